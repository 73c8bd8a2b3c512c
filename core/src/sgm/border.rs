//! The border: extends the nearest surface to the columns that the other view does not show.
//!
//! The first columns of a row, in stored order, have their matches beyond the edge of the other
//! view and are rejected. The surface that follows, up to the first jump of its disparities, is
//! extended to the edge along a straight line: through its nearest disparities, and with a slope that
//! is fitted to it and to that of the rows above, each of which counts less than the one below it.

use crate::disparity::STEPS_PER_PX;
use crate::rows::Found;

/// Number of columns, from the first known disparity on, that a slope is fitted to.
const FITTED_PX: usize = 32;
/// Smallest number of known disparities among them that a slope is fitted to.
const FITTED_MIN: i32 = 4;
/// Number of known disparities, from the first on, whose middle the line goes through.
const NEAREST: i32 = 8;
/// Largest step from one known disparity to the next on one surface, 1/16 px.
const STEP_MAX_Q4: i32 = STEPS_PER_PX as i32;
/// Largest slope: 3/32 px per px, in 1/256 of 1/16 px per px.
const SLOPE_MAX_Q8: i32 = 3 << 7;

/// Extension to the border, with what slopes of the rows so far are fitted to.
#[derive(Debug, Default)]
pub(super) struct Border {
    /// Sum of the squared distances of the fitted columns from their middle, px^2, times 4.
    spread: i32,
    /// Sum of the products of these distances and those of the disparities, 1/16 px^2, times 4.
    covariance: i32,
}

impl Border {
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Extends the disparities of a row to its first column. `row` has stored values of [`Found`];
    /// the values written are disparities that hold, between 0 and `largest_index_q4`.
    pub(super) fn extend(&mut self, row: &mut [i16], largest_index_q4: i16) {
        let Some(first) = row.iter().position(|&found| Found::of(found).holds()) else {
            return;
        };
        let (before, known) = row.split_at_mut(first);
        if before.is_empty() {
            return;
        }
        let first_q4 = i32::from(known.first().copied().unwrap_or(0));
        let (mut n, mut sum_x, mut sum_y, mut sum_xx, mut sum_xy) = (0, 0, 0, 0, 0);
        // The nearest ones' number and sums.
        let mut nearest = (0, 0, 0);
        let mut last = 0;
        for (&found, x) in known.iter().take(FITTED_PX).zip(0_i32..) {
            if !Found::of(found).holds() {
                continue;
            }
            // Less than 32 steps from the first, so that all sums fit.
            let y = i32::from(found) - first_q4;
            if (y - last).abs() > STEP_MAX_Q4 {
                break;
            }
            last = y;
            n += 1;
            sum_x += x;
            sum_y += y;
            sum_xx += x * x;
            sum_xy += x * y;
            if n <= NEAREST {
                nearest = (n, sum_x, sum_y);
            }
        }
        // Divisions are per row.
        if n >= FITTED_MIN {
            self.spread += 4 * (n * sum_xx - sum_x * sum_x) / n - (self.spread >> 2);
            self.covariance += 4 * (n * sum_xy - sum_x * sum_y) / n - (self.covariance >> 2);
        }
        let slope_q8 = (self.covariance << 8) / self.spread.max(1);
        let slope_q8 = slope_q8.clamp(-SLOPE_MAX_Q8, SLOPE_MAX_Q8);
        let (n, sum_x, sum_y) = nearest;
        let middle_q8 = ((sum_y << 8) - slope_q8 * sum_x) / n.max(1);
        let at_first_q8 = (first_q4 << 8) + middle_q8;
        for (pixel, x) in before.iter_mut().rev().zip(1_i32..) {
            let value_q4 = (at_first_q8 - slope_q8 * x + (1 << 7)) >> 8;
            // Limited to what an `i16` holds.
            *pixel = value_q4.min(largest_index_q4.into()).max(0) as i16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::INVALID;

    const FIRST: usize = 8;

    /// A row whose disparities begin in column `FIRST`.
    fn row(found: impl Fn(i16) -> i16) -> [i16; 60] {
        core::array::from_fn(|x| if x < FIRST { INVALID } else { found(x as i16) })
    }

    fn extended(border: &mut Border, row: [i16; 60]) -> [i16; 60] {
        let mut extended = row;
        border.extend(&mut extended, 2000);
        assert_eq!(extended[FIRST..], row[FIRST..]);
        extended
    }

    #[test]
    fn a_slanted_surface_is_drawn_on_to_the_edge() {
        let mut border = Border::default();
        // Of a slope of 1/16 px per px, from the first row on.
        for row in [row(|x| 100 + x), row(|x| 140 + x)] {
            let drawn = extended(&mut border, row);
            assert!(
                drawn.windows(2).all(|pair| pair[1] - pair[0] == 1),
                "{drawn:?}"
            );
        }
        border.reset();
        // Bounded by the range of disparities.
        let drawn = extended(&mut border, row(|x| x - 7));
        assert!(drawn[..FIRST - 1].iter().all(|&found| found == 0));
        border.reset();
        let mut drawn = row(|x| 2000 - x);
        border.extend(&mut drawn, 1995);
        assert!(drawn[..4].iter().all(|&found| found == 1995));
    }

    #[test]
    fn a_surface_ends_where_disparities_jump() {
        let jump = row(|x| if x < 20 { 320 } else { 337 + x });
        assert_eq!(
            extended(&mut Border::default(), jump)[..FIRST],
            [320; FIRST]
        );
        // A step of a whole pixel is none, nor is a gap.
        let slope = row(|x| if x % 2 == 0 { 320 + 3 * x / 2 } else { INVALID });
        let drawn = extended(&mut Border::default(), slope);
        assert_eq!(drawn[0], 320, "{drawn:?}");
    }

    #[test]
    fn the_steepest_slope_is_three_thirty_seconds() {
        let drawn = extended(&mut Border::default(), row(|x| 400 + 4 * x));
        assert_eq!(drawn[FIRST - 1] - drawn[FIRST - 5], 6, "{drawn:?}");
    }

    #[test]
    fn few_disparities_are_drawn_on_with_the_slope_of_the_rows_above() {
        let few = [INVALID, INVALID, 50, !7, 50, !7, 50, INVALID];
        let mut extended = few;
        let mut border = Border::default();
        border.extend(&mut extended, 2000);
        assert_eq!(extended[..2], [50; 2]);
        assert_eq!(extended[2..], few[2..]);
        border.extend(&mut row(|x| 300 + x), 2000);
        let mut extended = few;
        border.extend(&mut extended, 2000);
        // Two columns before the middle of the three.
        assert_eq!(extended[..2], [46, 47]);
        // Those in doubt alone are none.
        let mut none = [INVALID, !7, !9];
        border.extend(&mut none, 2000);
        assert_eq!(none, [INVALID, !7, !9]);
    }
}
