"""The pairs of pictures that show the board, and why others are left out."""

from dataclasses import dataclass

import numpy
from tqdm import tqdm

from . import Refused, pictures
from .board import Charuco, Chessboard
from .pictures import shown

# Fewer do not tell all that is sought.
PAIRS_MIN = 5


@dataclass
class Pair:
    """A pair of pictures with the corners in both."""

    paths: tuple
    seen: list

    def name(self):
        return " ".join(shown(path.name) for path in self.paths)

    def common(self, board):
        """Corners that both views show: on the board, and in the left and the right picture."""
        left, right = self.seen
        ids, at_left, at_right = numpy.intersect1d(left.ids, right.ids, return_indices=True)
        return board.points(ids), left.px[at_left], right.px[at_right]


def board_of(options):
    if options.charuco is None:
        return Chessboard(*options.board, options.square)
    return Charuco(*options.board, options.square, options.marker, options.charuco)


def paths_of(options):
    """The pairs of pictures, and notes on those that are not of one."""
    if options.left:
        return pictures.pairs_by_patterns(options.folder, options.left, options.right), []
    pairs, alone = pictures.pairs_by_name(options.folder)
    if not pairs:
        raise Refused(
            f"{shown(options.folder)}: no two pictures are named as a pair, such as "
            "left01.png and right01.png; give --left GLOB and --right GLOB"
        )
    return pairs, [f"{shown(path.name)} has no partner" for path in alone]


def common_size(paths):
    """Width and height of most pictures, px."""
    sizes = [
        pictures.grey(path).shape[::-1]
        for pair in tqdm(paths, "reading", unit="pair", leave=False, disable=None)
        for path in pair
    ]
    return max(sorted(set(sizes)), key=sizes.count)


def seen_pairs(options, board):
    """The pairs that show the board, the size of the pictures, and notes on the others."""
    paths, notes = paths_of(options)
    if options.out and any(
        options.out.resolve() == path.resolve() for pair in paths for path in pair
    ):
        raise Refused(f"the output {shown(options.out)} would replace a picture")
    size = common_size(paths)
    pairs, renumbered = [], 0
    for pair in tqdm(paths, "corners", unit="pair", leave=False, disable=None):
        views = [pictures.grey(path) for path in pair]
        other = [view.shape[::-1] for view in views if view.shape[::-1] != size]
        names = " ".join(shown(path.name) for path in pair)
        if other:
            notes.append(
                f"{names} left out: {other[0][0]}x{other[0][1]} px, and most have "
                f"{size[0]}x{size[1]} px"
            )
            continue
        seen = [board.find(view) for view in views]
        if all(seen):
            seen[1], is_turned = board.matched(*seen)
            found = Pair(pair, seen)
            if len(found.common(board)[0]) >= 6:
                pairs.append(found)
                renumbered += is_turned
            else:
                notes.append(f"{names} left out: the views have hardly a corner in common")
        elif any(seen):
            lacking = shown(pair[0 if seen[0] is None else 1].name)
            notes.append(
                f"{names} left out: the board is not seen whole in {lacking}, or blurred or "
                "small there"
            )
        else:
            notes.append(
                f"{names} left out: no board of {options.board[0]}x{options.board[1]} corners "
                "in either view"
            )
    if renumbered:
        notes.append(
            f"in {renumbered} of {len(pairs)} pairs the right view numbered the board from "
            "another end: mended"
        )
    if not pairs:
        raise Refused(
            f"{shown(options.folder)}: no pair of {len(paths)} shows a board of "
            f"{options.board[0]}x{options.board[1]} corners in both views"
            + smaller_board(options, paths)
        )
    return pairs, size, notes


def smaller_board(options, paths):
    """A hint if squares were given instead of the corners between them."""
    columns, rows = (side - 1 for side in options.board)
    if options.charuco is None and min(columns, rows) >= 3:
        smaller = Chessboard(columns, rows, 1.0)
        if any(smaller.find(pictures.grey(path)) for path in paths[0]):
            return f"; one of {columns}x{rows} is there: count the corners, not the squares"
    return ""


def ensure_enough(pairs, notes):
    if len(pairs) < PAIRS_MIN:
        raise Refused(
            f"{len(pairs)} pairs can be used, and {PAIRS_MIN} are the least, 10 to 20 are good"
            + "".join(f"; {note}" for note in notes)
        )
