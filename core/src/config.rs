//! What to compute: method parameters, image size, disparities, region, reference.

use core::fmt;

use crate::disparity::{DisparityRange, Reference};
use crate::matching::RowMatcher;
use crate::matching::TieBreak;
use crate::memory::OutOfMemory;
use crate::minchinton::SYNAPSE_STEP;
use crate::refine::Refiner;
use crate::synapse::{MAX_SIGMA_PX, MAX_SYNAPSES, Support, SynapseError};

/// Largest number of candidates kept per pixel.
pub const MAX_CANDIDATES: u8 = 16;

/// Largest reach of the median, px.
pub const MAX_MEDIAN_REACH_PX: u8 = 63;

/// The method's parameters: all that a preset fixes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// |W|: 16 to 1024, a multiple of 16.
    pub synapses: u16,
    /// Standard deviation of the offsets, px, above 0 and at most 10.
    pub sigma_px: f32,
    /// Reach of the offsets; [`Support::three_sigma`] unless there is a reason.
    pub support: Support,
    /// Seed of the offsets.
    pub seed: u64,
    /// How ties are broken.
    pub ties: TieBreak,
    /// Candidates kept per pixel, 1 to 16; more than 1 only serves the vote.
    pub candidates: u8,
    /// Passes of the vote filter; 0 turns it off. Each is a line of latency.
    pub vote_passes: u8,
    /// The median covers `2 reach + 1` pixels squared; 0 turns it off, at most 63.
    pub median_reach_px: u8,
}

impl Parameters {
    /// The same parameters with another sigma and the support that goes with it.
    #[must_use]
    pub const fn with_sigma(mut self, sigma_px: f32) -> Self {
        self.sigma_px = sigma_px;
        self.support = Support::three_sigma(sigma_px);
        self
    }

    /// The same parameters with another seed, for the offsets and for ties.
    #[must_use]
    pub const fn with_seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self.ties = self.ties.with_seed(seed);
        self
    }

    /// Lines between a pair of lines going in and its disparities coming out: pair
    /// `y + latency_lines` completes line `y`.
    #[must_use]
    pub const fn latency_lines(&self) -> u32 {
        self.support.y_px as u32 + self.vote_passes as u32 + self.median_reach_px as u32
    }
}

/// A rectangle of the reference view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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

/// Everything a matcher is built from. The number of lines is not part of it: memory
/// does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// The method's parameters.
    pub parameters: Parameters,
    /// Columns of both views, px.
    pub width: u16,
    /// Disparities to search.
    pub disparities: DisparityRange,
    /// The view whose pixels get a disparity.
    pub reference: Reference,
    /// The part of the reference view that gets disparities. Whole lines still go in:
    /// neurons near its edge look outside.
    pub region: Region,
}

/// Why a configuration is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    /// The left view as the reference, all of it.
    #[must_use]
    pub const fn new(parameters: Parameters, width: u16, disparities: DisparityRange) -> Self {
        Self {
            parameters,
            width,
            disparities,
            reference: Reference::Left,
            region: Region::whole(width),
        }
    }

    /// Words of 32 bits that [`Matcher::new`](crate::matcher::Matcher::new) takes; bytes are four
    /// times as many. With `W` columns (region `w`), `D` disparities, |W| synapses `n`,
    /// support `(X, Y)`, `k` candidates, `v` vote passes and median reach `m`, up to the
    /// rounding of each part to words:
    ///
    /// | part | bytes |
    /// |---|---|
    /// | offsets | `2 n` |
    /// | strips | `2 (2 Y + 1) (W + 2 X)` |
    /// | patterns | `(W + w + 32) n / 8` |
    /// | distances | `2 D`, `D` rounded up to 16 |
    /// | candidates | `2 k w` |
    /// | vote, if `v > 0` | `2 w ((v + 1) k + v + 2)` |
    /// | median, if `m > 0` | `2 w (2 m + 2) + 2 D` |
    /// | output line | `2 w` |
    #[must_use]
    pub const fn memory_words(&self) -> usize {
        RowMatcher::memory_words(self) + Refiner::memory_words(self)
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
        if !(parameters.sigma_px > 0.0 && parameters.sigma_px <= MAX_SIGMA_PX) {
            return Err(SynapseError::Sigma.into());
        }
        if !parameters.support.is_valid() {
            return Err(SynapseError::Support.into());
        }
        if parameters.candidates == 0 || parameters.candidates > MAX_CANDIDATES {
            return Err(ConfigError::Candidates);
        }
        if parameters.median_reach_px > MAX_MEDIAN_REACH_PX {
            return Err(ConfigError::Median);
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
