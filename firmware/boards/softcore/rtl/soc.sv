// The system on a chip: a processor, its memories, two camera ports, a serial port, a timer with a watchdog, eight LEDs,
// the bus that sets the sensors up, and the stereo unit, which reads the data memory while the processor does not. The
// module `processor` is that of the folder vexriscv or cv32e40p.
//
//  0x0000_0000  code, fetched only
//  0x1000_0000  data
//  0x8000_0000  serial port
//  0x8100_0000  timer and watchdog
//  0x8200_0000  camera ports
//  0x8300_0000  LEDs
//  0x8400_0000  stereo unit, if there is one
//  0x8500_0000  the sensors' I2C bus and reset
module soc #(
    parameter int CLOCK_MHZ = 48,
    parameter int BIT_CYCLES = 16,         // of the serial port
    parameter int UNIT_LANES = 16,         // costs in a cycle: 8, 16 or 32; 0 for no stereo unit
    // Without the unit, its kernels are code.
    parameter int CODE_WORDS = UNIT_LANES != 0 ? 53248 : 65536,
    parameter int DATA_WORDS = 24576,
    parameter int CAMERA_LINES = 128,
    parameter int CAMERA_LINE_WORDS = 40,
    parameter CODE_FILE = "",
    parameter DATA_FILE = ""
) (
    input  logic       clk, rst_n,
    input  logic       left_pclk, left_vsync, left_href,
    input  logic [7:0] left_d,
    input  logic       right_pclk, right_vsync, right_href,
    input  logic [7:0] right_d,
    // The sensors' I2C bus, open drain: pins that are to be low, and what they are.
    output logic       scl_low, left_sda_low, right_sda_low,
    input  logic       scl, left_sda, right_sda,
    output logic       sensors_rst_n,
    input  logic       rx,
    output logic       tx,
    output logic [7:0] leds,
    // For cameras that can be held.
    output logic       camera_has_room, camera_may_begin, camera_wait_alone,
    // The processor has asked for what is not there. It stays so.
    output logic       bus_fault
);
  logic core_rst_n;

  // Instructions: what the memory has at code_word comes with the next cycle. Data likewise. While an access of the
  // processor is active, the data memory is the processor's; a read begins, and a write is done, in one cycle.
  logic code_reads;
  logic [29:0] code_word;
  logic [31:0] code_data;
  logic data_active, data_reads, data_writes;
  logic [29:0] data_word;
  logic [3:0] data_bytes;
  logic [31:0] data_out, data_in;
  processor cpu (
      .clk, .rst_n(core_rst_n), .code_reads, .code_word, .code_data, .data_active, .data_reads, .data_writes, .data_word,
      .data_bytes, .data_out, .data_in);

  localparam int CODE_AT = $clog2(CODE_WORDS);
  localparam int DATA_AT = $clog2(DATA_WORDS);
  code_ram #(.WORDS(CODE_WORDS), .FILE(CODE_FILE)) program_ram (
      .clk, .addr(code_word[CODE_AT-1:0]), .data(code_data));

  wire [7:0] region = data_word[29:22];
  wire is_data = region == 8'h10;
  wire is_uart = region == 8'h80;
  wire is_timer = region == 8'h81;
  wire is_camera = region == 8'h82;
  wire is_leds = region == 8'h83;
  wire is_unit = region == 8'h84 && UNIT_LANES != 0;
  wire is_i2c = region == 8'h85;
  logic [7:0] region_read;
  logic [31:0] ram_data, uart_data, timer_data, camera_data, unit_data, i2c_data;
  // The unit has the data memory when the processor is not at what may be in it.
  logic unit_asks;
  logic [21:0] unit_word;
  wire unit_takes = unit_asks && !(data_active && !data_word[29]);

  data_ram #(.WORDS(DATA_WORDS), .FILE(DATA_FILE)) variable_ram (
      .clk, .addr(unit_takes ? unit_word[DATA_AT-1:0] : data_word[DATA_AT-1:0]), .write(data_writes && is_data), .bytes(data_bytes),
      .write_data(data_out), .data(ram_data));
  uart #(.DIVIDER(BIT_CYCLES)) serial (
      .clk, .rst_n(core_rst_n), .write(data_writes && is_uart), .read(data_reads && is_uart),
      .addr({data_word[0], 2'b0}), .write_data(data_out[7:0]), .read_data(uart_data), .rx, .tx);
  timer #(.CLOCK_MHZ(CLOCK_MHZ)) clock (
      .clk, .board_rst_n(rst_n), .rst_n(core_rst_n), .write(data_writes && is_timer),
      .read(data_reads && is_timer), .addr({data_word[1:0], 2'b0}), .write_data(data_out),
      .read_data(timer_data));
  dvp_pair #(.LINES(CAMERA_LINES), .LINE_WORDS(CAMERA_LINE_WORDS)) cameras (
      .clk, .rst_n(core_rst_n), .left_pclk, .left_vsync, .left_href, .left_d, .right_pclk,
      .right_vsync, .right_href, .right_d, .write(data_writes && is_camera),
      .addr({data_word[12:0], 2'b0}), .write_data(data_out), .read_data(camera_data),
      .has_room(camera_has_room), .may_begin(camera_may_begin), .wait_alone(camera_wait_alone));

  i2c sensor_bus (
      .clk, .rst_n(core_rst_n), .write(data_writes && is_i2c), .addr({data_word[0], 2'b0}),
      .write_data(data_out[11:0]), .read_data(i2c_data), .scl_low, .left_sda_low, .right_sda_low, .scl, .left_sda,
      .right_sda, .sensors_rst_n);

  if (UNIT_LANES != 0) begin : stereo
    stereo_unit #(.LANES(UNIT_LANES)) unit (
        .clk, .rst_n(core_rst_n), .write(data_writes && is_unit), .addr({data_word[10:0], 2'b0}),
        .write_data(data_out), .read_data(unit_data), .memory_asks(unit_asks), .memory_at(unit_word),
        .memory_takes(unit_takes), .memory_data(ram_data));
  end else begin : no_stereo
    assign unit_asks = 1'b0;
    assign unit_word = '0;
    assign unit_data = '0;
  end

  always_ff @(posedge clk) begin
    region_read <= region;
    if (!core_rst_n) leds <= '0;
    else if (data_writes && is_leds) leds <= data_out[7:0];
    if (!rst_n) bus_fault <= 1'b0;
    else if (core_rst_n) begin
      if (data_active && !(is_data || is_uart || is_timer || is_camera || is_leds || is_unit || is_i2c))
        bus_fault <= 1'b1;
      if (data_active && is_data && data_word[21:0] >= 22'(DATA_WORDS)) bus_fault <= 1'b1;
      if (code_reads && code_word >= 30'(CODE_WORDS)) bus_fault <= 1'b1;
    end
  end
  always_comb begin
    case (region_read)
      8'h80: data_in = uart_data;
      8'h81: data_in = timer_data;
      8'h82: data_in = camera_data;
      8'h83: data_in = {24'b0, leds};
      8'h84: data_in = unit_data;
      8'h85: data_in = i2c_data;
      default: data_in = ram_data;
    endcase
  end
endmodule
