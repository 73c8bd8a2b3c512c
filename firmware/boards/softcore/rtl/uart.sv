// Serial port, 8N1, with a queue in each direction.
//
//  0x0 DATA    write: sends a byte, if there is room; read: takes the oldest byte that has come
//  0x4 STATUS  [0] room to send  [1] all sent  [2] a byte has come  [3] bytes were lost, or came
//              damaged, since the last read of this register
module uart #(
    parameter int DIVIDER = 16,            // cycles of a bit
    parameter int QUEUE_BITS = 9
) (
    input  logic        clk, rst_n,
    input  logic        write, read,       // one cycle each
    input  logic [2:0]  addr,
    input  logic [7:0]  write_data,
    output logic [31:0] read_data,         // a cycle after `read`
    input  logic        rx,
    output logic        tx
);
  localparam int TICK = $clog2(DIVIDER);
  wire at_data = addr[2] == 1'b0;

  // To send.
  logic [7:0] to_send[2**QUEUE_BITS];
  logic [QUEUE_BITS-1:0] send_in, send_out;
  wire [QUEUE_BITS-1:0] send_next = send_in + 1'b1;
  wire send_room = send_next != send_out;
  logic [9:0] out_bits;
  logic [3:0] out_left;
  logic [TICK-1:0] out_tick;
  logic [7:0] head;
  logic has_head;                          // `head` is the queue's first
  wire sends = write && at_data && send_room;
  assign tx = out_left == 0 || out_bits[0];
  always_ff @(posedge clk) begin
    if (sends) to_send[send_in] <= write_data;
    head <= to_send[send_out];
    if (!rst_n) begin
      {send_in, send_out, out_left, out_tick, has_head} <= '0;
      out_bits <= '1;
    end else begin
      if (sends) send_in <= send_next;
      has_head <= send_out != send_in && !(out_left == 0 && has_head);
      if (out_left == 0) begin
        if (has_head) begin
          out_bits <= {1'b1, head, 1'b0};
          out_left <= 4'd10;
          out_tick <= TICK'(DIVIDER - 1);
          send_out <= send_out + 1'b1;
        end
      end else if (out_tick == 0) begin
        out_bits <= {1'b1, out_bits[9:1]};
        out_left <= out_left - 1'b1;
        out_tick <= TICK'(DIVIDER - 1);
      end else out_tick <= out_tick - 1'b1;
    end
  end

  // Received. The first sample of a bit is in its middle.
  logic [7:0] received[2**QUEUE_BITS];
  logic [QUEUE_BITS-1:0] take_in, take_out;
  wire [QUEUE_BITS-1:0] take_next = take_in + 1'b1;
  logic [2:0] line;                        // the pin through two flip-flops, and once more
  logic [7:0] in_bits;
  logic [3:0] in_left;
  logic [TICK-1:0] in_tick;
  logic damaged;
  wire came = in_left == 4'd1 && in_tick == 0 && line[1];
  always_ff @(posedge clk) begin
    if (came && take_next != take_out) received[take_in] <= in_bits;
    if (!rst_n) begin
      {take_in, take_out, in_left, in_tick, in_bits, damaged} <= '0;
      line <= '1;
    end else begin
      line <= {line[1:0], rx};
      if (in_left == 0) begin
        if (line[2] && !line[1]) begin
          in_left <= 4'd10;
          in_tick <= TICK'(DIVIDER / 2 - 1);
        end
      end else if (in_tick != 0) in_tick <= in_tick - 1'b1;
      else begin
        in_tick <= TICK'(DIVIDER - 1);
        in_left <= in_left - 1'b1;
        if (in_left == 4'd10 && line[1]) in_left <= '0;      // no start bit
        if (in_left < 4'd10 && in_left > 4'd1) in_bits <= {line[1], in_bits[7:1]};
      end
      if (read && !at_data) damaged <= 1'b0;
      if (in_left == 4'd1 && in_tick == 0 && (!line[1] || take_next == take_out)) damaged <= 1'b1;
      if (came && take_next != take_out) take_in <= take_next;
      if (read && at_data && take_in != take_out) take_out <= take_out + 1'b1;
    end
  end

  always_ff @(posedge clk) begin
    read_data <= at_data ? {24'b0, received[take_out]}
        : {28'b0, damaged, take_in != take_out, send_out == send_in && out_left == 0, send_room};
  end
endmodule
