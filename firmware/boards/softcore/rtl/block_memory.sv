// Memory that one side writes and another reads, a cycle later. What is read while it is written is not defined.
module block_memory #(
    parameter int WORDS = 512,
    parameter int BITS = 32
) (
    input  logic                     clk,
    input  logic                     write,
    input  logic [$clog2(WORDS)-1:0] write_at,
    input  logic [BITS-1:0]          write_data,
    input  logic [$clog2(WORDS)-1:0] read_at,
    output logic [BITS-1:0]          data
);
  (* ram_style = "block" *) logic [BITS-1:0] words[WORDS];
  always_ff @(posedge clk) begin
    if (write) words[write_at] <= write_data;
    data <= words[read_at];
  end
endmodule
