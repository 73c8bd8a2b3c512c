//! Aggregation of up to 64 disparities in AVX-512: the path costs of a pixel take one register.

use core::arch::x86_64::*;

use vgstereo_core::kernel::{self, AggregateRow};

use super::mask_of;
use crate::x86_64::aggregate::{
    BLOCK, FROM_LEFT, INDEX_BITS, MAX_STRIDE, NO_KEY, SelectedBlock, aggregate_in_registers,
    is_whole, key_at, key_tails, other_of, place,
};

type Costs = __m512i;
type Keys = [__m512i; 2];

aggregate_in_registers!("avx512f,avx512bw,avx512vl,avx512vbmi");

/// Permutations that bring each place the value of the place below or above it, cyclically.
static BELOW: [u8; MAX_STRIDE] = places_from(MAX_STRIDE - 1);
static ABOVE: [u8; MAX_STRIDE] = places_from(1);

const fn places_from(first: usize) -> [u8; MAX_STRIDE] {
    let mut places = [0; MAX_STRIDE];
    let mut place = 0;
    while place < MAX_STRIDE {
        places[place] = ((first + place) % MAX_STRIDE) as u8;
        place += 1;
    }
    places
}

/// All ones in the first or last place, 0 elsewhere: a guard against values that came round the
/// end, because costs of all ones are never the least.
static FIRST: [u8; MAX_STRIDE] = guard_at(0);
static LAST: [u8; MAX_STRIDE] = guard_at(MAX_STRIDE - 1);

const fn guard_at(place: usize) -> [u8; MAX_STRIDE] {
    let mut guard = [0; MAX_STRIDE];
    guard[place] = u8::MAX;
    guard
}

/// Takes one step along a path.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn step_path<const FULL: bool>(previous: Costs, costs: Costs, p1: Costs, p2: Costs) -> Costs {
    let mut below = _mm512_permutexvar_epi8(load(&BELOW), previous);
    let mut above = _mm512_permutexvar_epi8(load(&ABOVE), previous);
    // Unless all places have disparities, the last place has the highest cost and is the guard for
    // both ends.
    if FULL {
        below = _mm512_or_si512(below, load(&FIRST));
        above = _mm512_or_si512(above, load(&LAST));
    }
    let step = _mm512_adds_epu8(_mm512_min_epu8(below, above), p1);
    // No path cost is below the least.
    let onward = _mm512_sub_epi8(_mm512_min_epu8(previous, step), least_cost(previous));
    _mm512_adds_epu8(costs, _mm512_min_epu8(onward, p2))
}

/// Returns the least byte, in all bytes.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn least_cost(costs: Costs) -> Costs {
    let half = _mm256_min_epu8(
        _mm512_castsi512_si256(costs),
        _mm512_extracti64x4_epi64::<1>(costs),
    );
    let quarter = _mm_min_epu8(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    // The lower byte of each word is the lesser of its two bytes, the upper one 0.
    let words = _mm_min_epu8(quarter, _mm_srli_epi16::<8>(quarter));
    _mm512_broadcastb_epi8(_mm_minpos_epu16(words))
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn join([a, b, c]: [Costs; 3], tails: Keys) -> Keys {
    let even = |costs| _mm512_and_si512(costs, _mm512_set1_epi16(255));
    let odd = |costs| _mm512_srli_epi16::<8>(costs);
    let key = |a, b, c, tail| {
        let sum = _mm512_add_epi16(_mm512_add_epi16(a, b), c);
        _mm512_or_si512(_mm512_slli_epi16::<INDEX_BITS>(sum), tail)
    };
    [
        key(even(a), even(b), even(c), tails[0]),
        key(odd(a), odd(b), odd(c), tails[1]),
    ]
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn lesser(a: Keys, b: Keys) -> Keys {
    [_mm512_min_epu16(a[0], b[0]), _mm512_min_epu16(a[1], b[1])]
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn advance([even, odd]: Keys) -> Keys {
    let words = |bytes| _mm512_cvtepu8_epi16(_mm512_castsi512_si256(bytes));
    let before = _mm512_permutexvar_epi16(words(load(&BELOW)), odd);
    let first = _mm512_set_epi64(0, 0, 0, 0, 0, 0, 0, NO_KEY.into());
    [_mm512_or_si512(before, first), even]
}

/// Returns the key in a place.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn key_in([even, odd]: Keys, place: usize) -> u16 {
    let place = _mm512_set1_epi16(place as i16);
    let keys = _mm512_permutex2var_epi16(even, place, odd);
    _mm512_cvtsi512_si32(keys) as u16
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn least_key(keys: Keys) -> u16 {
    let v = _mm512_min_epu16(keys[0], keys[1]);
    let half = _mm256_min_epu16(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v));
    let quarter = _mm_min_epu16(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    _mm_cvtsi128_si32(_mm_minpos_epu16(quarter)) as u16
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn broadcast(cost: u8) -> Costs {
    _mm512_set1_epi8(cost.cast_signed())
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn are_equal(a: Costs, b: Costs) -> bool {
    _mm512_cmpneq_epi8_mask(a, b) == 0
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn load(costs: &[u8]) -> Costs {
    // SAFETY: only the bytes that the slice has are read.
    unsafe {
        _mm512_mask_loadu_epi8(
            _mm512_set1_epi8(-1),
            mask_of(costs.len()),
            costs.as_ptr().cast(),
        )
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi")]
#[inline]
fn store(costs: &mut [u8], register: Costs) {
    // SAFETY: only the bytes that the slice has are written.
    unsafe {
        _mm512_mask_storeu_epi8(costs.as_mut_ptr().cast(), mask_of(costs.len()), register);
    }
}
