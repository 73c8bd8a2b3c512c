//! Median of 3 x 3 pixels, two pixels to a register.

use vgstereo_core::kernel;

use super::instructions::{align, max_i16x2, min_i16x2};
use crate::armv7em::median9::{Pairs, medians, sorted};
use crate::armv7em::simd::pair_of;

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
    let mut before = sorted::<ByteInstructions>([a, b, c].map(pair_of));
    let columns = above.iter().zip(own).zip(below);
    let mut done = 0;
    for (output, ((a, b), c)) in output.as_chunks_mut::<2>().0.iter_mut().zip(columns) {
        let after = sorted::<ByteInstructions>([a, b, c].map(pair_of));
        let medians = medians::<ByteInstructions>(before, after);
        *output = [medians as i16, (medians >> 16) as i16];
        before = after;
        done += 2;
    }
    Some(done)
}

struct ByteInstructions;

impl Pairs for ByteInstructions {
    #[inline(always)]
    fn lesser(a: u32, b: u32) -> u32 {
        min_i16x2(a, b)
    }

    #[inline(always)]
    fn greater(a: u32, b: u32) -> u32 {
        max_i16x2(a, b)
    }

    #[inline(always)]
    fn between(before: u32, after: u32) -> u32 {
        align::<2>(before, after)
    }
}
