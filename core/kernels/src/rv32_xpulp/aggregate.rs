//! SGM path costs, four disparities to a register. The path costs of a pixel stay in registers, or lie in the stack, until
//! the next pixel of the path.

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::{self, AggregateRow};

use crate::armv7em::simd::splat_u8;
use crate::xpulp::{insert_3, min_u8x4, shuffle};

/// For each byte the one below it: that of the highest of the word before comes first.
const BELOW: u32 = 0x0605_0403;

/// Equals [`kernel::aggregate_paths`] bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let is_full = row.disparities == row.stride;
    let done = match (row.stride, is_full) {
        (16, true) => aggregate::<4, true>(row),
        (16, false) => aggregate::<4, false>(row),
        (32, true) => aggregate::<8, true>(row),
        (32, false) => aggregate::<8, false>(row),
        (48, true) => aggregate::<12, true>(row),
        (48, false) => aggregate::<12, false>(row),
        (64, true) => aggregate::<16, true>(row),
        (64, false) => aggregate::<16, false>(row),
        _ => None,
    };
    if done.is_none() {
        kernel::aggregate_paths(row);
    }
}

/// Aggregates a row of `4 * WORDS` disparities, all of which are searched if `IS_FULL`; returns `None` if the rows are not
/// aligned to words.
#[inline(never)]
fn aggregate<const WORDS: usize, const IS_FULL: bool>(row: &mut AggregateRow<'_>) -> Option<()> {
    let step = Step {
        p1: splat_u8(row.p1),
    };
    let costs: &mut [u32] = try_cast_slice_mut(row.costs).ok()?;
    let from_right: &mut [u32] = try_cast_slice_mut(row.from_right).ok()?;
    let from_above: &mut [u32] = try_cast_slice_mut(row.from_above).ok()?;
    let costs = costs.as_chunks_mut::<WORDS>().0;
    let (from_right, from_above) = (
        from_right.as_chunks_mut::<WORDS>().0,
        from_above.as_chunks_mut::<WORDS>().0,
    );

    // From the right. The penalty of a pixel is that between it and the one on its right.
    let pixels = costs.iter().zip(from_right.iter_mut()).zip(row.p2_along);
    let mut pixels = pixels.rev();
    if let Some(((costs, from_right), &(mut p2))) = pixels.next() {
        let mut path = Path::begin(*costs);
        *from_right = path.costs;
        for ((costs, from_right), &p2_left) in pixels {
            path = step.take::<WORDS, IS_FULL>(p2, path, costs);
            *from_right = path.costs;
            p2 = p2_left;
        }
    }

    let pixels = costs.iter().zip(from_above.iter_mut()).zip(row.p2_down);
    for ((costs, from_above), &p2) in pixels {
        let next = if row.is_first {
            *costs
        } else {
            let path = Path::begin(*from_above);
            step.take::<WORDS, IS_FULL>(p2, path, costs).costs
        };
        *from_above = next;
    }

    // From the left; the path costs replace the matching costs.
    let mut pixels = costs.iter_mut().zip(row.p2_along);
    if let Some((costs, _)) = pixels.next() {
        let mut path = Path::begin(*costs);
        for (costs, &p2) in pixels {
            path = step.take::<WORDS, IS_FULL>(p2, path, costs);
            *costs = path.costs;
        }
    }
    Some(())
}

/// Path costs of a pixel.
#[derive(Clone, Copy)]
struct Path<const WORDS: usize> {
    costs: [u32; WORDS],
    /// The least of them, in all four bytes.
    least: u32,
}

impl<const WORDS: usize> Path<WORDS> {
    /// A path begins with the costs of its first pixel.
    #[inline(always)]
    fn begin(costs: [u32; WORDS]) -> Self {
        let least = costs.into_iter().fold(u32::MAX, min_u8x4);
        Self {
            costs,
            least: in_all_bytes(least),
        }
    }
}

/// The least byte, in all four bytes.
#[inline(always)]
fn in_all_bytes(word: u32) -> u32 {
    let least = min_u8x4(word, word >> 16);
    (min_u8x4(least, least >> 8) & 0xff) * splat_u8(1)
}

/// A step along a path.
struct Step {
    /// P1 in all four bytes.
    p1: u32,
}

impl Step {
    /// Returns the path costs of the next pixel, given the penalty of a larger step and the costs.
    #[inline(always)]
    fn take<const WORDS: usize, const IS_FULL: bool>(
        &self,
        p2: u8,
        path: Path<WORDS>,
        costs: &[u32; WORDS],
    ) -> Path<WORDS> {
        let p2 = splat_u8(p2);
        let mut next = [0; WORDS];
        let mut least = u32::MAX;
        // Not by a closure or a loop, which the compiler would not unroll so often.
        macro_rules! take {
            ($($word:literal)+) => {
                $(if $word < WORDS {
                    let (same, cost) = (path.costs[$word % WORDS], costs[$word % WORDS]);
                    // The lowest disparity has no neighbour below it, and the highest none above it.
                    let before = match $word {
                        0 => u32::MAX,
                        _ => path.costs[($word + WORDS - 1) % WORDS],
                    };
                    let after = path.costs.get($word + 1).copied().unwrap_or(u32::MAX);
                    let below = shuffle(before, same, BELOW);
                    let above = insert_3(same >> 8, after);
                    // No byte carries.
                    let beside = min_u8x4(min_u8x4(below, above), !self.p1).wrapping_add(self.p1);
                    // No path cost is below the least: no byte borrows.
                    let onward = min_u8x4(beside, same).wrapping_sub(path.least);
                    let onward = min_u8x4(onward, p2);
                    // Path costs fit a byte, but those beyond the range.
                    let reached = if IS_FULL {
                        cost.wrapping_add(onward)
                    } else {
                        min_u8x4(onward, !cost).wrapping_add(cost)
                    };
                    least = min_u8x4(least, reached);
                    next[$word % WORDS] = reached;
                })+
            };
        }
        take!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
        Path {
            costs: next,
            least: in_all_bytes(least),
        }
    }
}
