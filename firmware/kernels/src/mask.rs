//! Cells that count, four pixels in a word.

use vgstereo_core::matching::{self, MASK_LANES, MaskBlock};
use vgstereo_core::minchinton::CELLS_PER_BYTE;

use crate::simd::{
    add_saturating_u8x4, halve_sum_u8x4, load, max_u8x4, min_u8x4, select_ge_u8x4, splat_u8, store,
    sub_saturating_u8x4,
};

/// Pixels of a word.
const LANES: usize = 4;
/// Words of a row of the block.
const WORDS: usize = MASK_LANES / LANES;
/// By how much the second threshold that is tried differs from the first.
const FIRST_STEP: u8 = 16;

type Row = [[u8; LANES]; WORDS];
/// The cells of a byte of the mask.
type Rows = [Row; CELLS_PER_BYTE];

/// The same as core's `mask_block`.
#[inline(never)]
pub fn mask_block(block: &mut MaskBlock<'_>) {
    let rows = block.differences.as_chunks_mut::<LANES>().0;
    let rows = rows.as_chunks_mut::<WORDS>().0;
    let (cells, rest) = rows.as_chunks_mut::<CELLS_PER_BYTE>();
    let count = cells.len() * CELLS_PER_BYTE;
    let fits = (usize::from(block.kept)..=usize::from(u8::MAX)).contains(&count);
    if block.lanes != MASK_LANES || !rest.is_empty() || !fits {
        matching::mask_block(block);
        return;
    }
    let masks = block.masks.as_chunks_mut::<LANES>().0;
    let masks = masks.as_chunks_mut::<WORDS>().0;
    let counts = block.counts.as_chunks_mut::<LANES>().0;
    // At most the number of cells.
    let kept = splat_u8(block.kept as u8);
    let floor = splat_u8(block.floor);
    // Neighbours have like thresholds.
    let mut thresholds = floor;
    for (word, counts) in (0..WORDS).zip(counts) {
        join_cells(cells, word);
        let kept_cells;
        (thresholds, kept_cells) = search(cells, word, kept, floor, thresholds);
        *counts = kept_cells.to_le_bytes().map(u16::from);
        for (mask, rows) in masks.iter_mut().zip(&*cells) {
            let mut bits = 0;
            for row in rows.iter().rev() {
                let cell = load(&row[word]);
                bits = bits << 1 | select_ge_u8x4(thresholds, cell, splat_u8(1), 0);
            }
            store(bits, &mut mask[word]);
        }
    }
}

/// Makes a synapse's difference its cell's: the larger of its own and its partner's.
#[inline(always)]
fn join_cells(cells: &mut [Rows], word: usize) {
    // From the last to the first, whose partner comes after it.
    let Some(first) = cells.first() else { return };
    let mut partner = load(&first[0][word]);
    for rows in cells.iter_mut().rev() {
        for row in rows.iter_mut().rev() {
            let own = load(&row[word]);
            store(max_u8x4(own, partner), &mut row[word]);
            partner = own;
        }
    }
}

/// The smallest thresholds that keep enough cells and are not below the floor, or others
/// that keep the same cells; and how many those are. Searched for from `probes` outwards,
/// in steps that double.
#[inline(never)]
fn search(cells: &[Rows], word: usize, kept: u32, floor: u32, mut probes: u32) -> (u32, u32) {
    let (mut low, mut high) = (floor, splat_u8(u8::MAX));
    // Below `WORDS` for the compiler too.
    let word = word % WORDS;
    // As many as there are, which is what the highest threshold keeps.
    let mut counts = splat_u8((cells.len() * CELLS_PER_BYTE) as u8);
    let mut step = splat_u8(FIRST_STEP);
    loop {
        let counted = count_within(cells, word, probes);
        let enough = |yes, no| select_ge_u8x4(counted, kept, yes, no);
        high = enough(probes, high);
        counts = enough(counted, counts);
        // A lower threshold that keeps no fewer would keep the same.
        let exact = select_ge_u8x4(kept, counted, probes, low);
        low = enough(exact, add_saturating_u8x4(probes, splat_u8(1)));
        if low == high {
            return (high, counts);
        }
        let middle = halve_sum_u8x4(low, high);
        let down = max_u8x4(middle, sub_saturating_u8x4(probes, step));
        let up = min_u8x4(middle, add_saturating_u8x4(probes, step));
        probes = enough(down, up);
        step = add_saturating_u8x4(step, step);
    }
}

/// How many cells of each pixel are within its threshold.
#[inline(always)]
fn count_within(cells: &[Rows], word: usize, thresholds: u32) -> u32 {
    let mut counts = 0;
    for rows in cells {
        for row in rows {
            counts += select_ge_u8x4(thresholds, load(&row[word]), splat_u8(1), 0);
        }
    }
    counts
}
