//! Kernels for AArch64 with Neon, whose registers have 16 bytes. Every AArch64 processor that runs
//! an operating system has Neon.
#![allow(unsafe_code)]

mod pack;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{CELLS_PER_BYTE, Kernels, Portable};

/// Kernel set for Neon.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Neon;

impl Neon {
    /// Returns the set: this module is compiled only for targets with Neon, so there is nothing to
    /// detect.
    #[must_use]
    pub const fn detect() -> Option<Self> {
        Some(Self)
    }
}

impl Kernels for Neon {
    const FUSES_SELECTION: bool = Portable::FUSES_SELECTION;

    // Compilers vectorise the references for Neon as they are.
    forward_kernels!(set => &Portable; luma_row, channel_row, resample_row, convert_row,
        smooth_row, recall_row, mask_block, cost_run, penalty_row, aggregate_paths, select_row,
        aggregate_row, rivals_row, attenuate_row, check_row, arms_row, median9_row, weighted_median_row);

    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack::pack_cells(samples, packed);
    }
}
