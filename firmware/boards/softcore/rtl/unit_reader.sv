// Reads runs of bytes from the data memory, in the order in which they are queued, and gives them as words in which
// the first byte of a run lies where it was asked for. Up to four bytes around a run are read with it.
module unit_reader #(
    parameter int QUEUE = 32
) (
    input  logic        clk, rst_n,
    // Queues a run.
    input  logic        queue,
    input  logic [23:0] address,       // of its first byte
    input  logic [9:0]  bytes,         // at least 1
    input  logic [4:0]  destination,   // goes with its words
    input  logic [1:0]  place,         // of the first byte in the first word
    output logic        busy,
    // The memory. What is asked for comes a cycle after it is taken.
    output logic        asks,
    output logic [21:0] word_at,
    input  logic        takes,
    input  logic [31:0] data,
    // A word of the run.
    output logic        valid,
    output logic [6:0]  index,
    output logic [4:0]  to,
    output logic [31:0] word
);
  localparam int AT = $clog2(QUEUE);
  (* ram_style = "distributed" *) logic [40:0] runs[QUEUE];
  logic [AT:0] written, begun;
  wire [40:0] next = runs[begun[AT-1:0]];
  wire [23:0] next_address = next[23:0];
  wire [9:0] next_bytes = next[33:24];
  wire [1:0] next_place = next[40:39];
  // Where the source lies further on in its word, the first word that is read fills none.
  wire is_further = next_address[1:0] > next_place;
  wire [10:0] next_words = (11'(next_bytes) + 11'(next_place) + 11'd3) >> 2;

  logic [10:0] left;
  logic [1:0] shift;
  logic further;
  logic [4:0] to_now;
  // The word that has been taken.
  logic comes, comes_first, comes_further;
  logic [1:0] comes_shift;
  logic [4:0] comes_to;
  logic [31:0] held;
  logic is_first, is_second;
  wire [63:0] both = {data, held};
  assign asks = left != 0;
  assign busy = written != begun || asks || comes || valid;

  always_ff @(posedge clk) begin
    if (queue) runs[written[AT-1:0]] <= {place, destination, bytes, address};
    if (!rst_n) begin
      {written, begun, left, comes, valid} <= '0;
    end else begin
      if (queue) written <= written + 1'b1;
      if (asks && takes) begin
        left <= left - 1'b1;
        word_at <= word_at + 1'b1;
        is_first <= 1'b0;
      end
      if (!asks && written != begun) begin
        begun <= begun + 1'b1;
        left <= next_words + 11'(is_further);
        word_at <= next_address[23:2];
        shift <= next_address[1:0] - next_place;
        further <= is_further;
        to_now <= next[38:34];
        is_first <= 1'b1;
      end
      comes <= asks && takes;
      {comes_first, comes_further, comes_shift, comes_to} <= {is_first, further, shift, to_now};
      valid <= comes && !(comes_first && comes_further);
      if (comes) begin
        held <= data;
        to <= comes_to;
        index <= comes_first ? '0 : index + 7'(!(is_second && comes_further));
        is_second <= comes_first;
        word <= comes_shift == 0 ? data : both[8*comes_shift+:32];
      end
    end
  end
endmodule
