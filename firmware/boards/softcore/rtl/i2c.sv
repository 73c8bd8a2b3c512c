// The I2C bus of two sensors of one address: they share SCL and have an SDA each. Both take each byte in the same cycle,
// so that they stay in step, and each answers by itself. It also has the wire of their reset.
//
//  0x0 BYTE    write: sends nine bits, unless some are under way: [8:1] byte, [0] acknowledgement  [9] a start before
//              them, which may be a repeated one  [10] a stop in their place  [11] the bits of the byte are the sensors':
//              to read it, write ones
//              read: [7:0] bits of the left sensor's SDA  [15:8] of the right one's  [16] under way
//              [17] the left sensor did not acknowledge  [18] nor did the right one
//              [19] the left sensor's SDA was low where it was released  [20] the right one's
//              [21] SCL was low for too long. After the last three, all is released.
//  0x4 RESET   write: [0] level of the sensors' reset, which is active when it is low, as after a reset
//
// A symbol - start, bit or stop - has four quarters: SDA is set, SCL rises, SDA may change, SCL falls.
module i2c #(
    parameter int QUARTER_CYCLES = 120,    // of a bit: 100 kHz at 48 MHz
    parameter int STRETCH_BITS = 16        // 2^n cycles for which SCL may be held low
) (
    input  logic        clk, rst_n,
    input  logic        write,
    input  logic [2:0]  addr,
    input  logic [11:0] write_data,
    output logic [31:0] read_data,         // a cycle after the address
    // Open drain: each pin is low where this says so, and is pulled up otherwise.
    output logic        scl_low, left_sda_low, right_sda_low,
    input  logic        scl, left_sda, right_sda,
    output logic        sensors_rst_n
);
  typedef enum logic [1:0] {IDLE, START, BITS, STOP} symbol_t;
  symbol_t symbol;
  logic [1:0] quarter;
  logic [$clog2(QUARTER_CYCLES)-1:0] tick;
  logic [STRETCH_BITS-1:0] stretched;
  logic [8:0] to_send;                     // the next bit is the uppermost
  logic [3:0] left;                        // bits
  logic is_read, sda_low;
  logic [8:0] left_bits, right_bits;
  logic left_stuck, right_stuck, scl_stuck;
  assign left_sda_low = sda_low;
  assign right_sda_low = sda_low;

  // The pins come through two flip-flops.
  logic scl_q, scl_in;
  logic [1:0] sda_q, sda_in;               // right, left
  always_ff @(posedge clk) begin
    {scl_in, scl_q} <= {scl_q, scl};
    {sda_in, sda_q} <= {sda_q, {right_sda, left_sda}};
  end

  wire is_last = left == 4'd1;
  // What SDA is until SCL is high, and what it is while SCL is.
  wire first_low = symbol == STOP || (symbol == BITS && !to_send[8]);
  wire then_low = symbol == START || (symbol == BITS && !to_send[8]);
  // Where SDA is released, and no sensor may answer.
  wire is_ours = symbol == START || (symbol == BITS && to_send[8] && !is_last && !is_read);
  wire waits = quarter == 2'd1 && !scl_in;
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      symbol <= IDLE;
      {quarter, tick, stretched, to_send, left, is_read, sda_low, scl_low} <= '0;
      {left_bits, right_bits, left_stuck, right_stuck, scl_stuck} <= '0;
      sensors_rst_n <= 1'b0;
    end else begin
      if (write && addr[2]) sensors_rst_n <= write_data[0];
      if (symbol == IDLE) begin
        if (write && !addr[2]) begin
          symbol <= write_data[10] ? STOP : write_data[9] ? START : BITS;
          is_read <= write_data[11];
          to_send <= write_data[8:0];
          left <= 4'd9;
          {quarter, tick, stretched} <= '0;
          {left_bits, right_bits, left_stuck, right_stuck, scl_stuck} <= '0;
        end
      end else if (tick == 0 && quarter == 2'd0) begin
        sda_low <= first_low;
        tick <= tick + 1'b1;
      end else if (waits) begin
        stretched <= stretched + 1'b1;
        tick <= '0;
        if (&stretched) begin
          symbol <= IDLE;
          scl_stuck <= 1'b1;
          {sda_low, scl_low} <= '0;
        end
      end else if (tick != ($clog2(QUARTER_CYCLES))'(QUARTER_CYCLES - 1)) begin
        tick <= tick + 1'b1;
      end else begin
        tick <= '0;
        quarter <= quarter + 1'b1;
        stretched <= '0;
        case (quarter)
          2'd0: scl_low <= 1'b0;
          2'd1: begin
            sda_low <= then_low;
            if (symbol == BITS) begin
              left_bits <= {left_bits[7:0], sda_in[0]};
              right_bits <= {right_bits[7:0], sda_in[1]};
            end
            if (is_ours && sda_in != 2'b11) begin
              symbol <= IDLE;
              {right_stuck, left_stuck} <= ~sda_in;
              {sda_low, scl_low} <= '0;
            end
          end
          2'd2: scl_low <= symbol != STOP;
          default: begin
            case (symbol)
              START: symbol <= BITS;
              BITS: begin
                to_send <= to_send << 1;
                left <= left - 1'b1;
                if (is_last) symbol <= IDLE;
              end
              default: symbol <= IDLE;
            endcase
          end
        endcase
      end
    end
  end

  always_ff @(posedge clk) begin
    read_data <= {10'b0, scl_stuck, right_stuck, left_stuck, !is_read && right_bits[0], !is_read && left_bits[0],
        symbol != IDLE, right_bits[8:1], left_bits[8:1]};
  end
endmodule
