//! Median of 3 x 3 pixels, by minima and maxima alone, which become vector code.
//!
//! At the edges the nearest pixel stands in for one outside. Pixels without a disparity
//! take part as the smallest value.

use super::ring::RowRing;
use crate::disparity::INVALID;
use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory};
use crate::neighbours::neighbours;

/// A 3 x 3 median over a ring of three rows.
#[derive(Debug)]
pub struct Median9<'m, K> {
    kernels: K,
    rows: RowRing<'m>,
    width: usize,
}

impl Median9<'_, ()> {
    /// Lines of latency.
    pub const LATENCY_LINES: u8 = 1;

    /// Words of memory: three rows.
    #[must_use]
    pub const fn memory_words(width: usize) -> usize {
        RowRing::memory_words(width, 1, 3)
    }
}

impl<'m, K: Kernels> Median9<'m, K> {
    /// A median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Median9::memory_words`] left.
    pub fn new(width: usize, kernels: K, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        let ahead = Median9::LATENCY_LINES;
        Ok(Self {
            kernels,
            rows: RowRing::new(width, 1, 3, ahead, INVALID, arena)?,
            width,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows.reset();
    }

    /// Takes a row; when this completes one, puts that in its place and returns true.
    pub fn push(&mut self, row: &mut [i16]) -> bool {
        let line = self.rows.push(row);
        self.filter(line, row)
    }

    /// After the last row: completes the next of the rows still to come; false when
    /// there are no more.
    pub fn flush(&mut self, row: &mut [i16]) -> bool {
        let line = self.rows.flush();
        self.filter(line, row)
    }

    fn filter(&mut self, line: Option<u32>, output: &mut [i16]) -> bool {
        let (Some(line), Some(output)) = (line, output.get_mut(..self.width)) else {
            return false;
        };
        self.rows.replicate_edges();
        let rows = [line.saturating_sub(1), line, line + 1].map(|line| self.rows.padded(line));
        self.kernels.median9_row(rows, output);
        true
    }
}

/// Writes the median of each pixel of `output`; the rows above, of and below it have a
/// pixel more at both ends. Inlined so that a caller may compile it for its own
/// instruction set.
///
/// The columns of three are sorted first; the median is the middle one of the largest of
/// their least, the middle one of their middle ones, and the least of their largest.
#[inline(always)]
pub fn median9_row(rows: [&[i16]; 3], output: &mut [i16]) {
    let width = output.len();
    let Some([[a, b, c], [d, e, f], [g, h, i]]) = neighbours(rows, width) else {
        return;
    };
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..width], &b[..width], &c[..width]);
    let (d, e, f) = (&d[..width], &e[..width], &f[..width]);
    let (g, h, i) = (&g[..width], &h[..width], &i[..width]);
    for x in 0..width {
        let (low_a, middle_a, high_a) = sorted(a[x], b[x], c[x]);
        let (low_b, middle_b, high_b) = sorted(d[x], e[x], f[x]);
        let (low_c, middle_c, high_c) = sorted(g[x], h[x], i[x]);
        let low = low_a.max(low_b).max(low_c);
        let (_, middle, _) = sorted(middle_a, middle_b, middle_c);
        let high = high_a.min(high_b).min(high_c);
        (_, output[x], _) = sorted(low, middle, high);
    }
}

#[inline(always)]
fn sorted(a: i16, b: i16, c: i16) -> (i16, i16, i16) {
    let (low, high) = (a.min(b), a.max(b));
    (low.min(c), low.max(high.min(c)), high.max(c))
}
