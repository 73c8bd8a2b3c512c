// Constants and variables: read and written by the processor. The constants are loaded with the
// configuration of the FPGA.
module data_ram #(
    parameter int WORDS = 24576,
    parameter FILE = ""
) (
    input  logic                     clk,
    input  logic [$clog2(WORDS)-1:0] addr,
    input  logic                     write,
    input  logic [3:0]               bytes,      // those that are written
    input  logic [31:0]              write_data,
    output logic [31:0]              data        // a cycle later
);
  (* ram_style = "block" *) logic [31:0] words[WORDS];
`ifdef VERILATOR
  string file;
  initial if ($value$plusargs("data=%s", file)) $readmemh(file, words);
`else
  initial if (FILE != "") $readmemh(FILE, words);
`endif
  always_ff @(posedge clk) begin
    for (int i = 0; i < 4; i++)
      if (write && bytes[i]) words[addr][8*i+:8] <= write_data[8*i+:8];
    data <= words[addr];
  end
endmodule
