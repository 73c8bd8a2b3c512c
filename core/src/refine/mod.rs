//! Refinement: from rows of candidates to lines of disparities, over a short strip.

mod border;
mod fill;
mod median;
mod median9;
mod region_vote;
mod ring;
mod speckle;
mod surface;
mod vote;
mod weighted_median;

pub use fill::fill_row;
pub use median::Median;
pub use median9::{Median9, median9_row};
pub use region_vote::{ArmsRow, RegionVote, arms_row, arms_scratch_bytes};
pub use speckle::Speckle;
pub use surface::SurfaceRefiner;
pub use vote::VoteFilter;
pub use weighted_median::{WeightedMedian, WeightedMedianRow, weighted_median_row};

use crate::config::{Config, ConfigError, Recall};
use crate::disparity::{INVALID, px_to_q4};
use crate::memory::{Arena, words};

/// The refinement stages that a configuration asks for, one after another.
#[derive(Debug)]
pub struct Refiner<'m> {
    vote: Option<VoteFilter<'m>>,
    median: Option<Median<'m>>,
    line_q4: &'m mut [i16],
    confidences: &'m mut [u8],
}

impl<'m> Refiner<'m> {
    /// Words of memory for the stages of `config`.
    #[must_use]
    pub const fn memory_words(config: &Config, recall: &Recall) -> usize {
        let columns = config.region.width as usize;
        let mut total = words(columns, size_of::<i16>()) + words(columns, 1);
        if recall.vote_passes > 0 {
            let candidates = recall.candidates as usize;
            total += VoteFilter::memory_words(columns, candidates, recall.vote_passes);
        }
        if recall.median_reach_px > 0 {
            let disparities = config.disparities.count;
            total += Median::memory_words(columns, recall.median_reach_px, disparities);
        }
        total
    }

    /// Carves the memory of the stages that `config` asks for.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn new(
        config: &Config,
        recall: &Recall,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        let columns = usize::from(config.region.width);
        let candidates = usize::from(recall.candidates);
        let passes = recall.vote_passes;
        let reach = recall.median_reach_px;
        Ok(Self {
            vote: (passes > 0)
                .then(|| VoteFilter::new(columns, candidates, passes, arena))
                .transpose()?,
            median: (reach > 0)
                .then(|| Median::new(columns, reach, config.disparities, arena))
                .transpose()?,
            line_q4: arena.take(columns)?,
            confidences: arena.take(columns)?,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        if let Some(vote) = &mut self.vote {
            vote.reset();
        }
        if let Some(median) = &mut self.median {
            median.reset();
        }
    }

    /// Takes a row of candidate planes, px. True when this completes a line, then
    /// [`Refiner::line_q4`].
    pub fn push(&mut self, candidates_px: &[i16]) -> bool {
        match &mut self.vote {
            Some(vote) => {
                vote.push(candidates_px)
                    && smooth(
                        vote.row(),
                        self.median.as_mut(),
                        self.line_q4,
                        self.confidences,
                    )
            }
            None => smooth(
                candidates_px,
                self.median.as_mut(),
                self.line_q4,
                self.confidences,
            ),
        }
    }

    /// After the last row: completes the next of the lines still to come; false when
    /// there are no more.
    pub fn flush(&mut self) -> bool {
        while let Some(vote) = &mut self.vote
            && vote.flush()
        {
            if smooth(
                vote.row(),
                self.median.as_mut(),
                self.line_q4,
                self.confidences,
            ) {
                return true;
            }
        }
        match &mut self.median {
            Some(median) => {
                let complete = median.flush();
                write_line(median.row(), self.line_q4, self.confidences);
                complete
            }
            None => false,
        }
    }

    /// Confidences of the line last completed: 255, or 0 where there is no disparity.
    #[must_use]
    pub fn line_confidences(&self) -> &[u8] {
        self.confidences
    }

    /// The line last completed: `region.width` disparities, 1/16 px.
    #[must_use]
    pub fn line_q4(&self) -> &[i16] {
        self.line_q4
    }
}

/// The last stages, from a row in px to a line in 1/16 px; true when this completes one.
fn smooth(
    row_px: &[i16],
    median: Option<&mut Median<'_>>,
    line_q4: &mut [i16],
    confidences: &mut [u8],
) -> bool {
    let Some(median) = median else {
        write_line(row_px, line_q4, confidences);
        return true;
    };
    let complete = median.push(row_px);
    if complete {
        write_line(median.row(), line_q4, confidences);
    }
    complete
}

fn write_line(row_px: &[i16], line_q4: &mut [i16], confidences: &mut [u8]) {
    for ((to, confidence), &from) in line_q4.iter_mut().zip(confidences).zip(row_px) {
        *to = px_to_q4(from);
        *confidence = if from == INVALID { 0 } else { u8::MAX };
    }
}
