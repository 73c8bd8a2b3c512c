"""Synapse offsets, computed without the Rust code: the source of tests/offsets.rs.

PCG XSH RR 64/32 (O'Neill 2014) seeded from 64 bits as the rand_core crate
documents it, Box-Muller, rounding, and redrawing outside the support, and further than LENGTH from the offset before if
that is not 0.
Usage: python3 offsets.py SEED SIGMA REACH_X REACH_Y LENGTH COUNT
"""

import math
import sys
import zlib

MASK = (1 << 64) - 1
MULTIPLIER = 6364136223846793005
SEEDING_INCREMENT = 11634580027462260723


def output(state):
    word = ((state >> 18 ^ state) >> 27) & 0xFFFFFFFF
    turn = state >> 59
    return (word >> turn | word << (-turn & 31)) & 0xFFFFFFFF


def generator(seed):
    words = []
    for _ in range(4):
        seed = (seed * MULTIPLIER + SEEDING_INCREMENT) & MASK
        words.append(output(seed))
    state = words[0] | words[1] << 32
    increment = words[2] | words[3] << 32 | 1
    state = ((state + increment) * MULTIPLIER + increment) & MASK
    while True:
        yield output(state)
        state = (state * MULTIPLIER + increment) & MASK


def nearest(value):
    """Rounds halves away from zero."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def offsets(seed, sigma, reach_x, reach_y, length, count):
    random = generator(seed)
    found = []
    while len(found) < count:
        u = (next(random) + 1) / 2**32
        v = next(random) / 2**32
        radius = math.sqrt(-2 * math.log(u))
        dx = nearest(radius * math.cos(2 * math.pi * v) * sigma)
        dy = nearest(radius * math.sin(2 * math.pi * v) * sigma)
        if abs(dx) > reach_x or abs(dy) > reach_y:
            continue
        if length and found and math.dist(found[-1], (dx, dy)) > length:
            continue
        found.append((dx, dy))
    return found


if __name__ == "__main__":
    seed, sigma, reach_x, reach_y, length, count = sys.argv[1:]
    found = offsets(int(seed), float(sigma), int(reach_x), int(reach_y), int(length), int(count))
    stored = b"".join(bytes((dx & 255, dy & 255)) for dx, dy in found)
    print(found[:8], "CRC-32", hex(zlib.crc32(stored)))
