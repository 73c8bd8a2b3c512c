//! Weighted median in AVX2: 16 pixels at once.

use core::arch::x86_64::{
    __m128i as Bytes, __m256i as Words, _mm_adds_epu8, _mm_or_si128, _mm_subs_epu8,
    _mm256_add_epi16 as add, _mm256_and_si256 as and, _mm256_and_si256 as keep, _mm256_blendv_epi8,
    _mm256_cmpeq_epi16 as is_equal, _mm256_cmpgt_epi16 as is_greater, _mm256_cvtepu8_epi16,
    _mm256_max_epi16 as greatest, _mm256_max_epu16, _mm256_min_epi16 as least,
    _mm256_movemask_epi8, _mm256_mullo_epi16 as multiply, _mm256_set1_epi16 as broadcast,
    _mm256_srai_epi16 as shift_right_signed, _mm256_srli_epi16 as shift_right,
    _mm256_sub_epi16 as subtract, _mm256_subs_epu16 as subtract_saturating,
    _mm256_xor_si256 as xor,
};
use core::cell::Cell;
use std::vec::Vec;

use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{self, WeightedMedianRow};

use crate::x86_64::weighted_median::{Tap, is_whole, median_in_registers};

/// Number of pixels filtered at once.
const LANES: usize = 16;

median_in_registers!("avx2");

/// Absolute differences, summed over three channels and at most 255.
#[target_feature(enable = "avx2")]
#[inline]
fn difference(a: [Bytes; 3], b: [Bytes; 3]) -> Words {
    let one = |channel: usize| {
        let (a, b) = (a[channel], b[channel]);
        _mm_or_si128(_mm_subs_epu8(a, b), _mm_subs_epu8(b, a))
    };
    _mm256_cvtepu8_epi16(_mm_adds_epu8(_mm_adds_epu8(one(0), one(1)), one(2)))
}

#[target_feature(enable = "avx2")]
#[inline]
fn select(mask: Words, yes: Words, no: Words) -> Words {
    _mm256_blendv_epi8(no, yes, mask)
}

#[target_feature(enable = "avx2")]
#[inline]
fn at_least_unsigned(a: Words, b: Words) -> Words {
    is_equal(_mm256_max_epu16(a, b), a)
}

#[target_feature(enable = "avx2")]
#[inline]
fn is_all(mask: Words) -> bool {
    _mm256_movemask_epi8(mask) == -1
}

#[target_feature(enable = "avx2")]
#[inline]
fn is_none(mask: Words) -> bool {
    _mm256_movemask_epi8(mask) == 0
}
