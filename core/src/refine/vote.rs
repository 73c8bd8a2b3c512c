//! The paper's vote filter: a pixel takes the candidate that most neighbours agree on.
//!
//! A number of passes over the disparities, each in place from the top left to the
//! bottom right. A pixel looks at its four neighbours as they are at that moment; the
//! candidate that most of them have replaces its disparity when more than one has it,
//! of equally many the nearer candidate. Pass `t` needs line `y + 1` after pass `t - 1`,
//! so the passes follow each other one line apart and the filter is late by as many
//! lines as it has passes, with the very result of whole-frame passes.

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
        let ring = self.passes;
        let range = voted_range(row, ring, width);
        let above = row
            .checked_sub(1)
            .map(|above| voted_range(above, ring, width));
        let below = (row + 1 < self.rows_in).then(|| voted_range(row + 1, ring, width));
        let planes = self.candidates_range(row);
        let Some(planes) = self.candidates_px.get(planes) else {
            return;
        };
        let mut left = INVALID;
        for x in 0..width {
            let at = |range: &Option<core::ops::Range<usize>>| match range {
                Some(range) => self
                    .voted_px
                    .get(range.start + x)
                    .copied()
                    .unwrap_or(INVALID),
                None => INVALID,
            };
            let right = if x + 1 < width {
                self.voted_px
                    .get(range.start + x + 1)
                    .copied()
                    .unwrap_or(INVALID)
            } else {
                INVALID
            };
            let neighbours = [left, right, at(&above), at(&below)];
            let Some(&current) = self.voted_px.get(range.start + x) else {
                return;
            };
            let mut elected = current;
            let mut most = 1;
            for &candidate in planes.iter().skip(x).step_by(width) {
                let votes = neighbours.iter().filter(|&&n| n == candidate).count();
                if votes > most && candidate != INVALID {
                    most = votes;
                    elected = candidate;
                }
            }
            if let Some(voted) = self.voted_px.get_mut(range.start + x) {
                *voted = elected;
            }
            left = elected;
        }
    }

    fn candidates_range(&self, row: u32) -> core::ops::Range<usize> {
        let length = self.candidates * self.width;
        let start = (row % (self.passes + 1)) as usize * length;
        start..start + length
    }
}

fn voted_range(row: u32, passes: u32, width: usize) -> core::ops::Range<usize> {
    let start = (row % (passes + 2)) as usize * width;
    start..start + width
}
