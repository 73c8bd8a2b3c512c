// The processor VexRiscv with byte instructions, behind the port that all processors have here (soc.sv). It caches what is
// below 0x8000_0000, in lines of eight words.
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
  localparam logic [2:0] IN_BURST = 3'b010;

  // Each word of a burst but the first comes with the next cycle: while one is acknowledged, the memory is at the next.
  // Writes are taken at once.
  logic code_cyc, code_stb, code_ack, data_cyc, data_stb, data_we, read_ack;
  logic [29:0] code_adr, data_adr;
  logic [2:0] code_cti, data_cti;
  assign code_reads = code_cyc && code_stb;
  assign data_active = data_cyc && data_stb;
  assign data_writes = data_active && data_we;
  assign data_reads = data_active && !data_we && !read_ack;
  wire code_goes_on = code_ack && code_cti == IN_BURST;
  wire data_goes_on = read_ack && data_cti == IN_BURST;
  // A burst stays in its line.
  assign code_word = {code_adr[29:3], code_adr[2:0] + 3'(code_goes_on)};
  assign data_word = {data_adr[29:3], data_adr[2:0] + 3'(data_goes_on)};
  always_ff @(posedge clk) begin
    code_ack <= rst_n && code_reads && (!code_ack || code_goes_on);
    read_ack <= rst_n && data_active && !data_we && (!read_ack || data_goes_on);
  end

  // Instructions of our own.
  logic cfu_asks, cfu_takes, cfu_has_result, cfu_result_taken;
  logic [9:0] cfu_id;
  logic [31:0] cfu_a, cfu_b, cfu_result;
  byte_instructions instructions (
      .clk, .rst_n, .asks(cfu_asks), .takes(cfu_takes), .id(cfu_id), .a(cfu_a), .b(cfu_b),
      .has_result(cfu_has_result), .result_taken(cfu_result_taken), .result(cfu_result));
  VexRiscv cpu (
      .clk, .reset(!rst_n), .externalResetVector(32'h0), .timerInterrupt(1'b0),
      .softwareInterrupt(1'b0), .externalInterruptArray(32'b0),
      .iBusWishbone_CYC(code_cyc), .iBusWishbone_STB(code_stb), .iBusWishbone_ACK(code_ack),
      .iBusWishbone_WE(), .iBusWishbone_ADR(code_adr), .iBusWishbone_DAT_MISO(code_data),
      .iBusWishbone_DAT_MOSI(), .iBusWishbone_SEL(), .iBusWishbone_ERR(1'b0),
      .iBusWishbone_CTI(code_cti), .iBusWishbone_BTE(),
      .dBusWishbone_CYC(data_cyc), .dBusWishbone_STB(data_stb),
      .dBusWishbone_ACK(read_ack || data_writes), .dBusWishbone_WE(data_we),
      .dBusWishbone_ADR(data_adr), .dBusWishbone_DAT_MISO(data_in),
      .dBusWishbone_DAT_MOSI(data_out), .dBusWishbone_SEL(data_bytes), .dBusWishbone_ERR(1'b0),
      .dBusWishbone_CTI(data_cti), .dBusWishbone_BTE(),
      .CfuPlugin_bus_cmd_valid(cfu_asks), .CfuPlugin_bus_cmd_ready(cfu_takes),
      .CfuPlugin_bus_cmd_payload_function_id(cfu_id), .CfuPlugin_bus_cmd_payload_inputs_0(cfu_a),
      .CfuPlugin_bus_cmd_payload_inputs_1(cfu_b), .CfuPlugin_bus_rsp_valid(cfu_has_result),
      .CfuPlugin_bus_rsp_ready(cfu_result_taken), .CfuPlugin_bus_rsp_payload_outputs_0(cfu_result));
endmodule
