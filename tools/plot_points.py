"""A picture of a cloud of points, as `vgstereo match --points FILE.ply` writes it.

    pip install numpy opencv-python-headless
    python3 tools/plot_points.py cloud.ply points.jpg
    python3 tools/plot_points.py cloud.ply side.png --turn 50 --tilt 0

Any binary little-endian PLY whose vertices come first, with x, y, z in metres (right, down,
forward) and red, green, blue. The cloud is seen by a pinhole that was carried around the middle
of the cloud: by `--turn` degrees to the right and by `--tilt` degrees up, still looking at it.
"""

import argparse

import cv2
import numpy

TYPES = {"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4",
         "uint": "<u4", "float": "<f4", "double": "<f8"}


def vertices(path):
    """The known vertices of a PLY, in their order."""
    with open(path, "rb") as file:
        lines = []
        while not lines or lines[-1] != ["end_header"]:
            line = file.readline()
            if not line:
                raise SystemExit(f"{path}: the header has no end")
            lines.append(line.decode("latin-1").split())
            if lines[0] != ["ply"]:
                raise SystemExit(f"{path}: no PLY")
        if ["format", "binary_little_endian", "1.0"] not in lines:
            raise SystemExit(f"{path}: no binary little-endian PLY")
        elements = [at for at, line in enumerate(lines) if line[:1] == ["element"]]
        first, after = elements[0], (elements + [len(lines)])[1]
        if lines[first][1] != "vertex":
            raise SystemExit(f"{path}: the vertices do not come first")
        fields = [(line[2], TYPES[line[1]]) for line in lines[first:after] if line[0] == "property"]
        points = numpy.fromfile(file, fields, int(lines[first][2]))
    return points[numpy.isfinite(points["z"])]


def turned(places, turn, tilt):
    """Places in the axes of the carried pinhole, in units of its distance to the middle."""
    middle = numpy.median(places, axis=0)
    angles = numpy.radians([turn, tilt])
    (sin_a, sin_b), (cos_a, cos_b) = numpy.sin(angles), numpy.cos(angles)
    about_y = numpy.array([[cos_a, 0, sin_a], [0, 1, 0], [-sin_a, 0, cos_a]])
    about_x = numpy.array([[1, 0, 0], [0, cos_b, -sin_b], [0, sin_b, cos_b]])
    turned = (places - middle) @ (about_x @ about_y).T / middle[2]
    return turned + [0, 0, 1]


def picture(points, turn, tilt, width, height, zoom):
    places = numpy.stack([points[axis] for axis in "xyz"], axis=1).astype(float)
    colours = numpy.stack([points[name] for name in ("blue", "green", "red")], axis=1)
    x, y, z = turned(places, turn, tilt).T
    focal = zoom * width
    seen = z > 0.05
    # The farthest first, so that what is near hides it.
    order = numpy.argsort(-z[seen])
    x, y, z, colours = x[seen][order], y[seen][order], z[seen][order], colours[seen][order]
    column = numpy.rint(focal * x / z + width / 2).astype(int)
    row = numpy.rint(focal * y / z + height / 2).astype(int)
    canvas = numpy.full((height, width, 3), 255, numpy.uint8)
    for down in (0, 1):
        for right in (0, 1):
            rows, columns = row + down, column + right
            inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
            canvas[rows[inside], columns[inside]] = colours[inside]
    return canvas


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("cloud")
    parser.add_argument("picture")
    parser.add_argument("--turn", type=float, default=25, help="degrees to the right")
    parser.add_argument("--tilt", type=float, default=15, help="degrees up")
    parser.add_argument("--zoom", type=float, default=1, help="focal length, widths of the picture")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    options = parser.parse_args()
    try:
        points = vertices(options.cloud)
    except OSError as error:
        raise SystemExit(error)
    if not points.size:
        raise SystemExit(f"{options.cloud}: it has no points")
    drawn = picture(points, options.turn, options.tilt, options.width, options.height, options.zoom)
    try:
        is_written = cv2.imwrite(options.picture, drawn)
    except cv2.error:
        is_written = False
    if not is_written:
        raise SystemExit(f"cannot write {options.picture}")


if __name__ == "__main__":
    main()
