//! Matching costs in vector registers: the disparities of a pixel are the bytes of one.
//!
//! The loops are the same for every instruction set; [`cost_in_registers`] puts them beside
//! the registers' own operations.

use vgstereo_core::matching::{CostRun, NO_COST, cost_stride};

/// Most bytes of a register.
const MAX_LANES: usize = 64;

/// Whether every byte that the run looks at is there.
pub fn is_inside(row: &CostRun<'_>, costs: usize) -> bool {
    let stride = cost_stride(row.disparities);
    let pixels = row.cell_costs_q8.len();
    let plane = |planes: usize, stride: usize| planes.saturating_sub(1) * stride;
    let count = row.inputs.count;
    let end = row.first_position + stride;
    let others = row.other_low.iter().zip(row.other_high);
    stride > 0
        && pixels > 0
        && count > 0
        && costs == pixels * stride
        && row.first_position + 1 >= pixels
        && plane(count, row.stored.stride) + end <= row.stored.bytes.len()
        && plane(count, row.inputs.stride) + row.start + pixels <= row.inputs.bytes.len()
        && (row.masks.bytes.is_empty()
            || plane(count, row.masks.stride) + pixels <= row.masks.bytes.len())
        && (row.difference_weight_q4 == 0
            || row
                .levels
                .iter()
                .zip(others)
                .take(row.channels)
                .all(|(levels, (low, high))| {
                    row.start + pixels <= levels.len() && end <= low.len() && end <= high.len()
                }))
}

/// The cost of disparities beyond the range, and 0 for `inside` before them.
#[inline]
pub fn beyond(inside: usize) -> &'static [u8] {
    static RAMP: [u8; 2 * MAX_LANES] = {
        let mut ramp = [0; 2 * MAX_LANES];
        let mut place = MAX_LANES;
        while place < ramp.len() {
            ramp[place] = NO_COST;
            place += 1;
        }
        ramp
    };
    &RAMP[MAX_LANES - inside.min(MAX_LANES)..]
}

/// Sums of differences that are told apart: what is larger costs the same.
pub const SUMS: usize = 128;

/// Whether the sums of differences of levels may be cut off at [`SUMS`]: where the mean is
/// truncated at 42 in colour, at 127 in grey, or below.
pub fn sums_fit_bytes(row: &CostRun<'_>) -> bool {
    row.difference_weight_q4 == 0
        || mean_of(row, SUMS as u16 - 1) >= u16::from(row.difference_truncation)
}

/// By the sum of the differences of levels, their cost. Inlined so that it is compiled for
/// the caller's instruction set.
#[inline(always)]
pub fn difference_costs(row: &CostRun<'_>) -> [u8; SUMS] {
    let mut costs = [0; SUMS];
    for (cost, sum) in costs.iter_mut().zip(0..) {
        let mean = mean_of(row, sum).min(row.difference_truncation.into());
        // The configuration bounds it to 8 bits.
        *cost = ((mean * u16::from(row.difference_weight_q4)) >> 4) as u8;
    }
    costs
}

/// The mean of the channels' differences, as core has it.
#[inline(always)]
fn mean_of(row: &CostRun<'_>, sum: u16) -> u16 {
    if row.channels == 1 {
        sum
    } else {
        (sum * 85) >> 8
    }
}

/// Defines `cost_run`, the same as core's, and that itself where a row is too short for the
/// run or differences of levels are hardly truncated.
///
/// A macro because a function cannot be compiled for the instruction set of its caller. It
/// takes from where it stands `Register` with its `LANES` of bytes, half as many words, and
/// operations on both; `load` and `store` move the first `lanes` bytes, and the others mean
/// nothing; `lanes_from` moves those from a place on to the front. And `Patterns`, made of a
/// run that [`is_inside`], whose `differing_cells` tells how many cells of `PIXELS` pixels from
/// `x` of the run differ from those of the last one's disparities from `start` on: `REGISTERS`
/// times, for each, two registers of words, which `pack` makes bytes in order. And
/// `Differences`, made of a run whose [`sums_fit_bytes`], whose `costs` are those of sums of
/// differences of levels, bytes cut off at 255.
macro_rules! cost_in_registers {
    ($features:literal) => {
        /// See [`super::cost`].
        #[target_feature(enable = $features)]
        pub fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
            let masked = !row.masks.bytes.is_empty();
            let channels = match row.difference_weight_q4 {
                0 => 0,
                _ => row.channels,
            };
            let is_for_registers = is_inside(row, costs.len()) && sums_fit_bytes(row);
            match (is_for_registers, masked, channels) {
                (true, false, 0) => cost_registers::<false, 0>(row, costs),
                (true, false, 1) => cost_registers::<false, 1>(row, costs),
                (true, false, 3) => cost_registers::<false, 3>(row, costs),
                (true, true, 0) => cost_registers::<true, 0>(row, costs),
                (true, true, 1) => cost_registers::<true, 1>(row, costs),
                (true, true, 3) => cost_registers::<true, 3>(row, costs),
                _ => matching::cost_run(row, costs),
            }
        }

        /// The same, two registers at a time where there are as many disparities, or [`GROUP`]
        /// pixels where a register has room for what all of them look at: what is the same
        /// for all of them is read once.
        #[target_feature(enable = $features)]
        fn cost_registers<const MASKED: bool, const CHANNELS: usize>(
            row: &CostRun<'_>,
            costs: &mut [u8],
        ) {
            let stride = cost_stride(row.disparities);
            let patterns = &Patterns::new(row);
            let differences = &Differences::new(row);
            if stride >= 2 * LANES {
                cost_pixels::<MASKED, CHANNELS, 2, 1>(row, (patterns, differences), 0, costs);
                return;
            }
            let mut grouped = 0;
            if row.disparities + GROUP - 1 <= stride.min(LANES) {
                grouped = row.cell_costs_q8.len() / GROUP * GROUP;
            }
            let (costs, rest) = costs.split_at_mut(grouped * stride);
            cost_pixels::<MASKED, CHANNELS, 1, GROUP>(row, (patterns, differences), 0, costs);
            cost_pixels::<MASKED, CHANNELS, 1, 1>(row, (patterns, differences), grouped, rest);
        }

        /// The costs of pixels from `first` on of a run that [`is_inside`], with its masks
        /// and channels of levels. Registers stand for what the last of a group looks at:
        /// for the one before a place further on.
        #[target_feature(enable = $features)]
        #[inline]
        fn cost_pixels<
            const MASKED: bool,
            const CHANNELS: usize,
            const REGISTERS: usize,
            const PIXELS: usize,
        >(
            row: &CostRun<'_>,
            (patterns, differences): (&Patterns, &Differences),
            first: usize,
            costs: &mut [u8],
        ) {
            let stride = cost_stride(row.disparities);
            let lanes = if REGISTERS > 1 {
                LANES
            } else {
                stride.min(LANES)
            };
            let block = REGISTERS * lanes;
            let hamming_truncation = broadcast_byte(row.hamming_truncation.cast_signed());
            let half = broadcast_word(128);
            let cell_costs_q8 = row.cell_costs_q8[first..].as_chunks::<PIXELS>().0;
            let groups = costs.chunks_exact_mut(PIXELS * stride).zip(cell_costs_q8);
            for ((costs, cell_costs_q8), x) in groups.zip((first..).step_by(PIXELS)) {
                for start in (0..stride).step_by(block) {
                    // The last block overlaps the one before rather than leave a rest.
                    let start = start.min(stride - block);
                    let cells =
                        patterns.differing_cells::<MASKED, REGISTERS, PIXELS>(x, start, lanes);
                    for (index, cells) in cells.into_iter().enumerate() {
                        let start = start + index * lanes;
                        let at = row.first_position + 1 - PIXELS - x + start;
                        let mut others = [[zero(); 2]; CHANNELS];
                        let rows = row.other_low.iter().zip(row.other_high);
                        for (other, (low, high)) in others.iter_mut().zip(rows) {
                            // SAFETY: `is_inside` has shown that all lanes are there.
                            *other = unsafe { [load(low, at, lanes), load(high, at, lanes)] };
                        }
                        for (pixel, cells) in cells.into_iter().enumerate() {
                            let cell_cost_q8 = broadcast_word(cell_costs_q8[pixel].cast_signed());
                            let [low, high] = cells.map(|cells| {
                                let exact_q8 = multiply(cells, cell_cost_q8);
                                shift_right::<8>(add_words(exact_q8, half))
                            });
                            let mut cost = least_bytes(pack(low, high), hamming_truncation);
                            if CHANNELS > 0 {
                                let mut sum = zero();
                                for ([low, high], levels) in others.into_iter().zip(row.levels) {
                                    let own = levels[row.start + x + pixel].cast_signed();
                                    let own = broadcast_byte(own);
                                    // One of the two is 0.
                                    let difference = or(
                                        subtract_saturating(own, high),
                                        subtract_saturating(low, own),
                                    );
                                    sum = add_saturating(sum, difference);
                                }
                                cost = add_saturating(cost, differences.costs(sum));
                            }
                            cost = lanes_from(cost, PIXELS - 1 - pixel);
                            if start + lanes > row.disparities {
                                let inside = row.disparities.saturating_sub(start);
                                // SAFETY: there are as many bytes as a register has.
                                cost = or(cost, unsafe { load(beyond(inside), 0, lanes) });
                            }
                            let at = pixel * stride + start;
                            store(&mut costs[at..at + lanes], cost);
                        }
                    }
                }
            }
        }
    };
}
pub(super) use cost_in_registers;
