// One sensor: its pins, and a ring of its last lines with what is known of each. All but the pins is
// in the system's domain.
//
// A line is stored whole or not at all: not unless its frame is taken, and not when the ring has no
// room at its first pixel. Lines that are not stored are counted, and the next one that is stored says
// that some are missing before it.
module dvp_sensor #(
    parameter int LINES = 128,             // room of the ring
    parameter int LINE_WORDS = 40          // words of a line, four pixels each
) (
    input  logic        clk, rst_n,
    input  logic        pclk, vsync, href,
    input  logic [7:0]  d,
    input  logic [31:0] now,               // cycles
    // Where the sensor is. A line that has ended is in the ring, or never comes.
    output logic [15:0] frame, next_line,
    output logic        skipped,           // lines since the last one stored were not
    // Frames: the pair decides which are taken.
    output logic        frame_begins,      // one cycle
    output logic [15:0] frame_next,        // its number then
    input  logic        takes,             // the answer, in the same cycle
    output logic        is_full,           // one cycle: a line had no room
    input  logic        close,             // what is left of the frame is not taken
    input  logic        restart,           // forget all lines, and wait for a frame
    input  logic        renumber,          // the frame that has begun has this number
    input  logic [15:0] number,
    // The oldest line.
    output logic        valid,
    output logic        comes_next,        // there is one, but it is not read from the ring yet
    output logic [15:0] line_frame, line,
    output logic [15:0] pixels,
    output logic [31:0] ended,             // when, in cycles
    output logic        gap,               // lines before it were not stored
    output logic        is_torn,           // some of it is lost: the queue of its pins was full
    input  logic        pop,
    input  logic        drop,              // with `pop`: nobody gets it
    input  logic [$clog2(LINE_WORDS)-1:0] word_at,
    output logic [31:0] word,              // a cycle after `word_at`
    output logic [15:0] waiting,           // lines in the ring
    output logic [15:0] lost               // lines that nobody gets, modulo 2^16
);
  localparam int AT = $clog2(LINES * LINE_WORDS);
  localparam int SLOT = $clog2(LINES);
  localparam logic [1:0] WORD = 2'd0;
  localparam logic [1:0] LINE_END = 2'd1;
  localparam logic [1:0] FRAME = 2'd2;

  logic comes, comes_torn;
  logic [1:0] kind, rest;
  logic [31:0] data;
  dvp_pins pins (.rst_n, .pclk, .vsync, .href, .d, .clk, .pop(comes), .valid(comes), .kind, .rest,
      .torn(comes_torn), .word(data));
  wire is_word = comes && kind == WORD;
  wire is_end = comes && kind == LINE_END;
  assign frame_begins = comes && kind == FRAME;
  assign frame_next = frame + 1'b1;

  // The line that comes.
  logic is_taken;                          // its frame is
  logic was_seen;                          // a frame, since the reset: lines count from then on
  logic has_begun;                         // a frame, since the last restart
  logic in_line, is_stored, torn;
  logic [15:0] count;                      // pixels so far
  wire first = (is_word || is_end) && !in_line;
  wire has_room = waiting != 16'(LINES);
  wire stores = first ? is_taken && has_room : is_stored;
  assign is_full = first && is_taken && !has_room;
  wire ends = is_end && stores;

  // Where lines are in the ring: slots, and the words that they begin at.
  logic [SLOT-1:0] write_slot, read_slot;
  logic [AT-1:0] write_base, read_base;
  wire [15:0] place = {2'b0, count[15:2]};
  wire fits = place < 16'(LINE_WORDS);
  (* ram_style = "block" *) logic [31:0] ring[LINES * LINE_WORDS];
  always_ff @(posedge clk) begin
    if (stores && fits && (is_word || (is_end && rest != 0))) ring[write_base + AT'(place)] <= data;
    word <= ring[read_base + AT'(word_at)];
  end
  logic [81:0] known[LINES], fetched;
  logic is_fetched;
  always_ff @(posedge clk) begin
    if (ends) begin
      known[write_slot] <= {skipped, torn || comes_torn, now, count + 16'(rest), frame, next_line};
    end
    // Two registers: block RAM is slow. The slot after one that is popped or forgotten is read anew.
    fetched <= known[read_slot];
    is_fetched <= rst_n && !pop && !restart && waiting != 0;
    {gap, is_torn, ended, pixels, line_frame, line} <= fetched;
    valid <= rst_n && !pop && !restart && is_fetched;
  end
  assign comes_next = waiting != 0 && !valid;

  function automatic logic [SLOT-1:0] after(input logic [SLOT-1:0] slot);
    return slot == SLOT'(LINES - 1) ? '0 : slot + 1'b1;
  endfunction
  function automatic logic [AT-1:0] base_after(input logic [SLOT-1:0] slot, input logic [AT-1:0] base);
    return slot == SLOT'(LINES - 1) ? '0 : base + AT'(LINE_WORDS);
  endfunction

  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {is_taken, was_seen, has_begun, in_line, is_stored, torn, skipped} <= '0;
      {count, next_line, waiting, lost} <= '0;
      frame <= '1;
      {write_slot, read_slot, write_base, read_base} <= '0;
    end else begin
      if (is_word || is_end) begin
        in_line <= is_word;
        is_stored <= stores;
        count <= is_word ? count + 16'd4 : '0;
        torn <= is_word && (torn || comes_torn);
      end
      if (is_end) begin
        next_line <= next_line + 1'b1;
        skipped <= !stores && has_begun;
      end
      if (close) is_taken <= 1'b0;
      if (frame_begins) begin
        // A line that it cuts off is gone.
        in_line <= 1'b0;
        count <= '0;
        torn <= comes_torn;
        frame <= frame_next;
        next_line <= '0;
        is_taken <= takes;
        was_seen <= 1'b1;
        has_begun <= 1'b1;
      end
      if (ends) begin
        write_slot <= after(write_slot);
        write_base <= base_after(write_slot, write_base);
      end
      if (pop) begin
        read_slot <= after(read_slot);
        read_base <= base_after(read_slot, read_base);
      end
      waiting <= waiting + 16'(ends) - 16'(pop);
      lost <= lost + 16'(was_seen && ((is_end && !stores) || (frame_begins && in_line))) + 16'(pop && drop);
      if (restart) begin
        is_taken <= 1'b0;
        is_stored <= 1'b0;
        skipped <= 1'b0;
        has_begun <= 1'b0;
        {write_slot, read_slot, write_base, read_base, waiting} <= '0;
        lost <= lost + waiting + 16'(was_seen && (is_end || (frame_begins && in_line)));
      end
      if (renumber) frame <= number;
    end
  end
endmodule
