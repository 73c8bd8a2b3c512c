"""Cameras and pairs of cameras: how they are calibrated from corners, and how well they fit."""

from dataclasses import dataclass

import cv2
import numpy

from . import Refused

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
# Flags of OpenCV by the lens.
LENS_FLAGS = {
    "pinhole": 0,
    "pinhole without k3": cv2.CALIB_FIX_K3,
    "rational": cv2.CALIB_RATIONAL_MODEL,
}
# A coefficient of at least so many standard deviations is told by the pictures. Deviations are told
# too small, because the errors of neighbouring corners are alike.
TOLD_DEVIATIONS = 5


def rms(values):
    """The root of the mean square, over all that is in `values`."""
    return float(numpy.sqrt(numpy.mean(numpy.square(values))))


@dataclass
class Camera:
    """A camera with its lens."""

    matrix: numpy.ndarray
    distortion: numpy.ndarray
    is_fisheye: bool

    def project(self, points, pose):
        """Where the camera sees points of the board, px."""
        if self.is_fisheye:
            px, _ = cv2.fisheye.projectPoints(
                points.reshape(1, -1, 3).astype(float), *pose, self.matrix, self.distortion
            )
        else:
            px, _ = cv2.projectPoints(points, *pose, self.matrix, self.distortion)
        return px.reshape(-1, 2)

    def tangents(self, px):
        """The rays that are seen at pixels, by their tangents."""
        px = px.reshape(-1, 1, 2).astype(float)
        if self.is_fisheye:
            rays = cv2.fisheye.undistortPoints(px, self.matrix, self.distortion)
        elif hasattr(cv2, "undistortPointsIter"):
            # The name in OpenCV 4. The default of 5 steps does not converge at the borders.
            rays = cv2.undistortPointsIter(px, self.matrix, self.distortion, None, None, CRITERIA)
        else:
            rays = cv2.undistortPoints(px, self.matrix, self.distortion, criteria=CRITERIA)
        return rays.reshape(-1, 2)


@dataclass
class Stereo:
    """Two cameras and how they stand to each other: x_right = rotation x_left + translation."""

    cameras: list
    rotation: numpy.ndarray
    translation: numpy.ndarray
    size: tuple
    """Width and height of the pictures, px."""
    rectifying: list | None = None
    """Rotations to the rectified views, if a file has them; otherwise they are Bouguet's."""
    unit_mm: float | None = 1.0
    """Millimetres in the unit of the translation, if it is known."""

    @property
    def baseline(self):
        """The distance between the cameras, in the unit of the translation."""
        return float(numpy.linalg.norm(self.translation))

    @property
    def focal_px(self):
        """The focal length at which errors are stated: the mean of both cameras' along lines."""
        return float(numpy.mean([camera.matrix[1, 1] for camera in self.cameras]))

    def right_pose(self, pose):
        """The pose of a board for the right camera, by that for the left one."""
        turned = self.rotation @ cv2.Rodrigues(pose[0])[0]
        return cv2.Rodrigues(turned)[0], self.rotation @ pose[1] + self.translation

    def rectified(self, left_px, right_px):
        """Corners in both rectified views, by their tangents: two arrays, N by 2."""
        turns = self.rectifying or rectifying(self.rotation, self.translation)
        views = []
        for camera, turn, px in zip(self.cameras, turns, (left_px, right_px)):
            rays = camera.tangents(px)
            rays = numpy.c_[rays, numpy.ones(len(rays))] @ turn.T
            views.append(rays[:, :2] / rays[:, 2:])
        return views

    def vertical_px(self, left_px, right_px):
        """How much lower each corner is in the left rectified view than in the right one, px at the
        scale of the pictures."""
        left, right = self.rectified(left_px, right_px)
        return (left - right)[:, 1] * self.focal_px

    def places(self, left_px, right_px):
        """Where corners are in space, in the unit of the translation, N by 3."""
        left, right = self.rectified(left_px, right_px)
        depth = self.baseline / (left - right)[:, 0]
        middle = 0.5 * (left[:, 1] + right[:, 1])
        return numpy.stack([left[:, 0], middle, numpy.ones(len(left))], 1) * depth[:, None]


def rectifying(rotation, translation):
    """Rotations from the cameras to the rectified views by Bouguet's method: each camera turns by
    half the rotation between them, and both turn until the baseline lies along the lines."""
    half_back = cv2.Rodrigues(-0.5 * cv2.Rodrigues(rotation)[0])[0]
    along = (half_back @ translation).ravel()
    along /= numpy.linalg.norm(along)
    target = numpy.array([-1.0, 0.0, 0.0])
    axis = numpy.cross(along, target)
    length = numpy.linalg.norm(axis)
    angle = numpy.arctan2(length, along @ target)
    aligned = cv2.Rodrigues(axis * (angle / length if length > 1e-12 else 0.0))[0]
    return [aligned @ half_back.T, aligned @ half_back]


@dataclass
class Alone:
    """A camera that was calibrated alone."""

    camera: Camera
    poses: list
    """Of the board in each picture: rotation vector and translation."""
    residuals_px: list
    """Rms distance of the corners of each picture from where they should be."""
    focal_deviation_px: float | None
    """Standard deviation of the focal length, where OpenCV tells it."""
    tells_k3: bool
    """Whether the pictures tell the third radial coefficient."""


def calibrate_alone(views, size, lens):
    """Both cameras by the corners of several pictures of each, on the board and seen; their lens.

    A third radial coefficient that the pictures do not tell is left out: it would follow the noise,
    and bend the borders of the views where no board was by whole pixels.
    """
    alone = [calibrate_camera(points, px, size, lens) for points, px in views]
    if lens == "pinhole" and not any(camera.tells_k3 for camera in alone):
        return calibrate_alone(views, size, "pinhole without k3")
    return alone, lens


def calibrate_camera(points, px, size, lens):
    """A camera by the corners of several pictures, on the board and seen, and by its lens: one of
    `LENS_FLAGS` or `fisheye`."""
    deviation, tells_k3 = None, False
    try:
        if lens == "fisheye":
            flags = fisheye_flags("RECOMPUTE_EXTRINSIC", "FIX_SKEW", "USE_INTRINSIC_GUESS")
            # The circle of 180 degrees as wide as the picture.
            focal = max(size) / numpy.pi
            guess = numpy.array(
                [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
            )
            _, matrix, distortion, turns, moves = cv2.fisheye.calibrate(
                [p.reshape(1, -1, 3).astype(float) for p in points],
                [p.reshape(1, -1, 2).astype(float) for p in px],
                size,
                guess,
                numpy.zeros((4, 1)),
                flags=flags,
                criteria=CRITERIA,
            )
        else:
            _, matrix, distortion, turns, moves, deviations, _, _ = cv2.calibrateCameraExtended(
                points, px, size, None, None, flags=LENS_FLAGS[lens], criteria=CRITERIA
            )
            deviation = float(deviations[:2].max())
            # Behind fx fy cx cy k1 k2 p1 p2.
            tells_k3 = abs(distortion.flat[4]) > TOLD_DEVIATIONS * float(deviations.flat[8])
    except cv2.error as error:
        raise Refused(f"OpenCV finds no camera that fits the corners: {error.err}") from None
    camera = Camera(matrix, distortion, lens == "fisheye")
    poses = [(turn.reshape(3, 1), move.reshape(3, 1)) for turn, move in zip(turns, moves)]
    residuals = [
        distance_px(camera.project(p, pose), seen) for p, pose, seen in zip(points, poses, px)
    ]
    return Alone(camera, poses, residuals, deviation, tells_k3)


def fisheye_flags(*names):
    """Flags of the fisheye functions, which are elsewhere in OpenCV 4 than in 5."""
    names = [f"CALIB_{name}" for name in names]
    return sum(getattr(cv2.fisheye if hasattr(cv2.fisheye, name) else cv2, name) for name in names)


def distance_px(a, b):
    """The rms distance between points of a plane."""
    return rms(numpy.linalg.norm(a - b, axis=1))


def calibrate_stereo(points, left_px, right_px, cameras, size, lens):
    """A pair of cameras by the corners that both see, from cameras that were calibrated alone; and
    the rms distances of each picture's corners from where they should be, left and right."""
    # OpenCV writes into what it starts from.
    start = [array.copy() for camera in cameras for array in (camera.matrix, camera.distortion)]
    try:
        if lens == "fisheye":
            flags = fisheye_flags("FIX_SKEW", "USE_INTRINSIC_GUESS")
            found = cv2.fisheye.stereoCalibrate(
                [p.reshape(1, -1, 3).astype(float) for p in points],
                [p.reshape(1, -1, 2).astype(float) for p in left_px],
                [p.reshape(1, -1, 2).astype(float) for p in right_px],
                *start,
                size,
                flags=flags,
                criteria=CRITERIA,
            )
            _, k1, d1, k2, d2, rotation, translation, turns, moves = found
        else:
            flags = cv2.CALIB_USE_INTRINSIC_GUESS | LENS_FLAGS[lens]
            found = cv2.stereoCalibrateExtended(
                points, left_px, right_px, *start, size, None, None, flags=flags, criteria=CRITERIA
            )
            _, k1, d1, k2, d2, rotation, translation, _, _, turns, moves, _ = found
    except cv2.error as error:
        raise Refused(
            f"OpenCV finds no pair of cameras that fits the corners: {error.err}"
        ) from None
    is_fisheye = lens == "fisheye"
    cameras = [Camera(k1, d1, is_fisheye), Camera(k2, d2, is_fisheye)]
    stereo = Stereo(cameras, rotation, translation.reshape(3, 1), tuple(size))
    residuals = []
    for p, left, right, turn, move in zip(points, left_px, right_px, turns, moves):
        pose = (turn.reshape(3, 1), move.reshape(3, 1))
        residuals.append(
            (
                distance_px(cameras[0].project(p, pose), left),
                distance_px(cameras[1].project(p, stereo.right_pose(pose)), right),
            )
        )
    return stereo, residuals
