// Filters a row by the 3 x 3 pixels around each: smooths levels, or takes the median of disparities. It is the kernels
// `smooth_row` and `median9_row`. A column of three comes with each cycle; of the results, words are made. So are words
// of what `unit_levels` makes of a column.
module unit_windows (
    input  logic        clk, rst_n,
    input  logic        start, start_median, start_levels,
    input  logic [7:0]  pixels,
    input  logic [7:0]  step_max,  // largest step that is smoothed
    input  logic [1:0]  place,     // of the first byte in the first word
    output logic        busy,
    // A column: levels in the low bytes, or disparities.
    output logic [7:0]  column,
    input  logic [15:0] top, middle, bottom,
    // Levels of a column, and what is made of them four cycles later.
    output logic [7:0]  level, neighbour,
    input  logic [7:0]  level_result,
    // A word of the results.
    output logic        write,
    output logic [6:0]  write_at,
    output logic [31:0] word
);
  function automatic logic [7:0] near(input logic [7:0] level, own, most);
    logic [7:0] step;
    step = level > own ? level - own : own - level;
    return step <= most ? level : own;
  endfunction

  function automatic logic [7:0] midpoint(input logic [7:0] a, b);
    return 8'((9'(a) + 9'(b)) >> 1);
  endfunction

  function automatic logic signed [15:0] lesser(input logic signed [15:0] a, b);
    return a < b ? a : b;
  endfunction

  function automatic logic signed [15:0] greater(input logic signed [15:0] a, b);
    return a < b ? b : a;
  endfunction

  function automatic logic signed [15:0] median(input logic signed [15:0] a, b, c);
    return greater(lesser(a, b), lesser(greater(a, b), c));
  endfunction

  // What is under way: a column in the window, and the pixels of the later stages.
  logic is_median, is_levels, comes, whole;
  logic [3:0] made;
  logic [15:0] window[3][3];
  wire [7:0] last_column = is_levels ? pixels - 1'b1 : pixels + 1'b1;
  assign level = window[0][2][7:0];
  assign neighbour = window[1][2][7:0];
  // Smoothing.
  logic [7:0] own_1, own_2, near_1[8], half_2[4];
  wire [7:0] edges = midpoint(half_2[2], half_2[3]);
  wire [7:0] corners = midpoint(half_2[0], half_2[1]);
  logic [7:0] smoothed;
  // The median of the sorted columns.
  logic [15:0] low[3], centre[3], high[3];
  logic [15:0] lows_2, centres_2, highs_2, median_3;

  // Bytes of the results.
  logic [8:0] at;
  logic [7:0] left;
  wire writes_now = is_levels ? made[3] : made[2];
  wire [1:0] lane = at[1:0];
  wire ends = left == 8'd1;
  assign busy = comes || made != 0 || write || left != 0;

  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {comes, whole, made, write, left} <= '0;
    end else begin
      if (start) begin
        comes <= 1'b1;
        column <= '0;
        is_median <= start_median;
        is_levels <= start_levels;
        at <= 9'(place);
        left <= pixels;
      end else if (column == last_column) comes <= 1'b0;
      if (comes) column <= column + 1'b1;
      whole <= comes && (is_levels || column >= 8'd2);
      made <= {made[2:0], whole};
      write <= writes_now && (ends || (is_median ? lane[1] : lane == 2'd3));
      if (writes_now) begin
        at <= at + (is_median ? 9'd2 : 9'd1);
        left <= left - 1'b1;
      end
    end
    if (comes) begin
      window[0] <= '{window[0][1], window[0][2], top};
      window[1] <= '{window[1][1], window[1][2], middle};
      window[2] <= '{window[2][1], window[2][2], bottom};
    end
    // Corners first, then edges.
    near_1[0] <= near(window[0][0][7:0], window[1][1][7:0], step_max);
    near_1[1] <= near(window[2][0][7:0], window[1][1][7:0], step_max);
    near_1[2] <= near(window[0][2][7:0], window[1][1][7:0], step_max);
    near_1[3] <= near(window[2][2][7:0], window[1][1][7:0], step_max);
    near_1[4] <= near(window[1][0][7:0], window[1][1][7:0], step_max);
    near_1[5] <= near(window[1][2][7:0], window[1][1][7:0], step_max);
    near_1[6] <= near(window[0][1][7:0], window[1][1][7:0], step_max);
    near_1[7] <= near(window[2][1][7:0], window[1][1][7:0], step_max);
    own_1 <= window[1][1][7:0];
    for (int i = 0; i < 4; i++) half_2[i] <= midpoint(near_1[2*i], near_1[2*i+1]);
    own_2 <= own_1;
    smoothed <= midpoint(edges, midpoint(own_2, corners));

    for (int i = 0; i < 3; i++) begin
      low[i] <= lesser(lesser(window[0][i], window[1][i]), window[2][i]);
      centre[i] <= median(window[0][i], window[1][i], window[2][i]);
      high[i] <= greater(greater(window[0][i], window[1][i]), window[2][i]);
    end
    lows_2 <= greater(greater(low[0], low[1]), low[2]);
    centres_2 <= median(centre[0], centre[1], centre[2]);
    highs_2 <= lesser(lesser(high[0], high[1]), high[2]);
    median_3 <= median(lows_2, centres_2, highs_2);

    if (writes_now) begin
      if (is_median) word[8*{lane[1], 1'b0}+:16] <= median_3;
      else word[8*lane+:8] <= is_levels ? level_result : smoothed;
      write_at <= at[8:2];
    end
  end
endmodule
