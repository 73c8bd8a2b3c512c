// The words of a row of results. Cells are packed here while their samples come: a bit of each pixel is 1 where the
// sample before is greater than this one. It is the kernel `pack_cells`.
module unit_cells (
    input  logic        clk,
    input  logic        valid,
    input  logic [3:0]  sample,    // 0 has none before
    input  logic [5:0]  index,     // of the word
    input  logic [31:0] levels,
    // Words of other results, at other times.
    input  logic        write,
    input  logic [6:0]  write_at,
    input  logic [31:0] write_data,
    input  logic [6:0]  read_at,
    output logic [31:0] data
);
  (* ram_style = "distributed" *) logic [31:0] earlier[64];
  (* ram_style = "distributed" *) logic [31:0] words[128];
  wire [31:0] levels_before = earlier[index];
  wire [31:0] cells_before = words[index];
  wire [2:0] cell_bit = sample[2:0] - 3'd1;
  logic [31:0] cells_now;
  always_comb begin
    cells_now = sample == 4'd1 ? '0 : cells_before;
    for (int i = 0; i < 4; i++)
      cells_now[8*i+32'(cell_bit)] = levels_before[8*i+:8] > levels[8*i+:8];
  end
  always_ff @(posedge clk) begin
    if (valid) earlier[index] <= levels;
    if (write || (valid && sample != 0)) words[write ? write_at : 7'(index)] <= write ? write_data : cells_now;
  end
  assign data = words[read_at];
endmodule
