//! The streaming matcher compared with the literal network and with the whole-image oracle.

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::config::Support;
use vgstereo_core::disparity::px_to_q4;
use vgstereo_core::kernel::{TieBreak, luma_row};
use vgstereo_core::literal::{DisparityNeuron, GreyImage, Network, Ties, Wiring, Word};
use vgstereo_core::pattern::Synapses;
use vgstereo_core::{
    Config, DisparityRange, INVALID, Method, Parameters, Portable, RecallParameters, Reference,
    Region,
};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_kernels::NativeKernels;
use vgstereo_tests::{Pair, oracle};

/// Capacity of the literal network's neurons: more than the columns of any view below.
const CAPACITY: usize = 64;

const PLAIN: RecallParameters = RecallParameters {
    ties: TieBreak::Lowest,
    candidates: 1,
    vote_passes: 0,
    median_reach_px: 0,
};

fn plain(synapses: u16, sigma_px: f32, support: Support, seed: u64) -> Parameters {
    Parameters {
        synapses,
        sigmas_px: [sigma_px; 2],
        cell_length_max_px: 0,
        support,
        seed,
        method: Method::Recall(PLAIN),
    }
}

/// Returns the literal network's disparities, 1/16 px. With `own`, every neuron has its own copy of
/// the offsets.
fn literal<W: Word, const WORDS: usize>(pair: &Pair, config: &Config, own: bool) -> Vec<i16> {
    let parameters = &config.parameters;
    let count = usize::from(parameters.synapses);
    let neurons = pair.width * pair.height;
    let stored = oracle::recall::offsets(parameters);
    let repeated = stored.repeat(neurons);
    let wiring = if own {
        Wiring::PerNeuron {
            offsets: Synapses::from_stored(&repeated),
            synapses: count,
        }
    } else {
        Wiring::Shared(Synapses::from_stored(&stored))
    };
    let mut memory: Vec<DisparityNeuron<W, WORDS, CAPACITY>> = Vec::new();
    memory.resize_with(neurons, DisparityNeuron::new);
    let mut network = Network::new(&mut memory, pair.width, wiring).unwrap();
    let (reference, other) = match config.reference {
        Reference::Left => (pair.left_view(), pair.right_view()),
        Reference::Right => (pair.right_view(), pair.left_view()),
    };
    network
        .train(&other, config.disparities, config.reference)
        .unwrap();
    let mut map = vec![0; neurons];
    network
        .test::<Pcg32>(&reference, Ties::Lowest, &mut map)
        .unwrap();
    map.into_iter().map(px_to_q4).collect()
}

fn reference() -> impl Strategy<Value = Reference> {
    prop_oneof![Just(Reference::Left), Just(Reference::Right)]
}

/// Views from one pixel up, and ranges of up to all disparities that the width allows, including
/// negative ones. With `hides`, the cameras of every other pair see some columns only.
fn sized_pair(hides: bool) -> impl Strategy<Value = (Pair, DisparityRange)> {
    (1_usize..34, 1_usize..14, 2_u32..40, any::<u64>()).prop_flat_map(
        move |(width, height, levels, seed)| {
            let widest = width as i16 - 1;
            (-widest..=widest).prop_flat_map(move |minimum_px| {
                (minimum_px..=widest).prop_map(move |maximum_px| {
                    let range = DisparityRange {
                        minimum_px,
                        count: (maximum_px - minimum_px + 1).unsigned_abs(),
                    };
                    let mut pair = Pair::random(width, height, levels, seed);
                    if hides && seed % 2 == 0 {
                        pair.hide_columns(seed);
                    }
                    (pair, range)
                })
            })
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn streaming_equals_the_literal_network(
        (pair, disparities) in sized_pair(false),
        reference in reference(),
        words in 1_u16..=4,
        sigmas_px in prop::array::uniform2(0.3_f32..10.0),
        cell_length_max_px in 0_u8..6,
        (x_px, y_px) in (0_u8..9, 0_u8..7),
        seed in any::<u64>(),
    ) {
        let parameters = Parameters {
            sigmas_px,
            cell_length_max_px,
            ..plain(16 * words, 1.0, Support { x_px, y_px }, seed)
        };
        let config = Config {
            reference,
            ..Config::new(parameters, pair.width as u16, disparities)
        };
        let streamed = pair.stream(&config, Portable);
        prop_assert_eq!(&streamed, &literal::<u32, 2>(&pair, &config, false));
        prop_assert_eq!(&streamed, &literal::<u64, 1>(&pair, &config, true));
    }

    #[test]
    fn every_stage_equals_the_oracle(
        (pair, disparities) in sized_pair(true),
        reference in reference(),
        words in 1_u16..=20,
        random_ties in any::<bool>(),
        candidates in 1_u8..=16,
        vote_passes in 0_u8..=6,
        median_reach_px in 0_u8..=4,
        seed in any::<u64>(),
    ) {
        let parameters = Parameters {
            method: Method::Recall(RecallParameters {
                ties: if random_ties { TieBreak::Random { seed } } else { TieBreak::Lowest },
                candidates,
                vote_passes,
                median_reach_px,
            }),
            ..plain(16 * words, 2.0, Support::three_sigma(2.0), seed)
        };
        let config = Config {
            reference,
            ..Config::new(parameters, pair.width as u16, disparities)
        };
        let expected = oracle::recall::match_whole(&pair, &config);
        for kernels in NativeKernels::available() {
            prop_assert_eq!(&pair.stream(&config, kernels), &expected, "{}", kernels.name());
        }
    }

    #[test]
    fn a_region_is_a_crop_of_the_whole(
        (pair, disparities) in sized_pair(true),
        reference in reference(),
        corners in any::<[prop::sample::Index; 4]>(),
        seed in any::<u64>(),
    ) {
        let parameters = Parameters {
            method: Method::Recall(RecallParameters { ties: TieBreak::Random { seed }, ..PLAIN }),
            ..plain(32, 2.0, Support::three_sigma(2.0), seed)
        };
        let whole = Config {
            reference,
            ..Config::new(parameters, pair.width as u16, disparities)
        };
        let x = corners[0].index(pair.width);
        let y = corners[1].index(pair.height);
        let width = 1 + corners[2].index(pair.width - x);
        let height = 1 + corners[3].index(pair.height - y);
        let region = Region { x: x as u16, y: y as u32, width: width as u16, height: height as u32 };
        let cropped: Vec<i16> = pair
            .stream(&whole, Portable)
            .chunks(pair.width)
            .skip(y)
            .take(height)
            .flat_map(|line| line[x..x + width].to_vec())
            .collect();
        prop_assert_eq!(pair.stream(&Config { region, ..whole }, Portable), cropped);
    }
}

/// Every neuron uses its own offsets. Those here are chosen so that the patterns of one line can be
/// derived by hand.
#[test]
fn each_neuron_has_its_own_offsets() {
    // Even synapses sample the pixel `reach` columns to the right, odd ones the neuron's own pixel.
    // A cell of an even synapse is then 1 if the sampled pixel is greater than the neuron's own; in
    // a view that rises to the right, cells of odd synapses are 0.
    let (width, synapses) = (6_usize, 16);
    let offsets: Vec<[i8; 2]> = (0..width)
        .flat_map(|neuron| {
            let reach = if neuron == 2 { 1 } else { 0 };
            (0..synapses).map(move |r| [if r % 2 == 0 { reach } else { 0 }, 0])
        })
        .collect();
    let wiring = Wiring::PerNeuron {
        offsets: Synapses::from_stored(&offsets),
        synapses,
    };
    let mut memory: Vec<DisparityNeuron<u32, 1, CAPACITY>> = Vec::new();
    memory.resize_with(width, DisparityNeuron::new);
    let mut network = Network::new(&mut memory, width, wiring).unwrap();
    // The other view rises only from column 0 to column 1, the reference view everywhere.
    let other = [1, 2, 0, 0, 0, 0];
    let reference = [1, 2, 3, 4, 5, 6];
    let view = |pixels| GreyImage::new(pixels, width, 1).unwrap();
    network
        .train(&view(&other), DisparityRange::up_to(5), Reference::Left)
        .unwrap();
    let mut map = [0; 6];
    network
        .test::<Pcg32>(&view(&reference), Ties::Lowest, &mut map)
        .unwrap();
    // Only neuron 2 sees the rise, and finds it at column 0; to all others, the views are flat.
    assert_eq!(map, [0, 0, 2, 0, 0, 0]);
}

/// With random ties, the network recalls all neurons in turn with one generator.
#[test]
fn random_ties_of_the_network_are_even_and_reproducible() {
    let (width, height) = (8_usize, 500);
    let flat = vec![7; width * height];
    let view = GreyImage::new(&flat, width, height).unwrap();
    let mut memory: Vec<DisparityNeuron<u32, 1, CAPACITY>> = Vec::new();
    memory.resize_with(width * height, DisparityNeuron::new);
    let offsets = [[0; 2]; 16];
    let wiring = Wiring::Shared(Synapses::from_stored(&offsets));
    let mut network = Network::new(&mut memory, width, wiring).unwrap();
    network
        .train(&view, DisparityRange::up_to(3), Reference::Left)
        .unwrap();
    let test = |seed| {
        let mut generator = Pcg32::seed_from_u64(seed);
        let mut map = vec![0; width * height];
        let ties = Ties::Random(&mut generator);
        network.test(&view, ties, &mut map).unwrap();
        map
    };
    let map = test(1);
    assert_eq!(map, test(1));
    assert_ne!(map, test(2));
    // On a flat view, all disparities tie, and each of the four is equally likely.
    let inner = map.chunks(width).flat_map(|line| &line[3..]);
    let mut counts = [0_i32; 4];
    for &disparity_px in inner {
        counts[usize::try_from(disparity_px).unwrap()] += 1;
    }
    // Each count is binomial, with 2500 draws of p = 1/4: its standard deviation is 22.
    assert!(counts.iter().all(|n| (n - 625).abs() < 110), "{counts:?}");
}

/// Sizes at which mistakes are likely, tested always rather than by chance.
#[test]
fn extreme_sizes_equal_the_oracle() {
    for (width, height) in [
        (1, 1),
        (1, 9),
        (2, 1),
        (17, 1),
        (33, 2),
        (63, 3),
        (64, 3),
        (65, 3),
    ] {
        for reference in [Reference::Left, Reference::Right] {
            let pair = Pair::random(width, height, 9, 5);
            let parameters = Parameters {
                method: Method::Recall(RecallParameters {
                    candidates: 4,
                    vote_passes: 3,
                    median_reach_px: 2,
                    ..PLAIN
                }),
                ..plain(48, 4.0, Support::three_sigma(4.0), 11)
            };
            let disparities = DisparityRange::up_to(width as u16 - 1);
            let config = Config {
                reference,
                ..Config::new(parameters, width as u16, disparities)
            };
            let expected = oracle::recall::match_whole(&pair, &config);
            for kernels in NativeKernels::available() {
                let found = pair.stream(&config, kernels);
                assert_eq!(
                    found,
                    expected,
                    "{width}x{height}, {reference:?}, {}",
                    kernels.name()
                );
            }
        }
    }
}

/// The paper's method matches the luma of colour lines, which are pushed as they are.
#[test]
fn colour_is_matched_by_its_luma() {
    let parameters = Parameters {
        method: Method::Recall(RecallParameters {
            candidates: 4,
            vote_passes: 2,
            median_reach_px: 1,
            ..PLAIN
        }),
        ..plain(64, 2.0, Support::three_sigma(2.0), 3)
    };
    for format in PixelFormat::ALL {
        for width in [1, 2, 37] {
            let pair = Pair::random_in(format, width, 9, 256, 12);
            let luma = |view: &[u8]| {
                let mut grey = vec![0; view.len() / format.bytes_per_pixel()];
                luma_row(format, view, &mut grey);
                grey
            };
            let grey = Pair {
                format: PixelFormat::Grey8,
                left: luma(&pair.left),
                right: luma(&pair.right),
                ..pair.clone()
            };
            let config = Config::new(
                parameters,
                width as u16,
                DisparityRange::up_to(width as u16 - 1),
            );
            let expected = oracle::recall::match_whole(&grey, &config);
            let coloured = Config {
                colour: !format.is_grey(),
                ..config
            };
            for kernels in NativeKernels::available() {
                let map = pair.stream_with_confidences(&coloured, kernels);
                assert_eq!(map.disparities_q4, expected, "{format:?}, {width}");
                let sure = map
                    .disparities_q4
                    .iter()
                    .map(|&d| if d == INVALID { 0 } else { 255 });
                assert!(map.confidences.iter().copied().eq(sure));
            }
        }
    }
}

/// The longest pattern, and the whole range of distances.
#[test]
fn a_thousand_synapses_equal_the_oracle() {
    let pair = Pair::random(71, 2, 256, 3);
    let parameters = plain(1024, 10.0, Support::three_sigma(10.0), 2);
    let config = Config::new(parameters, 71, DisparityRange::up_to(69));
    let expected = oracle::recall::match_whole(&pair, &config);
    for kernels in NativeKernels::available() {
        assert_eq!(
            pair.stream(&config, kernels),
            expected,
            "{}",
            kernels.name()
        );
    }
}

/// A shifted texture has the disparity of its shift, for both references and also if it is
/// negative.
#[test]
fn a_shifted_texture_has_its_shift() {
    let (width, height, shift) = (96_usize, 24, 7_usize);
    let mut random = Pcg32::seed_from_u64(4);
    let strip: Vec<u8> = (0..(width + shift) * height)
        .map(|_| random.next_u32() as u8)
        .collect();
    let cut = |from: usize| -> Vec<u8> {
        let lines = strip.chunks_exact(width + shift);
        lines
            .flat_map(|line| line[from..from + width].to_vec())
            .collect()
    };
    let (near, far) = (cut(0), cut(shift));
    for (left, right, expected) in [(&near, &far, 7), (&far, &near, -7)] {
        let pair = Pair {
            format: PixelFormat::Grey8,
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
            let parameters = plain(128, 2.0, Support::three_sigma(2.0), 1);
            let config = Config {
                reference,
                ..Config::new(parameters, width as u16, range)
            };
            let map = pair.stream(&config, Portable);
            // Away from the sides, the match and all samples are within both views.
            for line in map.chunks_exact(width) {
                assert!(
                    line[20..width - 20].iter().all(|&d| d == expected * 16),
                    "{reference:?}"
                );
            }
        }
    }
}

/// Columns whose matches all lie outside the other view are `INVALID`, not 0.
#[test]
fn pixels_without_a_match_inside_are_invalid() {
    let pair = Pair::random(20, 5, 50, 8);
    for (reference, invalid) in [(Reference::Left, 0..6), (Reference::Right, 14..20)] {
        let range = DisparityRange {
            minimum_px: 6,
            count: 4,
        };
        let parameters = Parameters {
            method: Method::Recall(RecallParameters {
                candidates: 3,
                vote_passes: 2,
                median_reach_px: 1,
                ..PLAIN
            }),
            ..plain(32, 2.0, Support::three_sigma(2.0), 1)
        };
        let config = Config {
            reference,
            ..Config::new(parameters, 20, range)
        };
        for line in pair.stream(&config, Portable).chunks_exact(20) {
            for (x, &disparity_q4) in line.iter().enumerate() {
                assert_eq!(
                    disparity_q4 == INVALID,
                    invalid.contains(&x),
                    "{reference:?}, {x}"
                );
            }
        }
    }
}
