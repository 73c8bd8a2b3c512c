//! The kernels of the preset that this firmware is for, all of them code.

use vgstereo_core::Portable;
use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{CostRun, Kernels};
#[cfg(feature = "vexriscv")]
use vgstereo_kernels::Rv32Bytes as Processor;
#[cfg(feature = "cv32e40p")]
use vgstereo_kernels::Rv32Xpulp as Processor;

use crate::board::BoardKernels;

/// Kernels of masks, arms and weighted medians, and of costs that the processor's set does not support. `lite` uses none
/// of them: there the reference takes the least of the block RAM.
#[cfg(feature = "lite")]
const OTHERS: Portable = Portable;
#[cfg(feature = "micro")]
const OTHERS: Processor = Processor;

/// The kernel set of the processor.
#[derive(Clone, Copy)]
pub(crate) struct PlainKernels;

impl Kernels for PlainKernels {
    const FUSES_SELECTION: bool = Processor::FUSES_SELECTION;

    forward_kernels!(set => &Processor; luma_row, channel_row, convert_row, smooth_row, pack_cells, penalty_row,
        aggregate_paths, select_row, aggregate_row, rivals_row, attenuate_row, check_row, median9_row);
    forward_kernels!(set => &OTHERS; mask_block, arms_row, weighted_median_row);
    // Of what is here for every preset.
    forward_kernels!(set => &Portable; resample_row, recall_row);

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        Processor.cost_run_or(&OTHERS, run, costs);
    }
}

impl BoardKernels for PlainKernels {
    fn fit(&self, _: usize, _: usize) -> bool {
        true
    }
}
