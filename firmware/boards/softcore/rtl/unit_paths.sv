// Path costs of a row, and their sums. First the pixels from left to right: the paths from the left and from above;
// then back: the path from the right, and with it the sum of all three. It is the kernel `aggregate_paths`.
//
// A pixel takes a cycle for each LANES disparities and two more: while it makes its step, in three stages of a cycle
// each, what the next one needs is read.
module unit_paths #(
    parameter int LANES = 16,
    parameter int DISPARITIES = 64,
    parameter int WORD_AT = 9
) (
    input  logic                clk, rst_n,
    input  logic                start,
    input  logic                is_first,     // no row is above
    input  logic [7:0]          pixels,
    input  logic [6:0]          last_block,
    input  logic [7:0]          p1,
    // Blocks of four pixels whose costs are shifted.
    input  logic [63:0]         doubts,
    input  logic [2:0]          shift,
    output logic                busy,
    // P2 of a pixel.
    output logic [7:0]          along_pixel, down_pixel,
    input  logic [7:0]          p2_along, p2_down,
    // Costs, a cycle later.
    output logic [WORD_AT-1:0]  costs_at,
    input  logic [8*LANES-1:0]  costs,
    // Sums of a pixel, block by block, the pixels from right to left.
    output logic                valid,
    output logic [5:0]          sums_block,
    output logic                sums_last,    // block of the pixel
    output logic [7:0]          sums_pixel,
    output logic [10*LANES-1:0] sums
);
  localparam int BLOCKS = DISPARITIES / LANES;
  localparam int BLOCK_AT = BLOCKS > 1 ? $clog2(BLOCKS) : 1;
  // They stay as they are during a row.
  logic [6:0] blocks, last_phase;
  always_ff @(posedge clk) begin
    blocks <= last_block + 1'b1;
    last_phase <= last_block + 7'd2;
  end

  logic back;                    // from right to left
  logic [7:0] place;             // pixels that were read, in the order of the pass
  logic [6:0] phase;
  wire ends_phase = phase == last_phase;
  wire reads = place != pixels;
  wire steps = place != 0;
  wire [7:0] read_pixel = back ? pixels - 1'b1 - place : place;
  wire [7:0] step_pixel = back ? pixels - place : place - 1'b1;

  // Blocks that come, are in the first stage, and in the second and third.
  logic comes, in_doubt, is_made_2, is_made_3;
  logic [BLOCK_AT-1:0] block_come, block_2, block_3;
  wire [BLOCK_AT-1:0] block = phase[BLOCK_AT-1:0];
  wire is_made = steps && busy && phase < blocks;

  logic [7:0] cost_next[DISPARITIES], cost[DISPARITIES];
  logic [7:0] above_next[DISPARITIES], above[DISPARITIES];
  logic [8:0] part_next[DISPARITIES], part[DISPARITIES];
  logic [7:0] path[DISPARITIES];
  logic [7:0] p2_path, p2_above;
  // Of four path costs each, in all blocks of a pixel, the least; the least of all is made when the next begins.
  localparam int FOURS = LANES / 4;
  logic [7:0] leasts_path[FOURS], leasts_above[FOURS], least_path_now, least_above_now;
  logic [7:0] onward_path[LANES], onward_above[LANES];
  logic [7:0] new_path[LANES], new_above[LANES];
  logic [WORD_AT-1:0] read_word, step_word;

  (* ram_style = "distributed" *) logic [7:0] least_above_of[256];
  logic [8*LANES-1:0] above_read, above_write;
  logic [9*LANES-1:0] part_read, part_write;
  wire keeps = is_made_3 && !back;
  block_memory #(.WORDS(2 ** WORD_AT), .BITS(8 * LANES)) above_row (
      .clk, .write(keeps), .write_at(step_word), .write_data(above_write), .read_at(read_word),
      .data(above_read));
  block_memory #(.WORDS(2 ** WORD_AT), .BITS(9 * LANES)) part_row (
      .clk, .write(keeps), .write_at(step_word), .write_data(part_write), .read_at(read_word),
      .data(part_read));

  function automatic logic [7:0] least(input logic [7:0] a, b);
    return a < b ? a : b;
  endfunction

  // The cheapest way from the pixel before, with its least cost still in it and without a larger step.
  function automatic logic [7:0] onward(input logic [7:0] below, same, over, p1);
    logic [8:0] step;
    step = 9'(least(below, over)) + 9'(p1);
    return step[8] ? same : least(same, step[7:0]);
  endfunction

  function automatic logic [7:0] step(input logic [7:0] onward, least_before, p2, cost);
    logic [8:0] sum;
    sum = 9'(cost) + 9'(least(onward - least_before, p2));
    return sum[8] ? 8'hff : sum[7:0];
  endfunction

  // What is beyond the disparities has the highest cost, and keeps it.
  function automatic logic [7:0] attenuated(input logic [7:0] cost);
    return cost == 8'hff ? cost : cost >> shift;
  endfunction

  function automatic logic [7:0] least_of(input logic [7:0] values[FOURS]);
    logic [7:0] tree[2*FOURS];
    for (int i = 0; i < FOURS; i++) tree[FOURS+i] = values[i];
    for (int i = FOURS - 1; i > 0; i--) tree[i] = least(tree[2*i], tree[2*i+1]);
    return tree[1];
  endfunction

  // The least of four path costs, and of those of the blocks before.
  function automatic logic [7:0] joined(input logic [7:0] so_far, a, b, c, d, input logic is_first_block);
    logic [7:0] four;
    four = least(least(a, b), least(c, d));
    return is_first_block ? four : least(so_far, four);
  endfunction

  assign costs_at = read_word;
  assign down_pixel = read_pixel;
  assign along_pixel = back ? read_pixel + 1'b1 : read_pixel;

  always_comb begin
    for (int lane = 0; lane < LANES; lane++) begin
      above_write[8*lane+:8] = new_above[lane];
      part_write[9*lane+:9] = 9'(new_path[lane]) + 9'(new_above[lane]);
    end
  end

  always_ff @(posedge clk) begin
    if (!rst_n) begin
      {busy, comes, is_made_2, is_made_3, valid} <= '0;
    end else begin
      if (!busy) begin
        if (start) begin
          busy <= 1'b1;
          back <= 1'b0;
          place <= '0;
          phase <= '0;
          read_word <= '0;
          step_word <= '0;
        end
      end else begin
        phase <= ends_phase ? '0 : phase + 1'b1;
        if (ends_phase) begin
          place <= place + 1'b1;
          if (!reads) begin
            place <= '0;
            back <= 1'b1;
            busy <= !back;
          end
        end
        // The words of a pixel lie in the order of the disparities in both passes.
        if (phase < blocks) read_word <= read_word + 1'b1;
        else if (ends_phase && back) read_word <= read_word - WORD_AT'({blocks, 1'b0});
        if (ends_phase && !reads && !back) read_word <= read_word - WORD_AT'({blocks, 1'b0});
        if (is_made_3) step_word <= step_word + 1'b1;
      end
      comes <= busy && phase < blocks;
      is_made_2 <= is_made;
      is_made_3 <= is_made_2;
      valid <= is_made_3 && back;
    end
    {block_come, block_2, block_3} <= {block, block, block_2};
    in_doubt <= doubts[read_pixel[7:2]];
    if (comes) begin
      for (int lane = 0; lane < LANES; lane++) begin
        cost_next[block_come*LANES+lane] <= in_doubt ? attenuated(costs[8*lane+:8]) : costs[8*lane+:8];
        above_next[block_come*LANES+lane] <= above_read[8*lane+:8];
        part_next[block_come*LANES+lane] <= part_read[9*lane+:9];
      end
    end
    if (busy && ends_phase) begin
      cost <= cost_next;
      above <= above_next;
      part <= part_next;
      p2_path <= p2_along;
      p2_above <= p2_down;
      least_above_now <= least_above_of[read_pixel];
    end
    if (phase == 0) begin
      least_path_now <= least_of(leasts_path);
      // What was made last is that of the pixel before.
      if (busy && !back && place > 8'd1) least_above_of[step_pixel-1'b1] <= least_of(leasts_above);
      if (busy && back && place == 0) least_above_of[pixels-1'b1] <= least_of(leasts_above);
    end
    // First stage: the way from the neighbours.
    for (int lane = 0; lane < LANES; lane++) begin
      automatic int d = 32'(block) * LANES + lane;
      automatic logic is_lowest = lane == 0 && block == 0;
      automatic logic is_highest = lane == LANES - 1 && phase == last_block;
      onward_path[lane] <= onward(is_lowest ? 8'hff : path[d-1], path[d], is_highest ? 8'hff : path[d+1], p1);
      onward_above[lane] <= onward(is_lowest ? 8'hff : above[d-1], above[d], is_highest ? 8'hff : above[d+1], p1);
    end
    // Second: the path costs. A path begins with the costs of its first pixel.
    if (is_made_2) begin
      for (int lane = 0; lane < LANES; lane++) begin
        automatic int d = 32'(block_2) * LANES + lane;
        automatic logic [7:0] along = place == 8'd1 ? cost[d]
            : step(onward_path[lane], least_path_now, p2_path, cost[d]);
        path[d] <= along;
        new_path[lane] <= along;
        new_above[lane] <= is_first ? cost[d]
            : step(onward_above[lane], least_above_now, p2_above, cost[d]);
      end
    end
    // Third: their least, and the sums.
    if (is_made_3) begin
      for (int i = 0; i < FOURS; i++) begin
        leasts_path[i] <= joined(leasts_path[i], new_path[4*i], new_path[4*i+1], new_path[4*i+2], new_path[4*i+3],
            block_3 == 0);
        leasts_above[i] <= joined(leasts_above[i], new_above[4*i], new_above[4*i+1], new_above[4*i+2],
            new_above[4*i+3], block_3 == 0);
      end
      for (int lane = 0; lane < LANES; lane++)
        sums[10*lane+:10] <= 10'(part[block_3*LANES+lane]) + 10'(new_path[lane]);
      sums_block <= 6'(block_3);
      sums_last <= 7'(block_3) == last_block;
      sums_pixel <= step_pixel;
    end
  end
endmodule
