//! Alignment: by how much the other view's lines lie too low.
//!
//! Two cameras that are rectified by hand, or not at all, seldom look along the same lines to
//! a fraction of one, and a fraction is enough to spoil patterns of fine texture. The matches
//! of the lines above tell the offset: where the other view's level at a match differs from
//! the reference's, the offset is the difference over the gradient across lines, by least
//! squares over many matches. Lines of the other view that are still to come are moved by it.
//!
//! What changes slowly along the line is taken from differences and gradients alike, so that
//! neither a gain that is unlike elsewhere in the image nor shading passes for an offset.

use super::exposure::LevelConversion;
use crate::synapse::Support;

/// Larger differences of levels are hardly the offset's: the match is wrong, or occluded.
const DIFFERENCE_MAX: u32 = 24;
/// Larger differences of the lines above and below are edges, where levels do not follow the
/// gradient.
const GRADIENT_MAX: u32 = 64;
/// Sum of the squares of the gradients, each of two lines, from which on an offset is told:
/// the noise of a camera then makes it uncertain by about 1/16 line.
const EVIDENCE_MIN: i64 = 30_000;
/// Smallest change of the offset, 1/256 line: more than that uncertainty.
const CHANGE_MIN_Q8: i64 = 24;
/// With every line 1/16 of the sums fades.
const FADING_SHIFT: u32 = 4;
/// Means along the line are over about 8 matches.
const MEAN_SHIFT: u32 = 3;

/// Rows of grey around a row that is matched, in stored order.
#[derive(Debug, Clone, Copy)]
pub(super) struct GreyRows<'a> {
    /// The row of the reference view.
    pub(super) own: &'a [u8],
    /// The other view's, above the row, at it, and below.
    pub(super) others: [&'a [u8]; 3],
}

/// A match whose levels are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// Position in the reference view's row.
    pub(super) position: usize,
    /// In the other view's.
    pub(super) other_position: usize,
    /// How much further on the match is, 1/16 px.
    pub(super) beyond_q4: i16,
}

/// The running estimate.
#[derive(Debug)]
pub(super) struct Alignment {
    offset_q4: i8,
    offset_max_q4: u8,
    /// Lines until those moved by the present offset alone are around the row.
    settling_lines: u8,
    settling_lines_max: u8,
    /// Of gradients squared, each the difference of two lines.
    squares: i64,
    /// Of gradients times differences.
    products: i64,
}

impl Alignment {
    /// An offset of 0, which may grow to `offset_max_q4`, at most 16, in either direction.
    pub(super) const fn new(offset_max_q4: u8, support: Support) -> Self {
        Self {
            offset_q4: 0,
            offset_max_q4,
            settling_lines: 0,
            settling_lines_max: support.y_px.saturating_add(2),
            squares: 0,
            products: 0,
        }
    }

    /// Forgets the frame.
    pub(super) fn reset(&mut self) {
        self.offset_q4 = 0;
        self.settling_lines = 0;
        self.squares = 0;
        self.products = 0;
    }

    /// By how much the other view's lines lie too low, 1/16 line.
    pub(super) fn offset_q4(&self) -> i8 {
        self.offset_q4
    }

    /// Learns from the matches of a row, in the order of the line; `conversion` is of grey.
    pub(super) fn learn(
        &mut self,
        matches: impl Iterator<Item = Match>,
        rows: GreyRows<'_>,
        conversion: &LevelConversion,
    ) {
        if self.settling_lines > 0 {
            self.settling_lines -= 1;
            return;
        }
        let (mut squares, mut products) = (0_i32, 0_i32);
        let (mut mean_difference_q3, mut mean_gradient_q3) = (0, 0);
        for found in matches {
            let Some((difference, gradient)) = compare(found, rows, conversion) else {
                continue;
            };
            if difference.unsigned_abs() > DIFFERENCE_MAX || gradient.unsigned_abs() > GRADIENT_MAX
            {
                continue;
            }
            mean_difference_q3 += difference - (mean_difference_q3 >> MEAN_SHIFT);
            mean_gradient_q3 += gradient - (mean_gradient_q3 >> MEAN_SHIFT);
            let difference_q3 = (difference << MEAN_SHIFT) - mean_difference_q3;
            let gradient_q3 = (gradient << MEAN_SHIFT) - mean_gradient_q3;
            // At most (16 * 64)^2 / 64 each, and of a line less than 2^15 matches count.
            squares += (gradient_q3 * gradient_q3) >> (2 * MEAN_SHIFT);
            products += (gradient_q3 * difference_q3) >> (2 * MEAN_SHIFT);
        }
        self.squares += i64::from(squares) - (self.squares >> FADING_SHIFT);
        self.products += i64::from(products) - (self.products >> FADING_SHIFT);
        self.conclude();
    }

    /// Moves the offset when it is told clearly. A division per line.
    fn conclude(&mut self) {
        if self.squares < EVIDENCE_MIN {
            return;
        }
        // The gradient is over two lines. Bounded well within 32 bits, as differences and
        // gradients are.
        let change_q8 = (self.products << 9)
            .div_euclid(self.squares)
            .clamp(-256, 256);
        if change_q8.abs() < CHANGE_MIN_Q8 {
            return;
        }
        let most = i64::from(self.offset_max_q4);
        let moved_q4 = (i64::from(self.offset_q4) * 16 + change_q8 + 8) >> 4;
        // Within `offset_max_q4`, at most 16.
        self.offset_q4 = moved_q4.clamp(-most, most) as i8;
        self.settling_lines = self.settling_lines_max;
        self.squares = 0;
        self.products = 0;
    }
}

/// The reference's level less that of the match, in the reference's exposure, and the
/// difference of the lines below and above the match.
#[inline]
fn compare(found: Match, rows: GreyRows<'_>, conversion: &LevelConversion) -> Option<(i32, i32)> {
    let at = found.other_position;
    let [above, middle, below] = rows.others;
    let around = middle.get(at.checked_sub(1)?..)?.first_chunk()?;
    let [before, level, after] = around.map(i32::from);
    let [own, above, below] = [
        *rows.own.get(found.position)?,
        *above.get(at)?,
        *below.get(at)?,
    ]
    .map(i32::from);
    let between = ((after - before) * i32::from(found.beyond_q4)) >> 5;
    let matched = (level + between).clamp(0, 255) as u8;
    Some((own - i32::from(conversion.apply(matched)), below - above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::exposure::Exposure;
    use std::vec::Vec;

    const WIDTH: usize = 200;
    const SUPPORT: Support = Support { x_px: 8, y_px: 3 };

    /// A texture with a known gradient across lines, and shading along them.
    fn level(x: usize, y_px: f64) -> f64 {
        let wave = (x as f64 * 0.9).sin() * (y_px * 0.7 + x as f64 * 1.3).sin();
        120.0 + 30.0 * wave + 0.2 * x as f64
    }

    /// Offsets after so many lines of views that differ by `offset_px` and a gain that
    /// changes along the line.
    fn learned_q4(offset_px: f64, most_q4: u8, gain_slope: f64, lines: usize) -> Vec<i8> {
        let mut alignment = Alignment::new(most_q4, SUPPORT);
        let mut offsets_q4 = Vec::new();
        for y in 0..lines {
            // Moved at once: what is left is the offset less what was learned.
            let left_px = offset_px - f64::from(alignment.offset_q4()) / 16.0;
            let row = |offset_px: f64, dy: f64, slope: f64| -> Vec<u8> {
                let gain = |x: usize| 1.0 + slope * (x as f64 / WIDTH as f64 - 0.5);
                (0..WIDTH)
                    .map(|x| (level(x, y as f64 + dy - offset_px) * gain(x)).round() as u8)
                    .collect()
            };
            let own = row(0.0, 0.0, 0.0);
            let others = [-1.0, 0.0, 1.0].map(|dy| row(left_px, dy, gain_slope));
            let matches = (0..WIDTH).step_by(2).map(|position| Match {
                position,
                other_position: position,
                beyond_q4: 0,
            });
            let rows = GreyRows {
                own: &own,
                others: others.each_ref().map(Vec::as_slice),
            };
            alignment.learn(matches, rows, &Exposure::new().conversion(0));
            offsets_q4.push(alignment.offset_q4());
        }
        offsets_q4
    }

    #[test]
    fn offsets_of_either_sign_are_found() {
        for offset_q4 in [-16, -9, -4, 3, 8, 16] {
            let found = learned_q4(f64::from(offset_q4) / 16.0, 16, 0.0, 100);
            let last = *found.last().unwrap();
            assert!(last.abs_diff(offset_q4) <= 2, "{last} for {offset_q4}");
        }
    }

    #[test]
    fn offsets_stay_within_their_bound() {
        assert_eq!(learned_q4(1.0, 6, 0.0, 100).last(), Some(&6));
        assert_eq!(learned_q4(-1.0, 6, 0.0, 100).last(), Some(&-6));
        assert!(learned_q4(1.0, 0, 0.0, 100).iter().all(|&found| found == 0));
    }

    #[test]
    fn a_gain_that_changes_along_the_line_is_no_offset() {
        let found = learned_q4(0.0, 16, 0.2, 200);
        assert!(found.iter().all(|&found| found == 0), "{found:?}");
    }
}
