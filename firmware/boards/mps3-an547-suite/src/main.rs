//! Comparison of every kernel of the sets `Helium` and `Armv7em` with the reference, on random tasks, on the emulated
//! board: no host has the instructions of either. The tasks are those of the suite in `core/kernels/tests/suite`.
//!
//! Ends the emulation with an error that names the kernel and the seed of the first task in which they
//! differ. The kernels are built with debug assertions, which check that loads and stores stay in their
//! slices.
#![no_std]
#![no_main]

// Linked for its critical sections, which the heap needs.
use cortex_m as _;
use cortex_m_rt::entry;
use embedded_alloc::LlffHeap;
use rand_pcg::Pcg32;
use semihosting::{print, println, process};
use static_cell::ConstStaticCell;
use vgstereo_core::kernel::{MASK_LANES, MAX_TAP_ROWS, PixelFormat, Portable};
use vgstereo_kernels::cases::{
    AggregateCase, ArmsCase, AttenuateCase, Case, ChannelCase, CheckCase, ConvertCase, CostCase,
    LumaCase, MaskCase, Median9Case, PackCase, PathsCase, PenaltyCase, RecallCase, ResampleCase,
    RivalsCase, SelectCase, SmoothCase, WeightedMedianCase, below, byte, generator,
};
use vgstereo_kernels::{Armv7em, Helium};

/// Number of tasks of each kernel.
const TASKS: u64 = 200;

#[global_allocator]
static HEAP: LlffHeap = LlffHeap::empty();

static MEMORY: ConstStaticCell<[u8; 768 * 1024]> = ConstStaticCell::new([0; 768 * 1024]);

/// Compares a kernel with the reference on the tasks that `$case` makes of the random numbers `$random`.
macro_rules! compare {
    ($kernel:literal, |$random:ident| $case:expr) => {
        for seed in 0..TASKS {
            let $random = &mut generator(seed);
            is_alike($kernel, seed, &mut $case);
        }
        print!("{} ", $kernel);
    };
    // For three rows of a frame: `$next` makes the next row, given the largest cost of all, which bounds the penalties.
    ($kernel:literal, |$random:ident, $cost_max:ident| $case:expr, |$made:ident| $next:expr) => {
        for seed in 0..TASKS {
            let $random = &mut generator(seed);
            let $cost_max = largest_cost($random);
            let mut case = $case;
            for _ in 0..3 {
                is_alike($kernel, seed, &mut case);
                let $made = &mut case;
                $next;
            }
        }
        print!("{} ", $kernel);
    };
}

/// Asserts that the sets and the reference have the same output. `case` keeps that of one.
fn is_alike<C: Case>(kernel: &str, seed: u64, case: &mut C) {
    let mut reference = case.clone();
    reference.run(Portable);
    let expected = reference.output();
    drop(reference);
    let mut without_vectors = case.clone();
    without_vectors.run(Armv7em);
    let is_alike = without_vectors.output() == expected;
    assert!(
        is_alike,
        "{kernel} of Armv7em differs from the reference, seed {seed}"
    );
    drop(without_vectors);
    case.run(Helium);
    let is_alike = case.output() == expected;
    assert!(is_alike, "{kernel} differs from the reference, seed {seed}");
}

#[entry]
fn main() -> ! {
    let memory = MEMORY.take();
    // SAFETY: the memory is the heap's alone, and this is done once.
    unsafe { HEAP.init(memory.as_mut_ptr().addr(), memory.len()) };
    rows_of_pixels();
    patterns();
    paths();
    refinement();
    println!("equal the reference");
    process::exit(0)
}

/// A number of those from `first` to `last`.
fn within(random: &mut Pcg32, first: usize, last: usize) -> usize {
    first + below(random, last + 1 - first)
}

/// One of these numbers.
fn one_of(random: &mut Pcg32, numbers: &[usize]) -> usize {
    numbers[below(random, numbers.len())]
}

/// Numbers of disparities, often those that fill whole registers.
fn disparities(random: &mut Pcg32) -> usize {
    match below(random, 3) {
        0 => within(random, 1, 64),
        1 => within(random, 1, 200),
        _ => one_of(random, &[16, 32, 48, 60, 64, 128, 256]),
    }
}

fn largest_cost(random: &mut Pcg32) -> u8 {
    match below(random, 3) {
        0 => 0,
        1 => 255,
        _ => byte(random),
    }
}

fn channels(random: &mut Pcg32) -> usize {
    one_of(random, &[1, 3])
}

fn format(random: &mut Pcg32) -> PixelFormat {
    PixelFormat::ALL[below(random, PixelFormat::ALL.len())]
}

fn rows_of_pixels() {
    compare!("luma_row", |random| {
        let (format, pixels) = (format(random), within(random, 1, 149));
        LumaCase::random(random, format, pixels, pixels)
    });
    compare!("channel_row", |random| {
        let (format, pixels) = (format(random), within(random, 1, 149));
        ChannelCase::random(random, format, pixels, pixels)
    });
    compare!("resample_row", |random| {
        let (pixels, width) = (within(random, 1, 199), within(random, 1, 199));
        let lines = within(random, 1, 11);
        ResampleCase::random(random, pixels, width, lines)
    });
    compare!("convert_row", |random| {
        let width = within(random, 1, 79);
        ConvertCase::random(random, width)
    });
    compare!("smooth_row", |random| {
        let (width, missing) = (within(random, 1, 149), below(random, 10).saturating_sub(6));
        SmoothCase::random(random, width, missing)
    });
}

fn patterns() {
    compare!("pack_cells", |random| {
        let width = within(random, 1, 79);
        PackCase::random(random, width)
    });
    compare!("recall_row", |random| {
        let (width, disparities) = (within(random, 1, 59), disparities(random));
        let bytes = one_of(random, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 33, 128]);
        RecallCase::random(random, width, disparities, bytes)
    });
    compare!("mask_block", |random| {
        let lanes = [within(random, 1, MASK_LANES), MASK_LANES][below(random, 2)];
        let bytes = one_of(random, &[1, 2, 3, 4, 5, 6, 8, 12, 16, 32, 64, 128]);
        let channels = channels(random);
        MaskCase::random(random, lanes, bytes, channels)
    });
    compare!("cost_run", |random| {
        let (width, disparities) = (within(random, 1, 70), disparities(random));
        let bytes = one_of(
            random,
            &[1, 2, 3, 4, 5, 6, 7, 8, 16, 24, 31, 32, 33, 62, 63, 64, 128],
        );
        let channels = channels(random);
        CostCase::random(random, width, disparities, bytes, channels)
    });
}

fn paths() {
    compare!("penalty_row", |random| {
        let width = within(random, 1, 79);
        PenaltyCase::random(random, width)
    });
    compare!(
        "aggregate_paths",
        |random, cost_max| {
            let (width, disparities) = (within(random, 1, 59), disparities(random));
            PathsCase(AggregateCase::random(random, width, disparities, cost_max))
        },
        |case| case.0.next_row(random, cost_max)
    );
    compare!("select_row", |random| {
        let (width, disparities) = (within(random, 1, 59), disparities(random));
        let cost_max = largest_cost(random);
        SelectCase::random(random, width, disparities, cost_max)
    });
    compare!(
        "aggregate_row",
        |random, cost_max| {
            let (width, disparities) = (within(random, 1, 59), disparities(random));
            AggregateCase::random(random, width, disparities, cost_max)
        },
        |case| case.next_row(random, cost_max)
    );
    compare!("rivals_row", |random| {
        let (width, disparities) = (within(random, 1, 149), within(random, 1, 69));
        RivalsCase::random(random, width, disparities)
    });
    compare!("attenuate_row", |random| {
        let (width, disparities) = (within(random, 1, 59), within(random, 1, 69));
        AttenuateCase::random(random, width, disparities)
    });
    compare!("check_row", |random| {
        let width = within(random, 1, 79);
        CheckCase::random(random, width)
    });
}

fn refinement() {
    compare!("arms_row", |random| {
        let (width, reach) = (within(random, 1, 199), below(random, 128) as u8);
        let channels = channels(random);
        ArmsCase::random(random, width, reach, channels)
    });
    compare!("median9_row", |random| {
        let width = within(random, 1, 79);
        Median9Case::random(random, width)
    });
    compare!("weighted_median_row", |random| {
        let width = [within(random, 1, 79), one_of(random, &[16, 32, 64])][below(random, 2)];
        let window = [
            (below(random, 13), within(random, 1, MAX_TAP_ROWS)),
            (30, MAX_TAP_ROWS),
        ];
        let (reach_x, rows) = window[below(random, 2)];
        let channels = channels(random);
        WeightedMedianCase::random(random, width, reach_x, rows, channels)
    });
}
