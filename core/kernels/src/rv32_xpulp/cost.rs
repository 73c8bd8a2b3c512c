//! Matching costs of patterns of 32 cells that all count, with levels of grey. The differing cells of a pattern are
//! counted by one instruction; all else is computed for four disparities at a time.

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::{CostRun, Kernels, LANES, cost_stride};

use crate::armv7em::cost::fill_beyond;
use crate::armv7em::simd::{even_bytes, odd_bytes};
use crate::rv32::cost::rows;
use crate::rv32_bytes::cost::{BYTES, MAX_STRIDE, Pixel, QUAD, is_supported};
use crate::xpulp::{count_ones, insert_1, max_u8x4, min_u8x4, pack_high, shuffle, sixteenth_u8x4};

/// Words of costs whose loop is unrolled.
const WORDS: usize = LANES / QUAD;

/// Pixels whose patterns are compared with the same positions of the other view.
const PIXELS: usize = 64;

/// Positions of the other view that their disparities reach, and one more.
const POSITIONS: usize = PIXELS + MAX_STRIDE;

/// Equals [`vgstereo_core::kernel::cost_run`] bit for bit. What this code does not support is left to `others`.
pub(super) fn cost_run(others: &impl Kernels, run: &CostRun<'_>, costs: &mut [u8]) {
    // A weight is a whole cost and a rest in 1/16.
    let rest_q4 = u32::from(run.difference_weight_q4 % 16);
    let written = if u32::from(run.difference_truncation) * rest_q4 <= u8::MAX.into() {
        write_costs::<true>(run, costs)
    } else {
        write_costs::<false>(run, costs)
    };
    if written.is_none() {
        others.cost_run(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it. `IS_NARROW` says that
/// no difference that counts is above 255 when it is multiplied with the rest of the weight.
#[inline(never)]
fn write_costs<const IS_NARROW: bool>(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    if !is_supported(run) {
        return None;
    }
    let stride = cost_stride(run.disparities);
    let words: &mut [u32] = try_cast_slice_mut(costs).ok()?;
    let (mut inputs, mut patterns) = ([0; PIXELS], [0; POSITIONS]);
    let cells = run.cell_costs_q8.chunks(PIXELS);
    let cells = cells.zip(run.truncations.chunks(PIXELS));
    let groups = words.chunks_mut(PIXELS * stride / QUAD).zip(cells);
    for ((costs, (cell_costs_q8, truncations)), first) in groups.zip((0..).step_by(PIXELS)) {
        let pixels = cell_costs_q8.len().min(truncations.len());
        let lowest = run.first_position.checked_sub(first + pixels - 1)?;
        let count = pixels - 1 + stride;
        let patterns = patterns.get_mut(..count)?;
        join(rows(run.stored, lowest, count)?, patterns);
        let low = run.other_low[0].get(lowest..lowest + count)?;
        let high = run.other_high[0].get(lowest..lowest + count)?;
        let start = run.start + first;
        let inputs = inputs.get_mut(..pixels)?;
        join(rows(run.inputs, start, pixels)?, inputs);
        let levels = run.levels[0].get(start..start + pixels)?;
        let values = cell_costs_q8.iter().zip(truncations);
        let values = values.zip(inputs.iter().zip(levels));
        let places = costs.chunks_exact_mut(stride / QUAD).zip((0..pixels).rev());
        // The position of a pixel's lowest disparity is one less than that of the pixel before it.
        for (((&cell_cost_q8, &truncation), (&pattern, &level)), (costs, position)) in
            values.zip(places)
        {
            write::<IS_NARROW>(
                &Pixel::new(run, pattern, cell_cost_q8, truncation, level),
                patterns.get(position..)?,
                low.get(position..)?,
                high.get(position..)?,
                costs,
            );
        }
    }
    fill_beyond(run, costs);
    Some(())
}

/// Writes patterns as words, given their bytes in rows of the same length.
fn join(rows: [&[u8]; BYTES], patterns: &mut [u32]) {
    // Bytes of two words by turns: the lower two of each, and the upper two; and halfwords of two words.
    const LOWER: u32 = 0x0501_0400;
    const UPPER: u32 = 0x0703_0602;
    const LOW_HALVES: u32 = 0x0504_0100;
    const HIGH_HALVES: u32 = 0x0706_0302;
    let [a, b, c, d] = rows.map(|row| row.as_chunks::<QUAD>().0.iter());
    let quads = a.zip(b).zip(c).zip(d);
    let (words, rest) = patterns.as_chunks_mut::<QUAD>();
    for (patterns, (((a, b), c), d)) in words.iter_mut().zip(quads) {
        let [a, b, c, d] = [a, b, c, d].map(|bytes| u32::from_le_bytes(*bytes));
        let (first, second) = (shuffle(a, b, LOWER), shuffle(c, d, LOWER));
        let (third, fourth) = (shuffle(a, b, UPPER), shuffle(c, d, UPPER));
        *patterns = [
            shuffle(first, second, LOW_HALVES),
            shuffle(first, second, HIGH_HALVES),
            shuffle(third, fourth, LOW_HALVES),
            shuffle(third, fourth, HIGH_HALVES),
        ];
    }
    let done = QUAD * words.len();
    let [a, b, c, d] = rows.map(|row| row.get(done..).unwrap_or_default().iter());
    for (pattern, (((&a, &b), &c), &d)) in rest.iter_mut().zip(a.zip(b).zip(c).zip(d)) {
        *pattern = u32::from_le_bytes([a, b, c, d]);
    }
}

/// Writes the pixel's costs, given the patterns and levels from that of its lowest disparity on.
#[inline(always)]
fn write<const IS_NARROW: bool>(
    pixel: &Pixel,
    patterns: &[u32],
    low: &[u8],
    high: &[u8],
    costs: &mut [u32],
) {
    let patterns = patterns.as_chunks::<LANES>().0;
    let low = low.as_chunks::<LANES>().0.iter();
    let levels = low.zip(high.as_chunks::<LANES>().0);
    let blocks = costs.as_chunks_mut::<WORDS>().0.iter_mut();
    for ((costs, patterns), (low, high)) in blocks.zip(patterns).zip(levels) {
        let patterns = patterns.as_chunks::<QUAD>().0;
        let low = low.as_chunks::<QUAD>().0;
        let high = high.as_chunks::<QUAD>().0;
        // Not by a closure, which the compiler would not inline so often.
        macro_rules! write {
            ($($word:literal)+) => {
                $(costs[$word] = costs_of_four::<IS_NARROW>(pixel, &patterns[$word], &low[$word], &high[$word]);)+
            };
        }
        write!(0 1 2 3);
    }
}

/// The costs of four disparities.
#[inline(always)]
fn costs_of_four<const IS_NARROW: bool>(
    pixel: &Pixel,
    patterns: &[u32; QUAD],
    low: &[u8; QUAD],
    high: &[u8; QUAD],
) -> u32 {
    let (low, high) = (u32::from_le_bytes(*low), u32::from_le_bytes(*high));
    let [a, b, c, d] = patterns.map(|pattern| count_ones(pattern ^ pixel.pattern));
    // No byte carries, as all cells together cost at most 255.
    let cells = pack_high(insert_1(a, b), d, c).wrapping_mul(pixel.cell_cost);
    // The level itself, where it is in the interval: no byte borrows.
    let difference = max_u8x4(low, pixel.level).wrapping_sub(min_u8x4(high, pixel.level));
    let difference = min_u8x4(difference, pixel.level_truncation);
    // The configuration bounds the sum to a byte.
    min_u8x4(cells, pixel.truncation).wrapping_add(weighted::<IS_NARROW>(pixel, difference))
}

/// The costs of four differences of levels.
#[inline(always)]
fn weighted<const IS_NARROW: bool>(pixel: &Pixel, differences: u32) -> u32 {
    let weight_q4 = pixel.level_weight_q4;
    if IS_NARROW {
        differences * (weight_q4 / 16) + sixteenth_u8x4(differences.wrapping_mul(weight_q4 % 16))
    } else {
        let even = even_bytes((even_bytes(differences) * weight_q4) >> 4);
        even | (odd_bytes(differences) * weight_q4) << 4 & 0xff00_ff00
    }
}
