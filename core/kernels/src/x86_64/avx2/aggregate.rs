//! Aggregation of up to 64 disparities in AVX2: the path costs of a pixel take two registers.

use core::arch::x86_64::*;

use vgstereo_core::kernel::{self, AggregateRow};

use crate::x86_64::aggregate::{
    BLOCK, FROM_LEFT, INDEX_BITS, MAX_STRIDE, NO_KEY, SelectedBlock, aggregate_in_registers,
    is_whole, key_at, key_tails, other_of, place,
};

/// Bytes per register.
const LANES: usize = 32;

type Costs = [__m256i; 2];
/// Two registers of keys of even disparities, then two of odd ones.
type Keys = [[__m256i; 2]; 2];

aggregate_in_registers!("avx2");

/// Takes one step along a path.
#[target_feature(enable = "avx2")]
#[inline]
fn step_path<const FULL: bool>([a, b]: Costs, costs: Costs, p1: Costs, p2: Costs) -> Costs {
    let guard = _mm256_set1_epi8(-1);
    // Neighbouring 16-byte halves, from which the shifts below take their incoming bytes.
    let before_a = _mm256_permute2x128_si256::<0x20>(guard, a);
    let between = _mm256_permute2x128_si256::<0x21>(a, b);
    let after_b = _mm256_permute2x128_si256::<0x21>(b, guard);
    let least = least_cost([a, b]);
    let step = |same, below, above, costs, p1, p2| {
        let step = _mm256_adds_epu8(_mm256_min_epu8(below, above), p1);
        // No path cost is below the least.
        let onward = _mm256_sub_epi8(_mm256_min_epu8(same, step), least);
        _mm256_adds_epu8(costs, _mm256_min_epu8(onward, p2))
    };
    let below = [
        _mm256_alignr_epi8::<15>(a, before_a),
        _mm256_alignr_epi8::<15>(b, between),
    ];
    let above = [
        _mm256_alignr_epi8::<1>(between, a),
        _mm256_alignr_epi8::<1>(after_b, b),
    ];
    [
        step(a, below[0], above[0], costs[0], p1[0], p2[0]),
        step(b, below[1], above[1], costs[1], p1[1], p2[1]),
    ]
}

/// Returns the least byte, in all bytes.
#[target_feature(enable = "avx2")]
#[inline]
fn least_cost([a, b]: Costs) -> __m256i {
    let half = _mm256_min_epu8(a, b);
    let quarter = _mm_min_epu8(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    // The lower byte of each word is the lesser of its two bytes, the upper one 0.
    let words = _mm_min_epu8(quarter, _mm_srli_epi16::<8>(quarter));
    _mm256_broadcastb_epi8(_mm_minpos_epu16(words))
}

#[target_feature(enable = "avx2")]
#[inline]
fn join([a, b, c]: [Costs; 3], tails: Keys) -> Keys {
    let even = |costs| _mm256_and_si256(costs, _mm256_set1_epi16(255));
    let odd = |costs| _mm256_srli_epi16::<8>(costs);
    let key = |a, b, c, tail| {
        let sum = _mm256_add_epi16(_mm256_add_epi16(a, b), c);
        _mm256_or_si256(_mm256_slli_epi16::<{ INDEX_BITS as i32 }>(sum), tail)
    };
    [
        [
            key(even(a[0]), even(b[0]), even(c[0]), tails[0][0]),
            key(even(a[1]), even(b[1]), even(c[1]), tails[0][1]),
        ],
        [
            key(odd(a[0]), odd(b[0]), odd(c[0]), tails[1][0]),
            key(odd(a[1]), odd(b[1]), odd(c[1]), tails[1][1]),
        ],
    ]
}

#[target_feature(enable = "avx2")]
#[inline]
fn lesser([a, b]: Keys, [c, d]: Keys) -> Keys {
    [
        [_mm256_min_epu16(a[0], c[0]), _mm256_min_epu16(a[1], c[1])],
        [_mm256_min_epu16(b[0], d[0]), _mm256_min_epu16(b[1], d[1])],
    ]
}

#[target_feature(enable = "avx2")]
#[inline]
fn advance([even, odd]: Keys) -> Keys {
    let no_key = _mm256_set1_epi16(NO_KEY.cast_signed());
    let before = _mm256_permute2x128_si256::<0x21>(no_key, odd[0]);
    let between = _mm256_permute2x128_si256::<0x21>(odd[0], odd[1]);
    [
        [
            _mm256_alignr_epi8::<14>(odd[0], before),
            _mm256_alignr_epi8::<14>(odd[1], between),
        ],
        even,
    ]
}

/// Returns the key in a place.
#[target_feature(enable = "avx2")]
#[inline]
fn key_in(keys: Keys, place: usize) -> u16 {
    words(keys)[place % MAX_STRIDE]
}

#[target_feature(enable = "avx2")]
#[inline]
fn least_key([even, odd]: Keys) -> u16 {
    let half = _mm256_min_epu16(
        _mm256_min_epu16(even[0], even[1]),
        _mm256_min_epu16(odd[0], odd[1]),
    );
    let quarter = _mm_min_epu16(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    _mm_cvtsi128_si32(_mm_minpos_epu16(quarter)) as u16
}

#[target_feature(enable = "avx2")]
#[inline]
fn broadcast(cost: u8) -> Costs {
    [_mm256_set1_epi8(cost.cast_signed()); 2]
}

#[target_feature(enable = "avx2")]
#[inline]
fn are_equal(a: Costs, b: Costs) -> bool {
    let differing = _mm256_or_si256(_mm256_xor_si256(a[0], b[0]), _mm256_xor_si256(a[1], b[1]));
    _mm256_testz_si256(differing, differing) == 1
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(costs: &[u8]) -> Costs {
    [
        load_half(costs),
        load_half(costs.get(LANES..).unwrap_or_default()),
    ]
}

/// Loads the first 32 or 16 bytes, as many as there are; all others are 255.
#[target_feature(enable = "avx2")]
#[inline]
fn load_half(costs: &[u8]) -> __m256i {
    let none = _mm256_set1_epi8(-1);
    if let Some(costs) = costs.first_chunk::<LANES>() {
        // SAFETY: the array has the register's 32 bytes; the load needs no alignment.
        unsafe { _mm256_loadu_si256(costs.as_ptr().cast()) }
    } else if let Some(costs) = costs.first_chunk::<{ LANES / 2 }>() {
        // SAFETY: the array has 16 bytes; the load needs no alignment.
        let half = unsafe { _mm_loadu_si128(costs.as_ptr().cast()) };
        _mm256_inserti128_si256::<0>(none, half)
    } else {
        none
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn store(costs: &mut [u8], registers: Costs) {
    for (costs, register) in costs.chunks_mut(LANES).zip(registers) {
        if let Some(costs) = costs.first_chunk_mut::<LANES>() {
            // SAFETY: the array has the register's 32 bytes; the store needs no alignment.
            unsafe { _mm256_storeu_si256(costs.as_mut_ptr().cast(), register) };
        } else if let Some(costs) = costs.first_chunk_mut::<{ LANES / 2 }>() {
            let half = _mm256_castsi256_si128(register);
            // SAFETY: the array has 16 bytes; the store needs no alignment.
            unsafe { _mm_storeu_si128(costs.as_mut_ptr().cast(), half) };
        }
    }
}
