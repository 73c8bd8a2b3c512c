//! Instructions per stage, read around every kernel.

use core::cell::Cell;

use vgstereo_core::aggregation::AggregateRow;
use vgstereo_core::camera::{ErrorType, Geometry, LinePair, LinePairSource, PixelFormat};
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matcher::DisparityLine;
use vgstereo_core::matching::{CostRun, LevelConversion, MaskBlock, RowRecall};
use vgstereo_core::minchinton::CELLS_PER_BYTE;
use vgstereo_core::refine::{ArmsRow, WeightedMedianRow};
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};

/// A counter that runs with the instructions.
pub trait Counter: Copy {
    /// Instructions of 64 ticks, at least 1.
    const INSTRUCTIONS_PER_64_TICKS: u32;

    /// Ticks so far; wraps.
    fn ticks(self) -> u32;
}

/// What instructions are spent on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Patterns of cells, from samples.
    Sampling,
    /// Cells that count.
    Masks,
    /// Matching costs: Hamming distances and differences of levels.
    Hamming,
    /// Path costs.
    Aggregation,
    /// Sums of paths; best disparities, sub-pixel steps and margins; the other view's best.
    Selection,
    /// Reach of surfaces, and medians.
    SurfacesAndMedians,
    /// All else of the matcher and the session: strips, levels, left-right and ambiguity
    /// checks, vote, fill.
    ChecksAndRest,
    /// The camera and the sink; no part of the method.
    Files,
}

impl Stage {
    /// All stages, in the order of their discriminants.
    pub const ALL: [Self; 8] = [
        Self::Sampling,
        Self::Masks,
        Self::Hamming,
        Self::Aggregation,
        Self::Selection,
        Self::SurfacesAndMedians,
        Self::ChecksAndRest,
        Self::Files,
    ];

    /// The name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sampling => "sampling",
            Self::Masks => "masks",
            Self::Hamming => "hamming",
            Self::Aggregation => "aggregation",
            Self::Selection => "selection",
            Self::SurfacesAndMedians => "surfaces_and_medians",
            Self::ChecksAndRest => "checks_and_rest",
            Self::Files => "files",
        }
    }
}

/// A number of each stage, in the order of [`Stage::ALL`].
pub type PerStage<T> = [T; Stage::ALL.len()];

/// Ticks of each stage.
#[derive(Debug)]
pub struct Meter<C> {
    counter: C,
    ticks: PerStage<Cell<u64>>,
}

impl<C: Counter> Meter<C> {
    /// A meter at zero.
    #[must_use]
    pub const fn new(counter: C) -> Self {
        Self {
            counter,
            ticks: [const { Cell::new(0) }; Stage::ALL.len()],
        }
    }

    /// Calls `body`; its ticks go to `stage`, but for those that go to another within it.
    /// A call may last 2^32 ticks.
    #[inline(always)]
    pub fn measure<R>(&self, stage: Stage, body: impl FnOnce() -> R) -> R {
        let inner_before = self.sum();
        let before = self.counter.ticks();
        let result = body();
        let ticks = self.counter.ticks().wrapping_sub(before);
        let inner = self.sum().wrapping_sub(inner_before);
        self.add(stage, u64::from(ticks).wrapping_sub(inner));
        result
    }

    /// Calls `body`, within which nothing else is measured.
    #[inline(always)]
    fn measure_innermost<R>(&self, stage: Stage, body: impl FnOnce() -> R) -> R {
        let before = self.counter.ticks();
        let result = body();
        self.add(stage, self.counter.ticks().wrapping_sub(before).into());
        result
    }

    /// Instructions of each stage so far.
    #[must_use]
    pub fn instructions(&self) -> PerStage<u64> {
        let rate = u64::from(C::INSTRUCTIONS_PER_64_TICKS);
        self.ticks
            .each_ref()
            .map(|ticks| ticks.get().wrapping_mul(rate) >> 6)
    }

    fn sum(&self) -> u64 {
        let ticks = self.ticks.iter().map(Cell::get);
        ticks.fold(0, u64::wrapping_add)
    }

    fn add(&self, stage: Stage, ticks: u64) {
        if let Some(sum) = self.ticks.get(stage as usize) {
            sum.set(sum.get().wrapping_add(ticks));
        }
    }
}

/// A kernel set, camera or sink whose every call is measured.
#[derive(Debug)]
pub struct Metered<'m, T, C> {
    inner: T,
    meter: &'m Meter<C>,
}

impl<'m, T, C> Metered<'m, T, C> {
    /// Wraps it.
    #[must_use]
    pub const fn new(inner: T, meter: &'m Meter<C>) -> Self {
        Self { inner, meter }
    }

    /// What is wrapped.
    #[must_use]
    pub fn into_inner(self) -> T {
        self.inner
    }
}

impl<T: Clone, C> Clone for Metered<'_, T, C> {
    fn clone(&self) -> Self {
        Self {
            inner: self.inner.clone(),
            meter: self.meter,
        }
    }
}

impl<T: Copy, C> Copy for Metered<'_, T, C> {}

impl<K: Kernels, C: Counter> Kernels for Metered<'_, K, C> {
    // These three are part of the rest.
    #[inline]
    fn luma_row(&self, format: PixelFormat, line: &[u8], grey: &mut [u8]) {
        self.inner.luma_row(format, line, grey);
    }

    #[inline]
    fn channel_row(&self, format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
        self.inner.channel_row(format, line, channel, row);
    }

    #[inline]
    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    ) {
        self.inner.convert_row(conversion, levels, low, high);
    }

    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        let body = || self.inner.pack_cells(samples, packed);
        self.meter.measure_innermost(Stage::Sampling, body);
    }

    #[inline]
    fn recall_row(&self, row: &RowRecall<'_>, distances: &mut [i16], candidates_px: &mut [i16]) {
        let body = || self.inner.recall_row(row, distances, candidates_px);
        self.meter.measure_innermost(Stage::Hamming, body);
    }

    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        let body = || self.inner.mask_block(block);
        self.meter.measure_innermost(Stage::Masks, body);
    }

    #[inline]
    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        let body = || self.inner.cost_run(row, costs);
        self.meter.measure_innermost(Stage::Hamming, body);
    }

    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
        let body = || self.inner.arms_row(row, scratch, arms);
        self.meter
            .measure_innermost(Stage::SurfacesAndMedians, body);
    }

    #[inline]
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        let body = || self.inner.median9_row(rows, output);
        self.meter
            .measure_innermost(Stage::SurfacesAndMedians, body);
    }

    #[inline]
    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        let body = || self.inner.weighted_median_row(row, weights, output);
        self.meter
            .measure_innermost(Stage::SurfacesAndMedians, body);
    }

    // `aggregate_row` is these two, one after the other.
    #[inline]
    fn aggregate_paths(&self, row: &mut AggregateRow<'_>) {
        let body = || self.inner.aggregate_paths(row);
        self.meter.measure_innermost(Stage::Aggregation, body);
    }

    #[inline]
    fn select_row(&self, row: &mut AggregateRow<'_>) {
        let body = || self.inner.select_row(row);
        self.meter.measure_innermost(Stage::Selection, body);
    }
}

impl<T: ErrorType, C> ErrorType for Metered<'_, T, C> {
    type Error = T::Error;
}

impl<T: LinePairSource, C: Counter> LinePairSource for Metered<'_, T, C> {
    fn geometry(&self) -> Geometry {
        self.inner.geometry()
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, Self::Error> {
        let body = || self.inner.read_pair(left, right);
        self.meter.measure_innermost(Stage::Files, body)
    }
}

impl<T: DisparitySink, C: Counter> DisparitySink for Metered<'_, T, C> {
    type Error = T::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        let body = || self.inner.begin_frame(info);
        self.meter.measure_innermost(Stage::Files, body)
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        let body = || self.inner.line(frame, line);
        self.meter.measure_innermost(Stage::Files, body)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        let body = || self.inner.end_frame(info);
        self.meter.measure_innermost(Stage::Files, body)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        let body = || self.inner.abort_frame(frame, fault);
        self.meter.measure_innermost(Stage::Files, body);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Advances by one at each look.
    #[derive(Clone, Copy)]
    struct Looks<'a>(&'a Cell<u32>);

    impl Counter for Looks<'_> {
        const INSTRUCTIONS_PER_64_TICKS: u32 = 128;

        fn ticks(self) -> u32 {
            self.0.set(self.0.get().wrapping_add(1));
            self.0.get()
        }
    }

    #[test]
    fn a_stage_within_another_is_not_counted_twice() {
        let ticks = Cell::new(u32::MAX - 3);
        let meter = Meter::new(Looks(&ticks));
        meter.measure(Stage::ChecksAndRest, || {
            meter.measure_innermost(Stage::Masks, || ticks.set(ticks.get().wrapping_add(10)));
        });
        let mut expected = [0; Stage::ALL.len()];
        // Eleven ticks within, and one before and one after; two instructions each.
        expected[Stage::Masks as usize] = 22;
        expected[Stage::ChecksAndRest as usize] = 4;
        assert_eq!(meter.instructions(), expected);
    }

    #[test]
    fn stages_are_in_order() {
        for (index, stage) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage as usize, index);
        }
    }
}
