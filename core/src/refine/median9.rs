//! Median of 3 x 3 pixels, by a network of exchanges that vector units run in parallel.
//!
//! At the edges the nearest pixel stands in for one outside. Pixels without a disparity
//! take part as the smallest value.

use super::ring::RowRing;
use crate::disparity::INVALID;
use crate::memory::{Arena, OutOfMemory};

const LANES: usize = 32;

/// A 3 x 3 median over a ring of three rows.
#[derive(Debug)]
pub struct Median9<'m> {
    rows: RowRing<'m>,
    width: usize,
}

impl<'m> Median9<'m> {
    /// Lines of latency.
    pub const LATENCY_LINES: u8 = 1;

    /// Words of memory: three rows.
    #[must_use]
    pub const fn memory_words(width: usize) -> usize {
        RowRing::memory_words(width, 1, 3)
    }

    /// A median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Median9::memory_words`] left.
    pub fn new(width: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        Ok(Self {
            rows: RowRing::new(width, 1, 3, Self::LATENCY_LINES, INVALID, arena)?,
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
        if self.width < LANES {
            for x in 0..self.width {
                median_block::<1>(rows, x, output);
            }
            return true;
        }
        // The last block overlaps the one before rather than leave a rest.
        for x in (0..self.width).step_by(LANES) {
            median_block::<LANES>(rows, x.min(self.width - LANES), output);
        }
        true
    }
}

#[inline(always)]
fn median_block<const N: usize>(rows: [&[i16]; 3], x: usize, output: &mut [i16]) {
    let mut values = [[0_i16; N]; 9];
    let shifts = rows.iter().flat_map(|row| (0..3).map(move |dx| (row, dx)));
    for (value, (row, dx)) in values.iter_mut().zip(shifts) {
        if let Some(run) = row.get(x + dx..).and_then(|run| run.first_chunk::<N>()) {
            *value = *run;
        }
    }
    // The exchanges of a median of nine (Paeth, Graphics Gems, 1990).
    for (a, b) in [
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 1),
        (3, 4),
        (6, 7),
        (1, 2),
        (4, 5),
        (7, 8),
        (0, 3),
        (5, 8),
        (4, 7),
        (3, 6),
        (1, 4),
        (2, 5),
        (4, 7),
        (4, 2),
        (6, 4),
        (4, 2),
    ] {
        let (mut low, mut high) = (values[a], values[b]);
        for (low, high) in low.iter_mut().zip(&mut high) {
            (*low, *high) = ((*low).min(*high), (*low).max(*high));
        }
        (values[a], values[b]) = (low, high);
    }
    if let Some(output) = output.get_mut(x..x + N) {
        output.copy_from_slice(&values[4]);
    }
}
