//! Matching costs of patterns of 32 cells that all count, with levels of grey. The differing cells of a pattern are
//! counted by one instruction; all else is computed for four disparities at a time.

use bytemuck::{must_cast_slice_mut, try_cast_slice_mut};
use vgstereo_core::kernel::{CostRun, Kernels, LANES, cost_stride};

use super::instructions::{
    add_saturating_u8x4, align, differing_bits, min_u8x4, products_q4, sub_saturating_u8x4,
};
use crate::armv7em::cost::fill_beyond;
use crate::armv7em::simd::splat_u8;
use crate::rv32::cost::{are_whole, rows};

/// Bytes of a pattern.
pub(crate) const BYTES: usize = 4;

/// Disparities whose costs share a word.
pub(crate) const QUAD: usize = 4;

/// Largest number of disparities, rounded up to a multiple of 16.
pub(crate) const MAX_STRIDE: usize = 64;

/// Pixels whose patterns are compared with the same positions of the other view.
const PIXELS: usize = 32;

/// Positions of the other view that their disparities reach, and one more.
const POSITIONS: usize = PIXELS + MAX_STRIDE;

/// Equals [`vgstereo_core::kernel::cost_run`] bit for bit. What this code does not support is left to `others`.
pub(super) fn cost_run(others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
    if write_costs(run, costs).is_none() {
        others.cost_run(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it.
#[inline(never)]
fn write_costs(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    if !is_supported(run) {
        return None;
    }
    let stride = cost_stride(run.disparities);
    let words: &mut [u32] = try_cast_slice_mut(costs).ok()?;
    let mut others = Others::new();
    let cells = run.cell_costs_q8.chunks(PIXELS);
    let cells = cells.zip(run.truncations.chunks(PIXELS));
    let groups = words.chunks_mut(PIXELS * stride / QUAD).zip(cells);
    for ((costs, (cell_costs_q8, truncations)), first) in groups.zip((0..).step_by(PIXELS)) {
        let pixels = cell_costs_q8.len().min(truncations.len());
        let lowest = run.first_position.checked_sub(first + pixels - 1)?;
        others.read(run, lowest, pixels - 1 + stride)?;
        let start = run.start + first;
        let [a, b, c, d] = rows::<BYTES>(run.inputs, start, pixels)?;
        let inputs = a.iter().zip(b).zip(c).zip(d);
        let levels = run.levels[0].get(start..start + pixels)?.iter();
        let values = cell_costs_q8.iter().zip(truncations);
        // The position of a pixel's lowest disparity is one less than that of the pixel before it.
        for ((((&cell_cost_q8, &truncation), (((&a, &b), &c), &d)), &level), (costs, position)) in
            values
                .zip(inputs)
                .zip(levels)
                .zip(costs.chunks_exact_mut(stride / QUAD).zip((0..pixels).rev()))
        {
            let pattern = u32::from_le_bytes([a, b, c, d]);
            let pixel = Pixel::new(run, pattern, cell_cost_q8, truncation, level);
            pixel.write(&others, position, costs)?;
        }
    }
    fill_beyond(run, costs);
    Some(())
}

/// Returns whether a run is of patterns of 32 cells that all count, with levels of grey and few enough disparities.
pub(crate) fn is_supported(run: &CostRun<'_>) -> bool {
    let has_grey = run.channels == 1 && run.difference_weight_q4 > 0;
    let has_pattern = run.inputs.count == BYTES && run.masks.count == 0 && are_whole(run);
    has_grey && has_pattern && (1..=MAX_STRIDE).contains(&run.disparities)
}

/// A row of levels, each four of them as a word, from each of the first four on.
type Levels = [[u32; POSITIONS / QUAD]; QUAD];

/// Patterns and levels of the other view.
struct Others {
    patterns: [u32; POSITIONS],
    low: Levels,
    high: Levels,
}

impl Others {
    fn new() -> Self {
        Self {
            patterns: [0; _],
            low: [[0; _]; _],
            high: [[0; _]; _],
        }
    }

    /// Reads `count` positions from `first` on; returns `None` if they are too many, or not there.
    fn read(&mut self, run: &CostRun<'_>, first: usize, count: usize) -> Option<()> {
        let [a, b, c, d] = rows::<BYTES>(run.stored, first, count)?;
        let bytes = a.iter().zip(b).zip(c).zip(d);
        let patterns = self.patterns.get_mut(..count)?;
        for (pattern, (((&a, &b), &c), &d)) in patterns.iter_mut().zip(bytes) {
            *pattern = u32::from_le_bytes([a, b, c, d]);
        }
        let positions = first..first + count;
        move_to_words(run.other_low[0].get(positions.clone())?, &mut self.low);
        move_to_words(run.other_high[0].get(positions)?, &mut self.high);
        Some(())
    }
}

/// Writes a row of levels as words.
fn move_to_words(levels: &[u8], words: &mut Levels) {
    let [words, one, two, three] = words;
    let bytes: &mut [u8] = must_cast_slice_mut(words.as_mut_slice());
    if let Some(bytes) = bytes.get_mut(..levels.len()) {
        bytes.copy_from_slice(levels);
    }
    let moved = one.iter_mut().zip(two).zip(three);
    for (pair, ((one, two), three)) in words.windows(2).zip(moved) {
        if let &[word, next] = pair {
            *one = align::<1>(word, next);
            *two = align::<2>(word, next);
            *three = align::<3>(word, next);
        }
    }
}

/// A pixel's values. Those but the pattern, the cost of a cell and the weight are in all four bytes.
pub(crate) struct Pixel {
    pub(crate) pattern: u32,
    /// Cost of a differing cell.
    pub(crate) cell_cost: u32,
    /// Largest cost of the pattern.
    pub(crate) truncation: u32,
    pub(crate) level: u32,
    /// Largest difference of levels that counts.
    pub(crate) level_truncation: u32,
    /// Cost of a difference of one level, 1/16.
    pub(crate) level_weight_q4: u32,
}

impl Pixel {
    /// Returns the values of a pixel with this pattern, cost of a differing cell, largest cost of the pattern, and level.
    #[inline(always)]
    pub(crate) fn new(
        run: &CostRun<'_>,
        pattern: u32,
        cell_cost_q8: u16,
        truncation: u8,
        level: u8,
    ) -> Self {
        Self {
            pattern,
            cell_cost: u32::from(cell_cost_q8) >> 8,
            truncation: splat_u8(truncation),
            level: splat_u8(level),
            level_truncation: splat_u8(run.difference_truncation),
            level_weight_q4: run.difference_weight_q4.into(),
        }
    }

    /// Writes the pixel's costs, whose lowest disparity is at a position of the others; returns `None` if there are
    /// too few.
    #[inline(always)]
    fn write(&self, others: &Others, position: usize, costs: &mut [u32]) -> Option<()> {
        const WORDS: usize = LANES / QUAD;
        let patterns = others.patterns.get(position..)?.as_chunks::<LANES>().0;
        let [low, high] = [&others.low, &others.high].map(|levels| {
            let levels = levels.get(position % QUAD)?.get(position / QUAD..)?;
            Some(levels.as_chunks::<WORDS>().0)
        });
        let blocks = costs.as_chunks_mut::<WORDS>().0.iter_mut();
        for (((costs, patterns), low), high) in blocks.zip(patterns).zip(low?).zip(high?) {
            let patterns = patterns.as_chunks::<{ 2 * QUAD }>().0;
            let levels = low.as_chunks::<2>().0.iter().zip(high.as_chunks::<2>().0);
            let pairs = costs.as_chunks_mut::<2>().0.iter_mut().zip(patterns);
            for ((costs, patterns), (low, high)) in pairs.zip(levels) {
                *costs = self.costs(patterns, *low, *high);
            }
        }
        Some(())
    }

    /// The costs of eight disparities.
    #[inline(always)]
    fn costs(&self, patterns: &[u32; 2 * QUAD], low: [u32; 2], high: [u32; 2]) -> [u32; 2] {
        let [a, b, c, d, e, f, g, h] = *patterns;
        let pattern = self.pattern;
        let first = [
            differing_bits::<0>(a, pattern),
            differing_bits::<1>(b, pattern),
            differing_bits::<2>(c, pattern),
            differing_bits::<3>(d, pattern),
        ];
        let second = [
            differing_bits::<0>(e, pattern),
            differing_bits::<1>(f, pattern),
            differing_bits::<2>(g, pattern),
            differing_bits::<3>(h, pattern),
        ];
        // No byte carries, as all cells together cost at most 255.
        let cells = [first, second].map(|[a, b, c, d]| (a | b | c | d) * self.cell_cost);
        let below = low.map(|low| sub_saturating_u8x4(low, self.level));
        let above = high.map(|high| sub_saturating_u8x4(self.level, high));
        // One of the two differences is 0.
        let differences = [below[0] | above[0], below[1] | above[1]];
        let differences = differences.map(|difference| min_u8x4(difference, self.level_truncation));
        let levels = differences.map(|difference| products_q4(difference, self.level_weight_q4));
        let cells = cells.map(|cells| min_u8x4(cells, self.truncation));
        [
            add_saturating_u8x4(cells[0], levels[0]),
            add_saturating_u8x4(cells[1], levels[1]),
        ]
    }
}
