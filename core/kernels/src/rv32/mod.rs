//! Kernels for RV32, with and without the Zbb extension.

mod aggregate;
mod cost;
mod counted;
#[allow(unsafe_code)]
mod least;
mod levels;
mod packed;
mod select;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{AggregateRow, CostRun, Kernels, Portable};

use crate::armv7em::Armv7em;

/// Kernel set for RV32: the kernels of [`Armv7em`] that are faster even without byte SIMD, and the
/// reference for all others.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rv32;

impl Kernels for Rv32 {
    const FUSES_SELECTION: bool = Portable::FUSES_SELECTION;

    // Counting bits of four patterns at once and packing four pixels into a register save more than
    // it costs to replace each byte SIMD instruction by a dozen ordinary ones.
    forward_kernels!(set => &Armv7em; smooth_row, mask_block, arms_row,
        weighted_median_row);
    // The kernels of `Armv7em` were not found to be faster here.
    forward_kernels!(set => &Portable; convert_row, pack_cells, median9_row);
    // On Arm, byte SIMD does most of the work of these. Not measured here.
    forward_kernels!(set => &Portable; penalty_row, rivals_row, check_row);
    // `Armv7em` has no kernels of its own for these.
    forward_kernels!(set => &Portable; luma_row, channel_row, recall_row);
    // `Armv7em` looks lines up and checks positions once per cell of knots, the reference for each
    // pixel. Not measured here.
    forward_kernels!(set => &Armv7em; resample_row);

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(run, costs);
    }

    #[inline]
    fn aggregate_paths(&self, row: &mut AggregateRow<'_>) {
        aggregate::aggregate_paths(row);
    }

    #[inline]
    fn select_row(&self, row: &mut AggregateRow<'_>) {
        select::select_row(row);
    }

    #[inline]
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }
}
