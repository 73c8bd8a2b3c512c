//! Semi-global aggregation (SGM) of a row of costs along three paths, in 8 bits.
//!
//! Along a path, the cost of a pixel at a disparity is its matching cost plus the least of: the
//! previous pixel's path cost at the same disparity; at a neighbouring one plus P1; at any plus
//! P2; less the least path cost of the previous pixel (Hirschmueller 2008, equation 13). The
//! paths run along the line in both directions, and down. The only state from line to line is
//! one row of path costs from above.
//!
//! P1, P2 and the largest matching cost are bounded so that every path cost fits 8 bits: see
//! [`SgmParameters::costs_fit_u8`](crate::config::SgmParameters::costs_fit_u8).

use super::hamming::LANES;
use super::subpixel::SubpixelStep;

/// Bytes before and after the path costs of a pixel, so that every disparity has two neighbours.
/// Their cost is the highest, so they are never on the cheapest path.
const GUARD: usize = 1;
const GUARD_COST: u8 = u8::MAX;

/// A row of matching costs, the state of its aggregation, and the result of its selection.
#[derive(Debug)]
pub struct AggregateRow<'a> {
    /// Matching costs, `stride` bytes per pixel, [`NO_COST`](super::NO_COST) beyond the range.
    /// Between [`aggregate_paths`] and [`select_row`](super::select_row) they are the path costs
    /// from the left; afterwards scratch. Those of a set that keeps them elsewhere are not here.
    pub costs: &'a mut [u8],
    /// Path costs from the right, of the size of `costs`: scratch.
    pub from_right: &'a mut [u8],
    /// Path costs from above, of the size of `costs`. In: those of the line above; out: those of
    /// this line. Unless `is_first`, they must have been written by the same kernel set for a line
    /// of this shape.
    pub from_above: &'a mut [u8],
    /// Bytes per pixel: a multiple of 16.
    pub stride: usize,
    /// Number of disparities.
    pub disparities: usize,
    /// Whether there is no line above.
    pub is_first: bool,
    /// P1, the penalty of a step of one disparity.
    pub p1: u8,
    /// How the sub-pixel step follows from the sums.
    pub subpixel: SubpixelStep,
    /// P2 of each pixel, the penalty of a larger step from the pixel on its left.
    pub p2_along: &'a [u8],
    /// P2 of each pixel, the penalty of a larger step from the pixel above.
    pub p2_down: &'a [u8],
    /// Scratch of [`path_scratch_bytes`].
    pub paths: &'a mut [u8],
    /// Scratch of `stride` sums.
    pub sums: &'a mut [i16],
    /// Out: the best match of each position of the other view, as `sum << 16 | index`. It begins
    /// at the position of the last pixel's lowest disparity and has at least as many elements
    /// as pixels and `stride` together.
    pub other_best: &'a mut [u32],
    /// Out: index of each pixel's best disparity.
    pub best: &'a mut [u16],
    /// Out: the best disparity with its sub-pixel step, counted from the lowest, 1/16 px.
    pub refined_index_q4: &'a mut [i16],
    /// Out: the sum of the second best disparity, not counting the neighbours of the best, less
    /// the sum of the best.
    pub margins: &'a mut [i16],
}

/// Bytes of [`AggregateRow::paths`] for `stride` disparities.
#[must_use]
pub const fn path_scratch_bytes(stride: usize) -> usize {
    3 * (stride + 2 * GUARD)
}

/// Aggregates a row of costs along its three paths. The path costs from the left replace the costs;
/// the others are written to `from_right` and `from_above`.
#[inline(always)]
pub fn aggregate_paths(row: &mut AggregateRow<'_>) {
    if row.stride.is_multiple_of(4 * LANES) {
        aggregate_blocks::<{ 4 * LANES }>(row);
    } else if row.stride.is_multiple_of(2 * LANES) {
        aggregate_blocks::<{ 2 * LANES }>(row);
    } else {
        aggregate_blocks::<LANES>(row);
    }
}

/// [`aggregate_paths`] for strides that are a multiple of `N`.
#[inline(always)]
pub(super) fn aggregate_blocks<const N: usize>(row: &mut AggregateRow<'_>) {
    let stride = row.stride.max(1);
    let guarded = stride + 2 * GUARD;
    row.paths.fill(GUARD_COST);
    let (Some((mut previous, rest)), p1) = (row.paths.split_at_mut_checked(guarded), row.p1) else {
        return;
    };
    let Some((mut current, above)) = rest.split_at_mut_checked(guarded) else {
        return;
    };

    // From the right; each step has the penalty between a pixel and the one on its right.
    let pixels = row
        .costs
        .chunks_exact(stride)
        .zip(row.from_right.chunks_exact_mut(stride));
    let penalties = core::iter::once(&0).chain(row.p2_along.iter().skip(1).rev());
    for (index, ((costs, from_right), &p2)) in pixels.rev().zip(penalties).enumerate() {
        if index == 0 {
            begin_path(costs, current);
        } else {
            step_path::<N>(previous, costs, p1, p2, inside(current));
        }
        if let Some(path) = current.get(GUARD..GUARD + stride) {
            copy(path, from_right);
        }
        core::mem::swap(&mut previous, &mut current);
    }

    // From above, and from the left.
    let pixels = row
        .costs
        .chunks_exact_mut(stride)
        .zip(row.from_above.chunks_exact_mut(stride))
        .zip(row.p2_along.iter().zip(row.p2_down));
    for (x, ((costs, from_above), (&p2_along, &p2_down))) in pixels.enumerate() {
        if row.is_first {
            copy(costs, from_above);
        } else {
            if let Some(path) = above.get_mut(GUARD..GUARD + stride) {
                copy(from_above, path);
            }
            step_path::<N>(above, costs, p1, p2_down, from_above);
        }
        if x == 0 {
            begin_path(costs, current);
        } else {
            step_path::<N>(previous, costs, p1, p2_along, inside(current));
        }
        if let Some(path) = current.get(GUARD..GUARD + stride) {
            copy(path, costs);
        }
        core::mem::swap(&mut previous, &mut current);
    }
}

/// Copies a path of the length of the other.
#[inline(always)]
fn copy(from: &[u8], to: &mut [u8]) {
    if from.len() == to.len() {
        to.copy_from_slice(from);
    }
}

/// A path begins with the costs of its first pixel.
#[inline(always)]
fn begin_path(costs: &[u8], path: &mut [u8]) {
    if let Some(path) = path.get_mut(GUARD..GUARD + costs.len()) {
        copy(costs, path);
    }
}

/// The costs between the guards.
#[inline(always)]
fn inside(path: &mut [u8]) -> &mut [u8] {
    let end = path.len().saturating_sub(GUARD);
    path.get_mut(GUARD..end).unwrap_or_default()
}

/// Takes one step along a path; `previous` has guards around its costs.
#[inline(always)]
fn step_path<const N: usize>(previous: &[u8], costs: &[u8], p1: u8, p2: u8, next: &mut [u8]) {
    // The guards are never the least. Over a run whose length is not a constant, this
    // becomes one vector reduction.
    let least = previous.iter().fold(u8::MAX, |a, &b| a.min(b));
    let next = next.as_chunks_mut::<N>().0;
    for ((next, costs), start) in next
        .iter_mut()
        .zip(costs.as_chunks::<N>().0)
        .zip((0..).step_by(N))
    {
        let Some(window) = previous.get(start..) else {
            return;
        };
        let (Some(below), Some(same), Some(above)) = (
            window.first_chunk::<N>(),
            window.get(GUARD..).and_then(|w| w.first_chunk::<N>()),
            window.get(2 * GUARD..).and_then(|w| w.first_chunk::<N>()),
        ) else {
            return;
        };
        for lane in 0..N {
            let step = below[lane].min(above[lane]).saturating_add(p1);
            // No path cost is below the least.
            let onward = same[lane].min(step).wrapping_sub(least).min(p2);
            next[lane] = costs[lane].saturating_add(onward);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    /// One path written from the equation, over pixels in the order of the path.
    fn path(costs: &[Vec<i32>], p1: i32, p2: &[i32], before: Option<&Vec<i32>>) -> Vec<Vec<i32>> {
        let mut paths: Vec<Vec<i32>> = vec![];
        for (costs, &p2) in costs.iter().zip(p2) {
            let previous = paths.last().or(before);
            let next = match previous {
                None => costs.clone(),
                Some(previous) => {
                    let least = *previous.iter().min().unwrap();
                    let at = |d: usize| previous.get(d).map_or(i32::MAX, |&cost| cost + p1);
                    let onward = |d: usize| {
                        let neighbours = at(d.wrapping_sub(1)).min(at(d + 1));
                        previous[d].min(neighbours).min(least + p2) - least
                    };
                    (0..costs.len()).map(|d| costs[d] + onward(d)).collect()
                }
            };
            paths.push(next);
        }
        paths
    }

    #[test]
    fn paths_follow_the_equation() {
        for seed in 0..40 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |bound: u32| (random.next_u32() % bound) as i32;
            let (pixels, disparities) = (1 + below(9) as usize, 1 + below(40) as usize);
            let stride = disparities.next_multiple_of(LANES);
            let p1 = below(30);
            let p2_along: Vec<i32> = (0..pixels).map(|_| p1 + below(90)).collect();
            let p2_down: Vec<i32> = (0..pixels).map(|_| p1 + below(90)).collect();
            let mut above: Vec<Vec<i32>> = vec![];
            let mut from_above = vec![9; pixels * stride];
            for line in 0..3 {
                let costs: Vec<Vec<i32>> = (0..pixels)
                    .map(|_| (0..disparities).map(|_| below(120)).collect())
                    .collect();
                let mut bytes = vec![255; pixels * stride];
                for (bytes, costs) in bytes.chunks_exact_mut(stride).zip(&costs) {
                    for (byte, &cost) in bytes.iter_mut().zip(costs) {
                        *byte = cost as u8;
                    }
                }
                let to_bytes = |p2: &[i32]| -> Vec<u8> { p2.iter().map(|&p| p as u8).collect() };
                let mut from_right = vec![7; pixels * stride];
                aggregate_paths(&mut AggregateRow {
                    costs: &mut bytes,
                    from_right: &mut from_right,
                    from_above: &mut from_above,
                    stride,
                    disparities,
                    is_first: line == 0,
                    p1: p1 as u8,
                    subpixel: SubpixelStep::PARABOLA,
                    p2_along: &to_bytes(&p2_along),
                    p2_down: &to_bytes(&p2_down),
                    paths: &mut vec![3; path_scratch_bytes(stride)],
                    sums: &mut [],
                    other_best: &mut [],
                    best: &mut [],
                    refined_index_q4: &mut [],
                    margins: &mut [],
                });
                let left = path(&costs, p1, &p2_along, None);
                // From the right, the penalty is that between a pixel and the one on its right.
                let reversed: Vec<Vec<i32>> = costs.iter().rev().cloned().collect();
                let mut penalties = vec![0];
                penalties.extend(p2_along.iter().skip(1).rev());
                let mut right = path(&reversed, p1, &penalties, None);
                right.reverse();
                let down: Vec<Vec<i32>> = (0..pixels)
                    .map(|x| path(&costs[x..=x], p1, &p2_down[x..=x], above.get(x)).remove(0))
                    .collect();
                for (found, expected) in
                    [(&bytes, &left), (&from_right, &right), (&from_above, &down)]
                {
                    for (found, expected) in found.chunks_exact(stride).zip(expected) {
                        let found: Vec<i32> = found[..disparities]
                            .iter()
                            .map(|&cost| cost.into())
                            .collect();
                        assert_eq!(found, *expected, "seed {seed}, line {line}");
                    }
                }
                above = down;
            }
        }
    }
}
