//! Masks of a whole block in AVX2: its pixels are the bytes of one register.

use std::arch::x86_64::*;

use vgstereo_core::matching::{MASK_LANES, MaskBlock};
use vgstereo_core::minchinton::CELLS_PER_BYTE;

/// The same as core's `mask_block`, for blocks of [`MASK_LANES`] pixels.
#[target_feature(enable = "avx2")]
pub fn mask_block(block: &mut MaskBlock<'_>) {
    let cells = block.differences.as_chunks_mut::<MASK_LANES>().0;
    let Some(first) = cells.first() else { return };
    let mut partner = load(first);
    for cell in cells.iter_mut().rev() {
        let own = load(cell);
        store(cell, in_signed_order(_mm256_max_epu8(own, partner)));
        partner = own;
    }
    let cells = &*cells;
    let kept = _mm256_set1_epi16(block.kept.cast_signed());
    let one = _mm256_set1_epi8(1);
    let mut low = _mm256_set1_epi8(block.floor.cast_signed());
    let mut high = _mm256_set1_epi8(-1);
    let mut middle = low;
    let counts = loop {
        let counts = count_within(cells, middle);
        // All ones where the threshold keeps enough.
        let [even, odd] = counts;
        let even = _mm256_cmpeq_epi16(_mm256_max_epu16(even, kept), even);
        let odd = _mm256_cmpeq_epi16(_mm256_max_epu16(odd, kept), odd);
        let is_enough = _mm256_blendv_epi8(even, odd, _mm256_set1_epi16(-256));
        high = _mm256_blendv_epi8(high, middle, is_enough);
        low = _mm256_blendv_epi8(_mm256_adds_epu8(middle, one), low, is_enough);
        low = _mm256_min_epu8(low, high);
        let is_done = _mm256_cmpeq_epi8(low, high);
        if _mm256_movemask_epi8(is_done) == -1 {
            // These are the counts unless a lane's threshold is an earlier one.
            let at_last = _mm256_cmpeq_epi8(high, middle);
            if _mm256_movemask_epi8(at_last) == -1 {
                break counts;
            }
            break count_within(cells, high);
        }
        let width = _mm256_sub_epi8(high, low);
        // Half of it, without what the shift brings in from the byte above.
        let half = _mm256_and_si256(_mm256_srli_epi16(width, 1), _mm256_set1_epi8(0x7f));
        middle = _mm256_add_epi8(low, half);
    };
    let [even, odd] = [words(counts[0]), words(counts[1])];
    for ((pair, even), odd) in block.counts.as_chunks_mut().0.iter_mut().zip(even).zip(odd) {
        *pair = [even, odd];
    }
    let masks = block.masks.as_chunks_mut::<MASK_LANES>().0;
    let threshold = in_signed_order(high);
    for (mask, cells) in masks.iter_mut().zip(cells.as_chunks::<CELLS_PER_BYTE>().0) {
        let mut bits = _mm256_setzero_si256();
        for cell in cells.iter().rev() {
            // Twice the bits, plus one where the cell does not count.
            let beyond = _mm256_cmpgt_epi8(load(cell), threshold);
            bits = _mm256_sub_epi8(_mm256_add_epi8(bits, bits), beyond);
        }
        store(mask, _mm256_xor_si256(bits, _mm256_set1_epi8(-1)));
    }
}

/// How many cells of each pixel are within its threshold: of pixels with even places, and
/// of those with odd ones. Cells are in signed order.
#[target_feature(enable = "avx2")]
#[inline]
fn count_within(cells: &[[u8; MASK_LANES]], thresholds: __m256i) -> [__m256i; 2] {
    let thresholds = in_signed_order(thresholds);
    // At most 1024 cells.
    let all = _mm256_set1_epi16(cells.len() as i16);
    let (mut even, mut odd) = (all, all);
    // Patterns are whole bytes of cells; those of a group are counted in 8 bits.
    let bytes = cells.as_chunks::<CELLS_PER_BYTE>().0;
    for group in bytes.chunks(u8::MAX as usize / CELLS_PER_BYTE) {
        let mut beyond = _mm256_setzero_si256();
        for cells in group {
            // In two halves, so that not each waits for the one before.
            let (mut a, mut b) = (_mm256_setzero_si256(), _mm256_setzero_si256());
            let (first, second) = cells.split_at(CELLS_PER_BYTE / 2);
            for (first, second) in first.iter().zip(second) {
                a = _mm256_add_epi8(a, _mm256_cmpgt_epi8(load(first), thresholds));
                b = _mm256_add_epi8(b, _mm256_cmpgt_epi8(load(second), thresholds));
            }
            beyond = _mm256_sub_epi8(beyond, _mm256_add_epi8(a, b));
        }
        even = _mm256_sub_epi16(even, _mm256_and_si256(beyond, _mm256_set1_epi16(255)));
        odd = _mm256_sub_epi16(odd, _mm256_srli_epi16(beyond, 8));
    }
    [even, odd]
}

/// Unsigned bytes as signed ones in the same order: there is one comparison for those.
#[target_feature(enable = "avx2")]
#[inline]
fn in_signed_order(bytes: __m256i) -> __m256i {
    _mm256_xor_si256(bytes, _mm256_set1_epi8(i8::MIN))
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(bytes: &[u8; MASK_LANES]) -> __m256i {
    // SAFETY: the array has the register's 32 bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(bytes.as_ptr().cast()) }
}

#[target_feature(enable = "avx2")]
#[inline]
fn store(bytes: &mut [u8; MASK_LANES], register: __m256i) {
    // SAFETY: the array has the register's 32 bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(bytes.as_mut_ptr().cast(), register) }
}

#[target_feature(enable = "avx2")]
#[inline]
fn words(register: __m256i) -> [u16; 16] {
    let mut words = [0; 16];
    // SAFETY: the array has the register's 32 bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(words.as_mut_ptr().cast(), register) };
    words
}
