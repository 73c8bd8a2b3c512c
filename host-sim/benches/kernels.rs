//! The core's inner loops, per kernel set, on rows of noise; and the stages of the refinement
//! that have no kernels.
//!
//! `cargo bench --bench kernels`

use std::num::NonZeroU8;

use criterion::measurement::WallTime;
use criterion::{
    BatchSize, BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main,
};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::aggregation::{AggregateRow, path_scratch_bytes};
use vgstereo_core::config::SpeckleParameters;
use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matching::{
    CostRun, LANES, MASK_LANES, MAX_CHANNELS, MaskBlock, RowRecall, TieBreak, cost_stride,
};
use vgstereo_core::memory::Arena;
use vgstereo_core::minchinton::{CELLS_PER_BYTE, PatternRow, Planes};
use vgstereo_core::refine::{ArmsRow, Speckle, WeightedMedianRow, arms_scratch_bytes, fill_row};
use vgstereo_core::strip::{Order, Strip};
use vgstereo_core::synapse::{Offset, Support, Synapses};
use vgstereo_sim::kernels::HostKernels;

const WIDTH: usize = 450;
const DISPARITIES: usize = 60;
const SIGMA_PX: f32 = 4.0;
/// A line with as many below it as the synapses see.
const LINE: u32 = 12;

/// Calls `measure` with a strip full of noise and offsets for `count` synapses.
fn with_strip(count: usize, measure: impl FnOnce(&Strip<'_>, &Synapses<'_>)) {
    let mut random = Pcg32::seed_from_u64(1);
    let support = Support::three_sigma(SIGMA_PX);
    let mut stored = vec![[0; 2]; count];
    let synapses = Synapses::draw(&mut stored, SIGMA_PX, support, &mut random).unwrap();
    let (padding, depth) = (support.x_px.into(), Strip::depth(support));
    let mut memory = vec![0; Strip::memory_words(WIDTH, padding, depth)];
    let mut arena = Arena::new(&mut memory);
    let mut strip = Strip::new(WIDTH, padding, depth, Order::Columns, &mut arena).unwrap();
    for _ in 0..depth {
        let line: Vec<u8> = (0..WIDTH).map(|_| random.next_u32() as u8).collect();
        strip.push(&line);
    }
    measure(&strip, &synapses);
}

fn observed(
    strip: &Strip<'_>,
    synapses: &Synapses<'_>,
    kernels: HostKernels,
    measure: impl FnOnce(&mut PatternRow<'_>),
) {
    let bytes = PatternRow::bytes(WIDTH, synapses.len());
    let mut memory = vec![0; bytes.div_ceil(4)];
    let mut row = PatternRow::new(WIDTH, synapses.len(), &mut Arena::new(&mut memory)).unwrap();
    row.observe([strip; 2], synapses, LINE, 0, WIDTH, &kernels);
    measure(&mut row);
}

fn sampling(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sampling");
    for count in [32, 256] {
        // One element is one cell of one pixel.
        group.throughput(Throughput::Elements((WIDTH * count) as u64));
        for kernels in HostKernels::available() {
            with_strip(count, |strip, synapses| {
                observed(strip, synapses, kernels, |row| {
                    group.bench_function(BenchmarkId::new(kernels.name(), count), |bencher| {
                        bencher
                            .iter(|| row.observe([strip; 2], synapses, LINE, 0, WIDTH, &kernels));
                    });
                });
            });
        }
    }
}

fn smoothing(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("smooth_row");
    // One element is one pixel.
    group.throughput(Throughput::Elements(WIDTH as u64));
    let rows = [1, 2, 3].map(|seed| noise(WIDTH + 2, 12, seed));
    let rows = rows.each_ref().map(Vec::as_slice);
    let mut smoothed = vec![0; WIDTH];
    per_set(&mut group, 5, |kernels| {
        kernels.smooth_row(rows, 5, &mut smoothed);
    });
    group.finish();
}

fn recall(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("recall");
    // One element is one pixel at one disparity.
    group.throughput(Throughput::Elements((WIDTH * DISPARITIES) as u64));
    for count in [32, 64, 256] {
        for kernels in HostKernels::available() {
            with_strip(count, |strip, synapses| {
                observed(strip, synapses, kernels, |row| {
                    let task = RowRecall {
                        inputs: row.planes(),
                        count: WIDTH,
                        stored: row.planes(),
                        stored_count: WIDTH,
                        first: WIDTH as isize - 1,
                        step: -1,
                        minimum_px: 0,
                        disparities: DISPARITIES,
                        candidates: 1,
                        ties: TieBreak::Lowest,
                        line: 0,
                        column: 0,
                    };
                    let mut distances = vec![0; DISPARITIES.next_multiple_of(LANES)];
                    let mut recalled = vec![0; WIDTH];
                    group.bench_function(BenchmarkId::new(kernels.name(), count), |bencher| {
                        bencher.iter(|| kernels.recall_row(&task, &mut distances, &mut recalled));
                    });
                });
            });
        }
    }
}

/// Numbers from 0 up to `bound`.
fn noise(count: usize, bound: u32, seed: u64) -> Vec<u8> {
    let mut random = Pcg32::seed_from_u64(seed);
    (0..count)
        .map(|_| (random.next_u32() % bound) as u8)
        .collect()
}

/// Runs `kernel` with every kernel set.
fn per_set(
    group: &mut BenchmarkGroup<'_, WallTime>,
    parameter: usize,
    mut kernel: impl FnMut(HostKernels),
) {
    for kernels in HostKernels::available() {
        group.bench_function(BenchmarkId::new(kernels.name(), parameter), |bencher| {
            bencher.iter(|| kernel(kernels));
        });
    }
}

fn masks(criterion: &mut Criterion) {
    for count in [64, 256] {
        with_strip(count, |strip, synapses| {
            let window = strip.window(LINE);
            let start = |offset| {
                window
                    .start(offset, 0, MASK_LANES)
                    .expect("within the strip")
            };
            let starts: Vec<u32> = synapses.iter().map(|o| start(o) as u32).collect();
            let mut cells = vec![0; count * MASK_LANES];
            let mut masks = vec![0; count / CELLS_PER_BYTE * MASK_LANES];
            let mut group = criterion.benchmark_group("mask_block");
            // One element is one cell of one pixel.
            group.throughput(Throughput::Elements((count * MASK_LANES) as u64));
            per_set(&mut group, count, |kernels| {
                kernels.mask_block(&mut MaskBlock {
                    levels: [strip.pixels(); MAX_CHANNELS],
                    channels: MAX_CHANNELS,
                    centre: start(Offset { dx: 0, dy: 0 }) + MASK_LANES,
                    starts: &starts,
                    first: MASK_LANES,
                    lanes: MASK_LANES,
                    kept: (count * 2 / 5) as u16,
                    floor: 20,
                    step: NonZeroU8::new(24).expect("not zero"),
                    cells: &mut cells,
                    masks: &mut masks,
                    counts: [0; MASK_LANES],
                });
            });
        });
    }
}

fn costs(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cost_run");
    // One element is one pixel at one disparity.
    group.throughput(Throughput::Elements((MASK_LANES * DISPARITIES) as u64));
    for count in [32, 64, 256] {
        with_strip(count, |strip, synapses| {
            observed(strip, synapses, HostKernels::fastest(), |inputs| {
                let positions = WIDTH + cost_stride(DISPARITIES);
                let mut memory = vec![0; PatternRow::bytes(positions, count).div_ceil(4)];
                let mut arena = Arena::new(&mut memory);
                let mut stored = PatternRow::new(positions, count, &mut arena).unwrap();
                stored.observe(
                    [strip; 2],
                    synapses,
                    LINE,
                    0,
                    WIDTH,
                    &HostKernels::fastest(),
                );
                stored.extend(WIDTH, 0, positions);
                let masks = noise(count / CELLS_PER_BYTE * MASK_LANES, 256, 2);
                let (levels, other) = (noise(WIDTH, 256, 3), noise(positions, 256, 4));
                let run = CostRun {
                    start: 0,
                    inputs: inputs.planes(),
                    masks: Planes {
                        bytes: &masks,
                        stride: MASK_LANES,
                        count: count / CELLS_PER_BYTE,
                    },
                    cell_costs_q8: &[(96 * 256 * 2 / count) as u16; MASK_LANES],
                    stored: stored.planes(),
                    first_position: WIDTH - 1,
                    disparities: DISPARITIES,
                    hamming_truncation: 32,
                    levels: [&levels; MAX_CHANNELS],
                    other_low: [&other; MAX_CHANNELS],
                    other_high: [&other; MAX_CHANNELS],
                    channels: MAX_CHANNELS,
                    difference_truncation: 30,
                    difference_weight_q4: 24,
                };
                let mut costs = vec![0; MASK_LANES * cost_stride(DISPARITIES)];
                per_set(&mut group, count, |kernels| {
                    kernels.cost_run(&run, &mut costs)
                });
            });
        });
    }
}

fn aggregation(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("aggregate_row");
    for disparities in [32, DISPARITIES, 128] {
        // One element is one pixel at one disparity.
        group.throughput(Throughput::Elements((WIDTH * disparities) as u64));
        let stride = cost_stride(disparities);
        let mut costs = noise(WIDTH * stride, 80, 5);
        let p2: Vec<u8> = noise(WIDTH, 60, 6).iter().map(|p2| p2 + 40).collect();
        let mut from_right = vec![0; WIDTH * stride];
        let mut from_above = costs.clone();
        let mut paths = vec![0; path_scratch_bytes(stride)];
        let (mut sums, mut other_best) = (vec![0; stride], vec![0; WIDTH + stride]);
        let (mut best, mut refined_q4, mut margins) =
            (vec![0; WIDTH], vec![0; WIDTH], vec![0; WIDTH]);
        per_set(&mut group, disparities, |kernels| {
            kernels.aggregate_row(&mut AggregateRow {
                costs: &mut costs,
                from_right: &mut from_right,
                from_above: &mut from_above,
                stride,
                disparities,
                is_first: false,
                p1: 16,
                p2_along: &p2,
                p2_down: &p2,
                paths: &mut paths,
                sums: &mut sums,
                other_best: &mut other_best,
                best: &mut best,
                refined_q4: &mut refined_q4,
                margins: &mut margins,
            });
        });
    }
}

/// A row of disparities, a gap in every ten pixels, speckles among them.
fn found_row() -> Vec<i16> {
    let noise = noise(WIDTH, 100, 7);
    let found = |(x, noise): (usize, u8)| match noise {
        0..10 => INVALID,
        10..15 => 900,
        _ => (x / 50 * 64) as i16,
    };
    (0..WIDTH).zip(noise).map(found).collect()
}

fn refinement(criterion: &mut Criterion) {
    const REACH_X: usize = 16;
    const ROWS: usize = 3;
    // One element is one pixel.
    let elements = Throughput::Elements(WIDTH as u64);
    // Few levels: surfaces reach far and neighbours weigh.
    let levels = noise(WIDTH + 2 * REACH_X, 12, 8);

    let mut group = criterion.benchmark_group("arms_row");
    group.throughput(elements.clone());
    let arms_row = ArmsRow {
        levels: [&levels[..WIDTH]; MAX_CHANNELS],
        channels: MAX_CHANNELS,
        reach: 25,
        near_step: 30,
        far_step: 6,
    };
    let (mut scratch, mut arms) = (vec![0; arms_scratch_bytes(WIDTH)], vec![0; WIDTH]);
    per_set(&mut group, 25, |kernels| {
        kernels.arms_row(&arms_row, &mut scratch, &mut arms);
    });
    group.finish();

    let mut group = criterion.benchmark_group("weighted_median_row");
    group.throughput(elements.clone());
    let taps = (REACH_X + 1) * ROWS;
    let values: Vec<i16> = noise(WIDTH + 2 * REACH_X, 60, 9)
        .iter()
        .map(|&px| i16::from(px) * 16)
        .collect();
    let places = vec![10; taps];
    let mut row = WeightedMedianRow {
        values: [&[]; _],
        levels: [[&[]; _]; MAX_CHANNELS],
        centres: [&levels[REACH_X..REACH_X + WIDTH]; MAX_CHANNELS],
        rows: ROWS,
        centre: ROWS / 2,
        channels: MAX_CHANNELS,
        window_width: 2 * REACH_X + 1,
        places: &places,
        colour_reach: 48,
    };
    row.values[..ROWS].fill(&values);
    for channel in &mut row.levels {
        channel[..ROWS].fill(&levels);
    }
    let (mut weights, mut output) = (vec![0; 16 * taps], vec![0; WIDTH]);
    per_set(&mut group, taps, |kernels| {
        kernels.weighted_median_row(&row, &mut weights, &mut output);
    });
    group.finish();

    let mut group = criterion.benchmark_group("median9_row");
    group.throughput(elements.clone());
    per_set(&mut group, 9, |kernels| {
        kernels.median9_row([&values[..WIDTH + 2]; 3], &mut output);
    });
    group.finish();

    let mut group = criterion.benchmark_group("refinement");
    group.throughput(elements);
    let found = found_row();
    let parameters = SpeckleParameters {
        size_min: 8,
        step_q4: 32,
        reach_y_px: 2,
    };
    let mut memory = vec![0; Speckle::memory_words(WIDTH, parameters)];
    let mut speckle = Speckle::new(WIDTH, parameters, &mut Arena::new(&mut memory)).unwrap();
    let mut stage = |name: &str, stage: &mut dyn FnMut(&mut [i16])| {
        group.bench_function(name, |bencher| {
            bencher.iter_batched_ref(|| found.clone(), |row| stage(row), BatchSize::SmallInput);
        });
    };
    stage("speckle", &mut |row| {
        speckle.push(row);
    });
    stage("fill", &mut |row| fill_row(row));
}

criterion_group!(
    benches,
    sampling,
    smoothing,
    recall,
    masks,
    costs,
    aggregation,
    refinement
);
criterion_main!(benches);
