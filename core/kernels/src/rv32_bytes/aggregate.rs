//! SGM path costs, four disparities to a register.

use core::cell::Cell;

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::{self, AggregateRow};

use super::instructions::{add_saturating_u8x4, least_beside, least_of, meet_next, min_u8x4};
use crate::armv7em::simd::splat_u8;

/// Disparities whose path costs share a word.
const QUAD: usize = 4;

/// Words that are computed side by side. All rows of disparities are a multiple of them.
const BLOCK: usize = 4;

/// Path costs beyond the range, which are never the least.
const FAR: u32 = u32::MAX;

/// Equals [`kernel::aggregate_paths`] bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    if aggregate(row).is_none() {
        kernel::aggregate_paths(row);
    }
}

/// Aggregates a row; returns `None` if the rows are not aligned to words.
#[inline(never)]
fn aggregate(row: &mut AggregateRow<'_>) -> Option<()> {
    let words = (row.stride / QUAD).max(1);
    let costs = cells(row.costs)?.chunks_exact(words);
    let (from_right, from_above) = (cells(row.from_right)?, cells(row.from_above)?);
    let p1 = splat_u8(row.p1);

    // From the right. `p2` is the penalty between a pixel and the one on its right.
    let (mut previous, mut p2) = (None, 0);
    let pixels = costs.clone().zip(from_right.chunks_exact(words));
    for ((costs, from_right), &p2_left) in pixels.zip(row.p2_along).rev() {
        let least = match previous {
            None => begin(costs, from_right),
            Some((previous, least)) => Step::new(p1, p2, least).take(previous, costs, from_right),
        };
        (previous, p2) = (Some((from_right, least)), p2_left);
    }

    let pixels = costs.clone().zip(from_above.chunks_exact(words));
    for ((costs, from_above), &p2) in pixels.zip(row.p2_down) {
        if row.is_first {
            begin(costs, from_above);
        } else {
            let least = least_in(from_above);
            Step::new(p1, p2, least).take(from_above, costs, from_above);
        }
    }

    // From the left; the path costs replace the matching costs.
    let mut previous = None;
    for (costs, &p2) in costs.zip(row.p2_along) {
        let least = match previous {
            None => least_in(costs),
            Some((previous, least)) => Step::new(p1, p2, least).take(previous, costs, costs),
        };
        previous = Some((costs, least));
    }
    Some(())
}

/// The words of a row as cells, because a path may replace what it is computed from.
fn cells(row: &mut [u8]) -> Option<&[Cell<u32>]> {
    let words: &mut [u32] = try_cast_slice_mut(row).ok()?;
    Some(Cell::from_mut(words).as_slice_of_cells())
}

/// A path begins with the costs of its first pixel, of which the least is returned, in all four bytes.
fn begin(costs: &[Cell<u32>], path: &[Cell<u32>]) -> u32 {
    for (path, cost) in path.iter().zip(costs) {
        path.set(cost.get());
    }
    least_in(costs)
}

/// The least of these costs, in all four bytes.
#[inline(always)]
fn least_in(costs: &[Cell<u32>]) -> u32 {
    let mut least = [FAR; 2];
    for costs in costs.as_chunks::<BLOCK>().0 {
        let [a, b, c, d] = costs.each_ref().map(Cell::get);
        let [first, second] = [min_u8x4(a, b), min_u8x4(c, d)];
        least = [min_u8x4(least[0], first), min_u8x4(least[1], second)];
    }
    least_of(least[0], least[1])
}

/// A step along a path. Each field has its value in all four bytes.
struct Step {
    p1: u32,
    p2: u32,
    /// Least path cost of the previous pixel.
    least: u32,
}

impl Step {
    #[inline(always)]
    fn new(p1: u32, p2: u8, least: u32) -> Self {
        Self {
            p1,
            p2: splat_u8(p2),
            least,
        }
    }

    /// Takes the step and returns the least path cost of the next pixel, in all four bytes. `next` may be the same
    /// memory as `previous` or as `costs`.
    #[inline(always)]
    fn take(&self, previous: &[Cell<u32>], costs: &[Cell<u32>], next: &[Cell<u32>]) -> u32 {
        let Some((first, above)) = previous.split_first() else {
            return FAR;
        };
        let (mut below, mut same, mut least) = (FAR, first.get(), [FAR; 2]);
        let (above, last_above) = above.as_chunks::<BLOCK>();
        let (costs, next) = (costs.as_chunks::<BLOCK>().0, next.as_chunks::<BLOCK>().0);
        for ((above, costs), next) in above.iter().zip(costs).zip(next) {
            let [b, c, d, e] = above.each_ref().map(Cell::get);
            self.block([below, same, b, c, d, e], costs, next, &mut least);
            (below, same) = (d, e);
        }
        // The highest disparity has no neighbour above it.
        if let (Some(above), Some(costs), Some(next)) = (
            last_above.first_chunk::<{ BLOCK - 1 }>(),
            costs.last(),
            next.last(),
        ) {
            let [b, c, d] = above.each_ref().map(Cell::get);
            self.block([below, same, b, c, d, FAR], costs, next, &mut least);
        }
        least_of(least[0], least[1])
    }

    /// Writes the path costs of a block, given those of the previous pixel in the word below it, in its own words
    /// and in the word above it.
    #[inline(always)]
    fn block(
        &self,
        path: [u32; BLOCK + 2],
        costs: &[Cell<u32>; BLOCK],
        next: &[Cell<u32>; BLOCK],
        least: &mut [u32; 2],
    ) {
        let costs = costs.each_ref().map(Cell::get);
        // One operation on all words after the other, as results are there only after one more instruction.
        let words: [usize; BLOCK] = [0, 1, 2, 3];
        let beside = words.map(|word| least_beside(path[word], path[word + 1]));
        let beside = words.map(|word| meet_next(beside[word], path[word + 2]));
        let beside = beside.map(|beside| add_saturating_u8x4(beside, self.p1));
        let reached = words.map(|word| min_u8x4(beside[word], path[word + 1]));
        // No path cost is below the least: no byte borrows.
        let onward = reached.map(|reached| min_u8x4(reached.wrapping_sub(self.least), self.p2));
        let reached = words.map(|word| add_saturating_u8x4(costs[word], onward[word]));
        for (next, &reached) in next.iter().zip(&reached) {
            next.set(reached);
        }
        let [a, b, c, d] = reached;
        let [first, second] = [min_u8x4(a, b), min_u8x4(c, d)];
        *least = [min_u8x4(least[0], first), min_u8x4(least[1], second)];
    }
}
