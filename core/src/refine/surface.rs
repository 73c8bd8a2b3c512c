//! Refinement of checked rows: speckles, vote, fill, and medians, over a short strip.

use super::border::Border;
use super::fill::fill_row;
use super::median9::Median9;
use super::region_vote::RegionVote;
use super::speckle::Speckle;
use super::weighted_median::WeightedMedian;
use crate::config::{Aggregation, Config, ConfigError, Output};
use crate::disparity::{INVALID, Reference, STEPS_PER_PX, px_to_q4};
use crate::kernel::Kernels;
use crate::memory::{Arena, words};
use crate::strip::Strip;

/// The stages after the check, one after another.
#[derive(Debug)]
pub struct SurfaceRefiner<'m, K> {
    speckle: Option<Speckle<'m>>,
    vote: Option<RegionVote<'m, K>>,
    border: Border,
    row: &'m mut [i16],
    median: Median9<'m, K>,
    weighted: Option<(WeightedMedian<'m, K>, Median9<'m, K>)>,
    confidences: &'m mut [u8],
    line_q4: &'m mut [i16],
    line_confidences: &'m mut [u8],
    config: Config,
    latency: u32,
    rows_in: u32,
    rows_out: u32,
}

impl SurfaceRefiner<'_, ()> {
    /// Words of memory for the stages of `config`.
    #[must_use]
    pub const fn memory_words(config: &Config, parameters: &Aggregation) -> usize {
        let width = config.width as usize;
        let columns = config.region.width as usize;
        let mut total = words(width, size_of::<i16>())
            + Median9::memory_words(width)
            + words(width * (parameters.refinement_lines() as usize + 1), 1)
            + words(columns, size_of::<i16>())
            + words(columns, 1);
        if let Some(speckle) = parameters.speckle {
            total += Speckle::memory_words(width, speckle);
        }
        if let Some(vote) = parameters.vote {
            total += RegionVote::memory_words(width, config.disparities, vote);
        }
        if let Some(weighted) = parameters.weighted_median {
            total += WeightedMedian::memory_words(width, weighted) + Median9::memory_words(width);
        }
        total
    }
}

impl<'m, K: Kernels> SurfaceRefiner<'m, K> {
    /// Carves the memory of the stages that `config` asks for.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn new(
        config: &Config,
        parameters: &Aggregation,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        let width = usize::from(config.width);
        let columns = usize::from(config.region.width);
        let latency = parameters.refinement_lines();
        let speckle = match parameters.speckle {
            Some(speckle) => Some(Speckle::new(width, speckle, arena)?),
            None => None,
        };
        let vote = match parameters.vote {
            Some(vote) => Some(RegionVote::new(
                width,
                config.disparities,
                vote,
                kernels,
                arena,
            )?),
            None => None,
        };
        let weighted = match parameters.weighted_median {
            Some(weighted) => Some((
                WeightedMedian::new(width, weighted, kernels, arena)?,
                Median9::new(width, kernels, arena)?,
            )),
            None => None,
        };
        Ok(Self {
            speckle,
            vote,
            border: Border::default(),
            row: arena.take(width)?,
            median: Median9::new(width, kernels, arena)?,
            weighted,
            confidences: arena.take(width * (latency as usize + 1))?,
            line_q4: arena.take(columns)?,
            line_confidences: arena.take(columns)?,
            config: *config,
            latency,
            rows_in: 0,
            rows_out: 0,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        if let Some(speckle) = &mut self.speckle {
            speckle.reset();
        }
        if let Some(vote) = &mut self.vote {
            vote.reset();
        }
        self.border.reset();
        self.median.reset();
        if let Some((weighted, median)) = &mut self.weighted {
            weighted.reset();
            median.reset();
        }
        self.rows_in = 0;
        self.rows_out = 0;
    }

    /// Takes a row as [`RowCheck::write`](crate::aggregation::RowCheck::write) gives it,
    /// in stored order; `channels` are the reference view's strips. True when this completes a
    /// line, then [`SurfaceRefiner::line_q4`].
    pub fn push(&mut self, found_q4: &[i16], confidences: &[u8], channels: &[Strip<'_>]) -> bool {
        let kept = self.confidence_row(self.rows_in);
        if let Some(kept) = self.confidences.get_mut(kept)
            && let Some(confidences) = confidences.get(..kept.len())
        {
            kept.copy_from_slice(confidences);
        }
        self.rows_in += 1;
        copy(self.row, found_q4.iter());
        if let Some(speckle) = &mut self.speckle {
            let Some(row) = speckle.push(self.row) else {
                return false;
            };
            self.reject(row);
        }
        self.vote(channels) && self.write_line()
    }

    /// After the last row: completes the next of the lines still to come; false when
    /// there are no more.
    pub fn flush(&mut self, channels: &[Strip<'_>]) -> bool {
        let first_line = self.config.region.y;
        while let Some(speckle) = &mut self.speckle
            && let Some(row) = speckle.flush(self.row)
        {
            self.reject(row);
            if self.vote(channels) {
                return self.write_line();
            }
        }
        while let Some(vote) = &mut self.vote
            && vote.flush(channels, first_line)
        {
            copy(self.row, vote.row().iter());
            if self.fill_and_smooth(channels) {
                return self.write_line();
            }
        }
        while self.median.flush(self.row) {
            if self.weight(channels) {
                return self.write_line();
            }
        }
        let Some((weighted, last)) = &mut self.weighted else {
            return false;
        };
        while weighted.flush(self.row, channels, first_line) {
            if last.push(self.row) {
                return self.write_line();
            }
        }
        last.flush(self.row) && self.write_line()
    }

    /// The line last completed: `region.width` disparities, 1/16 px.
    #[must_use]
    pub fn line_q4(&self) -> &[i16] {
        self.line_q4
    }

    /// Confidences of the line last completed: 1 to 255; 0 for a disparity that was filled in.
    #[must_use]
    pub fn line_confidences(&self) -> &[u8] {
        self.line_confidences
    }

    /// Takes the confidence from the speckles of a row, which is the present one.
    fn reject(&mut self, row: u32) {
        let kept = self.confidence_row(row);
        let confidences = self.confidences.get_mut(kept).unwrap_or_default();
        for (confidence, &found) in confidences.iter_mut().zip(&*self.row) {
            if found == INVALID {
                *confidence = 0;
            }
        }
    }

    /// The stages from the vote on, on the present row.
    fn vote(&mut self, channels: &[Strip<'_>]) -> bool {
        if let Some(vote) = &mut self.vote {
            if !vote.push(self.row, channels, self.config.region.y) {
                return false;
            }
            copy(self.row, vote.row().iter());
        }
        self.fill_and_smooth(channels)
    }

    fn fill_and_smooth(&mut self, channels: &[Strip<'_>]) -> bool {
        // Relative to the lowest disparity until the line is written.
        let largest_px = self.config.disparities.count.saturating_sub(1);
        self.border
            .extend(self.row, largest_px as i16 * STEPS_PER_PX);
        for found in self.row.iter_mut() {
            // What is still in doubt keeps its own.
            if *found < 0 && *found != INVALID {
                *found = !*found;
            }
        }
        fill_row(self.row);
        self.median.push(self.row) && self.weight(channels)
    }

    /// The stages after the first median, on its row.
    fn weight(&mut self, channels: &[Strip<'_>]) -> bool {
        match &mut self.weighted {
            Some((weighted, last)) => {
                weighted.push(self.row, channels, self.config.region.y) && last.push(self.row)
            }
            None => true,
        }
    }

    /// Crops the completed row to the region, in the order of columns.
    fn write_line(&mut self) -> bool {
        let row = &*self.row;
        let kept = self.confidence_row(self.rows_out);
        self.rows_out += 1;
        let confidences = self.confidences.get(kept).unwrap_or_default();
        let region = &self.config.region;
        let (start, count) = (usize::from(region.x), usize::from(region.width));
        // The right view is stored mirrored.
        let is_mirrored = self.config.reference == Reference::Right;
        let start = if is_mirrored {
            row.len() - start - count
        } else {
            start
        };
        let inside = start..start + count;
        let row = row.get(inside.clone()).unwrap_or_default();
        let confidences = confidences.get(inside).unwrap_or_default();
        copy(self.line_q4, row.iter());
        copy(self.line_confidences, confidences.iter());
        if is_mirrored {
            self.line_q4.reverse();
            self.line_confidences.reverse();
        }
        let is_sparse = self.config.output == Output::Sparse;
        let minimum_q4 = px_to_q4(self.config.disparities.minimum_px);
        for (disparity_q4, confidence) in self
            .line_q4
            .iter_mut()
            .zip(self.line_confidences.iter_mut())
        {
            if *disparity_q4 == INVALID {
                *confidence = 0;
            } else if is_sparse && *confidence == 0 {
                *disparity_q4 = INVALID;
            } else {
                *disparity_q4 += minimum_q4;
            }
        }
        true
    }

    fn confidence_row(&self, row: u32) -> core::ops::Range<usize> {
        let width = usize::from(self.config.width);
        let start = (row % (self.latency + 1).max(1)) as usize * width;
        start..start + width
    }
}

fn copy<'a, T: Copy + 'a>(to: &mut [T], from: impl Iterator<Item = &'a T>) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = from;
    }
}
