//! The SGM method: streamed frames compared with the whole-image oracle, and further guarantees.

use std::num::NonZeroU8;

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::config::{
    RegionVoteParameters, RivalParameters, SpeckleParameters, Support, Voters,
    WeightedMedianParameters,
};
use vgstereo_core::disparity::px_to_q4;
use vgstereo_core::kernel::{SubpixelStep, luma_row};
use vgstereo_core::rows::OutOfMemory;
use vgstereo_core::{
    Config, ConfigError, DisparityRange, INVALID, LineOffsets, Matcher, Method, Output, Parameters,
    Portable, Preset, Reference, Region, SgmParameters,
};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_frame::{Views, match_frame};
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::arguments::aggregating_unless_named;
use vgstereo_sim::exposure::Exposure;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::stress::{Kind, Stress};
use vgstereo_sim::views::views_of;
use vgstereo_tests::{Map, Pair, follow, line_offsets, oracle, with_sgm};

fn micro() -> SgmParameters {
    match Preset::Micro.parameters().method {
        Method::Sgm(aggregation) => aggregation,
        Method::Recall(_) => panic!("micro aggregates"),
    }
}

/// SGM parameters near those of the preset `micro`, sometimes without some of the stages.
fn aggregation() -> impl Strategy<Value = SgmParameters> {
    let masks = (
        prop_oneof![Just(103_u16), Just(256), 1_u16..=256],
        0_u8..=60,
        (1_u8..=255).prop_map(|step| NonZeroU8::new(step).unwrap()),
    );
    let costs = (
        1_u8..=120,
        0_u8..=60,
        prop_oneof![Just(0_u8), Just(24), 1_u8..=48],
        0_u8..=30,
        prop_oneof![2 => Just(0_u8), 2 => Just(1), 1 => 2_u8..=4],
        prop_oneof![Just(0_u8), 1_u8..=255],
        prop_oneof![Just(255_u8), 0_u8..=20],
        prop_oneof![1 => Just(0_u8), 2 => 1_u8..=255],
    );
    let penalties = (0_u8..=30, 0_u8..=60, 0_u8..=40, 0_u8..=32);
    let texture_min = prop_oneof![2 => Just(0_u16), 1 => 0_u16..=1500];
    let rivals = (
        0_u8..=20,
        16_u8..=40,
        0_u8..=255,
        0_u8..=20,
        0_u8..=24,
        0_u8..=16,
        (0_u8..=4, 0_u8..=7, 0_u8..=75),
    );
    let rivals = rivals.prop_map(
        |(reach_px, ratio_q4, slack, rise, run_min_px, spread_px, others)| RivalParameters {
            reach_px,
            ratio_q4,
            slack,
            rise,
            run_min_px,
            spread_px,
            row_step: others.0,
            cost_shift: others.1,
            p2_min: others.2,
        },
    );
    let rivals = proptest::option::of(rivals);
    let checks = (0_u8..=2, -1_i16..=30, texture_min, rivals);
    let voters = prop_oneof![Just(Voters::OtherLines), Just(Voters::EveryLine)];
    let election = (0_u8..=8, 0_u8..=60);
    let vote = (0_u8..=25, 0_u8..=4, 0_u8..=40, 0_u8..=40, voters, election).prop_map(
        |(
            reach_x_px,
            reach_y_px,
            near_step,
            far_step,
            voters,
            (support_min, share_min_percent),
        )| {
            RegionVoteParameters {
                reach_x_px,
                reach_y_px,
                near_step,
                far_step,
                voters,
                support_min,
                share_min_percent,
            }
        },
    );
    let weighted_median =
        (0_u8..=6, 0_u8..=2, 4_u8..=48).prop_map(|(half_x, half_y, colour_reach)| {
            WeightedMedianParameters {
                reach_x_px: 2 * half_x,
                reach_y_px: 2 * half_y,
                colour_reach,
            }
        });
    let speckle = (0_u8..=40, 0_u8..=40, 0_u8..=3).prop_map(|(size_min, step_q4, reach_y_px)| {
        SpeckleParameters {
            size_min,
            step_q4,
            reach_y_px,
        }
    });
    let refinement = (
        prop::option::of(speckle),
        prop::option::weighted(0.8, vote),
        prop::option::weighted(0.8, weighted_median),
    );
    let levels = (
        prop::bool::weighted(0.75),
        prop_oneof![1 => Just(0_u8), 3 => 1_u8..=40],
    );
    let subpixel = (prop_oneof![1 => Just(0_u8), 3 => 0_u8..=90], 0_u16..=400);
    (
        levels, masks, costs, penalties, subpixel, checks, refinement,
    )
        .prop_map(
            |((colour, smoothing_step), masks, costs, penalties, subpixel, checks, refinement)| {
                let p2 = penalties.0 + penalties.1;
                SgmParameters {
                    colour,
                    smoothing_step,
                    kept_cells_q8: masks.0,
                    mask_floor: masks.1,
                    mask_step: masks.2,
                    hamming_scale: costs.0,
                    hamming_truncation: costs.1,
                    evidence_q8: costs.7,
                    difference_weight_q4: costs.2,
                    difference_truncation: costs.3,
                    line_offset_max_lines: costs.4,
                    line_gain_max_q8: costs.5,
                    usual_difference_max: costs.6,
                    p1: penalties.0,
                    p2,
                    p2_floor: penalties.2.min(p2),
                    p2_adaptation_q4: penalties.3,
                    subpixel: SubpixelStep {
                        relief: subpixel.0,
                        lines_min: subpixel.1,
                    },
                    left_right_tolerance_px: checks.0,
                    margin: checks.1,
                    texture_min: checks.2,
                    rivals: checks.3,
                    speckle: refinement.0,
                    vote: refinement.1,
                    weighted_median: refinement.2,
                }
            },
        )
}

fn parameters() -> impl Strategy<Value = Parameters> {
    let support = (0_u8..9, 0_u8..6).prop_map(|(x_px, y_px)| Support { x_px, y_px });
    let own = (
        1_u16..=8,
        prop::array::uniform2(0.3_f32..6.0),
        0_u8..6,
        support,
        any::<u64>(),
        aggregation(),
    )
        .prop_map(
            |(words, sigmas_px, cell_length_max_px, support, seed, aggregation)| Parameters {
                synapses: 16 * words,
                sigmas_px,
                cell_length_max_px,
                support,
                seed,
                method: Method::Sgm(aggregation),
            },
        );
    prop_oneof![
        1 => any::<u64>().prop_map(|seed| Preset::Micro.parameters().with_seed(seed)),
        3 => own,
    ]
}

fn disparities(width: usize) -> impl Strategy<Value = DisparityRange> {
    let widest = width as i16 - 1;
    (-widest..=widest).prop_flat_map(move |minimum_px| {
        (minimum_px..=widest).prop_map(move |maximum_px| DisparityRange {
            minimum_px,
            count: (maximum_px - minimum_px + 1).unsigned_abs(),
        })
    })
}

/// A pair, and a configuration that fits it, with the whole view as its region.
fn matching() -> impl Strategy<Value = (Pair, Config)> {
    let format = prop_oneof![Just(PixelFormat::Grey8), Just(PixelFormat::Rgb888)];
    let reference = prop_oneof![Just(Reference::Left), Just(Reference::Right)];
    let output = prop_oneof![2 => Just(Output::Dense), 1 => Just(Output::Sparse)];
    let size = (1_usize..=70, 1_usize..26, 2_u32..=256, any::<u64>());
    (size, format, reference, output, parameters()).prop_flat_map(
        |((width, height, levels, seed), format, reference, output, parameters)| {
            disparities(width).prop_map(move |disparities| {
                let mut pair = Pair::random_in(format, width, height, levels, seed);
                if seed % 4 > 0 {
                    follow(&mut pair, disparities, seed);
                }
                if seed % 3 == 0 {
                    pair.hide_columns(seed);
                }
                if seed % 8 > 3 {
                    pair.flicker(seed);
                }
                let config = Config {
                    reference,
                    colour: !format.is_grey(),
                    output,
                    line_offsets: line_offsets(seed >> 3),
                    ..Config::new(parameters, width as u16, disparities)
                };
                (pair, config)
            })
        },
    )
}

/// Reverses the columns of every line.
fn mirrored<T: Copy>(values: &[T], width: usize, per_pixel: usize) -> Vec<T> {
    let lines = values.chunks_exact(width * per_pixel);
    lines
        .flat_map(|line| line.chunks_exact(per_pixel).rev().flatten().copied())
        .collect()
}

/// Asserts what holds for every line, whatever the views show: disparities are within the range,
/// and invalid ones have no confidence.
#[track_caller]
fn assert_sound(map: &Map, config: &Config) {
    let range = config.disparities.range_px();
    let range_q4 = px_to_q4(range.start as i16)..=px_to_q4((range.end - 1) as i16);
    for (&disparity_q4, &confidence) in map.disparities_q4.iter().zip(&map.confidences) {
        if disparity_q4 == INVALID {
            assert_eq!(confidence, 0, "confidence of no disparity");
        } else {
            assert!(range_q4.contains(&disparity_q4), "{disparity_q4}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn all_kernels_give_the_bits_of_the_oracle((pair, config) in matching()) {
        let (disparities_q4, confidences) = oracle::sgm::match_whole(&pair, &config);
        let expected = Map { disparities_q4, confidences };
        for kernels in NativeKernels::available() {
            let found = pair.stream_with_confidences(&config, kernels);
            prop_assert_eq!(&found.disparities_q4, &expected.disparities_q4, "{}", kernels.name());
            prop_assert_eq!(&found.confidences, &expected.confidences, "{}", kernels.name());
        }
    }

    #[test]
    fn two_threads_give_the_bits_of_one(
        (pair, mut config) in matching(),
        [x, y, width, height] in prop::array::uniform4(0_u16..70),
    ) {
        let x = x.min(config.width - 1);
        config.region = Region {
            x,
            y: (y / 4).into(),
            width: width.clamp(1, config.width - x),
            height: u32::from(height / 2) + 1,
        };
        let views = pair.views();
        let kernels = NativeKernels::fastest();
        let alone = pair.stream_with_confidences(&config, kernels);
        let matched = match_frame(&config, &views, kernels, 2).unwrap();
        prop_assert_eq!(matched.disparities_q4, alone.disparities_q4);
        prop_assert_eq!(matched.confidences, alone.confidences);
    }

    /// Sparse lines are dense lines without the disparities that were filled in.
    #[test]
    fn sparse_lines_have_what_was_found((pair, config) in matching()) {
        let [dense, sparse] = [Output::Dense, Output::Sparse].map(|output| {
            pair.stream_with_confidences(&Config { output, ..config }, NativeKernels::fastest())
        });
        let found = dense.disparities_q4.iter().zip(&dense.confidences);
        let expected: Vec<i16> = found
            .map(|(&disparity_q4, &confidence)| if confidence > 0 { disparity_q4 } else { INVALID })
            .collect();
        prop_assert!(sparse.disparities_q4 == expected && sparse.confidences == dense.confidences);
    }

    #[test]
    fn lines_are_sound((pair, config) in matching()) {
        assert_sound(&pair.stream_with_confidences(&config, NativeKernels::fastest()), &config);
    }

    /// Offsets within one column are their own mirror image, and so the method is symmetric.
    #[test]
    fn the_right_view_is_the_left_one_of_the_mirrored_pair((pair, config) in matching()) {
        let mut config = config;
        config.parameters.support.x_px = 0;
        let pixel = pair.format.bytes_per_pixel();
        let exchanged = Pair {
            left: mirrored(&pair.right, pair.width, pixel),
            right: mirrored(&pair.left, pair.width, pixel),
            valid_columns: {
                let [left, right] = pair.valid_columns.clone();
                let width = config.width;
                [right, left].map(|view| {
                    let lines = view.into_iter();
                    lines.map(|columns| width - columns.end..width - columns.start).collect()
                })
            },
            ..pair.clone()
        };
        let right = Config { reference: Reference::Right, ..config };
        // The same offset at every column of the mirrored view.
        let LineOffsets { shift_q24, tilt_q24, stretch_q24 } = config.line_offsets;
        let one_before = if pair.width.is_multiple_of(2) { tilt_q24 } else { 0 };
        let line_offsets = LineOffsets {
            shift_q24: shift_q24.saturating_sub(one_before),
            tilt_q24: tilt_q24.saturating_neg(),
            stretch_q24,
        };
        let left = Config { reference: Reference::Left, line_offsets, ..config };
        let found = pair.stream_with_confidences(&right, Portable);
        let other = exchanged.stream_with_confidences(&left, Portable);
        let expected = Map {
            disparities_q4: mirrored(&other.disparities_q4, pair.width, 1),
            confidences: mirrored(&other.confidences, pair.width, 1),
        };
        prop_assert!(found == expected);
    }

    /// If colour is not used, colour lines are matched by their luma.
    #[test]
    fn without_colour_the_luma_is_matched((pair, config) in matching(), format in 0..PixelFormat::ALL.len()) {
        let format = PixelFormat::ALL[format];
        let mut config = config;
        config.parameters = with_sgm(config.parameters, |sgm| sgm.colour = false);
        let mut pair = Pair::random_in(format, pair.width, pair.height, 256, 1);
        follow(&mut pair, config.disparities, 2);
        let luma = |view: &[u8]| {
            let mut grey = vec![0; pair.width * pair.height];
            luma_row(format, view, &mut grey);
            grey
        };
        let grey = Pair {
            format: PixelFormat::Grey8,
            left: luma(&pair.left),
            right: luma(&pair.right),
            ..pair.clone()
        };
        let found = pair.stream_with_confidences(&Config { colour: !format.is_grey(), ..config }, Portable);
        let grey_config = Config { colour: false, ..config };
        prop_assert!(found == grey.stream_with_confidences(&grey_config, Portable));
    }

    /// A matcher accepts the stated memory, whatever is in it, and refuses one word less.
    #[test]
    fn the_stated_memory_is_exact(
        (pair, config) in matching(),
        corners in any::<[prop::sample::Index; 2]>(),
    ) {
        let x = corners[0].index(pair.width);
        let width = 1 + corners[1].index(pair.width - x);
        let region = Region { x: x as u16, width: width as u16, ..config.region };
        for config in [config, Config { region, ..config }] {
            let mut memory = vec![u32::MAX; config.memory_words()];
            prop_assert!(Matcher::new(&config, Portable, &mut memory).is_ok());
            let refused = Matcher::new(&config, Portable, &mut memory[1..]).err();
            prop_assert_eq!(refused, Some(ConfigError::Memory(OutOfMemory)));
        }
    }

    #[test]
    fn two_frames_in_a_row_equal_each_alone(
        (first, config) in matching(),
        height in 1_usize..26,
        broken_off in any::<prop::sample::Index>(),
        seed in any::<u64>(),
    ) {
        let mut second = Pair::random_in(first.format, first.width, height, 200, seed);
        follow(&mut second, config.disparities, seed);
        let alone = [&first, &second].map(|pair| pair.stream_with_confidences(&config, Portable));
        let mut memory = vec![u32::MAX; config.memory_words()];
        let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        prop_assert!(first.stream_through(&mut matcher) == alone[0]);
        prop_assert!(second.stream_through(&mut matcher) == alone[1]);
        for (left, right) in first.lines().take(broken_off.index(first.height)) {
            matcher.push(&left, &right).unwrap();
        }
        matcher.reset();
        prop_assert!(second.stream_through(&mut matcher) == alone[1]);
    }

    /// A region with fewer columns is a crop of the whole lines, because whole lines are matched.
    #[test]
    fn columns_of_a_region_are_a_crop(
        (pair, config) in matching(),
        corners in any::<[prop::sample::Index; 4]>(),
    ) {
        let x = corners[0].index(pair.width);
        let y = corners[1].index(pair.height) as u32;
        let width = 1 + corners[2].index(pair.width - x);
        let height = 1 + corners[3].index(pair.height - y as usize) as u32;
        let lines = Region { y, height, ..config.region };
        let whole = pair.stream_with_confidences(&Config { region: lines, ..config }, Portable);
        let region = Region { x: x as u16, width: width as u16, ..lines };
        let found = pair.stream_with_confidences(&Config { region, ..config }, Portable);
        let crop = |line: &[i16]| line[x..x + width].to_vec();
        let disparities_q4 = whole.disparities_q4.chunks(pair.width).flat_map(crop).collect();
        let crop = |line: &[u8]| line[x..x + width].to_vec();
        let confidences = whole.confidences.chunks(pair.width).flat_map(crop).collect();
        let expected = Map { disparities_q4, confidences };
        prop_assert!(found == expected);
    }

    /// Below a region, only the lines within reach of the synapses matter: neither lines further
    /// down nor the time at which the region's lines are flushed change the result.
    #[test]
    fn lines_below_the_reach_of_a_region_do_not_matter(
        (pair, config) in matching(),
        corners in any::<[prop::sample::Index; 2]>(),
    ) {
        let y = corners[0].index(pair.height);
        let height = 1 + corners[1].index(pair.height - y);
        let region = Region { y: y as u32, height: height as u32, ..config.region };
        let config = Config { region, ..config };
        let moving = match &config.parameters.method {
            Method::Sgm(sgm) => sgm.moving_latency_lines(),
            Method::Recall(_) => 0,
        };
        let ahead = usize::from(config.parameters.support.y_px + moving);
        let end = (y + height + ahead).min(pair.height);
        let bytes = end * pair.format.line_bytes(config.width);
        let cut = Pair {
            height: end,
            left: pair.left[..bytes].to_vec(),
            right: pair.right[..bytes].to_vec(),
            ..pair.clone()
        };
        let found = pair.stream_with_confidences(&config, Portable);
        prop_assert!(found == cut.stream_with_confidences(&config, Portable));
    }
}

/// Asserts that offsets of frames of 150 x 110 px are the same but for the rounding of floating point, 1/500 line at
/// most.
#[track_caller]
fn assert_near(found: LineOffsets, expected: LineOffsets) {
    let lines =
        |found: i32, expected: i32| f64::from(found.abs_diff(expected)) / f64::from(1 << 24);
    let apart = lines(found.shift_q24, expected.shift_q24)
        + lines(found.tilt_q24, expected.tilt_q24) * 75.0
        + lines(found.stretch_q24, expected.stretch_q24) * 110.0;
    assert!(apart < 0.002, "{found:?} for {expected:?}");
}

/// If the cameras do not look along the same lines, the lines are moved as in the oracle.
#[test]
fn lines_that_lie_too_low_give_the_bits_of_the_oracle() {
    for (line_offset_px, roll_degrees, lines_max, grey, reference) in [
        (0.4, 0.0, 1, false, Reference::Left),
        (-0.7, 0.0, 1, true, Reference::Left),
        (0.8, 0.0, 1, true, Reference::Right),
        (0.2, 0.5, 1, false, Reference::Left),
        (-0.9, -1.0, 2, false, Reference::Right),
        (0.9, 1.5, 3, true, Reference::Left),
    ] {
        let mut scene = render(&RenderOptions {
            width: 150,
            height: 110,
            d_max: 15,
            line_offset_px,
            exposure: Exposure {
                gain: 1.1,
                offset: 4.0,
                ..Exposure::EQUAL
            },
            ..RenderOptions::default()
        });
        let roll = Stress {
            kind: Kind::Roll,
            amount: roll_degrees,
        };
        roll.apply(&mut scene, 1).unwrap();
        let views = views_of(scene.left.clone(), scene.right.clone(), grey).unwrap();
        let pair = Pair {
            width: 150,
            height: 110,
            format: views.format,
            left: views.left,
            right: views.right,
            valid_columns: views.valid_columns,
        };
        let parameters = with_sgm(Preset::Micro.parameters(), |sgm| {
            sgm.line_offset_max_lines = lines_max;
        });
        let config = Config {
            reference,
            colour: !grey,
            ..Config::new(parameters, 150, DisparityRange::up_to(15))
        };
        let (disparities_q4, confidences, learned) = oracle::sgm::match_and_learn(&pair, &config);
        let expected = Map {
            disparities_q4,
            confidences,
        };
        assert_ne!(learned, LineOffsets::NONE);
        // A second frame, of the same pair, begins with what the first one taught.
        let next = Config {
            line_offsets: learned,
            ..config
        };
        let (disparities_q4, confidences, learned_next) =
            oracle::sgm::match_and_learn(&pair, &next);
        let expected_next = Map {
            disparities_q4,
            confidences,
        };
        assert!(expected_next != expected);
        for kernels in NativeKernels::available() {
            let what = format!("{line_offset_px}, {roll_degrees}, {}", kernels.name());
            let mut memory = vec![u32::MAX; config.memory_words()];
            let mut matcher = Matcher::new(&config, kernels, &mut memory).unwrap();
            assert!(pair.stream_through(&mut matcher) == expected, "{what}");
            assert_near(matcher.line_offsets(), learned);
            matcher.set_line_offsets(learned);
            assert_eq!(matcher.line_offsets(), learned);
            assert!(pair.stream_through(&mut matcher) == expected_next, "{what}");
            assert_near(matcher.line_offsets(), learned_next);
        }
        let mut unmoved = config;
        unmoved.parameters = with_sgm(config.parameters, |sgm| sgm.line_offset_max_lines = 0);
        let unmoved = pair.stream_with_confidences(&unmoved, NativeKernels::fastest());
        assert!(unmoved != expected, "{line_offset_px}: no line was moved");
    }
}

/// A shifted texture has the disparity of its shift, for both references, in grey and in colour,
/// also if it is negative.
#[test]
fn a_shifted_texture_has_its_shift() {
    let (width, height, shift) = (96_usize, 24, 7_usize);
    for format in [PixelFormat::Grey8, PixelFormat::Rgb888] {
        let pixel = format.bytes_per_pixel();
        let mut random = Pcg32::seed_from_u64(4);
        let strip: Vec<u8> = (0..(width + shift) * height * pixel)
            .map(|_| random.next_u32() as u8)
            .collect();
        let cut = |from: usize| -> Vec<u8> {
            let lines = strip.chunks_exact((width + shift) * pixel);
            lines
                .flat_map(|line| line[from * pixel..(from + width) * pixel].to_vec())
                .collect()
        };
        let (near, far) = (cut(0), cut(shift));
        for (left, right, expected) in [(&near, &far, 7), (&far, &near, -7)] {
            let pair = Pair {
                format,
                width,
                height,
                left: left.clone(),
                right: right.clone(),
                valid_columns: Default::default(),
            };
            for reference in [Reference::Left, Reference::Right] {
                let range = DisparityRange {
                    minimum_px: -12,
                    count: 25,
                };
                let config = Config {
                    reference,
                    colour: !format.is_grey(),
                    ..Config::new(Preset::Micro.parameters(), width as u16, range)
                };
                let map = pair.stream_with_confidences(&config, Portable);
                assert_sound(&map, &config);
                let lines = map.disparities_q4.chunks_exact(width);
                for (line, confidences) in lines.zip(map.confidences.chunks_exact(width)) {
                    // Away from the sides, the match and all samples are within both views. The
                    // parabola through the sums may be off by 1/16 px.
                    let inner = 20..width - 20;
                    for (&d, &confidence) in line[inner.clone()].iter().zip(&confidences[inner]) {
                        assert!(
                            (d - expected * 16).abs() <= 1,
                            "{format:?}, {reference:?}: {d}"
                        );
                        assert!(confidence > 0, "{format:?}, {reference:?}");
                    }
                }
            }
        }
    }
}

/// On a blank wall between two textures, disparities lose their confidence if texture is required,
/// and only there.
#[test]
fn without_texture_nothing_is_found() {
    let (width, height, wall) = (120_usize, 12, 40..80_usize);
    let mut pair = Pair::random(width, height, 256, 8);
    for line in pair.left.chunks_exact_mut(width) {
        line[wall.clone()].fill(90);
    }
    pair.right.clone_from(&pair.left);
    let parameters = Preset::Lite.parameters();
    let Method::Sgm(lite) = parameters.method else {
        panic!("lite aggregates");
    };
    let reach = usize::from(parameters.support.x_px);
    for texture_min in [0, 1] {
        let method = Method::Sgm(SgmParameters {
            margin: i16::MIN,
            texture_min,
            ..lite
        });
        let parameters = Parameters {
            method,
            ..parameters
        };
        let config = Config::new(parameters, width as u16, DisparityRange::up_to(7));
        let map = pair.stream_with_confidences(&config, Portable);
        for line in map.confidences.chunks_exact(width) {
            let blank = &line[wall.start + reach..wall.end - reach];
            assert!(blank.iter().all(|&c| (c > 0) == (texture_min == 0)));
            let textured = [&line[8..wall.start], &line[wall.end..]].concat();
            assert!(textured.iter().all(|&c| c > 0));
        }
    }
}

/// Sizes at which mistakes are likely, tested always rather than by chance.
#[test]
fn extreme_sizes_are_alike_for_all_kernels() {
    for (width, height) in [
        (1, 1),
        (1, 40),
        (2, 1),
        (31, 9),
        (32, 9),
        (33, 9),
        (63, 3),
        (64, 3),
        (65, 20),
    ] {
        for reference in [Reference::Left, Reference::Right] {
            for format in PixelFormat::ALL {
                let range = DisparityRange::up_to(width as u16 - 1);
                let mut pair = Pair::random_in(format, width, height, 9, 5);
                follow(&mut pair, range, 6);
                let config = Config {
                    reference,
                    colour: !format.is_grey(),
                    ..Config::new(Preset::Micro.parameters(), width as u16, range)
                };
                let expected = pair.stream_with_confidences(&config, Portable);
                for kernels in NativeKernels::available() {
                    let found = pair.stream_with_confidences(&config, kernels);
                    assert!(
                        found == expected,
                        "{width}x{height}, {reference:?}, {format:?}, {}",
                        kernels.name()
                    );
                }
            }
        }
    }
}

/// A region of a few lines is finished late: the lines that its stages look at must still be
/// available.
#[test]
fn a_region_of_one_line_waits_for_its_latency() {
    let pair = Pair::random(40, 30, 200, 3);
    let reaches = [None, Some(0), Some(1), Some(2)];
    for (ahead, speckle, vote, median) in [0, 1, 3]
        .into_iter()
        .flat_map(|ahead| reaches.map(|speckle| (ahead, speckle)))
        .flat_map(|(ahead, speckle)| reaches.map(|vote| (ahead, speckle, vote)))
        .flat_map(|(ahead, speckle, vote)| {
            let reaches = [None, Some(0), Some(2), Some(4)];
            reaches.map(|median| (ahead, speckle, vote, median))
        })
    {
        let full = micro();
        let parameters = Parameters {
            support: Support {
                x_px: 3,
                y_px: ahead,
            },
            method: Method::Sgm(SgmParameters {
                margin: 1,
                speckle: speckle.map(|reach_y_px| SpeckleParameters {
                    size_min: 4,
                    step_q4: 16,
                    reach_y_px,
                }),
                vote: vote.map(|reach_y_px| RegionVoteParameters {
                    reach_y_px,
                    ..full.vote.unwrap()
                }),
                weighted_median: median.map(|reach_y_px| WeightedMedianParameters {
                    reach_y_px,
                    ..full.weighted_median.unwrap()
                }),
                ..full
            }),
            ..Preset::Micro.parameters()
        };
        for height in 1..4 {
            let mut config = Config::new(parameters, 40, DisparityRange::up_to(15));
            config.region = Region {
                y: 5,
                height,
                ..config.region
            };
            // The frame ends with the last line that the region's synapses reach.
            let end = 40 * (5 + height as usize + usize::from(ahead));
            let cut = Pair {
                left: pair.left[..end].to_vec(),
                right: pair.right[..end].to_vec(),
                ..pair.clone()
            };
            let found = pair.stream_with_confidences(&config, Portable);
            let expected = cut.stream_with_confidences(&config, Portable);
            assert!(
                found == expected,
                "{height} lines; reaches: synapses {ahead}, speckle {speckle:?}, vote {vote:?}, median {median:?}"
            );
        }
    }
}

/// The most disparities that fit 16 bits in 1/16 px can be matched; one more is refused.
#[test]
fn the_widest_range_of_disparities_runs() {
    let (width, shift) = (2100_usize, 1500_usize);
    let mut random = Pcg32::seed_from_u64(9);
    let strip: Vec<u8> = (0..width + shift)
        .map(|_| random.next_u32() as u8)
        .collect();
    let pair = Pair {
        format: PixelFormat::Grey8,
        width,
        height: 2,
        left: strip[..width].repeat(2),
        right: strip[shift..].repeat(2),
        valid_columns: Default::default(),
    };
    let wider = DisparityRange {
        minimum_px: -2047,
        count: 2049,
    };
    let config = Config::new(Preset::Micro.parameters(), width as u16, wider);
    assert_eq!(config.validate(), Err(ConfigError::Disparities));
    let range = DisparityRange {
        minimum_px: -300,
        count: 2048,
    };
    let config = Config::new(Preset::Micro.parameters(), width as u16, range);
    let map = pair.stream_with_confidences(&config, NativeKernels::fastest());
    assert_sound(&map, &config);
    let found = &map.disparities_q4[shift + 40..width - 40];
    assert!(found.iter().all(|&d| (d - 1500 * 16).abs() <= 4));
}

/// In the negative of an image every cell of a pattern differs, which has the highest cost.
#[test]
fn the_dearest_patterns_cost_the_most() {
    for (synapses, hamming_scale, kept_cells_q8) in [
        (1024, 250, 256),
        (512, 250, 256),
        (1024, 250, 128),
        (1024, 96, 256),
    ] {
        let parameters = Parameters {
            synapses,
            sigmas_px: [10.0; 2],
            cell_length_max_px: 0,
            support: Support::square(30),
            seed: 1,
            method: Method::Sgm(SgmParameters {
                hamming_scale,
                hamming_truncation: 170,
                p1: 10,
                p2: 75,
                p2_floor: 15,
                kept_cells_q8,
                mask_floor: 0,
                difference_weight_q4: 0,
                difference_truncation: 0,
                left_right_tolerance_px: u8::MAX,
                margin: 1,
                // Its penalty leaves no room for such costs.
                rivals: None,
                vote: None,
                weighted_median: None,
                ..micro()
            }),
        };
        let width = 80;
        let mut pair = Pair::random(width, 20, 256, 2);
        pair.right = pair.left.iter().map(|level| !level).collect();
        let config = Config::new(parameters, width as u16, DisparityRange::up_to(1));
        let map = pair.stream_with_confidences(&config, Portable);
        // At disparity 0 all cells differ, at disparity 1 half of them do.
        let lines = map.disparities_q4.chunks_exact(width);
        for (y, line) in lines.enumerate() {
            assert!(
                line[1..].iter().all(|&d| d == 16),
                "{synapses}, {hamming_scale}, {kept_cells_q8}, line {y}: {line:?}"
            );
        }
    }
}

/// Returns a pair whose lines differ in brightness, so that vertical arms end at some lines and
/// cross others. The views are unrelated, so that most pixels are voted for.
fn striped(format: PixelFormat, (width, height): (usize, usize), seed: u64) -> Pair {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut pair = Pair::random_in(format, width, height, 8, seed);
    let bytes = width * format.bytes_per_pixel();
    for line in 0..height {
        let brightness = if random.next_u32().is_multiple_of(6) {
            60
        } else {
            0
        };
        for view in [&mut pair.left, &mut pair.right] {
            for level in &mut view[line * bytes..(line + 1) * bytes] {
                *level += brightness;
            }
        }
    }
    pair
}

/// Each stage that compares levels finds all lines of its window, even if no other stage keeps
/// them: if the view kept one line less, the output would differ.
#[test]
fn stages_see_all_lines_of_their_windows() {
    let vote = RegionVoteParameters {
        reach_x_px: 3,
        reach_y_px: 5,
        near_step: 30,
        far_step: 30,
        voters: Voters::EveryLine,
        support_min: 0,
        share_min_percent: 0,
    };
    let median = WeightedMedianParameters {
        reach_x_px: 2,
        reach_y_px: 6,
        colour_reach: 48,
    };
    let speckle = SpeckleParameters {
        size_min: 2,
        step_q4: 16,
        reach_y_px: 1,
    };
    for (speckle, vote, weighted_median) in [
        (None, Some(vote), None),
        (Some(speckle), Some(vote), None),
        (None, None, Some(median)),
        (Some(speckle), None, Some(median)),
    ] {
        for (format, seed) in [PixelFormat::Grey8, PixelFormat::Rgb888]
            .into_iter()
            .flat_map(|format| (0..4).map(move |seed| (format, seed)))
        {
            let pair = striped(format, (24, 40), seed);
            let sgm = SgmParameters {
                colour: true,
                left_right_tolerance_px: 2,
                margin: 40,
                speckle,
                vote,
                weighted_median,
                ..micro()
            };
            let parameters = Parameters {
                support: Support { x_px: 2, y_px: 1 },
                sigmas_px: [1.0; 2],
                method: Method::Sgm(sgm),
                ..Preset::Micro.parameters()
            };
            let config = Config {
                colour: !format.is_grey(),
                ..Config::new(parameters, 24, DisparityRange::up_to(7))
            };
            let (disparities_q4, confidences) = oracle::sgm::match_whole(&pair, &config);
            let expected = Map {
                disparities_q4,
                confidences,
            };
            let found = pair.stream_with_confidences(&config, Portable);
            assert!(found == expected, "{format:?}, seed {seed}, {sgm:?}");
        }
    }
}

/// Returns a rendered pair whose right view is shifted down by a fraction of a line.
fn lowered(line_offset_px: f32) -> Pair {
    let scene = render(&RenderOptions {
        width: 150,
        height: 110,
        d_max: 15,
        line_offset_px,
        ..RenderOptions::default()
    });
    let views = views_of(scene.left.clone(), scene.right.clone(), false).unwrap();
    Pair {
        width: 150,
        height: 110,
        format: views.format,
        left: views.left,
        right: views.right,
        valid_columns: views.valid_columns,
    }
}

/// The learned vertical offset is discarded at the end of the frame, whether it is complete or
/// broken off.
#[test]
fn the_alignment_of_a_frame_does_not_outlive_it() {
    let config = Config {
        colour: true,
        ..Config::new(Preset::Micro.parameters(), 150, DisparityRange::up_to(15))
    };
    let (first, second) = (lowered(0.8), lowered(-0.6));
    let alone = second.stream_with_confidences(&config, Portable);
    let mut memory = vec![u32::MAX; config.memory_words()];
    let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let _ = first.stream_through(&mut matcher);
    assert!(second.stream_through(&mut matcher) == alone);
    // The frame is broken off before an offset is found, just after that, and later.
    for lines in [5, 12, 20, 30, 60, 100] {
        for (left, right) in first.lines().take(lines) {
            matcher.push(&left, &right).unwrap();
        }
        let learned = matcher.line_offsets();
        matcher.reset();
        assert_eq!(matcher.line_offsets(), learned);
        assert!(
            second.stream_through(&mut matcher) == alone,
            "{lines} lines"
        );
    }
    // Unless it is told to begin with what was learned.
    let _ = first.stream_through(&mut matcher);
    let learned = matcher.line_offsets();
    assert_ne!(learned, LineOffsets::NONE);
    assert!(matcher.finish().is_none());
    assert_eq!(
        matcher.line_offsets(),
        learned,
        "a frame of no lines taught something"
    );
    matcher.set_line_offsets(learned);
    let begun = Config {
        line_offsets: learned,
        ..config
    };
    assert_eq!(*matcher.config(), config);
    let alone = second.stream_with_confidences(&begun, Portable);
    assert!(second.stream_through(&mut matcher) == alone);
}

/// Channels with different exposures are each converted by their own gain and offset.
#[test]
fn channels_exposed_unlike_give_the_bits_of_the_oracle() {
    let mut pair = lowered(0.0);
    for pixel in pair.right.as_chunks_mut::<3>().0 {
        for (level, (gain_q4, offset)) in pixel.iter_mut().zip([(12, 20), (16, 0), (11, 60)]) {
            *level = ((u16::from(*level) * gain_q4) / 16 + offset).min(255) as u8;
        }
    }
    let config = Config {
        colour: true,
        ..Config::new(Preset::Micro.parameters(), 150, DisparityRange::up_to(15))
    };
    let (disparities_q4, confidences) = oracle::sgm::match_whole(&pair, &config);
    let expected = Map {
        disparities_q4,
        confidences,
    };
    for kernels in NativeKernels::available() {
        let found = pair.stream_with_confidences(&config, kernels);
        assert!(found == expected, "{}", kernels.name());
    }
}

/// Share of the pixels that are further than 1 px from both neighbouring lines, to the same side.
fn stripes(disparities_q4: &[i16], width: usize) -> f64 {
    let lines: Vec<&[i16]> = disparities_q4.chunks_exact(width).collect();
    let is_unlike = |above: i16, own: i16, below: i16| {
        let (least, most) = (above.min(below), above.max(below));
        own > most + 16 || own + 16 < least
    };
    let inside = lines.windows(3).map(|lines| {
        let pixels = lines[0].iter().zip(lines[1]).zip(lines[2]);
        pixels
            .filter(|&((&above, &own), &below)| is_unlike(above, own, below))
            .count()
    });
    inside.sum::<usize>() as f64 / (width * (lines.len() - 2)) as f64
}

/// Where the lines that vote alternate from line to line, so do the disparities; where every line
/// votes, they do not.
#[test]
fn a_vote_over_every_line_leaves_no_stripes() {
    let options = RenderOptions::default();
    let scene = Prepared::new(render(&options), false).unwrap();
    for preset in [Preset::Micro, Preset::Balanced] {
        let shares = [Voters::OtherLines, Voters::EveryLine].map(|voters| {
            let parameters = with_sgm(preset.parameters(), |sgm| {
                sgm.vote.as_mut().unwrap().voters = voters;
            });
            let matched = scene.matched(parameters, Output::Dense, 1).unwrap();
            stripes(&matched.disparities_q4, options.width as usize)
        });
        println!("{preset}: {shares:?}");
        assert!(
            shares[1] <= 0.0005 && shares[1] < 0.8 * shares[0],
            "{preset}: {shares:?}"
        );
    }
}

/// Both views of a slanted plane that is textured but for a plain window, with noise of one level,
/// and the true disparity of each column.
fn plain_window(width: u32, height: u32, seed: u64) -> (Views, Vec<f64>) {
    let (nearest_px, slope) = (20.0, 0.03);
    let middle = f64::from(width) / 2.0;
    let disparity_px = |x: f64| nearest_px + slope * (x - middle);
    let mut random = Pcg32::seed_from_u64(seed);
    let margin = 40;
    let columns = (width + 2 * margin) as usize;
    // A mean of two columns, so that the levels between them are true to the texture.
    let texture: Vec<f64> = (0..height as usize * columns)
        .map(|_| f64::from(random.next_u32() % 256))
        .collect();
    let texture = |x: f64, y: u32| {
        let x = x + f64::from(margin);
        let (column, part) = (x.floor() as usize, x.fract());
        let at = |column: usize| {
            let row = y as usize * columns;
            (texture[row + column] + texture[row + column + 1]) / 2.0
        };
        at(column) * (1.0 - part) + at(column + 1) * part
    };
    let mut view = |place_of: &dyn Fn(f64) -> f64| {
        image::RgbImage::from_fn(width, height, |x, y| {
            let x = place_of(f64::from(x));
            let is_plain = (100.0..200.0).contains(&x) && (20..100).contains(&y);
            let level = if is_plain { 128.0 } else { texture(x, y) };
            let noise = f64::from(random.next_u32() % 3) - 1.0;
            image::Rgb([(level + noise).clamp(0.0, 255.0).round() as u8; 3])
        })
    };
    let left = view(&|x| x);
    let right = view(&|x| (x + nearest_px - slope * middle) / (1.0 - slope));
    let truth = (0..width).map(|x| disparity_px(f64::from(x))).collect();
    (views_of(left, right, false).unwrap(), truth)
}

/// In a plain window, what differs by noise alone decides less where it costs less.
#[test]
fn with_evidence_a_plain_window_is_less_often_wrong() {
    let (width, height) = (240, 120);
    for preset in aggregating_unless_named(&[]) {
        let wrong = [0, 83].map(|evidence_q8| {
            let parameters = with_sgm(preset.parameters(), |sgm| sgm.evidence_q8 = evidence_q8);
            let wrong = (1..=3).map(|seed| {
                let (views, truth_px) = plain_window(width, height, seed);
                let range = DisparityRange::up_to(39);
                let config = Config {
                    colour: views.has_colour(),
                    ..Config::new(parameters, width as u16, range)
                };
                let kernels = NativeKernels::fastest();
                let matched = match_frame(&config, &views, kernels, 1).unwrap();
                let lines = matched.disparities_q4.chunks_exact(width as usize);
                let is_wrong =
                    |q4: i16, truth_px: f64| (f64::from(q4) / 16.0 - truth_px).abs() > 1.0;
                let lines = lines.skip(20).take(80);
                let pixels = lines.flat_map(|line| line.iter().zip(&truth_px).skip(100).take(100));
                pixels
                    .filter(|&(&q4, &truth_px)| is_wrong(q4, truth_px))
                    .count()
            });
            wrong.sum::<usize>()
        });
        println!("{preset}: {wrong:?} of 24000");
        assert!(2 * wrong[1] < wrong[0], "{preset}: {wrong:?}");
    }
}
