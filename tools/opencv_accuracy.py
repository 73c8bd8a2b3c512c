"""Bad pixels of OpenCV's StereoSGBM, measured as `vgstereo eval` measures.

    pip install opencv-python-headless
    python3 tools/opencv_accuracy.py middlebury/{tsukuba,venus,teddy,cones}
    python3 tools/opencv_accuracy.py kitti2012/* --threshold 3
    python3 tools/opencv_accuracy.py middlebury/teddy --gain 1.6

3x3 blocks and the penalties of OpenCV's sample; holes take the smaller of the
disparities beside them; then a 3x3 median. `--gain` and `--offset` change the right
view's levels as `vgstereo exposure` does.
"""

import argparse
import pathlib
import statistics
import tomllib

import cv2
import numpy


def disparities(left, right, d_max):
    block = 3
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=-(-(d_max + 1) // 16) * 16, blockSize=block,
        P1=8 * block**2, P2=32 * block**2, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2)
    found = matcher.compute(left, right).astype(numpy.float32) / 16
    found[found < 0] = numpy.inf
    for line in found:
        known = numpy.flatnonzero(numpy.isfinite(line))
        if known.size:
            at = numpy.arange(line.size)
            before = numpy.searchsorted(known, at, "right") - 1
            after = numpy.searchsorted(known, at, "left")
            on_left = numpy.where(before >= 0, line[known[before.clip(0)]], numpy.inf)
            on_right = numpy.where(after < known.size, line[known[after.clip(max=known.size - 1)]],
                                   numpy.inf)
            holes = ~numpy.isfinite(line)
            line[holes] = numpy.minimum(on_left, on_right)[holes]
    return cv2.medianBlur(found, 3)


def exposed(view, gain, offset):
    return numpy.clip(numpy.rint(view * gain + offset), 0, 255).astype(numpy.uint8)


def bad_pixels(scene, threshold, gain=1.0, offset=0.0):
    meta = tomllib.loads((scene / "meta.toml").read_text())
    read = lambda name, flag: cv2.imread(str(scene / name), flag)
    left, right = read("left.png", cv2.IMREAD_COLOR), read("right.png", cv2.IMREAD_COLOR)
    views = [cv2.cvtColor(view, cv2.COLOR_BGR2GRAY) for view in (left, exposed(right, gain, offset))]
    found = disparities(*views, meta["d_max"])
    truth = read("gt_left.png", cv2.IMREAD_UNCHANGED).astype(numpy.float32)
    bad = numpy.abs(found - truth / meta["gt_scale"]) > threshold
    rates = []
    for mask in ("nonocc", "all", "disc"):
        if (scene / f"{mask}.png").is_file():
            inside = (read(f"{mask}.png", cv2.IMREAD_GRAYSCALE) == 255) & (truth > 0)
            rates.append(100 * bad[inside].mean())
    # Without a mask, all known truth counts.
    return statistics.mean(rates or [100 * bad[truth > 0].mean()])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=pathlib.Path, nargs="+", help="folders, as for `vgstereo eval`")
    parser.add_argument("--threshold", type=float, default=1.0)
    parser.add_argument("--gain", type=float, default=1.0, help="of the right camera")
    parser.add_argument("--offset", type=float, default=0.0, help="its black level, grey levels")
    arguments = parser.parse_args()
    scenes = [scene for scene in arguments.scenes if (scene / "left.png").is_file()]
    rates = [bad_pixels(scene, arguments.threshold, arguments.gain, arguments.offset)
             for scene in scenes]
    for scene, rate in zip(scenes, rates):
        print(f"{scene.name:12} {rate:6.2f}")
    print(f"{'average':12} {statistics.mean(rates):6.2f}")


if __name__ == "__main__":
    main()
