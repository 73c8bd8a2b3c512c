//! What to compute: method parameters, image size, disparities, region, reference.

use core::fmt;
use core::num::NonZeroU8;

use crate::camera::PixelFormat;
use crate::disparity::{DisparityRange, MAX_MAGNITUDE_PX, Reference};
use crate::matching::{RowMatcher, SurfaceMatcher, TieBreak};
use crate::memory::{OutOfMemory, words};
use crate::minchinton::SYNAPSE_STEP;
use crate::refine::{Refiner, SurfaceRefiner};
use crate::synapse::{MAX_SIGMA_PX, MAX_SYNAPSES, Support, SynapseError};

/// Largest number of candidates kept per pixel.
pub const MAX_CANDIDATES: u8 = 16;

/// Largest reach of the median, px.
pub const MAX_MEDIAN_REACH_PX: u8 = 63;

/// Largest offset of the other view's lines, 1/16 line.
pub const MAX_LINE_OFFSET_Q4: u8 = 16;

/// The method's parameters: all that a preset fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Parameters {
    /// |W|: 16 to 1024, a multiple of 16.
    pub synapses: u16,
    /// Standard deviation of the offsets, px, above 0 and at most 10: of the first half of
    /// the synapses and of the second. The larger first: lines are smoothed for that half.
    pub sigmas_px: [f32; 2],
    /// Reach of the offsets; [`Support::three_sigma`] unless there is a reason.
    pub support: Support,
    /// Seed of the offsets.
    pub seed: u64,
    /// What is made of the patterns.
    pub method: Method,
}

/// What is made of the patterns.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "kind", rename_all = "kebab-case"))]
pub enum Method {
    /// The nearest pattern's disparity, as the paper has it.
    Recall(Recall),
    /// Distances as costs, aggregated, checked and filled.
    Aggregation(Aggregation),
}

/// The paper's method and its post-processing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Recall {
    /// How ties are broken.
    pub ties: TieBreak,
    /// Candidates kept per pixel, 1 to 16; more than 1 only serves the vote.
    pub candidates: u8,
    /// Passes of the vote filter; 0 turns it off. Each is a line of latency.
    pub vote_passes: u8,
    /// The median covers `2 reach + 1` pixels squared; 0 turns it off, at most 63.
    pub median_reach_px: u8,
}

/// Costs, their semi-global aggregation, and what follows it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Aggregation {
    /// Whether colour is used where lines have it: for masks, differences of levels, vote
    /// and weighted median. Patterns are of grey in any case.
    pub colour: bool,
    /// Largest step of grey between neighbours that is smoothed, levels, for the first half
    /// of the synapses; the others see lines as they came. Nothing is smoothed where this is 0,
    /// or the support a single column or line.
    pub smoothing_step: u8,
    /// Share of a pixel's cells that count at least, 1/256: those whose samples are most
    /// like the pixel itself. 256 counts all.
    pub kept_cells_q8: u16,
    /// Difference from the pixel, summed over red, green and blue, up to which a cell
    /// always counts.
    pub mask_floor: u8,
    /// By how much a cell's difference may be larger where that keeps too few, summed
    /// likewise; twice, four times and so on until enough count.
    pub mask_step: NonZeroU8,
    /// Cost of a pattern all of whose cells that count differ, at most 250.
    pub hamming_scale: u8,
    /// Largest cost of a pattern.
    pub hamming_truncation: u8,
    /// Cost of a difference of one level between the views, 1/16; 0 leaves levels out.
    pub difference_weight_q4: u8,
    /// Largest difference of levels that counts.
    pub difference_truncation: u8,
    /// Largest offset of the other view's lines that is made up for, 1/16 line, at most 16: it
    /// is learned on the way, along with the other camera's exposure, where levels count.
    /// 0 takes lines as they come.
    pub line_offset_max_q4: u8,
    /// Penalty of a step of one disparity along a path.
    pub p1: u8,
    /// Penalty of a larger step where the image is flat.
    pub p2: u8,
    /// Least penalty of a larger step.
    pub p2_floor: u8,
    /// How much the penalty falls per level of a step in the image, 1/16.
    pub p2_adaptation_q4: u8,
    /// Largest difference of the two views' disparities, px.
    pub left_right_tolerance_px: u8,
    /// Smallest margin between the best disparity's sum and the second best's.
    pub margin: i16,
    /// Smallest texture of a pixel: the sum of the absolute steps of grey along the line over
    /// the reach of the synapses; 0 asks for none.
    pub texture_min: u16,
    /// Rejection of small regions.
    pub speckle: Option<SpeckleParameters>,
    /// Vote on rejected pixels.
    pub vote: Option<RegionVoteParameters>,
    /// Weighted median, between two medians of 3 x 3; without it there is one.
    pub weighted_median: Option<WeightedMedianParameters>,
}

/// Parameters of [`Speckle`](crate::refine::Speckle).
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

/// Parameters of [`RegionVote`](crate::refine::RegionVote).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct RegionVoteParameters {
    /// Reach along the line, px, at most 127.
    pub reach_x_px: u8,
    /// Reach across lines, at most 15; as many lines of latency.
    pub reach_y_px: u8,
    /// Largest difference from the centre in any channel, in the nearer half of the reach.
    pub near_step: u8,
    /// The same in the farther half.
    pub far_step: u8,
    /// Votes must be more than this; every other pixel of every other line has one.
    pub support_min: u8,
    /// The winner's share of the votes must be more than this, percent.
    pub share_min_percent: u8,
}

/// Parameters of [`WeightedMedian`](crate::refine::WeightedMedian).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct WeightedMedianParameters {
    /// Reach along the line, px, even, at most 30.
    pub reach_x_px: u8,
    /// Reach across lines, even, at most 6; as many lines of latency.
    pub reach_y_px: u8,
    /// Difference of colour, summed over red, green and blue, at which nothing weighs any
    /// more: 4 to 48.
    pub colour_reach: u8,
}

impl WeightedMedianParameters {
    /// Largest reach along the line.
    pub const MAX_REACH_X_PX: u8 = 30;
    /// Largest reach across lines.
    pub const MAX_REACH_Y_PX: u8 = 6;
    /// Most rows of taps.
    pub const MAX_ROWS: usize = Self::MAX_REACH_Y_PX as usize + 1;
    /// Most taps: their weights of at most 180 sum to 16 bits.
    pub const MAX_TAPS: usize = (Self::MAX_REACH_X_PX as usize + 1) * Self::MAX_ROWS;

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

    /// Taps of one of the window's rows.
    pub(crate) const fn taps_per_row(&self) -> usize {
        self.reach_x_px as usize + 1
    }

    /// Number of taps, at most [`WeightedMedianParameters::MAX_TAPS`].
    #[must_use]
    pub const fn tap_count(&self) -> usize {
        self.taps_per_row() * (self.reach_y_px as usize + 1)
    }
}

impl Aggregation {
    /// Whether the windows of the refinement are within their bounds, and some cells are
    /// kept.
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
        speckle && vote && median && self.kept_cells_q8 > 0
    }

    /// Whether lines of the other view are moved to where those of the reference view are.
    #[must_use]
    pub const fn aligns_lines(&self) -> bool {
        self.line_offset_max_q4 > 0 && self.difference_weight_q4 > 0
    }

    /// Whether every path cost fits 8 bits: the largest matching cost and the largest
    /// penalty together stay below what marks the end of the range.
    #[must_use]
    pub const fn fits(&self) -> bool {
        let difference =
            (self.difference_truncation as u32 * self.difference_weight_q4 as u32) >> 4;
        let cost = self.hamming_truncation as u32 + difference;
        cost + (self.p2 as u32) < 255
            && self.hamming_scale <= 250
            && self.p1 <= self.p2
            && self.p2_floor <= self.p2
    }
}

impl Parameters {
    /// The same parameters with another sigma and the support that goes with it.
    #[must_use]
    pub const fn with_sigma(mut self, sigma_px: f32) -> Self {
        self.sigmas_px = [sigma_px; 2];
        self.support = Support::three_sigma(sigma_px);
        self
    }

    /// The same parameters with another seed, for the offsets and for ties.
    #[must_use]
    pub const fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        if let Method::Recall(recall) = &mut self.method {
            recall.ties = recall.ties.with_seed(seed);
        }
        self
    }

    /// Lines between a pair of lines going in and its disparities coming out: pair
    /// `y + latency_lines` completes line `y`.
    #[must_use]
    pub const fn latency_lines(&self) -> u32 {
        self.support.y_px as u32
            + match &self.method {
                Method::Recall(recall) => recall.vote_passes as u32 + recall.median_reach_px as u32,
                Method::Aggregation(aggregation) => aggregation.refinement_lines(),
            }
    }
}

impl Aggregation {
    /// Lines of latency of what follows the aggregation.
    #[must_use]
    pub const fn refinement_lines(&self) -> u32 {
        let speckle = match &self.speckle {
            Some(speckle) => speckle.reach_y_px as u32,
            None => 0,
        };
        let vote = match &self.vote {
            Some(vote) => vote.reach_y_px as u32,
            None => 0,
        };
        let medians = match &self.weighted_median {
            Some(median) => median.reach_y_px as u32 + 2,
            None => 1,
        };
        speckle + vote + medians
    }
}

/// A rectangle of the reference view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Region {
    /// First column, px.
    pub x: u16,
    /// First line.
    pub y: u32,
    /// Columns, at least 1.
    pub width: u16,
    /// Lines, at least 1; the region ends with the frame if that is shorter.
    pub height: u32,
}

impl Region {
    /// All of a view of `width` columns, whatever its number of lines.
    #[must_use]
    pub const fn whole(width: u16) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height: u32::MAX,
        }
    }

    /// Whether line `line` of the frame is inside.
    #[must_use]
    pub const fn contains_line(&self, line: u32) -> bool {
        line >= self.y && line - self.y < self.height
    }
}

/// What becomes of the pixels whose disparity was not found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// They are filled in, with confidence 0.
    #[default]
    Dense,
    /// They are [`INVALID`](crate::disparity::INVALID).
    Sparse,
}

/// Everything a matcher is built from. The number of lines is not part of it: memory
/// does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The method's parameters.
    pub parameters: Parameters,
    /// Columns of both views, px.
    pub width: u16,
    /// Disparities to search.
    pub disparities: DisparityRange,
    /// The view whose pixels get a disparity.
    pub reference: Reference,
    /// How the pixels of a line are stored.
    pub format: PixelFormat,
    /// What becomes of the pixels whose disparity was not found. Of no effect on
    /// [`Recall`], which fills nothing in.
    pub output: Output,
    /// The part of the reference view that gets disparities. Whole lines still go in:
    /// neurons near its edge look outside.
    pub region: Region,
}

/// Why a configuration is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ConfigError {
    /// |W| is not a multiple of 16 from 16 to 1024.
    Synapses,
    /// Sigma or support cannot be drawn from.
    Synapse(SynapseError),
    /// The number of candidates is not 1 to 16.
    Candidates,
    /// The median reaches further than 63 px.
    Median,
    /// A cost and a penalty together do not fit 8 bits: see [`Aggregation::fits`].
    Costs,
    /// A window of the refinement is too large, or no cell is kept.
    Windows,
    /// Lines would be moved by more than one line.
    LineOffset,
    /// The disparities do not fit the width: see [`DisparityRange::fits`].
    Disparities,
    /// The region is empty or leaves the view.
    Region,
    /// The lent memory is smaller than [`Config::memory_words`].
    Memory(OutOfMemory),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Synapses => {
                f.write_str("the number of synapses must be a multiple of 16 from 16 to 1024")
            }
            Self::Synapse(error) => error.fmt(f),
            Self::Candidates => f.write_str("the number of candidates must be 1 to 16"),
            Self::Median => f.write_str("the median may reach at most 63 px"),
            Self::Costs => f.write_str(
                "the largest cost and penalty must be below 255 together, the scale at most 250, P1 at most P2",
            ),
            Self::Windows => f.write_str(
                "the speckle window may reach 15 lines, the vote 127 px and 15 lines, the weighted median even 30 px and 6 lines, and some cells must be kept",
            ),
            Self::LineOffset => f.write_str("lines can be moved by at most 16/16 of a line"),
            Self::Disparities => f.write_str(
                "the disparities must be shorter than the line and at most 2047 px long",
            ),
            Self::Region => f.write_str("the region is empty or leaves the view"),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for ConfigError {}

impl From<OutOfMemory> for ConfigError {
    fn from(error: OutOfMemory) -> Self {
        Self::Memory(error)
    }
}

impl From<SynapseError> for ConfigError {
    fn from(error: SynapseError) -> Self {
        Self::Synapse(error)
    }
}

impl Config {
    /// The left view as the reference, all of it, dense.
    #[must_use]
    pub const fn new(parameters: Parameters, width: u16, disparities: DisparityRange) -> Self {
        Self {
            parameters,
            width,
            disparities,
            reference: Reference::Left,
            format: PixelFormat::Grey8,
            output: Output::Dense,
            region: Region::whole(width),
        }
    }

    /// Words of 32 bits that [`Matcher::new`](crate::matcher::Matcher::new) takes; bytes
    /// are four times as many. With `W` columns (region `w`), `D` disparities, |W| synapses
    /// `n`, support `(X, Y)`, up to the rounding of each part to words:
    ///
    /// | part of [`Recall`], `k` candidates, `v` vote passes, median reach `m` | bytes |
    /// |---|---|
    /// | offsets | `2 n` |
    /// | strips | `2 (2 Y + 1) (W + 2 X)` |
    /// | patterns | `(W + w + 32) n / 8` |
    /// | distances | `2 D`, `D` rounded up to 16 |
    /// | candidates | `2 k w` |
    /// | vote, if `v > 0` | `2 w ((v + 1) k + v + 2)` |
    /// | median, if `m > 0` | `2 w (2 m + 2) + 2 D` |
    /// | output line and confidences | `3 w` |
    /// | grey lines, unless lines are grey | `2 W` |
    ///
    /// | part of [`Aggregation`], `D` rounded up to 16, `c` channels | bytes |
    /// |---|---|
    /// | costs and paths | `2 W D + 5 D` |
    /// | paths from the right, and before them patterns, levels of the other view and cells of the masks | the larger of `W D` and `(W + P + 32) n / 8 + 2 c P + 32 n`, `P = W + D` and the lowest disparity's magnitude; without `2 c P` where levels do not count, without `32 n` where every cell does |
    /// | best matches and checks | `15 W + 4 D` |
    /// | offsets, costs of a cell | `4 n` |
    /// | masks, unless every cell counts | `8 n` |
    /// | lines before they are moved, if they are | `W`, with colour `4 W` |
    /// | smoothed strips, if there are | `2 (2 Y + 1) (W + 2 X)` |
    /// | strips | those of the patterns; with colour, three of the reference view as deep as the last stage looks back and three of `Y + 1` lines of the other |
    /// | speckle removal, below `k` pixels, reach `y` | `2 W (2 y + 1) + 6 k` |
    /// | region vote, reach `(x, y)` | `4 W (2 y + 1) + 6 W + 2 D` |
    /// | medians, weighted over `p` pixels of `2 y + 1` rows | `12 W + 2 (W + 2 x) (2 y + 1) + 17 p` |
    /// | rows and confidences waiting | `2 W + W (lines of refinement + 1) + 3 w` |
    #[must_use]
    pub const fn memory_words(&self) -> usize {
        match &self.parameters.method {
            Method::Recall(recall) => {
                let grey = if self.format.is_grey() {
                    0
                } else {
                    2 * words(self.width as usize, 1)
                };
                grey + RowMatcher::memory_words(self, recall) + Refiner::memory_words(self, recall)
            }
            Method::Aggregation(aggregation) => {
                SurfaceMatcher::memory_words(self, aggregation)
                    + SurfaceRefiner::memory_words(self, aggregation)
            }
        }
    }

    /// Checks everything but the lent memory.
    ///
    /// # Errors
    /// [`ConfigError`] for the first field that is out of its range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let parameters = &self.parameters;
        let synapses = usize::from(parameters.synapses);
        if synapses == 0 || synapses % SYNAPSE_STEP != 0 || synapses > MAX_SYNAPSES {
            return Err(ConfigError::Synapses);
        }
        for sigma_px in parameters.sigmas_px {
            if !(sigma_px > 0.0 && sigma_px <= MAX_SIGMA_PX) {
                return Err(SynapseError::Sigma.into());
            }
        }
        if !parameters.support.is_valid() {
            return Err(SynapseError::Support.into());
        }
        match &parameters.method {
            Method::Recall(recall) => {
                if recall.candidates == 0 || recall.candidates > MAX_CANDIDATES {
                    return Err(ConfigError::Candidates);
                }
                if recall.median_reach_px > MAX_MEDIAN_REACH_PX {
                    return Err(ConfigError::Median);
                }
            }
            Method::Aggregation(aggregation) => {
                // An index in 1/16 px must fit 16 bits.
                if self.disparities.count > MAX_MAGNITUDE_PX as u16 + 1 {
                    return Err(ConfigError::Disparities);
                }
                if !aggregation.fits() {
                    return Err(ConfigError::Costs);
                }
                if aggregation.line_offset_max_q4 > MAX_LINE_OFFSET_Q4 {
                    return Err(ConfigError::LineOffset);
                }
                if !aggregation.windows_fit() {
                    return Err(ConfigError::Windows);
                }
            }
        }
        if !self.disparities.fits(self.width) {
            return Err(ConfigError::Disparities);
        }
        let region = &self.region;
        let inside = u32::from(region.x) + u32::from(region.width) <= u32::from(self.width);
        if region.width == 0 || region.height == 0 || !inside {
            return Err(ConfigError::Region);
        }
        Ok(())
    }
}
