//! The checks of a row of selected disparities against the other view's, and of their margins.

use crate::disparity::INVALID;

/// A row of selected disparities to check.
///
/// All slices but `others` have one element per pixel; of different lengths, the common one is
/// checked.
#[derive(Debug, Clone, Copy)]
pub struct CheckRow<'a> {
    /// Index of the best disparity of each pixel.
    pub best: &'a [u16],
    /// Index of the best disparity of each pixel with its sub-pixel step, 1/16 px, not negative.
    pub refined_index_q4: &'a [i16],
    /// Margin of the best disparity over the second best.
    pub margins: &'a [i16],
    /// Best matches of the other view's pixels, the index of the disparity in the low half.
    pub others: &'a [u32],
    /// Place in `others`, modulo 2^32, of the match of the first pixel at the lowest disparity. That
    /// of each pixel after it is one less, that of each disparity one more.
    pub first: u32,
    /// Largest difference between the disparities of the two views, px.
    pub tolerance_px: u8,
    /// Smallest margin of a disparity that is not in doubt.
    pub margin: i16,
}

/// Writes the state of each pixel and its confidence. If the match is among the others and agrees,
/// the state is the refined index, or its complement if the margin is too small; it is [`INVALID`] if
/// the views do not agree. The confidence is the margin, clamped to 1 to 255, of a disparity that agrees and
/// whose margin is not too small, else 0.
#[inline(always)]
pub fn check_row(row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]) {
    // Without branches, because it is hard to predict where the views agree. First, masks of all
    // ones where they do.
    let mut position = row.first;
    for (&best, agrees) in row.best.iter().zip(&mut *found) {
        // Before the first of them the position wraps round, and is then beyond the last.
        let other = row.others.get(position.wrapping_add(best.into()) as usize);
        // The index of no match is far from every index.
        let other = other.map_or(u16::MAX, |&other| other as u16);
        *agrees = -i16::from(other.abs_diff(best) <= row.tolerance_px.into());
        position = position.wrapping_sub(1);
    }
    let pixels = row.refined_index_q4.iter().zip(row.margins);
    let outputs = found.iter_mut().zip(confidences.iter_mut());
    for ((&refined_index_q4, &margin), (found, confidence)) in pixels.zip(outputs) {
        let agrees = *found;
        let is_clear = -i16::from(margin >= row.margin);
        *found = ((refined_index_q4 ^ !is_clear) & agrees) | (INVALID & !agrees);
        *confidence = (margin.clamp(1, 255) & is_clear & agrees) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_agree_within_the_tolerance_and_hold_with_enough_margin() {
        let row = CheckRow {
            best: &[1, 3, 2, 0, 9],
            refined_index_q4: &[17, 48, 30, 3, 144],
            margins: &[300, 20, 19, 20, 20],
            // Pixel 0 at disparity 0 has its match at place 2.
            others: &[2 << 16 | 5, 0, 2, u32::MAX, 3],
            first: 2,
            tolerance_px: 1,
            margin: 20,
        };
        let (mut found, mut confidences) = ([7; 5], [7; 5]);
        check_row(&row, &mut found, &mut confidences);
        // Places 3, 4, 2, -1 and 7: no match; 3; 2 with too small a margin; outside twice.
        assert_eq!(found, [INVALID, 48, !30, INVALID, INVALID]);
        assert_eq!(confidences, [0, 20, 0, 0, 0]);
        let row = CheckRow { first: 1, ..row };
        check_row(&row, &mut found, &mut confidences);
        // Places 2, 3, 1, -2 and 6.
        assert_eq!(found, [17, INVALID, INVALID, INVALID, INVALID]);
        assert_eq!(confidences, [255, 0, 0, 0, 0]);
    }
}
