//! The core's kernels compiled for the widest vectors that this processor has.
//!
//! Core's reference kernels are plain loops that inline everywhere. Compiled here once
//! more with wider instruction sets enabled, they give the same bits from vector
//! registers of 32 or 64 bytes. The set is chosen at run time.

use vgstereo_core::aggregation::AggregateRow;
use vgstereo_core::camera::PixelFormat;
use vgstereo_core::kernel::{Kernels, Portable};
use vgstereo_core::matching::{CostRun, LevelConversion, MaskBlock, RowRecall};
use vgstereo_core::minchinton::CELLS_PER_BYTE;
use vgstereo_core::refine::{ArmsRow, WeightedMedianRow};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// A kernel set that this processor can run.
///
/// The level is private: a value exists only of a level that was detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostKernels(Level);

impl HostKernels {
    /// All sets this processor can run, slowest first; the first is the reference.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let mut levels = vec![Self(Level::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt") {
                levels.push(Self(Level::Avx2));
            }
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512vbmi")
                && is_x86_feature_detected!("avx512vpopcntdq")
                && is_x86_feature_detected!("popcnt")
            {
                levels.push(Self(Level::Avx512));
            }
        }
        levels
    }

    /// The fastest set this processor can run.
    #[must_use]
    pub fn fastest() -> Self {
        let mut available = Self::available();
        available.pop().unwrap_or(Self(Level::Portable))
    }

    /// The set's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self.0 {
            Level::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => "avx512",
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod aggregate;
#[cfg(target_arch = "x86_64")]
mod aggregate_avx2;
#[cfg(target_arch = "x86_64")]
mod aggregate_avx512;
#[cfg(target_arch = "x86_64")]
mod channel;
#[cfg(target_arch = "x86_64")]
mod cost;
#[cfg(target_arch = "x86_64")]
mod cost_avx2;
#[cfg(target_arch = "x86_64")]
mod cost_avx512;
#[cfg(target_arch = "x86_64")]
mod mask_avx2;
#[cfg(target_arch = "x86_64")]
mod mask_avx512;
#[cfg(target_arch = "x86_64")]
mod median;
#[cfg(target_arch = "x86_64")]
mod median_avx2;
#[cfg(target_arch = "x86_64")]
mod median_avx512;

#[cfg(target_arch = "x86_64")]
macro_rules! compiled_for {
    ($module:ident, $features:literal, $mask_block:path, $cost_run:path, $aggregate_row:path, $weighted_median_row:path) => {
        mod $module {
            use vgstereo_core::aggregation::AggregateRow;
            use vgstereo_core::camera::PixelFormat;
            use vgstereo_core::kernel;
            use vgstereo_core::matching::{self, CostRun, LevelConversion, MaskBlock, RowRecall};
            use vgstereo_core::minchinton::CELLS_PER_BYTE;
            use vgstereo_core::refine::{self, ArmsRow, WeightedMedianRow};

            #[target_feature(enable = $features)]
            pub fn luma_row(format: PixelFormat, line: &[u8], grey: &mut [u8]) {
                format.luma(line, grey);
            }

            #[target_feature(enable = $features)]
            pub fn channel_row(format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
                super::channel::channel_row(format, line, channel, row);
            }

            #[target_feature(enable = $features)]
            pub fn convert_row(
                conversion: &LevelConversion,
                levels: &[u8],
                low: &mut [u8],
                high: &mut [u8],
            ) {
                matching::convert_row(conversion, levels, low, high);
            }

            #[target_feature(enable = $features)]
            pub fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
                matching::smooth_row(rows, step_max, smoothed);
            }

            #[target_feature(enable = $features)]
            pub fn pack_cells(samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
                kernel::pack_cells(samples, packed);
            }

            #[target_feature(enable = $features)]
            pub fn mask_block(block: &mut MaskBlock<'_>) {
                $mask_block(block);
            }

            #[target_feature(enable = $features)]
            pub fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
                $cost_run(row, costs);
            }

            #[target_feature(enable = $features)]
            pub fn arms_row(row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
                refine::arms_row(row, scratch, arms);
            }

            #[target_feature(enable = $features)]
            pub fn median9_row(rows: [&[i16]; 3], output: &mut [i16]) {
                refine::median9_row(rows, output);
            }

            #[target_feature(enable = $features)]
            pub fn weighted_median_row(
                row: &WeightedMedianRow<'_>,
                weights: &mut [u8],
                output: &mut [i16],
            ) {
                $weighted_median_row(row, weights, output);
            }

            #[target_feature(enable = $features)]
            pub fn aggregate_row(row: &mut AggregateRow<'_>) {
                $aggregate_row(row);
            }

            #[target_feature(enable = $features)]
            pub fn recall_row(
                row: &RowRecall<'_>,
                distances: &mut [i16],
                candidates_px: &mut [i16],
            ) {
                matching::recall_row(row, distances, candidates_px);
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
compiled_for!(
    avx2,
    "avx2,popcnt",
    super::mask_avx2::mask_block,
    super::cost_avx2::cost_run,
    super::aggregate_avx2::aggregate_row,
    super::median_avx2::weighted_median_row
);
#[cfg(target_arch = "x86_64")]
compiled_for!(
    avx512,
    "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq,popcnt",
    super::mask_avx512::mask_block,
    super::cost_avx512::cost_run,
    super::aggregate_avx512::aggregate_row,
    super::median_avx512::weighted_median_row
);

/// Calls a kernel in the set that was chosen.
macro_rules! dispatch {
    ($self:ident, $kernel:ident($($argument:expr),*)) => {
        match $self.0 {
            Level::Portable => Portable.$kernel($($argument),*),
            // SAFETY: a value of this level exists only where `available` saw its features.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { avx2::$kernel($($argument),*) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { avx512::$kernel($($argument),*) },
        }
    };
}

impl Kernels for HostKernels {
    fn luma_row(&self, format: PixelFormat, line: &[u8], grey: &mut [u8]) {
        dispatch!(self, luma_row(format, line, grey));
    }

    fn channel_row(&self, format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
        dispatch!(self, channel_row(format, line, channel, row));
    }

    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    ) {
        dispatch!(self, convert_row(conversion, levels, low, high));
    }

    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        dispatch!(self, smooth_row(rows, step_max, smoothed));
    }

    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        dispatch!(self, pack_cells(samples, packed));
    }

    fn recall_row(&self, row: &RowRecall<'_>, distances: &mut [i16], candidates_px: &mut [i16]) {
        dispatch!(self, recall_row(row, distances, candidates_px));
    }

    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        dispatch!(self, mask_block(block));
    }

    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        dispatch!(self, cost_run(row, costs));
    }

    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
        dispatch!(self, arms_row(row, scratch, arms));
    }

    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        dispatch!(self, median9_row(rows, output));
    }

    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        dispatch!(self, weighted_median_row(row, weights, output));
    }

    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        dispatch!(self, aggregate_row(row));
    }
}
