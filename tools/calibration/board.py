"""Boards, and their corners in a picture."""

from dataclasses import dataclass

import cv2
import numpy

# Half the side of the window in which a corner is refined, in distances to the next corner: turned
# by 45 degrees, it still ends half-way to that.
WINDOW = 0.35


@dataclass
class Seen:
    """The corners of a board in a picture."""

    ids: numpy.ndarray
    """Their numbers, rising: row by row from a corner of the board."""
    px: numpy.ndarray
    """Their places, N by 2."""
    edge_px: float | None
    """How wide the edges of the squares are, if that is known: more in blurred pictures."""


class Chessboard:
    """A board of squares, by the numbers of its inner corners."""

    def __init__(self, columns, rows, square_mm):
        self.columns, self.rows, self.square_mm = columns, rows, square_mm

    def points(self, ids):
        """The places of corners on the board, mm, N by 3."""
        row, column = numpy.divmod(ids, self.columns)
        return numpy.stack([column, row, 0 * ids], 1).astype(numpy.float32) * self.square_mm

    def find(self, picture):
        """The corners in a picture; `None` unless all are seen."""
        size = (self.columns, self.rows)
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        is_found, px = cv2.findChessboardCornersSB(picture, size, flags=flags)
        if not is_found:
            # It finds some that the newer one does not, such as boards without a white border.
            is_found, px = cv2.findChessboardCorners(
                picture, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
            )
        if not is_found:
            return None
        grid = px.reshape(self.rows, self.columns, 2).astype(numpy.float32)
        if numpy.linalg.det(directions(grid)) < 0:
            # Seen from the front, rows are numbered clockwise from columns.
            grid = grid[:, ::-1]
        px = refined(
            picture, grid.reshape(-1, 2), numpy.arange(grid[..., 0].size), self.columns, WINDOW
        )
        edge_px = cv2.estimateChessboardSharpness(picture, size, px.reshape(-1, 1, 2))[0][0]
        return Seen(numpy.arange(len(px)), px, edge_px)

    def matched(self, left, right):
        """The right corners, numbered as the left ones are, and whether they had been numbered from
        another end. A detector may begin at either end of a board, and many boards look the same
        when they are turned; the cameras of a pair stand nearly upright to each other."""
        shape = (self.rows, self.columns, 2)
        aim = directions(left.px.reshape(shape))
        turned = [numpy.rot90(right.px.reshape(shape), turns) for turns in range(4)]
        fits = [numpy.sum(aim * directions(grid)) if grid.shape == shape else -9 for grid in turned]
        best = int(numpy.argmax(fits))
        px = numpy.ascontiguousarray(turned[best].reshape(-1, 2))
        return Seen(right.ids, px, right.edge_px), best != 0


class Charuco:
    """A board of squares with markers in them, by the numbers of its inner corners."""

    def __init__(self, columns, rows, square_mm, marker_mm, dictionary):
        self.columns, self.rows, self.square_mm = columns, rows, square_mm
        # Markers must not come into the window.
        self.window = min(WINDOW, 0.5 * (1 - marker_mm / square_mm))
        self.detectors = []
        # Boards of an even number of rows were printed otherwise before OpenCV 4.6.
        for is_legacy in (False, True) if rows % 2 else (False,):
            board = cv2.aruco.CharucoBoard(
                (columns + 1, rows + 1),
                square_mm,
                marker_mm,
                cv2.aruco.getPredefinedDictionary(dictionary),
            )
            board.setLegacyPattern(is_legacy)
            self.detectors.append(cv2.aruco.CharucoDetector(board))

    points = Chessboard.points

    def find(self, picture):
        """The corners in a picture, those that are seen; `None` if there are hardly any."""
        best = []
        for detector in self.detectors:
            px, ids, _, _ = detector.detectBoard(picture)
            if ids is not None and len(ids) > len(best):
                best = sorted(zip(ids.ravel().tolist(), px.reshape(-1, 2).tolist()))
        ids, px = numpy.array([i for i, _ in best], int), numpy.array([p for _, p in best])
        # Corners on one line say nothing.
        rows, columns = numpy.divmod(ids, self.columns)
        if len(ids) < 6 or len(set(rows)) < 2 or len(set(columns)) < 2:
            return None
        return Seen(ids, refined(picture, px, ids, self.columns, self.window), None)

    def matched(self, _, right):
        """The right corners: markers number them."""
        return right, False


def refined(picture, px, ids, columns, window):
    """Corners where their edges cross, in a window of this share of the least distance to a next
    corner."""
    place = {int(number): at for number, at in zip(ids, px)}
    gaps = [
        numpy.linalg.norm(place[number] - place[other])
        for number in place
        for other in (number + 1, number + columns)
        if other in place and (other % columns or other == number + columns)
    ]
    half = max(2, int(min(gaps, default=0.0) * window))
    px = numpy.ascontiguousarray(px.reshape(-1, 1, 2), numpy.float32)
    return cv2.cornerSubPix(picture, px, (half, half), (-1, -1), (3, 100, 1e-3)).reshape(-1, 2)


def directions(grid):
    """The directions in which columns and rows of corners are counted, of length 1, as rows."""
    across, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    mean = numpy.stack([across.mean(0), down.mean(0)])
    return mean / numpy.linalg.norm(mean, axis=1, keepdims=True)
