#!/usr/bin/env python3
"""Prints the messages of a board, as of docs/link.md: link_decoder.py [FILE], or standard input."""
import struct, sys, zlib

# The fields of each kind: u and i are varints, b is a byte, f a float, s a text; ? marks an option.
KINDS = [line.split() for line in """unknown rest
hello s s u u u u u u s i u u u ?u b u\nframe-begun u u u u u u\nframe-done u\nframe-aborted u b
disparities u u u i16\nconfidences u u u u8\ndepths u u u u16\npoints u u u rest\nscan u u f f u u16
raw-pair u u u rest\nrectified-pair u u u rest\nstatistics u u u u u u u u u u u u u u u u u u
log b s\nanswer u b\ncamera u i i u i\nstate b u u ?uuuu b ?i ?b ?u ?b ?b ?b ?b""".split("\n")]

def unpack(count, body, kind):
    """The values of a packed line, None where there is none."""
    values = [] if body[0] else struct.unpack("<%d" % count + "BH"[kind != "u8"], body[1:])
    bits, at_bit, previous, none = int.from_bytes(body[1:], "little"), 0, 0, 0x8000 * (kind == "i16")
    def take(width):
        nonlocal at_bit
        at_bit += width
        return bits >> at_bit - width & (1 << width) - 1
    while len(values) < count:
        code, mask = take(4), 15
        mask, code = (take(4), take(4)) if code == 14 else (mask, code)
        mask, width = (0, 0) if code == 15 else (mask, 16 if code == 13 else code)
        for at in range(4):
            stored = take(width)
            if mask >> at & 1:
                previous = previous + ((stored >> 1) ^ -(stored & 1)) & 0xffff
            values.append(previous if mask >> at & 1 else none)
    signed = lambda v: v - 65536 if kind == "i16" and v > 32767 else v
    return [None if v == none else signed(v) for v in values[:count]]

def fields(kinds, body):
    """The values of the fields that a body begins with, and the bytes after them."""
    values = []
    for kind in kinds:
        varint = next((at for at, byte in enumerate(body) if byte < 128), 0) + 1
        number = sum((byte & 127) << 7 * at for at, byte in enumerate(body[:varint]))
        if kind[0] == "?":
            inner, body = fields(kind[1:] if body[0] else "", body[1:])
            values += inner or "-"; continue
        size, value = {"b": (1, lambda taken: taken[0]), "u": (varint, lambda _: number),
            "i": (varint, lambda _: number >> 1 ^ -(number & 1)), "rest": (len(body), bytes.hex),
            "f": (4, lambda taken: "%g" % struct.unpack("<f", taken)),
            "s": (varint + number, lambda taken: taken[varint:].decode())}.get(
            kind, (len(body), lambda taken: unpack(number, taken[varint:], kind)))
        body, values = body[size:], [*values, value(body[:size])]
    return values, body

stream = open(sys.argv[1], "rb") if len(sys.argv) > 1 else sys.stdin.buffer
for rest in filter(None, stream.read().split(b"\0")):
    plain, run = b"", 0
    while rest:
        run = rest[0]
        plain, rest = plain + rest[1:run] + b"\0" * (run < 255), rest[run:]
    plain = plain[:-1] if run < 255 else plain
    if len(plain) < 8 or zlib.crc32(plain[:-4]) != int.from_bytes(plain[-4:], "little"):
        print("damaged"); continue
    kinds = KINDS[plain[1] if plain[0] == 1 and plain[1] < len(KINDS) else 0]
    values = fields(["u", "u", *kinds[1:]], plain[2:-4])[0]
    print(*values[:2], kinds[0], *values[2:])
