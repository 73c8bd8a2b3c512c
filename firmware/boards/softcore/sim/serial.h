// The host's end of the serial port, 8N1.
#pragma once

#include <poll.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <deque>

// Bytes from the board to standard output. `step` once a cycle.
class SerialOutput {
 public:
  explicit SerialOutput(unsigned bit_cycles) : bit_cycles_(bit_cycles) {}

  void step(bool tx) {
    if (bits_ < 0) {
      idle_++;
      // The start bit has begun: the middle of the first bit is one and a half bits away.
      if (!tx) bits_ = 0, wait_ = bit_cycles_ + bit_cycles_ / 2 - 1, byte_ = 0, idle_ = 0;
    } else if (wait_-- == 0) {
      wait_ = bit_cycles_ - 1;
      if (bits_ < 8) byte_ |= static_cast<unsigned>(tx) << bits_++;
      else fputc(static_cast<int>(byte_), stdout), bits_ = -1;
    }
  }

  // Whether nothing has come for longer than a byte takes.
  bool is_idle() const { return idle_ > 20 * bit_cycles_; }

  void flush() { fflush(stdout); }

 private:
  const unsigned bit_cycles_;
  int bits_ = -1;  // of the byte under way that have come; -1 without one
  unsigned wait_ = 0, byte_ = 0;
  uint64_t idle_ = 0;
};

// Bytes from standard input to the board.
class SerialInput {
 public:
  explicit SerialInput(unsigned bit_cycles) : bit_cycles_(bit_cycles) {}

  // The pin in the next cycle.
  bool step() {
    if (left_ == 0) {
      if (bytes_.empty()) return true;
      frame_ = 0x200u | static_cast<unsigned>(bytes_.front()) << 1;
      bytes_.pop_front();
      left_ = 10, wait_ = bit_cycles_;
    }
    const bool bit = frame_ & 1;
    if (--wait_ == 0) frame_ >>= 1, left_--, wait_ = bit_cycles_;
    return bit;
  }

  // Takes what has come to standard input; false at its end.
  bool look() {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (poll(&input, 1, 0) <= 0) return true;
    uint8_t bytes[256];
    const ssize_t count = read(STDIN_FILENO, bytes, sizeof bytes);
    if (count <= 0) return false;
    bytes_.insert(bytes_.end(), bytes, bytes + count);
    return true;
  }

 private:
  const unsigned bit_cycles_;
  std::deque<uint8_t> bytes_;
  unsigned frame_ = 0, left_ = 0, wait_ = 0;
};
