//! Resampling of a row of a rectified view, a cell of knots at a time.

use vgstereo_core::kernel::{
    self, Interpolation, ResampleRow, cell_positions, for_each_cell, resample_cell, sixteenth_shift,
};

use super::simd::{add_products_i16x2, even_bytes, odd_bytes};

/// Columns of the raw view that the pixels of a cell may lie in.
const COLUMNS: usize = 32;
/// Lines of the raw view that they may lie in.
const LINES: usize = 4;
/// Bits after the point of a position, px.
const BITS: u32 = 20;

/// The levels of a raw line around a cell, and one more for the pixel to the right.
type Window = [u8; COLUMNS + 1];

/// Equals [`kernel::resample_row`] bit for bit.
#[inline(never)]
pub(super) fn resample_row(row: &ResampleRow<'_>, output: &mut [u8]) {
    if row.interpolation != Interpolation::Bilinear {
        return kernel::resample_row(row, output);
    }
    for_each_cell(row, output, |knots, pixels| {
        if inner_cell(row, knots, pixels).is_none() {
            resample_cell(row, knots, pixels);
        }
    });
}

/// Writes the pixels between two knots if all that they read is inside the lines that are kept, and
/// near enough together; `None` if not.
#[inline(always)]
fn inner_cell(row: &ResampleRow<'_>, knots: [[i32; 2]; 2], pixels: &mut [u8]) -> Option<()> {
    let bits = sixteenth_shift(row.step_shift) + 4;
    let [(x, dx), (y, dy)] = cell_positions(knots, row.step_shift);
    let steps = pixels.len() as i32 - 1;
    let ends = |from: i32, step: i32| {
        let (first, last) = (from >> bits, (from + step * steps) >> bits);
        (first.min(last), first.max(last))
    };
    let ((left, right), (top, bottom)) = (ends(x, dx), ends(y, dy));
    let columns = COLUMNS as i32;
    // The first column of the windows, which end with the line at the latest.
    let first = left.min(row.width as i32 - columns - 1);
    let top_kept = top - i32::from(row.first_line);
    let height = bottom - top;
    if first < 0 || right + 1 >= row.width as i32 || right - first >= columns {
        return None;
    }
    if top_kept < 0 || height >= LINES as i32 {
        return None;
    }
    let starts = row.starts.get(top_kept as usize..)?;
    let window = |start: u32| -> Option<&Window> {
        row.levels
            .get(start as usize + first as usize..)?
            .first_chunk()
    };
    let fixed = |position: i32, origin: i32| (position - (origin << bits)) << (BITS - bits);
    let (mut x, mut y) = (fixed(x, first) as u32, fixed(y, top) as u32);
    let (dx, dy) = ((dx << (BITS - bits)) as u32, (dy << (BITS - bits)) as u32);
    if height == 0 {
        // Most cells: all pixels lie between the same two lines.
        let &[upper, lower] = starts.first_chunk()?;
        let (upper, lower) = (window(upper)?, window(lower)?);
        for pixel in pixels {
            *pixel = level(upper, lower, x, y);
            x = x.wrapping_add(dx);
            y = y.wrapping_add(dy);
        }
        return Some(());
    }
    let starts = starts.get(..=height as usize + 1)?;
    let mut windows: [&Window; LINES + 1] = [&[0; COLUMNS + 1]; LINES + 1];
    for (kept, &start) in windows.iter_mut().zip(starts) {
        *kept = window(start)?;
    }
    for pixel in pixels {
        let line = (y >> BITS) as usize % LINES;
        *pixel = level(windows[line], windows[line + 1], x, y);
        x = x.wrapping_add(dx);
        y = y.wrapping_add(dy);
    }
    Some(())
}

/// The level at a place between two lines, whose integer parts are the column and a line.
#[inline(always)]
fn level(upper: &Window, lower: &Window, x: u32, y: u32) -> u8 {
    let column = (x >> BITS) as usize % COLUMNS;
    let (right, below) = (x >> (BITS - 4) & 15, y >> (BITS - 4) & 15);
    let pair = |window: &Window| u16::from_le_bytes([window[column], window[column + 1]]);
    let pairs = u32::from(pair(upper)) | u32::from(pair(lower)) << 16;
    // Levels of the upper line in the lower halfword. Means across are below 2^12.
    let mixed = even_bytes(pairs) * (16 - right) + odd_bytes(pairs) * right;
    let weights = 16 + below * 0xffff;
    (add_products_i16x2(mixed, weights, 128) >> 8) as u8
}
