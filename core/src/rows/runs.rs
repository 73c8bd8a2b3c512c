//! Runs: the valid positions of the newest rows.

use core::ops::Range;

use super::arena::{Arena, OutOfMemory};
use super::ring::Ring;
use crate::disparity::{DisparityRange, STEPS_PER_PX};

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

/// Where the match of a pixel lies in the stored row of the other view: for pixel `x` and disparity
/// `d`, at position `first + step x + d`, px.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MatchPositions {
    pub(crate) first: i32,
    /// 1 or -1.
    pub(crate) step: i32,
}

impl MatchPositions {
    /// Takes the confidence from disparities whose match, to the nearest pixel, the other camera did
    /// not see, as medians may leave them. `disparities_q4` are in 1/16 px, with `added_q4` to be added,
    /// and then in `range`; `seen` is the run of positions that the other camera saw.
    pub(crate) fn doubt_unseen(
        self,
        disparities_q4: &[i16],
        confidences: &mut [u8],
        added_q4: i16,
        range: DisparityRange,
        seen: &Range<usize>,
    ) {
        let Range { start, end } = *seen;
        // Rows have at most 2^16 positions.
        let (start, end, width) = (start as i32, end as i32, disparities_q4.len() as i32);
        let Range {
            start: least,
            end: beyond,
        } = range.range_px();
        // In between, all disparities of the range are inside.
        let (before, after) = if self.step < 0 {
            (self.first + beyond - end, self.first + least - start + 1)
        } else {
            (start - self.first - least, end - self.first - beyond + 1)
        };
        // Not `clamp`, which panics unless its bounds are in order.
        let before = before.min(width).max(0);
        let after = after.min(width).max(before);
        let steps_per_px = i32::from(STEPS_PER_PX);
        for x in (0..before).chain(after..width) {
            let index = x as usize;
            let (Some(&disparity_q4), Some(confidence)) =
                (disparities_q4.get(index), confidences.get_mut(index))
            else {
                return;
            };
            let disparity_q4 = i32::from(disparity_q4) + i32::from(added_q4);
            let position_q4 = (self.first + self.step * x) * steps_per_px + disparity_q4;
            let position = (position_q4 + steps_per_px / 2).div_euclid(steps_per_px);
            if !(start..end).contains(&position) {
                *confidence = 0;
            }
        }
    }
}
