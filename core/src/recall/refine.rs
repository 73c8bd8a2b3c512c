//! The refinement of the paper's method: vote and median, then conversion to 1/16 px.

use core::ops::Range;

use super::matcher::match_positions;
use super::median::Median;
use super::vote::VoteFilter;
use crate::config::{Config, ConfigError, RecallParameters};
use crate::disparity::{DisparityRange, INVALID, px_to_q4};
use crate::rows::{
    Arena, MatchPositions, Part, Parts, RowStage, Then, ValidRuns, copy_common, fill_outside, words,
};

/// The configured stages, one after another.
#[derive(Debug)]
pub struct RecallRefiner<'m> {
    stages: Then<Option<VoteFilter<'m>>, Option<Median<'m>>>,
    /// The row on its way through the stages, px; then the line, 1/16 px.
    line: &'m mut [i16],
    confidences: &'m mut [u8],
    /// For each row in the stages, the run of valid columns of the reference view, counted from the
    /// region's first, and the run of valid positions of the other view's stored row.
    valid: [ValidRuns<'m>; 2],
    rows_out: u32,
    disparities: DisparityRange,
    matches: MatchPositions,
}

impl<'m> RecallRefiner<'m> {
    /// The parts of the refinement. With `w` columns, `D` disparities and `k` candidates they
    /// take, each rounded up to words:
    ///
    /// | part | bytes |
    /// |---|---|
    /// | vote of `v` passes | `2 w ((v + 1) k + v + 2)` |
    /// | median of reach `m` | `2 w (2 m + 1) + 2 D` |
    /// | output, of stages `l` lines late | `3 w + 8 (l + 1)` |
    pub(crate) const fn parts(config: &Config, recall: &RecallParameters) -> Parts {
        let columns = config.region.width as usize;
        let parts = Self::stages(config, recall);
        let output = words(columns, size_of::<i16>())
            + words(columns, 1)
            + 2 * ValidRuns::words(parts.latency_lines() as usize + 1);
        parts.and(Part::memory("output", output))
    }

    /// The stages alone, with the demand of each.
    const fn stages(config: &Config, recall: &RecallParameters) -> Parts {
        let columns = config.region.width as usize;
        let mut parts = Parts::NONE;
        if recall.vote_passes > 0 {
            let candidates = recall.candidates as usize;
            parts = parts.and(VoteFilter::part(columns, candidates, recall.vote_passes));
        }
        if recall.median_reach_px > 0 {
            let disparities = config.disparities.count;
            parts = parts.and(Median::part(columns, recall.median_reach_px, disparities));
        }
        parts
    }

    /// Words of memory.
    #[must_use]
    pub const fn words(config: &Config, recall: &RecallParameters) -> usize {
        Self::parts(config, recall).words()
    }

    /// Carves the memory of the stages that `config` asks for.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena has fewer than
    /// [`RecallRefiner::words`] left.
    pub fn new(
        config: &Config,
        recall: &RecallParameters,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        let columns = usize::from(config.region.width);
        let candidates = usize::from(recall.candidates);
        let passes = recall.vote_passes;
        let reach = recall.median_reach_px;
        let latency = Self::stages(config, recall).latency_lines();
        let vote = (passes > 0)
            .then(|| VoteFilter::new(columns, candidates, passes, arena))
            .transpose()?;
        let median = (reach > 0)
            .then(|| Median::new(columns, reach, config.disparities, arena))
            .transpose()?;
        Ok(Self {
            stages: Then(vote, median),
            line: arena.take(columns)?,
            confidences: arena.take(columns)?,
            valid: [
                ValidRuns::new(latency as usize + 1, arena)?,
                ValidRuns::new(latency as usize + 1, arena)?,
            ],
            rows_out: 0,
            disparities: config.disparities,
            matches: match_positions(config),
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        RowStage::<&[i16]>::reset(&mut self.stages);
        for runs in &mut self.valid {
            runs.clear();
        }
        self.rows_out = 0;
    }

    /// Takes a row of candidate planes, px, with the recalled disparities in plane 0, and the
    /// columns of it and the positions of the other view's row that the cameras saw. Returns
    /// whether this completes a line, which is then [`RecallRefiner::line_q4`].
    pub fn push(&mut self, mut candidates_px: &[i16], valid: [Range<usize>; 2]) -> bool {
        for (runs, run) in self.valid.iter_mut().zip(valid) {
            runs.push(run);
        }
        copy_common(self.line, candidates_px);
        let is_complete = self.stages.push(self.line, &mut candidates_px);
        if is_complete {
            self.write_line();
        }
        is_complete
    }

    /// Completes the next line after the last row; returns false if there are no more.
    pub fn flush(&mut self) -> bool {
        let is_complete = self.stages.flush(self.line, &mut &[][..]);
        if is_complete {
            self.write_line();
        }
        is_complete
    }

    /// The line last completed: `region.width` disparities, 1/16 px.
    #[must_use]
    pub fn line_q4(&self) -> &[i16] {
        self.line
    }

    /// Confidences of the line last completed: 255, or 0 where there is no disparity.
    #[must_use]
    pub fn line_confidences(&self) -> &[u8] {
        self.confidences
    }

    fn write_line(&mut self) {
        let [valid, other_valid] = self.valid.each_ref().map(|runs| runs.row(self.rows_out));
        fill_outside(self.line, &valid, INVALID);
        self.rows_out += 1;
        for (disparity, confidence) in self.line.iter_mut().zip(&mut *self.confidences) {
            *confidence = if *disparity == INVALID { 0 } else { u8::MAX };
            *disparity = px_to_q4(*disparity);
        }
        let disparities = self.disparities;
        self.matches
            .doubt_unseen(self.line, self.confidences, 0, disparities, &other_valid);
    }
}
