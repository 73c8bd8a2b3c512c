// Selects the best disparity of each pixel of both views, from the sums of the path costs. It is the kernel
// `select_row`. The pixels come from right to left, each at least two cycles after the last block of the one before.
//
// The best of the other view's positions lie in a window that moves on by one with each pixel: what leaves it is done.
module unit_selection #(
    parameter int LANES = 16,
    parameter int DISPARITIES = 64
) (
    input  logic                clk, rst_n,
    input  logic                start,
    input  logic [6:0]          disparities, last_block,
    input  logic [7:0]          relief,
    input  logic [9:0]          lines_min,
    input  logic                valid,
    input  logic [5:0]          block,
    input  logic                last,
    input  logic [7:0]          pixel,
    input  logic [10*LANES-1:0] sums,
    output logic                busy,
    // The other view's best: sum << 6 | index, all ones if there is none.
    output logic                other_write,
    output logic [7:0]          other_at,
    output logic [15:0]         other,
    // The pixel's best, its margin, and the step to the minimum.
    output logic                best_write,
    output logic [7:0]          best_at,
    output logic [5:0]          best,
    output logic [14:0]         margin,
    output logic signed [4:0]   step_q4
);
  localparam int BLOCKS = DISPARITIES / LANES;
  localparam int BLOCK_AT = BLOCKS > 1 ? $clog2(BLOCKS) : 1;
  localparam logic [15:0] NONE = '1;

  // The least of a block is found in two cycles: of each four first.
  localparam int FOURS = LANES / 4;
  function automatic logic [15:0] least(input logic [15:0] a, b);
    return a < b ? a : b;
  endfunction
  function automatic logic [15:0] least_of(input logic [15:0] keys[FOURS]);
    logic [15:0] tree[2*FOURS];
    for (int i = 0; i < FOURS; i++) tree[FOURS+i] = keys[i];
    for (int i = FOURS - 1; i > 0; i--) tree[i] = least(tree[2*i], tree[2*i+1]);
    return tree[1];
  endfunction

  // The other view. After the last pixel, what is left in the window moves out.
  logic [15:0] window[DISPARITIES];
  logic [6:0] left;
  logic moved, ends;
  wire moves = valid && block == 0;
  wire [BLOCK_AT-1:0] at = block[BLOCK_AT-1:0];
  logic [15:0] keys[LANES];
  logic is_within[DISPARITIES];
  always_comb begin
    for (int lane = 0; lane < LANES; lane++) begin
      automatic logic [5:0] d = 6'(at) * 6'(LANES) + 6'(lane);
      keys[lane] = is_within[d] ? {sums[10*lane+:10], d} : NONE;
    end
  end
  always_ff @(posedge clk) for (int d = 0; d < DISPARITIES; d++) is_within[d] <= 7'(d) < disparities;
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {left, other_write, moved, ends} <= '0;
    end else begin
      ends <= valid && last && pixel == 0;
      if (start) begin
        moved <= 1'b0;
        other_at <= '1;
      end else if (moves) moved <= 1'b1;
      if (ends) left <= disparities;
      else if (left != 0) left <= left - 1'b1;
      // Before the first pixel, the window holds nothing.
      other_write <= (moves && moved) || left != 0;
      if ((moves && moved) || left != 0) other_at <= other_at + 1'b1;
    end
    other <= window[0];
    for (int d = 0; d < DISPARITIES; d++) begin
      automatic logic [15:0] held = moves || left != 0 ? (d + 1 == DISPARITIES ? NONE : window[d+1]) : window[d];
      if (moves && !moved) held = NONE;
      window[d] <= valid && d / LANES == 32'(at) && keys[d%LANES] < held ? keys[d%LANES] : held;
    end
  end

  // The best of the pixel: of each block, then of those so far.
  logic [9:0] sum[DISPARITIES];
  logic [10*LANES-1:0] sums_0;
  logic [15:0] fours_0[FOURS], least_1, least_2;
  logic valid_0, first_0, last_0, valid_1, first_1, last_1, chosen;
  logic [BLOCK_AT-1:0] at_0;
  logic [7:0] pixel_0, pixel_1, pixel_2;
  // The second best, which is no neighbour of the best: block by block as well.
  logic [15:0] picked, taken;
  logic [7:0] picked_pixel, taken_pixel;
  logic [9:0] picked_before, picked_after, sum_before, sum_after;
  logic picked_both, has_both, scans, done;
  logic scanned_0, scan_first_0, scan_ends_0, scanned_1, scan_first_1, scan_ends_1;
  logic [BLOCK_AT-1:0] scan;
  wire is_last_scan = 7'(scan) == last_block;
  logic [15:0] others_0[FOURS];
  logic [9:0] second_1, second;
  logic [15:0] others[LANES];
  wire [5:0] picked_index = picked[5:0];
  always_comb begin
    for (int lane = 0; lane < LANES; lane++) begin
      automatic logic [6:0] d = 7'(scan) * 7'(LANES) + 7'(lane);
      automatic logic is_near = d + 7'd1 >= 7'(picked_index) && d <= 7'(picked_index) + 7'd1;
      others[lane] = is_near || !is_within[6'(d)] ? NONE : {sum[6'(d)], 6'd0};
    end
  end
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {valid_0, valid_1, chosen, scans, scanned_0, scanned_1, done} <= '0;
    end else begin
      {valid_0, valid_1} <= {valid, valid_0};
      chosen <= valid_1 && last_1;
      if (chosen) scans <= 1'b1;
      else if (is_last_scan) scans <= 1'b0;
      {scanned_0, scanned_1} <= {scans, scanned_0};
      done <= scanned_1 && scan_ends_1;
    end
    {sums_0, at_0} <= {sums, at};
    if (valid_0)
      for (int lane = 0; lane < LANES; lane++) sum[32'(at_0)*LANES+lane] <= sums_0[10*lane+:10];
    for (int i = 0; i < FOURS; i++) begin
      fours_0[i] <= least(least(keys[4*i], keys[4*i+1]), least(keys[4*i+2], keys[4*i+3]));
      others_0[i] <= least(least(others[4*i], others[4*i+1]), least(others[4*i+2], others[4*i+3]));
    end
    least_1 <= least_of(fours_0);
    {first_0, last_0, pixel_0} <= {block == 0, last, pixel};
    {first_1, last_1, pixel_1} <= {first_0, last_0, pixel_0};
    if (valid_1) begin
      if (first_1 || least_1 < least_2) least_2 <= least_1;
      pixel_2 <= pixel_1;
    end
    if (chosen) begin
      picked <= least_2;
      picked_pixel <= pixel_2;
      picked_before <= sum[least_2[5:0]-1'b1];
      picked_after <= sum[least_2[5:0]+1'b1];
      picked_both <= least_2[5:0] != 0 && 7'(least_2[5:0]) + 7'd1 < disparities;
      scan <= '0;
    end else scan <= scan + 1'b1;
    // The next pixel is picked before this one's second is known.
    if (scans && is_last_scan) begin
      {taken, taken_pixel, has_both} <= {picked, picked_pixel, picked_both};
      {sum_before, sum_after} <= {picked_before, picked_after};
    end
    second_1 <= 10'(least_of(others_0) >> 6);
    {scan_first_0, scan_first_1} <= {scan == 0, scan_first_0};
    {scan_ends_0, scan_ends_1} <= {is_last_scan, scan_ends_0};
    if (scanned_1) second <= scan_first_1 || second_1 < second ? second_1 : second;
  end

  // The sub-pixel step.
  logic [5:0] made;
  logic [7:0] pixel_s[6];
  logic [5:0] index_s[6];
  logic [14:0] margin_s[6];
  logic has_s[6], is_negative[6];
  logic [9:0] rise_before, rise_after, larger, smaller, larger_relieved, smaller_relieved;
  logic is_weak;
  logic [10:0] divisor;
  logic [9:0] difference;
  // Whether the step is at least half of an odd number of sixteenths; 1, 3, and so on.
  logic [7:0] passed;
  wire [3:0] steps = 4'($countones(passed));
  function automatic logic [9:0] relief_of(input logic [9:0] larger, input logic [7:0] relief);
    logic [12:0] five;
    five = 13'(larger) * 13'd5;
    return five[12:4] < 9'(relief) ? 10'(five[12:4]) : 10'(relief);
  endfunction
  wire [9:0] relief_now = relief_of(larger, relief);
  always_ff @(posedge clk) begin
    made <= rst_n ? {made[4:0], done} : '0;
    for (int i = 1; i < 6; i++) begin
      pixel_s[i] <= pixel_s[i-1];
      index_s[i] <= index_s[i-1];
      margin_s[i] <= margin_s[i-1];
      has_s[i] <= has_s[i-1];
    end
    pixel_s[0] <= taken_pixel;
    index_s[0] <= taken[5:0];
    margin_s[0] <= (second == '1 ? 15'h7fff : 15'(second)) - 15'(taken[15:6]);
    has_s[0] <= has_both;
    rise_before <= sum_before - taken[15:6];
    rise_after <= sum_after - taken[15:6];
    is_negative[1] <= rise_before < rise_after;
    larger <= rise_before < rise_after ? rise_after : rise_before;
    smaller <= rise_before < rise_after ? rise_before : rise_after;
    is_negative[2] <= is_negative[1];
    larger_relieved <= larger - relief_now;
    smaller_relieved <= smaller > relief_now ? smaller - relief_now : '0;
    is_weak <= larger < lines_min;
    is_negative[3] <= is_negative[2];
    divisor <= 11'(larger_relieved) + (is_weak ? 11'(smaller_relieved) : '0);
    difference <= larger_relieved - smaller_relieved;
    for (int i = 0; i < 8; i++)
      passed[i] <= 16'(difference) * 16'd16 >= 16'(divisor) * 16'(2 * i + 1) && divisor != 0;
    is_negative[4] <= is_negative[3];
    best_write <= made[4];
    best_at <= pixel_s[4];
    best <= index_s[4];
    margin <= margin_s[4];
    step_q4 <= !has_s[4] ? '0 : is_negative[4] ? -5'(steps) : 5'(steps);
  end
  assign busy = valid || ends || left != 0 || other_write || valid_0 || valid_1 || chosen || scans || scanned_0
      || scanned_1 || done || made != '0 || best_write;
endmodule
