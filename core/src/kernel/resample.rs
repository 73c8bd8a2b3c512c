//! Resampling: a row of a rectified view from the lines of a camera.

/// Bits after the point of a displacement: 1/64 px.
pub const DISPLACEMENT_BITS: u32 = 6;

/// How a level between pixels is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// The mean of the four pixels around it, weighted by distance.
    #[default]
    Bilinear,
    /// The cubic convolution of the 16 pixels around it (R. G. Keys, *Cubic Convolution
    /// Interpolation for Digital Image Processing*, 1981, with a slope of -3/4), which keeps edges sharper. It
    /// needs a line more above and below.
    Cubic,
}

impl Interpolation {
    /// Pixels that are read before and after the one at or before a position.
    #[must_use]
    pub const fn reach(self) -> (i32, i32) {
        match self {
            Self::Bilinear => (0, 1),
            Self::Cubic => (1, 2),
        }
    }
}

/// Task: where the pixels of a row lie in the lines of a camera, and those lines.
///
/// The position of a pixel is interpolated between knots, which lie every `2^step_shift` pixels:
/// pixel `x` is `x % 2^step_shift` pixels right of knot `x >> step_shift`.
#[derive(Debug, Clone, Copy)]
pub struct ResampleRow<'a> {
    /// Levels of all lines that are kept.
    pub levels: &'a [u8],
    /// Index in `levels` of the first level of each line, from line `first_line` of the frame
    /// down.
    pub starts: &'a [u32],
    /// Line of the frame that `starts` begins with.
    pub first_line: u16,
    /// Pixels of a line, at most 2^12.
    pub width: usize,
    /// Column and line of each knot, in 1/64 px divided by `2^step_shift`: the mean of two
    /// displacements in 1/64 px, weighted by the lines to either, keeps its fraction. Within
    /// -2^12 to 2^12 px.
    pub knots: &'a [[i32; 2]],
    /// Binary logarithm of the pixels from one knot to the next, at most 6.
    pub step_shift: u32,
    /// How the levels between pixels are made.
    pub interpolation: Interpolation,
}

/// Writes a row: each pixel is interpolated at its position, to the nearest 1/16 px, and rounded. A
/// position outside the lines takes the nearest level inside.
/// Pixels without knots, and all of them if there are no lines, become 0.
#[inline(always)]
pub fn resample_row(row: &ResampleRow<'_>, output: &mut [u8]) {
    for_each_cell(row, output, |knots, pixels| {
        resample_cell(row, knots, pixels)
    });
}

/// Calls `write` with every two knots of a row and the pixels between them. Pixels without knots become
/// 0.
#[inline(always)]
pub fn for_each_cell(
    row: &ResampleRow<'_>,
    output: &mut [u8],
    mut write: impl FnMut(&[[i32; 2]; 2], &mut [u8]),
) {
    let step = 1 << row.step_shift;
    let mut cells = row.knots.array_windows();
    for pixels in output.chunks_mut(step) {
        let Some(knots) = cells.next() else {
            pixels.fill(0);
            continue;
        };
        write(knots, pixels);
    }
}

/// Writes the pixels between two knots, as [`resample_row`] does.
#[inline(always)]
pub fn resample_cell(row: &ResampleRow<'_>, knots: &[[i32; 2]; 2], pixels: &mut [u8]) {
    match row.interpolation {
        Interpolation::Bilinear => {
            write_cell(row, knots, pixels, |position| bilinear(row, position))
        }
        Interpolation::Cubic => write_cell(row, knots, pixels, |position| cubic(row, position)),
    }
}

/// Writes the pixels between two knots; `level` is that of a column and a line, 1/16 px.
#[inline(always)]
fn write_cell(
    row: &ResampleRow<'_>,
    knots: &[[i32; 2]; 2],
    pixels: &mut [u8],
    level: impl Fn([i32; 2]) -> u8,
) {
    let below_sixteenth = sixteenth_shift(row.step_shift);
    let [mut x, mut y] = cell_positions(knots, row.step_shift);
    for pixel in pixels {
        *pixel = level([x.0 >> below_sixteenth, y.0 >> below_sixteenth]);
        x.0 += x.1;
        y.0 += y.1;
    }
}

/// Bits of [`cell_positions`] below 1/16 px.
#[inline(always)]
#[must_use]
pub const fn sixteenth_shift(step_shift: u32) -> u32 {
    DISPLACEMENT_BITS + 2 * step_shift - 4
}

/// Positions between two knots, column and line: that of the first pixel, and the step from pixel
/// to pixel. Their unit is that of the knots divided by the pixels between them. The first has half
/// of 1/16 px added, so that cutting off the bits below 1/16 px rounds to nearest.
#[inline(always)]
#[must_use]
pub const fn cell_positions(knots: &[[i32; 2]; 2], step_shift: u32) -> [(i32, i32); 2] {
    let &[[start_x, start_y], [end_x, end_y]] = knots;
    let half = 1 << (sixteenth_shift(step_shift) - 1);
    [
        ((start_x << step_shift) + half, end_x - start_x),
        ((start_y << step_shift) + half, end_y - start_y),
    ]
}

impl ResampleRow<'_> {
    /// The levels of a line of the frame, or of the nearest that is there.
    #[inline(always)]
    fn line(&self, y: i32) -> &[u8] {
        let last = self.starts.len().saturating_sub(1) as i32;
        // Not `clamp`, which panics unless its bounds are in order.
        let line = (y - i32::from(self.first_line)).min(last).max(0) as usize;
        let start = self.starts.get(line);
        let start = start.map_or(usize::MAX, |&start| start as usize);
        self.levels.get(start..).unwrap_or_default()
    }

    /// The level of a line at a column, or at the nearest that is there.
    #[inline(always)]
    fn level(&self, line: &[u8], x: i32) -> i32 {
        let column = x.min(self.width.saturating_sub(1) as i32).max(0) as usize;
        line.get(column).copied().unwrap_or(0).into()
    }
}

/// The level at a position in 1/16 px, between four pixels.
#[inline(always)]
fn bilinear(row: &ResampleRow<'_>, [x_q4, y_q4]: [i32; 2]) -> u8 {
    let (x, y) = (x_q4 >> 4, y_q4 >> 4);
    let (right, below) = (x_q4 & 15, y_q4 & 15);
    let mixed = |line: &[u8]| row.level(line, x) * (16 - right) + row.level(line, x + 1) * right;
    let sum = mixed(row.line(y)) * (16 - below) + mixed(row.line(y + 1)) * below;
    ((sum + 128) >> 8) as u8
}

/// The level at a position in 1/16 px, between 16 pixels.
#[inline(always)]
fn cubic(row: &ResampleRow<'_>, [x_q4, y_q4]: [i32; 2]) -> u8 {
    let (x, y) = (x_q4 >> 4, y_q4 >> 4);
    let [across, down] = [x_q4, y_q4].map(|q4| CUBIC_WEIGHTS_Q7[(q4 & 15) as usize]);
    let mut sum = 1 << 13;
    for (line, weight) in (y - 1..).zip(down) {
        let levels = row.line(line);
        let terms = (x - 1..).zip(across);
        let mixed: i32 = terms.map(|(x, weight)| row.level(levels, x) * weight).sum();
        sum += mixed * weight;
    }
    (sum >> 14).clamp(0, 255) as u8
}

/// Weights, 1/128, of the pixels from one before a position to two after, by its distance from the pixel
/// before it in 1/16 px. They add up to 128.
const CUBIC_WEIGHTS_Q7: [[i32; 4]; 16] = {
    let mut weights = [[0; 4]; 16];
    let mut sixteenths = 0;
    while sixteenths < 16 {
        let outer = cubic_outer_q7(sixteenths);
        let inner = cubic_inner_q7(16 - sixteenths);
        let last = cubic_outer_q7(16 - sixteenths);
        weights[sixteenths as usize] = [outer, 128 - outer - inner - last, inner, last];
        sixteenths += 1;
    }
    weights
};

/// The weight of a pixel `1 + t` away, rounded: `-3/4 t (1 - t)^2`, where `t` is in 1/16.
const fn cubic_outer_q7(sixteenths: i32) -> i32 {
    let t = sixteenths;
    // 128 * 3 / 4 / 16^3, halves outwards.
    -((96 * t * (16 - t) * (16 - t) + 2048) >> 12)
}

/// The weight of a pixel `t` away, rounded: `5/4 t^3 - 9/4 t^2 + 1`, where `t` is in 1/16.
const fn cubic_inner_q7(sixteenths: i32) -> i32 {
    let t = sixteenths;
    (160 * t * t * t - 288 * 16 * t * t + (128 << 12) + 2048) >> 12
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Positions and weights in floating point, over a whole frame.
    #[test]
    fn pixels_are_bilinear_between_sixteenths() {
        let (width, lines) = (9, 7);
        let frame: Vec<u8> = (0..width * lines).map(|i| (i * 37 % 251) as u8).collect();
        // Lines 1 to 6 of the frame, kept in a ring whose oldest line is not its first.
        let starts: Vec<u32> = [5, 0, 1, 2, 3, 4].map(|slot| slot * width as u32).to_vec();
        let mut levels = std::vec![0; 6 * width];
        for (line, &start) in starts.iter().enumerate() {
            let own = &frame[(line + 1) * width..][..width];
            levels[start as usize..][..width].copy_from_slice(own);
        }
        // From beyond the upper left corner to beyond the lower right one, steeper at the end.
        let knots_px = [[-1.1, -0.6], [2.05, 3.1], [6.6, 4.7], [10.9, 8.1]];
        for step_shift in [2, 3] {
            let unit = f64::from(64 << step_shift);
            let knots = knots_px.map(|knot| knot.map(|px| (px * unit).round() as i32));
            let row = ResampleRow {
                levels: &levels,
                starts: &starts,
                first_line: 1,
                width,
                knots: &knots,
                step_shift,
                interpolation: Interpolation::Bilinear,
            };
            let step = 1 << step_shift;
            let mut output = std::vec![0; 3 * step + 2];
            resample_row(&row, &mut output);
            for (x, &found) in output.iter().enumerate().take(3 * step) {
                let [start, end] = [knots[x / step], knots[x / step + 1]];
                let part = (x % step) as f64 / step as f64;
                let [column, line] = [0, 1].map(|axis| {
                    let [start, end] = [start, end].map(|knot| f64::from(knot[axis]) / unit);
                    let position = start + (end - start) * part;
                    (position * 16.0 + 0.5).floor() / 16.0
                });
                let level = |column: f64, line: f64| {
                    let column = column.clamp(0.0, width as f64 - 1.0) as usize;
                    let line = line.clamp(1.0, lines as f64 - 1.0) as usize;
                    f64::from(frame[line * width + column])
                };
                let mixed = |line: f64| {
                    let share = column - column.floor();
                    level(column.floor(), line) * (1.0 - share)
                        + level(column.floor() + 1.0, line) * share
                };
                let share = line - line.floor();
                let expected =
                    mixed(line.floor()) * (1.0 - share) + mixed(line.floor() + 1.0) * share;
                assert_eq!(f64::from(found), (expected + 0.5).floor(), "pixel {x}");
            }
            assert_eq!(output[3 * step..], [0, 0], "beyond the last knot");
        }
    }

    /// The kernel of Keys in floating point, over a ramp with an edge.
    #[test]
    fn pixels_are_cubic_between_sixteenths() {
        let keys = |t: f64| {
            let (t, a) = (t.abs(), -0.75);
            if t <= 1.0 {
                (a + 2.0) * t * t * t - (a + 3.0) * t * t + 1.0
            } else if t < 2.0 {
                a * (t * t * t - 5.0 * t * t + 8.0 * t - 4.0)
            } else {
                0.0
            }
        };
        let (width, lines) = (12, 9);
        let level = |x: i32, y: i32| {
            let (x, y) = (x.clamp(0, width - 1), y.clamp(0, lines - 1));
            if x + y > 9 {
                200 + 3 * x
            } else {
                5 * y + 2 * x
            }
        };
        let frame: Vec<u8> = (0..width * lines)
            .map(|i| level(i % width, i / width) as u8)
            .collect();
        let starts: Vec<u32> = (0..lines).map(|y| (y * width) as u32).collect();
        // Every distance from the pixels, on a slant.
        let step_shift = 3;
        let unit = f64::from(64 << step_shift);
        let knots_px = [[-0.4, 0.3], [7.1, 3.9], [12.6, 9.4]];
        let knots = knots_px.map(|knot: [f64; 2]| knot.map(|px| (px * unit).round() as i32));
        let row = ResampleRow {
            levels: &frame,
            starts: &starts,
            first_line: 0,
            width: width as usize,
            knots: &knots,
            step_shift,
            interpolation: Interpolation::Cubic,
        };
        let mut output = [0; 16];
        resample_row(&row, &mut output);
        for (x, &found) in output.iter().enumerate() {
            let [start, end] = [knots[x / 8], knots[x / 8 + 1]];
            let part = (x % 8) as f64 / 8.0;
            let [u, v] = [0, 1].map(|axis| {
                let [start, end] = [start, end].map(|knot| f64::from(knot[axis]) / unit);
                ((start + (end - start) * part) * 16.0 + 0.5).floor() / 16.0
            });
            let mut sum = 0.0;
            for j in -1..=2 {
                for i in -1..=2 {
                    let (x, y) = (u.floor() as i32 + i, v.floor() as i32 + j);
                    let weight = keys(u - f64::from(x)) * keys(v - f64::from(y));
                    sum += weight * f64::from(level(x, y));
                }
            }
            let expected = sum.clamp(0.0, 255.0);
            // Weights in 1/128 are off by half of that each.
            assert!(
                (f64::from(found) - expected).abs() < 3.0,
                "pixel {x}: {found} {expected}"
            );
        }
        for weights in CUBIC_WEIGHTS_Q7 {
            assert_eq!(weights.iter().sum::<i32>(), 128);
        }
        assert_eq!(CUBIC_WEIGHTS_Q7[0], [0, 128, 0, 0]);
    }

    #[test]
    fn without_lines_there_is_no_level() {
        let row = ResampleRow {
            levels: &[],
            starts: &[],
            first_line: 0,
            width: 0,
            knots: &[[0, 0], [16 << 10, 0]],
            step_shift: 4,
            interpolation: Interpolation::Cubic,
        };
        let mut output = [7; 16];
        resample_row(&row, &mut output);
        assert_eq!(output, [0; 16]);
    }
}
