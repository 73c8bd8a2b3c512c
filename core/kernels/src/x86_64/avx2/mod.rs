//! Kernels in AVX2.

mod aggregate;
mod cost;
mod mask;
mod weighted_median;

use vgstereo_core::kernel::Kernels;

/// Kernel set for AVX2. A value exists only if the processor has its instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx2(());

impl Avx2 {
    /// Returns the set if the processor has its instructions.
    #[must_use]
    pub fn detect() -> Option<Self> {
        let has_all =
            std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("popcnt");
        has_all.then_some(Self(()))
    }
}

impl Kernels for Avx2 {
    const FUSES_SELECTION: bool = true;

    compiled_for!("avx2,popcnt", own {
        channel_row => crate::x86_64::unpack::channel_row,
        mask_block => mask::mask_block,
        cost_run => cost::cost_run,
        aggregate_row => aggregate::aggregate_row,
        weighted_median_row => weighted_median::weighted_median_row,
    });
    compiled_for!(
        "avx2,popcnt",
        reference {
            luma_row,
            resample_row,
            convert_row,
            smooth_row,
            pack_cells,
            recall_row,
            penalty_row,
            aggregate_paths,
            select_row,
            rivals_row,
            attenuate_row,
            check_row,
            arms_row,
            median9_row,
        }
    );
}
