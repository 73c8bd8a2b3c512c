//! The core's inner loops, per kernel set: pattern sampling and recall of a row.
//!
//! `cargo bench --bench kernels`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matching::{LANES, RowRecall, TieBreak};
use vgstereo_core::memory::Arena;
use vgstereo_core::minchinton::PatternRow;
use vgstereo_core::strip::{Order, Strip};
use vgstereo_core::synapse::{Support, Synapses};
use vgstereo_sim::kernels::HostKernels;

const WIDTH: usize = 450;
const DISPARITIES: usize = 60;
const SIGMA_PX: f32 = 4.0;

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
    row.observe(strip, synapses, 12, 0, WIDTH, &kernels);
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
                        bencher.iter(|| row.observe(strip, synapses, 12, 0, WIDTH, &kernels));
                    });
                });
            });
        }
    }
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

criterion_group!(benches, sampling, recall);
criterion_main!(benches);
