//! Every kernel set against the portable one, kernel by kernel, on random rows: values at
//! the ends of their ranges and of the row come up far more often than through images.

use std::num::NonZeroU8;

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_chip_kernels::Armv7em;
use vgstereo_core::aggregation::{AggregateRow, path_scratch_bytes};
use vgstereo_core::camera::PixelFormat;
use vgstereo_core::config::WeightedMedianParameters;
use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{Kernels, Portable};
use vgstereo_core::matching::{
    CostRun, LevelConversion, MASK_LANES, MAX_CHANNELS, MaskBlock, NO_COST, cost_stride,
};
use vgstereo_core::minchinton::{CELLS_PER_BYTE, PatternRow, Planes};
use vgstereo_core::refine::{ArmsRow, WeightedMedianRow, arms_scratch_bytes};
use vgstereo_sim::kernels::HostKernels;

/// Below `bound`, which is at least 1.
fn below(random: &mut Pcg32, bound: usize) -> usize {
    random.next_u32() as usize % bound
}

/// Bytes from `low` on, with few levels at times, so that many are equal.
fn levels(random: &mut Pcg32, count: usize) -> Vec<u8> {
    let low = below(random, 256);
    let most = [2, 20, 256][below(random, 3)].min(256 - low);
    let levels = 1 + below(random, most);
    (0..count)
        .map(|_| (low + below(random, levels)) as u8)
        .collect()
}

/// The rows of up to three channels.
fn channel_rows(rows: &[Vec<u8>]) -> [&[u8]; MAX_CHANNELS] {
    let mut all = [&[][..]; MAX_CHANNELS];
    for (to, row) in all.iter_mut().zip(rows) {
        *to = row;
    }
    all
}

/// What an aggregated row gives, and its state for the next.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Aggregated {
    from_above: Vec<u8>,
    best: Vec<u16>,
    refined_q4: Vec<i16>,
    margins: Vec<i16>,
    other_best: Vec<u32>,
}

/// A few rows one after another; what is left in scratch is not compared.
fn aggregate(
    kernels: impl Kernels,
    (width, disparities, cost_max): (usize, usize, u8),
    seed: u64,
) -> Vec<Aggregated> {
    let mut random = Pcg32::seed_from_u64(seed);
    let stride = cost_stride(disparities);
    let mut from_above = vec![0; width * stride];
    let mut rows = Vec::new();
    for line in 0..3 {
        let mut costs = vec![NO_COST; width * stride];
        // Few levels at times, so that many are equal.
        let levels = 1 + below(&mut random, usize::from(cost_max) + 1);
        for pixel in costs.chunks_exact_mut(stride) {
            for cost in &mut pixel[..disparities] {
                *cost = below(&mut random, levels) as u8;
            }
        }
        let p2_max = usize::from(u8::MAX - cost_max);
        let p1 = below(&mut random, p2_max + 1);
        let mut penalties = || -> Vec<u8> {
            let penalty = |_| (p1 + below(&mut random, p2_max - p1 + 1)) as u8;
            (0..width).map(penalty).collect()
        };
        let (p2_along, p2_down) = (penalties(), penalties());
        let mut best = vec![u16::MAX; width];
        let (mut refined_q4, mut margins) = (vec![-1; width], vec![-1; width]);
        let mut other_best = vec![0; width + stride];
        kernels.aggregate_row(&mut AggregateRow {
            costs: &mut costs,
            from_right: &mut vec![1; width * stride],
            from_above: &mut from_above,
            stride,
            disparities,
            is_first: line == 0,
            p1: p1 as u8,
            p2_along: &p2_along,
            p2_down: &p2_down,
            paths: &mut vec![2; path_scratch_bytes(stride)],
            sums: &mut vec![3; stride],
            other_best: &mut other_best,
            best: &mut best,
            refined_q4: &mut refined_q4,
            margins: &mut margins,
        });
        other_best.truncate(width + disparities - 1);
        rows.push(Aggregated {
            from_above: from_above.clone(),
            best,
            refined_q4,
            margins,
            other_best,
        });
    }
    rows
}

/// What stands in a line of ones after it was smoothed.
fn smoothed(kernels: impl Kernels, rows: [&[u8]; 3], step_max: u8, width: usize) -> Vec<u8> {
    let mut smoothed = vec![1; width];
    kernels.smooth_row(rows, step_max, &mut smoothed);
    smoothed
}

/// Disparities: all values, a few neighbouring ones, or the ends of the range; some are
/// missing.
fn disparities_q4(random: &mut Pcg32, count: usize) -> Vec<i16> {
    let (kind, low, missing) = (below(random, 3), random.next_u32() as i16, below(random, 5));
    let mut disparity = || match kind {
        _ if below(random, 4) < missing => INVALID,
        0 => random.next_u32() as i16,
        1 => low.wrapping_add(below(random, 40) as i16),
        _ => [INVALID + 1, -1, 0, 1, i16::MAX - 1, i16::MAX][below(random, 6)],
    };
    (0..count).map(|_| disparity()).collect()
}

fn weighted_median(
    kernels: impl Kernels,
    (width, reach_x, rows, channels): (usize, usize, usize, usize),
    seed: u64,
) -> Vec<i16> {
    let mut random = Pcg32::seed_from_u64(seed);
    let padded = width + 2 * reach_x;
    let values: Vec<_> = (0..rows)
        .map(|_| disparities_q4(&mut random, padded))
        .collect();
    let planes: Vec<_> = (0..channels)
        .map(|_| levels(&mut random, rows * padded))
        .collect();
    let centre = below(&mut random, rows);
    let taps = rows * (reach_x + 1);
    let places: Vec<u8> = (0..taps)
        .map(|_| 1 + below(&mut random, 20) as u8)
        .collect();
    let mut row = WeightedMedianRow {
        values: [&[]; WeightedMedianParameters::MAX_ROWS],
        levels: [[&[]; WeightedMedianParameters::MAX_ROWS]; MAX_CHANNELS],
        centres: [&[]; MAX_CHANNELS],
        rows,
        centre,
        channels,
        window_width: 2 * reach_x + 1,
        places: &places,
        colour_reach: 4 + below(&mut random, 45) as u8,
    };
    for (to, values) in row.values.iter_mut().zip(&values) {
        *to = values;
    }
    for ((levels, centre_levels), plane) in row.levels.iter_mut().zip(&mut row.centres).zip(&planes)
    {
        for (to, line) in levels.iter_mut().zip(plane.chunks_exact(padded)) {
            *to = line;
        }
        *centre_levels = &levels[centre][reach_x..reach_x + width];
    }
    let mut output = vec![1; width];
    kernels.weighted_median_row(&row, &mut vec![2; 16 * taps], &mut output);
    output
}

fn arms(
    kernels: impl Kernels,
    (width, reach, channels): (usize, u8, usize),
    seed: u64,
) -> Vec<i16> {
    let mut random = Pcg32::seed_from_u64(seed);
    let planes: Vec<_> = (0..channels).map(|_| levels(&mut random, width)).collect();
    let row = ArmsRow {
        levels: channel_rows(&planes),
        channels,
        reach,
        near_step: random.next_u32() as u8,
        far_step: random.next_u32() as u8,
    };
    let mut arms = vec![-1; width];
    kernels.arms_row(&row, &mut vec![2; arms_scratch_bytes(width)], &mut arms);
    arms
}

/// Luma and channels of a line that may have another length than its rows.
fn taken_apart(
    kernels: impl Kernels,
    format: PixelFormat,
    (pixels, width): (usize, usize),
    seed: u64,
) -> [Vec<u8>; 1 + MAX_CHANNELS] {
    let random = &mut Pcg32::seed_from_u64(seed);
    let line = levels(random, pixels * format.bytes_per_pixel());
    let mut rows = [(); 1 + MAX_CHANNELS].map(|()| vec![1; width]);
    let [luma, channels @ ..] = &mut rows;
    kernels.luma_row(format, &line, luma);
    for (channel, row) in channels.iter_mut().enumerate() {
        kernels.channel_row(format, &line, channel, row);
    }
    rows
}

/// Masks, and the number of cells in each.
fn masks(
    kernels: impl Kernels,
    (lanes, bytes, channels): (usize, usize, usize),
    seed: u64,
) -> (Vec<u8>, Vec<u16>) {
    const PIXELS: usize = 300;
    let mut random = Pcg32::seed_from_u64(seed);
    let cells = bytes * CELLS_PER_BYTE;
    let planes: Vec<_> = (0..channels).map(|_| levels(&mut random, PIXELS)).collect();
    let mut channel_levels = [&[][..]; MAX_CHANNELS];
    for (levels, plane) in channel_levels.iter_mut().zip(&planes) {
        *levels = plane;
    }
    let first = below(&mut random, 100);
    let mut start = |first| below(&mut random, PIXELS - first - lanes + 1);
    let centre = start(0);
    let starts: Vec<_> = (0..cells).map(|_| start(first) as u32).collect();
    let mut masks = vec![1; bytes * lanes];
    let mut block = MaskBlock {
        levels: channel_levels,
        channels,
        centre,
        starts: &starts,
        first,
        lanes,
        kept: 1 + below(&mut random, cells) as u16,
        floor: random.next_u32() as u8,
        step: NonZeroU8::new(1 + below(&mut random, 255) as u8).unwrap(),
        cells: &mut vec![3; cells * lanes],
        masks: &mut masks,
        counts: [2; MASK_LANES],
    };
    // Low at times, as presets have them.
    if below(&mut random, 2) > 0 {
        block.floor /= 8;
        block.step = NonZeroU8::new(1 + block.step.get() / 8).unwrap();
    }
    kernels.mask_block(&mut block);
    let counts = block.counts[..lanes].to_vec();
    (masks, counts)
}

/// Packed cells, beyond the shortest row what was there.
fn cells(kernels: impl Kernels, width: usize, seed: u64) -> Vec<u8> {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut rows: Vec<_> = (0..=CELLS_PER_BYTE)
        .map(|_| levels(&mut random, width))
        .collect();
    if below(&mut random, 3) == 0 {
        let row = below(&mut random, rows.len());
        rows[row].truncate(below(&mut random, width));
    }
    let mut packed = vec![1; width];
    let samples = std::array::from_fn(|index| &rows[index][..]);
    kernels.pack_cells(&samples, &mut packed);
    packed
}

/// Levels less and more the dead zone.
fn converted(kernels: impl Kernels, width: usize, seed: u64) -> [Vec<u8>; 2] {
    let mut random = Pcg32::seed_from_u64(seed);
    let conversion = LevelConversion {
        gain_q12: (1 << 10) + below(&mut random, 15 << 10) as i32,
        offset_q12: below(&mut random, 1 << 22) as i32 - (1 << 21),
        dead_zone: (random.next_u32() as u8) >> below(&mut random, 8),
    };
    let mut levels = levels(&mut random, width);
    for end in [0, u8::MAX] {
        levels[below(&mut random, width)] = end;
    }
    let (mut low, mut high) = (vec![1; width], vec![2; width]);
    kernels.convert_row(&conversion, &levels, &mut low, &mut high);
    [low, high]
}

fn costs(
    kernels: impl Kernels,
    (width, disparities, bytes, channels): (usize, usize, usize, usize),
    seed: u64,
) -> Vec<u8> {
    let mut random = Pcg32::seed_from_u64(seed);
    let stride = cost_stride(disparities);
    let start = below(&mut random, 3);
    let spare = below(&mut random, 3);
    let first_position = width - 1 + spare;
    let positions = first_position + stride;
    let mut planes = |positions: usize| -> Vec<u8> {
        let bytes = bytes * (positions + PatternRow::SLACK);
        (0..bytes).map(|_| random.next_u32() as u8).collect()
    };
    let (inputs, masks, stored) = (planes(start + width), planes(width), planes(positions));
    let planes = |bytes, positions: usize, count| Planes {
        bytes,
        stride: positions + PatternRow::SLACK,
        count,
    };
    let cells = bytes * CELLS_PER_BYTE;
    // As bounded where they are made: see `CostRun::cell_costs_q8`.
    let cell_cost_max = ((1 << 16) - 129) / cells;
    // Often whole, as they are where all cells count.
    let whole = if below(&mut random, 2) == 0 {
        !0
    } else {
        !0xff
    };
    let cell_costs_q8: Vec<_> = (0..width)
        .map(|_| below(&mut random, cell_cost_max + 1) as u16 & whole)
        .collect();
    let masked = below(&mut random, 3) > 0;
    let mut rows = |count: usize| -> Vec<Vec<u8>> {
        (0..channels).map(|_| levels(&mut random, count)).collect()
    };
    let (own, other) = (rows(start + width), rows(positions + PatternRow::SLACK));
    let dead_zone = below(&mut random, 9) as u8;
    let moved = |change: fn(u8, u8) -> u8| -> Vec<Vec<u8>> {
        let row = |row: &Vec<u8>| row.iter().map(|&level| change(level, dead_zone)).collect();
        other.iter().map(row).collect()
    };
    let (low, high) = (moved(u8::saturating_sub), moved(u8::saturating_add));
    let hamming_truncation = (random.next_u32() as u8) >> below(&mut random, 4);
    let difference_truncation = (random.next_u32() as u8) >> below(&mut random, 5);
    // Both terms together fit 8 bits.
    let rest = usize::from(u8::MAX - hamming_truncation) * 16;
    let weight_max = rest / usize::from(difference_truncation.max(1));
    // Often without the levels.
    let weight_max = weight_max.min(255) * below(&mut random, 3).min(1);
    let run = CostRun {
        start,
        inputs: planes(&inputs, start + width, bytes),
        masks: if masked {
            planes(&masks, width, bytes)
        } else {
            Planes::NONE
        },
        cell_costs_q8: &cell_costs_q8,
        stored: planes(&stored, positions, bytes),
        first_position,
        disparities,
        hamming_truncation,
        levels: channel_rows(&own),
        other_low: channel_rows(&low),
        other_high: channel_rows(&high),
        channels,
        difference_truncation,
        // Often a multiple of a power of two.
        difference_weight_q4: (below(&mut random, weight_max + 1) as u8)
            & (u8::MAX << below(&mut random, 5)),
    };
    let mut costs = vec![1; width * stride];
    kernels.cost_run(&run, &mut costs);
    costs
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn aggregation_is_alike(
        width in 1_usize..60,
        disparities in prop_oneof![1_usize..=64, 1_usize..=200, Just(64), Just(128), Just(256)],
        cost_max in prop_oneof![Just(0_u8), Just(255), any::<u8>()],
        seed in any::<u64>(),
    ) {
        let size = (width, disparities, cost_max);
        let expected = aggregate(Portable, size, seed);
        for kernels in HostKernels::available() {
            let found = aggregate(kernels, size, seed);
            prop_assert!(found == expected, "{}", kernels.name());
        }
        prop_assert!(aggregate(Armv7em, size, seed) == expected, "Armv7em");
    }

    #[test]
    fn weighted_medians_are_alike(
        width in prop_oneof![1_usize..80, Just(16), Just(32), Just(64)],
        (reach_x, rows) in prop_oneof![(0_usize..=12, 1_usize..=WeightedMedianParameters::MAX_ROWS), Just((30, WeightedMedianParameters::MAX_ROWS))],
        channels in prop_oneof![Just(1_usize), Just(3)],
        seed in any::<u64>(),
    ) {
        let size = (width, reach_x, rows, channels);
        let expected = weighted_median(Portable, size, seed);
        for kernels in HostKernels::available() {
            let found = weighted_median(kernels, size, seed);
            prop_assert_eq!(&found, &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&weighted_median(Armv7em, size, seed), &expected, "Armv7em");
    }

    #[test]
    fn medians_of_nine_are_alike(width in 1_usize..80, seed in any::<u64>()) {
        let random = &mut Pcg32::seed_from_u64(seed);
        let rows = [(); 3].map(|()| disparities_q4(random, width + 2));
        let rows = rows.each_ref().map(Vec::as_slice);
        let mut expected = vec![1; width];
        Portable.median9_row(rows, &mut expected);
        for kernels in HostKernels::available() {
            let mut found = vec![2; width];
            kernels.median9_row(rows, &mut found);
            prop_assert_eq!(&found, &expected, "{}", kernels.name());
        }
        let mut found = vec![2; width];
        Armv7em.median9_row(rows, &mut found);
        prop_assert_eq!(&found, &expected, "Armv7em");
    }

    #[test]
    fn smoothed_lines_are_alike(
        width in 1_usize..150,
        missing in prop_oneof![4 => Just(0_usize), 1 => 1_usize..=4],
        step_max in any::<u8>(),
        seed in any::<u64>(),
    ) {
        let random = &mut Pcg32::seed_from_u64(seed);
        let rows = [(); 3].map(|()| levels(random, (width + 2).saturating_sub(missing)));
        let rows = rows.each_ref().map(Vec::as_slice);
        let expected = smoothed(Portable, rows, step_max, width);
        if missing > 0 {
            prop_assert_eq!(&expected, &vec![1; width]);
        }
        for kernels in HostKernels::available() {
            let found = smoothed(kernels, rows, step_max, width);
            prop_assert_eq!(&found, &expected, "{}", kernels.name());
        }
        let found = smoothed(Armv7em, rows, step_max, width);
        prop_assert_eq!(&found, &expected, "Armv7em");
    }

    #[test]
    fn arms_are_alike(
        width in 1_usize..200,
        reach in 0_u8..=127,
        channels in prop_oneof![Just(1_usize), Just(3)],
        seed in any::<u64>(),
    ) {
        let size = (width, reach, channels);
        let expected = arms(Portable, size, seed);
        for kernels in HostKernels::available() {
            prop_assert_eq!(&arms(kernels, size, seed), &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&arms(Armv7em, size, seed), &expected, "Armv7em");
    }

    #[test]
    fn masks_are_alike(
        lanes in prop_oneof![1..=MASK_LANES, Just(MASK_LANES)],
        bytes in prop_oneof![1_usize..=16, Just(32), Just(64), Just(128)],
        channels in prop_oneof![Just(1_usize), Just(3)],
        seed in any::<u64>(),
    ) {
        let size = (lanes, bytes, channels);
        let expected = masks(Portable, size, seed);
        for kernels in HostKernels::available() {
            prop_assert_eq!(&masks(kernels, size, seed), &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&masks(Armv7em, size, seed), &expected, "Armv7em");
    }

    #[test]
    fn cells_are_alike(width in 1_usize..80, seed in any::<u64>()) {
        let expected = cells(Portable, width, seed);
        for kernels in HostKernels::available() {
            prop_assert_eq!(&cells(kernels, width, seed), &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&cells(Armv7em, width, seed), &expected, "Armv7em");
    }

    #[test]
    fn lines_taken_apart_are_alike(
        format in prop::sample::select(&PixelFormat::ALL[..]),
        pixels in 0_usize..80,
        width in 1_usize..80,
        is_whole in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let size = (if is_whole { width } else { pixels }, width);
        let expected = taken_apart(Portable, format, size, seed);
        for kernels in HostKernels::available() {
            let found = taken_apart(kernels, format, size, seed);
            prop_assert_eq!(&found, &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&taken_apart(Armv7em, format, size, seed), &expected, "Armv7em");
    }

    #[test]
    fn conversions_are_alike(width in 1_usize..80, seed in any::<u64>()) {
        let expected = converted(Portable, width, seed);
        for kernels in HostKernels::available() {
            prop_assert_eq!(&converted(kernels, width, seed), &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&converted(Armv7em, width, seed), &expected, "Armv7em");
    }

    #[test]
    fn costs_are_alike(
        width in prop_oneof![1_usize..40, 60_usize..=128],
        disparities in prop_oneof![1_usize..=64, 1_usize..=200, Just(64), Just(128)],
        bytes in prop_oneof![1_usize..=8, Just(4), Just(6), Just(8), Just(16), Just(24), Just(32), Just(64)],
        channels in prop_oneof![Just(1_usize), Just(3)],
        seed in any::<u64>(),
    ) {
        let size = (width, disparities, bytes, channels);
        let expected = costs(Portable, size, seed);
        for kernels in HostKernels::available() {
            prop_assert_eq!(&costs(kernels, size, seed), &expected, "{}", kernels.name());
        }
        prop_assert_eq!(&costs(Armv7em, size, seed), &expected, "Armv7em");
    }
}
