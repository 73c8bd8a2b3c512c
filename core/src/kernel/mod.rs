//! Kernels: the inner loops of the pipeline, each with a plain reference.
//!
//! Each kernel has a file with its task (its inputs and outputs), the plain reference, and a test
//! of the reference. The references are safe code whose loops have fixed trip counts, so that a
//! compiler vectorises them. They are `inline(always)`, so that a kernel set can compile them for
//! its own instruction set.
//!
//! A kernel set is a type that implements [`Kernels`]; it equals the reference bit for bit.
//! [`Portable`] is the reference. The crate `vgstereo-kernels` has faster sets.
//!
//! Kernels do not know where rows come from: they work on slices, and import nothing of this crate
//! but [`crate::disparity`].

mod aggregate;
mod arms;
mod attenuate;
mod check;
pub mod compact;
mod convert;
mod cost;
mod hamming;
pub(crate) mod lanes;
mod mask;
mod median9;
mod nearest;
mod neighbours;
mod pack;
mod penalty;
mod recall;
mod resample;
mod rivals;
mod scope;
mod select;
mod smooth;
mod subpixel;
mod unpack;
mod weighted_median;

pub use aggregate::{AggregateRow, aggregate_paths, path_scratch_bytes};
pub use arms::{ArmsRow, arms_row, arms_scratch_bytes};
pub use attenuate::{AttenuateRow, attenuate_row};
pub use check::{CheckRow, check_row};
pub use convert::{LevelConversion, convert_row};
pub use cost::{CostRun, NO_COST, cost_run, cost_stride};
pub use hamming::{LANES, NO_DISTANCE, Planes, distances};
pub use mask::{MASK_LANES, MaskBlock, mask_block};
pub use median9::median9_row;
pub use nearest::{Nearest, best, nearest, nth_at};
pub use pack::{CELLS_PER_BYTE, pack_cells};
pub use penalty::{Penalty, penalty_row};
pub(crate) use recall::pick;
pub use recall::{RowRecall, TieBreak, recall_row};
pub use resample::{
    DISPLACEMENT_BITS, Interpolation, ResampleRow, cell_positions, for_each_cell, resample_cell,
    resample_row, sixteenth_shift,
};
pub use rivals::{RIVAL_BLOCK_PX, RIVAL_STEP_PX, RivalsRow, rivals_row};
pub use scope::{DrawnSynapses, Only, Scope, Scoped, SynapseLaw};
pub use select::select_row;
pub use smooth::smooth_row;
pub use subpixel::{SubpixelStep, subpixel_step_q4, subpixel_steps_q4};
pub use unpack::{MAX_CHANNELS, PixelFormat, channel_row, luma_row};
pub use weighted_median::{MAX_TAP_ROWS, WeightedMedianRow, weighted_median_row};

/// A kernel set: the inner loops of the pipeline, for one instruction set.
///
/// Every method equals the plain reference with its name in this module, bit for bit. Only where the costs and the path
/// costs of a row are kept is up to a set: what its [`Kernels::cost_run`] has computed, its [`Kernels::rivals_row`],
/// [`Kernels::attenuate_row`] and [`Kernels::aggregate_row`] take, and nothing else reads. No method has
/// a default: a set that lacks a kernel of its own forwards it to a named set, with
/// [`forward_kernels!`](crate::forward_kernels).
pub trait Kernels: Copy {
    /// Whether [`Kernels::aggregate_row`] is one loop, rather than [`Kernels::aggregate_paths`]
    /// followed by [`Kernels::select_row`].
    const FUSES_SELECTION: bool;

    /// The configurations for which a matcher with this set is compiled; see [`Only`]. A set that wraps another has
    /// its scope.
    const SCOPE: Scope = Scope::ALL;

    /// Writes the luma of a line of `format` to `grey`; see [`luma_row`].
    fn luma_row(&self, format: PixelFormat, line: &[u8], grey: &mut [u8]);

    /// Writes one colour channel of a line of `format` to `row`; see [`channel_row`].
    fn channel_row(&self, format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]);

    /// Converts levels to the reference camera's exposure; see [`convert_row`].
    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    );

    /// Resamples a row of a rectified view; see [`resample_row`].
    fn resample_row(&self, row: &ResampleRow<'_>, output: &mut [u8]);

    /// Smooths a line of grey between edges; see [`smooth_row`]. If a row has fewer than two pixels
    /// more than `smoothed`, `smoothed` stays unchanged.
    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]);

    /// Forms eight Minchinton cells for each neuron of a run; see [`pack_cells`].
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]);

    /// Recalls a row of neurons; see [`recall_row`].
    fn recall_row(&self, row: &RowRecall<'_>, distances: &mut [i16], candidates_px: &mut [i16]);

    /// Selects the cells on the surface of each pixel of a block; see [`mask_block`].
    fn mask_block(&self, block: &mut MaskBlock<'_>);

    /// Computes the matching costs of a run of pixels; see [`cost_run`].
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]);

    /// Writes penalties of larger steps of disparity; see [`penalty_row`].
    fn penalty_row(&self, penalty: &Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]);

    /// Aggregates a row of costs along three paths, in place of the costs; see
    /// [`aggregate_paths`].
    fn aggregate_paths(&self, row: &mut AggregateRow<'_>);

    /// Selects the best disparity of each pixel of both views; see [`select_row`].
    fn select_row(&self, row: &mut AggregateRow<'_>);

    /// Aggregates a row and selects. The outputs equal those of [`Kernels::aggregate_paths`]
    /// followed by [`Kernels::select_row`]; the content of scratch may differ.
    fn aggregate_row(&self, row: &mut AggregateRow<'_>);

    /// Looks for rivals in a row of costs; see [`rivals_row`].
    fn rivals_row(&self, row: &RivalsRow<'_>, sums: &mut [u32], rivals: &mut [u8]);

    /// Attenuates a row of costs, after rivals were looked for in it; see [`attenuate_row`].
    fn attenuate_row(&self, row: &mut AttenuateRow<'_>);

    /// Checks a row of selected disparities; see [`check_row`].
    fn check_row(&self, row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]);

    /// Measures the arms of the cross-based vote along a line; see [`arms_row`].
    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]);

    /// Filters a row by the median of 3 x 3 pixels; see [`median9_row`].
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]);

    /// Filters a row by a weighted median; see [`weighted_median_row`].
    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    );
}

/// The parameters of every kernel, for macros that write methods of
/// [`Kernels`](crate::kernel::Kernels): invokes the macro in brackets once for each named kernel, or
/// for all kernels if none is named, with any tokens in braces, the kernel's name, its parameters
/// and its arguments.
#[doc(hidden)]
#[macro_export]
macro_rules! kernel_methods {
    ($write:tt $how:tt: $($kernel:ident),+ $(,)?) => {
        $($crate::kernel_methods!(@ $kernel $write $how);)+
    };
    ($write:tt $how:tt) => {
        $crate::kernel_methods!($write $how: luma_row, channel_row, resample_row, convert_row,
            smooth_row, pack_cells, recall_row, mask_block, cost_run, penalty_row, aggregate_paths,
            select_row, aggregate_row, rivals_row, attenuate_row, check_row, arms_row, median9_row,
            weighted_median_row);
    };
    (@ luma_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ luma_row $($to)+,
            format: $crate::kernel::PixelFormat, line: &[u8], grey: &mut [u8]);
    };
    (@ channel_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ channel_row $($to)+,
            format: $crate::kernel::PixelFormat, line: &[u8], channel: usize,
            row: &mut [u8]);
    };
    (@ resample_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ resample_row $($to)+,
            row: &$crate::kernel::ResampleRow<'_>, output: &mut [u8]);
    };
    (@ convert_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ convert_row $($to)+,
            conversion: &$crate::kernel::LevelConversion, levels: &[u8], low: &mut [u8],
            high: &mut [u8]);
    };
    (@ smooth_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ smooth_row $($to)+,
            rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]);
    };
    (@ pack_cells $($to:tt)+) => {
        $crate::kernel_methods!(@@ pack_cells $($to)+,
            samples: &[&[u8]; $crate::kernel::CELLS_PER_BYTE + 1], packed: &mut [u8]);
    };
    (@ recall_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ recall_row $($to)+,
            row: &$crate::kernel::RowRecall<'_>, distances: &mut [i16],
            candidates_px: &mut [i16]);
    };
    (@ mask_block $($to:tt)+) => {
        $crate::kernel_methods!(@@ mask_block $($to)+, block: &mut $crate::kernel::MaskBlock<'_>);
    };
    (@ cost_run $($to:tt)+) => {
        $crate::kernel_methods!(@@ cost_run $($to)+,
            run: &$crate::kernel::CostRun<'_>, costs: &mut [u8]);
    };
    (@ penalty_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ penalty_row $($to)+,
            penalty: &$crate::kernel::Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]);
    };
    (@ aggregate_paths $($to:tt)+) => {
        $crate::kernel_methods!(@@ aggregate_paths $($to)+,
            row: &mut $crate::kernel::AggregateRow<'_>);
    };
    (@ select_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ select_row $($to)+, row: &mut $crate::kernel::AggregateRow<'_>);
    };
    (@ aggregate_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ aggregate_row $($to)+,
            row: &mut $crate::kernel::AggregateRow<'_>);
    };
    (@ rivals_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ rivals_row $($to)+,
            row: &$crate::kernel::RivalsRow<'_>, sums: &mut [u32], rivals: &mut [u8]);
    };
    (@ attenuate_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ attenuate_row $($to)+,
            row: &mut $crate::kernel::AttenuateRow<'_>);
    };
    (@ check_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ check_row $($to)+,
            row: &$crate::kernel::CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]);
    };
    (@ arms_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ arms_row $($to)+,
            row: &$crate::kernel::ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]);
    };
    (@ median9_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ median9_row $($to)+, rows: [&[i16]; 3], output: &mut [i16]);
    };
    (@ weighted_median_row $($to:tt)+) => {
        $crate::kernel_methods!(@@ weighted_median_row $($to)+,
            row: &$crate::kernel::WeightedMedianRow<'_>, weights: &mut [u8],
            output: &mut [i16]);
    };
    (@@ $kernel:ident [$($write:tt)+] $how:tt, $($argument:ident: $type:ty),+) => {
        $($write)+!($how $kernel ($($argument: $type),+) ($($argument),+));
    };
}

/// The reference kernels, for every target.
#[derive(Debug, Clone, Copy, Default)]
pub struct Portable;

/// Writes a method of [`Portable`] that calls the reference of its name.
macro_rules! call_reference {
    ({} $kernel:ident ($($parameters:tt)+) $arguments:tt) => {
        #[inline]
        fn $kernel(&self, $($parameters)+) {
            $kernel $arguments;
        }
    };
}

impl Kernels for Portable {
    const FUSES_SELECTION: bool = false;

    kernel_methods!([call_reference] {}: luma_row, channel_row, resample_row, convert_row,
        smooth_row, pack_cells, recall_row, mask_block, cost_run, penalty_row, aggregate_paths,
        select_row, rivals_row, attenuate_row, check_row, arms_row, median9_row, weighted_median_row);

    #[inline]
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }
}

/// Writes methods of an implementation of [`Kernels`] that call those
/// of another set. Every kernel is named, so that a set that forgets one does not compile.
///
/// `set => expression;` names the set itself and gives the one to call. With
/// `within |body| expression`, the call is a closure `body`, for a set that does something
/// around it, such as measuring.
///
/// ```
/// use vgstereo_core::kernel::{Kernels, Portable};
///
/// /// Counts its calls of two kernels.
/// #[derive(Clone, Copy)]
/// struct Counting<'a>(&'a core::cell::Cell<u32>);
///
/// impl Kernels for Counting<'_> {
///     const FUSES_SELECTION: bool = Portable::FUSES_SELECTION;
///
///     vgstereo_core::forward_kernels!(set => &Portable; luma_row, channel_row, resample_row,
///         convert_row, smooth_row, pack_cells, recall_row, mask_block, penalty_row,
///         aggregate_paths, select_row, aggregate_row, rivals_row, attenuate_row, check_row, arms_row,
///         weighted_median_row);
///     vgstereo_core::forward_kernels!(set => &Portable, within |body| {
///         set.0.set(set.0.get() + 1);
///         body()
///     }; cost_run, median9_row);
/// }
///
/// let calls = core::cell::Cell::new(0);
/// let mut median = [0];
/// Counting(&calls).median9_row([&[1, 2, 3], &[4, 5, 6], &[7, 8, 9]], &mut median);
/// assert_eq!((calls.get(), median), (1, [5]));
/// ```
#[macro_export]
macro_rules! forward_kernels {
    ($set:ident => $to:expr; $($kernel:ident),+ $(,)?) => {
        $crate::forward_kernels!($set => $to, within |body| body(); $($kernel),+);
    };
    ($set:ident => $to:expr, within |$body:ident| $within:expr; $($kernel:ident),+ $(,)?) => {
        $crate::kernel_methods!(
            [$crate::forward_kernel] { $set, $to, $body, $within }: $($kernel),+
        );
    };
}

pub(crate) use forward_kernels;

/// Writes the method of one kernel for [`forward_kernels!`](crate::forward_kernels).
#[doc(hidden)]
#[macro_export]
macro_rules! forward_kernel {
    (
        { $set:ident, $to:expr, $body:ident, $within:expr }
        $kernel:ident ($($parameters:tt)+) ($($arguments:tt)+)
    ) => {
        #[inline]
        fn $kernel(&self, $($parameters)+) {
            #[allow(unused_variables)]
            let $set = self;
            #[allow(unused_mut)]
            let mut $body = || $crate::kernel::Kernels::$kernel($to, $($arguments)+);
            $within
        }
    };
}
