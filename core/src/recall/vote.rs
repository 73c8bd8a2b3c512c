//! The paper's vote filter: a pixel takes the candidate that most of its neighbours have.
//!
//! Several passes go over the disparities, each in place from the top left to the bottom right. A
//! pixel compares its candidates with the current disparities of its four neighbours. The candidate
//! that most of them have replaces its disparity, if more than one has it; among equally frequent
//! candidates, the nearer one wins. Pass `t` needs line `y + 1` after pass `t - 1`, so the passes
//! follow each other at a distance of one line. The filter has as many lines of latency as passes,
//! and its result equals that of passes over whole frames.

use core::cell::Cell;

use crate::disparity::INVALID;
use crate::rows::{Arena, OutOfMemory, Part, Ring, RowStage, copy_common};

/// The passes of the vote over a short ring of rows.
///
/// The [`RowStage`] takes the recalled disparities, px, and looks at the candidates of the
/// same row: planes of a row each, the recalled disparity in plane 0.
#[derive(Debug)]
pub(super) struct VoteFilter<'m> {
    /// Rows of candidate planes.
    candidates_px: Ring<'m, i16>,
    /// Rows of disparities as voted so far.
    voted_px: Ring<'m, i16>,
    candidates: usize,
    passes: u32,
    /// Number of rows taken, plus the number of steps of flushing: pass `t` works on the row `t`
    /// above it.
    time: u32,
}

impl<'m> VoteFilter<'m> {
    /// Demand of the filter: `passes + 1` rows of candidates, `passes + 2` of disparities, and a
    /// line of latency per pass.
    pub(super) const fn part(width: usize, candidates: usize, passes: u8) -> Part {
        let passes = passes as usize;
        Part {
            name: "vote",
            words: Ring::<i16>::words(candidates * width, 0, passes + 1)
                + Ring::<i16>::words(width, 0, passes + 2),
            look_back_lines: 0,
            latency_lines: passes as u32,
        }
    }

    /// A filter for rows of `width` pixels with `candidates` planes.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`VoteFilter::part`] says.
    pub(super) fn new(
        width: usize,
        candidates: usize,
        passes: u8,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let rows = usize::from(passes) + 1;
        Ok(Self {
            candidates_px: Ring::new(candidates * width, 0, rows, INVALID, arena)?,
            voted_px: Ring::new(width, 0, rows + 1, INVALID, arena)?,
            candidates,
            passes: passes.into(),
            time: 0,
        })
    }

    /// Advances all passes by one row: pass `t` works on the row `t` above the newest.
    fn run_passes(&mut self) {
        for pass in 1..=self.passes {
            if let Some(row) = self.time.checked_sub(pass)
                && row < self.voted_px.rows_in()
            {
                self.vote_row(row);
            }
        }
        self.time += 1;
    }

    /// Copies the row whose last pass is done to `row`.
    fn write(&self, row: &mut [i16]) {
        let done = self.time.saturating_sub(self.passes + 1);
        copy_common(row, self.voted_px.row(done));
    }

    /// One pass over a row.
    fn vote_row(&mut self, row: u32) {
        let width = self.voted_px.width();
        let start = |row: u32| self.voted_px.start(row);
        let at = start(row);
        let above = row.checked_sub(1).map(start);
        let below = (row + 1 < self.voted_px.rows_in()).then(|| start(row + 1));
        let planes = self.candidates_px.row(row);
        // Cells, so that the row being written and its neighbours are borrowed at once.
        let voted = Cell::from_mut(self.voted_px.values_mut()).as_slice_of_cells();
        let ring_row = |start: usize| voted.get(start..).and_then(|row| row.get(..width));
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
}

impl RowStage<&[i16]> for VoteFilter<'_> {
    fn reset(&mut self) {
        self.candidates_px.clear();
        self.voted_px.clear();
        self.time = 0;
    }

    fn push(&mut self, row: &mut [i16], candidates_px: &mut &[i16]) -> bool {
        self.candidates_px.push_copy(candidates_px);
        self.voted_px.push_copy(row);
        self.run_passes();
        let is_complete = self.time > self.passes;
        if is_complete {
            self.write(row);
        }
        is_complete
    }

    fn flush(&mut self, row: &mut [i16], _: &mut &[i16]) -> bool {
        while self.time < self.voted_px.rows_in() + self.passes {
            self.run_passes();
            if self.time > self.passes {
                self.write(row);
                return true;
            }
        }
        false
    }
}
