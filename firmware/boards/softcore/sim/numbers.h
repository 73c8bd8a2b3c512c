// Numbers on standard input and output, the lowest byte first.
#pragma once

#include <cstdint>
#include <cstdio>

// Reads a number of this many bytes; false at the end of the input.
inline bool take(uint32_t &value, int bytes) {
  value = 0;
  for (int i = 0; i < bytes; i++) {
    const int byte = getchar();
    if (byte == EOF) return false;
    value |= static_cast<uint32_t>(byte) << 8 * i;
  }
  return true;
}

// Writes a number of four bytes.
inline void give(uint32_t value) {
  for (int i = 0; i < 4; i++) putchar(value >> 8 * i & 0xff);
}
