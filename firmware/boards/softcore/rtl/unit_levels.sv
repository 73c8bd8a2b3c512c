// Makes of levels, one after another, penalties of the steps between two rows, or the lowest and the highest level that
// equal one of the other camera: the kernels `penalty_row` and `convert_row`. A result comes four cycles after its
// levels.
module unit_levels (
    input  logic               clk,
    input  logic               is_convert, is_high,
    // Penalties.
    input  logic [7:0]         p2, p2_floor, adaptation_q4, step_min,
    // Conversion.
    input  logic [14:0]        gain_q12,
    input  logic signed [22:0] offset_q12,
    input  logic [7:0]         dead_zone,
    input  logic [7:0]         level, neighbour,
    output logic [7:0]         result
);
  wire [7:0] step = level > neighbour ? level - neighbour : neighbour - level;
  logic [7:0] factor_1;
  logic [2:0] is_lowest, is_highest;
  logic [22:0] product_2;
  logic signed [25:0] penalty, exact_q12;
  wire signed [13:0] rounded = exact_q12[25:12];
  wire [7:0] converted = rounded < 0 ? '0 : rounded > 255 ? '1 : rounded[7:0];
  wire [8:0] over = converted + dead_zone;

  always_ff @(posedge clk) begin
    if (is_convert) factor_1 <= level;
    else factor_1 <= step > step_min ? step - step_min : '0;
    is_lowest <= {is_lowest[1:0], level == '0};
    is_highest <= {is_highest[1:0], level == '1};
    product_2 <= (is_convert ? gain_q12 : 15'(adaptation_q4)) * factor_1;
    penalty <= $signed({18'b0, p2}) - $signed({7'b0, product_2[22:4]});
    exact_q12 <= $signed({3'b0, product_2}) + offset_q12 + 26'sd2048;
    // A level at either end of the range may have been clipped.
    if (!is_convert) result <= penalty < $signed({18'b0, p2_floor}) ? p2_floor : penalty[7:0];
    else if (is_high) result <= over[8] || is_highest[2] ? '1 : over[7:0];
    else result <= converted < dead_zone || is_lowest[2] ? '0 : converted - dead_zone;
  end
endmodule
