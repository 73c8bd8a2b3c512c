// The gate of the processor's clock, which it leaves to whoever builds it: always open, as an FPGA gates no clocks.
module cv32e40p_clock_gate (
    input  logic clk_i, en_i, scan_cg_en_i,
    output logic clk_o
);
  assign clk_o = clk_i;
endmodule
