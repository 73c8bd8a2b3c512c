//! Weighted median in AVX-512: 32 pixels side by side, a register of words.

use std::arch::x86_64::*;

use vgstereo_core::disparity::INVALID;
use vgstereo_core::refine::{self, WeightedMedianRow};

/// Pixels filtered side by side.
const LANES: usize = 32;

/// Taps that have weights here: the most that a configuration may ask for.
const MAX_TAPS: usize = 363;

/// The same as core's `weighted_median_row`, and that itself for short rows.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
pub fn weighted_median_row(row: &WeightedMedianRow<'_>, weights: &mut [u8], output: &mut [i16]) {
    let width = output.len();
    let taps = (0..row.rows).map(|index| row.tap_columns(index).count());
    let taps: usize = taps.sum();
    if width < LANES || taps > MAX_TAPS || taps > row.places.len() || row.window_width == 0 {
        refine::weighted_median_row(row, weights, output);
        return;
    }
    // Words, on the host's stack.
    let mut weights = [[0; LANES]; MAX_TAPS];
    // The last block overlaps the one before rather than leave a rest.
    for x in (0..width).step_by(LANES) {
        let x = x.min(width - LANES);
        if let Some(output) = output[x..].first_chunk_mut() {
            filter_block(row, x, &mut weights[..taps], output);
        }
    }
}

/// Filters the pixels from `x` on.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn filter_block(
    row: &WeightedMedianRow<'_>,
    x: usize,
    weights: &mut [[i16; LANES]],
    output: &mut [i16; LANES],
) {
    // Grey counts as three equal channels.
    let [a, b, c] = if row.channels == 1 { [0; 3] } else { [0, 1, 2] };
    let run = x..x + row.window_width - 1 + LANES;
    let centre = |channel: usize| load_bytes(&row.centres[channel][x..x + LANES]);
    let centres = [centre(a), centre(b), centre(c)];
    let reach = _mm512_set1_epi16(row.colour_reach.into());
    let invalid = _mm512_set1_epi16(INVALID);
    let mut totals = _mm512_setzero_si512();
    let mut low = _mm512_set1_epi16(i16::MAX);
    let mut high = _mm512_set1_epi16(i16::MIN);
    let mut places = weights.iter_mut().zip(row.places);
    for index in 0..row.rows {
        let taps = run.start + row.first_tap(index)..run.end;
        let values = row.values[index][taps.clone()].windows(LANES);
        let levels = |channel: usize| row.levels[channel][index][taps.clone()].windows(LANES);
        let taps = values.zip(levels(a)).zip(levels(b)).zip(levels(c));
        for ((((values, a), b), c), (weights, &place)) in taps.step_by(2).zip(places.by_ref()) {
            let values = load_words(values);
            let [a, b, c] = [
                distance(centres[0], load_bytes(a)),
                distance(centres[1], load_bytes(b)),
                distance(centres[2], load_bytes(c)),
            ];
            // Cut off at 255, where nothing weighs any more.
            let difference = _mm256_adds_epu8(_mm256_adds_epu8(a, b), c);
            let likeness = _mm512_subs_epu16(reach, _mm512_cvtepu8_epi16(difference));
            let square = _mm512_srli_epi16::<4>(_mm512_mullo_epi16(likeness, likeness));
            let place = _mm512_set1_epi16(place.into());
            let weight = _mm512_srli_epi16::<4>(_mm512_mullo_epi16(square, place));
            let is_there = _mm512_cmpneq_epi16_mask(values, invalid);
            let weight = _mm512_maskz_mov_epi16(is_there, weight);
            store_words(weights, weight);
            totals = _mm512_add_epi16(totals, weight);
            let weighs = _mm512_test_epi16_mask(weight, weight);
            low = _mm512_mask_min_epi16(low, weighs, low, values);
            high = _mm512_mask_max_epi16(high, weighs, high, values);
        }
    }
    let is_known = _mm512_test_epi16_mask(totals, totals);
    // Bisection: the smallest value at or below which lies half of the weight.
    loop {
        let is_open = _mm512_cmplt_epi16_mask(low, high);
        if is_open == 0 {
            break;
        }
        // Rounded down, without overflow.
        let middle = _mm512_add_epi16(
            _mm512_and_si512(low, high),
            _mm512_srai_epi16::<1>(_mm512_xor_si512(low, high)),
        );
        let mut below = _mm512_setzero_si512();
        let mut weights = weights.iter();
        for (index, values) in row.values.iter().enumerate().take(row.rows) {
            let values = values[run.start + row.first_tap(index)..run.end].windows(LANES);
            for (values, weights) in values.step_by(2).zip(weights.by_ref()) {
                let counts = _mm512_cmple_epi16_mask(load_words(values), middle);
                below = _mm512_mask_add_epi16(below, counts, below, load_words(weights));
            }
        }
        let rest = _mm512_sub_epi16(totals, below);
        let at_or_below = _mm512_cmpge_epu16_mask(below, rest);
        high = _mm512_mask_mov_epi16(high, is_open & at_or_below, middle);
        let next = _mm512_add_epi16(middle, _mm512_set1_epi16(1));
        low = _mm512_mask_mov_epi16(low, is_open & !at_or_below, next);
    }
    store_words(output, _mm512_mask_mov_epi16(invalid, is_known, low));
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn distance(a: __m256i, b: __m256i) -> __m256i {
    _mm256_or_si256(_mm256_subs_epu8(a, b), _mm256_subs_epu8(b, a))
}

/// The first bytes; all 0 where there are fewer than [`LANES`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn load_bytes(bytes: &[u8]) -> __m256i {
    let Some(bytes) = bytes.first_chunk::<LANES>() else {
        return _mm256_setzero_si256();
    };
    // SAFETY: the array has the register's 32 bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(bytes.as_ptr().cast()) }
}

/// The first words; all 0 where there are fewer than [`LANES`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn load_words(words: &[i16]) -> __m512i {
    let Some(words) = words.first_chunk::<LANES>() else {
        return _mm512_setzero_si512();
    };
    // SAFETY: the array has the register's 64 bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(words.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn store_words(words: &mut [i16; LANES], register: __m512i) {
    // SAFETY: the array has the register's 64 bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(words.as_mut_ptr().cast(), register) }
}
