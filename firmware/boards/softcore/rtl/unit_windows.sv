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

  // Three numbers, and of each two whether the first is less. Which of them is the least, the middle one or the greatest
  // is for the next cycle.
  typedef struct packed {
    logic signed [15:0] a, b, c;
    logic a_b, a_c, b_c;
  } compared_t;

  function automatic compared_t compare(input logic signed [15:0] a, b, c);
    return '{a, b, c, a < b, a < c, b < c};
  endfunction

  function automatic logic [15:0] least(input compared_t of);
    return of.a_b ? (of.a_c ? of.a : of.c) : of.b_c ? of.b : of.c;
  endfunction

  function automatic logic [15:0] middle_one(input compared_t of);
    if (of.a_b) return of.b_c ? of.b : of.a_c ? of.c : of.a;
    return of.a_c ? of.a : of.b_c ? of.c : of.b;
  endfunction

  function automatic logic [15:0] greatest(input compared_t of);
    return of.a_b ? (of.b_c ? of.c : of.b) : of.a_c ? of.c : of.a;
  endfunction

  // What is under way: a column in the window, and the pixels of the later stages.
  logic is_median, is_levels, comes, whole;
  logic [4:0] made;
  logic [1:0] came;
  logic [15:0] window[3][3];
  wire [7:0] last_column = is_levels ? pixels - 1'b1 : pixels + 1'b1;
  assign level = window[0][2][7:0];
  assign neighbour = window[1][2][7:0];
  // Smoothing.
  logic [7:0] own_1, own_2, near_1[8], half_2[4];
  wire [7:0] edges = midpoint(half_2[2], half_2[3]);
  wire [7:0] corners = midpoint(half_2[0], half_2[1]);
  logic [7:0] smoothed;
  // The median of the sorted columns: of the greatest least, the middle one of the middle ones, and the least greatest.
  compared_t newest, lows, centres, highs, last;
  logic [15:0] low[3], centre[3], high[3], highest_low, middle_centre, lowest_high;

  // Bytes of the results.
  logic [8:0] at;
  logic [7:0] left;
  wire writes_now = is_median ? made[4] : is_levels ? made[3] : made[2];
  wire [1:0] lane = at[1:0];
  wire ends = left == 8'd1;
  assign busy = comes || made != 0 || write || left != 0;

  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {comes, came, whole, made, write, left} <= '0;
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
      made <= {made[3:0], whole};
      came <= {came[0], comes};
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

    newest <= compare(window[0][2], window[1][2], window[2][2]);
    if (came[1]) begin
      low <= '{low[1], low[2], least(newest)};
      centre <= '{centre[1], centre[2], middle_one(newest)};
      high <= '{high[1], high[2], greatest(newest)};
    end
    lows <= compare(low[0], low[1], low[2]);
    centres <= compare(centre[0], centre[1], centre[2]);
    highs <= compare(high[0], high[1], high[2]);
    highest_low <= greatest(lows);
    middle_centre <= middle_one(centres);
    lowest_high <= least(highs);
    last <= compare(highest_low, middle_centre, lowest_high);

    if (writes_now) begin
      if (is_median) word[8*{lane[1], 1'b0}+:16] <= middle_one(last);
      else word[8*lane+:8] <= is_levels ? level_result : smoothed;
      write_at <= at[8:2];
    end
  end
endmodule
