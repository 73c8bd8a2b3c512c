//! Filling: a pixel without a disparity takes that of the background beside it.
//!
//! A surface that only one view sees belongs to what is further away: of the nearest
//! disparities on the left and on the right the smaller one (Hirschmueller 2008, 2.5).

use crate::disparity::INVALID;

/// Fills the gaps of a row; a row without any disparity stays as it is.
pub fn fill_row(row: &mut [i16]) {
    let mut gap_from = 0;
    let mut left = INVALID;
    for x in 0..=row.len() {
        let right = row.get(x).copied();
        if right == Some(INVALID) {
            continue;
        }
        // The gap ends here, at a disparity or at the end of the row.
        let fill = match right {
            Some(right) if left == INVALID => right,
            Some(right) => left.min(right),
            None => left,
        };
        if let Some(gap) = row.get_mut(gap_from..x) {
            gap.fill(fill);
        }
        left = right.unwrap_or(left);
        gap_from = x + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_the_smaller_neighbour() {
        const X: i16 = INVALID;
        let filled = |mut row: [i16; 8]| {
            fill_row(&mut row);
            row
        };
        assert_eq!(filled([X, X, 5, X, 9, X, 7, X]), [5, 5, 5, 5, 9, 7, 7, 7]);
        assert_eq!(
            filled([1, X, X, X, X, X, X, -2]),
            [1, -2, -2, -2, -2, -2, -2, -2]
        );
        assert_eq!(filled([X; 8]), [X; 8]);
        assert_eq!(filled([1, 2, 3, 4, 5, 6, 7, 8]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }
}
