//! Kernels for RV32, with and without the Zbb extension.

pub(crate) mod aggregate;
mod check;
pub(crate) mod cost;
mod counted;
mod group;
#[allow(unsafe_code)]
mod least;
mod levels;
#[cfg(all(
    target_arch = "riscv32",
    target_os = "none",
    feature = "memory-functions"
))]
#[allow(unsafe_code)]
mod memory;
mod packed;
mod select;
mod unrolled;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{AggregateRow, CheckRow, CostRun, Kernels, Portable};

use crate::armv7em::Armv7em;

/// Kernel set for RV32: matching costs, path costs, selection and checks of its own, the kernels of [`Armv7em`] that are
/// faster even without byte SIMD, and the reference for all others.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rv32;

impl Rv32 {
    /// Writes the costs of a run as [`Kernels::cost_run`] does, and leaves those that this set has no kernel of its own
    /// for to another set: to [`Portable`] where memory for code is short. Of its own it has one for 32 cells and one
    /// for 48 masked cells, with up to 64 disparities and levels of grey.
    #[inline]
    pub fn cost_run_or(self, others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(others, run, costs);
    }
}

impl Kernels for Rv32 {
    const FUSES_SELECTION: bool = false;

    // Four pixels in a register save more than it costs to replace each byte SIMD instruction by a
    // dozen ordinary ones.
    forward_kernels!(set => &Armv7em; smooth_row, mask_block, arms_row, weighted_median_row);
    // The kernels of `Armv7em` were measured to be slower here, together and stage by stage.
    forward_kernels!(set => &Portable; convert_row, pack_cells, penalty_row, rivals_row, attenuate_row, median9_row);
    // `Armv7em` has no kernels of its own for these.
    forward_kernels!(set => &Portable; luma_row, channel_row, recall_row);
    // `Armv7em` looks lines up and checks positions once per cell of knots, the reference for each
    // pixel. Not measured here.
    forward_kernels!(set => &Armv7em; resample_row);

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        self.cost_run_or(&Armv7em, run, costs);
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
    fn check_row(&self, row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]) {
        check::check_row(row, found, confidences);
    }

    #[inline]
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }
}
