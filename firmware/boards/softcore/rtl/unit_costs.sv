// Matching costs of a run of pixels: the cells in which the patterns differ, times the cost of one, and the difference
// of the levels, each truncated. It is the kernel `cost_run`, for patterns of 32 cells, one channel and no masks.
//
// The stored patterns and levels lie in a window that moves by one with each pixel: its element `d` is that of
// disparity `d`. Of a pixel, LANES costs are made in a cycle.
module unit_costs #(
    parameter int LANES = 16,
    parameter int DISPARITIES = 64,
    parameter int WORD_AT = 9
) (
    input  logic               clk, rst_n,
    input  logic               start,
    input  logic [7:0]         pixels,
    input  logic [6:0]         disparities, last_block,
    input  logic [WORD_AT-1:0] first,                  // word of the first pixel's costs
    input  logic [7:0]         difference_truncation,
    input  logic [7:0]         difference_weight_q4,
    output logic               busy,
    // What is known of a pixel, and of a position of the other view.
    output logic [7:0]         pixel,
    input  logic [31:0]        pattern,
    input  logic [7:0]         level, truncation,
    input  logic [15:0]        cell_cost_q8,
    output logic [7:0]         position,
    input  logic [31:0]        stored,
    input  logic [7:0]         low, high,
    // Costs of a pixel, those beyond the range being the highest.
    output logic               write,
    output logic [WORD_AT-1:0] write_at,
    output logic [8*LANES-1:0] costs
);
  localparam int BLOCKS = DISPARITIES / LANES;
  localparam int BLOCK_AT = BLOCKS > 1 ? $clog2(BLOCKS) : 1;
  typedef enum logic [1:0] {IDLE, MOVE, BLOCK, DRAIN} state_t;
  state_t state;

  logic [47:0] window[DISPARITIES];
  logic is_within[DISPARITIES];
  logic [6:0] missing;
  logic [BLOCK_AT-1:0] block;
  logic [31:0] own;
  logic [7:0] own_level, own_truncation;
  logic [15:0] own_cell_q8;
  // What is under way: what is compared, then what differs, then products.
  logic made_0, made_1, made_2;
  logic [BLOCK_AT-1:0] block_0, block_1, block_2;
  logic [31:0] differing_0[LANES];
  logic [15:0] levels_0[LANES];
  logic [7:0] level_0, truncation_0;
  logic [15:0] cell_q8_0;
  logic [5:0] cells_1[LANES];
  logic [7:0] difference_1[LANES];
  logic [7:0] truncation_1, truncation_2;
  logic [15:0] cell_q8_1;
  logic [15:0] product_2[LANES], weighted_2[LANES];

  function automatic logic [5:0] ones(input logic [31:0] bits);
    ones = '0;
    for (int i = 0; i < 32; i++) ones += 6'(bits[i]);
  endfunction

  function automatic logic [7:0] difference(input logic [7:0] level, low, high, most);
    logic [7:0] outside;
    outside = level > high ? level - high : low > level ? low - level : 8'd0;
    return outside < most ? outside : most;
  endfunction

  function automatic logic [7:0] cost(input logic [15:0] product, weighted, input logic [7:0] most);
    logic [15:0] rounded;
    logic [7:0] patterns;
    logic [8:0] sum;
    rounded = product + 16'd128;
    patterns = rounded[15:8] < most ? rounded[15:8] : most;
    sum = 9'(patterns) + 9'(weighted[11:4]);
    return sum[8] ? 8'hff : sum[7:0];
  endfunction

  assign busy = state != IDLE;
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      state <= IDLE;
      {made_0, made_1, made_2, write} <= '0;
    end else begin
      case (state)
        IDLE: if (start) begin
          state <= MOVE;
          missing <= disparities - 1'b1;
          pixel <= '0;
          position <= pixels + 8'(disparities) - 8'd2;
          write_at <= first - 1'b1;
        end
        MOVE: begin
          for (int d = DISPARITIES - 1; d > 0; d--) window[d] <= window[d-1];
          window[0] <= {high, low, stored};
          position <= position - 1'b1;
          own <= pattern;
          own_level <= level;
          own_truncation <= truncation;
          own_cell_q8 <= cell_cost_q8;
          block <= '0;
          if (missing != 0) missing <= missing - 1'b1;
          else state <= BLOCK;
        end
        BLOCK: begin
          block <= block + 1'b1;
          if (7'(block) == last_block) begin
            pixel <= pixel + 1'b1;
            state <= pixel + 1'b1 == pixels ? DRAIN : MOVE;
          end
        end
        DRAIN: if (!made_0 && !made_1 && !made_2) state <= IDLE;
      endcase
      made_0 <= state == BLOCK;
      {made_1, made_2} <= {made_0, made_1};
      write <= made_2;
      if (made_2) write_at <= write_at + 1'b1;
    end
    {block_0, block_1, block_2} <= {block, block_0, block_1};
    {level_0, truncation_0, cell_q8_0} <= {own_level, own_truncation, own_cell_q8};
    {truncation_1, truncation_2} <= {truncation_0, truncation_1};
    cell_q8_1 <= cell_q8_0;
    for (int d = 0; d < DISPARITIES; d++) is_within[d] <= 7'(d) < disparities;
    for (int lane = 0; lane < LANES; lane++) begin
      differing_0[lane] <= own ^ window[block*LANES+lane][31:0];
      levels_0[lane] <= window[block*LANES+lane][47:32];
      cells_1[lane] <= ones(differing_0[lane]);
      difference_1[lane] <= difference(level_0, levels_0[lane][7:0], levels_0[lane][15:8], difference_truncation);
      product_2[lane] <= 16'(cells_1[lane]) * cell_q8_1;
      weighted_2[lane] <= 16'(difference_1[lane]) * 16'(difference_weight_q4);
      costs[8*lane+:8] <= is_within[block_2*LANES+lane]
          ? cost(product_2[lane], weighted_2[lane], truncation_2) : 8'hff;
    end
  end
endmodule
