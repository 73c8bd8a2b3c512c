//! Matching costs of patterns of 32 cells, and of 48 masked cells, with levels of grey.
//!
//! Costs of levels are [looked up](LevelCosts). Differing cells are counted by Zbb's instruction that counts the
//! ones of a word ([`counted`]), or four disparities at a time ([`packed`]).

use vgstereo_core::kernel::{CELLS_PER_BYTE, CostRun, Kernels, Planes, cost_stride};

use super::group::{Group, MAX_STRIDE, PIXELS, POSITIONS};
use super::levels::LevelCosts;
use super::{counted, packed};
use crate::armv7em::cost::fill_beyond;

/// Equals [`vgstereo_core::kernel::cost_run`] bit for bit. What this code does not support is left to `others`.
pub(super) fn cost_run(others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
    if write_costs::<{ cfg!(target_feature = "zbb") }>(run, costs).is_none() {
        others.cost_run(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it.
/// `COUNTS_ONES` says whether one instruction counts the ones of a word.
fn write_costs<const COUNTS_ONES: bool>(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    let has_grey = run.channels == 1 && run.difference_weight_q4 > 0;
    let fits = (1..=MAX_STRIDE).contains(&run.disparities) && run.hamming_truncation <= 127;
    let pixels = run.cell_costs_q8.len().min(run.truncations.len());
    if !has_grey || !fits || pixels == 0 {
        return None;
    }
    let stride = cost_stride(run.disparities).max(1);
    let lowest = run.first_position.checked_sub(pixels - 1)?;
    let positions = lowest..lowest + pixels - 1 + stride;
    let low = run.other_low[0].get(positions.clone())?;
    let high = run.other_high[0].get(positions)?;
    let levels = LevelCosts::new(run, low, high);
    match (run.inputs.count, run.masks.count) {
        (4, 0) if are_whole(run) => write_groups::<4, 1>(
            run,
            &levels,
            costs,
            if COUNTS_ONES {
                counted::write::<4, 1, 1>
            } else {
                packed::write::<4, 1, { packed::tile_words(4) }>
            },
        )?,
        (6, 6) => write_groups::<6, 2>(
            run,
            &levels,
            costs,
            if COUNTS_ONES {
                counted::write::<6, 2, 2>
            } else {
                packed::write::<6, 2, { packed::tile_words(6) }>
            },
        )?,
        _ => return None,
    }
    fill_beyond(run, costs);
    Some(())
}

/// Whether the cost of a cell is a whole number and all cells together cost at most 255.
pub(crate) fn are_whole(run: &CostRun<'_>) -> bool {
    let bits = run.cell_costs_q8.iter().fold(0, |bits, &cost| bits | cost);
    let most = usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE;
    bits.is_multiple_of(256) && most <= u8::MAX.into()
}

/// Writes the costs of a group of pixels; returns `None` if its rows are too short.
type Write<const BYTES: usize, const TERMS: usize> =
    fn(&Group<'_, BYTES, TERMS>, &LevelCosts, &mut [u8]) -> Option<()>;

/// Writes the costs of a run group by group.
fn write_groups<const BYTES: usize, const TERMS: usize>(
    run: &CostRun<'_>,
    levels: &LevelCosts,
    costs: &mut [u8],
    write: Write<BYTES, TERMS>,
) -> Option<()> {
    let stride = cost_stride(run.disparities).max(1);
    let mut places = [0; POSITIONS];
    let cells = run.cell_costs_q8.chunks(PIXELS);
    let cells = cells.zip(run.truncations.chunks(PIXELS));
    let groups = costs.chunks_mut((PIXELS * stride).max(1)).zip(cells);
    for ((costs, (cell_costs_q8, truncations)), first) in groups.zip((0..).step_by(PIXELS)) {
        let pixels = cell_costs_q8.len().min(truncations.len());
        let lowest = run.first_position.checked_sub(first + pixels - 1)?;
        let count = pixels - 1 + stride;
        let positions = lowest..lowest + count;
        let low = run.other_low[0].get(positions.clone())?;
        let high = run.other_high[0].get(positions)?;
        levels.place(low, high, &mut places)?;
        let start = run.start + first;
        let group = Group::<BYTES, TERMS> {
            inputs: rows(run.inputs, start, pixels)?,
            masks: match TERMS {
                1 => [&[]; BYTES],
                _ => rows(run.masks, first, pixels)?,
            },
            cell_costs_q8,
            truncations,
            levels: run.levels[0].get(start..start + pixels)?,
            stored: rows(run.stored, lowest, count)?,
            places: &places,
            stride,
        };
        write(&group, levels, costs)?;
    }
    Some(())
}

/// A run of positions in all planes.
pub(crate) fn rows<const BYTES: usize>(
    planes: Planes<'_>,
    first: usize,
    count: usize,
) -> Option<[&[u8]; BYTES]> {
    let mut rows: [&[u8]; BYTES] = [&[]; BYTES];
    for (row, plane) in rows.iter_mut().zip(0..) {
        let start = plane * planes.stride + first;
        *row = planes.bytes.get(start..start + count)?;
    }
    Some(rows)
}

#[cfg(test)]
mod tests {
    use vgstereo_core::forward_kernels;
    use vgstereo_core::kernel::Portable;

    use super::*;
    use crate::cases::{Case, CostCase, generator};

    /// Costs counted as with Zbb or without it, whatever the processor has.
    #[derive(Clone, Copy)]
    struct Counting<const COUNTS_ONES: bool>;

    impl<const COUNTS_ONES: bool> Kernels for Counting<COUNTS_ONES> {
        const FUSES_SELECTION: bool = false;

        forward_kernels!(set => &Portable; luma_row, channel_row, resample_row, convert_row, smooth_row,
            pack_cells, recall_row, mask_block, penalty_row, aggregate_paths, select_row, aggregate_row,
            rivals_row, attenuate_row, check_row, arms_row, median9_row, weighted_median_row);

        fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
            if write_costs::<COUNTS_ONES>(run, costs).is_none() {
                Portable.cost_run(run, costs);
            }
        }
    }

    /// The suite tests the one that the processor has.
    #[test]
    fn both_ways_of_counting_give_the_costs_of_the_reference() {
        for seed in 0..600 {
            let random = &mut generator(seed);
            let (width, disparities) = (1 + seed as usize % 70, 1 + seed as usize * 7 % 64);
            let mut reference =
                CostCase::random(random, width, disparities, [4, 6][seed as usize % 2], 1);
            let (mut counted, mut packed) = (reference.clone(), reference.clone());
            reference.run(Portable);
            counted.run(Counting::<true>);
            packed.run(Counting::<false>);
            assert_eq!(counted.output(), reference.output(), "counted, seed {seed}");
            assert_eq!(packed.output(), reference.output(), "packed, seed {seed}");
        }
    }

    /// A level that was clipped, or whose exposure is not known, has an interval of any length.
    #[test]
    fn intervals_of_any_lengths_cost_what_the_reference_says() {
        for seed in 0..300 {
            let random = &mut generator(seed);
            let mut reference = CostCase::random(random, 1 + seed as usize % 40, 32, 4, 1);
            for (at, (low, high)) in reference.other_low[0]
                .iter_mut()
                .zip(&mut reference.other_high[0])
                .enumerate()
            {
                match (at as u64 + seed) % 7 {
                    0 => *low = 0,
                    1 => *high = u8::MAX,
                    2 => (*low, *high) = (0, u8::MAX),
                    3 if seed % 3 == 0 => *high = high.saturating_add(at as u8),
                    _ => {}
                }
            }
            let mut found = reference.clone();
            reference.run(Portable);
            found.run(Counting::<false>);
            assert_eq!(found.output(), reference.output(), "seed {seed}");
        }
    }
}
