"""Pairs of pictures in a folder, by their names."""

import re

import cv2
import numpy

from . import Refused

ENDINGS = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm", ".pnm"}

# What names the side: left, l or cam0, and right, r or cam1, as words; a word also begins at the
# capital of `imageLeft`. `bright` and `control` name none.
MARK = re.compile(
    r"(?i:(?<![a-z])(left|right|cam[-_]?[01](?![0-9])))(?![a-z])"
    r"|(?i:(?<![a-z])([lr])(?![a-z]))"
    r"|(?<=[a-z])(Left|Right|L|R)(?![a-z])"
)


def side(mark):
    """Which side a mark names: 0 is left, 1 is right."""
    return int(mark[0] in "rR" or mark.endswith("1"))


def natural(text):
    """A key that sorts 2 before 10."""
    return [
        (part.isdigit(), int(part) if part.isdigit() else 0, part)
        for part in re.split(r"([0-9]+)", text)
    ]


def shown(path):
    """A name for the terminal, in which what cannot be seen is escaped."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in str(path))


def pictures_of(folder, pattern):
    found = folder.glob(pattern)
    try:
        found = [path for path in found if path.suffix.lower() in ENDINGS and path.is_file()]
    except (NotImplementedError, ValueError) as error:
        raise Refused(f"{pattern}: {error}") from None
    return sorted(found, key=lambda path: natural(str(path.relative_to(folder))))


def pairs_by_name(folder):
    """The pairs whose names, with those of their folders, differ in the side alone; and the
    pictures that name a side and have no partner."""
    by_key = {}
    for path in pictures_of(folder, "*") + pictures_of(folder, "*/*"):
        name = path.relative_to(folder).as_posix()
        sides = {side(next(filter(None, mark))) for mark in MARK.findall(name)}
        if len(sides) == 1:
            by_key.setdefault(MARK.sub("*", name), {})[sides.pop()] = path
    keys = sorted(by_key, key=natural)
    pairs = [(by_key[key][0], by_key[key][1]) for key in keys if len(by_key[key]) == 2]
    alone = sorted(path for sides in by_key.values() if len(sides) == 1 for path in sides.values())
    return pairs, alone


def pairs_by_patterns(folder, left, right):
    """The pairs of two patterns, the first with the first by their names."""
    lefts, rights = pictures_of(folder, left), pictures_of(folder, right)
    if len(lefts) != len(rights) or not lefts:
        raise Refused(
            f"--left {left} names {len(lefts)} pictures and --right {right} names "
            f"{len(rights)}: they must be as many, and some"
        )
    for path in set(lefts) & set(rights):
        raise Refused(f"{shown(path)} is both a left and a right picture: --left and --right")
    return list(zip(lefts, rights))


def grey(path):
    """The levels of a picture, 8 bits."""
    try:
        data = numpy.frombuffer(path.read_bytes(), numpy.uint8)
    except OSError as error:
        raise Refused(f"cannot read {shown(path)}: {error.strerror}") from None
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if picture is None:
        raise Refused(f"cannot read {shown(path)}: it is no picture, or a damaged one")
    return picture
