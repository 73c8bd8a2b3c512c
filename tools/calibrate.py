#!/usr/bin/env python3
"""Calibrates a pair of cameras from pictures of a board, or checks a calibration.

    python3 -m pip install -r tools/requirements.txt
    python3 tools/calibrate.py pictures --board 9x6 --square 25mm --out calibration.yml
    vgstereo calibration calibration.yml

The board has black and white squares (a chessboard), or markers in the white ones (ChArUco). Print
it, glue it to something stiff and flat, and measure the side of a square: all distances follow from
that.

Take 10 to 20 pairs, both cameras at the same moment, with the board or the cameras still:
  - the whole board is in both views, large, sharp and without glare;
  - it is tilted in several directions: flat ones alone do not tell the focal length;
  - the pairs together have it in all parts of both views, the corners too;
  - focus, zoom and size of the pictures stay as they will be used.

Pairs are found by names that differ in the side alone: left01.png right01.png, 01_l.png 01_r.png,
left/01.png right/01.png, cam0/01.png cam1/01.png. Pictures in which the board is not seen whole
cannot be used and are left out; the screen names them. Those that spoil the calibration are named
with the reason, and are left out if you ask for it with --drop.

The screen tells for each pair how far the corners are from where the calibrated cameras should see
them, and how far they are from lying on one line of both views once these are rectified, in pixels
of the pictures. The vertical error counts for stereo: 0.3 px or less is good, 1 px or more costs
matches.
"""

import os
import sys

try:
    import cv2  # noqa: F401
    import numpy
    import tqdm  # noqa: F401
except ImportError as missing:
    print(f"error: {missing}: python3 -m pip install -r tools/requirements.txt", file=sys.stderr)
    sys.exit(2)

from calibration import Refused, files
from calibration.cameras import calibrate_alone, calibrate_stereo, rms
from calibration.doubts import SIDES, doubts, empty_parts, standing_out
from calibration.options import parsed
from calibration.pairs import board_of, ensure_enough, seen_pairs
from calibration.pictures import shown

# Vertical errors from which a calibration is called worse than good, and bad, px.
GOOD_PX, BAD_PX = 0.3, 1.0


def table(pairs, residuals, verticals):
    """The errors of each pair and of all, px."""
    width = max(len(pair.name()) for pair in pairs)
    yield f"{'pair':{width}}  left px  right px  vertical px"
    for pair, (left, right), vertical in zip(pairs, residuals, verticals):
        yield f"{pair.name():{width}}  {left:7.2f}  {right:8.2f}  {rms(vertical):11.2f}"
    left, right = (rms([residual[side] for residual in residuals]) for side in (0, 1))
    yield (
        f"{'all, rms':{width}}  {left:7.2f}  {right:8.2f} "
        f" {rms(numpy.concatenate(verticals)):11.2f}"
    )


def calibrate(options):
    """Calibrates, writes the file and prints how good it is."""
    lens = "fisheye" if options.fisheye else "rational" if options.rational else "pinhole"
    board = board_of(options)
    pairs, size, notes = seen_pairs(options, board)
    while True:
        ensure_enough(pairs, notes)
        views = [
            (
                [board.points(pair.seen[side].ids) for pair in pairs],
                [pair.seen[side].px for pair in pairs],
            )
            for side in (0, 1)
        ]
        alone, found_lens = calibrate_alone(views, size, lens)
        common = [pair.common(board) for pair in pairs]
        points, left_px, right_px = ([corners[i] for corners in common] for i in range(3))
        stereo, residuals = calibrate_stereo(
            points, left_px, right_px, [camera.camera for camera in alone], size, found_lens
        )
        verticals = [stereo.vertical_px(*corners[1:]) for corners in common]
        total = rms(residuals)
        reason = unusable(
            stereo, total, rms([by_itself.residuals_px for by_itself in alone]), board
        )
        spoilers = doubts(pairs, board, alone)
        # Without a calibration, vertical errors mean nothing.
        for i, doubt in [] if reason else vertical_doubts(verticals):
            spoilers.setdefault(i, doubt)
        notes += [
            f"{pairs[i].name()} {'left out' if options.drop else 'spoils it'}: {spoilers[i]}"
            for i in sorted(spoilers)
        ]
        if not options.drop or not spoilers:
            break
        pairs = [pair for i, pair in enumerate(pairs) if i not in spoilers]
    if spoilers:
        notes.append("give --drop to leave out the pairs that spoil the calibration")
    if len(pairs) < 10:
        notes.append(f"{len(pairs)} pairs are few: 10 to 20 make it surer")

    if reason:
        print(*notes, sep="\n", end="\n" if notes else "")
        raise Refused(f"nothing is written: {reason}")
    vertical = rms(numpy.concatenate(verticals))
    figures = {"pairs": len(pairs), "stereo_rms_px": total, "vertical_rms_px": vertical}
    files.write_whole(options.out, files.text_of(stereo, figures))

    print(f"{len(pairs)} pairs of {size[0]}x{size[1]} px; lens: {found_lens}\n")
    print(*table(pairs, residuals, verticals), "", sep="\n")
    for side, name in enumerate(SIDES):
        print(camera_line(name, stereo.cameras[side], alone[side]))
        notes += camera_notes(
            name,
            stereo.cameras[side],
            alone[side],
            empty_parts(size, [pair.seen[side].px for pair in pairs]),
        )
    print(
        f"baseline {stereo.baseline:.2f} mm; stereo {total:.2f} px rms; vertical error "
        f"{vertical:.3f} px rms"
    )
    print(*notes, sep="\n", end="\n" if notes else "")
    if vertical > GOOD_PX:
        print(f"a vertical error of {GOOD_PX} px or less is good: see above what spoils it")
    print(f"wrote {shown(options.out)}")


def vertical_doubts(verticals):
    """The pairs whose vertical errors are far above those of others, with the reason."""
    errors = [rms(vertical) for vertical in verticals]
    found, median = standing_out(errors, 0.3)
    for i in found:
        yield (
            i,
            (
                f"its vertical error is {errors[i]:.2f} px, that of most pairs about {median:.2f}"
                " px: the views were not taken at the same moment, or corners were found wrongly"
            ),
        )


def camera_line(name, camera, alone):
    (fx, _, cx), (_, fy, cy), _ = camera.matrix
    deviation = alone.focal_deviation_px
    about = "" if deviation is None else f" (deviation {deviation:.1f})"
    return (
        f"{name} camera: focal length {fx:.1f} x {fy:.1f} px{about}, principal point {cx:.1f}, "
        f"{cy:.1f}; alone {rms(alone.residuals_px):.2f} px rms"
    )


def camera_notes(name, camera, alone, empty):
    """What the pictures leave open about a camera."""
    if alone.focal_deviation_px and alone.focal_deviation_px > 0.01 * camera.matrix[0, 0]:
        yield f"the focal length of the {name} camera is uncertain: tilt the board more"
    if empty:
        yield (
            f"no corner in these parts of the {name} view: {', '.join(empty)}; a lens is least"
            " known where no board was"
        )


def unusable(stereo, total, alone, board):
    """Why this is no calibration of two cameras side by side, if it is none."""
    x, y, z = stereo.translation.ravel()
    if stereo.baseline < 0.01 * board.square_mm:
        return "both views are from one place: are they the same pictures?"
    if total > max(3.0, 5 * alone):
        return (
            f"each view fits by itself ({alone:.2f} px rms) but not with the other ({total:.2f}"
            " px): pairs were not taken at the same moment, or a camera stands on its head"
        )
    if abs(x) < max(abs(y), abs(z)):
        return "the cameras do not stand side by side"
    if x > 0:
        return (
            "left and right are exchanged: the camera of the left pictures stands on the right;"
            " give --left and --right the other way round"
        )
    return None


def check(options):
    """Prints how well a calibration fits the pictures."""
    stereo = files.read(options.check, options.unit)
    board = board_of(options)
    pairs, size, notes = seen_pairs(options, board)
    if stereo.size not in (None, size):
        raise Refused(
            f"{shown(options.check[0])}: the calibration is of {stereo.size[0]}x"
            f"{stereo.size[1]} px, and the pictures have {size[0]}x{size[1]} px"
        )
    unit = "mm" if stereo.unit_mm else "units"
    width = max(len(pair.name()) for pair in pairs)
    print(f"{'pair':{width}}  vertical px: rms   mean  largest  square, {unit}")
    verticals, squares = [], []
    for pair in pairs:
        points, left_px, right_px = pair.common(board)
        vertical = stereo.vertical_px(left_px, right_px)
        places = stereo.places(left_px, right_px) * (stereo.unit_mm or 1.0)
        square = square_of(points, places, options.square)
        verticals.append(vertical)
        squares.append(square)
        print(
            f"{pair.name():{width}}  {rms(vertical):16.2f}  {vertical.mean():5.2f}  "
            f"{abs(vertical).max():7.2f}  {square:10.3f}"
        )
    notes += [f"{pairs[i].name()}: {reason}" for i, reason in vertical_doubts(verticals)]
    total, square = rms(numpy.concatenate(verticals)), float(numpy.median(squares))
    print(
        f"\npairs: {len(pairs)}; vertical error {total:.3f} px rms at a focal length of "
        f"{stereo.focal_px:.1f} px"
    )
    share = square / options.square
    if not stereo.unit_mm:
        print(
            f"squares measure {square:.4f} in the unit of the file, which states none; that of "
            f"{options.square:g} mm would make the unit {1 / share:.3f} mm: give --unit"
        )
    else:
        print(f"squares measure {square:.3f} mm; given are {options.square:g} mm")
        if not 0.97 < share < 1.03:
            notes.append(
                "the squares are off by more than 3 %, and so are distances: the cameras have "
                "moved, or --square, --unit or the calibration's unit is another one"
            )
    print(*notes, sep="\n", end="\n" if notes else "")
    if total > BAD_PX:
        print(f"calibrate anew: a vertical error of {BAD_PX:g} px or more costs matches")
    elif total > GOOD_PX:
        print(f"the vertical error is usable; {GOOD_PX:g} px or less is good")
    else:
        print("the vertical error is good")


def square_of(points, places, square):
    """The mean distance in space of corners that are neighbours on the board."""
    apart = numpy.linalg.norm(points[:, None] - points[None], axis=2)
    a, b = numpy.nonzero(numpy.isclose(apart, square, rtol=1e-3))
    return float(numpy.linalg.norm(places[a] - places[b], axis=1).mean())


def main():
    try:
        options = parsed(__doc__)
        (check if options.check else calibrate)(options)
        sys.stdout.flush()
    except Refused as refused:
        print(f"error: {refused}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader has seen enough. What is still to be printed goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
