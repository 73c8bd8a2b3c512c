//! Don't-care cells: of a pixel's cells, those on the surface that the pixel is on.
//!
//! A cell whose two samples look like the pixel in the middle is likely on its surface,
//! and moves with it from view to view; one across an edge is not. The likeness of a cell
//! is the larger difference of its two samples from the middle, summed over the channels.
//! The smallest threshold that keeps the wanted number of cells is taken, but not below a
//! floor; the cells within it count.

use super::cost::MAX_CHANNELS;
use crate::minchinton::CELLS_PER_BYTE;
use crate::strip::StripWindow;
use crate::synapse::{Offset, Synapses};

/// Pixels whose masks are made side by side.
pub const MASK_LANES: usize = 32;

/// A block of pixels to compare with their samples.
#[derive(Debug, Clone, Copy)]
pub struct DifferenceBlock<'a> {
    /// The lines around the block of each channel, of strips of one shape.
    pub windows: [StripWindow<'a>; MAX_CHANNELS],
    /// Channels in use: 1 or 3.
    pub channels: usize,
    /// Where the samples are.
    pub synapses: Synapses<'a>,
    /// Stored position of the block's first pixel.
    pub first: usize,
    /// Pixels of the block, at most [`MASK_LANES`].
    pub lanes: usize,
}

/// Writes the differences of the samples from their pixels, summed over the channels and
/// at most 255: a row of `lanes` per synapse. Inlined so that a caller may compile it for
/// its own instruction set.
#[inline(always)]
pub fn difference_block(block: &DifferenceBlock<'_>, differences: &mut [u8]) {
    let lanes = block.lanes.clamp(1, MASK_LANES);
    // A block of all lanes has a length that the compiler knows.
    let whole = if lanes == MASK_LANES {
        differences.as_chunks_mut::<MASK_LANES>().0
    } else {
        &mut []
    };
    if !whole.is_empty() {
        let mut centres = [[0_u8; MASK_LANES]; MAX_CHANNELS];
        for (centre, window) in centres.iter_mut().zip(&block.windows) {
            if let Some(run) = centre_of(window, block.first, lanes).first_chunk() {
                *centre = *run;
            }
        }
        let [a, b, c] = block.windows.map(|window| window.pixels());
        for (row, offset) in whole.iter_mut().zip(block.synapses.iter()) {
            let start = block.windows[0].start(offset, block.first, lanes);
            let run = |pixels: &'_ [u8]| -> [u8; MASK_LANES] {
                let run = start.and_then(|start| pixels.get(start..)?.first_chunk());
                run.copied().unwrap_or_default()
            };
            if start.is_none() {
                row.fill(0);
                continue;
            }
            let mut sum = [0_u8; MASK_LANES];
            let near = run(a);
            for lane in 0..MASK_LANES {
                sum[lane] = distance(centres[0][lane], near[lane]);
            }
            if block.channels > 1 {
                for (pixels, centre) in [(b, &centres[1]), (c, &centres[2])] {
                    let near = run(pixels);
                    for lane in 0..MASK_LANES {
                        sum[lane] = sum[lane].saturating_add(distance(centre[lane], near[lane]));
                    }
                }
            }
            *row = sum;
        }
        return;
    }
    differences.fill(0);
    for window in block.windows.iter().take(block.channels) {
        let centres = centre_of(window, block.first, lanes);
        let rows = differences.chunks_exact_mut(lanes.max(1));
        for (row, offset) in rows.zip(block.synapses.iter()) {
            let samples = window.samples(offset, block.first, lanes);
            for ((difference, &a), &b) in row.iter_mut().zip(centres).zip(samples) {
                *difference = difference.saturating_add(a.abs_diff(b));
            }
        }
    }
}

/// The absolute difference, in a form that stays 8 bits wide in vector code.
#[inline(always)]
fn distance(a: u8, b: u8) -> u8 {
    a.saturating_sub(b) | b.saturating_sub(a)
}

/// The block's own pixels.
#[inline(always)]
fn centre_of<'a>(window: &StripWindow<'a>, first: usize, lanes: usize) -> &'a [u8] {
    window.samples(Offset { dx: 0, dy: 0 }, first, lanes)
}

/// A block of pixels to find masks of. Rows have one byte per pixel of the block; all
/// pixels of a row are treated side by side.
#[derive(Debug)]
pub struct MaskBlock<'a> {
    /// Differences of the samples from their pixels, a row per synapse; overwritten.
    pub differences: &'a mut [u8],
    /// Pixels of the block, at most [`MASK_LANES`].
    pub lanes: usize,
    /// Cells to keep at least.
    pub kept: u16,
    /// Threshold that is taken at least.
    pub floor: u8,
    /// Out: the masks, a row per byte of cells.
    pub masks: &'a mut [u8],
    /// Out: cells in each mask.
    pub counts: [u16; MASK_LANES],
}

/// Finds each pixel's threshold and writes its mask and its number of cells. Inlined so
/// that a caller may compile it for its own instruction set.
#[inline(always)]
pub fn mask_block(block: &mut MaskBlock<'_>) {
    // Rows are as long as the block says rather than an array: a length that the compiler
    // does not know keeps the loops over pixels the ones that become vector code.
    let lanes = block.lanes.clamp(1, MASK_LANES);
    join_cells(block.differences, lanes);
    // Bisection, all pixels at once: the smallest threshold that keeps enough cells and is
    // not below the floor.
    let mut low = [block.floor; MASK_LANES];
    let mut high = [u8::MAX; MASK_LANES];
    // Where the floor keeps enough in every lane, which is common, there is no search.
    let mut middle = low;
    while {
        let counted = count_within(block.differences, lanes, &middle);
        let mut is_open = 0;
        for lane in 0..MASK_LANES {
            let is_enough = counted[lane] >= block.kept;
            high[lane] = if is_enough { middle[lane] } else { high[lane] };
            // Not above 255: everything is within that.
            low[lane] = if is_enough {
                low[lane]
            } else {
                middle[lane].saturating_add(1)
            };
            low[lane] = low[lane].min(high[lane]);
            middle[lane] = low[lane] + ((high[lane] - low[lane]) >> 1);
            is_open |= high[lane] - low[lane];
        }
        is_open > 0
    } {}
    block.counts = count_within(block.differences, lanes, &high);
    write_masks(block.differences, lanes, &high, block.masks);
}

/// Makes a synapse's difference its cell's: the larger of its own and its partner's.
#[inline(always)]
fn join_cells(differences: &mut [u8], lanes: usize) {
    let mut first = [0_u8; MASK_LANES];
    if let (Some(first), Some(row)) = (first.get_mut(..lanes), differences.get(..lanes)) {
        first.copy_from_slice(row);
    }
    let mut rest = differences;
    while let Some((own, after)) = rest.split_at_mut_checked(lanes) {
        let partner = after
            .get(..lanes)
            .or(first.get(..lanes))
            .unwrap_or_default();
        for (own, &partner) in own.iter_mut().zip(partner) {
            *own = (*own).max(partner);
        }
        rest = after;
    }
}

/// Writes a bit per cell: whether it is within the pixel's threshold.
#[inline(always)]
fn write_masks(cells: &[u8], lanes: usize, thresholds: &[u8; MASK_LANES], masks: &mut [u8]) {
    let rows = masks.chunks_exact_mut(lanes);
    for (mask, cells) in rows.zip(cells.chunks(lanes * CELLS_PER_BYTE)) {
        mask.fill(0);
        for cell in cells.chunks_exact(lanes).rev() {
            for ((mask, &cell), &threshold) in mask.iter_mut().zip(cell).zip(thresholds) {
                *mask = *mask << 1 | u8::from(cell <= threshold);
            }
        }
    }
}

/// How many cells of each pixel are within its threshold.
#[inline(always)]
fn count_within(
    differences: &[u8],
    lanes: usize,
    thresholds: &[u8; MASK_LANES],
) -> [u16; MASK_LANES] {
    let mut counts = [0_u16; MASK_LANES];
    // Summed in 8 bits first: a group has fewer cells than those count.
    for group in differences.chunks(lanes * usize::from(u8::MAX)) {
        let mut sums = [0_u8; MASK_LANES];
        for cell in group.chunks_exact(lanes) {
            for ((sum, &cell), &threshold) in sums.iter_mut().zip(cell).zip(thresholds) {
                *sum += u8::from(cell <= threshold);
            }
        }
        for (count, sum) in counts.iter_mut().zip(sums) {
            *count += u16::from(sum);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    /// Against sorting the cells of each pixel.
    #[test]
    fn masks_equal_those_by_sorting() {
        for (seed, count) in [(1, 16), (2, 64), (3, 256), (4, 1024)] {
            let mut random = Pcg32::seed_from_u64(seed);
            let levels = [2, 20, 256][seed as usize % 3];
            let lanes = [1, 13, 31, MASK_LANES][seed as usize % 4];
            let mut differences: Vec<u8> = (0..count * lanes)
                .map(|_| (random.next_u32() % levels) as u8)
                .collect();
            let samples = differences.clone();
            let kept = 1 + (random.next_u32() % count as u32) as u16;
            let floor = (random.next_u32() % 30) as u8;
            let mut masks = std::vec![0; count / 8 * lanes];
            let mut block = MaskBlock {
                differences: &mut differences,
                lanes,
                kept,
                floor,
                masks: &mut masks,
                counts: [0; MASK_LANES],
            };
            mask_block(&mut block);
            let counts = block.counts;
            for lane in 0..lanes {
                let sample = |i: usize| samples[i % count * lanes + lane];
                let cell = |i: usize| sample(i).max(sample(i + 1));
                let mut sorted: Vec<u8> = (0..count).map(cell).collect();
                sorted.sort_unstable();
                let threshold = sorted[usize::from(kept) - 1].max(floor);
                let expected: Vec<bool> = (0..count).map(|i| cell(i) <= threshold).collect();
                let found: Vec<bool> = (0..count)
                    .map(|i| masks[i / 8 * lanes + lane] >> (i % 8) & 1 == 1)
                    .collect();
                assert_eq!(found, expected, "seed {seed}, lane {lane}");
                assert_eq!(
                    usize::from(counts[lane]),
                    expected.iter().filter(|&&k| k).count()
                );
            }
        }
    }
}
