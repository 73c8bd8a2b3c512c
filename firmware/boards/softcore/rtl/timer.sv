// Time since the reset, and a watchdog, which resets the processor unless it is fed in time. Once it
// runs, nothing but a reset of the board stops it.
//
//  0x0 TIME_LOW, 0x4 TIME_HIGH   us; the high word is that of the last read of the low one
//  0x8 WATCHDOG                  write: us until the reset; read: what is left, 0 while it is off
//  0xc RESETS                    by the watchdog, since the board was reset
module timer #(parameter int CLOCK_MHZ = 48) (
    input  logic        clk,
    input  logic        board_rst_n,       // of the board
    output logic        rst_n,             // of processor and peripherals: the watchdog's as well
    input  logic        write, read,
    input  logic [3:0]  addr,
    input  logic [31:0] write_data,
    output logic [31:0] read_data          // a cycle after `read`
);
  logic [$clog2(CLOCK_MHZ)-1:0] tick;
  logic [63:0] time_us;
  logic [31:0] high, left_us, resets;
  logic [3:0] resetting;                   // cycles
  wire is_us = tick == 0;
  assign rst_n = resetting == 0;
  always_ff @(posedge clk) begin
    if (!board_rst_n) begin
      {tick, time_us, high, left_us, resets} <= '0;
      resetting <= '1;
    end else begin
      tick <= is_us ? ($clog2(CLOCK_MHZ))'(CLOCK_MHZ - 1) : tick - 1'b1;
      if (is_us) time_us <= time_us + 1'b1;
      if (read && addr[3:2] == 2'd0) high <= time_us[63:32];
      if (resetting != 0) resetting <= resetting - 1'b1;
      if (left_us != 0 && is_us) begin
        left_us <= left_us - 1'b1;
        if (left_us == 1) begin
          resetting <= '1;
          resets <= resets + 1'b1;
        end
      end
      if (write && addr[3:2] == 2'd2 && write_data != 0) left_us <= write_data;
    end
    case (addr[3:2])
      2'd0: read_data <= time_us[31:0];
      2'd1: read_data <= high;
      2'd2: read_data <= left_us;
      default: read_data <= resets;
    endcase
  end
endmodule
