// The program: the processor fetches from it, and nothing else can read or write it. What it holds is
// loaded with the configuration of the FPGA.
module code_ram #(
    parameter int WORDS = 65536,
    parameter FILE = ""
) (
    input  logic                     clk,
    input  logic [$clog2(WORDS)-1:0] addr,
    output logic [31:0]              data     // a cycle later
);
  (* ram_style = "block" *) logic [31:0] words[WORDS];
`ifdef VERILATOR
  string file;
  initial if ($value$plusargs("code=%s", file)) $readmemh(file, words);
`else
  initial if (FILE != "") $readmemh(FILE, words);
`endif
  always_ff @(posedge clk) data <= words[addr];
endmodule
