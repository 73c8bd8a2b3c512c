//! Tasks that break the bounds of a kernel: indices and lengths near the ends of their types, and
//! slices that are too short.
//!
//! The reference is safe code, so it returns or panics. Where it returns, a set must return the
//! same; where it panics, a set may do either, but never reach outside of a slice. Only the sets
//! that load and store without checks are tried: the others are safe code themselves, and differ
//! from the reference where rows are too short.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

use rand_pcg::Pcg32;
use vgstereo_core::kernel::{Kernels, LANES, MAX_TAP_ROWS, PixelFormat, Portable};
use vgstereo_kernels::cases::{
    AggregateCase, ArmsCase, Case, ChannelCase, ConvertCase, CostCase, LumaCase, MaskCase,
    Median9Case, OwnPlanes, PackCase, PathsCase, RecallCase, SelectCase, SmoothCase,
    WeightedMedianCase, below, generator,
};

use crate::Run;

/// Lengths and indices from 0 to the largest `usize`: each field of a task is set to each of them, and
/// each slice is shortened by as many elements.
const VALUES: [usize; 26] = {
    const HALF: usize = usize::MAX / 2;
    const LAST: usize = usize::MAX;
    [
        0,
        1,
        2,
        3,
        15,
        16,
        17,
        31,
        32,
        33,
        48,
        63,
        64,
        80,
        1 << 32,
        HALF,
        HALF + 1,
        HALF + 2,
        LAST - 64,
        LAST - 63,
        LAST - 32,
        LAST - 31,
        LAST - 16,
        LAST - 15,
        LAST - 1,
        LAST,
    ]
};

/// Number of tasks that each value is tried on.
const TASKS: u64 = 2;

type Change<C> = fn(&mut C, usize);

/// Tries every value in every change of random tasks.
fn spoil<C: Case>(make: &dyn Fn(&mut Pcg32) -> C, changes: &[(&str, Change<C>)], run: Run<'_, C>) {
    for seed in 0..TASKS {
        for &(name, change) in changes {
            for value in VALUES {
                let mut case = make(&mut generator(seed));
                change(&mut case, value);
                let Some(expected) = quietly(|| output(&case, &|case| case.run(Portable))) else {
                    #[cfg(unix)]
                    for side in crate::guarded::Side::ALL {
                        quietly(|| crate::guarded::output(&case, run, side));
                    }
                    continue;
                };
                let found = output(&case, run);
                assert_eq!(found, expected, "seed {seed}, {name} {value}");
                #[cfg(unix)]
                for side in crate::guarded::Side::ALL {
                    let found = crate::guarded::output(&case, run, side);
                    assert_eq!(found, expected, "seed {seed}, {name} {value}, {side:?}");
                }
            }
        }
    }
}

fn output<C: Case>(case: &C, run: Run<'_, C>) -> C::Output {
    let mut case = case.clone();
    run(&mut case);
    case.output()
}

/// Returns what `body` returns, or nothing, and prints nothing, if it panics.
fn quietly<T>(body: impl FnOnce() -> T) -> Option<T> {
    std::thread_local! {
        static QUIET: Cell<bool> = const { Cell::new(false) };
    }
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !QUIET.get() {
                usual(info);
            }
        }));
    });
    QUIET.set(true);
    let result = panic::catch_unwind(AssertUnwindSafe(body));
    QUIET.set(false);
    result.ok()
}

/// Changes by name: of a field, which takes the value as it is, or of a slice, which becomes
/// shorter by it.
macro_rules! changes {
    ($Case:ty: $($how:ident $($field:tt).+ $([$index:literal])*),+ $(,)?) => {
        &[$((
            concat!(stringify!($how), " ", stringify!($($field).+) $(, "[", $index, "]")*),
            |case: &mut $Case, value| changes!(@ $how case.$($field).+ $([$index])*, value),
        )),+]
    };
    (@ set $field:expr, $value:ident) => { $field = $value as _ };
    // Loops run as often as these say, so that they cannot be as large as the rest.
    (@ count $field:expr, $value:ident) => { $field = $value % 1000 };
    (@ stride $planes:expr, $value:ident) => { set_stride(&mut $planes, $value) };
    (@ cut $slice:expr, $value:ident) => { shorten(&mut $slice, $value) };
}

fn shorten<T>(slice: &mut Vec<T>, by: usize) {
    slice.truncate(slice.len().saturating_sub(by));
}

fn set_stride(planes: &mut OwnPlanes, stride: usize) {
    planes.positions = stride.saturating_sub(LANES);
}

/// Every kernel of a set, each on tasks whose fields and slices are out of bounds in turn.
pub(crate) fn every_kernel(kernels: impl Kernels) {
    rows(kernels);
    patterns(kernels);
    costs(kernels);
    let aggregate = |random: &mut Pcg32| {
        let disparities = [5, 16, 30, 48, 64, 70][below(random, 6)];
        let width = 1 + below(random, 40);
        AggregateCase::random(random, width, disparities, 200)
    };
    spoil(
        &aggregate,
        changes!(AggregateCase: set stride, set disparities, cut costs, cut from_right,
            cut from_above, cut p2_along, cut p2_down, cut paths, cut sums, cut other_best, cut best,
            cut refined_index_q4, cut margins),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| PathsCase(aggregate(random)),
        changes!(PathsCase: set 0.stride, set 0.disparities, cut 0.costs, cut 0.from_right,
            cut 0.from_above, cut 0.p2_along, cut 0.p2_down, cut 0.paths),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| {
            let disparities = [5, 16, 30, 48, 64, 70][below(random, 6)];
            SelectCase::random(random, 20, disparities, 200)
        },
        changes!(SelectCase: set 0.stride, set 0.disparities, cut 0.costs, cut 0.from_right,
            cut 0.from_above, cut 0.sums, cut 0.other_best, cut 0.best, cut 0.refined_index_q4,
            cut 0.margins),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| {
            let (width, reach) = (40 + below(random, 60), below(random, 8));
            let (rows, channels) = (1 + below(random, MAX_TAP_ROWS), [1, 3][below(random, 2)]);
            WeightedMedianCase::random(random, width, reach, rows, channels)
        },
        changes!(WeightedMedianCase: set rows, set centre, set window_width, cut values,
            cut values[0], cut levels, cut levels[0], cut levels[0][0], cut centres, cut centres[0],
            cut places, cut output),
        &|case| case.run(kernels),
    );
}

/// Kernels of single rows.
fn rows(kernels: impl Kernels) {
    spoil(
        &|random| {
            let format = PixelFormat::ALL[below(random, PixelFormat::ALL.len())];
            LumaCase::random(random, format, 70, 70)
        },
        changes!(LumaCase: cut line, cut grey),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| ChannelCase::random(random, PixelFormat::Rgb888, 70, 70),
        changes!(ChannelCase: set channel, cut line, cut row),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| ConvertCase::random(random, 70),
        changes!(ConvertCase: cut levels, cut low, cut high),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| SmoothCase::random(random, 70, 0),
        changes!(SmoothCase: cut rows[0], cut rows[1], cut rows[2], cut smoothed),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| Median9Case::random(random, 70),
        changes!(Median9Case: cut rows[0], cut rows[1], cut rows[2], cut output),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| {
            let channels = [1, 3][below(random, 2)];
            ArmsCase::random(random, 70, 9, channels)
        },
        changes!(ArmsCase: cut levels, cut levels[0], cut scratch, cut arms),
        &|case| case.run(kernels),
    );
}

/// Kernels that make patterns, or compare them alone.
fn patterns(kernels: impl Kernels) {
    spoil(
        &|random| PackCase::random(random, 70),
        changes!(PackCase: cut samples[0], cut samples[8], cut packed),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| RecallCase::random(random, 20, 30, 4),
        changes!(RecallCase: count inputs.positions,
            set stored.positions, set first, set disparities, cut inputs.bytes, cut stored.bytes,
            cut distances, cut candidates_px),
        &|case| case.run(kernels),
    );
    spoil(
        &|random| {
            let (bytes, channels) = ([1, 8, 16][below(random, 3)], [1, 3][below(random, 2)]);
            MaskCase::random(random, 32, bytes, channels)
        },
        changes!(MaskCase: set centre, set first, set starts[0], count lanes, cut levels,
            cut levels[0], cut starts, cut cells, cut masks),
        &|case| case.run(kernels),
    );
}

fn costs(kernels: impl Kernels) {
    spoil(
        &|random| {
            let disparities = [5, 16, 30, 40, 64, 70, 128][below(random, 7)];
            let (bytes, channels) = ([4, 6, 8, 16][below(random, 4)], [1, 3][below(random, 2)]);
            let width = 1 + below(random, 70);
            CostCase::random(random, width, disparities, bytes, channels)
        },
        changes!(CostCase: set start, set first_position, set disparities, stride inputs,
            stride stored, count inputs.count, count stored.count, cut inputs.bytes,
            cut stored.bytes, cut cell_costs_q8, cut truncations, cut levels, cut levels[0], cut other_low,
            cut other_low[0], cut other_high, cut other_high[0], cut costs),
        &|case| case.run(kernels),
    );
}
