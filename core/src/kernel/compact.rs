//! References in little code: compiled once, and one disparity at a time. For a kernel set that hardly ever takes a
//! reference, in a program for a small flash.

use super::aggregate::{AggregateRow, aggregate_blocks};
use super::cost::{CostRun, NO_COST, cost_block, cost_stride};
use super::select::select_blocks;
use super::weighted_median::WeightedMedianRow;

/// Equals [`cost_run`](super::cost_run()).
#[inline(never)]
pub fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(row.disparities).max(1);
    let cells = row.cell_costs_q8.iter().zip(row.truncations);
    for (x, (costs, (&cost_q8, &truncation))) in
        costs.chunks_exact_mut(stride).zip(cells).enumerate()
    {
        let first = row.first_position.saturating_sub(x);
        costs.fill(NO_COST);
        for (cost, at) in costs.iter_mut().take(row.disparities).zip(first..) {
            [*cost] = cost_block(row, x, at, (cost_q8, truncation));
        }
    }
}

/// Equals [`aggregate_paths`](super::aggregate_paths()).
#[inline(never)]
pub fn aggregate_paths(row: &mut AggregateRow<'_>) {
    aggregate_blocks::<1>(row);
}

/// Equals [`select_row`](super::select_row()).
#[inline(never)]
pub fn select_row(row: &mut AggregateRow<'_>) {
    select_blocks::<1>(row);
}

/// Equals [`weighted_median_row`](super::weighted_median_row()).
#[inline(never)]
pub fn weighted_median_row(row: &WeightedMedianRow<'_>, weights: &mut [u8], output: &mut [i16]) {
    super::weighted_median_row(row, weights, output);
}
