//! Semi-global aggregation of a row of costs: left, right and down, in 8 bits.
//!
//! Along a path, the cost of a pixel at a disparity is its matching cost plus the least
//! of: the previous pixel's path cost at the same disparity, at a neighbouring one plus
//! P1, at any plus P2; less the previous pixel's least (Hirschmueller 2008, equation 13).
//! Three paths are summed: along the line in both directions, and down. The only state
//! from line to line is one row of the path down. The disparity with the least sum is
//! selected, the lowest of several.
//!
//! P1, P2 and the largest matching cost are bounded so that every path cost fits 8 bits:
//! see [`Aggregation::fits`](crate::config::Aggregation::fits).

use crate::disparity::{INVALID, STEPS_PER_PX};
use crate::matching::{LANES, NO_DISTANCE, nearest};

/// Bytes before and after the path costs of a pixel, so that every disparity has two
/// neighbours: the outer ones can never be on the cheapest path.
const GUARD: usize = 1;
const GUARD_COST: u8 = u8::MAX;

/// A right pixel that no disparity reaches.
const NO_MATCH: u32 = u32::MAX;

/// A row of costs and the state of its aggregation.
#[derive(Debug)]
pub struct AggregateRow<'a> {
    /// Matching costs, `stride` bytes per pixel, those beyond the range
    /// [`NO_COST`](crate::matching::NO_COST); scratch afterwards. Between
    /// [`aggregate_paths`] and [`select_row`], path costs from the left.
    pub costs: &'a mut [u8],
    /// Path costs from the right: scratch of the same size.
    pub from_right: &'a mut [u8],
    /// Path costs from above: those of the line above, then of this line. Unless `is_first`,
    /// they are what the same kernel set made of a line of this shape.
    pub from_above: &'a mut [u8],
    /// Bytes per pixel: a multiple of 16.
    pub stride: usize,
    /// Number of disparities.
    pub disparities: usize,
    /// Whether there is no line above.
    pub is_first: bool,
    /// Penalty of a step of one disparity.
    pub p1: u8,
    /// Per pixel, the penalty of a larger step from the pixel on its left.
    pub p2_along: &'a [u8],
    /// Per pixel, that from the pixel above.
    pub p2_down: &'a [u8],
    /// Scratch of [`path_scratch_bytes`].
    pub paths: &'a mut [u8],
    /// Scratch of `stride` sums.
    pub sums: &'a mut [i16],
    /// The best match of each pixel of the other view, as `sum << 16 | index`: from the
    /// position of the last pixel's lowest disparity on; at least pixels + `stride`.
    pub other_best: &'a mut [u32],
    /// Out: index of each pixel's best disparity.
    pub best: &'a mut [u16],
    /// Out: that disparity refined, relative to the lowest, 1/16 px.
    pub refined_q4: &'a mut [i16],
    /// Out: sum of the second best disparity, the best's neighbours left out, less the best's.
    pub margins: &'a mut [i16],
}

/// Bytes of scratch for paths of `stride` disparities.
#[must_use]
pub const fn path_scratch_bytes(stride: usize) -> usize {
    3 * (stride + 2 * GUARD)
}

/// Aggregates a row and selects; the reference of
/// [`Kernels::aggregate_row`](crate::kernel::Kernels::aggregate_row), inlined so that a
/// caller may compile it for its own instruction set.
#[inline(always)]
pub fn aggregate_row(row: &mut AggregateRow<'_>) {
    aggregate_paths(row);
    select_row(row);
}

/// Aggregates a row along its paths, those from the left in place of the costs; the reference
/// of [`Kernels::aggregate_paths`](crate::kernel::Kernels::aggregate_paths).
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

/// The same for strides that are a multiple of `N`.
#[inline(always)]
fn aggregate_blocks<const N: usize>(row: &mut AggregateRow<'_>) {
    let stride = row.stride.max(1);
    let guarded = stride + 2 * GUARD;
    row.paths.fill(GUARD_COST);
    let (Some((mut previous, rest)), p1) = (row.paths.split_at_mut_checked(guarded), row.p1) else {
        return;
    };
    let Some((mut current, above)) = rest.split_at_mut_checked(guarded) else {
        return;
    };

    // From the right, over the penalties between a pixel and the one on its right.
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
            from_right.copy_from_slice(path);
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
            from_above.copy_from_slice(costs);
        } else {
            if let Some(path) = above.get_mut(GUARD..GUARD + stride) {
                path.copy_from_slice(from_above);
            }
            step_path::<N>(above, costs, p1, p2_down, from_above);
        }
        if x == 0 {
            begin_path(costs, current);
        } else {
            step_path::<N>(previous, costs, p1, p2_along, inside(current));
        }
        if let Some(path) = current.get(GUARD..GUARD + stride) {
            costs.copy_from_slice(path);
        }
        core::mem::swap(&mut previous, &mut current);
    }
}

/// Selects the best disparity of each pixel, and that of each pixel of the other view; the
/// reference of [`Kernels::select_row`](crate::kernel::Kernels::select_row).
#[inline(always)]
pub fn select_row(row: &mut AggregateRow<'_>) {
    if row.stride.is_multiple_of(4 * LANES) {
        select_blocks::<{ 4 * LANES }>(row);
    } else if row.stride.is_multiple_of(2 * LANES) {
        select_blocks::<{ 2 * LANES }>(row);
    } else {
        select_blocks::<LANES>(row);
    }
}

/// The same for strides that are a multiple of `N`.
#[inline(always)]
fn select_blocks<const N: usize>(row: &mut AggregateRow<'_>) {
    let stride = row.stride.max(1);
    let count = row.best.len();
    row.other_best.fill(NO_MATCH);
    let pixels = row
        .costs
        .chunks_exact(stride)
        .zip(row.from_right.chunks_exact(stride))
        .zip(row.from_above.chunks_exact(stride));
    let outputs = row
        .best
        .iter_mut()
        .zip(row.refined_q4.iter_mut())
        .zip(row.margins.iter_mut());
    for (x, (((from_left, from_right), from_above), ((best, refined_q4), margin))) in
        pixels.zip(outputs).enumerate()
    {
        sum_paths::<N>([from_left, from_right, from_above], row.sums);
        if let Some(beyond) = row.sums.get_mut(row.disparities..) {
            beyond.fill(NO_DISTANCE);
        }
        if let Some(others) = row.other_best.get_mut(count - 1 - x..)
            && let Some(others) = others.get_mut(..row.disparities)
        {
            for ((other, &sum), index) in others.iter_mut().zip(&*row.sums).zip(0_u32..) {
                // Sums are not negative.
                *other = (*other).min((sum as u32) << 16 | index);
            }
        }
        let selected = select(row.sums);
        *best = selected.index;
        *refined_q4 = selected.refined_q4;
        *margin = selected.margin;
    }
}

/// A path begins with the costs of its first pixel.
#[inline(always)]
fn begin_path(costs: &[u8], path: &mut [u8]) {
    if let Some(path) = path.get_mut(GUARD..GUARD + costs.len()) {
        path.copy_from_slice(costs);
    }
}

/// The costs between the guards.
#[inline(always)]
fn inside(path: &mut [u8]) -> &mut [u8] {
    let end = path.len().saturating_sub(GUARD);
    path.get_mut(GUARD..end).unwrap_or_default()
}

/// One pixel along a path; `previous` has guards around its costs.
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

#[inline(always)]
fn sum_paths<const N: usize>(paths: [&[u8]; 3], sums: &mut [i16]) {
    let [left, right, above] = paths.map(|path| path.as_chunks::<N>().0);
    for (((sums, left), right), above) in sums
        .as_chunks_mut::<N>()
        .0
        .iter_mut()
        .zip(left)
        .zip(right)
        .zip(above)
    {
        for lane in 0..N {
            // Three times 8 bits.
            sums[lane] = i16::from(left[lane]) + i16::from(right[lane]) + i16::from(above[lane]);
        }
    }
}

/// What is known of a pixel from its sums.
struct Selected {
    index: u16,
    refined_q4: i16,
    margin: i16,
}

/// The best disparity, refined by a parabola through its neighbours, and how clear it is.
/// Overwrites the sums around the best.
#[inline(always)]
fn select(sums: &mut [i16]) -> Selected {
    let best = nearest(sums);
    let at = |index: Option<usize>| index.and_then(|i| sums.get(i)).copied();
    let before = at(best.first.checked_sub(1));
    let after = at(Some(best.first + 1)).filter(|&sum| sum != NO_DISTANCE);
    let step_q4 = match (before, after) {
        (Some(before), Some(after)) => parabola_q4(before - best.distance, after - best.distance),
        _ => 0,
    };
    let around = best.first.saturating_sub(1)..=(best.first + 1).min(sums.len().saturating_sub(1));
    if let Some(around) = sums.get_mut(around) {
        around.fill(NO_DISTANCE);
    }
    // Below 4096 disparities.
    let index = best.first as u16;
    Selected {
        index,
        refined_q4: index as i16 * STEPS_PER_PX + step_q4,
        margin: nearest(sums).distance - best.distance,
    }
}

/// The minimum of the parabola through (-1, before), (0, 0), (1, after), 1/16 px:
/// `8 (before - after) / (before + after)`, rounded to nearest, halves outwards.
#[inline(always)]
#[must_use]
pub fn parabola_q4(before: i16, after: i16) -> i16 {
    let [step_q4] = parabolas_q4(&[before], &[after]);
    step_q4
}

/// [`parabola_q4`] of many side by side: loops that become vector code.
#[inline(always)]
#[must_use]
pub fn parabolas_q4<const N: usize>(before: &[i16; N], after: &[i16; N]) -> [i16; N] {
    let mut steps = [0; N];
    // The quotient is at most 8: counting the half steps below it needs no division.
    for half in [1, 3, 5, 7, 9, 11, 13, 15] {
        for lane in 0..N {
            let (before, after) = (before[lane], after[lane]);
            let (sum, difference) = (before + after, before.abs_diff(after) as i16);
            // 8 * 2 * difference / sum >= half; at most 15 times twice 765, three 8-bit paths.
            steps[lane] += i16::from((difference * 16 >= half * sum) & (sum > 0));
        }
    }
    for lane in 0..N {
        // All ones where it is negative: a branch would be mispredicted every other time.
        let sign = -i16::from(before[lane] < after[lane]);
        steps[lane] = (steps[lane] ^ sign) - sign;
    }
    steps
}

/// Checks the matches of a row from both sides: a pixel whose match lies outside the other
/// view, or whose match has another best disparity, is rejected; one whose margin is too
/// small, or whose surroundings have too little texture, is in doubt.
///
/// Texture is the sum of the absolute steps from pixel to pixel along the line, over the
/// pixels at most `reach` away.
#[derive(Debug, Clone, Copy)]
pub struct RowCheck<'a> {
    /// [`AggregateRow::best`].
    pub best: &'a [u16],
    /// [`AggregateRow::refined_q4`].
    pub refined_q4: &'a [i16],
    /// [`AggregateRow::margins`].
    pub margins: &'a [i16],
    /// [`AggregateRow::other_best`].
    pub other_best: &'a [u32],
    /// Lowest disparity, px.
    pub minimum_px: i16,
    /// Largest difference of the two views' disparities, px.
    pub tolerance_px: u8,
    /// Smallest margin.
    pub margin: i16,
    /// Grey of the line with `reach` more pixels at both ends.
    pub grey: &'a [u8],
    /// How far texture is looked for, px, at most 128.
    pub reach: usize,
    /// Smallest texture.
    pub texture_min: u16,
}

impl RowCheck<'_> {
    /// Position in the other view's stored order of the match of pixel `x` at its `best`
    /// disparity, if inside.
    #[must_use]
    #[inline(always)]
    pub fn position(&self, x: usize, best: u16) -> Option<usize> {
        let count = self.best.len();
        // Before the first pixel, the position wraps round and is beyond the last.
        let position =
            (count - 1 - x + usize::from(best)).wrapping_add_signed(self.minimum_px.into());
        (position < count).then_some(position)
    }

    /// Writes what is found of each pixel: its disparity relative to the lowest, 1/16 px,
    /// where it holds; the complement of that (a negative number) where both views agree
    /// but the margin or the texture is small; [`INVALID`] where they do not agree. And its confidence:
    /// the margin in the range 1 to 255 where it holds, else 0.
    pub fn write(&self, found_q4: &mut [i16], confidences: &mut [u8]) {
        let count = self.best.len();
        // Of the other view's best matches those of pixels inside it.
        let minimum_px = isize::from(self.minimum_px);
        let start = (-minimum_px).max(0).unsigned_abs();
        let end = count.saturating_add_signed(-minimum_px);
        let others = self.other_best.get(..end.min(self.other_best.len()));
        let others = others
            .and_then(|others| others.get(start..))
            .unwrap_or_default();
        // Without branches: where views do not agree is hard to predict. First, all ones where
        // they do.
        for (x, (&best, agrees)) in self.best.iter().zip(&mut *found_q4).enumerate() {
            // Before the first of them, the position wraps round and is beyond the last.
            let position = (count - 1 - x + usize::from(best)).wrapping_sub(start);
            // The low half is the other pixel's index; that of no match is far from any.
            let other = others.get(position).map_or(u16::MAX, |&other| other as u16);
            *agrees = -i16::from(other.abs_diff(best) <= self.tolerance_px.into());
        }
        let pixels = self.refined_q4.iter().zip(self.margins);
        let outputs = found_q4.iter_mut().zip(confidences.iter_mut());
        for ((&refined_q4, &margin), (found_q4, confidence)) in pixels.zip(outputs) {
            let agrees = *found_q4;
            let holds = -i16::from(margin >= self.margin);
            *found_q4 = ((refined_q4 ^ !holds) & agrees) | (INVALID & !agrees);
            *confidence = (margin.clamp(1, 255) & holds & agrees) as u8;
        }
        if self.texture_min == 0 {
            return;
        }
        let textures = textures(self.grey, self.reach);
        for ((found_q4, confidence), texture) in found_q4.iter_mut().zip(confidences).zip(textures)
        {
            if texture < self.texture_min && *found_q4 >= 0 {
                *found_q4 = !*found_q4;
                *confidence = 0;
            }
        }
    }
}

/// The texture of each pixel, of a line with `reach` more pixels at both ends.
fn textures(grey: &[u8], reach: usize) -> impl Iterator<Item = u16> {
    let steps = || {
        let pairs = grey.iter().zip(grey.iter().skip(1));
        pairs.map(|(&a, &b)| u16::from(a.abs_diff(b)))
    };
    let mut entering = steps().skip(2 * reach);
    let mut leaving = steps();
    let first: u16 = steps().take(2 * reach).sum();
    let pixels = grey.len().saturating_sub(2 * reach);
    core::iter::successors(Some(first), move |texture| {
        // What leaves is part of the sum.
        Some(texture + entering.next().unwrap_or(0) - leaving.next().unwrap_or(0))
    })
    .take(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabola_equals_the_rounded_quotient() {
        for before in 0..200_i16 {
            for after in 0..200_i16 {
                let sum = f64::from(before) + f64::from(after);
                let exact = if sum > 0.0 {
                    // `f64::round` takes halves outwards.
                    (8.0 * f64::from(before - after) / sum).round()
                } else {
                    0.0
                };
                assert_eq!(
                    f64::from(parabola_q4(before, after)),
                    exact,
                    "{before} {after}"
                );
            }
        }
    }
}
