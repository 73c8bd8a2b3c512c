//! Alignment: the vertical offset between the two views, learned from matches.
//!
//! Two cameras that are rectified by hand, or not at all, seldom have their lines at the same
//! height to a fraction of a line, and a fraction is enough to spoil patterns of fine texture. If one
//! camera is turned against the other, the offset also changes along the line. It is estimated from the
//! matches of the lines above: at each match, it is the difference between the levels of the two views,
//! divided by the vertical gradient; the estimate, a shift and a tilt of the line, is a least-squares fit
//! over many matches. The lines of the other view that are still to come are moved by it.
//!
//! At the end of a frame, a plane is fitted to the matches of all its lines ([`frame`]). A frame that begins
//! with it has its first lines in place.
//!
//! The running mean along the line is subtracted from differences and gradients, so that neither
//! shading nor a gain that changes along the line is mistaken for an offset.

mod frame;
mod sums;

use self::frame::FrameFit;
use self::sums::Sums;
pub(super) use self::sums::{GreyRows, Match};
use crate::kernel::LevelConversion;
use crate::rows::{LineOffsets, OFFSET_BITS, RowOffsets};

/// Smallest sum of the squares of the gradients from which offsets are estimated; the noise of a
/// camera then makes them uncertain by about 1/16 line.
const EVIDENCE_MIN: i64 = 30_000;
/// Weight of what is known without matches, as a square of gradients: that the offset does not change, in the
/// middle and at a quarter of the width from it.
const PRIOR: i64 = 15_000;
/// Smallest change of the offset at either end of the line, 24/256 line: more than that uncertainty.
const CHANGE_MIN_Q24: u64 = 24 << (OFFSET_BITS - 8);

/// The running estimate of the offsets, in the stored order of the other view.
#[derive(Debug)]
pub(super) struct Alignment {
    /// What the frame began with.
    begun: LineOffsets,
    /// By how much the newest lines differ from that.
    deviation: RowOffsets,
    /// What the last whole frame taught.
    learned: LineOffsets,
    width: usize,
    shift_max_q24: i32,
    /// Number of rows still to come whose lines were not all moved by the current deviation.
    settling_lines: u32,
    settling_lines_max: u32,
    sums: Sums,
    frame: FrameFit,
}

impl Alignment {
    /// The estimate for frames of `width` px that begin with the offsets `begun`. Offsets are limited to
    /// `lines_max` lines, at most 4, in either direction; `lines_ahead` lines come before a row is matched.
    pub(super) fn new(width: usize, lines_max: u8, lines_ahead: u32, begun: LineOffsets) -> Self {
        Self {
            begun,
            deviation: RowOffsets::NONE,
            learned: begun,
            width,
            shift_max_q24: i32::from(lines_max) << OFFSET_BITS,
            settling_lines: 0,
            settling_lines_max: lines_ahead + 2,
            sums: Sums::default(),
            frame: FrameFit::default(),
        }
    }

    /// Forgets the frame.
    pub(super) fn reset(&mut self) {
        self.deviation = RowOffsets::NONE;
        self.settling_lines = 0;
        self.sums = Sums::default();
        self.frame = FrameFit::default();
    }

    /// Lets frames begin with these offsets, after a reset.
    pub(super) fn begin_with(&mut self, begun: LineOffsets) {
        self.begun = begun;
        self.learned = begun;
    }

    /// What the last whole frame taught, or else what frames begin with.
    pub(super) fn learned(&self) -> LineOffsets {
        self.learned
    }

    /// Takes what the frame taught, if anything, which has come to its end.
    // Apart, so that its floating point takes no stack while rows are matched.
    #[inline(never)]
    pub(super) fn end_frame(&mut self) {
        if self.frame.lines() == 0 {
            return;
        }
        let fit = self.frame.fit(self.begun, self.width);
        let change = fit.less(self.begun);
        self.learned = if change.largest_q24(self.width, self.frame.lines()) < CHANGE_MIN_Q24 {
            self.begun
        } else {
            fit
        };
    }

    /// The offsets of the pixels of `line` of the other view.
    pub(super) fn offsets(&self, line: u32) -> RowOffsets {
        self.bounded(self.begun.row(line), self.deviation)
    }

    /// The sum of offsets, within the bounds of both.
    fn bounded(&self, offsets: RowOffsets, change: RowOffsets) -> RowOffsets {
        let sum = |offset: i32, change: i32, most: i32| {
            // Not `clamp`, which panics unless its bounds are in order.
            offset.saturating_add(change).min(most).max(-most)
        };
        let tilt_max_q24 = RowOffsets::tilt_max_q24(self.width);
        RowOffsets {
            shift_q24: sum(offsets.shift_q24, change.shift_q24, self.shift_max_q24),
            tilt_q24: sum(offsets.tilt_q24, change.tilt_q24, tilt_max_q24),
        }
    }

    /// Learns from the matches of the row of `line`, given in the order of the line. `conversion` is that of
    /// grey levels.
    pub(super) fn learn(
        &mut self,
        line: u32,
        matches: impl Iterator<Item = Match>,
        rows: GreyRows<'_>,
        conversion: &LevelConversion,
    ) {
        if self.settling_lines > 0 {
            self.settling_lines -= 1;
            return;
        }
        let offsets = self.offsets(line);
        let row = Sums::of(matches, rows, conversion, offsets, self.shift_max_q24);
        self.frame.add(line, &row, offsets);
        self.sums.add(&row);
        if self.sums.squares >= EVIDENCE_MIN {
            self.conclude();
        }
    }

    /// Changes the offsets if the sums show a clear deviation. Apart, for its floating point is software, and
    /// large, on most boards.
    #[inline(never)]
    fn conclude(&mut self) {
        let change = fit(&self.sums, self.width);
        if change.largest_q24(self.width) < CHANGE_MIN_Q24 {
            return;
        }
        self.deviation = self.bounded(self.deviation, change);
        self.settling_lines = self.settling_lines_max;
        self.sums = Sums::default();
    }
}

/// By how much the pixels of rows of `width` px lie too low, by least squares over the matches in `sums`. One
/// match more says that they do not, so that little evidence makes no large tilt.
fn fit(sums: &Sums, width: usize) -> RowOffsets {
    let quarter = (width / 4) as i64;
    let [n, x, xx, p, px] = [
        sums.squares + PRIOR,
        sums.squares_x,
        sums.squares_xx + PRIOR * quarter * quarter,
        // Gradients are over two lines.
        2 * sums.products,
        2 * sums.products_x,
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

    /// Shows `alignment` `lines` lines of views whose offset, px, is `offset_px` at a column and a line, and which
    /// differ by a gain that changes along the line.
    fn show(
        alignment: &mut Alignment,
        offset_px: impl Fn(usize, usize) -> f64,
        gain_slope: f64,
        lines: usize,
        mut after_line: impl FnMut(RowOffsets),
    ) {
        let place = |x: usize| x as f64 / WIDTH as f64;
        for y in 0..lines {
            // The lines are moved at once, so that the remaining offset is less by the one learned.
            let offsets = alignment.offsets(y as u32);
            let left_px = |x: usize| offset_px(x, y) - at_px(offsets, x);
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
            let conversion = Exposure::new().conversion(0);
            alignment.learn(y as u32, matches, rows, &conversion);
            after_line(alignment.offsets(y as u32));
        }
    }

    /// The offset at a position, px.
    fn at_px(offsets: RowOffsets, x: usize) -> f64 {
        let from_middle = x as f64 - (WIDTH / 2) as f64;
        (f64::from(offsets.shift_q24) + f64::from(offsets.tilt_q24) * from_middle) / LINE
    }

    fn alignment(lines_max: u8) -> Alignment {
        Alignment::new(WIDTH, lines_max, 5, LineOffsets::NONE)
    }

    /// Offsets at either end of the line, px, after each of `lines` lines of views that differ by
    /// `ends_px` and by a gain that changes along the line.
    fn learned_px(
        ends_px: [f64; 2],
        lines_max: u8,
        gain_slope: f64,
        lines: usize,
    ) -> Vec<[f64; 2]> {
        let [start, end] = ends_px;
        let offset_px = |x: usize, _| start + (end - start) * x as f64 / WIDTH as f64;
        let mut found = Vec::new();
        show(
            &mut alignment(lines_max),
            offset_px,
            gain_slope,
            lines,
            |offsets| found.push([0, WIDTH].map(|x| at_px(offsets, x))),
        );
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
        let mut tilted = alignment(4);
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
        assert_eq!(tilted.offsets(0).tilt_q24, most);
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
            let fit = fit(&sums, WIDTH);
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
            let mut alignment = alignment(1);
            // The prior takes its part.
            let products = (squares + PRIOR) as f64 * change_q8 / 512.0;
            alignment.sums = Sums {
                squares,
                products: products.round() as i64,
                ..Sums::default()
            };
            alignment.learn(
                0,
                core::iter::empty(),
                GreyRows {
                    own: &[],
                    others: [&[]; 3],
                },
                &Exposure::new().conversion(0),
            );
            alignment.offsets(0) != RowOffsets::NONE
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

    /// Frame by frame, the plane of offsets comes nearer to the true one, and the first line of a frame that
    /// begins with it is in place.
    #[test]
    fn a_frame_begins_with_the_plane_that_the_last_one_showed() {
        const LINES: usize = 150;
        for [shift, tilt, stretch] in [
            [0.4, 0.0, 0.0],
            [-0.2, 0.006, 0.0],
            [0.7, -0.002, -0.009],
            [-0.9, 0.001, 0.012],
        ] {
            let true_px = |x: usize, y: usize| {
                shift + tilt * (x as f64 - (WIDTH / 2) as f64) + stretch * y as f64
            };
            let mut alignment = alignment(2);
            for _ in 0..3 {
                show(&mut alignment, true_px, 0.0, LINES, |_| ());
                alignment.end_frame();
                let learned = alignment.learned();
                alignment.begin_with(learned);
                alignment.reset();
            }
            for (x, y) in [(0, 0), (WIDTH, 0), (0, LINES), (WIDTH, LINES)] {
                let found = at_px(alignment.learned().row(y as u32), x);
                let expected = true_px(x, y);
                assert!(
                    (found - expected).abs() < 0.12,
                    "{found} for {expected} at {x}, {y} of {shift}, {tilt}, {stretch}"
                );
            }
        }
    }

    #[test]
    fn a_frame_without_matches_or_offsets_teaches_nothing() {
        let begun = LineOffsets {
            shift_q24: 1 << 23,
            tilt_q24: -2_000,
            stretch_q24: 3_000,
        };
        let mut alignment = Alignment::new(WIDTH, 2, 5, begun);
        alignment.end_frame();
        assert_eq!(alignment.learned(), begun);
        // Where everything is in its place, or where less is wrong than noise may make.
        show(
            &mut alignment,
            |x, y| at_px(begun.row(y as u32), x),
            0.0,
            150,
            |_| (),
        );
        alignment.end_frame();
        assert_eq!(alignment.learned(), begun);
        show(
            &mut alignment,
            |x, y| 0.05 + at_px(begun.row(y as u32), x),
            0.0,
            150,
            |_| (),
        );
        alignment.end_frame();
        assert_eq!(alignment.learned(), begun);
    }
}
