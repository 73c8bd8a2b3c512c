//! Kernels for Armv7E-M: Cortex-M4 and M7.
//!
//! A register holds four bytes or two halfwords, and the instructions of the DSP extension
//! work on them side by side. The kernels are written on [`simd`], whose functions are one
//! or two of these instructions each where the target has them, and plain code of the same
//! bits elsewhere: what runs on the chip is tested on the host.
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

mod aggregate;
mod cost;
mod pack;
#[allow(unsafe_code)]
pub mod simd;

use vgstereo_core::aggregation::AggregateRow;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matching::CostRun;
use vgstereo_core::minchinton::CELLS_PER_BYTE;

/// Kernels of byte SIMD, the same bits as
/// [`Portable`](vgstereo_core::kernel::Portable)'s.
#[derive(Debug, Clone, Copy, Default)]
pub struct Armv7em;

impl Kernels for Armv7em {
    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack::pack_cells(samples, packed);
    }

    #[inline]
    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        cost::cost_run(row, costs);
    }

    #[inline]
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        aggregate::aggregate_row(row);
    }
}
