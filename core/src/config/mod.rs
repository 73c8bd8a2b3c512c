//! Configuration: what to compute, of which lines, and where.
//!
//! [`Parameters`] are the method's and fixed by a [`Preset`]; a [`Config`] adds the width, the
//! disparities to search, the reference view and a region of interest. It can be checked when a
//! program is built: [`Config::validate`] is `const`.

mod checks;
mod parameters;
mod preset;
pub mod presets;

pub use checks::{Checks, ChecksError, SpeckleChecks};
pub use parameters::{
    MAX_CANDIDATES, MAX_LINE_OFFSET_LINES, MAX_MEDIAN_REACH_PX, MAX_RIVAL_REACH_PX, MAX_SIGMA_PX,
    MAX_SYNAPSES, Method, Parameters, RecallParameters, RegionVoteParameters, RivalParameters,
    SYNAPSE_STEP, SgmParameters, SpeckleParameters, Support, SynapseError, Voters,
    WeightedMedianParameters,
};
pub use preset::{DEFAULT_SEED, Preset, UnknownPreset};

use core::fmt;

use crate::disparity::{DisparityRange, MAX_MAGNITUDE_PX, Reference};
use crate::kernel::{Kernels, Scope};
use crate::rows::{LineOffsets, OutOfMemory};

/// A rectangle of the reference view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Region {
    /// First column, px.
    pub x: u16,
    /// First line.
    pub y: u32,
    /// Columns, px, at least 1.
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

/// Treatment of pixels whose disparity was not found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// They are filled in, with confidence 0.
    #[default]
    Dense,
    /// They are [`INVALID`](crate::disparity::INVALID).
    Sparse,
}

/// All that a matcher is built from. The number of lines of a frame is not part of it, because
/// memory does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Parameters of the method.
    pub parameters: Parameters,
    /// Columns of both views, px.
    pub width: u16,
    /// Disparities to search.
    pub disparities: DisparityRange,
    /// The view whose pixels get a disparity.
    pub reference: Reference,
    /// Whether lines have colour. If false, lines with colour are accepted too, but only their grey
    /// is used.
    pub colour: bool,
    /// Treatment of pixels whose disparity was not found. It has no effect on [`Method::Recall`],
    /// which fills nothing in.
    pub output: Output,
    /// The part of the reference view that gets disparities. Whole lines still go in: patterns
    /// near its edge look outside.
    pub region: Region,
    /// By how much the lines of the other view lie too low when a frame begins, in 1/2^24 line:
    /// [`LineOffsets::NONE`], or what [`Matcher::line_offsets`](crate::Matcher::line_offsets) has told of an earlier
    /// frame. Lines are moved by at most [`SgmParameters::line_offset_max_lines`], and not at all by
    /// [`Method::Recall`].
    pub line_offsets: LineOffsets,
}

/// Reason for which a configuration is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ConfigError {
    /// |W| is not a multiple of 16 from 16 to 1024.
    Synapses,
    /// Offsets cannot be drawn with this sigma or support.
    Synapse(SynapseError),
    /// The number of candidates is not 1 to 16.
    Candidates,
    /// The median reaches further than 63 px.
    Median,
    /// A cost and a penalty together do not fit 8 bits: see [`SgmParameters::costs_fit_u8`].
    Costs,
    /// A window of the refinement is too large, or no cell is kept: see
    /// [`SgmParameters::windows_fit`].
    Windows,
    /// Pixels would be moved by more than 4 lines.
    LineOffset,
    /// The disparities do not fit the width: see [`DisparityRange::fits`].
    Disparities,
    /// The region is empty or leaves the view.
    Region,
    /// The program leaves out code that this configuration asks for: see [`Kernels::SCOPE`].
    Scope,
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
                "the largest cost and the largest of P2 (of rivals, too: p2_min) must be below 255 together, the scale at most \
                 250, P1 at most P2, and the shift of costs below 8",
            ),
            Self::Windows => f.write_str(
                "the speckle window may reach 15 lines, the vote 127 px and 15 lines, the weighted median even 30 px and 6 lines, and some cells must be kept",
            ),
            Self::LineOffset => f.write_str("pixels can be moved by at most 4 lines"),
            Self::Disparities => f.write_str(
                "the disparities must be shorter than the line and at most 2047 px long",
            ),
            Self::Region => f.write_str("the region is empty or leaves the view"),
            Self::Scope => f.write_str("the program leaves out what the configuration asks for"),
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

impl Parameters {
    /// Checks all that does not depend on the rest of a [`Config`].
    ///
    /// # Errors
    /// [`ConfigError`] for the first field that is out of its range.
    pub const fn validate(&self) -> Result<(), ConfigError> {
        let synapses = self.synapses as usize;
        if synapses == 0 || !synapses.is_multiple_of(SYNAPSE_STEP) || synapses > MAX_SYNAPSES {
            return Err(ConfigError::Synapses);
        }
        let [first, second] = self.sigmas_px;
        // Written so that NaN is refused.
        let is_sigma =
            first > 0.0 && first <= MAX_SIGMA_PX && second > 0.0 && second <= MAX_SIGMA_PX;
        if !is_sigma {
            return Err(ConfigError::Synapse(SynapseError::Sigma));
        }
        if !self.support.is_valid() {
            return Err(ConfigError::Synapse(SynapseError::Support));
        }
        match &self.method {
            Method::Recall(recall) => {
                if recall.candidates == 0 || recall.candidates > MAX_CANDIDATES {
                    return Err(ConfigError::Candidates);
                }
                if recall.median_reach_px > MAX_MEDIAN_REACH_PX {
                    return Err(ConfigError::Median);
                }
            }
            Method::Sgm(sgm) => {
                if !sgm.costs_fit_u8() {
                    return Err(ConfigError::Costs);
                }
                if sgm.line_offset_max_lines > MAX_LINE_OFFSET_LINES {
                    return Err(ConfigError::LineOffset);
                }
                if !sgm.windows_fit() {
                    return Err(ConfigError::Windows);
                }
            }
        }
        Ok(())
    }
}

impl Parameters {
    /// The smallest scope with these parameters: for any disparities, for lines with and without colour, rectified
    /// before or on their way to the matcher.
    #[must_use]
    pub const fn scope(&self) -> Scope {
        let synapses = Some(self.synapses);
        match &self.method {
            Method::Recall(_) => Scope {
                recall: true,
                sgm: false,
                synapses,
                drawn: None,
                disparities: None,
                masks: false,
                region_vote: false,
                weighted_median: false,
                colour: false,
                rectification: true,
            },
            Method::Sgm(sgm) => Scope {
                recall: false,
                sgm: true,
                synapses,
                drawn: None,
                disparities: None,
                masks: !sgm.every_cell_counts(),
                region_vote: sgm.vote.is_some(),
                weighted_median: sgm.weighted_median.is_some(),
                colour: sgm.colour,
                rectification: true,
            },
        }
    }
}

impl Config {
    /// Returns a configuration with the left view as reference, the whole view as region, grey
    /// lines, dense output and no offsets of lines.
    #[must_use]
    pub const fn new(parameters: Parameters, width: u16, disparities: DisparityRange) -> Self {
        Self {
            parameters,
            width,
            disparities,
            reference: Reference::Left,
            colour: false,
            output: Output::Dense,
            region: Region::whole(width),
            line_offsets: LineOffsets::NONE,
        }
    }

    /// The smallest scope with this configuration, for lines that are rectified.
    #[must_use]
    pub const fn scope(&self) -> Scope {
        let scope = self.parameters.scope();
        Scope {
            colour: scope.colour && self.colour,
            disparities: Some(self.disparities.count),
            rectification: false,
            ..scope
        }
    }

    /// Checks everything but the lent memory, and that a matcher with the kernels `K` is compiled for this
    /// configuration. In a `const` it refuses a configuration when a program is built.
    ///
    /// # Errors
    /// As [`Config::validate`], and [`ConfigError::Scope`].
    pub const fn validate_for<K: Kernels>(&self) -> Result<(), ConfigError> {
        let parameters = &self.parameters;
        // Stored synapses serve if they were drawn from these parameters.
        let drawn = match K::SCOPE.drawn {
            Some(drawn) if drawn.law.is(&parameters.synapse_law()) => Some(drawn),
            _ => None,
        };
        let asked = Scope {
            drawn,
            ..self.scope()
        };
        if !K::SCOPE.contains(&asked) {
            return Err(ConfigError::Scope);
        }
        self.validate()
    }

    /// Checks everything but the lent memory. In a `const` it refuses a configuration when a
    /// program is built.
    ///
    /// # Errors
    /// [`ConfigError`] for the first field that is out of its range.
    pub const fn validate(&self) -> Result<(), ConfigError> {
        if let Err(error) = self.parameters.validate() {
            return Err(error);
        }
        // An index in 1/16 px must fit 16 bits.
        if matches!(self.parameters.method, Method::Sgm(_))
            && self.disparities.count > MAX_MAGNITUDE_PX as u16 + 1
        {
            return Err(ConfigError::Disparities);
        }
        if !self.disparities.fits(self.width) {
            return Err(ConfigError::Disparities);
        }
        let region = &self.region;
        let is_inside = region.x as u32 + region.width as u32 <= self.width as u32;
        if region.width == 0 || region.height == 0 || !is_inside {
            return Err(ConfigError::Region);
        }
        Ok(())
    }
}
