//! Filling: a pixel without a disparity takes that of the background beside it.
//!
//! A surface that only one view sees belongs to what is further away: of the nearest
//! disparities on the left and on the right the smaller one (Hirschmueller 2008, 2.5).

use crate::disparity::INVALID;

/// Fills the gaps of a row; a row without any disparity stays as it is.
pub fn fill_row(row: &mut [i16]) {
    let mut from = 0;
    while let Some(known) = row.iter().skip(from).position(|&found| found == INVALID) {
        let start = from + known;
        let length = row
            .iter()
            .skip(start)
            .take_while(|&&found| found == INVALID);
        let end = start + length.count();
        let before = start.checked_sub(1).and_then(|left| row.get(left));
        let fill = before.into_iter().chain(row.get(end)).min().copied();
        if let (Some(fill), Some(gap)) = (fill, row.get_mut(start..end)) {
            gap.fill(fill);
        }
        from = end;
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
