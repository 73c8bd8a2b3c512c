//! Matching costs in AVX2.

use core::arch::x86_64::{
    __m256i as Register, _mm_loadu_si128, _mm_storeu_si128, _mm256_add_epi8 as add_bytes,
    _mm256_add_epi16 as add_words, _mm256_adds_epu8 as add_saturating, _mm256_and_si256 as and,
    _mm256_castsi128_si256, _mm256_castsi256_si128, _mm256_loadu_si256,
    _mm256_min_epu8 as least_bytes, _mm256_min_epu16 as least_words,
    _mm256_mullo_epi16 as multiply, _mm256_or_si256 as or, _mm256_packus_epi16 as pack,
    _mm256_set1_epi8 as broadcast_byte, _mm256_set1_epi16 as broadcast_word, _mm256_setr_epi8,
    _mm256_setzero_si256 as zero, _mm256_shuffle_epi8, _mm256_srli_epi16 as shift_right,
    _mm256_storeu_si256, _mm256_subs_epu8 as subtract_saturating,
    _mm256_unpackhi_epi8 as unpack_high, _mm256_unpacklo_epi8 as unpack_low,
    _mm256_xor_si256 as xor,
};

use vgstereo_core::kernel::{self, CostRun, cost_stride};

use crate::x86_64::cost::{beyond, cost_in_registers, is_inside, sums_fit_bytes};

/// Number of disparities compared at once; half as many if there are no more than that.
const LANES: usize = 32;

/// Number of pixels handled together: sharing loads between more of them does not pay in AVX2.
const GROUP: usize = 1;

/// Number of planes whose differing cells are summed in 8 bits: at most 31 * 8 cells.
const PLANES_PER_SUM: usize = 31;

cost_in_registers!("avx2");

/// Patterns of a run as they are, in planes of bytes.
struct Patterns<'a>(&'a CostRun<'a>);

impl<'a> Patterns<'a> {
    fn new(row: &'a CostRun<'a>) -> Self {
        Self(row)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn differing_cells<const MASKED: bool, const REGISTERS: usize, const PIXELS: usize>(
        &self,
        x: usize,
        start: usize,
        lanes: usize,
    ) -> [[[Register; 2]; PIXELS]; REGISTERS] {
        const { assert!(PIXELS == 1) };
        let row = self.0;
        let position = row.first_position - x + start;
        let mut totals = [[zero(); 2]; REGISTERS];
        let mut plane = 0;
        while plane < row.inputs.count {
            let end = row.inputs.count.min(plane + PLANES_PER_SUM);
            let mut sums = [zero(); REGISTERS];
            for plane in plane..end {
                // SAFETY: `is_inside` has shown that these planes have the pixel and all
                // lanes.
                unsafe {
                    let input_at = row.inputs.stride * plane + row.start + x;
                    let input = *row.inputs.bytes.get_unchecked(input_at);
                    let input = broadcast_byte(input.cast_signed());
                    let mask = if MASKED {
                        let mask_at = row.masks.stride * plane + x;
                        let mask = *row.masks.bytes.get_unchecked(mask_at);
                        broadcast_byte(mask.cast_signed())
                    } else {
                        zero()
                    };
                    for (sum, index) in sums.iter_mut().zip(0..) {
                        let stored_at = row.stored.stride * plane + position + index * lanes;
                        let stored = load(row.stored.bytes, stored_at, lanes);
                        let mut differing = xor(input, stored);
                        if MASKED {
                            differing = and(differing, mask);
                        }
                        *sum = add_bytes(*sum, popcount(differing));
                    }
                }
            }
            for (total, sum) in totals.iter_mut().zip(sums) {
                *total = widen_add(*total, sum);
            }
            plane = end;
        }
        totals.map(|total| [total; PIXELS])
    }
}

/// Parameters of the cost of level differences, each in all words of a register.
struct Differences {
    mean_q8: Register,
    truncation: Register,
    weight_q4: Register,
}

impl Differences {
    #[target_feature(enable = "avx2")]
    fn new(row: &CostRun<'_>) -> Self {
        let mean_q8 = if row.channels == 1 { 256 } else { 85 };
        Self {
            mean_q8: broadcast_word(mean_q8),
            truncation: broadcast_word(row.difference_truncation.into()),
            weight_q4: broadcast_word(row.difference_weight_q4.into()),
        }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn costs(&self, sums: Register) -> Register {
        let cost = |sum| {
            let mean = shift_right::<8>(multiply(sum, self.mean_q8));
            shift_right::<4>(multiply(least_words(mean, self.truncation), self.weight_q4))
        };
        pack(
            cost(unpack_low(sums, zero())),
            cost(unpack_high(sums, zero())),
        )
    }
}

/// The register unchanged: a group is one pixel, so the place is always 0.
fn lanes_from(register: Register, _place: usize) -> Register {
    register
}

/// Adds each byte to its word.
#[target_feature(enable = "avx2")]
#[inline]
fn widen_add([low, high]: [Register; 2], bytes: Register) -> [Register; 2] {
    [
        add_words(low, unpack_low(bytes, zero())),
        add_words(high, unpack_high(bytes, zero())),
    ]
}

/// Counts the bits of each byte, by looking up its two nibbles.
#[target_feature(enable = "avx2")]
#[inline]
fn popcount(bytes: Register) -> Register {
    let ones = _mm256_setr_epi8(
        0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4, //
        0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4,
    );
    let lower = broadcast_byte(15);
    add_bytes(
        _mm256_shuffle_epi8(ones, and(bytes, lower)),
        _mm256_shuffle_epi8(ones, and(shift_right::<4>(bytes), lower)),
    )
}

/// Loads the first `lanes` bytes from `start` on; the others are unspecified.
///
/// # Safety
/// The slice has `lanes` bytes from `start` on; they are [`LANES`] or half as many.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn load(bytes: &[u8], start: usize, lanes: usize) -> Register {
    // SAFETY: only these lanes are read, which the caller promises.
    unsafe {
        let bytes = bytes.as_ptr().add(start);
        if lanes == LANES {
            _mm256_loadu_si256(bytes.cast())
        } else {
            _mm256_castsi128_si256(_mm_loadu_si128(bytes.cast()))
        }
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn store(bytes: &mut [u8], register: Register) {
    if let Some(bytes) = bytes.first_chunk_mut::<LANES>() {
        // SAFETY: the array has the register's 32 bytes.
        unsafe { _mm256_storeu_si256(bytes.as_mut_ptr().cast(), register) };
    } else if let Some(bytes) = bytes.first_chunk_mut::<{ LANES / 2 }>() {
        let lower = _mm256_castsi256_si128(register);
        // SAFETY: the array has the 16 bytes of half a register.
        unsafe { _mm_storeu_si128(bytes.as_mut_ptr().cast(), lower) };
    }
}
