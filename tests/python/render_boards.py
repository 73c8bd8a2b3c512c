"""Renders pairs of pictures of a board through two cameras that are known, for the tests.

Writes left_01.png right_01.png ... and truth.yml, the cameras as OpenCV's files have them. The lens
formulas are written out here, so that OpenCV's are not compared with themselves. Lengths are in mm.
"""

import argparse
import pathlib

import cv2
import numpy

SIZE = (480, 360)
SQUARE, MARKER = 25.0, 18.0
# Pixels of the board's texture per square.
TEXELS = 40
# Samples per pixel in each direction.
SAMPLES = 2
CAMERAS = {
    "pinhole": [
        ((402.0, 401.0, 236.0, 184.0), (-0.28, 0.09)),
        ((398.0, 399.5, 245.0, 174.0), (-0.26, 0.07)),
    ],
    # Of 130 degrees from corner to corner.
    "fisheye": [
        ((262.0, 261.0, 236.0, 184.0), (0.02, -0.01, 0.004, -0.001)),
        ((258.0, 259.0, 245.0, 174.0), (0.015, -0.008, 0.003, -0.0005)),
    ],
}
TURN, MOVE = numpy.array([0.012, -0.018, 0.014]), numpy.array([[-60.0], [1.1], [-0.7]])


def distorted(tangent, lens, coefficients):
    """How far from the axis, in focal lengths, a ray of this tangent meets the sensor."""
    of = numpy.arctan(tangent) if lens == "fisheye" else tangent
    return of * (1 + sum(k * of ** (2 * power) for power, k in enumerate(coefficients, 1)))


def project(points, lens, camera):
    (fx, fy, cx, cy), coefficients = camera
    tangents = points[:, :2] / points[:, 2:]
    radius = numpy.linalg.norm(tangents, axis=1, keepdims=True)
    bent = tangents * distorted(radius, lens, coefficients) / numpy.maximum(radius, 1e-9)
    return bent * (fx, fy) + (cx, cy)


def rays(lens, camera):
    """The tangents of the rays through all samples of a picture."""
    (fx, fy, cx, cy), coefficients = camera
    columns, lines = ((numpy.arange(side * SAMPLES) + 0.5) / SAMPLES - 0.5 for side in SIZE)
    x, y = numpy.meshgrid((columns - cx) / fx, (lines - cy) / fy)
    radius = numpy.hypot(x, y)
    table = numpy.linspace(0, 3.0, 30001)
    scale = numpy.interp(radius, distorted(table, lens, coefficients), table) / numpy.maximum(
        radius, 1e-9
    )
    return numpy.stack([x * scale, y * scale, numpy.ones_like(x)], -1)


def texture(columns, rows, is_charuco):
    """A board with these inner corners and a white border of one square, levels."""
    if is_charuco:
        marks = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_100)
        board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), SQUARE, MARKER, marks)
        squares = board.generateImage(((columns + 1) * TEXELS, (rows + 1) * TEXELS))
    else:
        parity = numpy.indices((rows + 1, columns + 1)).sum(0) % 2
        squares = numpy.kron(parity * 255, numpy.ones((TEXELS, TEXELS))).astype(numpy.uint8)
    return numpy.pad(squares, TEXELS, constant_values=255)


def view(ray, board, pose, bend_mm):
    """A picture of the board."""
    turn, move = pose
    homography = numpy.linalg.inv(numpy.c_[turn[:, :2], move])
    at = ray @ homography.T
    x, y = at[..., 0] / at[..., 2], at[..., 1] / at[..., 2]
    x = x + bend_mm * numpy.sin(y / SQUARE)
    # The first inner corner is at 0, 0, two squares from the border's corner.
    x, y = (((mm / SQUARE + 2) * TEXELS - 0.5).astype(numpy.float32) for mm in (x, y))
    levels = cv2.remap(board, x, y, cv2.INTER_LINEAR, borderValue=128)
    levels[at[..., 2] <= 0] = 128
    levels = cv2.resize(levels, SIZE, interpolation=cv2.INTER_AREA).astype(float)
    return 40 + levels * 170 / 255


def poses(generator, count, lens, cameras, corners, roll, is_partial):
    """Poses of the board that both cameras see whole."""
    turn = cv2.Rodrigues(TURN)[0]
    middle = corners.mean(0)
    reach = 1.0 if lens == "fisheye" else 0.5
    while count:
        depth = generator.uniform(160, 420) if lens == "fisheye" else generator.uniform(330, 620)
        tilt = numpy.array([*generator.uniform(-0.5, 0.5, 2), 0])
        spin = numpy.array([0, 0, numpy.radians(roll) + generator.uniform(-0.2, 0.2)])
        own = cv2.Rodrigues(tilt)[0] @ cv2.Rodrigues(spin)[0]
        at = numpy.array([*generator.uniform(-reach, reach, 2), 1.0]) * depth
        move = (at - own @ middle).reshape(3, 1)
        both = [(own, move), (turn @ own, turn @ move + MOVE)]
        slack = -30 if is_partial else 4
        seen = [
            project(corners @ own.T + move.T, lens, camera)
            for (own, move), camera in zip(both, cameras)
        ]
        if all((px > slack).all() and (px < numpy.array(SIZE) - 1 - slack).all() for px in seen):
            count -= 1
            yield both


def truth(lens, cameras):
    """The cameras in OpenCV's names."""
    lines = [
        f"image_width: {SIZE[0]}",
        f"image_height: {SIZE[1]}",
        f"fisheye_model: {int(lens == 'fisheye')}",
        "translation_unit: mm",
    ]

    def numbers(values):
        return "[" + ", ".join(repr(float(value)) for value in values) + "]"

    for name, ((fx, fy, cx, cy), coefficients) in zip("12", cameras):
        lines.append(f"M{name}: " + numbers([fx, 0, cx, 0, fy, cy, 0, 0, 1]))
        if lens == "pinhole":
            coefficients = (*coefficients, 0, 0, 0)
        lines.append(f"D{name}: " + numbers(coefficients))
    lines += ["R: " + numbers(cv2.Rodrigues(TURN)[0].ravel()), "T: " + numbers(MOVE.ravel())]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--board", default="9x6", help="inner corners")
    parser.add_argument("--lens", choices=CAMERAS, default="pinhole")
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--roll", type=float, default=0.0, help="of the board, degrees")
    parser.add_argument(
        "--charuco", action="store_true", help="markers of 4X4_100, partly out of sight"
    )
    parser.add_argument(
        "--moved", type=int, help="pair whose board moves by 8 mm between the pictures"
    )
    parser.add_argument("--bent", type=int, help="pair whose board is not as printed")
    parser.add_argument(
        "--covered", type=int, help="pair whose right view does not show the whole board"
    )
    options = parser.parse_args()
    columns, rows = map(int, options.board.split("x"))
    generator = numpy.random.default_rng(7)
    board = texture(columns, rows, options.charuco)
    cameras = CAMERAS[options.lens]
    corners = (
        numpy.array([[x, y, 0] for y in (-1.3, rows + 0.3) for x in (-1.3, columns + 0.3)]) * SQUARE
    )
    ray = [rays(options.lens, camera) for camera in cameras]
    (options.folder / "truth.yml").write_text(truth(options.lens, cameras))
    found = poses(
        generator, options.pairs, options.lens, cameras, corners, options.roll, options.charuco
    )
    for number, both in enumerate(found, 1):
        if number == options.moved:
            own, move = both[1]
            both[1] = (own, move + [[6.0], [0.0], [5.0]])
        for side, name in enumerate(("left", "right")):
            bend_mm = 1.5 if number == options.bent else 0.0
            levels = view(ray[side], board, both[side], bend_mm)
            if number == options.covered and side == 1:
                own, move = both[1]
                middle = corners.mean(0, keepdims=True) @ own.T + move.T
                x, y = project(middle, options.lens, cameras[1])[0]
                levels[:, int(x) :] = 100
            levels += generator.normal(0, 2, levels.shape)
            levels = numpy.clip(numpy.rint(levels), 0, 255).astype(numpy.uint8)
            cv2.imwrite(str(options.folder / f"{name}_{number:02}.png"), levels)


if __name__ == "__main__":
    main()
