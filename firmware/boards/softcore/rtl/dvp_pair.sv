// Two sensors in step. A pair of lines is ready when both have delivered the line of one frame and
// number; the processor reads it and releases it. A line whose partner never comes is dropped.
//
//  0x0000 STATUS   [0] a pair is ready  [1] lines before it were not stored for want of room
//                  [2] before it, lines of one sensor had no partner, or a line was torn
//                  [3] its lines ended too far apart  [31:16] pairs waiting
//  0x0004 PLACE    the pair's frame << 16 | line
//  0x0008 PIXELS   of its right line << 16 | of its left line, as counted
//  0x000c ENDED    the cycle in which the left line ended, low 32 bits
//  0x0010 SKEW     cycles from the end of the left line to that of the right one, signed
//  0x0014 CONTROL  write: [0] release the pair  [1] restart: both sensors wait for a frame, which they
//                  begin at one time
//  0x0018 LEVEL    a frame is taken if, when it begins, at most so many lines of a sensor wait
//  0x001c LIMIT    of the skew, cycles: beyond it the lines do not belong together; 0 for none
//  0x0020 LOST     right << 16 | left: lines that were not delivered, modulo 2^16
//  0x0024 FRAMES   right << 16 | left: numbers of the frames that the sensors are in
//  0x0028 ROOM     lines of a ring << 16 | bytes of a line
//  0x002c NOW      the cycle that is now, low 32 bits
//  0x4000          the bytes of the left line
//  0x6000          the bytes of the right line
module dvp_pair #(
    parameter int LINES = 128,
    parameter int LINE_WORDS = 40
) (
    input  logic        clk, rst_n,
    input  logic        left_pclk, left_vsync, left_href,
    input  logic [7:0]  left_d,
    input  logic        right_pclk, right_vsync, right_href,
    input  logic [7:0]  right_d,
    // Registers: what is read comes a cycle later.
    input  logic        write,
    input  logic [14:0] addr,
    input  logic [31:0] write_data,
    output logic [31:0] read_data,
    // For cameras that can be held: there is room for a line and more; no line waits; lines of one sensor wait alone.
    output logic        has_room, may_begin, wait_alone
);
  localparam int AT = $clog2(LINE_WORDS);
  logic [31:0] now;
  logic [15:0] level;
  logic [31:0] limit;

  logic restart, close, pair_pop, left_drop, right_drop;
  logic [15:0] left_frame, right_frame, left_next, right_next, left_begun, right_begun;
  logic left_skipped, right_skipped, left_begins, right_begins, left_takes, right_takes;
  logic left_full, right_full, left_valid, right_valid, left_gap, right_gap, left_torn, right_torn;
  logic left_comes, right_comes;
  logic [15:0] left_line_frame, right_line_frame, left_line, right_line, left_pixels, right_pixels;
  logic [31:0] left_ended, right_ended, left_word, right_word;
  logic [15:0] left_waiting, right_waiting, left_lost, right_lost;

  // Each counts its frames. The frame with which both begin after a restart has the number of the one that has begun more.
  logic meet;
  wire [15:0] left_number = left_begins ? left_begun : left_frame;
  wire [15:0] right_number = right_begins ? right_begun : right_frame;
  wire [15:0] frames_apart = left_number - right_number;
  wire [15:0] number = frames_apart[15] ? right_number : left_number;
  wire [15:0] close_frame = left_full ? left_frame : right_frame;

  dvp_sensor #(.LINES(LINES), .LINE_WORDS(LINE_WORDS)) left (
      .clk, .rst_n, .pclk(left_pclk), .vsync(left_vsync), .href(left_href), .d(left_d), .now,
      .frame(left_frame), .next_line(left_next), .skipped(left_skipped),
      .frame_begins(left_begins), .frame_next(left_begun), .takes(left_takes), .is_full(left_full),
      .close(close && close_frame == left_frame), .restart, .renumber(meet), .number,
      .valid(left_valid), .comes_next(left_comes), .line_frame(left_line_frame), .line(left_line),
      .pixels(left_pixels), .ended(left_ended), .gap(left_gap), .is_torn(left_torn), .pop(pair_pop || left_drop),
      .drop(left_drop), .word_at(addr[AT+1:2]), .word(left_word), .waiting(left_waiting),
      .lost(left_lost));
  dvp_sensor #(.LINES(LINES), .LINE_WORDS(LINE_WORDS)) right (
      .clk, .rst_n, .pclk(right_pclk), .vsync(right_vsync), .href(right_href), .d(right_d), .now,
      .frame(right_frame), .next_line(right_next), .skipped(right_skipped),
      .frame_begins(right_begins), .frame_next(right_begun), .takes(right_takes),
      .is_full(right_full), .close(close && close_frame == right_frame), .restart,
      .renumber(meet), .number, .valid(right_valid), .comes_next(right_comes),
      .line_frame(right_line_frame), .line(right_line), .pixels(right_pixels), .ended(right_ended), .gap(right_gap),
      .is_torn(right_torn), .pop(pair_pop || right_drop), .drop(right_drop),
      .word_at(addr[AT+1:2]), .word(right_word), .waiting(right_waiting), .lost(right_lost));

  // A frame is taken by both or by none: the first that begins it decides.
  logic was_decided, decision;
  logic [15:0] decided_frame;
  wire has_level = left_waiting <= level && right_waiting <= level;
  assign left_takes = was_decided && decided_frame == left_begun ? decision : has_level;
  assign right_takes = was_decided && decided_frame == right_begun ? decision : has_level;
  assign close = left_full || right_full;

  // The oldest lines: are they of one place, or is one without a partner? Places are compared as
  // numbers that wrap.
  wire [31:0] left_place = {left_line_frame, left_line};
  wire [31:0] right_place = {right_line_frame, right_line};
  wire [31:0] places_apart = left_place - right_place;
  wire [31:0] left_past = {left_frame, left_next} - right_place - 32'd1;
  wire [31:0] right_past = {right_frame, right_next} - left_place - 32'd1;
  wire both = left_valid && right_valid;
  wire same = places_apart == 0;
  wire ready = both && same;
  assign left_drop = !restart && left_valid && !right_comes
      && (right_valid ? !same && places_apart[31] : !right_past[31]);
  assign right_drop = !restart && right_valid && !left_comes
      && (left_valid ? !same && !places_apart[31] : !left_past[31]);
  // Why: the partner had no room, or the sensors are not where they should be.
  wire left_is_overrun = right_valid ? left_line_frame == right_line_frame && right_gap
      : right_frame == left_line_frame && right_skipped;
  wire right_is_overrun = left_valid ? left_line_frame == right_line_frame && left_gap
      : left_frame == right_line_frame && left_skipped;

  logic was_overrun, was_astray;
  wire [31:0] skew = right_ended - left_ended;
  wire [31:0] distance = skew[31] ? -skew : skew;
  wire overrun = was_overrun || (ready && (left_gap || right_gap));
  wire astray = was_astray || (ready && (left_torn || right_torn));
  wire skewed = ready && limit != 0 && distance > limit;

  wire is_register = addr[14] == 1'b0;
  wire writes_control = write && is_register && addr[5:2] == 4'd5;
  wire is_told = writes_control && write_data[1];
  assign pair_pop = writes_control && write_data[0] && ready && !restart;

  // After a restart both have to begin a frame at one time. One that begins alone, because the other
  // has begun before, or not yet, waits again.
  logic left_waits, right_waits;
  logic [31:0] alone;
  assign meet = (left_waits || right_waits) && (left_begins || !left_waits) && (right_begins || !right_waits);
  assign restart = is_told || (left_waits != right_waits && limit != 0 && alone > limit);

  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {now, level, limit} <= '0;
      {was_decided, decision, decided_frame, was_overrun, was_astray, alone} <= '0;
      {left_waits, right_waits} <= '1;
    end else begin
      now <= now + 1'b1;
      alone <= left_waits != right_waits ? alone + 1'b1 : '0;
      if (left_begins) left_waits <= 1'b0;
      if (right_begins) right_waits <= 1'b0;
      if (restart) {left_waits, right_waits, alone} <= {2'b11, 32'b0};
      if (write && is_register && addr[5:2] == 4'd6) level <= write_data[15:0];
      if (write && is_register && addr[5:2] == 4'd7) limit <= write_data;
      if (left_begins || right_begins) begin
        was_decided <= 1'b1;
        decided_frame <= left_begins ? left_begun : right_begun;
        decision <= left_begins ? left_takes : right_takes;
        if (meet) decided_frame <= number;
      end else if (close && close_frame == decided_frame) decision <= 1'b0;
      if (pair_pop || restart) begin
        was_overrun <= 1'b0;
        was_astray <= 1'b0;
      end
      if (left_drop) begin
        if (left_is_overrun) was_overrun <= 1'b1;
        else was_astray <= 1'b1;
      end
      if (right_drop) begin
        if (right_is_overrun) was_overrun <= 1'b1;
        else was_astray <= 1'b1;
      end
    end
  end

  logic [31:0] register_data;
  logic [1:0] region;
  wire [15:0] pairs = left_waiting < right_waiting ? left_waiting : right_waiting;
  always_ff @(posedge clk) begin
    region <= addr[14:13];
    case (addr[5:2])
      4'd0: register_data <= {pairs, 12'b0, skewed, astray, overrun, ready};
      4'd1: register_data <= left_place;
      4'd2: register_data <= {right_pixels, left_pixels};
      4'd3: register_data <= left_ended;
      4'd4: register_data <= skew;
      4'd6: register_data <= {16'b0, level};
      4'd7: register_data <= limit;
      4'd8: register_data <= {right_lost, left_lost};
      4'd9: register_data <= {right_frame, left_frame};
      4'd10: register_data <= {16'(LINES), 16'(4 * LINE_WORDS)};
      4'd11: register_data <= now;
      default: register_data <= '0;
    endcase
  end
  assign read_data = region == 2'd2 ? left_word : region == 2'd3 ? right_word : register_data;

  localparam logic [15:0] NEARLY_FULL = 16'(LINES - 1);
  assign has_room = left_waiting < NEARLY_FULL && right_waiting < NEARLY_FULL;
  assign may_begin = left_waiting == 0 && right_waiting == 0;
  assign wait_alone = (left_waiting == 0) != (right_waiting == 0);
endmodule
