//! Alignment: the vertical offset between the two views, learned from matches.
//!
//! Two cameras that are rectified by hand, or not at all, seldom have their lines at the same
//! height to a fraction of a line, and a fraction is enough to spoil patterns of fine texture. If one
//! camera is turned against the other, the offset also changes along the line. It is estimated from the
//! matches of the lines above: at each match, it is the difference between the levels of the two views,
//! divided by the vertical gradient; the estimate, a shift and a tilt of the line, is a least-squares fit
//! over many matches. The lines of the other view that are still to come are moved by it.
//!
//! The running mean along the line is subtracted from differences and gradients, so that neither
//! shading nor a gain that changes along the line is mistaken for an offset.

use crate::kernel::LevelConversion;
use crate::rows::{OFFSET_BITS, RowOffsets};

/// Largest difference of levels that is used: larger ones stem from wrong matches or occlusion
/// rather than from the offset.
const DIFFERENCE_MAX: u32 = 24;
/// Largest difference between the lines above and below that is used: larger ones are edges, at
/// which levels do not follow the gradient.
const GRADIENT_MAX: u32 = 64;
/// Smallest sum of the squares of the gradients from which offsets are estimated; the noise of a
/// camera then makes them uncertain by about 1/16 line.
const EVIDENCE_MIN: i64 = 30_000;
/// Weight of what is known without matches, as a square of gradients: that the offset does not change, in the
/// middle and at a quarter of the width from it.
const PRIOR: i64 = 15_000;
/// Smallest change of the offset at either end of the line, 24/256 line: more than that uncertainty.
const CHANGE_MIN_Q24: i64 = 24 << (OFFSET_BITS - 8);
/// Fading of the sums: they lose 1/8 with every line.
const FADING_SHIFT: u32 = 3;
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

/// Sums over the matches of lines: of the squares of the gradients, where a gradient is the line below less
/// the line above, and of the products of gradients and differences; each also with the position x of the
/// match in the other view, from the middle of its line.
#[derive(Debug, Default)]
struct Sums {
    squares: i64,
    squares_x: i64,
    squares_xx: i64,
    products: i64,
    products_x: i64,
}

impl Sums {
    /// The sums of the matches of a row, given in the order of the line. `conversion` is that of grey
    /// levels.
    fn of(
        matches: impl Iterator<Item = Match>,
        rows: GreyRows<'_>,
        conversion: &LevelConversion,
    ) -> Self {
        let middle = (rows.own.len() / 2) as i32;
        let (mut squares, mut products) = (0_i32, 0_i32);
        let (mut squares_x, mut squares_xx, mut products_x) = (0_i64, 0_i64, 0_i64);
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
            // Each is at most (16 * 64)^2 / 64, and fewer than 2^15 matches of a line are used.
            let square = (gradient_q3 * gradient_q3) >> (2 * MEAN_SHIFT);
            let product = (gradient_q3 * difference_q3) >> (2 * MEAN_SHIFT);
            // Within 2^15 of the middle.
            let x = found.other_position as i32 - middle;
            squares += square;
            products += product;
            squares_x += i64::from(square) * i64::from(x);
            squares_xx += i64::from(square * x) * i64::from(x);
            products_x += i64::from(product) * i64::from(x);
        }
        Self {
            squares: squares.into(),
            squares_x,
            squares_xx,
            products: products.into(),
            products_x,
        }
    }

    /// Adds the sums of a row to those of the rows above, which fade.
    fn add(&mut self, row: &Self) {
        for (sum, row) in [
            (&mut self.squares, row.squares),
            (&mut self.squares_x, row.squares_x),
            (&mut self.squares_xx, row.squares_xx),
            (&mut self.products, row.products),
            (&mut self.products_x, row.products_x),
        ] {
            *sum += row - (*sum >> FADING_SHIFT);
        }
    }

    /// By how much the pixels of rows of `width` px lie too low, by least squares. One match more says that
    /// they do not, so that little evidence makes no large tilt.
    fn fit(&self, width: usize) -> RowOffsets {
        let quarter = (width / 4) as i64;
        let [n, x, xx, p, px] = [
            self.squares + PRIOR,
            self.squares_x,
            self.squares_xx + PRIOR * quarter * quarter,
            // Gradients are over two lines.
            2 * self.products,
            2 * self.products_x,
        ]
        .map(|sum| sum as f64);
        // The divisors are positive: the prior adds to `n` and `xx`, and `n xx` is never less than `x x`. Few
        // divisions: they are software on most boards.
        let mean = 1.0 / n;
        let x_mean = x * mean;
        let tilt = (px - p * x_mean) / (xx - x * x_mean);
        let shift = (p - x * tilt) * mean;
        let [shift_q24, tilt_q24] =
            [shift, tilt].map(|lines| (lines * f64::from(1 << OFFSET_BITS)) as i32);
        RowOffsets {
            shift_q24,
            tilt_q24,
        }
    }
}

/// The running estimate of the offsets.
#[derive(Debug)]
pub(super) struct Alignment {
    offsets: RowOffsets,
    width: usize,
    shift_max_q24: i32,
    /// Number of rows still to come whose lines were not all moved by the current offsets.
    settling_lines: u32,
    settling_lines_max: u32,
    sums: Sums,
}

impl Alignment {
    /// An estimate of 0 for lines of `width` px. Offsets are limited to `lines_max` lines, at most 4, in either
    /// direction; `lines_ahead` lines come before a row is matched.
    pub(super) fn new(width: usize, lines_max: u8, lines_ahead: u32) -> Self {
        Self {
            offsets: RowOffsets::NONE,
            width,
            shift_max_q24: i32::from(lines_max) << OFFSET_BITS,
            settling_lines: 0,
            settling_lines_max: lines_ahead + 2,
            sums: Sums::default(),
        }
    }

    /// Forgets the frame.
    pub(super) fn reset(&mut self) {
        self.offsets = RowOffsets::NONE;
        self.settling_lines = 0;
        self.sums = Sums::default();
    }

    /// The offsets of the pixels of the other view, in its stored order.
    pub(super) fn offsets(&self) -> RowOffsets {
        self.offsets
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
        self.sums.add(&Sums::of(matches, rows, conversion));
        if self.sums.squares >= EVIDENCE_MIN {
            self.conclude();
        }
    }

    /// Changes the offsets if the sums show a clear deviation. Apart, for its floating point is software, and
    /// large, on most boards.
    #[inline(never)]
    fn conclude(&mut self) {
        let change = self.sums.fit(self.width);
        let half = (self.width / 2) as i64;
        let (shift, at_end) = (
            i64::from(change.shift_q24),
            i64::from(change.tilt_q24) * half,
        );
        let largest = (shift + at_end).abs().max((shift - at_end).abs());
        if largest < CHANGE_MIN_Q24 {
            return;
        }
        let tilt_max_q24 = RowOffsets::tilt_max_q24(self.width);
        let sum = |offset: i32, change: i32, most: i32| {
            // Not `clamp`, which panics unless its bounds are in order.
            offset.saturating_add(change).min(most).max(-most)
        };
        self.offsets = RowOffsets {
            shift_q24: sum(self.offsets.shift_q24, change.shift_q24, self.shift_max_q24),
            tilt_q24: sum(self.offsets.tilt_q24, change.tilt_q24, tilt_max_q24),
        };
        self.settling_lines = self.settling_lines_max;
        self.sums = Sums::default();
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
    const LINE: f64 = (1 << OFFSET_BITS) as f64;

    /// A texture with a known gradient across lines, and shading along them.
    fn level(x: usize, y_px: f64) -> f64 {
        let wave = (x as f64 * 0.9).sin() * (y_px * 0.7 + x as f64 * 1.3).sin();
        120.0 + 30.0 * wave + 0.2 * x as f64
    }

    /// Offsets at either end of the line, px, after each of `lines` lines of views that differ by
    /// `ends_px` and by a gain that changes along the line.
    fn learned_px(
        ends_px: [f64; 2],
        lines_max: u8,
        gain_slope: f64,
        lines: usize,
    ) -> Vec<[f64; 2]> {
        let mut alignment = Alignment::new(WIDTH, lines_max, 5);
        let place = |x: usize| x as f64 / WIDTH as f64;
        let mut found = Vec::new();
        for y in 0..lines {
            // The lines are moved at once, so that the remaining offset is less by the one learned.
            let learned = alignment.offsets();
            let left_px = |x: usize| {
                let [start, end] = ends_px;
                let from_middle = x as f64 - (WIDTH / 2) as f64;
                let q24 = f64::from(learned.shift_q24) + f64::from(learned.tilt_q24) * from_middle;
                start + (end - start) * place(x) - q24 / LINE
            };
            let row = |dy: f64, slope: f64, offset_px: &dyn Fn(usize) -> f64| -> Vec<u8> {
                let gain = |x: usize| 1.0 + slope * (place(x) - 0.5);
                (0..WIDTH)
                    .map(|x| (level(x, y as f64 + dy - offset_px(x)) * gain(x)).round() as u8)
                    .collect()
            };
            let own = row(0.0, 0.0, &|_| 0.0);
            let others = [-1.0, 0.0, 1.0].map(|dy| row(dy, gain_slope, &left_px));
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
            let RowOffsets {
                shift_q24,
                tilt_q24,
            } = alignment.offsets();
            let half = f64::from(tilt_q24) * (WIDTH / 2) as f64;
            found.push([-half, half].map(|end| (f64::from(shift_q24) + end) / LINE));
        }
        found
    }

    #[test]
    fn offsets_at_either_end_are_found() {
        for ends_px in [
            [1.0, 1.0],
            [-0.6, -0.6],
            [0.25, 0.25],
            [-0.8, 0.8],
            [0.9, -0.1],
            [0.0, -0.7],
        ] {
            let found = learned_px(ends_px, 2, 0.0, 150);
            let last = *found.last().unwrap();
            for (found, expected) in last.into_iter().zip(ends_px) {
                // Changes below 24/256 line are not made.
                assert!((found - expected).abs() < 0.14, "{last:?} for {ends_px:?}");
            }
        }
    }

    #[test]
    fn offsets_stay_within_their_bound() {
        let end = |offset_px, lines_max| {
            let found = learned_px([offset_px; 2], lines_max, 0.0, 150);
            let [start, end] = *found.last().unwrap();
            0.5 * (start + end)
        };
        for side in [-1.0, 1.0] {
            // The shift of lines that lie lower by a line and a half ends at one.
            assert_eq!(end(1.5 * side, 1), side);
            assert_eq!(end(0.8 * side, 0), 0.0);
        }
        let mut tilted = Alignment::new(WIDTH, 4, 5);
        for _ in 0..20 {
            tilted.sums = Sums {
                squares: 1 << 20,
                squares_xx: 1 << 30,
                products_x: 1 << 30,
                ..Sums::default()
            };
            tilted.conclude();
        }
        let most = RowOffsets::tilt_max_q24(WIDTH);
        assert_eq!(tilted.offsets().tilt_q24, most);
        assert!(i64::from(most) * (WIDTH as i64 / 2 + 8) <= 1 << 27);
    }

    #[test]
    fn a_gain_that_changes_along_the_line_is_no_offset() {
        let found = learned_px([0.0; 2], 2, 0.2, 200);
        assert!(found.iter().all(|ends| *ends == [0.0; 2]), "{found:?}");
    }

    /// The fit of sums of single matches is the one that solves the normal equations, with the match
    /// that stands for the prior.
    #[test]
    fn the_fit_is_that_of_least_squares() {
        for (shift, tilt) in [(0.3, 0.004), (-0.9, 0.0), (0.0, -0.01)] {
            let mut sums = Sums::default();
            for x in -100..100_i64 {
                let square = 400 + (x * x) % 97;
                let product = (square as f64 * (shift + tilt * x as f64) / 2.0).round() as i64;
                sums.squares += square;
                sums.squares_x += square * x;
                sums.squares_xx += square * x * x;
                sums.products += product;
                sums.products_x += product * x;
            }
            // What is left of both equations.
            let fit = sums.fit(WIDTH);
            let [a, b] = [fit.shift_q24, fit.tilt_q24].map(|q24| f64::from(q24) / LINE);
            let [n, x, xx, p, px] = [
                sums.squares + PRIOR,
                sums.squares_x,
                sums.squares_xx + PRIOR * 50 * 50,
                2 * sums.products,
                2 * sums.products_x,
            ]
            .map(|sum| sum as f64);
            assert!((n * a + x * b - p).abs() < 1e-4 * n, "{shift} {tilt}");
            assert!((x * a + xx * b - px).abs() < 1e-4 * xx, "{shift} {tilt}");
            assert!(
                (a - shift).abs() < 0.2 * shift.abs() + 1e-3,
                "{a} for {shift}"
            );
            assert!((b - tilt).abs() < 0.2 * tilt.abs() + 5e-5, "{b} for {tilt}");
        }
    }

    #[test]
    fn offsets_change_from_the_stated_evidence_and_deviation_on() {
        let after = |squares: i64, change_q8: f64| {
            let mut alignment = Alignment::new(WIDTH, 1, 5);
            // The prior takes its part.
            let products = (squares + PRIOR) as f64 * change_q8 / 512.0;
            alignment.sums = Sums {
                squares,
                products: products.round() as i64,
                ..Sums::default()
            };
            alignment.learn(
                core::iter::empty(),
                GreyRows {
                    own: &[],
                    others: [&[]; 3],
                },
                &Exposure::new().conversion(0),
            );
            alignment.offsets() != RowOffsets::NONE
        };
        // The sums fade by an eighth before they are looked at.
        let least = EVIDENCE_MIN * 8 / 7;
        assert!(!after(least - 8, 100.0) && after(least + 8, 100.0));
        // The products fade, the prior does not: 24 q8 need more before.
        let faded =
            |change_q8: f64| change_q8 * 8.0 / 7.0 * (100_000.0 * 7.0 / 8.0 + 15_000.0) / 115_000.0;
        for side in [-1.0, 1.0] {
            assert!(!after(100_000, side * faded(23.9)));
            assert!(after(100_000, side * faded(24.1)));
        }
    }
}
