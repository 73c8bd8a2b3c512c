//! Every kernel set against the portable one, kernel by kernel, on random rows: values at
//! the ends of their ranges and of the row come up far more often than through images.

use proptest::prelude::*;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::aggregation::{AggregateRow, path_scratch_bytes};
use vgstereo_core::kernel::{Kernels, Portable};
use vgstereo_core::matching::{NO_COST, cost_stride};
use vgstereo_sim::kernels::HostKernels;

/// Below `bound`, which is at least 1.
fn below(random: &mut Pcg32, bound: usize) -> usize {
    random.next_u32() as usize % bound
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
            costs: &costs,
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
    }
}
