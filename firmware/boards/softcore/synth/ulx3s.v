// The soft core on a ULX3S with an ECP5-85F, and two OV7670 at its header J1. The pins are in ulx3s.lpf. It is
// Verilog, as the reader of SystemVerilog does not know the FPGA's cells.
module ulx3s (
    input        clk_25mhz,
    input        button_n,           // low while it is pressed: resets the board
    output       ftdi_rxd,
    input        ftdi_txd,
    output [7:0] led,
    output       wifi_en, wifi_gpio0,
    input        left_pclk, left_vsync, left_href,
    input  [7:0] left_d,
    input        right_pclk, right_vsync, right_href,
    input  [7:0] right_d,
    output       left_xclk, right_xclk,
    output       sensors_rst_n,
    inout        scl, left_sda, right_sda
);
  // Some pins of the header are also those of the ESP32, which is held in reset, and does not reset the FPGA.
  assign wifi_en = 1'b0;
  assign wifi_gpio0 = 1'b1;

  // 25 MHz / 5 * 12 * 8 = 480 MHz; a tenth of it is the system's clock, a twentieth the sensors'.
  wire clk_feedback, clk, xclk, is_locked;
  (* FREQUENCY_PIN_CLKI = "25" *) (* FREQUENCY_PIN_CLKOP = "60" *)
  (* FREQUENCY_PIN_CLKOS = "48" *) (* FREQUENCY_PIN_CLKOS2 = "24" *)
  (* ICP_CURRENT = "12" *) (* LPF_RESISTOR = "8" *) (* MFG_ENABLE_FILTEROPAMP = "1" *) (* MFG_GMCREF_SEL = "2" *)
  EHXPLLL #(
      .CLKI_DIV(5), .CLKFB_DIV(12), .FEEDBK_PATH("CLKOP"),
      .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(8), .CLKOP_CPHASE(7), .CLKOP_FPHASE(0),
      .CLKOS_ENABLE("ENABLED"), .CLKOS_DIV(10), .CLKOS_CPHASE(9), .CLKOS_FPHASE(0),
      .CLKOS2_ENABLE("ENABLED"), .CLKOS2_DIV(20), .CLKOS2_CPHASE(19), .CLKOS2_FPHASE(0),
      .OUTDIVIDER_MUXA("DIVA"), .OUTDIVIDER_MUXB("DIVB"), .OUTDIVIDER_MUXC("DIVC"), .OUTDIVIDER_MUXD("DIVD"),
      .PLLRST_ENA("DISABLED"), .INTFB_WAKE("DISABLED"), .STDBY_ENABLE("DISABLED"), .DPHASE_SOURCE("DISABLED")
  ) pll (
      .CLKI(clk_25mhz), .CLKFB(clk_feedback), .CLKOP(clk_feedback), .CLKOS(clk), .CLKOS2(xclk), .CLKOS3(),
      .LOCK(is_locked), .INTLOCK(), .REFCLK(), .CLKINTFB(), .RST(1'b0), .STDBY(1'b0), .PHASESEL0(1'b0),
      .PHASESEL1(1'b0), .PHASEDIR(1'b1), .PHASESTEP(1'b1), .PHASELOADREG(1'b1), .PLLWAKESYNC(1'b0),
      .ENCLKOP(1'b0), .ENCLKOS(1'b0), .ENCLKOS2(1'b0), .ENCLKOS3(1'b0));

  // The clock is forwarded by registers at the pins, so that both sensors have the same edges.
  ODDRX1F left_clock (.SCLK(xclk), .RST(1'b0), .D0(1'b1), .D1(1'b0), .Q(left_xclk));
  ODDRX1F right_clock (.SCLK(xclk), .RST(1'b0), .D0(1'b1), .D1(1'b0), .Q(right_xclk));

  // The reset ends 5 ms after the clock has begun and the button is released.
  reg [1:0] is_up;
  reg [17:0] calm;
  reg rst_n;
  always @(posedge clk or negedge is_locked) begin
    if (!is_locked) begin
      {is_up, calm, rst_n} <= 21'd0;
    end else begin
      is_up <= {is_up[0], button_n};
      calm <= is_up[1] ? calm + !(&calm) : 18'd0;
      rst_n <= &calm;
    end
  end

  wire scl_low, left_sda_low, right_sda_low, scl_in, left_sda_in, right_sda_in;
  BB scl_pin (.I(1'b0), .T(!scl_low), .O(scl_in), .B(scl));
  BB left_sda_pin (.I(1'b0), .T(!left_sda_low), .O(left_sda_in), .B(left_sda));
  BB right_sda_pin (.I(1'b0), .T(!right_sda_low), .O(right_sda_in), .B(right_sda));

  soc system (
      .clk(clk), .rst_n(rst_n), .rx(ftdi_txd), .tx(ftdi_rxd), .leds(led), .sensors_rst_n(sensors_rst_n),
      .left_pclk(left_pclk), .left_vsync(left_vsync), .left_href(left_href), .left_d(left_d),
      .right_pclk(right_pclk), .right_vsync(right_vsync), .right_href(right_href), .right_d(right_d),
      .scl_low(scl_low), .left_sda_low(left_sda_low), .right_sda_low(right_sda_low),
      .scl(scl_in), .left_sda(left_sda_in), .right_sda(right_sda_in),
      .camera_has_room(), .camera_may_begin(), .camera_wait_alone(), .bus_fault());
endmodule
