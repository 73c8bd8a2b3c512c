// A queue from one clock domain to another. Each side sees the other's pointer in Gray code through
// two flip-flops: it may be old, but it is never a value that the pointer did not have. So what one
// side takes for full or empty may be late, never wrong.
module async_fifo #(
    parameter int WIDTH = 8,
    parameter int DEPTH_BITS = 4
) (
    input  logic             write_clk,
    input  logic             write_rst_n,
    input  logic             push,         // ignored while the queue is full
    input  logic [WIDTH-1:0] write_data,
    output logic             full,
    input  logic             read_clk,
    input  logic             read_rst_n,
    input  logic             pop,          // only while the queue is not empty
    output logic [WIDTH-1:0] read_data,    // the oldest, while the queue is not empty
    output logic             empty
);
  logic [WIDTH-1:0] entries[2**DEPTH_BITS];
  logic [DEPTH_BITS:0] write_at, write_gray, read_at, read_gray;
  logic [DEPTH_BITS:0] write_gray_1, write_gray_2, read_gray_1, read_gray_2;

  function automatic logic [DEPTH_BITS:0] gray(input logic [DEPTH_BITS:0] value);
    return value ^ (value >> 1);
  endfunction

  // Full: the pointers differ in the lap alone, which turns the two upper bits of the code.
  assign full = write_gray == {~read_gray_2[DEPTH_BITS:DEPTH_BITS-1], read_gray_2[DEPTH_BITS-2:0]};
  assign empty = read_gray == write_gray_2;
  assign read_data = entries[read_at[DEPTH_BITS-1:0]];

  wire [DEPTH_BITS:0] write_next = write_at + 1'b1;
  wire [DEPTH_BITS:0] read_next = read_at + 1'b1;

  always_ff @(posedge write_clk) begin
    if (push && !full) entries[write_at[DEPTH_BITS-1:0]] <= write_data;
  end
  always_ff @(posedge write_clk or negedge write_rst_n) begin
    if (!write_rst_n) begin
      write_at <= '0;
      write_gray <= '0;
      read_gray_1 <= '0;
      read_gray_2 <= '0;
    end else begin
      read_gray_1 <= read_gray;
      read_gray_2 <= read_gray_1;
      if (push && !full) begin
        write_at <= write_next;
        write_gray <= gray(write_next);
      end
    end
  end
  always_ff @(posedge read_clk or negedge read_rst_n) begin
    if (!read_rst_n) begin
      read_at <= '0;
      read_gray <= '0;
      write_gray_1 <= '0;
      write_gray_2 <= '0;
    end else begin
      write_gray_1 <= write_gray;
      write_gray_2 <= write_gray_1;
      if (pop) begin
        read_at <= read_next;
        read_gray <= gray(read_next);
      end
    end
  end
endmodule
