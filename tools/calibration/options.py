"""The command line of tools/calibrate.py."""

import argparse
import math
import pathlib
import re

import cv2

from . import Refused
from .files import UNITS_MM
from .pictures import shown

LENGTHS_MM = {**UNITS_MM, "in": 25.4}


def length_mm(text):
    found = re.fullmatch(r"([0-9]*\.?[0-9]+)\s*([a-z]*)", text)
    if not found or found[2] not in {"", *LENGTHS_MM} or not float(found[1]) > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no length: write 25mm, 2.5cm, 0.025m or 1in")
    if not found[2]:
        raise argparse.ArgumentTypeError(
            f"{text} has no unit: write {text}mm, {text}cm or {text}in"
        )
    return float(found[1]) * LENGTHS_MM[found[2]]


def unit_mm(text):
    try:
        value = UNITS_MM[text] if text in UNITS_MM else float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no unit: write mm, cm, m, or millimetres")
    return value


def board_size(text):
    found = re.fullmatch(r"([0-9]{1,3})x([0-9]{1,3})", text)
    if not found or min(int(side) for side in found.groups()) < 3:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no board: write the corners between squares, across and down, such as 9x6"
            " for 10x7 squares; at least 3x3"
        )
    return int(found[1]), int(found[2])


def dictionary(text):
    name = "DICT_" + text.upper().removeprefix("DICT_")
    known = sorted(known for known in dir(cv2.aruco) if re.fullmatch("DICT_[0-9A-Z_]+", known))
    if name not in known:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no dictionary: " + " ".join(known).replace("DICT_", "")
        )
    return getattr(cv2.aruco, name)


class Parser(argparse.ArgumentParser):
    def error(self, message):
        raise Refused(message)


def parsed(text):
    """The options of the command line, with this text as its help."""
    words = text.split("\n\n")
    parser = Parser(
        description=words[0],
        epilog="\n\n".join(words[2:]) + "\n" + words[1],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=pathlib.Path, help="folder of the pictures")
    parser.add_argument(
        "--board",
        type=board_size,
        required=True,
        metavar="CxR",
        help=(
            "inner corners across and down, where four squares meet: one less than "
            "squares; also of a ChArUco board"
        ),
    )
    parser.add_argument(
        "--square",
        type=length_mm,
        required=True,
        metavar="LENGTH",
        help="side of a square with its unit: 25mm, 2.5cm, 1in",
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--out",
        type=pathlib.Path,
        metavar="FILE",
        help=(
            "calibration to write, OpenCV's YAML; lengths in mm. It has no rectification: "
            "vgstereo finds one that uses the views better than OpenCV's"
        ),
    )
    what.add_argument(
        "--check",
        type=pathlib.Path,
        nargs="+",
        metavar="FILE",
        help=(
            "calibration to check on the pictures instead, of OpenCV (one file, or "
            "intrinsics and extrinsics) or ROS (left and right); one pair is enough"
        ),
    )
    parser.add_argument(
        "--unit",
        type=unit_mm,
        help=(
            "with --check: unit of the translation if the file "
            "states none: mm, cm, m, or millimetres"
        ),
    )
    parser.add_argument(
        "--charuco",
        type=dictionary,
        metavar="DICT",
        help=(
            "the board has markers of this dictionary of OpenCV, such as 4X4_50; it need "
            "not be seen whole"
        ),
    )
    parser.add_argument("--marker", type=length_mm, metavar="LENGTH", help="side of a marker: 18mm")
    parser.add_argument(
        "--rational",
        action="store_true",
        help="lens of 8 coefficients instead of 5, for wide lenses: keep it if the errors fall",
    )
    parser.add_argument(
        "--fisheye",
        action="store_true",
        help="fisheye lens of 4 coefficients, from about 110 degrees",
    )
    parser.add_argument(
        "--drop",
        action="store_true",
        help="leave out the pairs that spoil the calibration, and calibrate anew",
    )
    parser.add_argument(
        "--left",
        metavar="GLOB",
        help=(
            "left pictures in the folder, with --right: 'a/*.png'; sorted by name, first with first"
        ),
    )
    parser.add_argument("--right", metavar="GLOB", help="right pictures")
    options = parser.parse_args()
    if (options.charuco is None) != (options.marker is None):
        parser.error("--charuco and --marker belong together")
    if options.marker and options.marker >= options.square:
        parser.error("--marker: a marker is smaller than a square")
    if (options.left is None) != (options.right is None):
        parser.error("--left and --right belong together")
    if options.rational and options.fisheye:
        parser.error("--rational and --fisheye: a lens has one model")
    if not options.folder.is_dir():
        parser.error(f"{shown(options.folder)}: there is no such folder")
    if options.out and (options.out.is_dir() or not options.out.resolve().parent.is_dir()):
        parser.error(f"--out {shown(options.out)}: it is a folder, or in one that does not exist")
    return options
