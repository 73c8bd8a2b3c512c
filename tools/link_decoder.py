#!/usr/bin/env python3
"""Prints the messages of a board, as of docs/link.md: link_decoder.py [FILE], or standard input."""
import struct, sys, zlib

# The fields of each kind: u and i are varints, b is a byte, f a float, s a text; ? marks an option.
KINDS = [line.split() for line in """unknown rest
hello s s u u u u u u s i u u u ?u b u\nframe-begun u u u u u u\nframe-done u\nframe-aborted u b
disparities u u u i16\nconfidences u u u u8\ndepths u u u u16\npoints u u u rest\nscan u u f f u u16
raw-pair u u u rest\nrectified-pair u u u rest\nstatistics u u u u u u u u u u u u u u u u u u
log b s\nanswer u b""".split("\n")]

def unpack(count, body, kind):
    """The values of a packed line, None where there is none."""
    none, values, previous = 0x8000 if kind == "i16" else 0, [], 0
    if body[0] == 0:
        values = struct.unpack("<%d%s" % (count, "B" if kind == "u8" else "H"), body[1:])
    bits = int.from_bytes(body[1:], "little")
    def take(width):
        nonlocal bits
        taken, bits = bits & (1 << width) - 1, bits >> width
        return taken
    while len(values) < count:
        code, mask = take(4), 15
        if code == 14:
            mask, code = take(4), take(4)
        mask, width = (0, 0) if code == 15 else (mask, 16 if code == 13 else code)
        for at in range(4):
            stored = take(width)
            if mask >> at & 1:
                previous = previous + ((stored >> 1) ^ -(stored & 1)) & 0xffff
            values.append(previous if mask >> at & 1 else none)
    signed = [value - 65536 if kind == "i16" and value > 32767 else value for value in values]
    return [None if values[at] == none else signed[at] for at in range(count)]

def field(kind, body):
    """The value of a field and the bytes after it."""
    if kind[0] == "?":
        return field(kind[1:], body[1:]) if body[0] else ("-", body[1:])
    if kind == "rest":
        return body.hex(), b""
    if kind == "b":
        return body[0], body[1:]
    if kind == "f":
        return "%g" % struct.unpack("<f", body[:4]), body[4:]
    length = next(at for at, byte in enumerate(body) if byte < 128) + 1
    number = sum((byte & 127) << 7 * at for at, byte in enumerate(body[:length]))
    body = body[length:]
    if kind == "s":
        return body[:number].decode(), body[number:]
    if kind in ("i16", "u8", "u16"):
        return unpack(number, body, kind), b""
    return (number >> 1) ^ -(number & 1) if kind == "i" else number, body

with open(sys.argv[1], "rb") if len(sys.argv) > 1 else sys.stdin.buffer as stream:
    packets = stream.read().split(b"\0")
for rest in filter(None, packets):
    plain, run = b"", 0
    while rest:
        run, plain = rest[0], plain + rest[1:rest[0]] + b"\0" * (rest[0] < 255)
        rest = rest[run:]
    plain = plain[:-1] if run < 255 else plain
    if len(plain) < 8 or zlib.crc32(plain[:-4]) != int.from_bytes(plain[-4:], "little"):
        print("damaged")
        continue
    kinds = KINDS[plain[1] if plain[0] == 1 and plain[1] < len(KINDS) else 0]
    body, values = plain[2:-4], []
    for kind in ["u", "u", *kinds[1:]]:
        value, body = field(kind, body)
        values.append(value)
    print(*values[:2], kinds[0], *values[2:])
