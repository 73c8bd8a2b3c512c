// The processor CV32E40P with its Xpulp instructions, behind the port that all processors have here (soc.sv). It has no
// caches: block RAM answers each request with the next cycle. A word that is not aligned takes it two requests.
module processor (
    input  logic        clk, rst_n,
    output logic        code_reads,
    output logic [29:0] code_word,
    input  logic [31:0] code_data,
    output logic        data_active, data_reads, data_writes,
    output logic [29:0] data_word,
    output logic [3:0]  data_bytes,
    output logic [31:0] data_out,
    input  logic [31:0] data_in
);
  logic code_valid, data_valid, data_we;
  logic [31:0] code_addr, data_addr;
  assign code_word = code_addr[31:2];
  assign data_word = data_addr[31:2];
  assign data_reads = data_active && !data_we;
  assign data_writes = data_active && data_we;
  always_ff @(posedge clk) begin
    code_valid <= rst_n && code_reads;
    data_valid <= rst_n && data_active;
  end

  cv32e40p_top #(.COREV_PULP(1)) cpu (
      .clk_i(clk), .rst_ni(rst_n), .pulp_clock_en_i(1'b1), .scan_cg_en_i(1'b0), .boot_addr_i(32'h0),
      .mtvec_addr_i(32'h0), .dm_halt_addr_i(32'h0), .hart_id_i(32'h0), .dm_exception_addr_i(32'h0),
      .instr_req_o(code_reads), .instr_gnt_i(1'b1), .instr_rvalid_i(code_valid), .instr_addr_o(code_addr),
      .instr_rdata_i(code_data), .data_req_o(data_active), .data_gnt_i(1'b1), .data_rvalid_i(data_valid),
      .data_we_o(data_we), .data_be_o(data_bytes), .data_addr_o(data_addr), .data_wdata_o(data_out),
      .data_rdata_i(data_in), .irq_i(32'b0), .irq_ack_o(), .irq_id_o(), .debug_req_i(1'b0), .debug_havereset_o(),
      .debug_running_o(), .debug_halted_o(), .fetch_enable_i(1'b1), .core_sleep_o());
endmodule
