//! Comparison of every kernel of every set with the reference, on random tasks.
//!
//! A failure prints the smallest failing task that was found: its sizes, and the seed of its
//! values. `PROPTEST_CASES` sets the number of tasks for each kernel of each set.
//!
//! On Unix, every task is also run with its buffers against pages that cannot be accessed, and
//! tasks that break the bounds of a kernel are run likewise.

mod bounds;
#[cfg(unix)]
mod guarded;

use libtest_mimic::{Arguments, Trial};
use proptest::prelude::*;
use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{
    AggregateRow, CostRun, Kernels, MASK_LANES, MAX_TAP_ROWS, PixelFormat, Portable,
    WeightedMedianRow, compact,
};
#[cfg(target_arch = "aarch64")]
use vgstereo_kernels::aarch64::Neon;
use vgstereo_kernels::cases::{
    AggregateCase, ArmsCase, AttenuateCase, Case, ChannelCase, CheckCase, ConvertCase, CostCase,
    LumaCase, MaskCase, Median9Case, PackCase, PathsCase, PenaltyCase, RecallCase, ResampleCase,
    RivalsCase, RowsCase, SelectCase, SmoothCase, WeightedMedianCase, generator,
};
#[cfg(target_arch = "x86_64")]
use vgstereo_kernels::x86_64::{Avx2, Avx512};
use vgstereo_kernels::{Armv7em, NativeKernels, Rv32, Rv32Bytes, Rv32Xpulp};

#[cfg(unix)]
#[global_allocator]
static ALLOCATOR: guarded::Guarded = guarded::Guarded;

/// Runs a case with the kernels of a set. All that knows the set is behind it, so that the rest is compiled once for all.
pub(crate) type Run<'a, C> = &'a dyn Fn(&mut C);

/// The tests of every kernel of a set, which is `None` where the processor cannot run it: then
/// they are listed as ignored.
macro_rules! suite {
    ($name:literal: $set:expr) => {
        suite!(@ $name: $set; luma_row, channel_row, resample_row, convert_row, smooth_row,
            pack_cells, recall_row, mask_block, cost_run, penalty_row, aggregate_paths, select_row,
            aggregate_row, whole_row, rivals_row, attenuate_row, check_row, arms_row, median9_row,
            weighted_median_row)
    };
    (@ $name:literal: $set:expr; $($kernel:ident),+) => {
        [$(trial(concat!($name, "::", stringify!($kernel)), $set, |set| $kernel(&|case| case.run(set))),)+]
    };
}

fn trial<K: Kernels + Send + 'static>(name: &str, set: Option<K>, test: fn(K)) -> Trial {
    let run = move || {
        let set = set.ok_or("the processor lacks the instructions")?;
        test(set);
        Ok(())
    };
    Trial::test(name, run).with_ignored_flag(set.is_none())
}

fn main() {
    let names = || {
        native_sets_are_named_from_the_slowest_on();
        Ok(())
    };
    let mut trials = vec![Trial::test(
        "native_sets_are_named_from_the_slowest_on",
        names,
    )];
    let overread = || {
        #[cfg(unix)]
        guarded::one_byte_beyond_a_buffer_ends_the_process();
        Ok(())
    };
    let overread = Trial::test("one_byte_beyond_a_buffer_ends_the_process", overread);
    trials.push(overread.with_ignored_flag(!cfg!(unix)));
    trials.extend(suite!("forwarded": Some(Forwarded(Portable))));
    trials.extend(suite!("compact": Some(Compact)));
    trials.extend(suite!("native": Some(NativeKernels::fastest())));
    trials.extend(suite!("armv7em": Some(Armv7em)));
    trials.extend(suite!("rv32": Some(Rv32)));
    trials.extend(suite!("rv32_bytes": Some(Rv32Bytes)));
    trials.extend(suite!("rv32_xpulp": Some(Rv32Xpulp)));
    #[cfg(target_arch = "x86_64")]
    {
        trials.extend(suite!("avx2": Avx2::detect()));
        trials.extend(suite!("avx512": Avx512::detect()));
        trials.push(trial(
            "avx2::out_of_bounds",
            Avx2::detect(),
            bounds::every_kernel,
        ));
        trials.push(trial(
            "avx512::out_of_bounds",
            Avx512::detect(),
            bounds::every_kernel,
        ));
    }
    #[cfg(target_arch = "aarch64")]
    {
        trials.extend(suite!("neon": Neon::detect()));
        trials.push(trial(
            "neon::out_of_bounds",
            Neon::detect(),
            bounds::every_kernel,
        ));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// A set that forwards every kernel to another set through a closure.
#[derive(Debug, Clone, Copy)]
struct Forwarded<K>(K);

impl<K: Kernels> Kernels for Forwarded<K> {
    const FUSES_SELECTION: bool = K::FUSES_SELECTION;

    forward_kernels!(set => &set.0, within |body| body(); luma_row,
        channel_row, resample_row, convert_row, smooth_row, pack_cells, recall_row, mask_block,
        cost_run, penalty_row, aggregate_paths, select_row, aggregate_row, rivals_row, attenuate_row, check_row,
        arms_row, median9_row, weighted_median_row);
}

/// The references in little code, which [`Armv7em`] takes with the feature `compact`.
#[derive(Debug, Clone, Copy)]
struct Compact;

impl Kernels for Compact {
    const FUSES_SELECTION: bool = false;

    forward_kernels!(set => &Portable; luma_row, channel_row, resample_row, convert_row, smooth_row, pack_cells,
        recall_row, mask_block, penalty_row, rivals_row, attenuate_row, check_row, arms_row, median9_row);

    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        compact::weighted_median_row(row, weights, output);
    }

    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        compact::cost_run(run, costs);
    }

    fn aggregate_paths(&self, row: &mut AggregateRow<'_>) {
        compact::aggregate_paths(row);
    }

    fn select_row(&self, row: &mut AggregateRow<'_>) {
        compact::select_row(row);
    }

    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }
}

/// The available sets are those that were detected, and the reference is the first.
fn native_sets_are_named_from_the_slowest_on() {
    let names: Vec<_> = NativeKernels::available()
        .map(NativeKernels::name)
        .collect();
    let mut expected = vec!["portable"];
    #[cfg(target_arch = "aarch64")]
    expected.extend(Neon::detect().map(|_| "neon"));
    #[cfg(target_arch = "x86_64")]
    {
        expected.extend(Avx2::detect().map(|_| "avx2"));
        expected.extend(Avx512::detect().map(|_| "avx512"));
    }
    assert_eq!(names, expected);
    assert_eq!(NativeKernels::fastest().name(), names[names.len() - 1]);
}

/// Runs a case with a set and with the reference, and compares their outputs. `case` keeps the
/// set's output.
fn is_alike<C: Case>(case: &mut C, run: Run<'_, C>) -> Result<(), TestCaseError> {
    let mut reference = case.clone();
    reference.run(Portable);
    #[cfg(unix)]
    for side in guarded::Side::ALL {
        let output = guarded::output(case, run, side);
        prop_assert_eq!(output, reference.output(), "guarded {:?}", side);
    }
    run(case);
    prop_assert_eq!(case.output(), reference.output());
    Ok(())
}

fn config() -> ProptestConfig {
    let default = ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    if std::env::var_os("PROPTEST_CASES").is_some() {
        return default;
    }
    ProptestConfig {
        cases: 400,
        ..default
    }
}

fn channels() -> impl Strategy<Value = usize> {
    prop_oneof![Just(1_usize), Just(3)]
}

fn formats() -> impl Strategy<Value = PixelFormat> {
    prop::sample::select(&PixelFormat::ALL[..])
}

/// Number of pixels of a line, and width of the output row; equal in half of the tasks.
fn line_widths() -> impl Strategy<Value = (usize, usize)> {
    let alike = (1_usize..150).prop_map(|width| (width, width));
    prop_oneof![alike, (0_usize..80, 1_usize..80)]
}

/// Numbers of disparities, often those that fill whole registers.
fn disparities() -> impl Strategy<Value = usize> {
    prop_oneof![1_usize..=64, 1_usize..=200, Just(64), Just(128), Just(256)]
}

fn largest_cost() -> impl Strategy<Value = u8> {
    prop_oneof![Just(0_u8), Just(255), any::<u8>()]
}

fn luma_row(run: Run<'_, LumaCase>) {
    proptest!(config(), |(
        format in formats(), (pixels, width) in line_widths(), seed in any::<u64>(),
    )| {
        is_alike(&mut LumaCase::random(&mut generator(seed), format, pixels, width), run)?;
    });
}

fn channel_row(run: Run<'_, ChannelCase>) {
    proptest!(config(), |(
        format in formats(), (pixels, width) in line_widths(), seed in any::<u64>(),
    )| {
        is_alike(&mut ChannelCase::random(&mut generator(seed), format, pixels, width), run)?;
    });
}

fn resample_row(run: Run<'_, ResampleCase>) {
    proptest!(config(), |(
        pixels in 1_usize..200, width in 1_usize..200, lines in 1_usize..12, seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        is_alike(&mut ResampleCase::random(random, pixels, width, lines), run)?;
    });
}

fn convert_row(run: Run<'_, ConvertCase>) {
    proptest!(config(), |(width in 1_usize..80, seed in any::<u64>())| {
        is_alike(&mut ConvertCase::random(&mut generator(seed), width), run)?;
    });
}

fn penalty_row(run: Run<'_, PenaltyCase>) {
    proptest!(config(), |(width in 1_usize..80, seed in any::<u64>())| {
        is_alike(&mut PenaltyCase::random(&mut generator(seed), width), run)?;
    });
}

fn rivals_row(run: Run<'_, RivalsCase>) {
    proptest!(config(), |(
        width in 1_usize..150, disparities in 1_usize..70, seed in any::<u64>()
    )| {
        is_alike(&mut RivalsCase::random(&mut generator(seed), width, disparities), run)?;
    });
}

fn attenuate_row(run: Run<'_, AttenuateCase>) {
    proptest!(config(), |(
        width in 1_usize..60, disparities in 1_usize..70, seed in any::<u64>()
    )| {
        is_alike(&mut AttenuateCase::random(&mut generator(seed), width, disparities), run)?;
    });
}

fn check_row(run: Run<'_, CheckCase>) {
    proptest!(config(), |(width in 1_usize..80, seed in any::<u64>())| {
        is_alike(&mut CheckCase::random(&mut generator(seed), width), run)?;
    });
}

fn smooth_row(run: Run<'_, SmoothCase>) {
    let missing = prop_oneof![4 => Just(0_usize), 1 => 1_usize..=4];
    proptest!(config(), |(width in 1_usize..150, missing in missing, seed in any::<u64>())| {
        let mut case = SmoothCase::random(&mut generator(seed), width, missing);
        let before = case.output();
        is_alike(&mut case, run)?;
        if missing > 0 {
            prop_assert_eq!(case.output(), before);
        }
    });
}

fn pack_cells(run: Run<'_, PackCase>) {
    proptest!(config(), |(width in 1_usize..80, seed in any::<u64>())| {
        is_alike(&mut PackCase::random(&mut generator(seed), width), run)?;
    });
}

fn recall_row(run: Run<'_, RecallCase>) {
    let bytes = prop_oneof![1_usize..=8, 9_usize..=40, Just(128)];
    proptest!(config(), |(
        width in 1_usize..60, disparities in disparities(), bytes in bytes, seed in any::<u64>(),
    )| {
        let mut case = RecallCase::random(&mut generator(seed), width, disparities, bytes);
        is_alike(&mut case, run)?;
    });
}

fn mask_block(run: Run<'_, MaskCase>) {
    let lanes = prop_oneof![1..=MASK_LANES, Just(MASK_LANES)];
    let bytes = prop_oneof![1_usize..=16, Just(32), Just(64), Just(128)];
    proptest!(config(), |(
        lanes in lanes, bytes in bytes, channels in channels(), seed in any::<u64>(),
    )| {
        is_alike(&mut MaskCase::random(&mut generator(seed), lanes, bytes, channels), run)?;
    });
}

fn cost_run(run: Run<'_, CostCase>) {
    let width = prop_oneof![1_usize..40, 60_usize..=128];
    let bytes = prop_oneof![
        1_usize..=8,
        Just(4),
        Just(6),
        Just(8),
        Just(16),
        Just(24),
        Just(32),
        Just(64)
    ];
    proptest!(config(), |(
        width in width, disparities in disparities(), bytes in bytes, channels in channels(),
        seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        is_alike(&mut CostCase::random(random, width, disparities, bytes, channels), run)?;
    });
}

fn aggregate_paths(run: Run<'_, PathsCase>) {
    proptest!(config(), |(
        width in 1_usize..60, disparities in disparities(), cost_max in largest_cost(),
        seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        let mut case = PathsCase(AggregateCase::random(random, width, disparities, cost_max));
        for _ in 0..3 {
            is_alike(&mut case, run)?;
            case.0.next_row(random, cost_max);
        }
    });
}

fn select_row(run: Run<'_, SelectCase>) {
    proptest!(config(), |(
        width in 1_usize..60, disparities in disparities(), cost_max in largest_cost(),
        seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        is_alike(&mut SelectCase::random(random, width, disparities, cost_max), run)?;
    });
}

fn aggregate_row(run: Run<'_, AggregateCase>) {
    proptest!(config(), |(
        width in 1_usize..60, disparities in disparities(), cost_max in largest_cost(),
        seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        let mut case = AggregateCase::random(random, width, disparities, cost_max);
        for _ in 0..3 {
            is_alike(&mut case, run)?;
            case.next_row(random, cost_max);
        }
    });
}

/// Costs, rivals, paths and selection, one after another.
fn whole_row(run: Run<'_, RowsCase>) {
    let width = prop_oneof![4 => 1_usize..60, 1 => 120_usize..=160];
    let bytes = prop_oneof![Just(4_usize), Just(6), Just(16)];
    proptest!(config(), |(
        width in width, disparities in disparities(), bytes in bytes, seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        is_alike(&mut RowsCase::random(random, width, 3, disparities, bytes), run)?;
    });
}

fn arms_row(run: Run<'_, ArmsCase>) {
    proptest!(config(), |(
        width in 1_usize..200, reach in 0_u8..=127, channels in channels(), seed in any::<u64>(),
    )| {
        is_alike(&mut ArmsCase::random(&mut generator(seed), width, reach, channels), run)?;
    });
}

fn median9_row(run: Run<'_, Median9Case>) {
    proptest!(config(), |(width in 1_usize..80, seed in any::<u64>())| {
        is_alike(&mut Median9Case::random(&mut generator(seed), width), run)?;
    });
}

fn weighted_median_row(run: Run<'_, WeightedMedianCase>) {
    let width = prop_oneof![1_usize..80, Just(16), Just(32), Just(64)];
    let window = prop_oneof![
        (0_usize..=12, 1_usize..=MAX_TAP_ROWS),
        Just((30, MAX_TAP_ROWS))
    ];
    proptest!(config(), |(
        width in width, (reach_x, rows) in window, channels in channels(), seed in any::<u64>(),
    )| {
        let random = &mut generator(seed);
        is_alike(&mut WeightedMedianCase::random(random, width, reach_x, rows, channels), run)?;
    });
}
