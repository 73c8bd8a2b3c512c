//! Resampling of a row of a rectified view, a cell of the knots at a time.

use vgstereo_core::kernel::{
    self, Interpolation, ResampleRow, cell_positions, for_each_cell, resample_cell, sixteenth_shift,
};

use super::simd::{add_products_i16x2, even_bytes, odd_bytes, opaque};

/// Columns of the raw view that the pixels of a cell may lie in.
const COLUMNS: usize = 64;
/// Lines of the raw view that they may lie in.
const LINES: usize = 4;
const _: () = assert!(COLUMNS.is_power_of_two() && LINES.is_power_of_two());
/// Bits after the point of a position, px.
const BITS: u32 = 20;

/// The levels of some columns of a raw line, and one more for the pixel to the right.
type Window = [u8; COLUMNS + 1];

/// Levels of neighbouring raw lines, from the same columns of each.
struct Windows<'a> {
    /// The lines from the top down, and one more for the pixels below.
    lines: [&'a Window; LINES + 1],
    /// The first column.
    left: i32,
    /// The first line.
    top: i32,
}

/// Equals [`kernel::resample_row`] bit for bit.
pub(super) fn resample_row(row: &ResampleRow<'_>, output: &mut [u8]) {
    match row.interpolation {
        Interpolation::Bilinear => bilinear_row(row, output),
        Interpolation::Cubic => kernel::resample_row(row, output),
    }
}

#[inline(never)]
fn bilinear_row(row: &ResampleRow<'_>, output: &mut [u8]) {
    let bits = sixteenth_shift(row.step_shift) + 4;
    // Neighbouring cells mostly lie in the same windows.
    let mut windows = Windows::NONE;
    for_each_cell(row, output, |knots, pixels| {
        let [(x, dx), (y, dy)] = cell_positions(knots, row.step_shift);
        let steps = pixels.len() as i32 - 1;
        let ends = [x >> bits, (x + dx * steps) >> bits];
        let [line, last_line] = [y >> bits, (y + dy * steps) >> bits];
        if !windows.have(ends, [line, last_line]) {
            let moved = windows.move_to(row, ends[0], line, dy < 0);
            if moved.is_none() || !windows.have(ends, [line, last_line]) {
                return outer_cell(row, knots, pixels);
            }
        }
        // Positions in the windows.
        let fixed =
            |position: i32, origin: i32| ((position - (origin << bits)) as u32) << (BITS - bits);
        let at = [fixed(x, windows.left), fixed(y, windows.top)];
        let step = [fixed(dx, 0), fixed(dy, 0)];
        if line == last_line {
            let [upper, lower] = windows.around(at[1]);
            write(pixels, at, step, |x, y| level(upper, lower, x, y));
        } else {
            write(pixels, at, step, |x, y| {
                let [upper, lower] = windows.around(y);
                level(upper, lower, x, y)
            });
        }
    });
}

/// Writes the pixels between two knots, wherever they lie.
#[inline(never)]
fn outer_cell(row: &ResampleRow<'_>, knots: &[[i32; 2]; 2], pixels: &mut [u8]) {
    resample_cell(row, knots, pixels);
}

/// Writes pixels from a position on, with this step to the next; `level` is that of a column and a line.
#[inline(always)]
fn write(
    pixels: &mut [u8],
    [mut x, mut y]: [u32; 2],
    [dx, dy]: [u32; 2],
    level: impl Fn(u32, u32) -> u8,
) {
    let mut write = |pixel: &mut u8| {
        *pixel = level(x, y);
        x = opaque(x.wrapping_add(dx));
        y = opaque(y.wrapping_add(dy));
    };
    let (fours, rest) = pixels.as_chunks_mut::<4>();
    for four in fours {
        four.iter_mut().for_each(&mut write);
    }
    rest.iter_mut().for_each(&mut write);
}

impl<'a> Windows<'a> {
    /// Windows that have no line, before they first move.
    const NONE: Self = Self {
        lines: [&[0; COLUMNS + 1]; LINES + 1],
        left: 0,
        top: Self::NOWHERE,
    };
    /// A line that no raw view has.
    const NOWHERE: i32 = i32::MIN / 2;

    /// Whether they have all from one of these columns to the other, and from one of these lines to the
    /// other.
    #[inline(always)]
    fn have(&self, columns: [i32; 2], lines: [i32; 2]) -> bool {
        // Negative numbers have a bit above those of the others.
        let bits = |[a, b]: [i32; 2], origin: i32| ((a - origin) | (b - origin)) as usize;
        bits(columns, self.left) < COLUMNS && bits(lines, self.top) < LINES
    }

    /// Moves to a column and a line, with other columns to the right and other lines below or
    /// above; `None` if the raw lines are too short, or none that is kept is meant.
    #[inline(never)]
    fn move_to(
        &mut self,
        row: &ResampleRow<'a>,
        column: i32,
        line: i32,
        above: bool,
    ) -> Option<()> {
        // Until all of them have moved, they have no line.
        self.top = Self::NOWHERE;
        // The last windows end with the line.
        self.left = column.min(row.width as i32 - COLUMNS as i32 - 1);
        let first = usize::try_from(self.left).ok()?;
        let first_line = i32::from(row.first_line);
        let top = if above {
            (line - LINES as i32 + 1).max(first_line)
        } else {
            line
        };
        let kept = usize::try_from(top - first_line).ok()?;
        let mut starts = row.starts.get(kept..)?.iter();
        let mut start = *starts.as_slice().first()?;
        for line in &mut self.lines {
            // Below the last line that is kept, it is taken again.
            start = starts.next().copied().unwrap_or(start);
            *line = row.levels.get(start as usize + first..)?.first_chunk()?;
        }
        self.top = top;
        Some(())
    }

    /// The lines above and below a position.
    #[inline(always)]
    fn around(&self, y: u32) -> [&'a Window; 2] {
        let line = (y >> BITS) as usize % LINES;
        [self.lines[line], self.lines[line + 1]]
    }
}

/// The level at a position between two lines: the column is in the integer part of `x`, that of `y` is
/// not looked at.
#[inline(always)]
fn level(upper: &Window, lower: &Window, x: u32, y: u32) -> u8 {
    let column = (x >> BITS) as usize % COLUMNS;
    let (right, below) = (x >> (BITS - 4) & 15, y >> (BITS - 4) & 15);
    let pair = |window: &Window| u16::from_le_bytes([window[column], window[column + 1]]);
    // Two loads: the compiler would take them apart.
    let [upper, lower] = [upper, lower].map(|window| opaque(pair(window).into()));
    let pairs = opaque(upper | lower << 16);
    // Levels of the upper line in the lower halfword. Means across are below 2^12.
    let mixed = even_bytes(pairs) * (16 - right) + odd_bytes(pairs) * right;
    let weights = 16 + below * 0xffff;
    (add_products_i16x2(mixed, weights, 128) >> 8) as u8
}
