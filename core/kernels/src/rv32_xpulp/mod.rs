//! Kernels for RV32 with Xpulp: CV32E40P.

mod aggregate;
mod cost;
mod pack;
mod select;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{AggregateRow, CELLS_PER_BYTE, CostRun, Kernels};

use crate::armv7em::Armv7em;
use crate::rv32::Rv32;

/// Kernel set for RV32 with the byte instructions of Xpulp, as CV32E40P has them: cells, matching costs of 32 cells, path
/// costs and selection of its own, and the kernels of [`Armv7em`] and [`Rv32`] for all others.
///
/// It executes these instructions on RV32 where the crate has the feature `xpulp-instructions`; so do then the kernels of
/// [`Armv7em`]. Elsewhere plain code stands in for them. Words are loaded from any address, so the compiler has to know that
/// the processor can: `-Ctarget-feature=+unaligned-scalar-mem`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rv32Xpulp;

impl Rv32Xpulp {
    /// Writes the costs of a run as [`Kernels::cost_run`] does, and leaves those that this set has no kernel of its own
    /// for to another set: to [`Portable`](vgstereo_core::kernel::Portable) where memory for code is short. Of its own
    /// it has one for 32 cells that all count, with up to 64 disparities and levels of grey.
    #[inline]
    pub fn cost_run_or(self, others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(others, run, costs);
    }
}

impl Kernels for Rv32Xpulp {
    const FUSES_SELECTION: bool = false;

    forward_kernels!(set => &Armv7em; resample_row, convert_row, smooth_row, mask_block, penalty_row, rivals_row, attenuate_row, arms_row,
        median9_row, weighted_median_row);
    forward_kernels!(set => &Rv32; luma_row, channel_row, recall_row, check_row);

    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack::pack_cells(samples, packed);
    }

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
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }
}
