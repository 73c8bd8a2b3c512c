//! Named sets of parameters, the same for every scene.

use core::fmt;
use core::num::NonZeroU8;
use core::str::FromStr;

use super::parameters::{
    Method, Parameters, RecallParameters, RegionVoteParameters, RivalParameters, SgmParameters,
    SpeckleParameters, Support, Voters, WeightedMedianParameters,
};
use crate::kernel::{SubpixelStep, TieBreak};

/// The seed of every preset unless another is asked for.
pub const DEFAULT_SEED: u64 = 1;

/// A named set of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Preset {
    /// Section III of the paper without post-processing: 256 synapses, sigma 4, ties broken at
    /// random. All neurons share their offsets, which are drawn again beyond three sigma.
    PaperRaw,
    /// [`Preset::PaperRaw`] with the paper's vote filter and median.
    Paper,
    /// SGM over patterns of 32 cells of grey, with left-right check, speckle removal and a plain
    /// fill.
    Lite,
    /// SGM over masked patterns of 48 cells in colour, filled by region vote and weighted median.
    Micro,
    /// [`Preset::Micro`] with 256 cells and wider windows.
    Balanced,
    /// [`Preset::Balanced`] with 512 cells and the widest windows.
    Quality,
}

/// No preset has this name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
    pub const ALL: [Self; 6] = [
        Self::PaperRaw,
        Self::Paper,
        Self::Lite,
        Self::Micro,
        Self::Balanced,
        Self::Quality,
    ];

    /// The preset's name, as [`FromStr`] reads it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PaperRaw => "paper-raw",
            Self::Paper => "paper",
            Self::Lite => "lite",
            Self::Micro => "micro",
            Self::Balanced => "balanced",
            Self::Quality => "quality",
        }
    }

    /// A description of the preset in one phrase.
    #[must_use]
    pub const fn summary(self) -> &'static str {
        match self {
            Self::PaperRaw => "the paper's network alone, ties at random",
            Self::Paper => "the paper's network, vote filter and median",
            Self::Lite => "32 cells, aggregated, checked, plain fill and median",
            Self::Micro => "48 cells, masked, aggregated, vote and weighted median",
            Self::Balanced => {
                "256 cells, masked, aggregated, vote and weighted median in wider windows"
            }
            Self::Quality => {
                "512 cells, masked, aggregated, vote and weighted median in the widest windows"
            }
        }
    }

    /// The preset's parameters.
    #[must_use]
    pub const fn parameters(self) -> Parameters {
        match self {
            Self::PaperRaw => paper(RAW),
            Self::Paper => paper(RecallParameters {
                candidates: 6,
                vote_passes: 5,
                median_reach_px: 3,
                ..RAW
            }),
            Self::Lite => LITE,
            Self::Micro => MICRO,
            Self::Balanced => BALANCED,
            Self::Quality => QUALITY,
        }
    }
}

const RAW: RecallParameters = RecallParameters {
    ties: TieBreak::Random { seed: DEFAULT_SEED },
    candidates: 1,
    vote_passes: 0,
    median_reach_px: 0,
};

const fn paper(recall: RecallParameters) -> Parameters {
    const SIGMA_PX: f32 = 4.0;
    Parameters {
        synapses: 256,
        sigmas_px: [SIGMA_PX; 2],
        cell_length_max_px: 0,
        support: Support::three_sigma(SIGMA_PX),
        seed: DEFAULT_SEED,
        method: Method::Recall(recall),
    }
}

/// Parameters that the SGM presets share, but where a preset says otherwise.
const SGM: SgmParameters = SgmParameters {
    colour: true,
    smoothing_step: 5,
    kept_cells_q8: 103,
    mask_floor: 20,
    // Evaluated when core is built, as all of a preset is.
    mask_step: NonZeroU8::new(24).unwrap(),
    hamming_scale: 96,
    hamming_truncation: 32,
    evidence_q8: 83,
    difference_weight_q4: 24,
    difference_truncation: 30,
    line_offset_max_lines: 1,
    line_gain_max_q8: 192,
    usual_difference_max: 4,
    p1: 20,
    p2: 85,
    p2_floor: 15,
    p2_adaptation_q4: 16,
    subpixel: SubpixelStep {
        relief: 50,
        lines_min: 110,
    },
    left_right_tolerance_px: 1,
    margin: 24,
    texture_min: 0,
    rivals: Some(RivalParameters {
        reach_px: 16,
        ratio_q4: 20,
        slack: 8,
        rise: 17,
        run_min_px: 12,
        spread_px: 28,
        row_step: 3,
        cost_shift: 2,
        p2_min: 160,
    }),
    speckle: None,
    vote: None,
    weighted_median: None,
};

const LITE: Parameters = Parameters {
    synapses: 32,
    sigmas_px: [2.5, 1.0],
    cell_length_max_px: 4,
    support: Support { x_px: 8, y_px: 5 },
    seed: DEFAULT_SEED,
    method: Method::Sgm(SgmParameters {
        colour: false,
        kept_cells_q8: 256,
        p1: 38,
        p2: 110,
        p2_floor: 20,
        p2_adaptation_q4: 24,
        margin: 20,
        speckle: Some(SpeckleParameters {
            size_min: 8,
            step_q4: 8,
            reach_y_px: 1,
        }),
        ..SGM
    }),
};

const MICRO: Parameters = Parameters {
    synapses: 48,
    sigmas_px: [3.0, 0.9],
    cell_length_max_px: 0,
    support: Support { x_px: 10, y_px: 3 },
    seed: DEFAULT_SEED,
    method: Method::Sgm(SgmParameters {
        mask_step: NonZeroU8::new(48).unwrap(),
        p1: 22,
        // Runs of the line alone: no more line, and hardly any memory.
        speckle: Some(SpeckleParameters {
            size_min: 3,
            step_q4: 32,
            reach_y_px: 0,
        }),
        vote: Some(region_vote(4)),
        weighted_median: Some(weighted_median(10, 2)),
        ..SGM
    }),
};

const BALANCED: Parameters = Parameters {
    synapses: 256,
    sigmas_px: [5.0, 1.2],
    cell_length_max_px: 0,
    support: Support { x_px: 10, y_px: 6 },
    seed: DEFAULT_SEED,
    method: Method::Sgm(SgmParameters {
        kept_cells_q8: 50,
        hamming_truncation: 36,
        p1: 24,
        p2: 100,
        margin: 30,
        speckle: Some(SPECKLE),
        vote: Some(region_vote(6)),
        weighted_median: Some(weighted_median(16, 2)),
        ..SGM
    }),
};

const QUALITY: Parameters = Parameters {
    synapses: 512,
    sigmas_px: [3.5, 1.2],
    cell_length_max_px: 0,
    support: Support { x_px: 10, y_px: 8 },
    seed: DEFAULT_SEED,
    method: Method::Sgm(SgmParameters {
        kept_cells_q8: 64,
        hamming_truncation: 40,
        p2: 105,
        p2_adaptation_q4: 20,
        margin: 30,
        speckle: Some(SPECKLE),
        vote: Some(region_vote(10)),
        weighted_median: Some(weighted_median(28, 2)),
        ..SGM
    }),
};

const SPECKLE: SpeckleParameters = SpeckleParameters {
    size_min: 8,
    step_q4: 32,
    reach_y_px: 2,
};

const fn region_vote(reach_y_px: u8) -> RegionVoteParameters {
    RegionVoteParameters {
        reach_x_px: 25,
        reach_y_px,
        near_step: 30,
        far_step: 6,
        voters: Voters::EveryLine,
        support_min: 2,
        share_min_percent: 40,
    }
}

const fn weighted_median(reach_x_px: u8, reach_y_px: u8) -> WeightedMedianParameters {
    WeightedMedianParameters {
        reach_x_px,
        reach_y_px,
        colour_reach: 48,
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
