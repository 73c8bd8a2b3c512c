//! Parameters of the method: all that a preset fixes.

use core::fmt;
use core::num::NonZeroU8;

use crate::kernel::{MAX_TAP_ROWS, SubpixelStep, SynapseLaw, TieBreak};
use crate::rows::MAX_MOVED_LINES;

/// Largest number of synapses of a neuron.
pub const MAX_SYNAPSES: usize = 1024;

/// The number of synapses must be a multiple of this.
pub const SYNAPSE_STEP: usize = 16;

/// Largest standard deviation of the synapses' offsets, px.
pub const MAX_SIGMA_PX: f32 = 10.0;

/// Largest number of candidates per pixel.
pub const MAX_CANDIDATES: u8 = 16;

/// Largest reach of the paper's median, px.
pub const MAX_MEDIAN_REACH_PX: u8 = 63;

/// Largest reach of [`RivalParameters`], px: 65 costs of at most 254 fit 16 bits.
pub const MAX_RIVAL_REACH_PX: u8 = 64;

/// Largest offset between the lines of the two views that is corrected, lines.
pub const MAX_LINE_OFFSET_LINES: u8 = MAX_MOVED_LINES as u8;

/// Parameters of the method: all that a preset fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Parameters {
    /// |W|, the number of synapses of a neuron: 16 to 1024, a multiple of 16.
    pub synapses: u16,
    /// Standard deviations of the offsets, px, above 0 and at most 10: that of the first half of
    /// the synapses, and that of the second half. The larger comes first, as the first half
    /// samples smoothed lines.
    pub sigmas_px: [f32; 2],
    /// Largest distance between the two samples of a cell, px; 0 for any. An offset that lies further
    /// from the one before it is drawn again. The two cells of which each half has one sample may be
    /// longer.
    pub cell_length_max_px: u8,
    /// Reach of the offsets; [`Support::three_sigma`] by default.
    pub support: Support,
    /// Seed of the offsets.
    pub seed: u64,
    /// Method that is applied to the patterns.
    pub method: Method,
}

/// Method that is applied to the patterns, with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "kebab-case"))]
pub enum Method {
    /// The paper's method: the disparity of the nearest pattern.
    Recall(RecallParameters),
    /// Distances of patterns as matching costs, aggregated semi-globally, checked and filled.
    #[cfg_attr(feature = "serde", serde(alias = "aggregation"))]
    Sgm(SgmParameters),
}

/// Parameters of the paper's method and its post-processing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RecallParameters {
    /// Choice among several nearest patterns at one distance.
    pub ties: TieBreak,
    /// Number of candidates kept per pixel, 1 to 16; more than 1 only serves the vote.
    pub candidates: u8,
    /// Number of passes of the vote filter; 0 turns it off. Each is a line of latency.
    pub vote_passes: u8,
    /// Reach of the median, px, at most 63; its window has `2 reach + 1` columns and lines.
    /// 0 turns it off.
    pub median_reach_px: u8,
}

/// Parameters of the matching costs, their semi-global aggregation, and the refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SgmParameters {
    /// Whether colour is used where lines have it: for masks, differences of levels, vote
    /// and weighted median. Patterns are of grey in any case.
    pub colour: bool,
    /// Largest step between neighbours that is smoothed, levels of grey. The first half of the
    /// synapses samples smoothed lines, the second half lines as they came. Nothing is smoothed if
    /// this is 0, or if the support has a single column or line.
    pub smoothing_step: u8,
    /// Smallest share of a pixel's cells that counts, 1/256: the cells whose samples are most
    /// like the pixel itself. At 256, every cell counts.
    pub kept_cells_q8: u16,
    /// Difference of a cell's samples from the pixel, levels summed over red, green and blue,
    /// up to which the cell always counts.
    pub mask_floor: u8,
    /// Increment of that difference where too few cells count, levels summed over red, green
    /// and blue. It is doubled until enough count.
    pub mask_step: NonZeroU8,
    /// Cost of a pattern whose unmasked cells all differ, at most 250.
    pub hamming_scale: u8,
    /// Largest cost of a pattern.
    pub hamming_truncation: u8,
    /// Share of a pixel's unmasked cells that must be 1 for its pattern to cost up to
    /// `hamming_truncation`, 1/256; about half are where there is texture. With fewer, its pattern
    /// costs proportionally less at most, as it tells less: on what is clipped or plain, levels, P1
    /// and P2 decide. 0 gives every pattern the same truncation.
    pub evidence_q8: u8,
    /// Cost of a difference of one level between the views, 1/16 of a cost; 0 leaves levels out.
    pub difference_weight_q4: u8,
    /// Largest difference of levels that counts, levels.
    pub difference_truncation: u8,
    /// Largest offset between the lines of the two views that is corrected, lines, at most 4. It may change
    /// along the line, as it does if one camera is turned against the other. It is learned from the matches
    /// above, which requires `difference_weight_q4` above 0. Each line but the first is one more line of
    /// latency. With 0, lines are used as they come.
    pub line_offset_max_lines: u8,
    /// Largest gain of single lines of the other view that is mended, 1/256 above 1: dark and bright bands
    /// of mains light, and noise of rows. 0 leaves the brightness of lines as it came. The exposures of the
    /// cameras, from which lines deviate, are learned if `difference_weight_q4` is above 0, else taken for equal.
    pub line_gain_max_q8: u8,
    /// Difference of matched levels up to which their noise is reckoned with by the other parameters alone,
    /// levels. Where they usually differ by more, larger steps are smoothed, differences of levels cost
    /// less, and steps of the image lower P2 less. At 255, noise changes nothing. Noise is learned if
    /// `difference_weight_q4` is above 0.
    pub usual_difference_max: u8,
    /// P1, the penalty of a step of one disparity along a path.
    pub p1: u8,
    /// P2, the penalty of a larger step, where the image is flat.
    pub p2: u8,
    /// Smallest P2.
    pub p2_floor: u8,
    /// Decrease of P2 per level of a step in the image, 1/16.
    pub p2_adaptation_q4: u8,
    /// Sub-pixel step from the sums of the path costs.
    pub subpixel: SubpixelStep,
    /// Left-right check: largest difference between the disparities of the two views, px.
    pub left_right_tolerance_px: u8,
    /// Uniqueness: smallest margin between the sums of the best and the second best disparity.
    /// A pixel with a smaller one is in doubt.
    pub margin: i16,
    /// Smallest texture of a pixel that is not in doubt: the sum of the absolute steps of grey
    /// along the line over the reach of the synapses, levels. 0 asks for none.
    pub texture_min: u16,
    /// Doubt where a second disparity fits about as well; `None` leaves it out.
    pub rivals: Option<RivalParameters>,
    /// Rejection of small regions; `None` leaves it out.
    pub speckle: Option<SpeckleParameters>,
    /// Cross-based vote on pixels that were rejected or are in doubt; `None` leaves it out.
    pub vote: Option<RegionVoteParameters>,
    /// Weighted median, between two medians of 3 x 3; without it there is one of 3 x 3.
    pub weighted_median: Option<WeightedMedianParameters>,
}

/// Parameters of the doubt where a second disparity fits about as well as the best.
///
/// For each disparity, the matching costs of every second pixel of a window along the line are summed up.
/// If the disparities are no multiple of four, the last ones are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RivalParameters {
    /// Reach of the window to either side, px, at most [`MAX_RIVAL_REACH_PX`].
    pub reach_px: u8,
    /// Ratio to the least sum below which a sum is that of a rival, 1/16; `slack` is added to the product.
    pub ratio_q4: u8,
    /// Cost that is added to `ratio_q4` times the least sum.
    pub slack: u8,
    /// Height of the wall that parts the least sum from its rival: a sum between them is larger than a
    /// rival's may be by at least so much cost per pixel that was summed up.
    pub rise: u8,
    /// Shorter runs of pixels with rivals are taken for chance, px.
    pub run_min_px: u8,
    /// Pixels up to this far from a run are in doubt, too, px.
    pub spread_px: u8,
    /// Every so many rows are searched for rivals; those between have the doubts of the row above. 0 is
    /// taken for 1.
    pub row_step: u8,
    /// The matching costs of pixels in doubt are divided by 2 to the power of this before they are aggregated, below 8:
    /// along what repeats, costs tell how disparities go on, and hardly which of them is right.
    pub cost_shift: u8,
    /// P2 of a pixel in doubt is this, or [`SgmParameters::p2`] if that is larger, whatever the steps of the image: the
    /// edges of what repeats are no outlines. With 0, P2 is that of other pixels.
    pub p2_min: u8,
}

/// Parameters of the speckle removal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SpeckleParameters {
    /// Regions of fewer pixels within the window are rejected.
    pub size_min: u8,
    /// Largest difference between neighbours of one region, 1/16 px.
    pub step_q4: u8,
    /// Reach of the window across lines, at most 15; as many lines of latency.
    pub reach_y_px: u8,
}

/// Parameters of the cross-based region vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RegionVoteParameters {
    /// Reach along the line, px, at most 127.
    pub reach_x_px: u8,
    /// Reach across lines, at most 15; as many lines of latency.
    pub reach_y_px: u8,
    /// Largest difference from the centre in any channel, levels, in the nearer half of the
    /// reach.
    pub near_step: u8,
    /// Largest difference from the centre in any channel, levels, in the farther half.
    pub far_step: u8,
    /// Which pixels of the region have a vote.
    pub voters: Voters,
    /// The number of votes must be more than this.
    pub support_min: u8,
    /// The winner's share of the votes must be more than this, percent.
    pub share_min_percent: u8,
}

/// Pixels of a region that have a vote: about a quarter of them in either case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Voters {
    /// Every other pixel of every other line. The votes for a pixel and for the one below it are
    /// of different lines, so that the two may take different disparities: stripes.
    OtherLines,
    /// Every fourth pixel of every line, from the first of a run on even lines and from the
    /// third on odd lines; on odd lines from the first if the run has no third.
    EveryLine,
}

/// Parameters of the weighted median.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct WeightedMedianParameters {
    /// Reach along the line, px, even, at most 30.
    pub reach_x_px: u8,
    /// Reach across lines, even, at most 6; as many lines of latency.
    pub reach_y_px: u8,
    /// Difference of colour, levels summed over red, green and blue, from which on a pixel has no
    /// weight: 4 to 48.
    pub colour_reach: u8,
}

impl WeightedMedianParameters {
    /// Largest reach along the line.
    pub const MAX_REACH_X_PX: u8 = 30;
    /// Largest reach across lines.
    pub const MAX_REACH_Y_PX: u8 = MAX_TAP_ROWS as u8 - 1;
    /// Largest number of taps: their weights, at most 180 each, sum to 16 bits.
    pub const MAX_TAPS: usize = (Self::MAX_REACH_X_PX as usize + 1) * MAX_TAP_ROWS;

    /// Offsets of the taps from the centre, (columns, rows), row by row: every other pixel
    /// of every other row.
    pub(crate) fn taps(&self) -> impl Iterator<Item = (i32, i32)> + use<> {
        let (reach_x, reach_y) = (i32::from(self.reach_x_px), i32::from(self.reach_y_px));
        let rows = (-reach_y..=reach_y).step_by(2);
        rows.flat_map(move |dy| (-reach_x..=reach_x).step_by(2).map(move |dx| (dx, dy)))
    }

    /// Weight of a tap by its distance, 1/16: 20 at the centre, one less for each pixel
    /// along and across, at least 1.
    pub(crate) fn place_weight((dx, dy): (i32, i32)) -> u8 {
        (20 - dx.abs() - dy.abs()).max(1) as u8
    }

    /// Number of taps in one of the window's rows.
    pub(crate) const fn taps_per_row(&self) -> usize {
        self.reach_x_px as usize + 1
    }

    /// Number of taps, at most [`WeightedMedianParameters::MAX_TAPS`].
    #[must_use]
    pub const fn tap_count(&self) -> usize {
        self.taps_per_row() * (self.reach_y_px as usize + 1)
    }
}

/// Largest offsets from the centre: `|dx| <= x_px`, `|dy| <= y_px`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Support {
    /// Reach along the line, px, at most 127.
    pub x_px: u8,
    /// Reach across lines, at most 127; patterns look at `2 * y_px + 1` lines.
    pub y_px: u8,
}

impl Support {
    /// A support that reaches `radius_px` in x and y.
    #[must_use]
    pub const fn square(radius_px: u8) -> Self {
        Self {
            x_px: radius_px,
            y_px: radius_px,
        }
    }

    /// The default support: three standard deviations, rounded up.
    #[must_use]
    pub const fn three_sigma(sigma_px: f32) -> Self {
        let reach_px = 3.0 * sigma_px;
        // A saturating cast rounds towards zero, which is all that `const` arithmetic offers.
        let floor = reach_px as u8;
        Self::square(if floor as f32 == reach_px {
            floor
        } else {
            floor.saturating_add(1)
        })
    }

    /// Whether offsets of this support fit their `i8` storage.
    #[must_use]
    pub const fn is_valid(self) -> bool {
        self.x_px <= i8::MAX as u8 && self.y_px <= i8::MAX as u8
    }
}

/// Reason for which synapses could not be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SynapseError {
    /// Sigma is not in `0.0 < sigma <= 10.0` px.
    Sigma,
    /// The support is larger than 127 px.
    Support,
}

impl fmt::Display for SynapseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sigma => "sigma must be above 0 and at most 10 px",
            Self::Support => "the support must be at most 127 px",
        })
    }
}

impl core::error::Error for SynapseError {}

impl SgmParameters {
    /// Whether the windows of the refinement are within their bounds, and some cells are kept:
    /// speckle removal up to 15 lines, the vote 127 px and 15 lines, the weighted median an even
    /// 30 px and 6 lines with a reach of colour of 4 to 48.
    #[must_use]
    pub const fn windows_fit(&self) -> bool {
        let speckle = match &self.speckle {
            Some(speckle) => speckle.reach_y_px <= 15,
            None => true,
        };
        let vote = match &self.vote {
            Some(vote) => vote.reach_x_px <= 127 && vote.reach_y_px <= 15,
            None => true,
        };
        let median = match &self.weighted_median {
            Some(median) => {
                median.reach_x_px <= WeightedMedianParameters::MAX_REACH_X_PX
                    && median.reach_y_px <= WeightedMedianParameters::MAX_REACH_Y_PX
                    && (median.reach_x_px | median.reach_y_px).is_multiple_of(2)
                    && median.colour_reach >= 4
                    && median.colour_reach <= 48
            }
            None => true,
        };
        let rivals = match &self.rivals {
            Some(rivals) => rivals.reach_px <= MAX_RIVAL_REACH_PX,
            None => true,
        };
        rivals && speckle && vote && median && self.kept_cells_q8 > 0
    }

    /// Whether no cell is masked.
    #[must_use]
    pub const fn every_cell_counts(&self) -> bool {
        self.kept_cells_q8 >= 256
    }

    /// Largest number of lines by which a pixel of the other view is moved to its place in the reference view;
    /// 0 if none is moved.
    #[must_use]
    pub const fn moving_lines(&self) -> u8 {
        if self.difference_weight_q4 > 0 {
            self.line_offset_max_lines
        } else {
            0
        }
    }

    /// Number of lines that must come after a line before all of its pixels can be moved, less the one that
    /// patterns do without.
    #[must_use]
    pub const fn moving_latency_lines(&self) -> u8 {
        self.moving_lines().saturating_sub(1)
    }

    /// Whether every path cost fits 8 bits: the largest matching cost and the largest penalty
    /// together are below 255, the scale is at most 250, and P2 is never below P1 or its floor. Costs in doubt are
    /// shifted by less than 8.
    #[must_use]
    pub const fn costs_fit_u8(&self) -> bool {
        let difference =
            (self.difference_truncation as u32 * self.difference_weight_q4 as u32) >> 4;
        let cost = self.hamming_truncation as u32 + difference;
        let (p2_min, shift) = match &self.rivals {
            Some(rivals) => (rivals.p2_min, rivals.cost_shift),
            None => (0, 0),
        };
        let p2 = if p2_min > self.p2 { p2_min } else { self.p2 };
        cost + (p2 as u32) < 255
            && shift < 8
            && self.hamming_scale <= 250
            && self.p1 <= self.p2
            && self.p2_floor <= self.p2
    }
}

impl Parameters {
    /// These parameters with another sigma for all synapses, and a support of three sigma.
    #[must_use]
    pub const fn with_sigma(mut self, sigma_px: f32) -> Self {
        self.sigmas_px = [sigma_px; 2];
        self.support = Support::three_sigma(sigma_px);
        self
    }

    /// What the offsets are drawn from.
    pub(crate) const fn synapse_law(&self) -> SynapseLaw {
        SynapseLaw {
            sigmas_px: self.sigmas_px,
            cell_length_max_px: self.cell_length_max_px,
            support_px: [self.support.x_px, self.support.y_px],
            seed: self.seed,
        }
    }

    /// These parameters with another seed, for the offsets and for ties.
    #[must_use]
    pub const fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        if let Method::Recall(recall) = &mut self.method {
            recall.ties = recall.ties.with_seed(seed);
        }
        self
    }
}
