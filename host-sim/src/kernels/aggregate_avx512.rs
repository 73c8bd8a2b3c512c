//! Aggregation of up to 64 disparities in AVX-512: the path costs of a pixel are one
//! register, from pixel to pixel.

use std::arch::x86_64::*;

use vgstereo_core::aggregation::{self, AggregateRow, parabola_q4};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::matching::NO_DISTANCE;

/// Most disparities, rounded up, that a register holds.
const MAX_STRIDE: usize = 64;

/// Pixels whose disparities are written together.
const BLOCK: usize = 32;

/// Key of no match: above those of all sums.
const NO_KEY: u16 = u16::MAX;

/// A key is a sum, at most 3 times 255, and 6 bits of index below it: the least key is
/// the first of the least sums.
const INDEX_BITS: u32 = 6;

/// The same as core's `aggregate_row`, and that itself for more disparities.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
pub fn aggregate_row(row: &mut AggregateRow<'_>) {
    if row.stride > MAX_STRIDE {
        aggregation::aggregate_row(row);
    } else {
        aggregate_register(row);
    }
}

/// The same for strides of at most [`MAX_STRIDE`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
fn aggregate_register(row: &mut AggregateRow<'_>) {
    let (stride, count) = (row.stride.min(MAX_STRIDE), row.best.len());
    row.other_best.fill(u32::MAX);
    if stride == 0 || count == 0 {
        return;
    }
    let p1 = broadcast(row.p1);

    // From the right, over the penalties between a pixel and the one on its right. Each of
    // these waits for the one before; the path down, which does not, fills the time.
    let pixels = row
        .costs
        .chunks_exact(stride)
        .zip(row.from_right.chunks_exact_mut(stride))
        .zip(row.from_above.chunks_exact_mut(stride));
    let penalties = std::iter::once(&0).chain(row.p2_along.iter().skip(1).rev());
    let penalties = penalties.zip(row.p2_down.iter().rev());
    let mut path = _mm512_setzero_si512();
    for (index, (((costs, from_right), from_above), (&p2_along, &p2_down))) in
        pixels.rev().zip(penalties).enumerate()
    {
        let costs = load(costs);
        path = if index == 0 {
            costs
        } else {
            step_path(path, costs, p1, broadcast(p2_along))
        };
        store(from_right, path);
        let down = if row.is_first {
            costs
        } else {
            step_path(load(from_above), costs, p1, broadcast(p2_down))
        };
        store(from_above, down);
    }

    // From the left; all three are there, so each pixel is decided at once.
    let blocks = row
        .costs
        .chunks(stride * BLOCK)
        .zip(row.from_right.chunks(stride * BLOCK))
        .zip(row.from_above.chunks(stride * BLOCK))
        .zip(row.p2_along.chunks(BLOCK));
    let outputs = row
        .best
        .chunks_mut(BLOCK)
        .zip(row.refined_q4.chunks_mut(BLOCK))
        .zip(row.margins.chunks_mut(BLOCK));
    let disparities = row.disparities.clamp(1, stride);
    let in_range = u64::MAX >> (MAX_STRIDE - disparities);
    let indices = indices();
    let last_index = _mm512_set1_epi16(disparities as i16 - 1);
    // The best matches of the other view's pixels that this pixel's disparities reach, as
    // keys: of the next pixel they are one further on.
    let no_key = _mm512_set1_epi16(NO_KEY.cast_signed());
    let mut others = [no_key; 2];
    let mut others_end = count + disparities - 1;
    let mut selected = SelectedBlock::default();
    for (block, ((((costs, from_right), from_above), p2_along), outputs)) in
        blocks.zip(outputs).enumerate()
    {
        let pixels = costs
            .chunks_exact(stride)
            .zip(from_right.chunks_exact(stride))
            .zip(from_above.chunks_exact(stride))
            .zip(p2_along);
        for (lane, (((costs, from_right), from_above), &p2)) in pixels.enumerate().take(BLOCK) {
            let costs = load(costs);
            path = if block == 0 && lane == 0 {
                costs
            } else {
                step_path(path, costs, p1, broadcast(p2))
            };
            let sums = sum_paths([path, load(from_right), load(from_above)]);
            let key = |half: usize| {
                let key =
                    _mm512_or_si512(_mm512_slli_epi16::<INDEX_BITS>(sums[half]), indices[half]);
                _mm512_mask_mov_epi16(no_key, (in_range >> (32 * half)) as u32, key)
            };
            let keys = [key(0), key(1)];
            let entering = _mm512_set1_epi64(-1);
            let shifted = [
                shift_in(entering, others[0]),
                shift_in(others[0], others[1]),
            ];
            others = [
                _mm512_min_epu16(shifted[0], keys[0]),
                _mm512_min_epu16(shifted[1], keys[1]),
            ];
            // No later pixel reaches the last.
            let leaving = _mm512_permutex2var_epi16(others[0], last_index, others[1]);
            selected.others[lane] = _mm_cvtsi128_si32(_mm512_castsi512_si128(leaving)) as u16;

            let least = least_key(keys);
            let index = usize::from(least) % MAX_STRIDE;
            // All but the best and its neighbours; the last may have none after it.
            let around = (3_u64 << index) | (1_u64 << index >> 1);
            let rest = |half: usize| {
                _mm512_mask_mov_epi16(keys[half], (around >> (32 * half)) as u32, no_key)
            };
            selected.least[lane] = least;
            selected.second[lane] = least_key([rest(0), rest(1)]);
            // One place on, so that the first has a place before it.
            let mut places = [0; MAX_STRIDE + 2];
            store_words(&mut places[1..=MAX_STRIDE], sums);
            selected.before[lane] = places[index];
            selected.after[lane] = places[index + 2];
        }
        let ((best, refined_q4), margins) = outputs;
        selected.write(disparities, best, refined_q4, margins);
        let others_start = others_end - best.len();
        if let Some(other_best) = row.other_best.get_mut(others_start..others_end) {
            for (other, &key) in other_best.iter_mut().rev().zip(&selected.others) {
                *other = other_of(key);
            }
        }
        others_end = others_start;
    }
    let mut first_others = [0; MAX_STRIDE];
    store_words(&mut first_others, others);
    for (other, &key) in row.other_best.iter_mut().zip(&first_others[..disparities]) {
        *other = other_of(key.cast_unsigned());
    }
}

/// What is known of the pixels of a block before it is written, side by side: the loops
/// over them become vector code.
#[derive(Debug, Default)]
struct SelectedBlock {
    /// Keys of the best and of the best without it and its neighbours.
    least: [u16; BLOCK],
    second: [u16; BLOCK],
    /// Sums beside the best; anything at the ends of the range.
    before: [i16; BLOCK],
    after: [i16; BLOCK],
    /// Keys of the other view's pixels that are decided.
    others: [u16; BLOCK],
}

impl SelectedBlock {
    #[inline(always)]
    fn write(
        &self,
        disparities: usize,
        best: &mut [u16],
        refined_q4: &mut [i16],
        margins: &mut [i16],
    ) {
        let last = disparities as u16 - 1;
        let mut indices = [0; BLOCK];
        let mut refined = [0; BLOCK];
        let mut margin = [0; BLOCK];
        for lane in 0..BLOCK {
            let (least, second) = (self.least[lane], self.second[lane]);
            let index = least % MAX_STRIDE as u16;
            let sum = (least >> INDEX_BITS).cast_signed();
            let is_inside = (index > 0) & (index < last);
            let side = |side: i16| if is_inside { side - sum } else { 0 };
            let step_q4 = parabola_q4(side(self.before[lane]), side(self.after[lane]));
            indices[lane] = index;
            refined[lane] = index.cast_signed() * STEPS_PER_PX + step_q4;
            let second = match second {
                NO_KEY => NO_DISTANCE,
                key => (key >> INDEX_BITS).cast_signed(),
            };
            margin[lane] = second - sum;
        }
        let count = best.len();
        best.copy_from_slice(&indices[..count]);
        refined_q4.copy_from_slice(&refined[..count]);
        margins.copy_from_slice(&margin[..count]);
    }
}

/// A key as [`AggregateRow::other_best`] has it.
fn other_of(key: u16) -> u32 {
    match key {
        NO_KEY => u32::MAX,
        key => (u32::from(key >> INDEX_BITS) << 16) | (u32::from(key) % MAX_STRIDE as u32),
    }
}

/// One pixel along a path.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn step_path(previous: __m512i, costs: __m512i, p1: __m512i, p2: __m512i) -> __m512i {
    let guard = _mm512_set1_epi64(-1);
    // By whole quarters first, then by bytes within them.
    let quarter_before = _mm512_alignr_epi64::<6>(previous, guard);
    let below = _mm512_alignr_epi8::<15>(previous, quarter_before);
    let quarter_after = _mm512_alignr_epi64::<2>(guard, previous);
    let above = _mm512_alignr_epi8::<1>(quarter_after, previous);
    let step = _mm512_adds_epu8(_mm512_min_epu8(below, above), p1);
    // No path cost is below the least.
    let onward = _mm512_sub_epi8(_mm512_min_epu8(previous, step), least_byte(previous));
    _mm512_adds_epu8(costs, _mm512_min_epu8(onward, p2))
}

/// The least byte, in all bytes.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn least_byte(v: __m512i) -> __m512i {
    let half = _mm256_min_epu8(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v));
    let quarter = _mm_min_epu8(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    // The lower byte of each word is the lesser of both, the upper one 0.
    let words = _mm_min_epu8(quarter, _mm_srli_epi16::<8>(quarter));
    _mm512_broadcastb_epi8(_mm_minpos_epu16(words))
}

/// The least word.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn least_key([a, b]: [__m512i; 2]) -> u16 {
    let v = _mm512_min_epu16(a, b);
    let half = _mm256_min_epu16(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v));
    let quarter = _mm_min_epu16(
        _mm256_castsi256_si128(half),
        _mm256_extracti128_si256::<1>(half),
    );
    _mm_cvtsi128_si32(_mm_minpos_epu16(quarter)) as u16
}

/// Sums of three paths, as words.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn sum_paths([a, b, c]: [__m512i; 3]) -> [__m512i; 2] {
    let low = |v| _mm512_cvtepu8_epi16(_mm512_castsi512_si256(v));
    let high = |v| _mm512_cvtepu8_epi16(_mm512_extracti64x4_epi64::<1>(v));
    [
        _mm512_add_epi16(_mm512_add_epi16(low(a), low(b)), low(c)),
        _mm512_add_epi16(_mm512_add_epi16(high(a), high(b)), high(c)),
    ]
}

/// The words of `v` one place further on, the last of `before` before them.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn shift_in(before: __m512i, v: __m512i) -> __m512i {
    let quarter_before = _mm512_alignr_epi64::<6>(v, before);
    _mm512_alignr_epi8::<14>(v, quarter_before)
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn indices() -> [__m512i; 2] {
    let mut indices = [0_u8; MAX_STRIDE];
    for (byte, index) in indices.iter_mut().zip(0..) {
        *byte = index;
    }
    let zero = _mm512_setzero_si512();
    sum_paths([load(&indices), zero, zero])
}

#[target_feature(enable = "avx512f")]
#[inline]
fn broadcast(byte: u8) -> __m512i {
    _mm512_set1_epi8(byte.cast_signed())
}

/// Ones for the bytes of a register that a slice has.
#[inline]
fn mask_of(length: usize) -> u64 {
    if length < MAX_STRIDE {
        (1 << length) - 1
    } else {
        u64::MAX
    }
}

/// The bytes, at most 64; after them, 255.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn load(bytes: &[u8]) -> __m512i {
    // SAFETY: only the bytes that the slice has are read.
    unsafe {
        _mm512_mask_loadu_epi8(
            _mm512_set1_epi8(-1),
            mask_of(bytes.len()),
            bytes.as_ptr().cast(),
        )
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn store(bytes: &mut [u8], register: __m512i) {
    // SAFETY: only the bytes that the slice has are written.
    unsafe {
        _mm512_mask_storeu_epi8(bytes.as_mut_ptr().cast(), mask_of(bytes.len()), register);
    }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn store_words(words: &mut [i16], [a, b]: [__m512i; 2]) {
    let Some(words) = words.first_chunk_mut::<MAX_STRIDE>() else {
        return;
    };
    let (first, second) = words.split_at_mut(MAX_STRIDE / 2);
    // SAFETY: each half has the register's 64 bytes; the stores need no alignment.
    unsafe {
        _mm512_storeu_si512(first.as_mut_ptr().cast(), a);
        _mm512_storeu_si512(second.as_mut_ptr().cast(), b);
    }
}
