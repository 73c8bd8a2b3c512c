//! The border: extends the nearest surface to the columns that the other view does not show.
//!
//! The first columns of a row, in stored order, have their matches beyond the edge of the other
//! view and are rejected. A straight line is fitted to the disparities that follow and extended to
//! the edge. Its slope is smoothed from row to row, and bounded.

use crate::rows::Found;

/// Number of columns, from the first known disparity on, that the line is fitted to.
const FITTED_PX: usize = 32;
/// Smallest number of known disparities among them.
const FITTED_MIN: i32 = 4;
/// Largest slope: an eighth of a pixel per pixel, in 1/4096 of 1/16 px per px.
const SLOPE_MAX_Q12: i64 = 1 << 13;
/// Smoothing of the slope: that of a row has a weight of 1/8, that of the rows above the rest.
const SMOOTHING: u32 = 3;

/// Extension to the border, with the smoothed slope of the rows so far.
#[derive(Debug, Default)]
pub(super) struct Border {
    slope_q12: i64,
}

impl Border {
    pub(super) fn reset(&mut self) {
        self.slope_q12 = 0;
    }

    /// Extends the disparities of a row to its first column. `row` has stored values of [`Found`];
    /// the values written are disparities that hold, between 0 and `largest_index_q4`.
    pub(super) fn extend(&mut self, row: &mut [i16], largest_index_q4: i16) {
        let Some(first) = row.iter().position(|&found| Found::of(found).holds()) else {
            return;
        };
        let (before, known) = row.split_at_mut(first);
        let (mut n, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy) = (0, 0, 0, 0, 0);
        for (&found, x) in known.iter().take(FITTED_PX).zip(0_i32..) {
            if Found::of(found).holds() {
                let y = i32::from(found);
                n += 1;
                sum_x += x;
                sum_y += y;
                sum_xx += x * x;
                sum_xy += x * y;
            }
        }
        if before.is_empty() || n < FITTED_MIN {
            return;
        }
        let [n, sum_x, sum_y, sum_xx, sum_xy] = [n, sum_x, sum_y, sum_xx, sum_xy].map(i64::from);
        // Different columns, so not 0. Divisions are per row.
        let spread = n * sum_xx - sum_x * sum_x;
        let slope_q12 = ((n * sum_xy - sum_x * sum_y) << 12).div_euclid(spread.max(1));
        self.slope_q12 +=
            (slope_q12.clamp(-SLOPE_MAX_Q12, SLOPE_MAX_Q12) - self.slope_q12) >> SMOOTHING;
        // At the first known column, through the middle of the fitted ones.
        let at_first_q12 = ((sum_y << 12) - self.slope_q12 * sum_x).div_euclid(n.max(1));
        for (pixel, x) in before.iter_mut().rev().zip(1_i64..) {
            let value_q4 = (at_first_q12 - self.slope_q12 * x + (1 << 11)) >> 12;
            // Limited to what an `i16` holds.
            *pixel = value_q4.min(largest_index_q4.into()).max(0) as i16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::INVALID;

    #[test]
    fn a_slanted_surface_is_drawn_on_to_the_edge() {
        const FIRST: usize = 8;
        let mut border = Border::default();
        // A slope of 1 / 16 px per px; the smoothed slope comes to it from row to row.
        let row: [i16; 60] =
            core::array::from_fn(|x| if x < FIRST { INVALID } else { 100 + x as i16 });
        for _ in 0..60 {
            let mut row = row;
            border.extend(&mut row, 2000);
            assert_eq!(
                row[FIRST..],
                core::array::from_fn::<i16, 52, _>(|x| 108 + x as i16)
            );
        }
        let mut drawn = row;
        border.extend(&mut drawn, 2000);
        for (x, &found) in drawn.iter().enumerate() {
            assert!((found - 100 - x as i16).abs() <= 1, "{x}: {found}");
        }
        // Bounded by the range of disparities.
        let mut drawn = row.map(|found| if found == INVALID { found } else { found - 107 });
        border.extend(&mut drawn, 2000);
        assert!(drawn[..FIRST - 1].iter().all(|&found| found == 0));
        // Too few known disparities, and those in doubt, change nothing.
        let mut few = [INVALID, INVALID, 5, 5, 5, !7, !7, INVALID];
        border.extend(&mut few, 2000);
        assert_eq!(few, [INVALID, INVALID, 5, 5, 5, !7, !7, INVALID]);
    }
}
