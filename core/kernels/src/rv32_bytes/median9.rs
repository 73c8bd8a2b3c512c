//! Median of 3 x 3 pixels, two pixels to a register.

use vgstereo_core::kernel;

use super::instructions::{align, max_i16x2, min_i16x2};
use crate::armv7em::simd::pair_of;

/// Two columns of three values, each sorted: the two least, the two middle and the two greatest values.
type Columns = [u32; 3];

/// Equals [`kernel::median9_row`] bit for bit.
#[inline(never)]
pub(super) fn median9_row(rows: [&[i16]; 3], output: &mut [i16]) {
    let done = filter(rows, output).unwrap_or(0);
    let rest = output.get_mut(done..).unwrap_or_default();
    let rows = rows.map(|row| row.get(done..).unwrap_or_default());
    kernel::median9_row(rows, rest);
}

/// Filters pairs of pixels and returns how many pixels these are, or `None` if a row is too short for the last of all.
#[inline(always)]
fn filter(rows: [&[i16]; 3], output: &mut [i16]) -> Option<usize> {
    let width = output.len();
    let mut pairs = [&[][..]; 3];
    for (pairs, row) in pairs.iter_mut().zip(rows) {
        *pairs = row.get(..width + 2)?.as_chunks::<2>().0;
    }
    let [(a, above), (b, own), (c, below)] = [
        pairs[0].split_first()?,
        pairs[1].split_first()?,
        pairs[2].split_first()?,
    ];
    let mut before = sorted([a, b, c].map(pair_of));
    let columns = above.iter().zip(own).zip(below);
    let mut done = 0;
    for (output, ((a, b), c)) in output.as_chunks_mut::<2>().0.iter_mut().zip(columns) {
        let after = sorted([a, b, c].map(pair_of));
        let medians = medians(before, after);
        *output = [medians as i16, (medians >> 16) as i16];
        before = after;
        done += 2;
    }
    Some(done)
}

/// Returns the medians of the two pixels in the middle of four sorted columns.
#[inline(always)]
fn medians(before: Columns, after: Columns) -> u32 {
    // The three operands of each step are columns 0 and 1, columns 1 and 2, and columns 2 and 3.
    let middle: Columns = core::array::from_fn(|i| align::<2>(before[i], after[i]));
    let low = max_i16x2(max_i16x2(before[0], middle[0]), after[0]);
    let half = middle_of(before[1], middle[1], after[1]);
    let high = min_i16x2(min_i16x2(before[2], middle[2]), after[2]);
    middle_of(low, half, high)
}

#[inline(always)]
fn sorted([a, b, c]: [u32; 3]) -> Columns {
    let (low, high) = (min_i16x2(a, b), max_i16x2(a, b));
    let middle = min_i16x2(high, c);
    [
        min_i16x2(low, c),
        max_i16x2(low, middle),
        max_i16x2(high, c),
    ]
}

#[inline(always)]
fn middle_of(a: u32, b: u32, c: u32) -> u32 {
    let (low, high) = (min_i16x2(a, b), max_i16x2(a, b));
    max_i16x2(low, min_i16x2(high, c))
}
