//! Runs: the valid positions of the newest rows.

use core::ops::Range;

use super::arena::{Arena, OutOfMemory};
use super::ring::Ring;

/// The run of valid positions of each of the newest `depth` rows.
#[derive(Debug)]
pub(crate) struct ValidRuns<'m>(Ring<'m, [u16; 2]>);

impl<'m> ValidRuns<'m> {
    /// Words of memory: 4 bytes a row.
    pub(crate) const fn words(depth: usize) -> usize {
        Ring::<[u16; 2]>::words(1, 0, depth)
    }

    /// No rows.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`ValidRuns::words`] left.
    pub(crate) fn new(depth: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        Ok(Self(Ring::new(1, 0, depth, [0; 2], arena)?))
    }

    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// Takes the run of the next row, of at most 65,535 positions.
    pub(crate) fn push(&mut self, run: Range<usize>) {
        let bound = |position: usize| u16::try_from(position).unwrap_or(u16::MAX);
        self.0.push_copy(&[[bound(run.start), bound(run.end)]]);
    }

    /// The run of one of the newest `depth` rows.
    pub(crate) fn row(&self, row: u32) -> Range<usize> {
        let [start, end] = self.0.row(row).first().copied().unwrap_or_default();
        start.into()..end.into()
    }
}

/// Fills the positions of a row before and after a run.
pub(crate) fn fill_outside<T: Copy>(row: &mut [T], run: &Range<usize>, value: T) {
    let end = run.end.min(row.len());
    for outside in [0..run.start.min(end), end..row.len()] {
        if let Some(outside) = row.get_mut(outside) {
            outside.fill(value);
        }
    }
}
