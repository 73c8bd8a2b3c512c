//! The paper's vote filter: a pixel takes the candidate that most neighbours agree on.
//!
//! A number of passes over the disparities, each in place from the top left to the
//! bottom right. A pixel looks at its four neighbours as they are at that moment; the
//! candidate that most of them have replaces its disparity when more than one has it,
//! of equally many the nearer candidate. Pass `t` needs line `y + 1` after pass `t - 1`,
//! so the passes follow each other one line apart and the filter is late by as many
//! lines as it has passes, with the very result of whole-frame passes.

use core::cell::Cell;

use crate::disparity::INVALID;
use crate::memory::{Arena, OutOfMemory, words};

/// The passes of the vote over a short ring of rows.
#[derive(Debug)]
pub struct VoteFilter<'m> {
    /// Rows of candidate planes, a ring of `passes + 1`.
    candidates_px: &'m mut [i16],
    /// Rows of disparities as voted so far, a ring of `passes + 2`.
    voted_px: &'m mut [i16],
    width: usize,
    candidates: usize,
    passes: u32,
    rows_in: u32,
    /// Rows in, then virtual rows while flushing: the time that drives the passes.
    time: u32,
}

impl<'m> VoteFilter<'m> {
    /// Words of memory: `passes + 1` rows of candidates and `passes + 2` of disparities.
    #[must_use]
    pub const fn memory_words(width: usize, candidates: usize, passes: u8) -> usize {
        words((passes as usize + 1) * candidates * width, size_of::<i16>())
            + words((passes as usize + 2) * width, size_of::<i16>())
    }

    /// A filter for rows of `width` pixels with `candidates` planes.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`VoteFilter::memory_words`] left.
    pub fn new(
        width: usize,
        candidates: usize,
        passes: u8,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let rows = usize::from(passes) + 1;
        Ok(Self {
            candidates_px: arena.take(rows * candidates * width)?,
            voted_px: arena.take((rows + 1) * width)?,
            width,
            candidates,
            passes: passes.into(),
            rows_in: 0,
            time: 0,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows_in = 0;
        self.time = 0;
    }

    /// Takes a row of candidate planes, the current disparity in plane 0. True when
    /// this completes a row, then [`VoteFilter::row`].
    pub fn push(&mut self, candidates_px: &[i16]) -> bool {
        let row = self.rows_in;
        let kept = self.candidates_range(row);
        for (to, from) in [
            (
                self.candidates_px.get_mut(kept),
                candidates_px.get(..self.candidates * self.width),
            ),
            (
                self.voted_px
                    .get_mut(voted_range(row, self.passes, self.width)),
                candidates_px.get(..self.width),
            ),
        ] {
            if let (Some(to), Some(from)) = (to, from) {
                to.copy_from_slice(from);
            }
        }
        self.rows_in += 1;
        self.run_passes();
        self.time > self.passes
    }

    /// After the last row: completes the next of the rows still to come; false when
    /// there are no more.
    pub fn flush(&mut self) -> bool {
        while self.time < self.rows_in + self.passes {
            self.run_passes();
            if self.time > self.passes {
                return true;
            }
        }
        false
    }

    /// The row last completed, px.
    #[must_use]
    pub fn row(&self) -> &[i16] {
        let row = self.time.saturating_sub(self.passes + 1);
        self.voted_px
            .get(voted_range(row, self.passes, self.width))
            .unwrap_or_default()
    }

    /// One step of time: pass `t` over the row that is `t` above the newest.
    fn run_passes(&mut self) {
        for pass in 1..=self.passes {
            if let Some(row) = self.time.checked_sub(pass)
                && row < self.rows_in
            {
                self.vote_row(row);
            }
        }
        self.time += 1;
    }

    fn vote_row(&mut self, row: u32) {
        let width = self.width;
        let rows = self.passes as usize + 2;
        let at = (row % (self.passes + 2).max(1)) as usize;
        let above = (row > 0).then(|| if at == 0 { rows - 1 } else { at - 1 });
        let below = (row + 1 < self.rows_in).then(|| if at + 1 == rows { 0 } else { at + 1 });
        let planes = self.candidates_range(row);
        let Some(planes) = self.candidates_px.get(planes) else {
            return;
        };
        // Cells, so that the row being written and its neighbours are borrowed at once.
        let voted = Cell::from_mut(&mut *self.voted_px).as_slice_of_cells();
        let ring_row = |index: usize| voted.get(index * width..).and_then(|row| row.get(..width));
        let Some(own) = ring_row(at) else {
            return;
        };
        // A neighbour outside the frame has no disparity, and so no vote.
        let above = above.and_then(ring_row);
        let below = below.and_then(ring_row);
        let value = |row: Option<&[Cell<i16>]>, x: usize| {
            row.and_then(|row| row.get(x)).map_or(INVALID, Cell::get)
        };
        let mut left = INVALID;
        for (x, current) in own.iter().enumerate() {
            let right = value(Some(own), x + 1);
            let neighbours = [left, right, value(above, x), value(below, x)];
            let mut elected = current.get();
            let mut most = 1;
            let mut plane = x;
            for _ in 0..self.candidates {
                let candidate = planes.get(plane).copied().unwrap_or(INVALID);
                plane += width;
                let votes = neighbours
                    .iter()
                    .map(|&neighbour| u8::from(neighbour == candidate))
                    .sum();
                if votes > most && candidate != INVALID {
                    most = votes;
                    elected = candidate;
                }
            }
            current.set(elected);
            left = elected;
        }
    }

    fn candidates_range(&self, row: u32) -> core::ops::Range<usize> {
        let length = self.candidates * self.width;
        let start = (row % (self.passes + 1).max(1)) as usize * length;
        start..start + length
    }
}

fn voted_range(row: u32, passes: u32, width: usize) -> core::ops::Range<usize> {
    let start = (row % (passes + 2).max(1)) as usize * width;
    start..start + width
}
