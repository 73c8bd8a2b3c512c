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
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
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

    /// The estimate in floating point, whose values are whole: floors where the integers shift.
    #[derive(Debug, Default)]
    struct Expected {
        offset_q4: f64,
        settling_lines: u32,
        squares: f64,
        products: f64,
    }

    impl Expected {
        fn learn(&mut self, pairs: &[(f64, f64)], most_q4: f64) {
            if self.settling_lines > 0 {
                self.settling_lines -= 1;
                return;
            }
            let mut means = [0.0; 2];
            let mut sums = [0.0; 2];
            for &(difference, gradient) in pairs {
                if difference.abs() > 24.0 || gradient.abs() > 64.0 {
                    continue;
                }
                let centred = [difference, gradient].map(|value| 8.0 * value);
                means[0] += difference - (means[0] / 8.0_f64).floor();
                means[1] += gradient - (means[1] / 8.0_f64).floor();
                let [difference, gradient] = [centred[0] - means[0], centred[1] - means[1]];
                sums[0] += (gradient * gradient / 64.0).floor();
                sums[1] += (gradient * difference / 64.0).floor();
            }
            self.squares += sums[0] - (self.squares / 16.0).floor();
            self.products += sums[1] - (self.products / 16.0).floor();
            self.conclude(most_q4);
        }

        fn conclude(&mut self, most_q4: f64) {
            if self.squares < 30_000.0 {
                return;
            }
            let change_q8 = (self.products * 512.0 / self.squares)
                .floor()
                .clamp(-256.0, 256.0);
            if change_q8.abs() < 24.0 {
                return;
            }
            let moved_q4 = (self.offset_q4 + (change_q8 + 8.0) / 16.0).floor();
            self.offset_q4 = moved_q4.clamp(-most_q4, most_q4);
            self.settling_lines = u32::from(SUPPORT.y_px) + 2;
            self.squares = 0.0;
            self.products = 0.0;
        }

        fn assert_equals(&self, alignment: &Alignment, what: &str) {
            let found = [
                f64::from(alignment.offset_q4()),
                f64::from(alignment.settling_lines),
                alignment.squares as f64,
                alignment.products as f64,
            ];
            let settling = f64::from(self.settling_lines);
            let expected = [self.offset_q4, settling, self.squares, self.products];
            assert_eq!(found, expected, "{what}");
        }
    }

    #[test]
    fn random_lines_are_learned_as_in_floating_point() {
        for seed in 0..60 {
            let mut random = Pcg32::seed_from_u64(seed);
            let most_q4 = [0, 5, 16][seed as usize % 3];
            let mut alignment = Alignment::new(most_q4, SUPPORT);
            let mut expected = Expected::default();
            let conversion = LevelConversion {
                gain_q12: [4096, 3200, 4900][seed as usize / 3 % 3],
                offset_q12: [0, 28_000, -49_000][seed as usize / 9 % 3],
                dead_zone: 0,
            };
            for line in 0..40 {
                // A step between the lines that follows the level, so that an offset shows.
                let width = 30 + random.next_u32() as usize % 60;
                let mut row = |around: &dyn Fn(usize) -> i32| -> Vec<u8> {
                    let mut noise = |x| around(x) + (random.next_u32() % 9) as i32 - 4;
                    (0..width).map(|x| noise(x).clamp(0, 255) as u8).collect()
                };
                let slope = |x: usize| [-40, 25, 62, 9][x / 2 % 4];
                let middle = row(&|x| 128 + (x as i32 % 5) * 8);
                let above = row(&|x| i32::from(middle[x]) - slope(x) / 2);
                let below = row(&|x| i32::from(middle[x]) + slope(x) / 2);
                let own = row(&|x| {
                    i32::from(conversion.apply(middle[x])) + slope(x) * (seed as i32 % 7 - 3) / 8
                });
                let matches: Vec<Match> = (0..width + 2)
                    .map(|position| Match {
                        position,
                        // At times beyond either end of the row.
                        other_position: (position + 1).wrapping_sub(random.next_u32() as usize % 3),
                        subpixel_q4: (random.next_u32() % 17) as i16 - 8,
                    })
                    .collect();
                let pairs: Vec<(f64, f64)> = matches
                    .iter()
                    .filter(|found| {
                        let inner = 1..width - 1;
                        found.position < width && inner.contains(&found.other_position)
                    })
                    .map(|found| {
                        let at = found.other_position;
                        let side = f64::from(middle[at + 1]) - f64::from(middle[at - 1]);
                        let between = (side * f64::from(found.subpixel_q4) / 32.0).floor();
                        let level = (f64::from(middle[at]) + between).clamp(0.0, 255.0);
                        let level = f64::from(conversion.apply(level as u8));
                        let gradient = f64::from(below[at]) - f64::from(above[at]);
                        (f64::from(own[found.position]) - level, gradient)
                    })
                    .collect();
                let rows = GreyRows {
                    own: &own,
                    others: [&above, &middle, &below],
                };
                alignment.learn(matches.into_iter(), rows, &conversion);
                expected.learn(&pairs, f64::from(most_q4));
                expected.assert_equals(&alignment, &std::format!("seed {seed}, line {line}"));
            }
            assert!(
                most_q4 == 0 || seed % 7 == 3 || expected.offset_q4 != 0.0,
                "seed {seed}"
            );
            alignment.reset();
            Expected::default().assert_equals(&alignment, "after a reset");
        }
    }

    #[test]
    fn the_offset_changes_from_the_stated_evidence_and_deviation_on() {
        for squares in [EVIDENCE_MIN - 1, EVIDENCE_MIN, EVIDENCE_MIN + 1, 1 << 20] {
            for change_q8 in [-300, -25, -24, -23, -1, 0, 1, 23, 24, 25, 40, 255, 256, 300] {
                for more in [-1, 0, 1] {
                    let products = squares * change_q8 / 512 + more;
                    let mut alignment = Alignment {
                        offset_q4: 3,
                        squares,
                        products,
                        ..Alignment::new(9, SUPPORT)
                    };
                    let mut expected = Expected {
                        offset_q4: 3.0,
                        squares: squares as f64,
                        products: products as f64,
                        ..Expected::default()
                    };
                    alignment.conclude();
                    expected.conclude(9.0);
                    expected.assert_equals(&alignment, &std::format!("{squares} {products}"));
                }
            }
        }
    }
}
