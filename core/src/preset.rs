//! Named sets of parameters, the same for every scene.

use core::fmt;
use core::str::FromStr;

use crate::config::Parameters;
use crate::matching::TieBreak;
use crate::synapse::Support;

/// The seed of every preset unless another is asked for.
pub const DEFAULT_SEED: u64 = 1;

/// A named set of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Preset {
    /// Section III of the paper: 256 synapses, sigma 4, ties at random, nothing after; with
    /// offsets shared by all neurons and drawn again beyond three sigma.
    PaperRaw,
    /// The same with the paper's vote filter and median.
    Paper,
}

/// No preset has this name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownPreset;

impl fmt::Display for UnknownPreset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("no preset has this name; there are: ")?;
        for (index, preset) in Preset::ALL.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{}", preset.name())?;
        }
        Ok(())
    }
}

impl core::error::Error for UnknownPreset {}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::PaperRaw, Self::Paper];

    /// The preset's name, as [`FromStr`] reads it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PaperRaw => "paper-raw",
            Self::Paper => "paper",
        }
    }

    /// What the preset is, in a sentence.
    #[must_use]
    pub const fn summary(self) -> &'static str {
        match self {
            Self::PaperRaw => "the paper's network alone, ties at random",
            Self::Paper => "the paper's network, vote filter and median",
        }
    }

    /// The preset's parameters.
    #[must_use]
    pub const fn parameters(self) -> Parameters {
        const SIGMA_PX: f32 = 4.0;
        let raw = Parameters {
            synapses: 256,
            sigma_px: SIGMA_PX,
            support: Support::three_sigma(SIGMA_PX),
            seed: DEFAULT_SEED,
            ties: TieBreak::Random { seed: DEFAULT_SEED },
            candidates: 1,
            vote_passes: 0,
            median_reach_px: 0,
        };
        match self {
            Self::PaperRaw => raw,
            Self::Paper => Parameters {
                candidates: 6,
                vote_passes: 5,
                median_reach_px: 3,
                ..raw
            },
        }
    }
}

impl FromStr for Preset {
    type Err = UnknownPreset;

    fn from_str(name: &str) -> Result<Self, UnknownPreset> {
        let mut all = Self::ALL.into_iter();
        all.find(|preset| preset.name() == name)
            .ok_or(UnknownPreset)
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
