// Instructions of our own, at the processor's port for custom functions (CFU): operations on the four bytes or the two
// halfwords of a register. Each takes two registers and gives one, and nothing stays behind: an interrupt may come
// between any two.
//
// An instruction's result is registered here and read by the processor's memory stage, so that one can begin in each
// cycle. The function is funct7 and funct3 of an instruction of opcode custom-0; the lowest byte is byte 0.
//
//  funct7  funct3  each byte or halfword of the result
//  0       0       byte: a + b, at most 255
//  0       1       byte: a - b, at least 0
//  0       2       byte: the lesser of a and b
//  0       3       byte: the lesser of the bytes of b beside it: byte 3 of a beside byte 0, none beside byte 3
//  0       4       byte: a; byte 3: the lesser of that of a and byte 0 of b
//  0       5       byte: the least of the bytes of a and b
//  0       6       byte: half of a + b, rounded down
//  0       7       byte: a times byte 0 of b, divided by 16, modulo 256
//  1       0-3     byte funct3: the number of ones of a ^ b; other bytes: 0
//  2       0       halfword: the lesser of a and b
//  2       1, 2    halfword: the sum of two bytes, of a and b: of bytes 0 and 1; 2 and 3
//  3       1-3     the word that begins at byte funct3 of a, and ends in b
//  4       0-7     byte: bit funct3 is whether a is greater than b, all others are 0
//  5       0       byte: the difference of a and b, without its sign
//  5       1       byte: 255 if a is at least b, else 0
//  5       2, 3    signed halfword: the lesser; the greater of a and b
//  6       0       as many bytes of a, from byte 0 on, as byte 3 of a says modulo 4, and then those of b
//  6       1       the bytes of b that were left out there, from byte 0 on, and their number in byte 3
//  7       0-7     halfword: 64 times the sum of that of a and a byte of b, bytes 0 and 1 if funct3 is even, else 2 and 3;
//                  and twice funct3, and 1 in the high one
//
// The result of any other function is 0.
module byte_instructions (
    input  logic        clk, rst_n,
    input  logic        asks,
    output logic        takes,
    input  logic [9:0]  id,
    input  logic [31:0] a, b,
    output logic        has_result,
    input  logic        result_taken,
    output logic [31:0] result
);
  function automatic logic [7:0] lesser(logic [7:0] x, logic [7:0] y);
    return x < y ? x : y;
  endfunction

  wire [2:0] funct3 = id[2:0];
  logic [7:0] lane_least[4];
  logic [7:0] least;
  logic [5:0] ones;
  always_comb begin
    for (int i = 0; i < 4; i++) lane_least[i] = lesser(a[8*i+:8], b[8*i+:8]);
    least = lesser(lesser(lane_least[0], lane_least[1]), lesser(lane_least[2], lane_least[3]));
    ones = '0;
    for (int i = 0; i < 32; i++) ones += 6'(a[i] ^ b[i]);
  end

  // The bytes beside each byte of b, from the highest of a on.
  wire [47:0] beside = {8'hff, b, a[31:24]};
  logic [31:0] bytes, halfwords, others, cells, indexed;
  always_comb begin
    bytes = '0;
    halfwords = '0;
    others = '0;
    cells = '0;
    indexed = '0;
    for (int i = 0; i < 4; i++) begin
      logic [7:0] x, y;
      logic [8:0] sum, difference;
      logic [15:0] product;
      x = a[8*i+:8];
      y = b[8*i+:8];
      sum = 9'(x) + 9'(y);
      difference = 9'(x) - 9'(y);
      product = 16'(x) * 16'(b[7:0]);
      case (funct3)
        0: bytes[8*i+:8] = sum[8] ? 8'hff : sum[7:0];
        1: bytes[8*i+:8] = difference[8] ? 8'h00 : difference[7:0];
        2: bytes[8*i+:8] = lane_least[i];
        3: bytes[8*i+:8] = lesser(beside[8*i+:8], beside[8*i+16+:8]);
        4: bytes[8*i+:8] = i == 3 ? lesser(x, b[7:0]) : x;
        5: bytes[8*i+:8] = least;
        6: bytes[8*i+:8] = sum[8:1];
        default: bytes[8*i+:8] = product[11:4];
      endcase
      cells[8*i+:8] = 8'(difference[8] == 1'b0 && x != y) << funct3;
      if (funct3 == 3'd0) others[8*i+:8] = difference[8] ? y - x : difference[7:0];
      if (funct3 == 3'd1) others[8*i+:8] = difference[8] ? 8'h00 : 8'hff;
    end
    for (int i = 0; i < 2; i++) begin
      logic [15:0] x, y;
      logic is_less;
      x = a[16*i+:16];
      y = b[16*i+:16];
      is_less = $signed(x) < $signed(y);
      case (funct3)
        0: halfwords[16*i+:16] = x < y ? x : y;
        1: halfwords[16*i+:16] = 16'(a[8*i+:8]) + 16'(b[8*i+:8]);
        2: halfwords[16*i+:16] = 16'(a[8*i+16+:8]) + 16'(b[8*i+16+:8]);
        default: ;
      endcase
      indexed[16*i+:16] = ((x + (funct3[0] ? 16'(b[8*i+16+:8]) : 16'(b[8*i+:8]))) << 6) + 16'({funct3, 1'(i)});
      if (funct3 == 3'd2) others[16*i+:16] = is_less ? x : y;
      if (funct3 == 3'd3) others[16*i+:16] = is_less ? y : x;
    end
  end

  // Bytes of a word that go before those of another.
  wire [4:0] shift = {a[25:24], 3'b0};
  wire [63:0] shifted = 64'(b) << shift;
  wire [31:0] joined = (a & ~('1 << shift)) | shifted[31:0];

  logic [31:0] next;
  always_comb begin
    case (id[9:3])
      0: next = bytes;
      1: next = funct3 < 3'd4 ? 32'(ones) << {funct3[1:0], 3'b0} : '0;
      2: next = halfwords;
      3: next = funct3 < 3'd4 && funct3 != 3'd0 ? 32'({b, a} >> {funct3[1:0], 3'b0}) : '0;
      4: next = cells;
      5: next = others;
      6: next = funct3 == 3'd0 ? joined : funct3 == 3'd1 ? {6'b0, a[25:24], shifted[55:32]} : '0;
      7: next = indexed;
      default: next = '0;
    endcase
  end

  assign takes = !has_result || result_taken;
  always_ff @(posedge clk) begin
    if (!rst_n) has_result <= 1'b0;
    else if (takes) has_result <= asks;
    if (takes) result <= next;
  end
endmodule
