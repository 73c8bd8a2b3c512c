//! Kernels for Armv8.1-M with Helium, the M-profile vector extension (MVE): Cortex-M52, M55 and M85.
//!
//! A vector register holds sixteen bytes. Stable Rust has no intrinsics for it, so the kernels are
//! assembly: each block of it is a loop over the vectors of a pixel, or over some pixels, in a function that
//! first asserts, in debug builds, that all its loads and stores stay inside its slices. The suite that holds
//! them to the reference runs on an emulated board: `firmware/boards/mps3-an547-suite`.

mod aggregate;
mod arms;
mod cost;
mod mask;
mod select;
mod weighted_median;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{
    AggregateRow, ArmsRow, CostRun, Kernels, MaskBlock, Portable, WeightedMedianRow,
};

use crate::armv7em::Armv7em;

/// Bytes of a vector register.
const LANES: usize = 16;

/// Assembly with vector instructions: its lines, then its operands. It overwrites all vector registers,
/// as names of them cannot be operands, and LR, in which hardware loops count. Lines that change the predicate P0,
/// which cannot be told either, save it before and restore it after.
macro_rules! vector_asm {
    ($($line:expr),+ ; $($operands:tt)*) => {
        core::arch::asm!(
            $($line),+,
            $($operands)*
            out("lr") _,
            out("d0") _, out("d1") _, out("d2") _, out("d3") _,
            out("d4") _, out("d5") _, out("d6") _, out("d7") _,
            out("d8") _, out("d9") _, out("d10") _, out("d11") _,
            out("d12") _, out("d13") _, out("d14") _, out("d15") _,
            options(nostack),
        )
    };
}
use vector_asm;

/// Kernel set in vectors of sixteen bytes for processors with Helium.
#[derive(Debug, Clone, Copy, Default)]
pub struct Helium;

impl Kernels for Helium {
    const FUSES_SELECTION: bool = false;

    // Of these references, the compiler makes vector code.
    forward_kernels!(set => &Portable; luma_row, channel_row, convert_row, smooth_row, pack_cells,
        recall_row, penalty_row, check_row, median9_row);
    forward_kernels!(set => &Armv7em; resample_row, rivals_row, attenuate_row);

    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        mask::mask_block(block);
    }

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

    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
        arms::arms_row(row, scratch, arms);
    }

    #[inline]
    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        weighted_median::weighted_median_row(row, weights, output);
    }
}
