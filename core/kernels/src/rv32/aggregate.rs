//! SGM path costs, one disparity after the other: a register has no room for saturating bytes, and the least of
//! two numbers takes a branch or one instruction of Zbb.

use core::cell::Cell;

use vgstereo_core::kernel::{AggregateRow, NO_COST};

use super::least::least;
use crate::armv7em::simd::unrolled;

/// Number of disparities whose loop is unrolled. All rows of disparities are a multiple of it.
const BLOCK: usize = 16;

/// Path cost of a neighbour beyond the range, which is never the least.
const FAR: u32 = 1 << 16;

/// Equals [`vgstereo_core::kernel::aggregate_paths`] bit for bit.
#[inline(never)]
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let stride = row.stride.max(1);
    let disparities = row.disparities;
    let pixels = |row| cells(row).chunks_exact(stride);
    let costs = pixels(row.costs);
    let p1 = row.p1.into();

    // From the right. `p2` is the penalty between a pixel and the one on its right.
    let (mut previous, mut p2) = (None, 0);
    let from_right = costs.clone().zip(pixels(row.from_right));
    for ((costs, from_right), &p2_left) in from_right.zip(row.p2_along).rev() {
        let least = match previous {
            None => begin(costs, from_right),
            Some((previous, least)) => {
                let penalties = Penalties { p1, p2, least };
                step(previous, &penalties, costs, from_right, disparities)
            }
        };
        (previous, p2) = (Some((from_right, least)), p2_left.into());
    }

    for ((costs, from_above), &p2) in costs.clone().zip(pixels(row.from_above)).zip(row.p2_down) {
        if row.is_first {
            begin(costs, from_above);
        } else {
            let least = least_of(from_above);
            let penalties = Penalties {
                p1,
                p2: p2.into(),
                least,
            };
            step(from_above, &penalties, costs, from_above, disparities);
        }
    }

    // From the left; the path costs replace the matching costs.
    let mut previous = None;
    for (costs, &p2) in costs.zip(row.p2_along) {
        let least = match previous {
            None => least_of(costs),
            Some((previous, least)) => {
                let penalties = Penalties {
                    p1,
                    p2: p2.into(),
                    least,
                };
                step(previous, &penalties, costs, costs, disparities)
            }
        };
        previous = Some((costs, least));
    }
}

/// The bytes of a row as cells, because a path may replace what it is computed from.
fn cells(row: &mut [u8]) -> &[Cell<u8>] {
    Cell::from_mut(row).as_slice_of_cells()
}

/// The penalties of a step along a path, and the least path cost of the pixel before it.
struct Penalties {
    p1: u32,
    p2: u32,
    least: u32,
}

/// A path begins with the costs of its first pixel, of which the least is returned.
fn begin(costs: &[Cell<u8>], path: &[Cell<u8>]) -> u32 {
    for (path, cost) in path.iter().zip(costs) {
        path.set(cost.get());
    }
    least_of(costs)
}

/// The least of these costs.
fn least_of(costs: &[Cell<u8>]) -> u32 {
    let mut found = u32::MAX;
    for costs in costs.as_chunks::<BLOCK>().0 {
        unrolled::<BLOCK>(|lane| found = least(found, costs[lane].get().into()));
    }
    found
}

/// Takes one step along a path and returns the least path cost of the next pixel. `next` may be the same
/// memory as `previous` or as `costs`.
#[inline(always)]
fn step(
    previous: &[Cell<u8>],
    penalties: &Penalties,
    costs: &[Cell<u8>],
    next: &[Cell<u8>],
    disparities: usize,
) -> u32 {
    let Some((first, above)) = previous.split_first() else {
        return u32::MAX;
    };
    let mut path = Path {
        p1: penalties.p1,
        ceiling: penalties.least + penalties.p2,
        least_before: penalties.least,
        below: FAR,
        same: first.get().into(),
        least: u32::MAX,
    };
    let (above, last_above) = above.as_chunks::<BLOCK>();
    let (costs, next_blocks) = (costs.as_chunks::<BLOCK>().0, next.as_chunks::<BLOCK>().0);
    for ((above, costs), next) in above.iter().zip(costs).zip(next_blocks) {
        unrolled::<BLOCK>(|lane| path.step(above[lane].get().into(), &costs[lane], &next[lane]));
    }
    // The highest disparity has no neighbour above it.
    if let (Some(above), Some(costs), Some(next)) = (
        last_above.first_chunk::<{ BLOCK - 1 }>(),
        costs.last(),
        next_blocks.last(),
    ) {
        unrolled::<{ BLOCK - 1 }>(|lane| {
            path.step(above[lane].get().into(), &costs[lane], &next[lane]);
        });
        path.step(FAR, &costs[BLOCK - 1], &next[BLOCK - 1]);
    }
    for beyond in next.get(disparities..).unwrap_or_default() {
        beyond.set(NO_COST);
    }
    path.least
}

/// A step along a path, from the lowest disparity up.
struct Path {
    p1: u32,
    /// Path cost of the previous pixel from which on a larger step is cheaper.
    ceiling: u32,
    /// Least path cost of the previous pixel.
    least_before: u32,
    /// Path cost of the previous pixel at the disparity below.
    below: u32,
    /// Path cost of the previous pixel at the same disparity.
    same: u32,
    /// Least path cost of the next pixel so far.
    least: u32,
}

impl Path {
    /// Writes the path cost of a disparity, given the cost of the previous pixel at the disparity above it.
    #[inline(always)]
    fn step(&mut self, above: u32, cost: &Cell<u8>, next: &Cell<u8>) {
        let neighbours = least(self.below, above) + self.p1;
        let reached = least(least(neighbours, self.same), self.ceiling);
        // It fits a byte, because the configuration bounds costs and penalties, but beyond the range.
        let path = reached + u32::from(cost.get()) - self.least_before;
        next.set(path as u8);
        self.least = least(self.least, path);
        (self.below, self.same) = (self.same, above);
    }
}
