//! The kernels of the preset that this firmware is for.

use vgstereo_core::Portable;
use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{CostRun, Kernels, Planes};
use vgstereo_kernels::Rv32;

/// Bytes of a pattern of `lite`.
const PATTERN_BYTES: usize = 4;

/// [`Rv32`] for `lite`. What that does not use is the reference, which has the same results and takes
/// the least room: block RAM is short. So do costs of other than 16 and 32 disparities.
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
            && run.difference_weight_q4 > 0;
        match run.disparities {
            16 if is_known => Rv32.cost_run(&with_constants::<16>(run), costs),
            32 if is_known => Rv32.cost_run(&with_constants::<32>(run), costs),
            _ => Portable.cost_run(run, costs),
        }
    }
}

/// The same run, of whose lengths the compiler knows what is known: the code for others is left out.
#[inline(always)]
fn with_constants<'r, const DISPARITIES: usize>(run: &CostRun<'r>) -> CostRun<'r> {
    CostRun {
        inputs: Planes {
            count: PATTERN_BYTES,
            ..run.inputs
        },
        masks: Planes {
            count: 0,
            ..run.masks
        },
        disparities: DISPARITIES,
        ..*run
    }
}
