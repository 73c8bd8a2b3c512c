//! Guarantees of the matcher on memory, latency, independence of frames and refusal of input.

use vgstereo_core::config::{ChecksError, DEFAULT_SEED, SpeckleChecks, Support, SynapseError};
use vgstereo_core::kernel::TieBreak;
use vgstereo_core::rows::OutOfMemory;
use vgstereo_core::{
    Config, ConfigError, DisparityRange, Matcher, Method, Output, Parameters, Portable, Preset,
    PushError, RecallParameters, Reference, Region, SgmParameters,
};
use vgstereo_firmware::camera::{PixelFormat, RawLine};
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;
use vgstereo_tests::{Map, Pair};

/// Reference configuration: Middlebury's Teddy.
const TEDDY: Config = Config::new(
    Preset::PaperRaw.parameters(),
    450,
    DisparityRange::up_to(59),
);

// The terms are the parts that `RecallMatcher::parts` and `RecallRefiner::parts` state, each
// rounded up to words. The last three are the output line, its confidences and what the cameras saw
// of the lines.
const _: () = assert!(
    TEDDY.memory_words() * 4
        == 2 * 256
            + 2 * (25 * 474 + 2)
            + 2 * (466 * 32)
            + 2 * 64
            + 2 * 450
            + 2 * 450
            + 452
            + 8 * 13
            + 8
);
const _: () = assert!(TEDDY.memory_words() * 4 <= 96 * 1024);

#[test]
fn exactly_the_stated_memory_is_enough() {
    for preset in Preset::ALL {
        for (width, d_max) in [(450, 59), (33, 32), (1, 0), (320, 47)] {
            for format in PixelFormat::ALL {
                let disparities = DisparityRange::up_to(d_max);
                let config = Config {
                    colour: !format.is_grey(),
                    ..Config::new(preset.parameters(), width, disparities)
                };
                let mut memory = vec![0; config.memory_words()];
                assert!(Matcher::new(&config, Portable, &mut memory).is_ok());
                let short = &mut memory[1..];
                let refused = Matcher::new(&config, Portable, short).map(|_| ());
                assert_eq!(
                    refused,
                    Err(ConfigError::Memory(OutOfMemory)),
                    "{preset} {width} {format:?}"
                );
            }
        }
    }
}

/// A matcher with other checks gives what one gives that was built with them.
#[test]
fn other_checks_are_those_of_a_matcher_built_with_them() {
    for (seed, preset) in (0..).zip([Preset::Lite, Preset::Micro]) {
        println!("seed {seed}, {preset}");
        let pair = Pair::random(61, 40, 40, seed);
        let config = Config::new(preset.parameters(), 61, DisparityRange::up_to(9));
        let mut memory = vec![0; config.memory_words()];
        let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        let before = pair.stream_through(&mut matcher);

        let mut checks = config.checks().unwrap();
        checks.margin = 90;
        checks.left_right_tolerance_px = 0;
        checks.texture_min = 200;
        let size_min = checks.speckle.unwrap().size_min - 3;
        checks.speckle = Some(SpeckleChecks {
            size_min,
            step_q4: 3,
        });
        checks.output = Output::Sparse;
        // Amid a frame, which is forgotten.
        matcher.push(&[7; 61], &[7; 61]).unwrap();
        matcher.set_checks(&checks).unwrap();
        assert_eq!(matcher.config().checks(), Some(checks));

        let mut other = config;
        let Method::Sgm(sgm) = &mut other.parameters.method else {
            panic!("{preset} is SGM");
        };
        (sgm.margin, sgm.left_right_tolerance_px, sgm.texture_min) = (90, 0, 200);
        let speckle = sgm.speckle.as_mut().unwrap();
        (speckle.size_min, speckle.step_q4) = (size_min, 3);
        other.output = Output::Sparse;
        let expected = pair.stream_with_confidences(&other, Portable);
        assert_eq!(pair.stream_through(&mut matcher), expected);
        assert_ne!(before, expected);
    }
}

#[test]
fn checks_that_do_not_fit_change_nothing() {
    let recall = Config::new(Preset::Paper.parameters(), 24, DisparityRange::up_to(9));
    let config = Config::new(Preset::Lite.parameters(), 24, DisparityRange::up_to(9));
    let mut memory = vec![0; config.memory_words().max(recall.memory_words())];
    let checks = config.checks().unwrap();
    assert_eq!(recall.checks(), None);
    let mut matcher = Matcher::new(&recall, Portable, &mut memory).unwrap();
    assert_eq!(matcher.set_checks(&checks), Err(ChecksError::Method));

    let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let mut other = checks;
    other.margin = 1;
    other.speckle = None;
    assert_eq!(matcher.set_checks(&other), Err(ChecksError::Speckle));
    let mut larger = checks.speckle.unwrap();
    larger.size_min += 1;
    other.speckle = Some(larger);
    assert_eq!(matcher.set_checks(&other), Err(ChecksError::SpeckleSize));
    assert_eq!(matcher.config(), &config);
}

/// Returns the number of lines that all stages together look ahead.
fn lines_ahead(parameters: &Parameters) -> u32 {
    let support = u32::from(parameters.support.y_px);
    support
        + match &parameters.method {
            Method::Recall(recall) => {
                u32::from(recall.vote_passes) + u32::from(recall.median_reach_px)
            }
            Method::Sgm(aggregation) => {
                let speckle = aggregation
                    .speckle
                    .map_or(0, |speckle| u32::from(speckle.reach_y_px));
                let vote = aggregation
                    .vote
                    .map_or(0, |vote| u32::from(vote.reach_y_px));
                // A median of 3 x 3 pixels looks one line ahead; the weighted median is followed by
                // another.
                let median = aggregation
                    .weighted_median
                    .map_or(0, |median| u32::from(median.reach_y_px) + 1);
                speckle + vote + 1 + median
            }
        }
}

/// The first line is returned with pair number `latency_lines`, and one more with each pair after
/// it. `finish` returns the lines that were held back.
#[test]
fn latency_is_as_stated() {
    for preset in Preset::ALL {
        let config = Config::new(preset.parameters(), 24, DisparityRange::up_to(9));
        let latency = config.parameters.latency_lines();
        assert_eq!(latency, lines_ahead(&config.parameters), "{preset}");
        match preset {
            // Paper: 12 lines of support, 5 passes of the vote, and half a median of 7 x 7.
            // PaperRaw: support only.
            Preset::PaperRaw => assert_eq!(latency, 12),
            Preset::Paper => assert_eq!(latency, 12 + 5 + 3),
            // 3 lines of support, 4 of the vote; medians over 3, 5 and 3 lines.
            Preset::Micro => assert_eq!(latency, 3 + 4 + 1 + 2 + 1),
            _ => {}
        }
        for height in [1, latency, latency + 1, 3 * latency] {
            let mut memory = vec![0; config.memory_words()];
            let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
            for pair in 0..height {
                let line = matcher
                    .push(&[9; 24], &[9; 24])
                    .unwrap()
                    .map(|line| line.line);
                assert_eq!(line, pair.checked_sub(latency), "{preset}");
            }
            let held = (0..).take_while(|_| matcher.finish().is_some()).count();
            assert_eq!(held as u32, latency.min(height), "{preset}");
        }
    }
}

/// If a region ends above the end of the frame, its last lines are not held back until then.
#[test]
fn latency_is_as_stated_below_a_region() {
    let places = [(0, 1), (3, 2), (2, 5), (0, 30), (9, 40), (59, 1)];
    let presets = Preset::ALL.into_iter();
    for (preset, (y, height)) in presets.flat_map(|preset| places.map(|place| (preset, place))) {
        let mut config = Config::new(
            preset.parameters().with_sigma(1.0),
            24,
            DisparityRange::up_to(9),
        );
        config.region = Region {
            x: 4,
            y,
            width: 11,
            height,
        };
        let latency = config.parameters.latency_lines();
        let mut memory = vec![0; config.memory_words()];
        let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        for pair in 0..60_u32 {
            let line = matcher.push(&[9; 24], &[9; 24]).unwrap();
            let expected = pair
                .checked_sub(latency)
                .filter(|&line| config.region.contains_line(line));
            let line = line.map(|line| line.line);
            assert_eq!(line, expected, "{preset} {y} {height}");
        }
        let held = (0..).take_while(|_| matcher.finish().is_some()).count() as u32;
        let end = (y + height).min(60);
        let first_held = 60 - latency;
        let expected = end.saturating_sub(first_held.max(y));
        assert_eq!(held, expected, "{preset} {y} {height}");
    }
}

#[test]
fn frames_do_not_leak_into_each_other() {
    for preset in Preset::ALL {
        let config = Config::new(preset.parameters(), 40, DisparityRange::up_to(15));
        let (first, second) = (Pair::random(40, 30, 200, 1), Pair::random(40, 23, 200, 2));
        let alone = second.stream_with_confidences(&config, Portable);
        let mut memory = vec![0; config.memory_words()];
        let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        let push = |matcher: &mut Matcher<'_>, pair: &Pair| -> Map {
            let lines = pair.left.chunks(40).zip(pair.right.chunks(40));
            let mut map = Map::default();
            for (left, right) in lines {
                if let Some(line) = matcher.push(left, right).unwrap() {
                    map.extend(&line, 40);
                }
            }
            map
        };
        // A complete frame, one that is broken off, then the one that is compared.
        push(&mut matcher, &first);
        while matcher.finish().is_some() {}
        push(&mut matcher, &first);
        matcher.reset();
        let mut map = push(&mut matcher, &second);
        while let Some(line) = matcher.finish() {
            map.extend(&line, 40);
        }
        assert_eq!(map, alone, "{preset}");
    }
}

#[test]
fn refused_lines_change_nothing() {
    let formats = [PixelFormat::Grey8, PixelFormat::Rgb888];
    let presets = Preset::ALL.into_iter();
    for (preset, format) in presets.flat_map(|preset| formats.map(|format| (preset, format))) {
        let config = Config {
            colour: !format.is_grey(),
            ..Config::new(preset.parameters(), 40, DisparityRange::up_to(15))
        };
        let pair = Pair::random_in(format, 40, 30, 200, 1);
        let bytes = format.line_bytes(40);
        let mut memory = vec![0; config.memory_words()];
        let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        let mut map = Map::default();
        let raw = |bytes| RawLine::new(format, bytes, Portable);
        let longer = vec![0; bytes + format.bytes_per_pixel()];
        for (left, right) in pair.lines() {
            let refused = matcher.push(&raw(&pair.left[1..bytes]), &right);
            assert_eq!(refused, Err(PushError::Width));
            let refused = matcher.push(&left, &raw(&longer));
            assert_eq!(refused, Err(PushError::Width));
            if config.colour {
                let refused = matcher.push(&left, &[7; 40]);
                assert_eq!(refused, Err(PushError::Colour));
            }
            if let Some(line) = matcher.push(&left, &right).unwrap() {
                map.extend(&line, 40);
            }
        }
        while let Some(line) = matcher.finish() {
            map.extend(&line, 40);
            let (left, right) = (raw(&pair.left[..bytes]), raw(&pair.right[..bytes]));
            assert_eq!(matcher.push(&left, &right), Err(PushError::Finishing));
        }
        assert_eq!(map, pair.stream_with_confidences(&config, Portable));
    }
}

fn recall_of(config: &mut Config) -> &mut RecallParameters {
    match &mut config.parameters.method {
        Method::Recall(recall) => recall,
        Method::Sgm(_) => panic!("not the paper's method"),
    }
}

fn micro() -> SgmParameters {
    match Preset::Micro.parameters().method {
        Method::Sgm(aggregation) => aggregation,
        Method::Recall(_) => panic!("micro aggregates"),
    }
}

#[test]
fn aggregations_out_of_range_are_refused() {
    let refusal = |change: &dyn Fn(&mut SgmParameters)| {
        let mut aggregation = micro();
        change(&mut aggregation);
        let parameters = Parameters {
            method: Method::Sgm(aggregation),
            ..Preset::Micro.parameters()
        };
        let config = Config::new(parameters, 40, DisparityRange::up_to(15));
        Matcher::new(&config, Portable, &mut vec![0; 1 << 20]).err()
    };
    assert_eq!(refusal(&|_| ()), None);
    let rivals = |a: &mut SgmParameters, cost_shift: u8, p2_min: u8| {
        let rivals = a.rivals.as_mut().unwrap();
        (rivals.cost_shift, rivals.p2_min) = (cost_shift, p2_min);
    };
    let costs: [&dyn Fn(&mut SgmParameters); 8] = [
        // The sum with P2 and the 45 of the levels is 255, one too many.
        &|a| {
            a.hamming_truncation = 255 - 45 - a.p2;
            rivals(a, 2, 0);
        },
        // So is that with the P2 of rivals.
        &|a| {
            let p2_min = 255 - 45 - a.hamming_truncation;
            rivals(a, 2, p2_min);
        },
        &|a| rivals(a, 8, 160),
        &|a| a.difference_weight_q4 = 255,
        &|a| a.p2 = 255,
        &|a| a.p1 = a.p2 + 1,
        &|a| a.p2_floor = a.p2 + 1,
        &|a| a.hamming_scale = 251,
    ];
    for (number, change) in costs.into_iter().enumerate() {
        assert_eq!(refusal(change), Some(ConfigError::Costs), "{number}");
    }
    let largest = refusal(&|a| {
        a.hamming_truncation = 254 - 45 - a.p2;
        let p2 = a.p2;
        rivals(a, 7, p2);
    });
    assert_eq!(largest, None);
    let largest = refusal(&|a| {
        let p2_min = 254 - 45 - a.hamming_truncation;
        rivals(a, 2, p2_min);
    });
    assert_eq!(largest, None);
    assert_eq!(refusal(&|a| a.hamming_scale = 250), None);
    let refused = refusal(&|a| a.line_offset_max_lines = 5);
    assert_eq!(refused, Some(ConfigError::LineOffset));
    assert_eq!(refusal(&|a| a.line_offset_max_lines = 4), None);
    let windows: [&dyn Fn(&mut SgmParameters); 9] = [
        &|a| a.kept_cells_q8 = 0,
        &|a| a.speckle.as_mut().unwrap().reach_y_px = 16,
        &|a| a.weighted_median.as_mut().unwrap().colour_reach = 3,
        &|a| a.vote.as_mut().unwrap().reach_x_px = 128,
        &|a| a.vote.as_mut().unwrap().reach_y_px = 16,
        &|a| a.weighted_median.as_mut().unwrap().reach_x_px = 31,
        &|a| a.weighted_median.as_mut().unwrap().reach_y_px = 8,
        &|a| a.weighted_median.as_mut().unwrap().colour_reach = 49,
        // Out of range, and odd: the largest window is 61 x 13 pixels.
        &|a| {
            let median = a.weighted_median.as_mut().unwrap();
            (median.reach_x_px, median.reach_y_px) = (30, 7);
        },
    ];
    for (number, change) in windows.into_iter().enumerate() {
        assert_eq!(refusal(change), Some(ConfigError::Windows), "{number}");
    }
    assert_eq!(
        refusal(&|a| a.speckle.as_mut().unwrap().reach_y_px = 15),
        None
    );
}

#[test]
fn configurations_out_of_range_are_refused() {
    let refusal = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::new(Preset::Paper.parameters(), 40, DisparityRange::up_to(15));
        change(&mut config);
        Matcher::new(&config, Portable, &mut vec![0; 1 << 20]).err()
    };
    assert_eq!(refusal(&|_| ()), None);
    for synapses in [0, 8, 24, 1040, u16::MAX] {
        let refused = refusal(&|c| c.parameters.synapses = synapses);
        assert_eq!(refused, Some(ConfigError::Synapses), "{synapses}");
    }
    for sigma_px in [0.0, -1.0, 10.1, f32::NAN, f32::INFINITY] {
        for sigmas_px in [[sigma_px; 2], [sigma_px, 2.0], [2.0, sigma_px]] {
            let refused = refusal(&|c| c.parameters.sigmas_px = sigmas_px);
            assert_eq!(
                refused,
                Some(ConfigError::Synapse(SynapseError::Sigma)),
                "{sigmas_px:?}"
            );
        }
    }
    let refused = refusal(&|c| c.parameters.support = Support::square(128));
    assert_eq!(refused, Some(ConfigError::Synapse(SynapseError::Support)));
    for candidates in [0, 17, 255] {
        let refused = refusal(&|c| recall_of(c).candidates = candidates);
        assert_eq!(refused, Some(ConfigError::Candidates), "{candidates}");
    }
    let refused = refusal(&|c| recall_of(c).median_reach_px = 64);
    assert_eq!(refused, Some(ConfigError::Median));
    for (minimum_px, count) in [(0, 41), (0, 0), (-40, 3), (38, 3), (i16::MIN, u16::MAX)] {
        let refused = refusal(&|c| c.disparities = DisparityRange { minimum_px, count });
        assert_eq!(
            refused,
            Some(ConfigError::Disparities),
            "{minimum_px} {count}"
        );
    }
    assert_eq!(refusal(&|c| c.width = 0), Some(ConfigError::Disparities));
    for (x, width, height) in [
        (0, 0, 1),
        (0, 1, 0),
        (40, 1, 1),
        (1, 40, 1),
        (u16::MAX, u16::MAX, 9),
    ] {
        let refused = refusal(&|c| {
            c.region = Region {
                x,
                y: 0,
                width,
                height,
            }
        });
        assert_eq!(refused, Some(ConfigError::Region), "{x} {width} {height}");
    }
}

/// All parameters at their upper ends at the same time.
#[test]
fn the_largest_parameters_run() {
    let pair = Pair::random(30, 4, 200, 6);
    let parameters = Parameters {
        synapses: 1024,
        sigmas_px: [10.0; 2],
        cell_length_max_px: u8::MAX,
        support: Support::square(127),
        seed: DEFAULT_SEED,
        method: Method::Recall(RecallParameters {
            ties: TieBreak::Random { seed: DEFAULT_SEED },
            candidates: 16,
            vote_passes: u8::MAX,
            median_reach_px: 63,
        }),
    };
    let config = Config::new(parameters, 30, DisparityRange::up_to(29));
    let map = pair.stream(&config, Portable);
    assert_eq!(
        map,
        vgstereo_tests::oracle::recall::match_whole(&pair, &config)
    );
}

#[test]
fn threads_give_the_same_frame() {
    let formats = [PixelFormat::Grey8, PixelFormat::Rgb888];
    let references = [Reference::Left, Reference::Right];
    let region = Region {
        x: 9,
        y: 11,
        width: 40,
        height: 17,
    };
    // More lines than wait between threads, as many, fewer, and fewer than the synapses reach.
    for (height, format) in [81, 32, 14, 1]
        .into_iter()
        .flat_map(|h| formats.map(|f| (h, f)))
    {
        let pair = Pair::random_in(format, 61, height, 30, 9);
        let views = pair.views();
        for (preset, reference) in Preset::ALL
            .into_iter()
            .flat_map(|preset| references.map(|reference| (preset, reference)))
        {
            let mut config = Config {
                colour: !format.is_grey(),
                reference,
                ..Config::new(preset.parameters(), 61, DisparityRange::up_to(20))
            };
            for region in [Region::whole(61), region] {
                config.region = region;
                let alone = pair.stream_with_confidences(&config, Portable);
                for threads in [0, 1, 2, 3, 64, 100_000, usize::MAX] {
                    let matched =
                        match_frame(&config, &views, NativeKernels::fastest(), threads).unwrap();
                    let case =
                        format!("{preset}, {reference:?}, {height} lines, {threads} threads");
                    assert_eq!(matched.disparities_q4, alone.disparities_q4, "{case}");
                    assert_eq!(matched.confidences, alone.confidences, "{case}");
                }
            }
        }
    }
}
