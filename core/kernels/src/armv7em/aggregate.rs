//! SGM path costs of up to 64 disparities, four to a register. Registers are loaded and stored in
//! pairs.

use bytemuck::{must_cast_slice, try_cast_slice_mut};
use vgstereo_core::kernel::AggregateRow;

use super::others;
use super::simd::{
    add_saturating_u8x4, in_order, load, meet_all, min_u8x4, splat_u8, sub_saturating_u8x4,
    unrolled,
};

/// Largest number of disparities, rounded up to a multiple of 16.
pub(super) const MAX_STRIDE: usize = 64;

/// Path costs of eight disparities: two registers.
type Pair = [u32; 2];

/// Equals [`aggregate_paths`](vgstereo_core::kernel::aggregate_paths) bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let aggregated = match row.stride {
        16 => aggregate::<2>(row),
        32 => aggregate::<4>(row),
        48 => aggregate::<6>(row),
        MAX_STRIDE => aggregate::<8>(row),
        _ => None,
    };
    if aggregated.is_none() {
        others::aggregate_paths(row);
    }
}

/// Aggregates a row of `8 * PAIRS` disparities; returns `None` if the rows are not aligned to
/// words.
#[inline(never)]
fn aggregate<const PAIRS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let costs = pixels_mut::<PAIRS>(row.costs)?;
    let from_right = pixels_mut::<PAIRS>(row.from_right)?;
    let from_above = pixels_mut::<PAIRS>(row.from_above)?;
    let p1 = splat_u8(row.p1);
    // A path begins with P2 = 0: then the costs of its first pixel stay as they are, whatever the
    // previous pixel's path costs are.
    let before = [[0; 2]; PAIRS];

    // From the right. `p2` is the penalty between a pixel and the one on its right.
    let (mut previous, mut least, mut p2) = (&before, 0, 0);
    let pixels = costs.iter().zip(from_right).zip(row.p2_along);
    for ((costs, from_right), &p2_left) in pixels.rev() {
        least = step(previous, least, p1, p2, |index, onward| {
            let path = add(costs[index], onward);
            from_right[index] = path;
            path
        });
        previous = from_right;
        p2 = p2_left;
    }

    let rows = costs.iter().zip(from_above).zip(row.p2_down);
    for ((costs, from_above), &p2) in rows {
        if row.is_first {
            *from_above = *costs;
        } else {
            descend(from_above, costs, p1, p2);
        }
    }

    // From the left; the path costs replace the matching costs.
    let (mut previous, mut least, mut is_inside) = (&before, 0, 0);
    for (costs, &p2) in costs.iter_mut().zip(row.p2_along) {
        least = step(previous, least, p1, p2 & is_inside, |index, onward| {
            let path = add(costs[index], onward);
            costs[index] = path;
            path
        });
        previous = costs;
        is_inside = u8::MAX;
    }
    Some(())
}

fn pixels_mut<const PAIRS: usize>(row: &mut [u8]) -> Option<&mut [[Pair; PAIRS]]> {
    Some(try_cast_slice_mut(row).ok()?.as_chunks_mut().0)
}

/// Takes one step along a path. `least` is the least path cost of the previous pixel, in all four
/// bytes; that of the next pixel is returned likewise. `add` receives the index of a [`Pair`] and
/// the path's surcharge on its matching costs, and returns the path costs.
#[inline(always)]
fn step<const PAIRS: usize>(
    previous: &[Pair; PAIRS],
    least: u32,
    p1: u32,
    p2: u8,
    mut add: impl FnMut(usize, Pair) -> Pair,
) -> u32 {
    let onward = Onward::new(least, p2);
    let mut least = None;
    unrolled::<PAIRS>(|index| {
        let path = add(index, onward.costs(reach(previous, index, p1)));
        least = Some(least_with(least, path));
    });
    least_of(least.unwrap_or(u32::MAX))
}

/// Takes one step along the path down, in place.
#[inline(always)]
fn descend<const PAIRS: usize>(path: &mut [Pair; PAIRS], costs: &[Pair; PAIRS], p1: u32, p2: u8) {
    let onward = Onward::new(least_in(path.as_flattened()), p2);
    // The costs of a pair are reached from those before and after it: it is written when the costs
    // of the next are known.
    let mut before = None;
    unrolled::<PAIRS>(|index| {
        let reached = reach(path, index, p1);
        if let Some(before) = before {
            path[index - 1] = before;
        }
        before = Some(add(costs[index], onward.costs(reached)).map(in_order));
    });
    if let (Some(last), Some(path)) = (before, path.last_mut()) {
        *path = last;
    }
}

#[inline(always)]
fn add(costs: Pair, onward: Pair) -> Pair {
    [
        add_saturating_u8x4(costs[0], onward[0]),
        add_saturating_u8x4(costs[1], onward[1]),
    ]
}

#[inline(always)]
fn least_with(least: Option<u32>, [a, b]: Pair) -> u32 {
    let least = least.map_or(a, |least| min_u8x4(least, a));
    in_order(min_u8x4(least, b))
}

/// Returns the least byte of these words, in all four bytes.
#[inline(always)]
fn least_in(words: &[u32]) -> u32 {
    least_of(meet_all(words, min_u8x4))
}

/// Least costs of reaching eight disparities with a step of at most one disparity. The neighbours
/// beyond the range have the highest cost, which is never the least.
#[inline(always)]
fn reach<const PAIRS: usize>(path: &[Pair; PAIRS], index: usize, p1: u32) -> Pair {
    let bytes: &[u8] = must_cast_slice(path.as_slice());
    let moved = |start: usize| {
        let costs = bytes.get(start..).and_then(<[u8]>::first_chunk);
        costs.map(load)
    };
    let reached = |word: usize| {
        let (start, same) = (8 * index + 4 * word, path[index][word]);
        let below = moved(start.wrapping_sub(1)).unwrap_or(same << 8 | 0xff);
        let above = moved(start + 1).unwrap_or(same >> 8 | 0xff << 24);
        min_u8x4(same, add_saturating_u8x4(min_u8x4(below, above), p1))
    };
    [reached(0), reached(1)]
}

/// Surcharge of a path on the matching costs of its next pixel.
struct Onward {
    p2: u32,
    /// The least path cost plus P2. It fits a byte, because the least path cost is at most the
    /// largest matching cost.
    ceiling: u32,
}

impl Onward {
    #[inline(always)]
    fn new(least: u32, p2: u8) -> Self {
        let p2 = splat_u8(p2);
        Self {
            p2,
            ceiling: add_saturating_u8x4(least, p2),
        }
    }

    /// The smaller of P2 and of the excess of the `reached` costs over the least one.
    #[inline(always)]
    fn costs(&self, reached: Pair) -> Pair {
        reached.map(|reached| {
            let less = sub_saturating_u8x4(self.ceiling, reached);
            self.p2.wrapping_sub(less)
        })
    }
}

/// Returns the least of four bytes, in all four bytes.
#[inline(always)]
fn least_of(quad: u32) -> u32 {
    let pair = min_u8x4(quad, quad.rotate_right(16));
    min_u8x4(pair, pair.rotate_right(8))
}
