//! Kernels for Armv7E-M, Cortex-M4 and M7, and for RV32, with and without Zbb.
//!
//! A register holds four bytes or two halfwords, and the instructions of the DSP extension
//! work on them side by side. The kernels are written on `simd`, whose functions are one
//! or two of these instructions each where the target has them, and elsewhere a dozen on
//! whole registers that give the same bits: what runs on the chip is tested on the host.
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

mod aggregate;
mod arms;
mod convert;
mod cost;
mod mask;
mod median9;
mod pack;
#[allow(unsafe_code)]
mod simd;
mod smooth;
mod weighted_median;

use vgstereo_core::aggregation::AggregateRow;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matching::{CostRun, LevelConversion, MaskBlock};
use vgstereo_core::minchinton::CELLS_PER_BYTE;
use vgstereo_core::refine::{ArmsRow, WeightedMedianRow};

/// Kernels of byte SIMD, the same bits as
/// [`Portable`](vgstereo_core::kernel::Portable)'s.
#[derive(Debug, Clone, Copy, Default)]
pub struct Armv7em;

impl Kernels for Armv7em {
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
    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(row, costs);
    }

    #[inline]
    fn aggregate_paths(&self, row: &mut AggregateRow<'_>) {
        aggregate::aggregate_paths(row);
    }

    #[inline]
    fn select_row(&self, row: &mut AggregateRow<'_>) {
        aggregate::select_row(row);
    }

    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        mask::mask_block(block);
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

    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, _scratch: &mut [u8], arms: &mut [i16]) {
        arms::arms_row(row, arms);
    }

    #[inline]
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        median9::median9_row(rows, output);
    }
}

/// Those of [`Armv7em`] that pay without byte SIMD too: counts of bits in four patterns at
/// once more than make up for it. The others are the reference:
/// aggregation was tried and takes more, and so does selection where there is Zbb.
#[derive(Debug, Clone, Copy, Default)]
pub struct Rv32;

impl Kernels for Rv32 {
    #[inline]
    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        Armv7em.smooth_row(rows, step_max, smoothed);
    }

    #[inline]
    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        Armv7em.cost_run(row, costs);
    }

    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        Armv7em.mask_block(block);
    }

    #[inline]
    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        Armv7em.weighted_median_row(row, weights, output);
    }

    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
        Armv7em.arms_row(row, scratch, arms);
    }
}
