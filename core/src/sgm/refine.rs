//! The refinement of checked rows: all stages up to a line of disparities.

use core::ops::Range;

use super::fill::Fill;
use super::medians::{Median9, WeightedMedian};
use super::region_vote::RegionVote;
use super::speckle::Speckle;
use super::surroundings::Surroundings;
use crate::config::{Config, ConfigError, Output, Region, SgmParameters};
use crate::disparity::{DisparityRange, INVALID, Reference, px_to_q4};
use crate::kernel::Kernels;
use crate::rows::{
    Arena, MatchPositions, Part, Parts, Ring, RowStage, Strip, Then, ValidRuns, copy_common,
    fill_outside, words,
};

/// The stages in order. The parameters may leave a stage out; with the weighted median, the second
/// median of 3 x 3 is left out too.
type Stages<'m, K> = Then<
    Option<Speckle<'m>>,
    Then<
        Option<RegionVote<'m, K>>,
        Then<Fill, Then<Median9<'m, K>, Option<Then<WeightedMedian<'m, K>, Median9<'m, K>>>>>,
    >,
>;

/// Takes rows of checked disparities and returns lines of disparities, a few rows later.
#[derive(Debug)]
pub struct SgmRefiner<'m, K> {
    stages: Stages<'m, K>,
    row: &'m mut [i16],
    /// Confidences of the rows that are in the stages.
    confidences: Ring<'m, u8>,
    /// For each of these rows, the run of stored positions that the camera saw, of the reference view and
    /// of the other one.
    valid: [ValidRuns<'m>; 2],
    line_q4: &'m mut [i16],
    line_confidences: &'m mut [u8],
    disparities: DisparityRange,
    region: Region,
    /// Whether columns are stored mirrored, as those of the right view are.
    is_mirrored: bool,
    is_sparse: bool,
    rows_out: u32,
}

impl SgmRefiner<'_, ()> {
    /// The stages alone, with the demand of each.
    pub(super) const fn stages(config: &Config, sgm: &SgmParameters) -> Parts {
        let width = config.width as usize;
        let mut parts = Parts::NONE;
        if let Some(speckle) = &sgm.speckle {
            parts = parts.and(Speckle::part(width, speckle));
        }
        if let Some(vote) = &sgm.vote {
            parts = parts.and(RegionVote::part(width, config.disparities, vote));
        }
        parts = parts.and(Median9::part(width));
        if let Some(weighted) = &sgm.weighted_median {
            parts = parts
                .and(WeightedMedian::part(width, weighted))
                .and(Median9::part(width));
        }
        parts
    }

    /// The parts of the refinement. With `W` columns (region `w`) and `D` disparities they take,
    /// each rounded up to words:
    ///
    /// | part | bytes |
    /// |---|---|
    /// | speckle removal, regions of fewer than `k` pixels, reach `y` | `2 W (2 y + 1) + 6 k` |
    /// | region vote, reach `(x, y)` | `4 W (2 y + 1) + 4 W + 2 D` |
    /// | each median of 3 x 3 | `6 W + 12` |
    /// | weighted median of `p` taps, reach `(x, y)` | `2 (W + 2 x) (2 y + 1) + 17 p` |
    /// | output, of stages `l` lines late | `2 W + (W + 8) (l + 1) + 3 w` |
    pub(crate) const fn parts(config: &Config, sgm: &SgmParameters) -> Parts {
        let width = config.width as usize;
        let columns = config.region.width as usize;
        let stages = SgmRefiner::stages(config, sgm);
        let rows = stages.latency_lines() as usize + 1;
        let output = words(width, size_of::<i16>())
            + Ring::<u8>::words(width, 0, rows)
            + 2 * ValidRuns::words(rows)
            + words(columns, size_of::<i16>())
            + words(columns, 1);
        stages.and(Part::memory("output", output))
    }
}

impl<'m, K: Kernels> SgmRefiner<'m, K> {
    /// Words of memory.
    #[must_use]
    pub const fn words(config: &Config, sgm: &SgmParameters) -> usize {
        SgmRefiner::parts(config, sgm).words()
    }

    /// Carves the memory of the stages that `config` asks for.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena has fewer than
    /// [`SgmRefiner::words`] left.
    pub fn new(
        config: &Config,
        sgm: &SgmParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate_for::<K>()?;
        let width = usize::from(config.width);
        let columns = usize::from(config.region.width);
        let latency = SgmRefiner::stages(config, sgm).latency_lines();
        let speckle = match sgm.speckle {
            Some(speckle) => Some(Speckle::new(width, speckle, arena)?),
            None => None,
        };
        let vote = match sgm.vote {
            Some(vote) => {
                let disparities = config.disparities;
                Some(RegionVote::new(width, disparities, vote, kernels, arena)?)
            }
            None => None,
        };
        let median = Median9::new(width, kernels, arena)?;
        let weighted = match sgm.weighted_median {
            Some(weighted) => Some(Then(
                WeightedMedian::new(width, weighted, kernels, arena)?,
                Median9::new(width, kernels, arena)?,
            )),
            None => None,
        };
        Ok(Self {
            stages: Then(
                speckle,
                Then(vote, Then(Fill::new(config), Then(median, weighted))),
            ),
            row: arena.take(width)?,
            confidences: Ring::new(width, 0, latency as usize + 1, 0, arena)?,
            valid: [
                ValidRuns::new(latency as usize + 1, arena)?,
                ValidRuns::new(latency as usize + 1, arena)?,
            ],
            line_q4: arena.take(columns)?,
            line_confidences: arena.take(columns)?,
            disparities: config.disparities,
            region: config.region,
            is_mirrored: config.reference == Reference::Right,
            is_sparse: config.output == Output::Sparse,
            rows_out: 0,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        RowStage::<Surroundings<'_, '_, '_>>::reset(&mut self.stages);
        self.confidences.clear();
        for runs in &mut self.valid {
            runs.clear();
        }
        self.rows_out = 0;
    }

    /// Takes the checks of a configuration that differs in nothing else. Returns whether there is memory
    /// for its speckles; if not, nothing has changed.
    pub(crate) fn set_checks(&mut self, config: &Config, sgm: &SgmParameters) -> bool {
        let Then(speckle, _) = &mut self.stages;
        if let (Some(stage), Some(speckle)) = (speckle, &sgm.speckle) {
            if !stage.has_room_for(speckle.size_min) {
                return false;
            }
            stage.set_bounds(speckle.size_min, speckle.step_q4);
        }
        self.is_sparse = config.output == Output::Sparse;
        true
    }

    /// Takes a row as [`RowCheck::write`](super::RowCheck::write) writes it, in stored order, and
    /// the positions of it and of the other view's row that the cameras saw. `channels` are the
    /// reference view's, with all lines that
    /// [`SgmPlan::refinement_view`](super::SgmPlan::refinement_view) keeps. Returns whether this
    /// completes a line, which is then [`SgmRefiner::line_q4`].
    pub fn push(
        &mut self,
        found: &[i16],
        confidences: &[u8],
        valid: [Range<usize>; 2],
        channels: &[Strip<'_>],
    ) -> bool {
        self.confidences.push_copy(confidences);
        for (runs, run) in self.valid.iter_mut().zip(valid) {
            runs.push(run);
        }
        copy_common(self.row, found);
        let mut around = Surroundings {
            channels,
            first_line: self.region.y,
            confidences: &mut self.confidences,
        };
        self.stages.push(self.row, &mut around) && self.write_line()
    }

    /// Completes the next line after the last row; returns false if there are no more. `channels`
    /// are as for [`SgmRefiner::push`].
    pub fn flush(&mut self, channels: &[Strip<'_>]) -> bool {
        let mut around = Surroundings {
            channels,
            first_line: self.region.y,
            confidences: &mut self.confidences,
        };
        self.stages.flush(self.row, &mut around) && self.write_line()
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

    /// Crops the completed row to what the camera saw and to the region, in the order of columns,
    /// and adds the lowest disparity. Always returns true.
    fn write_line(&mut self) -> bool {
        let [valid, other_valid] = self.valid.each_ref().map(|runs| runs.row(self.rows_out));
        fill_outside(self.row, &valid, INVALID);
        let row = &*self.row;
        let confidences = self.confidences.row_mut(self.rows_out);
        let disparities = self.disparities;
        let minimum_q4 = px_to_q4(disparities.minimum_px);
        // The stored orders of the views run against each other.
        MatchPositions {
            first: row.len() as i32 - 1,
            step: -1,
        }
        .doubt_unseen(row, confidences, minimum_q4, disparities, &other_valid);
        self.rows_out += 1;
        let (start, count) = (usize::from(self.region.x), usize::from(self.region.width));
        let start = if self.is_mirrored {
            row.len() - start - count
        } else {
            start
        };
        let inside = start..start + count;
        copy_common(self.line_q4, row.get(inside.clone()).unwrap_or_default());
        copy_common(
            self.line_confidences,
            confidences.get(inside).unwrap_or_default(),
        );
        if self.is_mirrored {
            self.line_q4.reverse();
            self.line_confidences.reverse();
        }
        let (line_q4, confidences) = (&mut *self.line_q4, &mut *self.line_confidences);
        // In loops of their own, most of which a line seldom needs.
        if line_q4.contains(&INVALID) {
            for (confidence, &disparity_q4) in confidences.iter_mut().zip(&*line_q4) {
                if disparity_q4 == INVALID {
                    *confidence = 0;
                }
            }
        }
        if self.is_sparse {
            for (disparity_q4, &confidence) in line_q4.iter_mut().zip(&*confidences) {
                if confidence == 0 {
                    *disparity_q4 = INVALID;
                }
            }
        }
        if minimum_q4 != 0 {
            for disparity_q4 in line_q4.iter_mut().filter(|&&mut it| it != INVALID) {
                *disparity_q4 += minimum_q4;
            }
        }
        true
    }
}
