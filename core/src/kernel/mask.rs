//! Masks: the cells of a pixel's pattern that lie on the pixel's own surface.
//!
//! A cell whose two samples are similar to the centre pixel is likely on the same surface, and
//! moves with it from view to view; a cell across an edge does not. The difference of a cell is the
//! larger difference of its two samples from the centre pixel, summed over the channels. A cell
//! counts if its difference is within the pixel's threshold. The threshold is the lowest on a
//! ladder that keeps enough cells: the floor, then the floor plus one step, plus two, four, eight
//! steps and so on.

use core::num::NonZeroU8;

use super::pack::CELLS_PER_BYTE;
use super::unpack::MAX_CHANNELS;

/// Pixels whose masks are made side by side.
pub const MASK_LANES: usize = 32;

/// A block of neighbouring pixels to find the masks of. Scratch and output have rows of one
/// byte per pixel of the block.
#[derive(Debug)]
pub struct MaskBlock<'a> {
    /// All stored lines of each channel; the channels have one shape, so that an index means
    /// the same pixel in each.
    pub levels: [&'a [u8]; MAX_CHANNELS],
    /// Number of channels in use: 1 or 3.
    pub channels: usize,
    /// Index in `levels` of the block's first pixel.
    pub centre: usize,
    /// Index in `levels` of the sample that each synapse takes for the first pixel of the row.
    pub starts: &'a [u32],
    /// Position of the block's first pixel in the row.
    pub first: usize,
    /// Number of pixels of the block, 1 to [`MASK_LANES`].
    pub lanes: usize,
    /// Smallest number of cells to keep, at most the number of synapses.
    pub kept: u16,
    /// First threshold of the ladder, levels.
    pub floor: u8,
    /// Increment from the first threshold to the second, levels.
    pub step: NonZeroU8,
    /// Scratch: the difference of each cell, one row per synapse.
    pub cells: &'a mut [u8],
    /// Out: the masks, one row per eight cells, bit `k` for cell `8 row + k`.
    pub masks: &'a mut [u8],
    /// Out: number of cells in each mask.
    pub counts: [u16; MASK_LANES],
}

/// Finds the threshold of each pixel of `block`, and writes its mask and the number of cells
/// in it.
#[inline(always)]
pub fn mask_block(block: &mut MaskBlock<'_>) {
    // The rows are slices of the block's length rather than arrays: if the compiler does not know
    // the length, it vectorises the loops over pixels and not others.
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
            // Every difference is within the highest threshold.
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
    // The length of a full block is known to the compiler.
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

/// Turns the differences of samples into those of cells: the larger of a synapse's and its
/// partner's.
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

/// Writes one bit per cell: 1 where its difference is within the pixel's threshold.
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

/// Counts the cells of each pixel whose difference is within its threshold.
#[inline(always)]
fn count_within(
    differences: &[u8],
    lanes: usize,
    thresholds: &[u8; MASK_LANES],
) -> [u16; MASK_LANES] {
    let mut counts = [0_u16; MASK_LANES];
    // Summed in 8 bits first: a group has at most 255 cells.
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

    /// Compared with counting the cells of each pixel within every threshold.
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
