//! Matching costs of a run of pixels: masked Hamming distance and difference of levels.
//!
//! The cost of a pixel at a disparity is the sum of two terms. The first is the share of the
//! pattern's unmasked cells that differ from the other view's pattern at that disparity,
//! scaled and truncated. The second is the difference of the levels of the two views,
//! truncated and weighted.

use super::hamming::{LANES, Planes, differing_cells};
use super::unpack::MAX_CHANNELS;

/// Cost of a disparity beyond the range searched: it loses against every other.
pub const NO_COST: u8 = u8::MAX;

/// A run of pixels to compute the costs of.
#[derive(Debug, Clone, Copy)]
pub struct CostRun<'a> {
    /// Pixel of the row that the run begins with.
    pub start: usize,
    /// Patterns of the reference view's row.
    pub inputs: Planes<'a>,
    /// Masks of the run's pixels, that of pixel `start` at position 0, in as many planes as
    /// the patterns have: bits of 1 are cells that count. Without planes, every cell counts.
    pub masks: Planes<'a>,
    /// Cost of one differing cell of each pixel of the run, 1/256 of a cost. Times the number
    /// of the pixel's unmasked cells it is less than 2^16 - 128.
    pub cell_costs_q8: &'a [u16],
    /// Patterns of the other view, readable for all disparities of all pixels.
    pub stored: Planes<'a>,
    /// Position, in `stored` and in the other view's levels, of the lowest disparity of pixel
    /// `start`. That of each pixel after it is one less.
    pub first_position: usize,
    /// Number of disparities.
    pub disparities: usize,
    /// Largest cost of the patterns of each pixel of the run, at most `hamming_truncation`.
    pub truncations: &'a [u8],
    /// Largest cost of any pixel's patterns.
    pub hamming_truncation: u8,
    /// Channels of the reference view, one level per pixel of the row each.
    pub levels: [&'a [u8]; MAX_CHANNELS],
    /// Channels of the other view by stored position, in the reference camera's exposure:
    /// the lowest level that counts as equal.
    pub other_low: [&'a [u8]; MAX_CHANNELS],
    /// Highest level that counts as equal, likewise.
    pub other_high: [&'a [u8]; MAX_CHANNELS],
    /// Number of channels in use: 1 or 3.
    pub channels: usize,
    /// Largest difference of levels that counts, levels.
    pub difference_truncation: u8,
    /// Cost of a difference of one level, 1/16 of a cost; 0 leaves the levels out. The largest
    /// difference costs at most 255 less the largest cost of the patterns.
    pub difference_weight_q4: u8,
}

/// Bytes from the costs of one pixel to those of the next: the number of disparities, rounded
/// up to a multiple of [`LANES`].
#[must_use]
pub const fn cost_stride(disparities: usize) -> usize {
    disparities.next_multiple_of(LANES)
}

/// Writes the costs of every pixel of `run`: [`cost_stride`] bytes per pixel, one per
/// disparity from the lowest up, and [`NO_COST`] in those beyond the range.
#[inline(always)]
pub fn cost_run(row: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(row.disparities);
    let pixels = row.cell_costs_q8.iter().zip(row.truncations);
    for (x, (costs, (&cell_cost_q8, &truncation))) in costs
        .chunks_exact_mut(stride.max(1))
        .zip(pixels)
        .enumerate()
    {
        let cell = (cell_cost_q8, truncation);
        let first = row.first_position.saturating_sub(x);
        let mut at = first;
        let (blocks, rest) = costs.as_chunks_mut::<{ 4 * LANES }>();
        for block in blocks {
            *block = cost_block(row, x, at, cell);
            at += block.len();
        }
        let (blocks, rest) = rest.as_chunks_mut::<{ 2 * LANES }>();
        for block in blocks {
            *block = cost_block(row, x, at, cell);
            at += block.len();
        }
        for block in rest.as_chunks_mut::<LANES>().0 {
            *block = cost_block(row, x, at, cell);
            at += block.len();
        }
        if let Some(beyond) = costs.get_mut(row.disparities..) {
            beyond.fill(NO_COST);
        }
    }
}

/// Costs of pixel `x` of the run at `N` disparities, of which the first has position `first`.
#[inline(always)]
pub(super) fn cost_block<'a, const N: usize>(
    row: &CostRun<'a>,
    x: usize,
    first: usize,
    (cell_cost_q8, truncation): (u16, u8),
) -> [u8; N] {
    let input = row.start + x;
    let differing: [u16; N] = differing_cells(row.inputs, input, row.masks, x, row.stored, first);
    let mut costs = [0_u8; N];
    let truncation = u16::from(truncation);
    for (cost, &cells) in costs.iter_mut().zip(&differing) {
        // With the rounding less than 2^16.
        *cost = (((cells * cell_cost_q8 + 128) >> 8).min(truncation)) as u8;
    }
    if row.difference_weight_q4 > 0 {
        let mut differences = [0_u16; N];
        let others = row.other_low.iter().zip(row.other_high);
        for (levels, (low, high)) in row.levels.iter().zip(others).take(row.channels) {
            let run = |levels: &'a [u8]| levels.get(first..)?.first_chunk::<N>();
            let (Some(&level), Some(low), Some(high)) =
                (levels.get(row.start + x), run(low), run(high))
            else {
                continue;
            };
            for ((difference, &low), &high) in differences.iter_mut().zip(low).zip(high) {
                // One of the two differences is 0.
                *difference += u16::from(level.saturating_sub(high) | low.saturating_sub(level));
            }
        }
        // The mean of three channels: 85 / 256 is a third. Products fit 16 bits: one
        // channel differs by at most 255, three by 765, and the mean by 255.
        let mean_q8 = if row.channels == 1 { 256 } else { 85 };
        let truncation = u16::from(row.difference_truncation);
        let weight = u16::from(row.difference_weight_q4);
        for (cost, &difference) in costs.iter_mut().zip(&differences) {
            let mean = ((difference * mean_q8) >> 8).min(truncation);
            // The configuration bounds the sum of both terms to 8 bits.
            *cost = cost.saturating_add(((mean * weight) >> 4) as u8);
        }
    }
    costs
}
