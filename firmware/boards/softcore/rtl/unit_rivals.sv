// Finds rivals in a row of costs: blocks of four pixels in whose window two low sums of costs have a high one between
// them. It is the kernel `rivals_row`.
module unit_rivals #(
    parameter int LANES = 16,
    parameter int DISPARITIES = 64,
    parameter int WORD_AT = 9
) (
    input  logic               clk, rst_n,
    input  logic               start,
    input  logic [7:0]         pixels,
    input  logic [6:0]         disparities, last_block,
    input  logic [7:0]         ratio_q4, slack, rise,
    input  logic [6:0]         reach,
    output logic               busy,
    // Costs, a cycle later.
    output logic [WORD_AT-1:0] costs_at,
    input  logic [8*LANES-1:0] costs,
    // A bit for each block.
    output logic [63:0]        rivals
);
  localparam int BLOCKS = DISPARITIES / LANES;
  localparam int BLOCK_AT = BLOCKS > 1 ? $clog2(BLOCKS) : 1;
  // Disparities beyond a multiple of four are left out.
  wire [6:0] used = {disparities[6:2], 2'b0};
  // They stay as they are during a run.
  logic [WORD_AT-1:0] blocks;
  logic is_within[DISPARITIES];
  always_ff @(posedge clk) begin
    blocks <= WORD_AT'(last_block + 1'b1);
    for (int d = 0; d < DISPARITIES; d++) is_within[d] <= 7'(d) < used;
  end
  typedef enum logic [2:0] {IDLE, ENTER, LEAVE, LEAST, BOUND, WALL, LOOK, NEXT} state_t;
  state_t state;

  logic [5:0] group;             // of four pixels
  logic [7:0] entered, gone;     // the pixels from the one on, up to the other, are in the sums
  logic [BLOCK_AT-1:0] block, block_come;
  logic comes, leaves;
  logic [14:0] sum[DISPARITIES];
  // The window, of every other pixel.
  wire [8:0] centre = {1'b0, group, 2'd2};
  wire [8:0] start_exact = centre > 9'(reach) ? centre - 9'(reach) : '0;
  wire [8:0] end_far = centre + 9'(reach) + 1'b1;
  wire [8:0] end_exact = end_far < 9'(pixels) ? end_far : 9'(pixels);
  wire [8:0] start_inside = start_exact < end_exact ? start_exact : end_exact;
  logic [7:0] window_start, window_end;
  wire [7:0] samples = (window_end - window_start) >> 1;
  wire [7:0] column = state == LEAVE ? gone : entered;
  assign costs_at = WORD_AT'(column) * blocks + WORD_AT'(block);

  logic begins;                  // the least of a group
  logic [14:0] least, least_1;
  logic [22:0] product;
  logic [19:0] bound, wall;
  logic looked_1, has_low, has_wall, found;
  logic [LANES-1:0] lows, walls;
  wire is_last = 7'(block) == last_block;

  function automatic logic [14:0] least_of(input logic [14:0] values[LANES]);
    logic [14:0] tree[2*LANES];
    for (int i = 0; i < LANES; i++) tree[LANES+i] = values[i];
    for (int i = LANES - 1; i > 0; i--) tree[i] = tree[2*i] < tree[2*i+1] ? tree[2*i] : tree[2*i+1];
    return tree[1];
  endfunction
  logic [14:0] values[LANES], values_1[LANES];
  logic [LANES-1:0] is_used;
  always_comb begin
    for (int lane = 0; lane < LANES; lane++) begin
      automatic logic [5:0] d = 6'(block) * 6'(LANES) + 6'(lane);
      is_used[lane] = is_within[d];
      values[lane] = is_used[lane] ? sum[d] : '1;
    end
  end
  // Low, high, low, in this order.
  logic [LANES-1:0] walls_behind, lows_behind;
  always_comb begin
    for (int lane = 0; lane < LANES; lane++) begin
      automatic logic [LANES-1:0] before_lane = LANES'((1 << lane) - 1);
      walls_behind[lane] = walls[lane] && (has_low || (lows & before_lane) != '0);
      lows_behind[lane] = lows[lane] && (has_wall || (walls_behind & before_lane) != '0);
    end
  end

  logic [1:0] waits;
  assign busy = state != IDLE;
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      state <= IDLE;
      {comes, looked_1} <= '0;
    end else begin
      comes <= 1'b0;
      looked_1 <= 1'b0;
      case (state)
        IDLE: if (start) begin
          state <= NEXT;
          {group, entered, gone} <= '0;
          rivals <= '0;
          waits <= '0;
        end
        // The columns that the window has and the sums have not, and those that it has no more.
        ENTER, LEAVE: begin
          if (column < (state == ENTER ? window_end : window_start)) begin
            comes <= 1'b1;
            block <= is_last ? '0 : block + 1'b1;
            if (is_last) begin
              if (state == ENTER) entered <= entered + 8'd2;
              else gone <= gone + 8'd2;
            end
          end else if (state == ENTER) state <= LEAVE;
          else begin
            waits <= waits + 1'b1;
            if (waits == 2'd1) begin
              state <= LEAST;
              waits <= '0;
            end
          end
        end
        LEAST: begin
          block <= is_last ? '0 : block + 1'b1;
          if (is_last) state <= BOUND;
        end
        BOUND: begin
          // The values of the last block come, and their least joins; then the product is made, and the bound.
          waits <= waits + 1'b1;
          if (waits == 2'd3) begin
            state <= WALL;
            waits <= '0;
          end
        end
        WALL: state <= LOOK;
        LOOK: begin
          looked_1 <= 1'b1;
          block <= is_last ? '0 : block + 1'b1;
          if (is_last) begin
            state <= NEXT;
            waits <= '0;
          end
        end
        NEXT: begin
          // What was looked at last is known in the third cycle.
          waits <= waits + 1'b1;
          window_start <= {start_inside[7:1] + 7'(start_inside[0]), 1'b0};
          window_end <= {end_exact[7:1] + 7'(end_exact[0]), 1'b0};
          block <= '0;
          if (waits == 2'd2) begin
            waits <= '0;
            if ({group, 2'b0} >= pixels) state <= IDLE;
            else state <= ENTER;
          end
        end
      endcase
      if (state == NEXT && waits == 2'd2) begin
        if (group != 0) rivals[group-1'b1] <= found;
        if ({group, 2'b0} < pixels) group <= group + 1'b1;
      end
    end
    {block_come, leaves} <= {block, state == LEAVE};
    if (state == IDLE) for (int d = 0; d < DISPARITIES; d++) sum[d] <= '0;
    else if (comes)
      for (int lane = 0; lane < LANES; lane++) begin
        automatic int d = 32'(block_come) * LANES + lane;
        sum[d] <= leaves ? sum[d] - 15'(costs[8*lane+:8]) : sum[d] + 15'(costs[8*lane+:8]);
      end
    begins <= state == LEAST && block == 0;
    values_1 <= values;
    least_1 <= least_of(values_1);
    if (begins) least <= '1;
    else if (least_1 < least) least <= least_1;
    product <= 23'(least) * 23'(ratio_q4);
    bound <= 20'(product >> 4) + 20'(slack);
    if (state == WALL) wall <= bound + 20'(rise) * 20'(samples);
    for (int lane = 0; lane < LANES; lane++) begin
      lows[lane] <= is_used[lane] && 20'(values[lane]) < bound;
      walls[lane] <= is_used[lane] && 20'(values[lane]) >= wall;
    end
    if (state == WALL) {has_low, has_wall, found} <= '0;
    else if (looked_1) begin
      has_low <= has_low || lows != '0;
      has_wall <= has_wall || walls_behind != '0;
      found <= found || lows_behind != '0;
    end
  end
endmodule
