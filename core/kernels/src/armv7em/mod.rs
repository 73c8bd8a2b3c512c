//! Kernels for Armv7E-M: Cortex-M4 and Cortex-M7.
//!
//! A register holds four bytes or two halfwords, and the instructions of the DSP extension work on
//! all of them at once. The kernels are written in terms of `simd`, whose functions are one or two
//! of these instructions on targets that have them, a few of Xpulp on those that have these, and about
//! a dozen ordinary ones with the same result elsewhere. So the code that runs on the chip is tested on
//! the host, but for some inner loops, which are assembly because the compiler does not find the registers for them: plain
//! code stands in for them elsewhere, and an emulated board holds them to the reference
//! (`firmware/boards/mps3-an547-suite`).

mod aggregate;
mod arms;
mod check;
mod convert;
pub(crate) mod cost;
mod mask;
pub(crate) mod median9;
#[cfg(all(dsp_extension, feature = "memory-functions"))]
#[allow(unsafe_code)]
mod memory;
mod pack;
mod path;
mod penalty;
mod resample;
mod rivals;
pub(crate) mod select;
#[allow(unsafe_code)]
pub(crate) mod simd;
mod smooth;
mod weighted_median;

/// The code for what these kernels do not take.
#[cfg(not(feature = "compact"))]
use vgstereo_core::kernel as others;
#[cfg(feature = "compact")]
use vgstereo_core::kernel::compact as others;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{
    AggregateRow, ArmsRow, CELLS_PER_BYTE, CheckRow, CostRun, Kernels, LevelConversion, MaskBlock,
    Penalty, Portable, ResampleRow, RivalsRow, WeightedMedianRow,
};

/// Kernel set in byte SIMD for Cortex-M4 and Cortex-M7.
///
/// It runs on every target. Without the DSP extension, at most the kernels that
/// [`Rv32`](crate::Rv32) takes from it are faster than the reference.
#[derive(Debug, Clone, Copy, Default)]
pub struct Armv7em;

impl Kernels for Armv7em {
    const FUSES_SELECTION: bool = false;

    // The reference suffices: each pixel is unpacked only once, and recall is little more than a
    // loop around the Hamming distances.
    forward_kernels!(set => &Portable; luma_row, channel_row, recall_row, attenuate_row);

    #[inline]
    fn resample_row(&self, row: &ResampleRow<'_>, output: &mut [u8]) {
        resample::resample_row(row, output);
    }

    #[inline]
    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    ) {
        convert::convert_row(conversion, levels, low, high);
    }

    #[inline]
    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        smooth::smooth_row(rows, step_max, smoothed);
    }

    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack::pack_cells(samples, packed);
    }

    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        mask::mask_block(block);
    }

    #[inline]
    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(run, costs);
    }

    #[inline]
    fn penalty_row(&self, penalty: &Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]) {
        penalty::penalty_row(penalty, own, neighbours, p2);
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
    fn rivals_row(&self, row: &RivalsRow<'_>, sums: &mut [u32], rivals: &mut [u8]) {
        rivals::rivals_row(row, sums, rivals);
    }

    #[inline]
    fn check_row(&self, row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]) {
        check::check_row(row, found, confidences);
    }

    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, _scratch: &mut [u8], arms: &mut [i16]) {
        arms::arms_row(row, arms);
    }

    #[inline]
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        median9::median9_row(rows, output);
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
