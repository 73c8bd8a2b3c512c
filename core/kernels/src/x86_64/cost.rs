//! Matching costs in vector registers: one byte per disparity of a pixel.
//!
//! All instruction sets share the loops: [`cost_in_registers`] is expanded beside the operations on
//! each set's registers.

use vgstereo_core::kernel::{CostRun, NO_COST, cost_stride};

/// Largest number of bytes per register.
const MAX_LANES: usize = 64;

/// Whether all slices are long enough for the run.
pub(super) fn is_inside(row: &CostRun<'_>, costs: usize) -> bool {
    let stride = cost_stride(row.disparities);
    let pixels = row.cell_costs_q8.len();
    // A sum that overflows is larger than every row.
    let ends_within = |planes: usize, stride: usize, end: usize, bytes: &[u8]| {
        let last = planes.saturating_sub(1).saturating_mul(stride);
        last.saturating_add(end) <= bytes.len()
    };
    let count = row.inputs.count;
    let own_end = row.start.saturating_add(pixels);
    let end = row.first_position.saturating_add(stride);
    let others = row.other_low.iter().zip(row.other_high);
    stride > 0
        && pixels > 0
        && count > 0
        && row.stored.count == count
        && (row.masks.bytes.is_empty() || row.masks.count == count)
        && Some(costs) == pixels.checked_mul(stride)
        && row.truncations.len() == pixels
        && row.first_position >= pixels - 1
        && ends_within(count, row.stored.stride, end, row.stored.bytes)
        && ends_within(count, row.inputs.stride, own_end, row.inputs.bytes)
        && (row.masks.bytes.is_empty()
            || ends_within(count, row.masks.stride, pixels, row.masks.bytes))
        && (row.difference_weight_q4 == 0
            || row
                .levels
                .iter()
                .zip(others)
                .take(row.channels)
                .all(|(levels, (low, high))| {
                    own_end <= levels.len() && end <= low.len() && end <= high.len()
                }))
}

/// Bytes to combine with costs by `or`: 0 for the first `inside` disparities, and [`NO_COST`] for
/// those after them, which are beyond the range.
#[inline]
pub(super) fn beyond(inside: usize) -> &'static [u8] {
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

/// Number of sums of level differences with a cost of their own: all larger sums cost as much as
/// the last.
pub(super) const SUMS: usize = 128;

/// Whether sums of level differences may be cut off below [`SUMS`]: if the mean difference is
/// truncated at 42 or less with three channels, or at 127 or less with one.
pub(super) fn sums_fit_bytes(row: &CostRun<'_>) -> bool {
    row.difference_weight_q4 == 0
        || mean_of(row, SUMS as u16 - 1) >= u16::from(row.difference_truncation)
}

/// Cost of each sum of level differences. Inlined, so that it is compiled for the caller's
/// instruction set.
#[inline(always)]
pub(super) fn difference_costs(row: &CostRun<'_>) -> [u8; SUMS] {
    let mut costs = [0; SUMS];
    for (cost, sum) in costs.iter_mut().zip(0..) {
        let mean = mean_of(row, sum).min(row.difference_truncation.into());
        // The configuration ensures that this fits 8 bits.
        *cost = ((mean * u16::from(row.difference_weight_q4)) >> 4) as u8;
    }
    costs
}

/// Mean of the channels' differences, computed as in core.
#[inline(always)]
fn mean_of(row: &CostRun<'_>, sum: u16) -> u16 {
    if row.channels == 1 {
        sum
    } else {
        (sum * 85) >> 8
    }
}

/// Defines `cost_run`, which equals core's bit for bit and calls it if a slice is too short for the
/// run or if level differences are truncated too high for [`sums_fit_bytes`].
///
/// A macro, because a function cannot be compiled for the instruction set of its caller. Where it
/// is expanded, it expects:
///
/// - `Register`, of `LANES` bytes or half as many words, and operations on both; `load` and
///   `store` move the first `lanes` bytes and leave the others unspecified; `lanes_from` moves the
///   lanes from a place on to the front;
/// - `Patterns`, made of a run that [`is_inside`]. `differing_cells` counts the cells in which the
///   patterns of `PIXELS` pixels from `x` on differ from those of the other view. The latter are
///   the disparities of the last of these pixels from `start` on: `REGISTERS` registers for each
///   pixel, each as two registers of words, which `pack` turns into bytes in order;
/// - `Differences`, made of a run for which [`sums_fit_bytes`], whose `costs` returns the costs of
///   sums of level differences; the sums are bytes, at most 255.
macro_rules! cost_in_registers {
    ($features:literal) => {
        /// Writes the costs of every pixel of the run.
        #[target_feature(enable = $features)]
        pub(super) fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
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
                _ => kernel::cost_run(row, costs),
            }
        }

        /// Writes the costs of a run that [`is_inside`]: two registers of disparities at a time if
        /// there are as many, otherwise [`GROUP`] pixels at a time if one register holds the
        /// disparities of all of them, because then they share their loads.
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

        /// Writes the costs of the pixels from `first` on of a run that [`is_inside`], with its
        /// masks and level channels. Registers begin at a disparity of the last pixel of a group;
        /// each pixel before it begins one place further up.
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
            let half = broadcast_word(128);
            let cell_costs_q8 = row.cell_costs_q8[first..].as_chunks::<PIXELS>().0;
            let truncations = row.truncations[first..].as_chunks::<PIXELS>().0;
            let cells = cell_costs_q8.iter().zip(truncations);
            let groups = costs.chunks_exact_mut(PIXELS * stride).zip(cells);
            for ((costs, (cell_costs_q8, truncations)), x) in groups.zip((first..).step_by(PIXELS))
            {
                for start in (0..stride).step_by(block) {
                    // The last block overlaps the one before it, so that nothing remains.
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
                            let truncation = broadcast_byte(truncations[pixel].cast_signed());
                            let mut cost = least_bytes(pack(low, high), truncation);
                            if CHANNELS > 0 {
                                let mut sum = zero();
                                for ([low, high], levels) in others.into_iter().zip(row.levels) {
                                    let own = levels[row.start + x + pixel].cast_signed();
                                    let own = broadcast_byte(own);
                                    // One of the two differences is 0.
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
