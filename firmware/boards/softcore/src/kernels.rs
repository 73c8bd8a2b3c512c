//! The kernels of the preset that this firmware is for, all of them code.

use vgstereo_core::Portable;
use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{CostRun, Kernels};
#[cfg(feature = "vexriscv")]
use vgstereo_kernels::Rv32Bytes as Processor;
#[cfg(feature = "cv32e40p")]
use vgstereo_kernels::Rv32Xpulp as Processor;

use crate::board::BoardKernels;

/// The kernel set of the processor, for `lite`. What that does not use is the reference, which has the same results and takes
/// the least room: block RAM is short.
#[derive(Clone, Copy)]
pub(crate) struct LiteKernels;

impl Kernels for LiteKernels {
    const FUSES_SELECTION: bool = Processor::FUSES_SELECTION;

    forward_kernels!(set => &Processor; luma_row, channel_row, convert_row, smooth_row, pack_cells, penalty_row,
        aggregate_paths, select_row, aggregate_row, rivals_row, check_row, median9_row);
    forward_kernels!(set => &Portable; resample_row, mask_block, recall_row, arms_row, weighted_median_row);

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        Processor.cost_run_or(&Portable, run, costs);
    }
}

impl BoardKernels for LiteKernels {
    fn fit(&self, _: usize, _: usize) -> bool {
        true
    }
}
