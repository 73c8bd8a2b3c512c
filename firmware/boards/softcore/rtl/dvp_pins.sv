// The pins of one sensor, in the domain of its pixel clock: pixels are packed to words, and words,
// ends of lines and beginnings of frames go into a queue to the system's clock. Between the domains
// there is nothing else.
//
// HREF is high while bytes come; a frame begins when VSYNC rises. A byte is taken at the rising
// edge of PCLK, as OV7670 and its like present it. A pixel is two bytes, of which the first is its grey, and the
// second one, a colour, is left out.
module dvp_pins #(
    parameter int QUEUE_BITS = 4
) (
    input  logic        rst_n,             // of the system; taken asynchronously
    input  logic        pclk, vsync, href,
    input  logic [7:0]  d,
    // In the system's domain: the oldest event.
    input  logic        clk,
    input  logic        pop,
    output logic        valid,
    output logic [1:0]  kind,              // as the constants below
    output logic [1:0]  rest,              // at the end of a line: pixels in `word`, first in bits 7:0
    output logic        torn,              // events were lost before this one: the queue was full
    output logic [31:0] word
);
  localparam logic [1:0] WORD = 2'd0;
  localparam logic [1:0] LINE_END = 2'd1;
  localparam logic [1:0] FRAME = 2'd2;

  logic [1:0] pclk_rst;
  always_ff @(posedge pclk or negedge rst_n) begin
    if (!rst_n) pclk_rst <= '0;
    else pclk_rst <= {pclk_rst[0], 1'b1};
  end
  wire pclk_rst_n = pclk_rst[1];

  logic vsync_q, vsync_qq, href_q, href_qq;
  logic [7:0] pixel;
  always_ff @(posedge pclk or negedge pclk_rst_n) begin
    if (!pclk_rst_n) begin
      {vsync_q, vsync_qq, href_q, href_qq} <= '0;
      pixel <= '0;
    end else begin
      {vsync_qq, vsync_q} <= {vsync_q, vsync};
      {href_qq, href_q} <= {href_q, href};
      pixel <= d;
    end
  end

  logic is_colour;                         // the byte in `pixel`, while `href_q`
  logic [1:0] held;                        // pixels in `pixels`, 0 to 3
  logic [23:0] pixels;                     // the last three, the newest above
  wire begins = vsync_q && !vsync_qq;
  wire ends = href_qq && !href_q;
  wire completes = href_q && !is_colour && held == 2'd3;
  logic push, full, lost;
  logic [36:0] event_in;
  always_comb begin
    push = 1'b1;
    if (begins) event_in = {lost, FRAME, 2'd0, 32'd0};
    else if (completes) event_in = {lost, WORD, 2'd0, pixel, pixels};
    else begin
      push = ends;
      // The pixels held are the uppermost ones.
      case (held)
        2'd1: event_in = {lost, LINE_END, held, 24'd0, pixels[23:16]};
        2'd2: event_in = {lost, LINE_END, held, 16'd0, pixels[23:8]};
        default: event_in = {lost, LINE_END, held, 8'd0, pixels};
      endcase
    end
  end
  always_ff @(posedge pclk or negedge pclk_rst_n) begin
    if (!pclk_rst_n) begin
      is_colour <= 1'b0;
      held <= '0;
      pixels <= '0;
      lost <= 1'b0;
    end else begin
      is_colour <= href_q && !is_colour;
      if (!href_q) held <= '0;
      else if (!is_colour) begin
        pixels <= {pixel, pixels[23:8]};
        held <= held + 2'd1;
      end
      if (push) lost <= full;
    end
  end

  logic empty;
  async_fifo #(.WIDTH(37), .DEPTH_BITS(QUEUE_BITS)) queue (
      .write_clk(pclk), .write_rst_n(pclk_rst_n), .push, .write_data(event_in), .full,
      .read_clk(clk), .read_rst_n(rst_n), .pop, .read_data({torn, kind, rest, word}), .empty);
  assign valid = !empty;
endmodule
