//! The fit of a frame: the plane of offsets that its matches show.

use super::sums::Sums;
use crate::rows::{LineOffsets, RowOffsets};

/// Weight of what the frame began with, as a square of gradients: that offsets are still the same, in the middle
/// of the frame and at a quarter of its width and of its height from there.
const PRIOR: f64 = 60_000.0;
/// One line, in units of [`LineOffsets`].
const LINE: f64 = LineOffsets::LINE_Q24 as f64;

/// Sums over the matches of a frame; positions x are from the middle of the line, lines y from the first. Of
/// single precision, which is enough for 1/1000 line, and takes little of the stack.
#[derive(Debug, Default)]
pub(super) struct FrameFit {
    /// Number of lines down to the newest row.
    lines: u32,
    /// Squares of gradients: their sum, and those with x, y, and products of both.
    squares: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
    /// Squares of gradients with the offset of the match, and with x and y besides.
    offset: f32,
    offset_x: f32,
    offset_y: f32,
}

impl FrameFit {
    /// Number of lines down to the newest row.
    pub(super) fn lines(&self) -> u32 {
        self.lines
    }

    /// Adds the row of `line`, whose pixels were moved by `offsets`: the offset of a match is that and what its
    /// levels show.
    // Apart, for floating point is software, and large, on some boards.
    #[inline(never)]
    pub(super) fn add(&mut self, line: u32, row: &Sums, offsets: RowOffsets) {
        self.lines = line.saturating_add(1);
        let y = line as f32;
        let [shift, tilt] =
            [offsets.shift_q24, offsets.tilt_q24].map(|q24| q24 as f32 * (1.0 / LINE as f32));
        let [n, x, xx] = [row.squares, row.squares_x, row.squares_xx].map(|sum| sum as f32);
        // Gradients are over two lines.
        let shown = [2 * row.products, 2 * row.products_x].map(|sum| sum as f32);
        let offset = shown[0] + shift * n + tilt * x;
        self.squares += n;
        self.x += x;
        self.y += y * n;
        self.xx += xx;
        self.xy += y * x;
        self.yy += y * y * n;
        self.offset += offset;
        self.offset_x += shown[1] + shift * x + tilt * xx;
        self.offset_y += y * offset;
    }

    /// The plane of lines of `width` px, by least squares over the matches and four that are where the frame
    /// began: left and right of the middle, above and below it.
    pub(super) fn fit(&self, begun: LineOffsets, width: usize) -> LineOffsets {
        let quarter_x = (width / 4).max(1) as f64;
        let quarter_y = f64::from((self.lines / 4).max(1));
        let [shift, tilt, stretch] =
            [begun.shift_q24, begun.tilt_q24, begun.stretch_q24].map(|q24| f64::from(q24) / LINE);
        let [squares, x, y, xx, xy, yy] =
            [self.squares, self.x, self.y, self.xx, self.xy, self.yy].map(f64::from);
        let [offset, offset_x, offset_y] =
            [self.offset, self.offset_x, self.offset_y].map(f64::from);
        // Sums with the prior, whose matches lie around (0, y).
        let n = squares + PRIOR;
        let y_mean = if squares > 0.0 {
            y / squares
        } else {
            quarter_y
        };
        let x_mean = x / n;
        let prior_x = PRIOR * quarter_x * quarter_x;
        let prior_y = PRIOR * quarter_y * quarter_y;
        let all_offset = offset + PRIOR * (shift + stretch * y_mean);
        // Sums of deviations from the means.
        let xx = xx + prior_x - x * x_mean;
        let xy = xy - x * y_mean;
        let yy = yy - y * y_mean + prior_y;
        let offset_x = offset_x + prior_x * tilt - all_offset * x_mean;
        let offset_y = offset_y - offset * y_mean + prior_y * stretch;
        // Positive, for so are the sums of squares of deviations, of which the priors are a part.
        let determinant = xx * yy - xy * xy;
        let tilt = (offset_x * yy - offset_y * xy) / determinant;
        let stretch = (offset_y * xx - offset_x * xy) / determinant;
        let shift = all_offset / n - tilt * x_mean - stretch * y_mean;
        let [shift_q24, tilt_q24, stretch_q24] =
            [shift, tilt, stretch].map(|lines| (lines * LINE) as i32);
        LineOffsets {
            shift_q24,
            tilt_q24,
            stretch_q24,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    const WIDTH: usize = 120;

    /// Solves three linear equations by Cramer's rule.
    fn solve(rows: [[f64; 4]; 3]) -> [f64; 3] {
        let determinant = |columns: [usize; 3]| {
            let [a, b, c] = rows.map(|row| columns.map(|column| row[column]));
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        let all = determinant([0, 1, 2]);
        [[3, 1, 2], [0, 3, 2], [0, 1, 3]].map(|columns| determinant(columns) / all)
    }

    /// The fit is the plane that solves the normal equations of all matches and of the four of the prior, one
    /// match at a time.
    #[test]
    fn the_fit_is_that_of_least_squares() {
        for seed in 0..20 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |bound: u32| random.next_u32() % bound;
            let begun = LineOffsets {
                shift_q24: below(1 << 24) as i32 - (1 << 23),
                tilt_q24: below(1 << 16) as i32 - (1 << 15),
                stretch_q24: below(1 << 16) as i32 - (1 << 15),
            };
            let lines = 40 + below(80);
            let mut fit = FrameFit::default();
            // Weight, x, y and offset.
            let mut points: Vec<[f64; 4]> = Vec::new();
            for line in 0..lines {
                let offsets = RowOffsets {
                    shift_q24: below(1 << 25) as i32 - (1 << 24),
                    tilt_q24: below(1 << 17) as i32 - (1 << 16),
                };
                let y = f64::from(line);
                let mut row = Sums::default();
                for _ in 0..below(30) {
                    let x = i64::from(below(120)) - 60;
                    let square = i64::from(1 + below(4000));
                    let product = i64::from(below(2000)) - 1000;
                    row.squares += square;
                    row.squares_x += square * x;
                    row.squares_xx += square * x * x;
                    row.products += product;
                    row.products_x += product * x;
                    let [shift, tilt] =
                        [offsets.shift_q24, offsets.tilt_q24].map(|q24| f64::from(q24) / LINE);
                    let (weight, x) = (square as f64, x as f64);
                    let shown = 2.0 * product as f64 / weight;
                    points.push([weight, x, y, shift + tilt * x + shown]);
                }
                fit.add(line, &row, offsets);
            }
            let weights: f64 = points.iter().map(|point| point[0]).sum();
            let middle: f64 = points.iter().map(|point| point[0] * point[2]).sum::<f64>() / weights;
            let [shift, tilt, stretch] = [begun.shift_q24, begun.tilt_q24, begun.stretch_q24]
                .map(|q24| f64::from(q24) / LINE);
            for (side_x, side_y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                let x = side_x * (WIDTH / 4) as f64;
                let y = middle + side_y * f64::from(lines / 4);
                points.push([PRIOR / 4.0, x, y, shift + tilt * x + stretch * y]);
            }
            let mut equations = [[0.0; 4]; 3];
            for [weight, x, y, offset] in points {
                let terms = [1.0, x, y, offset];
                for (equation, factor) in equations.iter_mut().zip(terms) {
                    for (sum, term) in equation.iter_mut().zip(terms) {
                        *sum += weight * factor * term;
                    }
                }
            }
            let expected = solve(equations);
            let found = fit.fit(begun, WIDTH);
            let found = [found.shift_q24, found.tilt_q24, found.stretch_q24].map(f64::from);
            // Within 1/1000 line all over the frame.
            let [shift, tilt, stretch] = [0, 1, 2].map(|i| found[i] / LINE - expected[i]);
            let error =
                shift.abs() + tilt.abs() * (WIDTH / 2) as f64 + stretch.abs() * f64::from(lines);
            assert!(error < 1e-3, "{found:?} for {expected:?} of seed {seed}");
        }
    }
}
