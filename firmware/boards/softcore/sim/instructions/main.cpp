// The byte instructions by themselves. They are read from standard input, a function with 16 bits and two operands with 32
// each, the lowest byte first, and their results written to standard output, with 32. They come one behind another, with
// gaps at random, and their results wait at random.

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "../numbers.h"
#include "Vbyte_instructions.h"
#include "verilated.h"

namespace {

struct Instruction {
  uint32_t function, a, b;
};

}  // namespace

int main(int argc, char **argv) {
  VerilatedContext context;
  context.commandArgs(argc, argv);
  std::vector<Instruction> all;
  Instruction next;
  while (take(next.function, 2) && take(next.a, 4) && take(next.b, 4)) all.push_back(next);
  Vbyte_instructions logic(&context);
  logic.rst_n = 0;
  size_t begun = 0, ended = 0;
  uint32_t noise = 1;
  for (size_t cycle = 0; ended < all.size(); cycle++) {
    // More cycles than any order of gaps and waits takes.
    if (cycle > 16 * all.size() + 16) return 1;
    noise = noise * 1664525 + 1013904223;
    logic.rst_n = cycle >= 4;
    logic.asks = logic.rst_n && begun < all.size() && noise >> 30 != 0;
    if (begun < all.size()) logic.id = all[begun].function, logic.a = all[begun].a, logic.b = all[begun].b;
    logic.result_taken = noise >> 28 & 1;
    logic.clk = 0;
    logic.eval();
    if (logic.asks && logic.takes) begun++;
    if (logic.rst_n && logic.has_result && logic.result_taken) {
      give(logic.result);
      ended++;
    }
    logic.clk = 1;
    logic.eval();
  }
  return 0;
}
