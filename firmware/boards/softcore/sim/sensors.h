// Two image sensors with a parallel port each, and what can go wrong at their pins.
#pragma once

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "sensor_registers.h"

// A grey image, 8 bit.
struct Image {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> pixels;

  // Reads a binary PGM without comments.
  static Image read(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error(path + ": cannot be opened");
    Image image;
    std::string magic;
    uint32_t maximum = 0;
    file >> magic >> image.width >> image.height >> maximum;
    if (!file || magic != "P5" || maximum != 255 || file.get() != '\n' || image.width == 0 || image.width > 4096 ||
        image.height == 0 || image.height > 4096)
      throw std::runtime_error(path + ": not a binary PGM of 8 bits and at most 4096x4096 px");
    image.pixels.resize(size_t{image.width} * image.height);
    if (!file.read(reinterpret_cast<char *>(image.pixels.data()), static_cast<std::streamsize>(image.pixels.size())))
      throw std::runtime_error(path + ": ends early");
    return image;
  }
};

enum Side { LEFT = 0, RIGHT = 1 };

// A fault at the pins, at a line of a frame: FRAME:LINE:KIND, with `-left` or `-right` behind the kind
// if it is one sensor's. The line after the last one is the gap between two frames.
struct Fault {
  enum Kind {
    SHORT_LINE,    // HREF falls amid the line
    LONG_LINE,     // HREF stays high for more pixels than the ports keep of a line
    LOST_LINE,     // HREF stays low
    EXTRA_LINE,    // a line that is none comes before the line, or in the gap
    JOINED_LINES,  // HREF stays high until the end of the next line; no fault at the last
    EARLY_FRAME,   // the next frame begins in place of the line
    FALSE_FRAME,   // VSYNC rises before the line, which comes all the same, or in the gap
    CUT_LINE,      // VSYNC rises amid the line, and falls with its end
    LOST_FRAME,    // VSYNC stays low where the frame begins, whatever the line
    LATE_LINE,     // the line comes a line's time late
    BURST,         // from here to the end of the frame the sensors do not wait for room
    STOPPED_CLOCK, // PCLK stops before the line, or in the gap, for 150 ms
    HUNG_CLOCK,    // PCLK stops before the line, until the sensor is reset
    LOST_POWER     // before the line; the sensor forgets its registers, and sends nothing until it is set up
  };
  uint32_t frame = 0, line = 0;
  Kind kind = SHORT_LINE;
  bool has[2] = {true, true};

  // Whether it may happen in the gap between two frames.
  bool fits_gap() const {
    return kind == EXTRA_LINE || kind == FALSE_FRAME || kind == STOPPED_CLOCK || kind == LOST_POWER;
  }
  static Fault parse(const std::string &text) {
    static const std::pair<const char *, Kind> KINDS[] = {
        {"short-line", SHORT_LINE},     {"long-line", LONG_LINE},       {"lost-line", LOST_LINE},
        {"extra-line", EXTRA_LINE},     {"joined-lines", JOINED_LINES}, {"early-frame", EARLY_FRAME},
        {"false-frame", FALSE_FRAME},   {"cut-line", CUT_LINE},         {"lost-frame", LOST_FRAME},
        {"late-line", LATE_LINE},       {"burst", BURST},               {"stopped-clock", STOPPED_CLOCK},
        {"hung-clock", HUNG_CLOCK},     {"lost-power", LOST_POWER}};
    const std::string problem = text + ": a fault is FRAME:LINE:KIND";
    Fault fault;
    char name[32] = "";
    if (sscanf(text.c_str(), "%u:%u:%31[a-z-]", &fault.frame, &fault.line, name) != 3) throw std::runtime_error(problem);
    std::string kind = name;
    const auto cut = [&kind](const std::string &end) {
      const bool has = kind.size() > end.size() && kind.compare(kind.size() - end.size(), end.size(), end) == 0;
      if (has) kind.resize(kind.size() - end.size());
      return has;
    };
    if (cut("-left")) fault.has[RIGHT] = false;
    else if (cut("-right")) fault.has[LEFT] = false;
    for (const auto &[known, value] : KINDS) {
      if (kind == known) {
        fault.kind = value;
        return fault;
      }
    }
    throw std::runtime_error(problem);
  }
};

struct Pins {
  bool pclk = false, vsync = false, href = false;
  uint8_t d = 0;
};

// Times, in clocks of PCLK. A pixel takes two: its grey and a colour.
constexpr uint32_t LINE_BLANK = 40;
constexpr uint32_t VSYNC_HIGH = 20;
constexpr uint32_t FRAME_BLANK = 60;
// Half cycles of the system's clock in half a clock of PCLK: 24 MHz where the system has 48.
constexpr uint32_t PCLK_HALF = 2;
// Clocks of PCLK for which it stops in the fault of that name.
constexpr uint64_t STOP = 150'000ull * 24;
// Half cycles of the system's clock for which a frame waits for lines of one sensor alone: 10 ms.
constexpr uint64_t LONGEST_ALONE = 10'000ull * 96;
// Pixels by which a long line is too long: all that the ports have room for.
constexpr uint32_t LONGER = 160;

// Where a sensor is: about to send a line, or, at line -1, to begin a frame.
struct Place {
  uint32_t frame = 0;
  int64_t line = -1;
  bool operator==(const Place &other) const { return frame == other.frame && line == other.line; }
  bool operator<(const Place &other) const {
    return frame != other.frame ? frame < other.frame : line < other.line;
  }
};

// One sensor. It waits at each place until it is let go, and to be set up for the image's size.
class Sensor {
 public:
  Sensor(const Image &image, const std::vector<Fault> &faults, Side side, uint32_t gap)
      : image_(image), faults_(faults), side_(side), gap_(gap), phase_(side) {}

  const Pins &pins() const { return pins_; }
  const Place &place() const { return place_; }
  bool waits() const { return at_ == script_.size(); }
  bool is_set_up() const { return registers_.is_set_up(image_.width, image_.height); }
  SensorRegisters &registers() { return registers_; }
  // The next frame that has not begun.
  uint32_t next_frame() const { return place_.frame + (place_.line >= 0); }

  // Begins anew with this frame, once it is set up.
  void begin_at(uint32_t frame) {
    script_.clear();
    at_ = 0;
    hangs_ = has_begun_early_ = false;
    place_ = {frame, -1};
    // A line that was under way is no line.
    pins_.vsync = pins_.href = false;
  }
  uint32_t lines() const { return lines_; }
  uint32_t frames() const { return frames_; }

  // Half a cycle of the system's clock.
  void step() {
    if (++phase_ % PCLK_HALF) return;
    if (hangs_) return;
    if (stopped_ > 0) {
      stopped_--;
      return;
    }
    pins_.pclk = !pins_.pclk;
    // The pins change at the falling edge.
    if (pins_.pclk) return;
    if (waits()) return;
    const Step &now = script_[at_];
    if (pins_.href && !now.href) lines_++;
    if (now.vsync && !pins_.vsync) frames_++;
    pins_.vsync = now.vsync;
    pins_.href = now.href;
    pins_.d = now.d;
    at_++;
  }

  // Goes on from this place.
  void go() {
    script_.clear();
    at_ = 0;
    if (place_.line < 0) {
      if (!has_begun_early_) add(VSYNC_HIGH, !loses_frame());
      has_begun_early_ = false;
      add(gap_, false);
      move_to(0);
      return;
    }
    const uint32_t line = static_cast<uint32_t>(place_.line);
    if (const Fault *fault = fault_at(line)) {
      switch (fault->kind) {
        case Fault::SHORT_LINE: add_line(line, image_.width / 2, true); break;
        case Fault::LONG_LINE:
          add_line(line, image_.width, false);
          script_.insert(script_.end(), 2 * LONGER, Step{false, true, 0});
          add(LINE_BLANK, false);
          break;
        case Fault::LOST_LINE: add(2 * image_.width + LINE_BLANK, false); break;
        case Fault::EXTRA_LINE:
          add_line(0, image_.width, true);
          add_frame_line(line);
          break;
        case Fault::JOINED_LINES:
          if (line + 1 == image_.height) {
            add_line(line, image_.width, true);
            break;
          }
          add_line(line, image_.width, false);
          add_line(line + 1, image_.width, true);
          move_to(place_.line + 2);
          return;
        case Fault::EARLY_FRAME:
          add(VSYNC_HIGH, true);
          add(LINE_BLANK, false);
          has_begun_early_ = true;
          place_ = {place_.frame + 1, -1};
          return;
        case Fault::FALSE_FRAME:
          add(VSYNC_HIGH, true);
          add(LINE_BLANK, false);
          add_frame_line(line);
          break;
        case Fault::CUT_LINE: {
          const size_t from = script_.size() + image_.width;
          add_line(line, image_.width, false);
          for (size_t at = from; at < script_.size(); at++) script_[at].vsync = true;
          add(LINE_BLANK, false);
          break;
        }
        case Fault::LATE_LINE:
          add(2 * image_.width + LINE_BLANK, false);
          add_line(line, image_.width, true);
          break;
        case Fault::STOPPED_CLOCK:
          stopped_ = 2 * STOP;
          add(LINE_BLANK, false);
          add_frame_line(line);
          break;
        case Fault::HUNG_CLOCK: hangs_ = true; return;
        case Fault::LOST_POWER:
          registers_.set_power(false);
          registers_.set_power(true);
          return;
        case Fault::LOST_FRAME:
        case Fault::BURST: add_frame_line(line); break;
      }
    } else {
      add_frame_line(line);
    }
    move_to(place_.line + 1);
  }

  // Whether the frame's sensors do not wait at this place.
  bool bursts() const {
    for (const Fault &fault : faults_)
      if (fault.kind == Fault::BURST && fault.frame == place_.frame && place_.line >= fault.line) return true;
    return false;
  }

 private:
  struct Step {
    bool vsync, href;
    uint8_t d;
  };

  const Fault *fault_at(uint32_t line) const {
    for (const Fault &fault : faults_)
      if (fault.has[side_] && fault.frame == place_.frame && fault.line == line &&
          (line < image_.height || fault.fits_gap()))
        return &fault;
    return nullptr;
  }
  bool loses_frame() const {
    for (const Fault &fault : faults_)
      if (fault.has[side_] && fault.frame == place_.frame && fault.kind == Fault::LOST_FRAME) return true;
    return false;
  }
  void add(uint32_t clocks, bool vsync) { script_.insert(script_.end(), clocks, Step{vsync, false, 0}); }
  void add_line(uint32_t line, uint32_t pixels, bool ends) {
    const uint8_t *row = &image_.pixels[size_t{line} * image_.width];
    for (uint32_t x = 0; x < pixels; x++) {
      script_.push_back({false, true, row[x]});
      script_.push_back({false, true, static_cast<uint8_t>(~row[x])});
    }
    if (ends) add(LINE_BLANK + 2 * (image_.width - pixels), false);
  }
  // A line of the frame; none in the gap behind it.
  void add_frame_line(uint32_t line) {
    if (line < image_.height) add_line(line, image_.width, true);
  }
  void move_to(int64_t line) {
    place_.line = line;
    const bool is_over = line > image_.height || (line == image_.height && !fault_at(image_.height));
    if (is_over) place_ = {place_.frame + 1, -1};
  }

  const Image &image_;
  const std::vector<Fault> &faults_;
  const Side side_;
  const uint32_t gap_;
  uint64_t phase_;
  Pins pins_;
  Place place_;
  std::vector<Step> script_;
  size_t at_ = 0;
  uint64_t stopped_ = 0;
  bool has_begun_early_ = false, hangs_ = false;
  uint32_t lines_ = 0, frames_ = 0;
  SensorRegisters registers_;
};

// Two sensors with one clock, one reset, one SCL and an SDA each. Neither begins a line before the other can. Unless a gap
// between their frames is given they wait for room: that is how the firmware sets the pace.
class SensorPair {
 public:
  SensorPair(const Image &left, const Image &right, const std::vector<Fault> &faults, std::optional<uint32_t> gap)
      : faults_(faults),
        left_(left, faults_, LEFT, gap.value_or(FRAME_BLANK)),
        right_(right, faults_, RIGHT, gap.value_or(FRAME_BLANK)),
        is_held_(!gap) {}

  const Pins &left() const { return left_.pins(); }
  const Pins &right() const { return right_.pins(); }
  uint32_t frames() const { return left_.frames(); }
  uint32_t lines(Side side) const { return side == LEFT ? left_.lines() : right_.lines(); }
  SensorRegisters &registers(Side side) { return (side == LEFT ? left_ : right_).registers(); }

  void step(bool has_room, bool may_begin, bool wait_alone) {
    alone_ = wait_alone ? alone_ + 1 : 0;
    // What waits alone does so until the next frame, and the firmware has seen by then what is wrong with the last one.
    may_begin |= alone_ > LONGEST_ALONE;
    const uint32_t resets = left_.registers().resets() + right_.registers().resets();
    if (resets != resets_) {
      // Whatever each was at: those that are reset together go on together.
      const uint32_t frame = std::max(left_.next_frame(), right_.next_frame());
      for (Sensor *sensor : {&left_, &right_})
        if (!sensor->is_set_up()) sensor->begin_at(frame);
      resets_ = resets;
    }
    if (left_.waits() && right_.waits()) {
      // What one has lost, the other sends alone.
      const bool left_goes = left_.is_set_up() && !(right_.is_set_up() && right_.place() < left_.place());
      const bool right_goes = right_.is_set_up() && !(left_.is_set_up() && left_.place() < right_.place());
      const Sensor &first = left_goes ? left_ : right_;
      const bool may_go = first.place().line < 0 ? may_begin && has_room : has_room || first.bursts();
      if (may_go || !is_held_) {
        if (left_goes) left_.go();
        if (right_goes) right_.go();
      }
    }
    left_.step();
    right_.step();
  }

 private:
  const std::vector<Fault> faults_;
  Sensor left_, right_;
  const bool is_held_;
  uint32_t resets_ = 0;
  uint64_t alone_ = 0;
};
