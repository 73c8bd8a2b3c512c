//! SGM path costs, four disparities to a register.

use core::cell::Cell;

use vgstereo_core::kernel::{self, AggregateRow};

use super::instructions::{add_saturating_u8x4, least_beside, least_of, meet_next, min_u8x4};
use crate::armv7em::simd::splat_u8;
use crate::rv32::aggregate::{Steps, aggregate};

/// Words that are computed side by side. All rows of disparities are a multiple of them.
const BLOCK: usize = 4;

/// Path costs beyond the range, which are never the least.
const FAR: u32 = u32::MAX;

/// Equals [`kernel::aggregate_paths`] bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let steps = Wordwise {
        p1: splat_u8(row.p1),
    };
    if aggregate(row, steps).is_none() {
        kernel::aggregate_paths(row);
    }
}

/// Steps that take all four disparities of a word at a time. What is least, they have in all four bytes.
struct Wordwise {
    /// P1 in all four bytes.
    p1: u32,
}

impl Steps for Wordwise {
    #[inline(always)]
    fn least_of(&self, costs: &[Cell<u32>]) -> u32 {
        let mut least = [FAR; 2];
        for costs in costs.as_chunks::<BLOCK>().0 {
            let [a, b, c, d] = costs.each_ref().map(Cell::get);
            let [first, second] = [min_u8x4(a, b), min_u8x4(c, d)];
            least = [min_u8x4(least[0], first), min_u8x4(least[1], second)];
        }
        least_of(least[0], least[1])
    }

    #[inline(always)]
    fn take(
        &self,
        p2: u8,
        least: u32,
        previous: &[Cell<u32>],
        costs: &[Cell<u32>],
        next: &[Cell<u32>],
    ) -> u32 {
        let step = Step {
            p1: self.p1,
            p2: splat_u8(p2),
            least,
        };
        let Some((first, above)) = previous.split_first() else {
            return FAR;
        };
        let (mut below, mut same, mut least) = (FAR, first.get(), [FAR; 2]);
        let (above, last_above) = above.as_chunks::<BLOCK>();
        let (costs, next) = (costs.as_chunks::<BLOCK>().0, next.as_chunks::<BLOCK>().0);
        for ((above, costs), next) in above.iter().zip(costs).zip(next) {
            let [b, c, d, e] = above.each_ref().map(Cell::get);
            step.block([below, same, b, c, d, e], costs, next, &mut least);
            (below, same) = (d, e);
        }
        // The highest disparity has no neighbour above it.
        if let (Some(above), Some(costs), Some(next)) = (
            last_above.first_chunk::<{ BLOCK - 1 }>(),
            costs.last(),
            next.last(),
        ) {
            let [b, c, d] = above.each_ref().map(Cell::get);
            step.block([below, same, b, c, d, FAR], costs, next, &mut least);
        }
        least_of(least[0], least[1])
    }
}

/// A step along a path. Each field has its value in all four bytes.
struct Step {
    p1: u32,
    p2: u32,
    /// Least path cost of the previous pixel.
    least: u32,
}

impl Step {
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
