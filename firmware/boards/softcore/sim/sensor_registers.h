// The I2C target of an OV7670, and its registers.
#pragma once

#include <cstdint>
#include <vector>

// Registers behind an I2C target, as SCCB has it: a write names a register and may give its value, and a read gives that
// of the register named last. `step` takes what the wires are. Other than an OV7670, it stretches SCL after each byte.
class SensorRegisters {
 public:
  // Register and value, in the order in which they were written.
  const std::vector<uint16_t> &writes() const { return writes_; }
  // Whether a window of this size was set up since the last reset, binned, of pixels whose first byte is their grey, and
  // the sensor has settled since.
  bool is_set_up(uint32_t width, uint32_t height) const {
    const auto edge = [this](int high, unsigned bits, unsigned low) {
      return static_cast<uint32_t>(values_[high]) << bits | (low & ((1u << bits) - 1));
    };
    const uint32_t columns = (edge(0x18, 3, values_[0x32] >> 3) + LINE - edge(0x17, 3, values_[0x32])) % LINE;
    const uint32_t rows = edge(0x1a, 2, values_[0x03] >> 2) - edge(0x19, 2, values_[0x03]);
    const bool is_grey_first = values_[0x12] == 0x00 && values_[0x3a] == 0x04;
    const bool is_binned = values_[0x0c] == 0x04 && values_[0x3e] == 0x19 && values_[0x73] == 0xf1;
    return is_on_ && quiet_ >= SETTLING && is_grey_first && is_binned && columns == 2 * width && rows == 2 * height;
  }
  // Number of resets, by the pin or the register.
  uint32_t resets() const { return resets_; }

  // Takes the power away, or gives it.
  void set_power(bool is_on) {
    if (is_on_ != is_on) reset();
    is_on_ = is_on;
  }

  // Whether the target holds the wires low.
  bool holds_sda() const { return holds_; }
  bool holds_scl() const { return stretch_ > 0; }

  // Half a cycle of the system's clock.
  void step(bool scl, bool sda, bool rst_n) {
    quiet_++;
    if (!rst_n && was_rst_n_) reset();
    was_rst_n_ = rst_n;
    const bool rises = scl && !scl_, falls = !scl && scl_;
    const bool starts = scl && scl_ && !sda && sda_, stops = scl && scl_ && sda && !sda_;
    scl_ = scl, sda_ = sda;
    if (!is_on_ || !rst_n || stops) state_ = IDLE, holds_ = false, stretch_ = 0;
    else if (starts) state_ = ADDRESS, bit_ = 0, byte_ = 0, holds_ = false;
    else if (state_ != IDLE && rises) rise();
    else if (state_ != IDLE && falls) fall();
    if (stretch_ > 0) stretch_--;
  }

 private:
  static constexpr uint8_t ADDRESS_BITS = 0x21, PID = 0x0a, VER = 0x0b, COM7 = 0x12, RESET = 0x80;
  static constexpr uint32_t LINE = 784;
  // Half cycles of the system's clock after the last write until frames are sent: 1 ms.
  static constexpr uint64_t SETTLING = 96'000;
  // And of stretching: 20 us.
  static constexpr uint64_t STRETCH = 20 * 96;
  enum State { IDLE, ADDRESS, REGISTER, VALUE, READ };

  void reset() {
    for (uint8_t &value : values_) value = 0;
    values_[PID] = 0x76, values_[VER] = 0x73;
    // What it has after a reset, among what a driver may look at: automatic exposure.
    values_[0x13] = 0x8f;
    resets_++;
  }

  // A bit is there.
  void rise() {
    if (bit_ < 8 && state_ != READ) byte_ = static_cast<uint8_t>(byte_ << 1 | sda_);
    if (bit_ == 8 && state_ == READ && sda_) ends_ = true;  // no acknowledgement: it was the last one
    bit_++;
  }

  // The next bit may be set.
  void fall() {
    if (bit_ == 0) return;  // the fall of the start
    if (bit_ == 9) {
      bit_ = 0;
      if (state_ == READ && ends_) state_ = IDLE;
      holds_ = state_ == READ && !(values_[register_] & 0x80);
      return;
    }
    if (bit_ < 8) {
      holds_ = state_ == READ && !(values_[register_] >> (7 - bit_) & 1);
      return;
    }
    // A byte has come, or gone.
    stretch_ = STRETCH;
    holds_ = state_ != READ;
    switch (state_) {
      case ADDRESS:
        if (byte_ >> 1 != ADDRESS_BITS) state_ = IDLE, holds_ = false;
        else state_ = byte_ & 1 ? READ : REGISTER, ends_ = false;
        break;
      case REGISTER: register_ = byte_, state_ = VALUE; break;
      case VALUE:
        writes_.push_back(static_cast<uint16_t>(register_ << 8 | byte_));
        quiet_ = 0;
        if (register_ == COM7 && byte_ & RESET) reset();
        else values_[register_++] = byte_;
        break;
      default: break;
    }
  }

  uint8_t values_[256] = {};
  std::vector<uint16_t> writes_;
  uint32_t resets_ = 0;
  uint64_t quiet_ = 0, stretch_ = 0;
  bool is_on_ = false, was_rst_n_ = false, scl_ = true, sda_ = true, holds_ = false, ends_ = false;
  State state_ = IDLE;
  unsigned bit_ = 0;
  uint8_t byte_ = 0, register_ = 0;
};
