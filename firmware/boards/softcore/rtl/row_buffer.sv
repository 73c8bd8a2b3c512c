// 64 words of a run of bytes, of which one is read at once.
module row_buffer (
    input  logic        clk, write,
    input  logic [5:0]  write_at,
    input  logic [31:0] write_data,
    input  logic [5:0]  read_at,
    output logic [31:0] data
);
  (* ram_style = "distributed" *) logic [31:0] words[64];
  always_ff @(posedge clk) if (write) words[write_at] <= write_data;
  assign data = words[read_at];
endmodule
