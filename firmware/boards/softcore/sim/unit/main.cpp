// The stereo unit by itself, with a memory that is at times busy. It is driven through standard input: `w` register
// value, `r` register, which answers with its value, and `m` address, length and that many bytes of memory; registers
// have 16 bits, all else 32, the lowest byte first.

#include <cstdint>
#include <cstdio>
#include <vector>

#include "../numbers.h"
#include "Vstereo_unit.h"
#include "verilated.h"

namespace {

class Bench {
 public:
  explicit Bench(VerilatedContext &context) : unit(&context), words(1 << 16) {
    unit.rst_n = 0;
    for (int i = 0; i < 8; i++) step();
    unit.rst_n = 1;
  }

  void write(uint16_t address, uint32_t value) {
    unit.write = 1, unit.addr = address, unit.write_data = value;
    step();
    unit.write = 0;
  }

  uint32_t read(uint16_t address) {
    unit.addr = address;
    step();
    return unit.read_data;
  }

  void store(uint32_t address, uint8_t byte) {
    uint32_t &word = words[address / 4 % words.size()];
    const unsigned shift = address % 4 * 8;
    word = (word & ~(0xffu << shift)) | static_cast<uint32_t>(byte) << shift;
  }

 private:
  // A cycle: what was taken in the one before has come, and the memory may be taken if the processor is elsewhere.
  void step() {
    noise = noise * 1664525 + 1013904223;
    unit.clk = 0;
    unit.eval();
    const bool is_taken = unit.memory_asks && noise >> 30 != 0;
    const uint32_t word = words[unit.memory_at % words.size()];
    unit.memory_takes = is_taken;
    unit.eval();
    unit.clk = 1;
    unit.eval();
    unit.memory_data = is_taken ? word : noise;
    unit.eval();
  }

  Vstereo_unit unit;
  std::vector<uint32_t> words;
  uint32_t noise = 1;
};

}  // namespace

int main(int argc, char **argv) {
  VerilatedContext context;
  context.commandArgs(argc, argv);
  Bench bench(context);
  uint32_t kind, address, value;
  while (take(kind, 1)) {
    if (kind == 'w' && take(address, 2) && take(value, 4)) bench.write(address, value);
    else if (kind == 'r' && take(address, 2)) {
      value = bench.read(address);
      give(value);
      fflush(stdout);
    } else if (kind == 'm' && take(address, 4) && take(value, 4)) {
      for (uint32_t byte, i = 0; i < value && take(byte, 1); i++) bench.store(address + i, byte);
    } else return 1;
  }
  return 0;
}
