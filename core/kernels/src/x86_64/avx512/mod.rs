//! Kernels in AVX-512, with its extensions for bytes, words, byte permutations and bit counts.

mod aggregate;
mod cost;
mod mask;
mod weighted_median;

use vgstereo_core::kernel::Kernels;

/// Mask of the bytes of a register that a slice of `length` bytes has.
#[inline]
const fn mask_of(length: usize) -> u64 {
    if length < u64::BITS as usize {
        (1 << length) - 1
    } else {
        u64::MAX
    }
}

/// Kernel set for AVX-512. A value exists only if the processor has its instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Avx512(());

impl Avx512 {
    /// Returns the set if the processor has its instructions.
    #[must_use]
    pub fn detect() -> Option<Self> {
        let has_all = std::is_x86_feature_detected!("avx512f")
            && std::is_x86_feature_detected!("avx512bw")
            && std::is_x86_feature_detected!("avx512vl")
            && std::is_x86_feature_detected!("avx512vbmi")
            && std::is_x86_feature_detected!("avx512vpopcntdq")
            && std::is_x86_feature_detected!("popcnt");
        has_all.then_some(Self(()))
    }
}

impl Kernels for Avx512 {
    const FUSES_SELECTION: bool = true;

    compiled_for!("avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq,popcnt", own {
        channel_row => crate::x86_64::unpack::channel_row,
        mask_block => mask::mask_block,
        cost_run => cost::cost_run,
        aggregate_row => aggregate::aggregate_row,
        weighted_median_row => weighted_median::weighted_median_row,
    });
    compiled_for!(
        "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq,popcnt",
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
