//! Alignment: the vertical offset between the two views, learned from matches.
//!
//! Two cameras that are rectified by hand, or not at all, seldom have their lines at the same
//! height to a fraction of a line, and a fraction is enough to spoil patterns of fine texture. The
//! offset is estimated from the matches of the lines above: at each match, it is the difference
//! between the levels of the two views, divided by the vertical gradient; the estimate is a
//! least-squares fit over many matches. The lines of the other view that are still to come are
//! moved by it.
//!
//! The running mean along the line is subtracted from differences and gradients, so that neither
//! shading nor a gain that changes along the line is mistaken for an offset.

use crate::config::Support;
use crate::kernel::LevelConversion;

/// Largest difference of levels that is used: larger ones stem from wrong matches or occlusion
/// rather than from the offset.
const DIFFERENCE_MAX: u32 = 24;
/// Largest difference between the lines above and below that is used: larger ones are edges, at
/// which levels do not follow the gradient.
const GRADIENT_MAX: u32 = 64;
/// Smallest sum of the squares of the gradients from which an offset is estimated; the noise of a
/// camera then makes it uncertain by about 1/16 line.
const EVIDENCE_MIN: i64 = 30_000;
/// Smallest change of the offset, 1/256 line: more than that uncertainty.
const CHANGE_MIN_Q8: i64 = 24;
/// Fading of the sums: they lose 1/16 with every line.
const FADING_SHIFT: u32 = 4;
/// Length of the running means along the line: about 8 matches.
const MEAN_SHIFT: u32 = 3;

/// Rows of grey around a row that is matched, in stored order.
#[derive(Debug, Clone, Copy)]
pub(super) struct GreyRows<'a> {
    /// The row of the reference view.
    pub(super) own: &'a [u8],
    /// Rows of the other view: above the row, at it, and below it.
    pub(super) others: [&'a [u8]; 3],
}

/// A match whose levels are compared, as positions in the stored order of each view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// Position in the row of the reference view.
    pub(super) position: usize,
    /// Position in the row of the other view, in whole pixels.
    pub(super) other_position: usize,
    /// Sub-pixel step from that position to the match, 1/16 px, in stored order.
    pub(super) subpixel_q4: i16,
}

/// The running estimate of the offset.
#[derive(Debug)]
pub(super) struct Alignment {
    offset_q4: i8,
    offset_max_q4: u8,
    /// Number of rows still to come whose lines were not all moved by the current offset.
    settling_lines: u8,
    settling_lines_max: u8,
    /// Decayed sum of `g^2`, where the gradient `g` is the line below less the line above.
    squares: i64,
    /// Decayed sum of `g` times the difference of the levels.
    products: i64,
}

impl Alignment {
    /// An estimate of 0, limited to `offset_max_q4`, 1/16 line, at most 16, in either direction.
    /// `support` is that of the patterns.
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

    /// The offset by which the lines of the other view lie too low, 1/16 line.
    pub(super) fn offset_q4(&self) -> i8 {
        self.offset_q4
    }

    /// Learns from the matches of a row, given in the order of the line. `conversion` is that of
    /// grey levels.
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
            // Each square is at most (16 * 64)^2 / 64, and fewer than 2^15 matches of a line are
            // used.
            squares += (gradient_q3 * gradient_q3) >> (2 * MEAN_SHIFT);
            products += (gradient_q3 * difference_q3) >> (2 * MEAN_SHIFT);
        }
        self.squares += i64::from(squares) - (self.squares >> FADING_SHIFT);
        self.products += i64::from(products) - (self.products >> FADING_SHIFT);
        self.conclude();
    }

    /// Changes the offset if the sums show a clear deviation. One division per line.
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

/// The level of the reference view less that of the match in the reference camera's exposure,
/// and the line below the match less the line above it. `None` at the edge of the row.
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
    let between = ((after - before) * i32::from(found.subpixel_q4)) >> 5;
    let matched = (level + between).clamp(0, 255) as u8;
    Some((own - i32::from(conversion.apply(matched)), below - above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sgm::exposure::Exposure;
    use std::vec::Vec;

    const WIDTH: usize = 200;
    const SUPPORT: Support = Support { x_px: 8, y_px: 3 };

    /// A texture with a known gradient across lines, and shading along them.
    fn level(x: usize, y_px: f64) -> f64 {
        let wave = (x as f64 * 0.9).sin() * (y_px * 0.7 + x as f64 * 1.3).sin();
        120.0 + 30.0 * wave + 0.2 * x as f64
    }

    /// Offsets after each of `lines` lines of views that differ by `offset_px` and by a gain that
    /// changes along the line.
    fn learned_q4(offset_px: f64, most_q4: u8, gain_slope: f64, lines: usize) -> Vec<i8> {
        let mut alignment = Alignment::new(most_q4, SUPPORT);
        let mut offsets_q4 = Vec::new();
        for y in 0..lines {
            // The lines are moved at once, so the remaining offset is less by the one learned.
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
                subpixel_q4: 0,
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
