//! Masks of a block in AVX2: the pixels of a block are the bytes of one register.

use core::arch::x86_64::*;

use vgstereo_core::kernel::{self, CELLS_PER_BYTE, MASK_LANES, MAX_CHANNELS, MaskBlock};

use crate::x86_64::mask::{is_inside, load_at};

/// Writes the masks of a block, as [`kernel::mask_block`] does. Calls it for blocks of fewer than
/// [`MASK_LANES`] pixels and for blocks that reach beyond the levels.
#[target_feature(enable = "avx2")]
pub(super) fn mask_block(block: &mut MaskBlock<'_>) {
    if !is_inside(block) {
        kernel::mask_block(block);
        return;
    }
    match block.channels {
        1 => compare::<1>(block),
        _ => compare::<MAX_CHANNELS>(block),
    }
    let cells = block.cells.as_chunks::<MASK_LANES>().0;
    let kept = _mm256_set1_epi16(block.kept.cast_signed());
    let mut thresholds = _mm256_set1_epi8(block.floor.cast_signed());
    let mut excess = block.step.get();
    let counts = loop {
        let counts = count_within(cells, thresholds);
        // All ones where the threshold keeps enough cells.
        let [even, odd] = counts;
        let even = _mm256_cmpeq_epi16(_mm256_max_epu16(even, kept), even);
        let odd = _mm256_cmpeq_epi16(_mm256_max_epu16(odd, kept), odd);
        let is_enough = _mm256_blendv_epi8(even, odd, _mm256_set1_epi16(-256));
        // Every difference is within the highest threshold.
        let is_highest = _mm256_cmpeq_epi8(thresholds, _mm256_set1_epi8(-1));
        if _mm256_movemask_epi8(_mm256_or_si256(is_enough, is_highest)) == -1 {
            break counts;
        }
        let higher = _mm256_set1_epi8(block.floor.saturating_add(excess).cast_signed());
        thresholds = _mm256_blendv_epi8(higher, thresholds, is_enough);
        excess = excess.saturating_mul(2);
    };
    let [even, odd] = [words(counts[0]), words(counts[1])];
    for ((pair, even), odd) in block.counts.as_chunks_mut().0.iter_mut().zip(even).zip(odd) {
        *pair = [even, odd];
    }
    let masks = block.masks.as_chunks_mut::<MASK_LANES>().0;
    let threshold = in_signed_order(thresholds);
    for (mask, cells) in masks.iter_mut().zip(cells.as_chunks::<CELLS_PER_BYTE>().0) {
        let mut bits = _mm256_setzero_si256();
        for cell in cells.iter().rev() {
            // Twice the bits so far, less -1 (all ones) where the difference is beyond the
            // threshold.
            let beyond = _mm256_cmpgt_epi8(load(cell), threshold);
            bits = _mm256_sub_epi8(_mm256_add_epi8(bits, bits), beyond);
        }
        store(mask, _mm256_xor_si256(bits, _mm256_set1_epi8(-1)));
    }
}

/// Writes the difference of each cell of a block that [`is_inside`]: the larger of its two samples'
/// differences from the centre, summed over the channels and at most 255. The bytes are in signed
/// order; see [`in_signed_order`].
#[target_feature(enable = "avx2")]
#[inline]
fn compare<const CHANNELS: usize>(block: &mut MaskBlock<'_>) {
    let levels: [&[u8]; CHANNELS] = core::array::from_fn(|channel| block.levels[channel]);
    // SAFETY: `is_inside` has shown that the block's pixels are there.
    let centres = levels.map(|levels| unsafe { load_at(levels, block.centre) });
    let difference = |start: u32| {
        let mut sum = _mm256_setzero_si256();
        for (centre, levels) in centres.iter().zip(levels) {
            // SAFETY: `is_inside` has shown that the synapse's samples are there.
            let samples = unsafe { load_at(levels, start as usize + block.first) };
            // One of the two differences is 0.
            let difference = _mm256_or_si256(
                _mm256_subs_epu8(*centre, samples),
                _mm256_subs_epu8(samples, *centre),
            );
            sum = _mm256_adds_epu8(sum, difference);
        }
        sum
    };
    let Some(&first) = block.starts.first() else {
        return;
    };
    // A synapse's partner is the next synapse; the partner of the last is the first.
    let mut partner = difference(first);
    let cells = block.cells.as_chunks_mut::<MASK_LANES>().0;
    for (cell, &start) in cells.iter_mut().zip(block.starts).rev() {
        let own = difference(start);
        store(cell, in_signed_order(_mm256_max_epu8(own, partner)));
        partner = own;
    }
}

/// Counts the cells of each pixel whose difference is within its threshold: a register of even
/// pixels, then one of odd pixels. The cells are in signed order.
#[target_feature(enable = "avx2")]
#[inline]
fn count_within(cells: &[[u8; MASK_LANES]], thresholds: __m256i) -> [__m256i; 2] {
    let thresholds = in_signed_order(thresholds);
    // At most 1024 cells.
    let all = _mm256_set1_epi16(cells.len() as i16);
    let (mut even, mut odd) = (all, all);
    // Patterns are whole bytes of cells; the cells of a group of bytes are counted in 8 bits.
    let bytes = cells.as_chunks::<CELLS_PER_BYTE>().0;
    for group in bytes.chunks(u8::MAX as usize / CELLS_PER_BYTE) {
        let mut beyond = _mm256_setzero_si256();
        for cells in group {
            // Two partial counts, so that additions do not wait for each other.
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

/// Maps unsigned bytes to signed ones in the same order, because AVX2 compares only signed bytes.
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
