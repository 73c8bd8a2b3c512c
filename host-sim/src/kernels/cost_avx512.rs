//! Matching costs in AVX-512: the costs of up to 64 disparities of a pixel are the bytes of
//! one register.

use std::arch::x86_64::*;

use vgstereo_core::matching::{self, CostRun, MAX_CHANNELS, NO_COST, cost_stride};

/// Disparities side by side.
const LANES: usize = 64;

/// Planes whose differing cells are summed in 8 bits: at most 31 * 8 of them.
const PLANES_PER_SUM: usize = 31;

/// The same as core's `cost_run`, and that itself where a row is too short for the run.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bitalg")]
pub fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
    let masked = !row.masks.bytes.is_empty();
    let channels = match row.difference_weight_q4 {
        0 => 0,
        _ => row.channels,
    };
    match (is_inside(row, costs.len()), masked, channels) {
        (true, false, 0) => cost_pixels::<false, 0>(row, costs),
        (true, false, 1) => cost_pixels::<false, 1>(row, costs),
        (true, false, 3) => cost_pixels::<false, 3>(row, costs),
        (true, true, 0) => cost_pixels::<true, 0>(row, costs),
        (true, true, 1) => cost_pixels::<true, 1>(row, costs),
        (true, true, 3) => cost_pixels::<true, 3>(row, costs),
        _ => matching::cost_run(row, costs),
    }
}

/// Whether every byte that the run looks at is there.
fn is_inside(row: &CostRun<'_>, costs: usize) -> bool {
    let stride = cost_stride(row.disparities);
    let pixels = row.cell_costs_q8.len();
    let plane = |planes: usize, stride: usize| planes.saturating_sub(1) * stride;
    let count = row.inputs.count;
    let end = row.first_position + stride;
    let levels = row
        .levels
        .iter()
        .zip(row.other_low.iter().zip(row.other_high));
    stride > 0
        && pixels > 0
        && count > 0
        && costs == pixels * stride
        && row.first_position + 1 >= pixels
        && plane(count, row.stored.stride) + end <= row.stored.bytes.len()
        && plane(count, row.inputs.stride) + row.start + pixels <= row.inputs.bytes.len()
        && (row.masks.bytes.is_empty()
            || plane(count, row.masks.stride) + pixels <= row.masks.bytes.len())
        && (row.difference_weight_q4 == 0
            || levels.take(row.channels).all(|(levels, (low, high))| {
                row.start + pixels <= levels.len() && end <= low.len() && end <= high.len()
            }))
}

/// The costs of a run that [`is_inside`], with its masks and channels of levels.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bitalg")]
#[inline]
fn cost_pixels<const MASKED: bool, const CHANNELS: usize>(row: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(row.disparities);
    let zero = _mm512_setzero_si512();
    let word = |value: u8| _mm512_set1_epi16(value.into());
    let hamming_truncation = word(row.hamming_truncation);
    let difference_truncation = word(row.difference_truncation);
    let weight_q4 = word(row.difference_weight_q4);
    let pixels = costs.chunks_exact_mut(stride).zip(row.cell_costs_q8);
    for (x, (costs, &cell_cost_q8)) in pixels.enumerate() {
        let cell_cost_q8 = _mm512_set1_epi16(cell_cost_q8.cast_signed());
        let mut own = [zero; MAX_CHANNELS];
        for (own, levels) in own.iter_mut().zip(row.levels).take(CHANNELS) {
            *own = _mm512_set1_epi8(levels[row.start + x].cast_signed());
        }
        for (costs, start) in costs.chunks_mut(LANES).zip((0..).step_by(LANES)) {
            let lanes = u64::MAX >> (LANES - costs.len());
            let position = row.first_position - x + start;
            let [low, high] = differing_cells::<MASKED>(row, x, position, lanes);
            let cost = |cells| {
                let exact_q8 = _mm512_mullo_epi16(cells, cell_cost_q8);
                let rounded_q8 = _mm512_add_epi16(exact_q8, _mm512_set1_epi16(128));
                _mm512_min_epu16(_mm512_srli_epi16::<8>(rounded_q8), hamming_truncation)
            };
            let mut cost = [cost(low), cost(high)];
            if CHANNELS > 0 {
                let mut differences = [zero; 2];
                let others = row.other_low.iter().zip(row.other_high);
                for (&own, (low, high)) in own.iter().zip(others).take(CHANNELS) {
                    // SAFETY: `is_inside` has shown that all lanes are there.
                    let (low, high) =
                        unsafe { (load(low, position, lanes), load(high, position, lanes)) };
                    // One of the two is 0.
                    let difference =
                        _mm512_or_si512(_mm512_subs_epu8(own, high), _mm512_subs_epu8(low, own));
                    differences = add_bytes(differences, difference);
                }
                for (cost, difference) in cost.iter_mut().zip(differences) {
                    let mean = match CHANNELS {
                        1 => difference,
                        _ => _mm512_srli_epi16::<8>(_mm512_mullo_epi16(
                            difference,
                            _mm512_set1_epi16(85),
                        )),
                    };
                    let mean = _mm512_min_epu16(mean, difference_truncation);
                    let weighted = _mm512_srli_epi16::<4>(_mm512_mullo_epi16(mean, weight_q4));
                    *cost = _mm512_add_epi16(*cost, weighted);
                }
            }
            let mut cost = _mm512_packus_epi16(cost[0], cost[1]);
            if start + LANES > row.disparities {
                // All of a block's disparities may lie beyond the range.
                let inside = row.disparities.saturating_sub(start);
                let beyond = u64::MAX.checked_shl(inside as u32).unwrap_or(0);
                cost = _mm512_mask_mov_epi8(cost, beyond, _mm512_set1_epi8(NO_COST.cast_signed()));
            }
            // SAFETY: the lanes are the slice's.
            unsafe { _mm512_mask_storeu_epi8(costs.as_mut_ptr().cast(), lanes, cost) };
        }
    }
}

/// How many cells of pixel `x` of the run differ from those of the patterns at `position`
/// and after: as words, in the order of [`add_bytes`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bitalg")]
#[inline]
fn differing_cells<const MASKED: bool>(
    row: &CostRun<'_>,
    x: usize,
    position: usize,
    lanes: u64,
) -> [__m512i; 2] {
    let mut totals = [_mm512_setzero_si512(); 2];
    let mut plane = 0;
    while plane < row.inputs.count {
        let end = row.inputs.count.min(plane + PLANES_PER_SUM);
        let mut sums = _mm512_setzero_si512();
        for plane in plane..end {
            // SAFETY: `is_inside` has shown that these planes have the pixel and all lanes.
            unsafe {
                let input_at = row.inputs.stride * plane + row.start + x;
                let input = *row.inputs.bytes.get_unchecked(input_at);
                let input = _mm512_set1_epi8(input.cast_signed());
                let stored = load(
                    row.stored.bytes,
                    row.stored.stride * plane + position,
                    lanes,
                );
                let mut differing = _mm512_xor_si512(input, stored);
                if MASKED {
                    let mask_at = row.masks.stride * plane + x;
                    let mask = *row.masks.bytes.get_unchecked(mask_at);
                    differing = _mm512_and_si512(differing, _mm512_set1_epi8(mask.cast_signed()));
                }
                sums = _mm512_add_epi8(sums, _mm512_popcnt_epi8(differing));
            }
        }
        totals = add_bytes(totals, sums);
        plane = end;
    }
    totals
}

/// Adds bytes to words: to the first register the lower 8 of every 16 bytes, to the second
/// the upper ones. Packing the two restores the order.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn add_bytes([low, high]: [__m512i; 2], bytes: __m512i) -> [__m512i; 2] {
    let zero = _mm512_setzero_si512();
    [
        _mm512_add_epi16(low, _mm512_unpacklo_epi8(bytes, zero)),
        _mm512_add_epi16(high, _mm512_unpackhi_epi8(bytes, zero)),
    ]
}

/// The bytes from `start` on.
///
/// # Safety
/// The slice has a byte for each of `lanes`.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn load(bytes: &[u8], start: usize, lanes: u64) -> __m512i {
    // SAFETY: only `lanes` are read, which the caller promises.
    unsafe { _mm512_maskz_loadu_epi8(lanes, bytes.as_ptr().add(start).cast()) }
}
