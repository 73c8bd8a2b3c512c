//! The matcher: every kernel set of the host and one to three threads give the bits of the oracle.

use std::num::NonZeroU8;

use arbitrary::{Arbitrary, Result, Unstructured};
use vgstereo_core::config::{
    RegionVoteParameters, RivalParameters, SpeckleParameters, Support, Voters,
    WeightedMedianParameters,
};
use vgstereo_core::kernel::{SubpixelStep, TieBreak};
use vgstereo_core::{
    Config, DisparityRange, Method, Output, Parameters, Portable, RecallParameters, Reference,
    Region, SgmParameters,
};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;

use crate::{Map, Pair, follow, line_offsets, oracle};

/// A pair and a configuration that fits it.
#[derive(Debug, Clone)]
pub struct Case {
    /// The views.
    pub pair: Pair,
    /// The configuration; its region may be a part of the view.
    pub config: Config,
}

impl<'a> Arbitrary<'a> for Case {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        let width = u.int_in_range(1_u16..=36)?;
        let height = u.int_in_range(1_usize..=9)?;
        let sgm = u.ratio(2, 3)?;
        let colour = sgm && u.arbitrary()?;
        let widest = width as i16 - 1;
        let minimum_px = u.int_in_range(-widest..=widest)?;
        // Few, as the oracle takes long for each.
        let maximum_px = u.int_in_range(minimum_px..=widest.min(minimum_px + 19))?;
        let disparities = DisparityRange {
            minimum_px,
            count: minimum_px.abs_diff(maximum_px) + 1,
        };
        let parameters = Parameters {
            synapses: 16 * u.int_in_range(1..=20)?,
            sigmas_px: [sigma_px(u)?, sigma_px(u)?],
            cell_length_max_px: u.int_in_range(0..=8)?,
            support: Support {
                x_px: u.int_in_range(0..=50)?,
                y_px: u.int_in_range(0..=14)?,
            },
            seed: u.arbitrary()?,
            method: if sgm {
                Method::Sgm(sgm_parameters(u)?)
            } else {
                Method::Recall(recall_parameters(u)?)
            },
        };
        let x = u.int_in_range(0..=width - 1)?;
        let region = Region {
            x,
            y: u.int_in_range(0..=height as u32)?,
            width: u.int_in_range(1..=width - x)?,
            height: u.int_in_range(1..=height as u32 + 1)?,
        };
        let mut config = Config {
            reference: *u.choose(&[Reference::Left, Reference::Right])?,
            colour,
            output: *u.choose(&[Output::Dense, Output::Sparse])?,
            region,
            ..Config::new(parameters, width, disparities)
        };
        let format = if colour {
            PixelFormat::Rgb888
        } else {
            PixelFormat::Grey8
        };
        let levels = u.int_in_range(1..=256)?;
        let seed = u.arbitrary()?;
        config.line_offsets = line_offsets(seed);
        let mut pair = Pair::random_in(format, width.into(), height, levels, seed);
        if u.ratio(3, 4)? {
            follow(&mut pair, disparities, seed);
        }
        if seed % 3 == 0 {
            pair.hide_columns(seed);
        }
        if seed % 8 > 3 {
            pair.flicker(seed);
        }
        // What is left changes single levels.
        while !u.is_empty() {
            let view = if u.arbitrary()? {
                &mut pair.left
            } else {
                &mut pair.right
            };
            let at = u.choose_index(view.len())?;
            view[at] = u.arbitrary()?;
        }
        Ok(Self { pair, config })
    }
}

/// A sigma from the smallest steps on, px.
fn sigma_px(u: &mut Unstructured<'_>) -> Result<f32> {
    Ok(f32::from(u.int_in_range(1_u16..=1000)?) / 100.0)
}

fn recall_parameters(u: &mut Unstructured<'_>) -> Result<RecallParameters> {
    Ok(RecallParameters {
        ties: if u.arbitrary()? {
            TieBreak::Lowest
        } else {
            TieBreak::Random {
                seed: u.arbitrary()?,
            }
        },
        candidates: u.int_in_range(1..=16)?,
        vote_passes: u.int_in_range(0..=4)?,
        median_reach_px: u.int_in_range(0..=8)?,
    })
}

/// Parameters in the whole range of their validity, but for the windows: the oracle is slow.
fn sgm_parameters(u: &mut Unstructured<'_>) -> Result<SgmParameters> {
    let (p2, difference_truncation) = (u.int_in_range(0..=150)?, u.arbitrary()?);
    // Cost and penalty fit 8 bits together.
    let hamming_truncation = u.int_in_range(0..=254 - p2)?;
    let rest = 254 - p2 - hamming_truncation;
    let weight_max = u16::from(rest) * 16 / u16::from(difference_truncation).max(1);
    let difference_weight_q4 = u.int_in_range(0..=weight_max.min(255) as u8)?;
    let difference =
        ((u16::from(difference_truncation) * u16::from(difference_weight_q4)) >> 4) as u8;
    Ok(SgmParameters {
        colour: u.arbitrary()?,
        smoothing_step: u.arbitrary()?,
        kept_cells_q8: u.int_in_range(1..=300)?,
        mask_floor: u.arbitrary()?,
        mask_step: u.arbitrary::<NonZeroU8>()?,
        hamming_scale: u.int_in_range(0..=250)?,
        hamming_truncation,
        evidence_q8: u.arbitrary()?,
        difference_weight_q4,
        difference_truncation,
        line_offset_max_lines: u.int_in_range(0..=4)?,
        line_gain_max_q8: u.arbitrary()?,
        usual_difference_max: u.arbitrary()?,
        p1: u.int_in_range(0..=p2)?,
        p2,
        p2_floor: u.int_in_range(0..=p2)?,
        p2_adaptation_q4: u.arbitrary()?,
        subpixel: SubpixelStep {
            relief: u.arbitrary()?,
            lines_min: u.int_in_range(0..=800)?,
        },
        left_right_tolerance_px: u.arbitrary()?,
        margin: u.arbitrary()?,
        texture_min: u.arbitrary()?,
        rivals: if u.arbitrary()? {
            Some(RivalParameters {
                reach_px: u.int_in_range(0..=32)?,
                ratio_q4: u.arbitrary()?,
                slack: u.arbitrary()?,
                rise: u.arbitrary()?,
                run_min_px: u.arbitrary()?,
                spread_px: u.arbitrary()?,
                row_step: u.arbitrary()?,
                cost_shift: u.int_in_range(0..=7)?,
                // It may be above P2.
                p2_min: u.int_in_range(0..=254 - hamming_truncation - difference)?,
            })
        } else {
            None
        },
        speckle: if u.arbitrary()? {
            Some(SpeckleParameters {
                size_min: u.arbitrary()?,
                step_q4: u.arbitrary()?,
                reach_y_px: u.int_in_range(0..=5)?,
            })
        } else {
            None
        },
        vote: if u.arbitrary()? {
            Some(RegionVoteParameters {
                reach_x_px: u.int_in_range(0..=127)?,
                reach_y_px: u.int_in_range(0..=15)?,
                near_step: u.arbitrary()?,
                far_step: u.arbitrary()?,
                voters: if u.arbitrary()? {
                    Voters::EveryLine
                } else {
                    Voters::OtherLines
                },
                support_min: u.arbitrary()?,
                share_min_percent: u.arbitrary()?,
            })
        } else {
            None
        },
        weighted_median: if u.arbitrary()? {
            Some(WeightedMedianParameters {
                reach_x_px: 2 * u.int_in_range(0..=15)?,
                reach_y_px: 2 * u.int_in_range(0..=3)?,
                colour_reach: u.int_in_range(4..=48)?,
            })
        } else {
            None
        },
    })
}

/// Matches the case that the bytes stand for.
pub fn run(bytes: &[u8]) {
    if let Ok(case) = Case::arbitrary(&mut Unstructured::new(bytes)) {
        check(&case);
    }
}

/// Matches the pair in every way that there is.
///
/// # Panics
/// If one gives other bits than the oracle.
pub fn check(Case { pair, config }: &Case) {
    assert_eq!(config.validate(), Ok(()));
    let whole = Config {
        region: Region::whole(config.width),
        ..*config
    };
    let (disparities_q4, confidences) = match config.parameters.method {
        Method::Sgm(_) => {
            let (disparities_q4, confidences) = oracle::sgm::match_whole(pair, &whole);
            (disparities_q4, Some(confidences))
        }
        Method::Recall(_) => (oracle::recall::match_whole(pair, &whole), None),
    };
    for kernels in NativeKernels::available() {
        let found = pair.stream_with_confidences(&whole, kernels);
        assert!(found.disparities_q4 == disparities_q4, "{}", kernels.name());
        assert!(
            confidences
                .as_ref()
                .is_none_or(|expected| *expected == found.confidences),
            "{}",
            kernels.name()
        );
    }
    // The lines of a region decide what is filled in, so that it is no part of the whole.
    let expected = pair.stream_with_confidences(config, Portable);
    for threads in 1..=3 {
        let matched =
            match_frame(config, &pair.views(), NativeKernels::fastest(), threads).unwrap();
        let found = Map {
            disparities_q4: matched.disparities_q4,
            confidences: matched.confidences,
        };
        assert!(found == expected, "{threads} threads");
    }
}
