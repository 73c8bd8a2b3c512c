//! Kernels for RV32 with the byte instructions of the soft core, `firmware/boards/softcore/rtl/byte_instructions.sv`.

mod aggregate;
pub(crate) mod cost;
#[allow(unsafe_code)]
mod instructions;
mod median9;
mod pack;
#[cfg(any(
    feature = "cases",
    not(all(target_arch = "riscv32", feature = "byte-instructions"))
))]
mod plain;
mod quads;
pub(crate) mod select;
mod smooth;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{AggregateRow, CELLS_PER_BYTE, CostRun, Kernels};

use crate::rv32::Rv32;

/// Kernel set for RV32 with the byte instructions of the soft core: smoothing, cells, matching costs of 32 cells, path
/// costs, selection and medians of its own, and [`Rv32`] for all others.
///
/// It executes these instructions on RV32 where the crate has the feature `byte-instructions`. They must then be
/// enabled, or they are illegal. Elsewhere plain code stands in for them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rv32Bytes;

/// The result of the instruction with these two parts of its code, for a test of the logic: 0 for those that there are
/// not.
#[cfg(feature = "cases")]
#[must_use]
pub fn byte_instruction(funct7: u32, funct3: u32, a: u32, b: u32) -> u32 {
    plain::result_of(funct7, funct3, a, b)
}

impl Rv32Bytes {
    /// Writes the costs of a run as [`Kernels::cost_run`] does, and leaves those that this set has no kernel of its own
    /// for to another set: to [`Portable`](vgstereo_core::kernel::Portable) where memory for code is short. Of its own
    /// it has one for 32 cells that all count, with up to 64 disparities and levels of grey.
    #[inline]
    pub fn cost_run_or(self, others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(others, run, costs);
    }
}

impl Kernels for Rv32Bytes {
    const FUSES_SELECTION: bool = false;

    forward_kernels!(set => &Rv32; luma_row, channel_row, resample_row, convert_row, recall_row, mask_block, penalty_row,
        rivals_row, attenuate_row, check_row, arms_row, weighted_median_row);

    #[inline]
    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        smooth::smooth_row(rows, step_max, smoothed);
    }

    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack::pack_cells(samples, packed);
    }

    #[inline]
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        median9::median9_row(rows, output);
    }

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        self.cost_run_or(&Rv32, run, costs);
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
