//! Matching costs in AVX-512.

use std::arch::x86_64::{
    __m512i as Register, _mm512_add_epi8 as add_bytes, _mm512_add_epi16 as add_words,
    _mm512_and_si512 as and, _mm512_mask_storeu_epi8, _mm512_maskz_loadu_epi8,
    _mm512_min_epu16 as least_words, _mm512_mullo_epi16 as multiply, _mm512_or_si512 as or,
    _mm512_packus_epi16 as pack, _mm512_popcnt_epi8 as popcount,
    _mm512_set1_epi8 as broadcast_byte, _mm512_set1_epi16 as broadcast_word,
    _mm512_setzero_si512 as zero, _mm512_srli_epi16 as shift_right,
    _mm512_subs_epu8 as subtract_saturating, _mm512_unpackhi_epi8 as unpack_high,
    _mm512_unpacklo_epi8 as unpack_low, _mm512_xor_si512 as xor,
};

use vgstereo_core::matching::{self, CostRun, MAX_CHANNELS, cost_stride};

use super::cost::{PLANES_PER_SUM, beyond, cost_in_registers, is_inside};

/// Disparities side by side.
const LANES: usize = 64;

cost_in_registers!("avx512f,avx512bw,avx512vl,avx512bitalg");

/// Ones for the first lanes; there is at least one.
#[inline]
fn mask_of(lanes: usize) -> u64 {
    u64::MAX >> (LANES - lanes)
}

/// # Safety
/// The slice has `lanes` bytes from `start` on.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn load(bytes: &[u8], start: usize, lanes: usize) -> Register {
    // SAFETY: only these lanes are read, which the caller promises.
    unsafe { _mm512_maskz_loadu_epi8(mask_of(lanes), bytes.as_ptr().add(start).cast()) }
}

#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn store(bytes: &mut [u8], register: Register) {
    // SAFETY: only the lanes that the slice has are written.
    unsafe {
        _mm512_mask_storeu_epi8(bytes.as_mut_ptr().cast(), mask_of(bytes.len()), register);
    }
}
