// The stereo unit: matching costs, path costs and selection of a row, rivals in it, cells of patterns, smoothed and
// converted levels, penalties and medians of disparities. It reads what it needs from the data memory while the
// processor does not, and keeps costs and paths to itself.
//
//  0x0000 STATUS      read: [0] it is at work. Nothing but STATUS and the queue is to be touched then
//         COMMAND     write: what to do when the queued runs have been read: [2:0] 1 costs, 2 rivals, 3 paths and
//                     selection, 4 smooth, 5 median, 6 penalties, 7 convert  [15:8] largest step that is smoothed; of
//                     what is converted, 0 lowest and 1 highest levels  [17:16] place of the first byte of the results of
//                     4 to 7 in the first word
//  0x0004 ADDRESS     of the first byte of the next run
//  0x0008 RUN         queues a run, of which 32 may wait: [9:0] bytes  [14:10] destination  [16:15] place of its first
//                     byte in the first word: 0 but for samples
//  0x000c SHAPE       [7:0] pixels of the run or row  [14:8] disparities
//  0x0010 FIRST       of the costs: number of the first pixel, times the words of a pixel
//  0x0014 DIFFERENCE  of the levels: [7:0] the largest that counts  [15:8] cost of one, 1/16
//  0x0018 PATHS       [7:0] P1  [15:8] relief  [25:16] from where on lines are meant, at most 1023  [26] no row is above
//  0x001c RIVALS      [7:0] ratio, 1/16  [15:8] slack  [23:16] rise  [30:24] reach, px
//  0x0020 FOUND       read: a bit for each block of four pixels that has rivals; 0x0024 the next 32
//  0x0028 SIZE        read: [7:0] costs of a word  [15:8] most disparities  [31:16] most costs of a row
//  0x002c PENALTY     [7:0] P2  [15:8] smallest P2  [23:16] fall of P2 for a level, 1/16  [31:24] levels without a fall
//  0x0030 GAIN        [14:0] gain, 1/4096  [23:16] difference that counts as none, levels
//  0x0034 OFFSET      [22:0] offset, 1/4096 level, signed
//  0x0038 DOUBTS      a bit for each block of four pixels whose costs count less for paths; 0x003c the next 32. None has
//                     one once costs are made
//  0x0040 SHIFT       [2:0] by how many bits such costs are shifted
//  0x1000             read: of each pixel a word: [31:16] margin  [15:8] best  [7:0] step, 1/16 px, signed
//  0x1400             read: of each position of the other view a word: sum << 16 | index
//  0x1800             read: bytes of cells, levels, penalties or medians
//
// Destinations of runs: 0 to 3 planes of the pixels' patterns, 4 to 7 of the other view's, 8 and 9 lowest and highest
// levels that are equal, 10 levels, 11 truncations, 12 costs of a cell (two bytes each), 13 P2 along the line, 14 P2
// down. The rows about one that is smoothed are 0 to 2, those of disparities begin at 0, 2 and 4 and take two buffers of
// 64 words each. Levels that get penalties, or that are converted, are 0, and their neighbours 1. 16 to 24 are the
// samples of cells, which are packed while they come: first 16, then one after another.
// Pixels are at most 160 in a row and 128 in a run of costs.
module stereo_unit #(
    parameter int LANES = 16,
    parameter int DISPARITIES = 64,
    parameter int COSTS = 8192
) (
    input  logic        clk, rst_n,
    // Registers: what is read comes a cycle later.
    input  logic        write,
    input  logic [12:0] addr,
    input  logic [31:0] write_data,
    output logic [31:0] read_data,
    // The data memory. A word that is taken comes a cycle later.
    output logic        memory_asks,
    output logic [21:0] memory_at,
    input  logic        memory_takes,
    input  logic [31:0] memory_data
);
  localparam int WORD_AT = $clog2(COSTS / LANES);
  localparam logic [15:0] NONE = '1;
  typedef enum logic [2:0] {
    NOTHING, MAKE_COSTS, FIND_RIVALS, MAKE_PATHS, SMOOTH, TAKE_MEDIANS, PENALISE, CONVERT
  } command_t;

  wire writes = write && !addr[12];
  wire [4:0] place = addr[6:2];
  logic [23:0] address;
  logic [7:0] pixels, difference_truncation, difference_weight_q4, p1, relief, ratio_q4, slack, rise;
  logic [6:0] disparities, reach;
  logic [7:0] p2, p2_floor, adaptation_q4, step_min, dead_zone;
  logic [14:0] gain_q12;
  logic signed [22:0] offset_q12;
  logic [9:0] lines_min;
  logic [WORD_AT-1:0] first;
  logic is_first;
  logic [63:0] doubts;
  logic [2:0] shift;
  command_t command;
  logic [7:0] step_max;
  logic [1:0] result_place;

  // Of the costs of a pixel. It stays as it is while the unit is at work.
  logic [6:0] last_block;
  always_ff @(posedge clk) last_block <= (disparities - 1'b1) / 7'(LANES);

  logic reader_busy, run_valid, costs_busy, rivals_busy, paths_busy, selection_busy;
  logic windows_busy;
  logic [6:0] run_index;
  logic [4:0] run_to;
  logic [31:0] run_word;
  unit_reader reader (
      .clk, .rst_n, .queue(writes && place == 5'd2), .address, .bytes(write_data[9:0]),
      .destination(write_data[14:10]), .place(write_data[16:15]), .busy(reader_busy), .asks(memory_asks),
      .word_at(memory_at), .takes(memory_takes), .data(memory_data), .valid(run_valid), .index(run_index),
      .to(run_to), .word(run_word));

  // A command begins when the runs have come. In the cycle after its start, it is under way.
  logic [1:0] started;
  wire starts = command != NOTHING && !reader_busy;
  wire at_work = reader_busy || command != NOTHING || started != 0 || costs_busy || rivals_busy || paths_busy
      || selection_busy || windows_busy;
  always_ff @(posedge clk) begin
    if (!rst_n) begin
      command <= NOTHING;
      started <= '0;
    end else begin
      started <= {started[0], starts};
      if (writes && place == 5'd0) command <= command_t'(write_data[2:0]);
      else if (starts) command <= NOTHING;
    end
    if (writes) begin
      case (place)
        5'd0: {result_place, step_max} <= write_data[17:8];
        5'd1: address <= write_data[23:0];
        5'd3: {disparities, pixels} <= write_data[14:0];
        5'd4: first <= write_data[WORD_AT-1:0];
        5'd5: {difference_weight_q4, difference_truncation} <= write_data[15:0];
        5'd6: {is_first, lines_min, relief, p1} <= write_data[26:0];
        5'd7: {reach, rise, slack, ratio_q4} <= write_data[30:0];
        5'd11: {step_min, adaptation_q4, p2_floor, p2} <= write_data;
        5'd12: {dead_zone, gain_q12} <= {write_data[23:16], write_data[14:0]};
        5'd13: offset_q12 <= write_data[22:0];
        5'd14: doubts[31:0] <= write_data;
        5'd15: doubts[63:32] <= write_data;
        5'd16: shift <= write_data[2:0];
        default: ;
      endcase
    end
    if (starts && command == MAKE_COSTS) doubts <= '0;
  end

  // What the runs fill.
  logic is_median;
  logic [7:0] pixel, position, along_pixel, down_pixel, column;
  logic [31:0] buffer[15];
  logic [5:0] buffer_at[15];
  always_comb begin
    for (int i = 0; i < 15; i++) begin
      if (i < 6 && windows_busy) buffer_at[i] = is_median ? column[6:1] : column[7:2];
      else if (i < 4 || i == 10 || i == 11) buffer_at[i] = pixel[7:2];
      else if (i < 10) buffer_at[i] = position[7:2];
      else if (i == 12) buffer_at[i] = pixel[6:1];
      else buffer_at[i] = i == 13 ? along_pixel[7:2] : down_pixel[7:2];
    end
  end
  for (genvar i = 0; i < 15; i++) begin : buffers
    row_buffer run (
        .clk, .write(run_valid && run_to + 5'(run_index[6]) == 5'(i)), .write_at(run_index[5:0]),
        .write_data(run_word), .read_at(buffer_at[i]), .data(buffer[i]));
  end
  wire [31:0] pattern = {buffer[3][8*pixel[1:0]+:8], buffer[2][8*pixel[1:0]+:8], buffer[1][8*pixel[1:0]+:8],
      buffer[0][8*pixel[1:0]+:8]};
  wire [31:0] stored = {buffer[7][8*position[1:0]+:8], buffer[6][8*position[1:0]+:8],
      buffer[5][8*position[1:0]+:8], buffer[4][8*position[1:0]+:8]};

  logic costs_write;
  logic [WORD_AT-1:0] costs_write_at, paths_costs_at, rivals_costs_at;
  logic [8*LANES-1:0] costs_made, costs;
  unit_costs #(.LANES(LANES), .DISPARITIES(DISPARITIES), .WORD_AT(WORD_AT)) matching (
      .clk, .rst_n, .start(starts && command == MAKE_COSTS), .pixels, .disparities, .last_block, .first,
      .difference_truncation, .difference_weight_q4, .busy(costs_busy), .pixel, .pattern,
      .level(buffer[10][8*pixel[1:0]+:8]),
      .truncation(buffer[11][8*pixel[1:0]+:8]), .cell_cost_q8(buffer[12][16*pixel[0]+:16]), .position, .stored,
      .low(buffer[8][8*position[1:0]+:8]), .high(buffer[9][8*position[1:0]+:8]), .write(costs_write),
      .write_at(costs_write_at), .costs(costs_made));
  block_memory #(.WORDS(COSTS / LANES), .BITS(8 * LANES)) costs_row (
      .clk, .write(costs_write), .write_at(costs_write_at), .write_data(costs_made),
      .read_at(rivals_busy ? rivals_costs_at : paths_costs_at), .data(costs));

  logic [63:0] rivals;
  unit_rivals #(.LANES(LANES), .DISPARITIES(DISPARITIES), .WORD_AT(WORD_AT)) repeated (
      .clk, .rst_n, .start(starts && command == FIND_RIVALS), .pixels, .disparities, .last_block, .ratio_q4, .slack,
      .rise, .reach, .busy(rivals_busy), .costs_at(rivals_costs_at), .costs, .rivals);

  logic sums_valid, sums_last;
  logic [5:0] sums_block;
  logic [7:0] sums_pixel;
  logic [10*LANES-1:0] sums;
  unit_paths #(.LANES(LANES), .DISPARITIES(DISPARITIES), .WORD_AT(WORD_AT)) paths (
      .clk, .rst_n, .start(starts && command == MAKE_PATHS), .is_first, .pixels, .last_block, .p1, .doubts, .shift,
      .busy(paths_busy), .along_pixel, .down_pixel, .p2_along(buffer[13][8*along_pixel[1:0]+:8]),
      .p2_down(buffer[14][8*down_pixel[1:0]+:8]), .costs_at(paths_costs_at), .costs, .valid(sums_valid), .sums_block,
      .sums_last, .sums_pixel, .sums);

  logic other_write, best_write;
  logic [7:0] other_at, best_at;
  logic [15:0] other;
  logic [5:0] best;
  logic [14:0] margin;
  logic signed [4:0] step_q4;
  unit_selection #(.LANES(LANES), .DISPARITIES(DISPARITIES)) selection (
      .clk, .rst_n, .start(starts && command == MAKE_PATHS), .disparities, .last_block, .relief, .lines_min,
      .valid(sums_valid), .block(sums_block), .last(sums_last), .pixel(sums_pixel), .sums, .busy(selection_busy),
      .other_write, .other_at, .other, .best_write, .best_at, .best, .margin, .step_q4);

  // What is read.
  logic [31:0] best_read;
  logic [15:0] other_read;
  block_memory #(.WORDS(256), .BITS(32)) best_row (
      .clk, .write(best_write), .write_at(best_at), .write_data({1'b0, margin, 2'b0, best, 8'(step_q4)}),
      .read_at(addr[9:2]), .data(best_read));
  block_memory #(.WORDS(256), .BITS(16)) other_row (
      .clk, .write(other_write), .write_at(other_at), .write_data(other), .read_at(addr[9:2]), .data(other_read));

  // Rows of levels, or of disparities, which take two buffers each.
  logic is_convert;
  logic [7:0] level, neighbour, level_result;
  logic window_write;
  logic [6:0] window_write_at;
  logic [31:0] window_word, results;
  logic [15:0] rows[3];
  always_ff @(posedge clk) if (starts) {is_median, is_convert} <= {command == TAKE_MEDIANS, command == CONVERT};
  always_comb begin
    for (int i = 0; i < 3; i++)
      rows[i] = is_median ? buffer[2*i+32'(column[7])][16*column[0]+:16] : 16'(buffer[i][8*column[1:0]+:8]);
  end
  unit_windows windows (
      .clk, .rst_n, .start(starts && command >= SMOOTH), .start_median(command == TAKE_MEDIANS),
      .start_levels(command >= PENALISE), .pixels, .step_max, .place(result_place), .busy(windows_busy), .column,
      .top(rows[0]), .middle(rows[1]), .bottom(rows[2]), .level, .neighbour, .level_result, .write(window_write),
      .write_at(window_write_at), .word(window_word));
  unit_levels converted (
      .clk, .is_convert, .is_high(step_max[0]), .p2, .p2_floor, .adaptation_q4, .step_min, .gain_q12, .offset_q12,
      .dead_zone, .level, .neighbour, .result(level_result));
  unit_cells packing (
      .clk, .valid(run_valid && run_to[4]), .sample(run_to[3:0]), .index(run_index[5:0]), .levels(run_word),
      .write(window_write), .write_at(window_write_at), .write_data(window_word), .read_at(addr[8:2]),
      .data(results));

  logic [31:0] register_data;
  logic [2:0] region;
  always_ff @(posedge clk) begin
    region <= addr[12:10];
    if (addr[12]) register_data <= results;
    else begin
      case (place)
        5'd0: register_data <= {31'b0, at_work};
        5'd8: register_data <= rivals[31:0];
        5'd9: register_data <= rivals[63:32];
        5'd10: register_data <= {16'(COSTS), 8'(DISPARITIES), 8'(LANES)};
        default: register_data <= '0;
      endcase
    end
  end
  always_comb begin
    case (region)
      3'b100: read_data = best_read;
      3'b101: read_data = other_read == NONE ? '1 : {6'b0, other_read[15:6], 10'b0, other_read[5:0]};
      default: read_data = register_data;
    endcase
  end
endmodule
