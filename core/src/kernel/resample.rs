//! Resampling: a row of a rectified view from the lines of a camera.

/// Bits after the point of a displacement: 1/64 px.
pub const DISPLACEMENT_BITS: u32 = 6;

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
}

/// Writes a row: each pixel is the mean of the four levels around its position, weighted by the
/// distance in 1/16 px, and rounded. A position outside the lines takes the nearest level inside.
/// Pixels without knots, and all of them if there are no lines, become 0.
#[inline(always)]
pub fn resample_row(row: &ResampleRow<'_>, output: &mut [u8]) {
    let step = 1 << row.step_shift;
    let mut cells = row.knots.windows(2);
    for pixels in output.chunks_mut(step) {
        let Some(&[start, end]) = cells.next() else {
            pixels.fill(0);
            continue;
        };
        resample_cell(row, [start, end], pixels);
    }
}

/// Writes the pixels between two knots, as [`resample_row`] does.
#[inline(always)]
pub fn resample_cell(row: &ResampleRow<'_>, knots: [[i32; 2]; 2], pixels: &mut [u8]) {
    let below_sixteenth = sixteenth_shift(row.step_shift);
    let [mut x, mut y] = cell_positions(knots, row.step_shift);
    for pixel in pixels {
        *pixel = interpolate(row, x.0 >> below_sixteenth, y.0 >> below_sixteenth);
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
pub const fn cell_positions(knots: [[i32; 2]; 2], step_shift: u32) -> [(i32, i32); 2] {
    let [[start_x, start_y], [end_x, end_y]] = knots;
    let half = 1 << (sixteenth_shift(step_shift) - 1);
    [
        ((start_x << step_shift) + half, end_x - start_x),
        ((start_y << step_shift) + half, end_y - start_y),
    ]
}

/// The level at a position in 1/16 px.
#[inline(always)]
fn interpolate(row: &ResampleRow<'_>, x_q4: i32, y_q4: i32) -> u8 {
    let column = |x: i32| x.clamp(0, row.width.saturating_sub(1) as i32) as usize;
    let line = |y: i32| {
        let last = row.starts.len().saturating_sub(1) as i32;
        let line = (y - i32::from(row.first_line)).clamp(0, last) as usize;
        let start = row
            .starts
            .get(line)
            .map_or(usize::MAX, |&start| start as usize);
        row.levels.get(start..).unwrap_or_default()
    };
    let level = |line: &[u8], column: usize| u32::from(line.get(column).copied().unwrap_or(0));
    let (x, y) = (x_q4 >> 4, y_q4 >> 4);
    let (right, below) = ((x_q4 & 15) as u32, (y_q4 & 15) as u32);
    let mixed =
        |line: &[u8]| level(line, column(x)) * (16 - right) + level(line, column(x + 1)) * right;
    let sum = mixed(line(y)) * (16 - below) + mixed(line(y + 1)) * below;
    ((sum + 128) >> 8) as u8
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

    #[test]
    fn without_lines_there_is_no_level() {
        let row = ResampleRow {
            levels: &[],
            starts: &[],
            first_line: 0,
            width: 0,
            knots: &[[0, 0], [16 << 10, 0]],
            step_shift: 4,
        };
        let mut output = [7; 16];
        resample_row(&row, &mut output);
        assert_eq!(output, [0; 16]);
    }
}
