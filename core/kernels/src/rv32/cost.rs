//! Matching costs of patterns of 32 cells, and of 48 masked cells, with levels of grey. Those of the levels are
//! [looked up](LevelCosts).
//!
//! Without Zbb, differing cells are counted in the four bytes of a register, one for each of four disparities.
//! Loads must be aligned, and the patterns of a pixel's disparities begin at any byte: so the rows of patterns
//! are copied and then moved by one byte three times, and each time every fourth pixel is compared. With Zbb,
//! which counts the ones of a word, the patterns are turned into words.

use bytemuck::{must_cast_slice_mut, try_cast_slice_mut};
use vgstereo_core::kernel::{
    CELLS_PER_BYTE, CostRun, Kernels, LANES, NO_COST, Planes, cost_stride,
};

use super::levels::{LevelCosts, PLACES, cost_at};
use crate::Armv7em;
use crate::armv7em::cost::{Constants, count};
use crate::armv7em::simd::{even_bytes, odd_bytes, splat_u8, splat_u16, unrolled};

/// Largest number of disparities, rounded up to a multiple of 16.
const MAX_STRIDE: usize = 64;

/// Pixels whose patterns are copied at a time.
const PIXELS: usize = 32;

/// Positions of the other view that their disparities reach, and one more.
const POSITIONS: usize = PIXELS + MAX_STRIDE;

/// Disparities whose loop is unrolled, those that share a word of costs, and the words.
const BLOCK: usize = LANES;
const QUAD: usize = 4;
const WORDS: usize = BLOCK / QUAD;

/// Words of a row of patterns.
const ROW: usize = POSITIONS / QUAD;

/// Words of the rows of patterns of `bytes` bytes from a block's first in the first row to its last in the last. A
/// slice of constant length spares bounds checks.
const fn tile_words(bytes: usize) -> usize {
    (bytes - 1) * ROW + WORDS
}

/// Equals [`vgstereo_core::kernel::cost_run`] bit for bit.
pub(super) fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    if write_costs(run, costs).is_none() {
        Armv7em.cost_run(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it.
fn write_costs(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    let has_grey = run.channels == 1 && run.difference_weight_q4 > 0;
    let fits = (1..=MAX_STRIDE).contains(&run.disparities) && run.hamming_truncation <= 127;
    let pixels = run.cell_costs_q8.len().min(run.truncations.len());
    if !has_grey || !fits || pixels == 0 {
        return None;
    }
    let stride = cost_stride(run.disparities);
    let lowest = run.first_position.checked_sub(pixels - 1)?;
    let positions = lowest..lowest + pixels - 1 + stride;
    let low = run.other_low[0].get(positions.clone())?;
    let high = run.other_high[0].get(positions)?;
    let levels = LevelCosts::new(run, low, high);
    match (run.inputs.count, run.masks.count) {
        (4, 0) if are_whole(run) => write_groups::<4, 1, { tile_words(4) }>(run, &levels, costs)?,
        (6, 6) => write_groups::<6, 2, { tile_words(6) }>(run, &levels, costs)?,
        _ => return None,
    }
    if run.disparities < stride {
        for costs in costs.chunks_exact_mut(stride) {
            if let Some(beyond) = costs.get_mut(run.disparities..) {
                beyond.fill(NO_COST);
            }
        }
    }
    Some(())
}

/// Whether the cost of a cell is a whole number and all cells together cost at most 255.
fn are_whole(run: &CostRun<'_>) -> bool {
    let bits = run.cell_costs_q8.iter().fold(0, |bits, &cost| bits | cost);
    let most = usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE;
    bits.is_multiple_of(256) && most <= u8::MAX.into()
}

/// Writes the costs of patterns of `BYTES` bytes, [`PIXELS`] pixels at a time. `TERMS` is 2 with masks and 1 if
/// all cells count.
fn write_groups<const BYTES: usize, const TERMS: usize, const TILE: usize>(
    run: &CostRun<'_>,
    levels: &LevelCosts,
    costs: &mut [u8],
) -> Option<()> {
    let stride = cost_stride(run.disparities);
    let mut places = [0; POSITIONS];
    let mut rows = [[0; ROW]; BYTES];
    let cells = run
        .cell_costs_q8
        .chunks(PIXELS)
        .zip(run.truncations.chunks(PIXELS));
    for (group, (costs, (cell_costs_q8, truncations))) in
        costs.chunks_mut(PIXELS * stride).zip(cells).enumerate()
    {
        let first = PIXELS * group;
        let pixels = cell_costs_q8.len().min(truncations.len());
        // The lowest position is that of the last pixel's lowest disparity.
        let lowest = run.first_position.checked_sub(first + pixels - 1)?;
        let count = pixels - 1 + stride;
        let positions = lowest..lowest + count;
        let low = run.other_low[0].get(positions.clone())?;
        let high = run.other_high[0].get(positions)?;
        levels.place(low, high, &mut places)?;
        let start = run.start + first;
        let group = Group::<BYTES, TERMS, TILE> {
            inputs: own_rows(run.inputs, start, pixels)?,
            masks: if TERMS == 1 {
                [&[]; BYTES]
            } else {
                own_rows(run.masks, first, pixels)?
            },
            cell_costs_q8,
            truncations,
            levels: run.levels[0].get(start..start + pixels)?,
            places: &places,
            stride,
        };
        for (byte, row) in rows.iter_mut().enumerate() {
            let row: &mut [u8] = must_cast_slice_mut(row.as_mut_slice());
            row.get_mut(..count)?
                .copy_from_slice(plane(run.stored, byte, lowest, count)?);
        }
        let costs: &mut [u32] = try_cast_slice_mut(costs).ok()?;
        group.write_packed(&mut rows, levels, costs);
    }
    Some(())
}

/// A run of positions in one plane.
fn plane(planes: Planes<'_>, byte: usize, first: usize, count: usize) -> Option<&[u8]> {
    let start = byte * planes.stride + first;
    planes.bytes.get(start..start + count)
}

/// The pixels' bytes in all planes.
fn own_rows<const BYTES: usize>(
    planes: Planes<'_>,
    first: usize,
    pixels: usize,
) -> Option<[&[u8]; BYTES]> {
    let mut rows: [&[u8]; BYTES] = [&[]; BYTES];
    for (byte, row) in rows.iter_mut().enumerate() {
        *row = plane(planes, byte, first, pixels)?;
    }
    Some(rows)
}

/// Pixels whose patterns are compared with the same rows.
struct Group<'a, const BYTES: usize, const TERMS: usize, const TILE: usize> {
    inputs: [&'a [u8]; BYTES],
    masks: [&'a [u8]; BYTES],
    cell_costs_q8: &'a [u16],
    truncations: &'a [u8],
    levels: &'a [u8],
    /// Places of the intervals of levels of the other view, from the lowest position on.
    places: &'a [u16; POSITIONS],
    stride: usize,
}

impl<const BYTES: usize, const TERMS: usize, const TILE: usize> Group<'_, BYTES, TERMS, TILE> {
    /// Writes the costs of all pixels, given the rows of patterns of the other view, which are moved.
    fn write_packed(&self, rows: &mut [[u32; ROW]; BYTES], levels: &LevelCosts, costs: &mut [u32]) {
        for moved in 0..QUAD {
            if moved > 0 {
                rows.iter_mut().for_each(move_by_a_byte);
            }
            // The lowest disparity of the last pixel is at position 0.
            let pixels = (0..self.levels.len()).rev().skip(moved).step_by(QUAD);
            for (word, x) in pixels.enumerate() {
                let words = self.stride / QUAD;
                let costs = costs.get_mut(words * x..words * (x + 1));
                if let (Some(pixel), Some(costs)) = (self.pixel(x, levels), costs) {
                    let places = self.places.get(QUAD * word + moved..).unwrap_or_default();
                    pixel.write(rows, word, places, costs);
                }
            }
        }
    }

    /// The values of a pixel.
    #[inline(always)]
    fn pixel<'a>(&self, x: usize, levels: &'a LevelCosts) -> Option<Pixel<'a, BYTES, TERMS, TILE>> {
        let mut patterns = [[0; TERMS]; BYTES];
        for (pattern, (input, mask)) in patterns.iter_mut().zip(self.inputs.iter().zip(self.masks))
        {
            for (pattern, row) in pattern.iter_mut().zip([input, mask]) {
                *pattern = splat_u8(*row.get(x)?);
            }
        }
        let cell_cost_q8 = u32::from(*self.cell_costs_q8.get(x)?);
        Some(Pixel {
            patterns,
            // If all cells count, the cost of a cell is a whole number.
            cell_cost: cell_cost_q8 >> if TERMS == 1 { 8 } else { 0 },
            truncation: splat_u8(*self.truncations.get(x)?),
            levels: levels.of(*self.levels.get(x)?)?,
        })
    }
}

/// Moves a row to the front by one byte.
#[inline(always)]
fn move_by_a_byte(row: &mut [u32; ROW]) {
    let mut word = row[0];
    for at in 0..ROW - 1 {
        let next = row[at + 1];
        row[at] = word >> 8 | next << 24;
        word = next;
    }
    row[ROW - 1] = word >> 8;
}

/// A pixel's values.
struct Pixel<'a, const BYTES: usize, const TERMS: usize, const TILE: usize> {
    /// Each byte of the pattern, and of the mask if there is one, in all four bytes.
    patterns: [[u32; TERMS]; BYTES],
    /// Cost of a differing cell; 1/256 of a cost if there are masks.
    cell_cost: u32,
    /// Largest cost of the pattern, at most 127, in all four bytes.
    truncation: u32,
    /// Costs of the level.
    levels: &'a [u8; PLACES],
}

impl<const BYTES: usize, const TERMS: usize, const TILE: usize> Pixel<'_, BYTES, TERMS, TILE> {
    /// Writes the pixel's costs. The patterns begin at a word of the rows.
    #[inline(always)]
    fn write(&self, rows: &[[u32; ROW]; BYTES], word: usize, places: &[u16], costs: &mut [u32]) {
        let constants = Constants::new();
        let words = rows.as_flattened();
        let blocks = costs
            .as_chunks_mut::<WORDS>()
            .0
            .iter_mut()
            .zip(places.as_chunks::<BLOCK>().0);
        for ((costs, places), word) in blocks.zip((word..).step_by(WORDS)) {
            let tile = words.get(word..).and_then(<[u32]>::first_chunk::<TILE>);
            let Some(tile) = tile else {
                return;
            };
            unrolled::<WORDS>(|at| {
                let differing = |byte: usize| {
                    let others = tile[(byte * ROW + at) % TILE];
                    match self.patterns[byte].as_slice() {
                        [input, mask] => (others ^ input) & mask,
                        [input] => others ^ input,
                        _ => 0,
                    }
                };
                let counts = count::<BYTES>(
                    constants,
                    |first| [differing(first), differing(first + 1), differing(first + 2)],
                    |first| [differing(first), differing(first + 1)],
                    || differing(BYTES - 1),
                );
                let level = |lane: usize| cost_at(self.levels, places[QUAD * at + lane]);
                let levels = level(0) | level(1) << 8 | level(2) << 16 | level(3) << 24;
                costs[at] = self.truncation + levels - self.missing(counts);
            });
        }
    }

    /// Returns by how much the costs of four counts of differing cells are below their truncation.
    #[inline(always)]
    fn missing(&self, counts: u32) -> u32 {
        const TOPS: u32 = splat_u8(0x80);
        let cells = if TERMS == 1 {
            counts * self.cell_cost
        } else {
            // Each product is less than 2^16, also after rounding.
            let cost = |counts: u32| counts * self.cell_cost + splat_u16(128);
            odd_bytes(cost(even_bytes(counts))) | cost(odd_bytes(counts)) & splat_u16(0xff00)
        };
        // Differences of seven bits do not borrow, as the top bit of each is set.
        let missing = (self.truncation | TOPS) - (cells & !TOPS);
        let is_missing = missing & !cells & TOPS;
        missing & (is_missing - (is_missing >> 7))
    }
}
