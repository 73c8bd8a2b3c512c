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

/// Defines `cost_run`, the same as core's, and that itself where a row is too short for the
/// run.
///
/// A macro because a function cannot be compiled for the instruction set of its caller. It
/// takes from where it stands `Register` with its `LANES` of bytes, half as many words, and
/// operations on both; `unpack_low` and `unpack_high` make two registers of words of bytes
/// and zeros, which `pack` puts back in order; `load` and `store` move the first `lanes`
/// bytes, and the others mean nothing. And `Patterns`, made of a run that [`is_inside`],
/// whose `differing_cells` tells how many cells of pixel `x` of the run differ from those of
/// its disparities from `start` on: `REGISTERS` times the two registers of words.
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
            match (is_inside(row, costs.len()), masked, channels) {
                (true, false, 0) => cost_registers::<false, 0>(row, costs),
                (true, false, 1) => cost_registers::<false, 1>(row, costs),
                (true, false, 3) => cost_registers::<false, 3>(row, costs),
                (true, true, 0) => cost_registers::<true, 0>(row, costs),
                (true, true, 1) => cost_registers::<true, 1>(row, costs),
                (true, true, 3) => cost_registers::<true, 3>(row, costs),
                _ => matching::cost_run(row, costs),
            }
        }

        /// The same, two registers at a time where there are as many disparities: what is
        /// the same for all of them is read once.
        #[target_feature(enable = $features)]
        fn cost_registers<const MASKED: bool, const CHANNELS: usize>(
            row: &CostRun<'_>,
            costs: &mut [u8],
        ) {
            if cost_stride(row.disparities) >= 2 * LANES {
                cost_pixels::<MASKED, CHANNELS, 2>(row, costs);
            } else {
                cost_pixels::<MASKED, CHANNELS, 1>(row, costs);
            }
        }

        /// The costs of a run that [`is_inside`], with its masks and channels of levels.
        #[target_feature(enable = $features)]
        #[inline]
        fn cost_pixels<const MASKED: bool, const CHANNELS: usize, const REGISTERS: usize>(
            row: &CostRun<'_>,
            costs: &mut [u8],
        ) {
            let stride = cost_stride(row.disparities);
            let lanes = if REGISTERS > 1 {
                LANES
            } else {
                stride.min(LANES)
            };
            let block = REGISTERS * lanes;
            let hamming_truncation = broadcast_word(row.hamming_truncation.into());
            let difference_truncation = broadcast_word(row.difference_truncation.into());
            let weight_q4 = broadcast_word(row.difference_weight_q4.into());
            let half = broadcast_word(128);
            let third_q8 = broadcast_word(85);
            let patterns = Patterns::new(row);
            let pixels = costs.chunks_exact_mut(stride).zip(row.cell_costs_q8);
            for (x, (costs, &cell_cost_q8)) in pixels.enumerate() {
                let cell_cost_q8 = broadcast_word(cell_cost_q8.cast_signed());
                let mut own = [zero(); MAX_CHANNELS];
                for (own, levels) in own.iter_mut().zip(row.levels).take(CHANNELS) {
                    *own = broadcast_byte(levels[row.start + x].cast_signed());
                }
                for start in (0..stride).step_by(block) {
                    // The last block overlaps the one before rather than leave a rest.
                    let start = start.min(stride - block);
                    let cells = patterns.differing_cells::<MASKED, REGISTERS>(x, start, lanes);
                    for (cells, index) in cells.into_iter().zip(0..) {
                        let start = start + index * lanes;
                        let mut cost = cells;
                        for cost in &mut cost {
                            let exact_q8 = multiply(*cost, cell_cost_q8);
                            let rounded = shift_right::<8>(add_words(exact_q8, half));
                            *cost = least_words(rounded, hamming_truncation);
                        }
                        if CHANNELS > 0 {
                            let mut differences = [zero(); 2];
                            let others = row.other_low.iter().zip(row.other_high);
                            for (&own, (low, high)) in own.iter().zip(others).take(CHANNELS) {
                                let at = row.first_position - x + start;
                                // SAFETY: `is_inside` has shown that all lanes are there.
                                let (low, high) =
                                    unsafe { (load(low, at, lanes), load(high, at, lanes)) };
                                // One of the two is 0.
                                let difference = or(
                                    subtract_saturating(own, high),
                                    subtract_saturating(low, own),
                                );
                                differences = widen_add(differences, difference);
                            }
                            for (cost, difference) in cost.iter_mut().zip(differences) {
                                let mean = match CHANNELS {
                                    1 => difference,
                                    _ => shift_right::<8>(multiply(difference, third_q8)),
                                };
                                let mean = least_words(mean, difference_truncation);
                                let weighted = shift_right::<4>(multiply(mean, weight_q4));
                                *cost = add_words(*cost, weighted);
                            }
                        }
                        let mut cost = pack(cost[0], cost[1]);
                        if start + lanes > row.disparities {
                            let inside = row.disparities.saturating_sub(start);
                            // SAFETY: there are as many bytes as a register has.
                            cost = or(cost, unsafe { load(beyond(inside), 0, lanes) });
                        }
                        store(&mut costs[start..start + lanes], cost);
                    }
                }
            }
        }

        /// Adds bytes to words.
        #[target_feature(enable = $features)]
        #[inline]
        fn widen_add([low, high]: [Register; 2], bytes: Register) -> [Register; 2] {
            [
                add_words(low, unpack_low(bytes, zero())),
                add_words(high, unpack_high(bytes, zero())),
            ]
        }
    };
}
pub(super) use cost_in_registers;
