//! Masks of a block in AVX-512: the pixels of a block are the bytes of half a register, which
//! therefore holds two cells of each pixel.

use core::arch::x86_64::*;

use vgstereo_core::kernel::{self, CELLS_PER_BYTE, MASK_LANES, MAX_CHANNELS, MaskBlock};

use crate::x86_64::mask::{is_inside, load_at};

/// Bytes per register.
const LANES: usize = 2 * MASK_LANES;

/// Number of registers whose cells are counted in 8 bits before the counts are widened.
const REGISTERS_PER_COUNT: usize = u8::MAX as usize;

/// Writes the masks of a block, as [`kernel::mask_block`] does. Calls it for blocks of fewer than
/// [`MASK_LANES`] pixels and for blocks that reach beyond the levels.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
pub(super) fn mask_block(block: &mut MaskBlock<'_>) {
    if !is_inside(block) {
        kernel::mask_block(block);
        return;
    }
    let mut thresholds = _mm512_set1_epi8(block.floor.cast_signed());
    let mut counts = match block.channels {
        1 => compare::<1>(block, thresholds),
        _ => compare::<MAX_CHANNELS>(block, thresholds),
    };
    let cells = block.cells.as_chunks::<LANES>().0;
    let kept = _mm512_set1_epi16(block.kept.cast_signed());
    let mut excess = block.step.get();
    loop {
        // One bit per pixel: whether the threshold keeps enough cells.
        let is_enough = u64::from(_mm512_cmpge_epu16_mask(counts, kept));
        // Every difference is within the highest threshold.
        let is_highest = _mm512_cmpeq_epi8_mask(thresholds, _mm512_set1_epi8(-1));
        let is_done = is_enough << MASK_LANES | is_enough | is_highest;
        if is_done == u64::MAX {
            break;
        }
        let higher = _mm512_set1_epi8(block.floor.saturating_add(excess).cast_signed());
        thresholds = _mm512_mask_blend_epi8(is_done, higher, thresholds);
        excess = excess.saturating_mul(2);
        counts = count_within(cells, thresholds);
    }
    // SAFETY: the array has the register's 64 bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(block.counts.as_mut_ptr().cast(), counts) };
    write_masks(cells, thresholds, block.masks);
}

/// Writes the difference of each cell of a block that [`is_inside`]: the larger of its two samples'
/// differences from the centre, summed over the channels and at most 255. Returns the number of
/// cells of each pixel within the first threshold.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn compare<const CHANNELS: usize>(block: &mut MaskBlock<'_>, thresholds: __m512i) -> __m512i {
    let levels = &block.levels[..CHANNELS];
    let mut centres = [_mm512_setzero_si512(); CHANNELS];
    for (centre, levels) in centres.iter_mut().zip(levels) {
        // SAFETY: `is_inside` has shown that the block's pixels are there.
        *centre = _mm512_broadcast_i64x4(unsafe { load_at(levels, block.centre) });
    }
    let difference = |starts: &[u32; 2]| {
        let mut sum = _mm512_setzero_si512();
        for (&centre, levels) in centres.iter().zip(levels) {
            let [first, second] = starts.map(|start| start as usize + block.first);
            // SAFETY: `is_inside` has shown that both synapses' samples are there.
            let (first, second) = unsafe { (load_at(levels, first), load_at(levels, second)) };
            let samples = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(first), second);
            // One of the two differences is 0.
            let difference = _mm512_or_si512(
                _mm512_subs_epu8(centre, samples),
                _mm512_subs_epu8(samples, centre),
            );
            sum = _mm512_adds_epu8(sum, difference);
        }
        sum
    };
    let pairs = block.starts.as_chunks::<2>().0;
    let mut counts = Counts::new();
    let Some(first) = pairs.first() else {
        return counts.words;
    };
    // A synapse's partner is the next synapse; the partner of the last is the first.
    let mut next = difference(first);
    let cells = block.cells.as_chunks_mut::<LANES>().0;
    for (cells, pairs) in
        (cells.rchunks_mut(REGISTERS_PER_COUNT)).zip(pairs.rchunks(REGISTERS_PER_COUNT))
    {
        for (cells, pair) in cells.iter_mut().zip(pairs).rev() {
            let own = difference(pair);
            // Partners of these two synapses: the second of the two, and the first of the next two.
            let partners = _mm512_shuffle_i64x2::<0b01_00_11_10>(own, next);
            let found = _mm512_max_epu8(own, partners);
            store(cells, found);
            counts.add(found, thresholds);
            next = own;
        }
        counts.widen(pairs.len());
    }
    counts.words
}

/// Counts the cells of each pixel whose difference is within its threshold.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn count_within(cells: &[[u8; LANES]], thresholds: __m512i) -> __m512i {
    let mut counts = Counts::new();
    for cells in cells.chunks(REGISTERS_PER_COUNT) {
        // Two partial counts, so that additions do not wait for each other.
        let mut second = Counts::new();
        let (pairs, rest) = cells.as_chunks::<2>();
        for [a, b] in pairs {
            counts.add(load(a), thresholds);
            second.add(load(b), thresholds);
        }
        for cells in rest {
            counts.add(load(cells), thresholds);
        }
        counts.beyond = _mm512_add_epi8(counts.beyond, second.beyond);
        counts.widen(cells.len());
    }
    counts.words
}

/// Counts of cells: in `beyond`, those beyond the threshold for each byte of a register, in 8 bits;
/// in `words`, those within the threshold for each pixel, in 16 bits.
struct Counts {
    beyond: __m512i,
    words: __m512i,
}

impl Counts {
    #[target_feature(enable = "avx512f,avx512bw,avx512vl")]
    #[inline]
    fn new() -> Self {
        Self {
            beyond: _mm512_setzero_si512(),
            words: _mm512_setzero_si512(),
        }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vl")]
    #[inline]
    fn add(&mut self, cells: __m512i, thresholds: __m512i) {
        // A comparison would go through a mask register.
        let excess = _mm512_subs_epu8(cells, thresholds);
        let is_beyond = _mm512_min_epu8(excess, _mm512_set1_epi8(1));
        self.beyond = _mm512_add_epi8(self.beyond, is_beyond);
    }

    /// Moves the counts of the last `registers` registers, at most 255, from `beyond` to `words`.
    #[target_feature(enable = "avx512f,avx512bw,avx512vl")]
    #[inline]
    fn widen(&mut self, registers: usize) {
        let first = _mm512_cvtepu8_epi16(_mm512_castsi512_si256(self.beyond));
        let second = _mm512_cvtepu8_epi16(_mm512_extracti64x4_epi64::<1>(self.beyond));
        let all = _mm512_set1_epi16(2 * registers as i16);
        let within = _mm512_sub_epi16(all, _mm512_add_epi16(first, second));
        self.words = _mm512_add_epi16(self.words, within);
        self.beyond = _mm512_setzero_si512();
    }
}

/// Writes one bit per cell: 1 if its difference is within the pixel's threshold.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn write_masks(cells: &[[u8; LANES]], thresholds: __m512i, masks: &mut [u8]) {
    let masks = masks.as_chunks_mut::<MASK_LANES>().0;
    let cells = cells.as_chunks::<{ CELLS_PER_BYTE / 2 }>().0;
    for (mask, cells) in masks.iter_mut().zip(cells) {
        let mut bits = _mm512_setzero_si512();
        for (cells, place) in cells.iter().zip([0, 2, 4, 6]) {
            let own = _mm256_set1_epi8((1_u8 << place).cast_signed());
            let next = _mm256_set1_epi8((2_u8 << place).cast_signed());
            let both = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(own), next);
            let is_within = _mm512_cmple_epu8_mask(load(cells), thresholds);
            bits = _mm512_mask_add_epi8(bits, is_within, bits, both);
        }
        let bits = _mm256_or_si256(
            _mm512_castsi512_si256(bits),
            _mm512_extracti64x4_epi64::<1>(bits),
        );
        // SAFETY: the array has the register's 32 bytes; the store needs no alignment.
        unsafe { _mm256_storeu_si256(mask.as_mut_ptr().cast(), bits) };
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn load(bytes: &[u8; LANES]) -> __m512i {
    // SAFETY: the array has the register's 64 bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(bytes.as_ptr().cast()) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
#[inline]
fn store(bytes: &mut [u8; LANES], register: __m512i) {
    // SAFETY: the array has the register's 64 bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(bytes.as_mut_ptr().cast(), register) }
}
