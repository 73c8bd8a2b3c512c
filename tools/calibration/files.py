"""Calibration files: written as OpenCV's programs do, read as OpenCV and ROS write them."""

import os
import pathlib
import tempfile

import cv2
import numpy

from . import Refused
from .cameras import Camera, Stereo
from .pictures import shown

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
BYTES_MAX = 1 << 20


def text_of(stereo, figures):
    """A calibration and further figures as OpenCV's YAML. Lengths are in mm."""
    storage = cv2.FileStorage("calibration.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", int(stereo.size[0]))
    storage.write("image_height", int(stereo.size[1]))
    # So do OpenCV's programs name it; four coefficients alone do not tell.
    storage.write("fisheye_model", int(stereo.cameras[0].is_fisheye))
    for name, camera in zip("12", stereo.cameras):
        storage.write(f"M{name}", camera.matrix)
        # OpenCV adds zeros to the eight of the rational model.
        storage.write(f"D{name}", camera.distortion.reshape(1, -1)[:, :8])
    storage.write("R", stereo.rotation)
    storage.write("T", stereo.translation)
    storage.write("translation_unit", "mm")
    for name, value in figures.items():
        storage.write(name, value)
    return storage.releaseAndGetString()


def write_whole(path, text):
    """Writes a file whole or not at all."""
    path = pathlib.Path(os.path.realpath(path))
    temporary = None
    try:
        if path.exists() and not path.is_file():
            # A pipe, or /dev/null.
            path.write_text(text)
            return
        handle, temporary = tempfile.mkstemp(prefix=".vgstereo-", dir=path.parent)
        with os.fdopen(handle, "w") as file:
            file.write(text)
        # Temporary files are private; this one becomes a file of the user with usual rights.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise Refused(f"cannot write {shown(path)}: {error.strerror}") from None
    finally:
        if temporary:
            os.unlink(temporary)


class File:
    """A file that OpenCV parses: its entries by name."""

    def __init__(self, path):
        self.name = shown(path)
        try:
            with open(path, "rb") as file:
                data = file.read(BYTES_MAX + 1)
            text = data.decode().lstrip("\ufeff")
        except OSError as error:
            raise Refused(f"cannot read {self.name}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise Refused(f"cannot read {self.name}: it is no text") from None
        if len(data) > BYTES_MAX:
            raise Refused(f"cannot read {self.name}: it has more than {BYTES_MAX} bytes")
        if not text.lstrip().startswith(("%YAML", "<", "{")):
            # Other programs leave out the line by which OpenCV knows YAML.
            text = "%YAML:1.0\n" + ("" if text.startswith("---") else "---\n") + text
        try:
            self.storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            is_open = self.storage.isOpened()
        except (cv2.error, SystemError):
            is_open = False
        if not is_open:
            raise Refused(f"cannot read {self.name}: it is no YAML, XML or JSON of OpenCV or ROS")

    def entry(self, *names):
        """The first entry that has one of these names."""
        for name in names:
            node = self.storage.getNode(name)
            if not node.empty():
                return node
        return None

    def numbers(self, *names):
        """The numbers of an entry as a list, if it is there."""
        node = self.entry(*names)
        if node is None:
            return None
        if node.isMap():
            node = node.getNode("data")
        if node.isReal() or node.isInt():
            return [node.real()]
        numbers = [node.at(i) for i in range(node.size())]
        if not all(number.isReal() or number.isInt() for number in numbers):
            raise Refused(f"{self.name}: {names[0]} is no list of numbers")
        return [number.real() for number in numbers]


def read(paths, unit_mm):
    """The calibration in one file or two; the unit of its translation, unless it is `None`,
    replaces what the files state."""
    files = [File(path) for path in paths]
    if all(file.entry("projection_matrix") for file in files):
        stereo = read_ros(files)
    else:
        stereo = read_opencv(files)
    if unit_mm is not None:
        stereo.unit_mm = unit_mm
    if not stereo.baseline > 0:
        raise Refused(
            f"{files[0].name}: the baseline is 0: these cameras are not calibrated as a pair"
        )
    return stereo


def camera_of(file, matrix, distortion, model):
    if matrix is None or distortion is None:
        raise Refused(
            f"{file.name}: a camera matrix or its distortion is missing; OpenCV's files have "
            "M1 D1 M2 D2 R T"
        )
    if len(matrix) != 9 or len(distortion) not in (0, 4, 5, 8, 12, 14):
        raise Refused(
            f"{file.name}: a camera matrix has 9 numbers and distortion 4, 5, 8, 12 or 14"
        )
    return Camera(
        numpy.array(matrix).reshape(3, 3),
        numpy.array(distortion).reshape(1, -1),
        model in ("equidistant", "fisheye"),
    )


def size_of(files):
    for file in files:
        sides = [file.numbers(name) for name in ("image_width", "image_height")]
        if all(sides):
            return tuple(int(side[0]) for side in sides)
    return None


def read_opencv(files):
    def numbers(*names):
        found = (file.numbers(*names) for file in files)
        return next((list_ for list_ in found if list_ is not None), None)

    is_fisheye = (numbers("fisheye_model") or [0])[0] == 1
    cameras = [
        camera_of(
            files[0],
            numbers(f"M{n}", f"K{n}", f"cameraMatrix{n}", f"camera_matrix_{side}"),
            numbers(
                f"D{n}", f"distCoeffs{n}", f"dist_coeffs_{side}", f"distortion_coefficients_{side}"
            ),
            "fisheye" if is_fisheye else "pinhole",
        )
        for n, side in (("1", "left"), ("2", "right"))
    ]
    rotation, translation = numbers("R"), numbers("T")
    if rotation is None or translation is None or len(translation) != 3 or len(rotation) != 9:
        raise Refused(
            f"{files[0].name}: there is no rotation R or no translation T from the left to the "
            "right camera"
        )
    units = [file.entry("translation_unit") for file in files]
    unit = next((node.string() for node in units if node is not None), None)
    return Stereo(
        cameras,
        numpy.array(rotation).reshape(3, 3),
        numpy.array(translation).reshape(3, 1),
        size_of(files),
        unit_mm=UNITS_MM.get(unit),
    )


def read_ros(files):
    if len(files) != 2:
        raise Refused(
            f"{files[0].name}: a camera_info file of ROS is of one camera: give those of the "
            "left and the right one"
        )
    if "right" in files[0].name.lower() and "left" in files[1].name.lower():
        files.reverse()
    cameras, turns, offsets = [], [], []
    for file in files:
        model = file.entry("distortion_model")
        cameras.append(
            camera_of(
                file,
                file.numbers("camera_matrix"),
                file.numbers("distortion_coefficients"),
                model.string() if model is not None else "",
            )
        )
        turn, projection = file.numbers("rectification_matrix"), file.numbers("projection_matrix")
        if turn is None or len(turn) != 9 or len(projection) != 12 or projection[0] <= 0:
            raise Refused(f"{file.name}: there is no rectification")
        turns.append(numpy.array(turn).reshape(3, 3))
        offsets.append(projection[3] / projection[0])
    translation = turns[1].T @ numpy.array([[offsets[1] - offsets[0]], [0], [0]])
    return Stereo(cameras, turns[1].T @ turns[0], translation, size_of(files), turns, 1000.0)
