"""Pairs that spoil a calibration, each with its reason, and parts of the views without corners."""

import cv2
import numpy

from .cameras import Stereo, distance_px
from .pictures import shown

SIDES = ("left", "right")


def standing_out(values, floor):
    """The numbers of the values that are above three times the median, and above it by `floor`."""
    median = float(numpy.median(values))
    return [i for i, value in enumerate(values) if value > max(3 * median, median + floor)], median


def misfits(pairs, alone, side):
    """The pairs whose picture of one side does not fit even the camera that was calibrated alone,
    with the reason."""
    residuals = alone.residuals_px
    edges = [pair.seen[side].edge_px or 0.0 for pair in pairs]
    found, median = standing_out(residuals, 0.2)
    for i in found:
        is_blurred = edges[i] > max(1.5 * numpy.median(edges), numpy.median(edges) + 1)
        cause = (
            "it is blurred"
            if is_blurred
            else "the board is bent, part of it is covered, or it mirrors a light"
        )
        yield (
            i,
            (
                f"the corners in {shown(pairs[i].paths[side].name)} are {residuals[i]:.2f} px off "
                f"the shape of the board, those of other pictures {median:.2f} px: {cause}"
            ),
        )


def between(left_pose, right_pose):
    """The rotation and the translation from the left camera to the right one by a board's poses."""
    left, right = cv2.Rodrigues(left_pose[0])[0], cv2.Rodrigues(right_pose[0])[0]
    rotation = right @ left.T
    return rotation, right_pose[1] - rotation @ left_pose[1]


def moved(pairs, board, alone, kept):
    """The pairs whose board stands elsewhere for the right camera than most pairs say by the left
    one, with the reason."""
    motions = [
        Stereo([], *between(left, right), None)
        for left, right in zip(alone[0].poses, alone[1].poses)
    ]

    def off_px(motion, i):
        seen = pairs[i].seen[1]
        expected = alone[1].camera.project(
            board.points(seen.ids), motion.right_pose(alone[0].poses[i])
        )
        return distance_px(expected, seen.px)

    # The motion on which most agree.
    offs = [[off_px(motions[i], j) for j in kept] for i in kept]
    best = int(numpy.argmin(numpy.median(offs, axis=1)))
    motion = motions[kept[best]]
    found, _ = standing_out(offs[best], 1.0)
    middle = board.points(numpy.arange(board.columns * board.rows)).mean(0).reshape(3, 1)

    def place(pose):
        return cv2.Rodrigues(pose[0])[0] @ middle + pose[1]

    for i in (kept[at] for at in found):
        far_mm = numpy.linalg.norm(
            place(alone[1].poses[i]) - place(motion.right_pose(alone[0].poses[i]))
        )
        yield (
            i,
            (
                f"the board stands {far_mm:.0f} mm elsewhere for the right camera than for the left"
                " one: the two were not taken at the same moment, or do not belong together"
            ),
        )


def doubts(pairs, board, alone):
    """The pairs that spoil a calibration, by number, with the reason of each."""
    found = {}
    for side, _ in enumerate(SIDES):
        for i, reason in misfits(pairs, alone[side], side):
            found.setdefault(i, reason)
    kept = [i for i in range(len(pairs)) if i not in found]
    found.update(moved(pairs, board, alone, kept))
    return found


def empty_parts(size, px):
    """The ninths of the picture in which the corners of no picture are, by name."""
    parts = numpy.floor(numpy.concatenate(px) / numpy.array(size) * 3).clip(0, 2)
    filled = {(int(x), int(y)) for x, y in parts}
    names = [
        ["top left", "top", "top right"],
        ["left", "middle", "right"],
        ["bottom left", "bottom", "bottom right"],
    ]
    return [names[y][x] for y in range(3) for x in range(3) if (x, y) not in filled]
