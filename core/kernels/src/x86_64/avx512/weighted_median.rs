//! Weighted median in AVX-512: 32 pixels at once.

use core::arch::x86_64::{
    __m256i as Bytes, __m512i as Words, __mmask32, _mm256_adds_epu8, _mm256_or_si256,
    _mm256_subs_epu8, _mm512_add_epi16 as add, _mm512_and_si512 as and,
    _mm512_cmpeq_epi16_mask as is_equal, _mm512_cmpge_epu16_mask as at_least_unsigned,
    _mm512_cmpgt_epi16_mask as is_greater, _mm512_cvtepu8_epi16, _mm512_mask_blend_epi16,
    _mm512_maskz_mov_epi16 as keep, _mm512_max_epi16 as greatest, _mm512_min_epi16 as least,
    _mm512_mullo_epi16 as multiply, _mm512_set1_epi16 as broadcast,
    _mm512_srai_epi16 as shift_right_signed, _mm512_srli_epi16 as shift_right,
    _mm512_sub_epi16 as subtract, _mm512_subs_epu16 as subtract_saturating,
    _mm512_xor_si512 as xor,
};
use core::cell::Cell;
use std::vec::Vec;

use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{self, WeightedMedianRow};

use crate::x86_64::weighted_median::{Tap, is_whole, median_in_registers};

/// Number of pixels filtered at once.
const LANES: usize = 32;

median_in_registers!("avx512f,avx512bw,avx512vl");

/// Absolute differences, summed over three channels and at most 255.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn difference(a: [Bytes; 3], b: [Bytes; 3]) -> Words {
    let one = |channel: usize| {
        let (a, b) = (a[channel], b[channel]);
        _mm256_or_si256(_mm256_subs_epu8(a, b), _mm256_subs_epu8(b, a))
    };
    _mm512_cvtepu8_epi16(_mm256_adds_epu8(_mm256_adds_epu8(one(0), one(1)), one(2)))
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn select(mask: __mmask32, yes: Words, no: Words) -> Words {
    _mm512_mask_blend_epi16(mask, no, yes)
}

#[inline]
fn is_all(mask: __mmask32) -> bool {
    mask == __mmask32::MAX
}

#[inline]
fn is_none(mask: __mmask32) -> bool {
    mask == 0
}
