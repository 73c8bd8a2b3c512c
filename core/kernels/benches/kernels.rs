//! Every kernel of every set that this processor can run, on rows of noise.
//!
//! `cargo bench -p vgstereo-kernels`

use std::num::NonZeroU8;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use vgstereo_core::kernel::{
    CELLS_PER_BYTE, LevelConversion, MASK_LANES, MAX_CHANNELS, PixelFormat, TieBreak,
};
use vgstereo_kernels::NativeKernels;
use vgstereo_kernels::cases::{
    AggregateCase, ArmsCase, AttenuateCase, Case, ChannelCase, CheckCase, ConvertCase, CostCase,
    LumaCase, MaskCase, Median9Case, OwnPlanes, PackCase, PathsCase, PenaltyCase, RecallCase,
    RivalsCase, SelectCase, SmoothCase, WeightedMedianCase, fill_costs, generator, levels_below,
};

const WIDTH: usize = 450;
const DISPARITIES: usize = 60;

/// Measures a case with every kernel set; `elements` are those that it has.
fn measure(
    criterion: &mut Criterion,
    kernel: &str,
    parameter: &str,
    elements: usize,
    case: &mut impl Case,
) {
    let mut group = criterion.benchmark_group(kernel);
    group.throughput(Throughput::Elements(elements as u64));
    for kernels in NativeKernels::available() {
        group.bench_function(BenchmarkId::new(kernels.name(), parameter), |bencher| {
            bencher.iter(|| case.run(kernels));
        });
    }
}

/// Elements are pixels.
fn unpacking(criterion: &mut Criterion) {
    let random = &mut generator(1);
    for format in PixelFormat::ALL {
        let name = format!("{format:?}");
        let mut case = LumaCase::random(random, format, WIDTH, WIDTH);
        measure(criterion, "luma_row", &name, WIDTH, &mut case);
        let mut case = ChannelCase::random(random, format, WIDTH, WIDTH);
        case.channel = 1;
        measure(criterion, "channel_row", &name, WIDTH, &mut case);
    }
}

/// Elements are pixels.
fn levels(criterion: &mut Criterion) {
    let random = &mut generator(2);
    let mut case = ConvertCase::random(random, WIDTH);
    case.conversion = LevelConversion {
        gain_q12: 5000,
        offset_q12: -20_000,
        dead_zone: 4,
    };
    measure(criterion, "convert_row", "450", WIDTH, &mut case);
    let mut case = SmoothCase::random(random, WIDTH, 0);
    case.rows = [(); 3].map(|()| levels_below(random, WIDTH + 2, 12));
    case.step_max = 5;
    measure(criterion, "smooth_row", "450", WIDTH, &mut case);
    let mut case = PenaltyCase::random(random, WIDTH);
    case.own = levels_below(random, WIDTH, 40);
    case.neighbours = levels_below(random, WIDTH, 40);
    measure(criterion, "penalty_row", "450", WIDTH, &mut case);
    let mut case = CheckCase::random(random, WIDTH);
    measure(criterion, "check_row", "450", WIDTH, &mut case);
    let mut case = RivalsCase::random(random, WIDTH, DISPARITIES);
    measure(criterion, "rivals_row", "450", WIDTH, &mut case);
    let mut case = AttenuateCase::random(random, WIDTH, DISPARITIES);
    (case.shift, case.doubts) = (2, vec![1; case.doubts.len()]);
    measure(criterion, "attenuate_row", "450", WIDTH, &mut case);
}

/// Elements are cells.
fn packing(criterion: &mut Criterion) {
    let random = &mut generator(3);
    let mut case = PackCase::random(random, WIDTH);
    case.samples = [(); _].map(|()| levels_below(random, WIDTH, 256));
    let cells = WIDTH * CELLS_PER_BYTE;
    measure(criterion, "pack_cells", "450", cells, &mut case);
}

/// Elements are disparities of pixels.
fn recall(criterion: &mut Criterion) {
    let random = &mut generator(4);
    for cells in [32, 64, 256] {
        let mut case = RecallCase::random(random, WIDTH, DISPARITIES, cells / CELLS_PER_BYTE);
        case.inputs = OwnPlanes::random(random, WIDTH, cells / CELLS_PER_BYTE);
        case.stored = case.inputs.clone();
        case.first = WIDTH as isize - 1;
        case.step = -1;
        case.minimum_px = 0;
        case.candidates = 1;
        case.candidates_px.truncate(WIDTH);
        case.ties = TieBreak::Lowest;
        let elements = WIDTH * DISPARITIES;
        measure(
            criterion,
            "recall_row",
            &cells.to_string(),
            elements,
            &mut case,
        );
    }
}

/// Elements are cells of pixels.
fn masks(criterion: &mut Criterion) {
    let random = &mut generator(5);
    for cells in [64, 256] {
        let bytes = cells / CELLS_PER_BYTE;
        let mut case = MaskCase::random(random, MASK_LANES, bytes, MAX_CHANNELS);
        case.levels = [(); MAX_CHANNELS]
            .map(|()| levels_below(random, 300, 256))
            .into();
        case.kept = (cells * 2 / 5) as u16;
        case.floor = 20;
        case.step = NonZeroU8::MIN.saturating_add(23);
        let elements = cells * MASK_LANES;
        measure(
            criterion,
            "mask_block",
            &cells.to_string(),
            elements,
            &mut case,
        );
    }
}

/// Elements are disparities of pixels.
fn costs(criterion: &mut Criterion) {
    let random = &mut generator(6);
    for cells in [32, 64, 256] {
        let bytes = cells / CELLS_PER_BYTE;
        let mut case = CostCase::random(random, MASK_LANES, DISPARITIES, bytes, MAX_CHANNELS);
        case.masks = Some(OwnPlanes::random(random, MASK_LANES, bytes));
        case.cell_costs_q8.fill((96 * 256 * 2 / cells) as u16);
        case.hamming_truncation = 32;
        case.truncations.fill(32);
        let positions = case.other_low[0].len();
        case.levels = [(); MAX_CHANNELS]
            .map(|()| levels_below(random, case.start + MASK_LANES, 256))
            .into();
        case.other_low = [(); MAX_CHANNELS]
            .map(|()| levels_below(random, positions, 256))
            .into();
        case.other_high.clone_from(&case.other_low);
        case.difference_truncation = 30;
        case.difference_weight_q4 = 24;
        let elements = MASK_LANES * DISPARITIES;
        measure(
            criterion,
            "cost_run",
            &cells.to_string(),
            elements,
            &mut case,
        );
    }
}

/// Elements are disparities of pixels.
fn aggregation(criterion: &mut Criterion) {
    let random = &mut generator(7);
    for disparities in [32, DISPARITIES, 128] {
        let mut row = AggregateCase::random(random, WIDTH, disparities, 80);
        let stride = row.stride;
        for costs in [&mut row.costs, &mut row.from_above] {
            fill_costs(random, costs, stride, disparities, 80);
        }
        row.is_first = false;
        row.p1 = 16;
        for p2 in row.p2_along.iter_mut().chain(&mut row.p2_down) {
            *p2 = 40 + *p2 % 60;
        }
        let name = disparities.to_string();
        let elements = WIDTH * disparities;
        measure(
            criterion,
            "aggregate_row",
            &name,
            elements,
            &mut row.clone(),
        );
        let mut case = PathsCase(row);
        measure(criterion, "aggregate_paths", &name, elements, &mut case);
        let mut case = SelectCase::random(random, WIDTH, disparities, 160);
        for paths in [
            &mut case.0.costs,
            &mut case.0.from_right,
            &mut case.0.from_above,
        ] {
            fill_costs(random, paths, stride, disparities, 160);
        }
        measure(criterion, "select_row", &name, elements, &mut case);
    }
}

/// Elements are pixels.
fn refinement(criterion: &mut Criterion) {
    const REACH_X: usize = 16;
    const ROWS: usize = 3;
    let random = &mut generator(8);

    // Few levels: surfaces reach far and neighbours weigh.
    let mut case = ArmsCase::random(random, WIDTH, 25, MAX_CHANNELS);
    case.levels = vec![levels_below(random, WIDTH, 12); MAX_CHANNELS];
    case.near_step = 30;
    case.far_step = 6;
    measure(criterion, "arms_row", "25", WIDTH, &mut case);

    let padded = WIDTH + 2 * REACH_X;
    let values: Vec<i16> = levels_below(random, padded, 60)
        .iter()
        .map(|&px| i16::from(px) * 16)
        .collect();
    let mut case = Median9Case::random(random, WIDTH);
    case.rows = [(); 3].map(|()| values[..WIDTH + 2].to_vec());
    measure(criterion, "median9_row", "9", WIDTH, &mut case);

    let mut case = WeightedMedianCase::random(random, WIDTH, REACH_X, ROWS, MAX_CHANNELS);
    case.values = vec![values; ROWS];
    case.levels = vec![vec![levels_below(random, padded, 12); ROWS]; MAX_CHANNELS];
    case.centre = ROWS / 2;
    case.places.fill(10);
    case.colour_reach = 48;
    let taps = case.places.len().to_string();
    measure(criterion, "weighted_median_row", &taps, WIDTH, &mut case);
}

criterion_group!(
    benches,
    unpacking,
    levels,
    packing,
    recall,
    masks,
    costs,
    aggregation,
    refinement
);
criterion_main!(benches);
