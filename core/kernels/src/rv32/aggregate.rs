//! SGM path costs, a word of four disparities at a time where all of them take the penalty of a larger step, and
//! else one disparity after the other.
//!
//! Most disparities of most pixels lie so far above the least path cost that a larger step is the cheapest. This
//! is seen of four of them at once; their path costs are their costs and the penalty, one addition for all.

use core::cell::Cell;

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::{self, AggregateRow, NO_COST};

use super::least::least;
use super::unrolled::unrolled;
use crate::armv7em::simd::splat_u8;

/// Disparities whose path costs share a word.
const QUAD: usize = 4;

/// Words whose loop is unrolled. All rows of disparities are a multiple of it.
const BLOCK: usize = 4;

/// Top bit of each byte.
const TOPS: u32 = splat_u8(0x80);

/// Equals [`kernel::aggregate_paths`] bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let steps = Bytewise {
        p1: row.p1.into(),
        disparities: row.disparities,
    };
    if aggregate(row, steps).is_none() {
        kernel::aggregate_paths(row);
    }
}

/// Steps along the paths of a row, whose costs and path costs are words of four disparities each.
pub(crate) trait Steps {
    /// The least of these costs, in the form in which [`take`](Self::take) takes and returns it.
    fn least_of(&self, costs: &[Cell<u32>]) -> u32;

    /// Writes the path costs of the next pixel of a path and returns their least, given the penalty of a larger step,
    /// and the path costs of the previous pixel and their least. `next` may be the same memory as `previous` or as
    /// `costs`.
    fn take(
        &self,
        p2: u8,
        least: u32,
        previous: &[Cell<u32>],
        costs: &[Cell<u32>],
        next: &[Cell<u32>],
    ) -> u32;
}

/// Aggregates a row by these steps; returns `None` if the rows are not aligned to words.
#[inline(never)]
pub(crate) fn aggregate(row: &mut AggregateRow<'_>, steps: impl Steps) -> Option<()> {
    let words = (row.stride / QUAD).max(1);
    let costs = cells(row.costs)?.chunks_exact(words);
    let (from_right, from_above) = (cells(row.from_right)?, cells(row.from_above)?);

    // From the right. `p2` is the penalty between a pixel and the one on its right.
    let (mut previous, mut p2) = (None, 0);
    let pixels = costs.clone().zip(from_right.chunks_exact(words));
    for ((costs, from_right), &p2_left) in pixels.zip(row.p2_along).rev() {
        let least = match previous {
            None => begin(&steps, costs, from_right),
            Some((previous, least)) => steps.take(p2, least, previous, costs, from_right),
        };
        (previous, p2) = (Some((from_right, least)), p2_left);
    }

    let pixels = costs.clone().zip(from_above.chunks_exact(words));
    for ((costs, from_above), &p2) in pixels.zip(row.p2_down) {
        if row.is_first {
            begin(&steps, costs, from_above);
        } else {
            let least = steps.least_of(from_above);
            steps.take(p2, least, from_above, costs, from_above);
        }
    }

    // From the left; the path costs replace the matching costs.
    let mut previous = None;
    for (costs, &p2) in costs.zip(row.p2_along) {
        let least = match previous {
            None => steps.least_of(costs),
            Some((previous, least)) => steps.take(p2, least, previous, costs, costs),
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

/// A path begins with the costs of its first pixel, of which the least is returned.
fn begin(steps: &impl Steps, costs: &[Cell<u32>], path: &[Cell<u32>]) -> u32 {
    for (path, cost) in path.iter().zip(costs) {
        path.set(cost.get());
    }
    steps.least_of(costs)
}

/// Steps that take one disparity after the other, but where all four of a word take the penalty of a larger step.
struct Bytewise {
    p1: u32,
    disparities: usize,
}

/// The least of these costs.
fn least_of(costs: &[Cell<u32>]) -> u32 {
    let mut found = u32::MAX;
    for costs in costs.as_chunks::<BLOCK>().0 {
        unrolled::<BLOCK>(|word| {
            for cost in costs[word].get().to_le_bytes() {
                found = least(found, cost.into());
            }
        });
    }
    found
}

impl Steps for Bytewise {
    fn least_of(&self, costs: &[Cell<u32>]) -> u32 {
        least_of(costs)
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
        let Some((first, above)) = previous.split_first() else {
            return u32::MAX;
        };
        let p2 = p2.into();
        let mut run = Run::new(self.p1, p2, least, first.get());
        let (above, last_above) = above.as_chunks::<BLOCK>();
        let (costs, next_blocks) = (costs.as_chunks::<BLOCK>().0, next.as_chunks::<BLOCK>().0);
        // Not by a closure, which the compiler would not inline so often.
        for ((above, costs), next) in above.iter().zip(costs).zip(next_blocks) {
            run.step(above[0].get(), &costs[0], &next[0]);
            run.step(above[1].get(), &costs[1], &next[1]);
            run.step(above[2].get(), &costs[2], &next[2]);
            run.step(above[3].get(), &costs[3], &next[3]);
        }
        // The highest disparity has no neighbour above it.
        if let (Some(above), Some(costs), Some(next)) = (
            last_above.first_chunk::<{ BLOCK - 1 }>(),
            costs.last(),
            next_blocks.last(),
        ) {
            run.step(above[0].get(), &costs[0], &next[0]);
            run.step(above[1].get(), &costs[1], &next[1]);
            run.step(above[2].get(), &costs[2], &next[2]);
            run.step(FAR, &costs[3], &next[3]);
        }
        forget_beyond(next, self.disparities);
        // Path costs with the larger penalty were left out.
        if run.least_next > p2 {
            least_of(next)
        } else {
            run.least_next
        }
    }
}

/// Path costs of neighbours beyond the range, which are never the least.
const FAR: u32 = u32::MAX;

/// Gives the disparities beyond the range their cost, as path costs of such do not fit a byte.
#[inline(always)]
fn forget_beyond(next: &[Cell<u32>], disparities: usize) {
    for (word, first) in next
        .iter()
        .zip((0..).step_by(QUAD))
        .skip(disparities / QUAD)
    {
        let mut costs = word.get().to_le_bytes();
        for (cost, disparity) in costs.iter_mut().zip(first..) {
            if disparity >= disparities {
                *cost = NO_COST;
            }
        }
        word.set(u32::from_le_bytes(costs));
    }
}

/// A step along a path, from the lowest disparities up.
struct Run {
    p1: u32,
    /// P2 in all four bytes.
    p2: u32,
    /// Path cost of the previous pixel, at the same disparity, from which on a larger step is cheaper.
    ceiling: u32,
    /// Path cost of the previous pixel, at a neighbouring disparity, from which on a larger step is cheaper.
    neighbour_ceiling: u32,
    /// Half the ceiling, rounded up, in all four bytes.
    half_ceiling: u32,
    /// Least path cost of the previous pixel.
    least_before: u32,
    /// Path cost of the previous pixel at the disparity below those of `same`.
    below: u32,
    /// Path costs of the previous pixel at the next four disparities.
    same: u32,
    /// Least path cost of the next pixel so far, of those without the larger penalty.
    least_next: u32,
}

impl Run {
    #[inline(always)]
    fn new(p1: u32, p2: u32, least_before: u32, same: u32) -> Self {
        let ceiling = least_before + p2;
        Self {
            p1,
            p2: p2 * splat_u8(1),
            ceiling,
            neighbour_ceiling: ceiling.saturating_sub(p1),
            // No byte is as much as 128 if its half is compared with that.
            half_ceiling: least(ceiling.div_ceil(2), 128) * splat_u8(1),
            least_before,
            below: FAR >> 24,
            same,
            least_next: u32::MAX,
        }
    }

    /// Writes the path costs of four disparities, given the path costs of the previous pixel at the four above
    /// them.
    #[inline(always)]
    fn step(&mut self, above: u32, costs: &Cell<u32>, next: &Cell<u32>) {
        // No byte borrows.
        let excess = (self.same >> 1 | TOPS) - self.half_ceiling;
        let is_far = excess & TOPS == TOPS
            && self.below >= self.neighbour_ceiling
            && above & 0xff >= self.neighbour_ceiling;
        let path = if is_far {
            // Only bytes beyond the range carry.
            costs.get().wrapping_add(self.p2)
        } else {
            self.near(above, costs.get())
        };
        next.set(path);
        (self.below, self.same) = (self.same >> 24, above);
    }

    /// The path costs of four disparities, one after the other.
    #[inline(always)]
    fn near(&mut self, above: u32, costs: u32) -> u32 {
        let byte = |word: u32, lane: u32| word >> (8 * lane) & 0xff;
        let same = self.same;
        let a = self.reach(self.below, byte(same, 0), byte(same, 1), byte(costs, 0));
        let b = self.reach(byte(same, 0), byte(same, 1), byte(same, 2), byte(costs, 1));
        let c = self.reach(byte(same, 1), byte(same, 2), byte(same, 3), byte(costs, 2));
        let d = self.reach(byte(same, 2), byte(same, 3), byte(above, 0), byte(costs, 3));
        a | b << 8 | c << 16 | d << 24
    }

    /// The path cost of a disparity. It fits a byte, because the configuration bounds costs and penalties, but
    /// beyond the range.
    #[inline(always)]
    fn reach(&mut self, below: u32, same: u32, above: u32, cost: u32) -> u32 {
        let neighbours = least(below, above) + self.p1;
        let reached = least(least(neighbours, same), self.ceiling);
        let path = reached + cost - self.least_before;
        self.least_next = least(self.least_next, path);
        path
    }
}
