//! The border: columns that the other view does not show continue the surface beside them.
//!
//! The first columns of a line, in stored order, match beyond the edge of the other view
//! and are rejected. A line through the disparities that follow is drawn on to the edge;
//! its slope is smoothed from row to row, and bounded.

/// Columns from the first known disparity on that the line is fitted to.
const FITTED_PX: usize = 32;
/// Known disparities among them that are enough.
const FITTED_MIN: i32 = 4;
/// Largest slope: an eighth of a pixel per pixel, in 1/4096 of 1/16 px per px.
const SLOPE_MAX_Q12: i64 = 1 << 13;
/// A new slope counts an eighth.
const SMOOTHING: u32 = 3;

/// The smoothed slope, from row to row.
#[derive(Debug, Default)]
pub(super) struct Border {
    slope_q12: i64,
}

impl Border {
    pub(super) fn reset(&mut self) {
        self.slope_q12 = 0;
    }

    /// Continues the disparities of a row, those that hold not negative, to its first
    /// column; they stay within 0 and `largest_q4`.
    pub(super) fn extend(&mut self, row: &mut [i16], largest_q4: i16) {
        let Some(first) = row.iter().position(|&found| found >= 0) else {
            return;
        };
        let (before, known) = row.split_at_mut(first);
        let (mut n, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy) = (0, 0, 0, 0, 0);
        for (&found, x) in known.iter().take(FITTED_PX).zip(0_i32..) {
            if found >= 0 {
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
        let at_first_q12 = ((sum_y << 12) - self.slope_q12 * sum_x).div_euclid(n);
        for (pixel, x) in before.iter_mut().rev().zip(1_i64..) {
            let value_q4 = (at_first_q12 - self.slope_q12 * x + (1 << 11)) >> 12;
            // Limited to what an `i16` holds.
            *pixel = value_q4.min(largest_q4.into()).max(0) as i16;
        }
    }
}
