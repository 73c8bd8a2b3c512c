//! Winner-take-all over the sums of the path costs, with a sub-pixel step and a margin.
//!
//! The disparity with the least sum is selected, the lowest of several. Its neighbours' sums
//! give the sub-pixel step, the second best sum the margin. The best match of each position of
//! the other view is found on the way, for the left-right check.

use super::aggregate::AggregateRow;
use super::hamming::{LANES, NO_DISTANCE};
use super::nearest::nearest;
use super::subpixel::{SubpixelStep, subpixel_step_q4};
use crate::disparity::STEPS_PER_PX;

/// Value of [`AggregateRow::other_best`] at positions of the other view that no disparity reaches.
const NO_MATCH: u32 = u32::MAX;

/// Selects the best disparity of each pixel of a row whose path costs
/// [`aggregate_paths`](super::aggregate_paths) has computed, and of each pixel of the other view.
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

/// [`select_row`] for strides that are a multiple of `N`.
#[inline(always)]
pub(super) fn select_blocks<const N: usize>(row: &mut AggregateRow<'_>) {
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
        .zip(row.refined_index_q4.iter_mut())
        .zip(row.margins.iter_mut());
    for (x, (((from_left, from_right), from_above), ((best, refined_index_q4), margin))) in
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
        let selected = select(row.sums, &row.subpixel);
        *best = selected.index;
        *refined_index_q4 = selected.refined_index_q4;
        *margin = selected.margin;
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
            // The sum of three 8-bit costs fits.
            sums[lane] = i16::from(left[lane]) + i16::from(right[lane]) + i16::from(above[lane]);
        }
    }
}

/// Result of the selection for one pixel, as in [`AggregateRow`].
struct Selected {
    index: u16,
    refined_index_q4: i16,
    margin: i16,
}

/// Returns the best disparity, refined by the sums of its neighbours, and its margin over
/// the second best. Overwrites the sums around the best.
#[inline(always)]
fn select(sums: &mut [i16], subpixel: &SubpixelStep) -> Selected {
    let best = nearest(sums);
    let at = |index: Option<usize>| index.and_then(|i| sums.get(i)).copied();
    let before = at(best.first.checked_sub(1));
    let after = at(Some(best.first + 1)).filter(|&sum| sum != NO_DISTANCE);
    let step_q4 = match (before, after) {
        (Some(before), Some(after)) => {
            subpixel_step_q4(subpixel, before - best.distance, after - best.distance)
        }
        _ => 0,
    };
    let around = best.first.saturating_sub(1)..=(best.first + 1).min(sums.len().saturating_sub(1));
    if let Some(around) = sums.get_mut(around) {
        around.fill(NO_DISTANCE);
    }
    // There are fewer than 4096 disparities.
    let index = best.first as u16;
    Selected {
        index,
        refined_index_q4: index as i16 * STEPS_PER_PX + step_q4,
        margin: nearest(sums).distance - best.distance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of two pixels, selected by hand.
    #[test]
    fn the_least_sum_wins_with_its_step_and_margin() {
        const STRIDE: usize = LANES;
        let sums = [[9_u8, 4, 2, 5, 9, 6], [3, 8, 8, 3, 8, 8]];
        let mut costs = [0; 2 * STRIDE];
        for (row, sums) in costs.chunks_exact_mut(STRIDE).zip(sums) {
            row[..6].copy_from_slice(&sums);
        }
        let (mut best, mut refined_index_q4, mut margins) = ([9; 2], [9; 2], [9; 2]);
        let mut other_best = [0; 2 + STRIDE];
        select_row(&mut AggregateRow {
            costs: &mut costs,
            from_right: &mut [0; 2 * STRIDE],
            from_above: &mut [0; 2 * STRIDE],
            stride: STRIDE,
            disparities: 6,
            is_first: true,
            p1: 0,
            subpixel: SubpixelStep::PARABOLA,
            p2_along: &[],
            p2_down: &[],
            paths: &mut [],
            sums: &mut [0; STRIDE],
            other_best: &mut other_best,
            best: &mut best,
            refined_index_q4: &mut refined_index_q4,
            margins: &mut margins,
        });
        // Among equal sums, the lowest disparity is selected. At the end of the range there is no
        // sub-pixel step.
        assert_eq!(best, [2, 0]);
        // 8 (2 - 3) / 5 = -1.6, rounded to -2.
        assert_eq!(refined_index_q4, [2 * 16 - 2, 0]);
        // The second best is not a neighbour of the best.
        assert_eq!(margins, [4, 0]);
        // Position 0 is that of the last pixel's lowest disparity.
        let (sum, index) = (|key: u32| key >> 16, |key: u32| key & 0xffff);
        let found: std::vec::Vec<_> = other_best
            .iter()
            .map(|&key| (sum(key), index(key)))
            .collect();
        let expected = [(3, 0), (8, 1), (4, 1), (2, 2), (5, 3), (8, 5), (6, 5)];
        assert_eq!(found[..7], expected);
        assert!(other_best[7..].iter().all(|&key| key == NO_MATCH));
    }
}
