//! The kernels of the preset that this firmware is for.

use vgstereo_core::Portable;
use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{CostRun, Kernels, Planes};
use vgstereo_kernels::Rv32;

/// Bytes of a pattern of `lite`.
const PATTERN_BYTES: usize = 4;

/// The largest number of disparities for which its costs have a fast kernel here.
const DISPARITIES_MAX: usize = 48;

/// [`Rv32`] for `lite`. What that does not use is the reference, which has the same results and takes
/// the least room: that of the block RAM is short.
#[derive(Clone, Copy)]
pub(crate) struct LiteKernels;

impl Kernels for LiteKernels {
    const FUSES_SELECTION: bool = Rv32::FUSES_SELECTION;

    forward_kernels!(set => &Rv32; luma_row, channel_row, convert_row, smooth_row, pack_cells, penalty_row,
        aggregate_paths, select_row, aggregate_row, rivals_row, check_row, median9_row);
    forward_kernels!(set => &Portable; resample_row, mask_block, recall_row, arms_row, weighted_median_row);

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        let is_known = run.inputs.count == PATTERN_BYTES
            && run.masks.count == 0
            && run.disparities <= DISPARITIES_MAX
            && run.difference_weight_q4 > 0;
        if is_known {
            // With these as constants, the code for other patterns is left out.
            let inputs = Planes {
                count: PATTERN_BYTES,
                ..run.inputs
            };
            let masks = Planes {
                count: 0,
                ..run.masks
            };
            let run = CostRun {
                inputs,
                masks,
                ..*run
            };
            Rv32.cost_run(&run, costs);
        } else {
            Portable.cost_run(run, costs);
        }
    }
}
