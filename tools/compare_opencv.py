"""Times vgstereo against OpenCV on one thread, in turn, on the same pair.

    pip install opencv-python-headless
    cargo build --release
    python3 tools/compare_opencv.py middlebury/teddy

Each round matches the pair once with every method, so that a machine whose
speed drifts slows all of them; the table has medians over the rounds and their
ratio to StereoSGBM. Times are of matching alone: no files, no set-up.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import time

import cv2

ROOT = pathlib.Path(__file__).resolve().parent.parent


def opencv_methods(left, right, disparities):
    # SGBM wants a multiple of 16 disparities; 3x3 blocks and the penalties of OpenCV's sample.
    count = -(-disparities // 16) * 16
    block = 3
    sgbm = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=count, blockSize=block,
        P1=8 * block**2, P2=32 * block**2, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2)
    bm = cv2.StereoBM_create(numDisparities=count, blockSize=11)

    def timed(matcher):
        started = time.perf_counter()
        matcher.compute(left, right)
        return time.perf_counter() - started

    return {
        f"OpenCV StereoSGBM, {count} disparities": lambda: timed(sgbm),
        f"OpenCV StereoBM, {count} disparities": lambda: timed(bm),
    }


def vgstereo_method(scene, preset):
    command = [ROOT / "target/release/vgstereo", "eval", scene.parent, scene.name,
               "--preset", preset, "--json"]

    def run():
        report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        return report["presets"][0]["scenes"][0]["seconds"]

    return run


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=pathlib.Path, help="folder of one scene, as for `vgstereo eval`")
    parser.add_argument("--presets", default="paper-raw,paper", help="separated by commas")
    parser.add_argument("--rounds", type=int, default=21)
    arguments = parser.parse_args()
    scene = arguments.scene.resolve()
    left, right = (cv2.imread(str(scene / f"{view}.png"), cv2.IMREAD_GRAYSCALE)
                   for view in ("left", "right"))
    if left is None or right is None:
        parser.error(f"{scene} has no left.png or right.png")
    report = subprocess.run([ROOT / "target/release/vgstereo", "eval", scene.parent, scene.name,
                             "--preset", "paper-raw", "--json"], check=True, capture_output=True)
    d_max = json.loads(report.stdout)["presets"][0]["scenes"][0]["d_max"]

    cv2.setNumThreads(1)
    methods = opencv_methods(left, right, d_max + 1)
    for preset in arguments.presets.split(","):
        methods[f"vgstereo {preset}, {d_max + 1} disparities"] = vgstereo_method(scene, preset)
    times = {name: [] for name in methods}
    for _ in range(arguments.rounds):
        for name, method in methods.items():
            times[name].append(method())

    medians = {name: statistics.median(found) for name, found in times.items()}
    base = next(iter(medians.values()))
    print(f"{scene.name}, {left.shape[1]}x{left.shape[0]}, one thread, "
          f"{arguments.rounds} rounds, OpenCV {cv2.__version__}\n")
    print("| method | median ms | of StereoSGBM |\n|---|---:|---:|")
    for name, median in medians.items():
        print(f"| {name} | {median * 1e3:.1f} | {median / base:.2f} |")


if __name__ == "__main__":
    main()
