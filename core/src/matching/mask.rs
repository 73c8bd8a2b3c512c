//! Don't-care cells: of a pixel's cells, those on the surface that the pixel is on.
//!
//! A cell whose two samples look like the pixel in the middle is likely on its surface,
//! and moves with it from view to view; one across an edge is not. The difference of a cell
//! is the larger difference of its two samples from the middle, summed over the channels.
//! The cells within a threshold count: the floor, or where that keeps too few, the floor and
//! a step, twice the step, four times and so on, up to the first that keeps enough.

use core::num::NonZeroU8;

use super::cost::MAX_CHANNELS;
use crate::minchinton::CELLS_PER_BYTE;

/// Pixels whose masks are made side by side.
pub const MASK_LANES: usize = 32;

/// A block of pixels to find masks of. Rows have one byte per pixel of the block; all
/// pixels of a row are treated side by side.
#[derive(Debug)]
pub struct MaskBlock<'a> {
    /// The lines around the pixels of each channel, of one shape.
    pub levels: [&'a [u8]; MAX_CHANNELS],
    /// Channels in use: 1 or 3.
    pub channels: usize,
    /// Where in `levels` the block's first pixel is.
    pub centre: usize,
    /// Where the first pixel of the row is for each synapse: its sample.
    pub starts: &'a [u32],
    /// The block's first pixel, counted from that of the row.
    pub first: usize,
    /// Pixels of the block, at most [`MASK_LANES`].
    pub lanes: usize,
    /// Cells to keep at least, at most as many as there are synapses.
    pub kept: u16,
    /// Threshold that is tried first.
    pub floor: u8,
    /// What the second is above it.
    pub step: NonZeroU8,
    /// Scratch: differences of the cells, a row per synapse.
    pub cells: &'a mut [u8],
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
    compare(block, lanes);
    join_cells(block.cells, lanes);
    let mut thresholds = [block.floor; MASK_LANES];
    let mut excess = block.step.get();
    loop {
        block.counts = count_within(block.cells, lanes, &thresholds);
        let higher = block.floor.saturating_add(excess);
        let mut is_done = true;
        for (threshold, &count) in thresholds.iter_mut().zip(&block.counts).take(lanes) {
            // Everything is within the highest.
            if count < block.kept && *threshold < u8::MAX {
                *threshold = higher;
                is_done = false;
            }
        }
        if is_done {
            break;
        }
        excess = excess.saturating_mul(2);
    }
    write_masks(block.cells, lanes, &thresholds, block.masks);
}

/// Writes the differences of the samples from their pixels, summed over the channels and
/// at most 255.
#[inline(always)]
fn compare(block: &mut MaskBlock<'_>, lanes: usize) {
    // A block of all lanes has a length that the compiler knows.
    let whole = if lanes == MASK_LANES {
        block.cells.as_chunks_mut::<MASK_LANES>().0
    } else {
        &mut []
    };
    let first = block.first;
    for (row, &start) in whole.iter_mut().zip(block.starts) {
        *row = [0; MASK_LANES];
        for levels in block.levels.iter().take(block.channels) {
            let run = |start: usize| -> [u8; MASK_LANES] {
                let run = levels.get(start..).and_then(|levels| levels.first_chunk());
                run.copied().unwrap_or_default()
            };
            let (centre, samples) = (run(block.centre), run(start as usize + first));
            for lane in 0..MASK_LANES {
                row[lane] = row[lane].saturating_add(distance(centre[lane], samples[lane]));
            }
        }
    }
    if lanes == MASK_LANES {
        return;
    }
    block.cells.fill(0);
    for levels in block.levels.iter().take(block.channels) {
        let run = |start: usize| levels.get(start..start + lanes).unwrap_or_default();
        let centres = run(block.centre);
        let rows = block.cells.chunks_exact_mut(lanes.max(1));
        for (row, &start) in rows.zip(block.starts) {
            let samples = run(start as usize + first);
            for ((difference, &a), &b) in row.iter_mut().zip(centres).zip(samples) {
                *difference = difference.saturating_add(distance(a, b));
            }
        }
    }
}

/// The absolute difference, in a form that stays 8 bits wide in vector code.
#[inline(always)]
fn distance(a: u8, b: u8) -> u8 {
    a.saturating_sub(b) | b.saturating_sub(a)
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
    for group in differences.chunks((lanes * usize::from(u8::MAX)).max(1)) {
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

    /// Against counting the cells of each pixel within every threshold.
    #[test]
    fn masks_equal_those_found_pixel_by_pixel() {
        for seed in 0..60 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |end: u32| random.next_u32() % end;
            let count = [16, 48, 64, 256, 1024][below(5) as usize];
            let lanes = [1, 13, 31, MASK_LANES][below(4) as usize];
            let channels = [1, 3][below(2) as usize];
            let contrast = [2, 20, 256][below(3) as usize];
            let planes: Vec<Vec<u8>> = (0..channels)
                .map(|_| (0..500).map(|_| below(contrast) as u8).collect())
                .collect();
            let mut levels = [&[][..]; MAX_CHANNELS];
            for (levels, plane) in levels.iter_mut().zip(&planes) {
                *levels = plane;
            }
            let (centre, first) = (below(400) as usize, below(100) as usize);
            let starts: Vec<u32> = (0..count).map(|_| below(300)).collect();
            let (kept, floor) = (1 + below(count) as u16, below(30) as u8);
            let step = 1 + below(40) as u8;
            let mut masks = std::vec![1; count as usize / 8 * lanes];
            let mut block = MaskBlock {
                levels,
                channels,
                centre,
                starts: &starts,
                first,
                lanes,
                kept,
                floor,
                step: NonZeroU8::new(step).unwrap(),
                cells: &mut std::vec![1; count as usize * lanes],
                masks: &mut masks,
                counts: [0; MASK_LANES],
            };
            mask_block(&mut block);
            let counts = block.counts;
            for lane in 0..lanes {
                let count = count as usize;
                let sample = |i: usize| {
                    let at = starts[i % count] as usize + first + lane;
                    let differences = planes
                        .iter()
                        .map(|plane| i32::from(plane[centre + lane]) - i32::from(plane[at]));
                    differences.map(i32::abs).sum::<i32>().min(255)
                };
                let cells: Vec<i32> = (0..count).map(|i| sample(i).max(sample(i + 1))).collect();
                let within = |threshold: i32| cells.iter().filter(|&&c| c <= threshold).count();
                let mut ladder = (0..).map(|rung| match rung {
                    0 => i32::from(floor),
                    rung => (i32::from(floor) + (i32::from(step) << (rung - 1))).min(255),
                });
                let threshold = ladder.find(|&t| within(t) >= kept.into()).unwrap();
                let expected: Vec<bool> = cells.iter().map(|&c| c <= threshold).collect();
                let found: Vec<bool> = (0..count)
                    .map(|i| masks[i / 8 * lanes + lane] >> (i % 8) & 1 == 1)
                    .collect();
                assert_eq!(found, expected, "seed {seed}, lane {lane}");
                assert_eq!(usize::from(counts[lane]), within(threshold));
            }
        }
    }
}
