//! Functions that the masks of both sets share.

use core::arch::x86_64::{__m256i, _mm256_loadu_si256};

use vgstereo_core::kernel::{CELLS_PER_BYTE, MASK_LANES, MAX_CHANNELS, MaskBlock};

/// Whether the block is of [`MASK_LANES`] pixels and whole bytes of cells, and all levels that it
/// compares are within the slices.
#[inline(always)]
pub(super) fn is_inside(block: &MaskBlock<'_>) -> bool {
    let last = block.starts.iter().fold(0, |last, &start| last.max(start));
    // A sum that overflows is larger than every slice.
    let start = block.centre.max(block.first.saturating_add(last as usize));
    let end = start.saturating_add(MASK_LANES);
    let mut levels = block.levels.iter().take(block.channels);
    let cells = block.starts.len();
    block.lanes == MASK_LANES
        && cells.is_multiple_of(CELLS_PER_BYTE)
        && Some(block.cells.len()) == cells.checked_mul(MASK_LANES)
        && (block.channels == 1 || block.channels == MAX_CHANNELS)
        && levels.all(|l| end <= l.len())
}

/// Loads the levels of [`MASK_LANES`] pixels from `start` on.
///
/// # Safety
/// `levels` has [`MASK_LANES`] elements from `start` on.
#[target_feature(enable = "avx2")]
#[inline]
pub(super) unsafe fn load_at(levels: &[u8], start: usize) -> __m256i {
    // SAFETY: the load needs no alignment, and the caller promises its bytes.
    unsafe { _mm256_loadu_si256(levels.as_ptr().add(start).cast()) }
}
