//! The fit of a frame: the plane of offsets that its matches show.

use super::sums::Sums;
use crate::rows::{LineOffsets, RowOffsets};

/// Rows that are added to the fit at once, as one row in their middle: floating point is software on most
/// boards.
const BLOCK_ROWS: u32 = 9;
/// Weight of what the frame began with, as a square of gradients: that offsets are still the same, in the middle
/// of the frame and at a quarter of its width and of its height from there.
const PRIOR: f64 = 60_000.0;
/// One line, in units of [`LineOffsets`].
const LINE: f64 = LineOffsets::LINE_Q24 as f64;

/// Sums over the matches of a frame, in 120 bytes; positions x are from the middle of the line, lines y from the
/// first.
#[derive(Debug, Default)]
pub(super) struct FrameFit {
    /// The rows that are not in the sums yet.
    block: Sums,
    block_rows: u32,
    /// Number of lines down to the newest row.
    lines: u32,
    /// Squares of gradients: their sum, and those with x, y, and products of both.
    squares: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    /// Squares of gradients with the offset of the match, and with x and y besides.
    offset: f64,
    offset_x: f64,
    offset_y: f64,
}

impl FrameFit {
    /// Adds the row of `line`, the one after the last unless [`FrameFit::fold`] came between. Returns whether
    /// there are as many rows as should be folded at once.
    pub(super) fn add(&mut self, line: u32, row: &Sums) -> bool {
        self.block.add(row);
        self.block_rows += 1;
        self.lines = line.saturating_add(1);
        self.block_rows >= BLOCK_ROWS
    }

    /// Number of lines down to the newest row.
    pub(super) fn lines(&self) -> u32 {
        self.lines
    }

    /// The line in the middle of the rows that are not folded.
    pub(super) fn middle_line(&self) -> u32 {
        self.lines.saturating_sub(1 + self.block_rows / 2)
    }

    /// Adds the rows since the last time to the sums. Their pixels were moved by `offsets`; the offset of a
    /// match is that and what its levels show.
    pub(super) fn fold(&mut self, offsets: RowOffsets) {
        if self.block_rows == 0 {
            return;
        }
        let y = f64::from(self.middle_line());
        let block = core::mem::take(&mut self.block);
        self.block_rows = 0;
        let [shift, tilt] = [offsets.shift_q24, offsets.tilt_q24].map(|q24| f64::from(q24) / LINE);
        let [n, x, xx] = [block.squares, block.squares_x, block.squares_xx].map(|sum| sum as f64);
        // Gradients are over two lines.
        let shown = [2 * block.products, 2 * block.products_x].map(|sum| sum as f64);
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
        // Sums with the prior, whose matches lie around (0, y).
        let n = self.squares + PRIOR;
        let y_mean = if self.squares > 0.0 {
            self.y / self.squares
        } else {
            quarter_y
        };
        let x_mean = self.x / n;
        let prior_x = PRIOR * quarter_x * quarter_x;
        let prior_y = PRIOR * quarter_y * quarter_y;
        let at_mean = shift + stretch * y_mean;
        let offset = self.offset + PRIOR * at_mean;
        // Sums of deviations from the means.
        let xx = self.xx + prior_x - self.x * x_mean;
        let xy = self.xy - self.x * y_mean;
        let yy = self.yy - self.y * y_mean + prior_y;
        let offset_x = self.offset_x + prior_x * tilt - offset * x_mean;
        let offset_y = self.offset_y - self.offset * y_mean + prior_y * stretch;
        // Positive, for so are the sums of squares of deviations, of which the priors are a part.
        let determinant = xx * yy - xy * xy;
        let tilt = (offset_x * yy - offset_y * xy) / determinant;
        let stretch = (offset_y * xx - offset_x * xy) / determinant;
        let shift = offset / n - tilt * x_mean - stretch * y_mean;
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
            let mut first = 0;
            while first < lines {
                let rows = (1 + below(9)).min(lines - first);
                let offsets = RowOffsets {
                    shift_q24: below(1 << 25) as i32 - (1 << 24),
                    tilt_q24: below(1 << 17) as i32 - (1 << 16),
                };
                // Rows of a block count as one in their middle.
                let y = f64::from(first + rows - 1 - rows / 2);
                for line in first..first + rows {
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
                    fit.add(line, &row);
                }
                fit.fold(offsets);
                first += rows;
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
            let found = [found.shift_q24, found.tilt_q24, found.stretch_q24];
            for (found, expected) in found.into_iter().zip(expected) {
                let error = f64::from(found) - expected * LINE;
                assert!(
                    error.abs() < 4.0,
                    "{found} for {} of seed {seed}",
                    expected * LINE
                );
            }
        }
    }
}
