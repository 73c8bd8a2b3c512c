// The soft core's surroundings: two sensors at its camera ports, and a host at its serial port, which
// is this program's standard input and output. It ends when standard input does.

#include <poll.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "Vsoc.h"
#include "sensors.h"
#include "serial.h"
#include "verilated.h"

namespace {

// How the program ends.
enum Exit { DONE = 0, BAD_INPUT = 2, NO_END = 3, BUS_FAULT = 4, BOARD_FAILED = 5 };
// What the firmware shows when it has failed.
constexpr uint8_t LEDS_FAILED = 0xff;
// Cycles of a bit of the serial port, as the RTL has it.
constexpr unsigned BIT_CYCLES = 16;
constexpr uint64_t RESET_CYCLES = 8;
constexpr uint64_t CLOCK_MHZ = 48;
// Cycles between two looks at standard input.
constexpr uint64_t LOOK_CYCLES = 4096;

struct Options {
  std::string left, right;
  std::vector<Fault> faults;
  std::optional<uint32_t> gap;              // of sensors that do not wait, clocks of PCLK
  uint64_t cycles = UINT64_MAX;
  uint64_t power_cycles[2] = {0, 0};  // when each sensor gets its power
  uint64_t held_cycles[2] = {0, 0};   // until when SDA of each is held low
};

// A time for one of the sensors: SIDE:US.
void parse_time(const std::string &text, uint64_t (&cycles)[2]) {
  const size_t colon = text.find(':');
  const std::string side = text.substr(0, colon);
  if (colon == std::string::npos || (side != "left" && side != "right"))
    throw std::runtime_error(text + ": a time is left:US or right:US");
  cycles[side == "left" ? LEFT : RIGHT] = std::stoull(text.substr(colon + 1)) * CLOCK_MHZ;
}

Options parse(int argc, char **argv) {
  Options options;
  for (int at = 1; at < argc; at++) {
    const std::string name = argv[at];
    if (name[0] == '+') continue;  // for the RTL
    if (++at == argc) throw std::runtime_error(name + " needs a value");
    const std::string value = argv[at];
    if (name == "--left") options.left = value;
    else if (name == "--right") options.right = value;
    else if (name == "--fault") options.faults.push_back(Fault::parse(value));
    else if (name == "--powered") parse_time(value, options.power_cycles);
    else if (name == "--sda-held") parse_time(value, options.held_cycles);
    else if (name == "--free-running") options.gap = static_cast<uint32_t>(std::stoul(value));
    else if (name == "--cycles") options.cycles = std::stoull(value);
    else throw std::runtime_error("there is no option " + name);
  }
  return options;
}

int run(VerilatedContext &context, const Options &options) {
  const Image left_view = Image::read(options.left), right_view = Image::read(options.right);
  if (left_view.width != right_view.width || left_view.height != right_view.height)
    throw std::runtime_error(options.right + ": not of the left view's size");
  SensorPair sensors(left_view, right_view, options.faults, options.gap);
  Vsoc soc(&context);
  SerialOutput from_board(BIT_CYCLES);
  SerialInput to_board(BIT_CYCLES);
  soc.clk = 0;
  soc.rst_n = 0;
  soc.rx = 1;
  uint64_t cycles = 0;
  int result = NO_END;
  while (cycles < options.cycles) {
    // Half a cycle each. The pins of the sensors change whenever their own clocks say.
    soc.clk = !soc.clk;
    sensors.step(soc.camera_has_room, soc.camera_may_begin, soc.camera_wait_alone);
    const Pins &left = sensors.left(), &right = sensors.right();
    soc.left_pclk = left.pclk, soc.left_vsync = left.vsync, soc.left_href = left.href, soc.left_d = left.d;
    soc.right_pclk = right.pclk, soc.right_vsync = right.vsync, soc.right_href = right.href, soc.right_d = right.d;
    // The wires are pulled up, and low where anyone holds them.
    SensorRegisters &left_bus = sensors.registers(LEFT), &right_bus = sensors.registers(RIGHT);
    if (cycles == options.power_cycles[LEFT]) left_bus.set_power(true);
    if (cycles == options.power_cycles[RIGHT]) right_bus.set_power(true);
    soc.scl = !(soc.scl_low || left_bus.holds_scl() || right_bus.holds_scl());
    soc.left_sda = !(soc.left_sda_low || left_bus.holds_sda() || cycles < options.held_cycles[LEFT]);
    soc.right_sda = !(soc.right_sda_low || right_bus.holds_sda() || cycles < options.held_cycles[RIGHT]);
    left_bus.step(soc.scl, soc.left_sda, soc.sensors_rst_n);
    right_bus.step(soc.scl, soc.right_sda, soc.sensors_rst_n);
    if (soc.clk) {
      soc.rst_n = cycles >= RESET_CYCLES;
      soc.rx = to_board.step();
    }
    soc.eval();
    if (!soc.clk) continue;
    cycles++;
    if (soc.rst_n) from_board.step(soc.tx);
    if (soc.bus_fault) {
      result = BUS_FAULT;
      break;
    }
    if (soc.leds == LEDS_FAILED && from_board.is_idle()) {
      result = BOARD_FAILED;
      break;
    }
    if (cycles % LOOK_CYCLES == 0) {
      from_board.flush();
      if (!to_board.look()) {
        result = DONE;
        break;
      }
    }
  }
  from_board.flush();
  soc.final();
  fprintf(stderr, "cycles %llu\nframes %u\nleft_lines %u\nright_lines %u\n", static_cast<unsigned long long>(cycles),
          sensors.frames(), sensors.lines(LEFT), sensors.lines(RIGHT));
  for (const Side side : {LEFT, RIGHT}) {
    // Register and value of each write, four digits.
    fprintf(stderr, "%s ", side == LEFT ? "left_writes" : "right_writes");
    for (const uint16_t write : sensors.registers(side).writes()) fprintf(stderr, "%04x", write);
    fprintf(stderr, "\n");
  }
  switch (result) {
    case NO_END: fprintf(stderr, "not done after %llu cycles\n", static_cast<unsigned long long>(cycles)); break;
    case BUS_FAULT: fprintf(stderr, "the processor asked for an address that is not there\n"); break;
    case BOARD_FAILED: fprintf(stderr, "the firmware has failed\n"); break;
    default: break;
  }
  return result;
}

}  // namespace

int main(int argc, char **argv) {
  VerilatedContext context;
  context.commandArgs(argc, argv);
  try {
    return run(context, parse(argc, argv));
  } catch (const std::exception &error) {
    fprintf(stderr, "error: %s\n", error.what());
    return BAD_INPUT;
  }
}
