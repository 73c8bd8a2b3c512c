//! Matching costs of four disparities at once: bits counted in bytes side by side.
//!
//! The patterns of a run's pixels and those they are compared with are first copied to
//! rows of a constant length, so that a loop over disparities needs one register to reach
//! all of them. Patterns of more bytes than registers count at once are counted in parts,
//! the counts so far in the place of the costs.

use vgstereo_core::matching::{CostRun, NO_COST, cost_run as portable, cost_stride};
use vgstereo_core::minchinton::{CELLS_PER_BYTE, Planes};

use crate::simd::{
    add_even_bytes, add_odd_bytes, afresh, even_bytes, halve_difference_u8x4, in_order, load,
    min_u8x4, odd_bytes, opaque, splat_u8, splat_u16, store, sub_saturating_u8x4,
};

/// Most disparities, rounded up.
const MAX_STRIDE: usize = 64;

/// Pixels that are copied at a time.
const PIXELS: usize = 64;

/// Positions that these pixels' disparities reach, to a power of two, and a block.
const POSITIONS: usize = (PIXELS + MAX_STRIDE).next_power_of_two() + BLOCK;

/// Disparities that are looked up at a time.
const BLOCK: usize = 16;

/// Bytes of a pattern that are counted at a time, at most.
const PART: usize = 8;

/// Most parts: the counts of all but the last fit a byte.
const MAX_PARTS: usize = 4;

/// Writes the costs of every pixel of the run.
pub fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    if cost_registers(run, costs).is_none() {
        portable(run, costs);
    }
}

/// The same for what fits the registers.
fn cost_registers(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    let fits = (1..=MAX_STRIDE).contains(&run.disparities);
    let weighing = Weighing::new(run).filter(|_| fits)?;
    // Whole costs of cells, of which all together cost no more than a byte holds.
    let are_whole = || {
        let bits = run.cell_costs_q8.iter().fold(0, |bits, &cost| bits | cost);
        bits.is_multiple_of(256)
            && usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE <= u8::MAX.into()
    };
    let has_levels = run.difference_weight_q4 > 0;
    let bytes = run.inputs.count;
    match (bytes, run.masks.count, has_levels) {
        (4, 0, true) if are_whole() => {
            cost_pixels::<4, 6, { tile(6) }, 1>(run, 0, costs, |counts, pixel, levels, _| {
                let cells = counts * pixel.cell_cost;
                let missing = sub_saturating_u8x4(weighing.hamming_truncation, cells);
                weighing.cost(missing, pixel.level, levels)
            });
        }
        (8, 0, false) if are_whole() => {
            cost_pixels::<8, 8, { tile(8) }, 1>(run, 0, costs, |counts, pixel, _, _| {
                min_u8x4(counts * pixel.cell_cost, weighing.hamming_truncation)
            });
        }
        (6, 6, true) => {
            cost_pixels::<6, 8, { tile(8) }, 2>(run, 0, costs, |counts, pixel, levels, _| {
                let counts = [even_bytes(counts), odd_bytes(counts)];
                let missing = weighing.missing(counts, pixel.cell_cost);
                weighing.cost(missing, pixel.level, levels)
            });
        }
        (_, masks, true)
            if masks == bytes
                && bytes.is_multiple_of(PART)
                && (1..=MAX_PARTS).contains(&(bytes / PART)) =>
        {
            costs.fill(0);
            let last = bytes - PART;
            for first in (0..last).step_by(PART) {
                let add = |counts, _: &Pixel<PART, 2>, _, before| before + counts;
                cost_pixels::<PART, PART, { tile(PART) }, 2>(run, first, costs, add);
            }
            let finish = |counts, pixel: &Pixel<PART, 2>, levels, before| {
                let even = add_even_bytes(even_bytes(counts), before);
                let odd = add_odd_bytes(odd_bytes(counts), before);
                let missing = weighing.missing([even, odd], pixel.cell_cost);
                weighing.cost(missing, pixel.level, levels)
            };
            cost_pixels::<PART, 10, { tile(10) }, 2>(run, last, costs, finish);
        }
        _ => return None,
    }
    let stride = cost_stride(run.disparities).max(1);
    if run.disparities < stride {
        for costs in costs.chunks_exact_mut(stride) {
            if let Some(beyond) = costs.get_mut(run.disparities..) {
                beyond.fill(NO_COST);
            }
        }
    }
    Some(())
}

/// Bytes from a block of disparities in the first of so many rows to that in the last.
const fn tile(rows: usize) -> usize {
    (rows - 1) * POSITIONS + BLOCK
}

/// Counts the differing cells of `BYTES` bytes of the patterns, from byte `first_byte` on, and
/// writes what `finish` makes of the counts of four disparities, the pixel, the levels low and
/// high and what stands in their place. There are two more rows, of the levels, or none;
/// `TILE` is the [`tile`] of all of them. `TERMS` is 2 with masks; with 1 all cells count.
#[inline(never)]
fn cost_pixels<const BYTES: usize, const ROWS: usize, const TILE: usize, const TERMS: usize>(
    run: &CostRun<'_>,
    first_byte: usize,
    costs: &mut [u8],
    finish: impl Fn(u32, &Pixel<BYTES, TERMS>, [u32; 2], u32) -> u32 + Copy,
) {
    let stride = cost_stride(run.disparities).max(1);
    let mut patterns = [[[0; PIXELS]; TERMS]; BYTES];
    let mut levels = [0; PIXELS];
    let mut rows = [[0; POSITIONS]; ROWS];
    let groups = costs.chunks_mut((stride * PIXELS).max(1));
    for (group, (costs, cell_costs)) in groups.zip(run.cell_costs_q8.chunks(PIXELS)).enumerate() {
        let first = group * PIXELS;
        let pixels = cell_costs.len();
        // The last pixel's lowest disparity has the lowest position.
        let Some(lowest) = run.first_position.checked_sub(first + pixels - 1) else {
            return;
        };
        let positions = pixels - 1 + stride;
        let terms = [(run.inputs, run.start + first), (run.masks, first)];
        for (byte, patterns) in (first_byte..).zip(&mut patterns) {
            for (to, (planes, first)) in patterns.iter_mut().zip(terms) {
                copy_plane(planes, byte, first, pixels, to);
            }
        }
        let (others, other_levels) = rows.split_at_mut(BYTES);
        for (byte, to) in (first_byte..).zip(others) {
            copy_plane(run.stored, byte, lowest, positions, to);
        }
        if let [low, high] = other_levels {
            copy(run.levels[0], run.start + first, pixels, &mut levels);
            copy(run.other_low[0], lowest, positions, low);
            copy(run.other_high[0], lowest, positions, high);
        }
        let pixels = costs.chunks_exact_mut(stride).zip(cell_costs);
        for (x, (costs, &cell_cost)) in pixels.enumerate() {
            let four = |row: &[u8; PIXELS]| splat_u8(row[x % PIXELS]);
            let pixel = Pixel {
                patterns: patterns.each_ref().map(|terms| terms.each_ref().map(four)),
                level: four(&levels),
                // Where all cells count, costs are whole.
                cell_cost: (cell_cost >> if TERMS == 1 { 8 } else { 0 }).into(),
            };
            let at = run.first_position - (first + x) - lowest;
            let blocks = costs.as_chunks_mut::<BLOCK>().0.iter_mut();
            for (block, at) in blocks.zip((at..).step_by(BLOCK)) {
                // The bound is above all positions that there are.
                let tile = rows.as_flattened().get(at % (POSITIONS - BLOCK)..);
                let Some(tile) = tile.and_then(<[u8]>::first_chunk::<TILE>) else {
                    return;
                };
                let [first, second, third, fourth] = block.as_chunks_mut().0 else {
                    return;
                };
                cost_quad::<BYTES, ROWS, TILE, TERMS, 0>(&pixel, tile, first, finish);
                cost_quad::<BYTES, ROWS, TILE, TERMS, 1>(&pixel, tile, second, finish);
                cost_quad::<BYTES, ROWS, TILE, TERMS, 2>(&pixel, tile, third, finish);
                cost_quad::<BYTES, ROWS, TILE, TERMS, 3>(&pixel, tile, fourth, finish);
            }
        }
    }
}

/// A pixel, four times side by side.
struct Pixel<const BYTES: usize, const TERMS: usize> {
    /// Its cells, and which of them count.
    patterns: [[u32; TERMS]; BYTES],
    level: u32,
    /// What a cell costs, 1/256 where masks say which count.
    cell_cost: u32,
}

impl<const BYTES: usize, const TERMS: usize> Pixel<BYTES, TERMS> {
    /// The cells of a byte that differ from others and count.
    #[inline(always)]
    fn differing(&self, byte: usize, others: u32) -> u32 {
        match self.patterns[byte].as_slice() {
            [input, mask] => (others ^ input) & mask,
            [input] => others ^ input,
            _ => 0,
        }
    }
}

/// Writes the costs of four disparities: those of quad `QUAD` of the block.
#[inline(always)]
fn cost_quad<
    const BYTES: usize,
    const ROWS: usize,
    const TILE: usize,
    const TERMS: usize,
    const QUAD: usize,
>(
    pixel: &Pixel<BYTES, TERMS>,
    tile: &[u8; TILE],
    costs: &mut [u8; 4],
    finish: impl Fn(u32, &Pixel<BYTES, TERMS>, [u32; 2], u32) -> u32,
) {
    // In memory, two words are loaded at once; there are not enough registers for all.
    let pixel = afresh(pixel);
    let load_row = |row: usize| load_at(tile, row * POSITIONS + 4 * QUAD);
    let counts = count::<BYTES>(|byte| pixel.differing(byte, load_row(byte)));
    let levels = if BYTES < ROWS {
        [load_row(BYTES), load_row(BYTES + 1)]
    } else {
        [0; 2]
    };
    let cost = finish(opaque(counts), pixel, levels, load(costs));
    store(in_order(cost), costs);
}

/// Four bytes of a tile.
#[inline(always)]
fn load_at<const TILE: usize>(tile: &[u8; TILE], at: usize) -> u32 {
    let bytes = tile.get(at..).and_then(<[u8]>::first_chunk);
    bytes.map_or(0, load)
}

/// Copies a run of positions of a plane; beyond the planes, nothing.
fn copy_plane(planes: Planes<'_>, byte: usize, first: usize, count: usize, to: &mut [u8]) {
    if byte < planes.count {
        copy(planes.bytes, byte * planes.stride + first, count, to);
    }
}

/// Copies a run of a row; beyond the row, nothing.
#[inline(never)]
fn copy(row: &[u8], first: usize, count: usize, to: &mut [u8]) {
    if let Some(run) = row.get(first..first + count)
        && let Some(to) = to.get_mut(..count)
    {
        // Words at once: a call to copy memory would take longer.
        let (run, run_rest) = run.as_chunks::<BLOCK>();
        let (to, to_rest) = to.as_chunks_mut::<BLOCK>();
        for (to, from) in to.iter_mut().zip(run) {
            for (to, from) in to.as_chunks_mut().0.iter_mut().zip(from.as_chunks().0) {
                store(opaque(load(from)), to);
            }
        }
        for (to, from) in to_rest.iter_mut().zip(run_rest) {
            *to = *from;
        }
    }
}

/// What turns the terms of a cost into the cost, for all bytes of a register.
struct Weighing {
    hamming_truncation: u32,
    difference_truncation: u32,
    /// Twice the cost of a difference of one level.
    weight: u32,
    /// Twice the largest cost.
    largest: u32,
}

impl Weighing {
    /// Where levels have one channel, if any, their weight is in halves, and twice the largest
    /// cost fits a byte.
    fn new(run: &CostRun<'_>) -> Option<Self> {
        let weight = run.difference_weight_q4 / 8;
        let levels = weight.checked_mul(run.difference_truncation)?;
        let largest = run.hamming_truncation.checked_mul(2)?.checked_add(levels)?;
        let is_halves = run.difference_weight_q4.is_multiple_of(8);
        let has_one_channel = run.channels == 1 || run.difference_weight_q4 == 0;
        (has_one_channel && is_halves).then(|| Self {
            hamming_truncation: splat_u8(run.hamming_truncation),
            difference_truncation: splat_u8(run.difference_truncation),
            weight: weight.into(),
            largest: splat_u8(largest),
        })
    }

    /// What the costs of so many cells, those of bytes 0 and 2 and of 1 and 3, are below their
    /// truncation.
    #[inline(always)]
    fn missing(&self, counts: [u32; 2], cost_q8: u32) -> u32 {
        // With the rounding, each product is less than 2^16.
        let [even, odd] = counts.map(|counts| counts * cost_q8 + splat_u16(128));
        let cells = odd_bytes(even) | odd & 0xff00_ff00;
        sub_saturating_u8x4(self.hamming_truncation, cells)
    }

    /// Costs of what those of the cells are below their truncation, and of a level that differs
    /// from others, less and more their dead zone.
    #[inline(always)]
    fn cost(&self, cells: u32, level: u32, [low, high]: [u32; 2]) -> u32 {
        // Levels too as what is missing up to their truncation: that needs no minimum. One of
        // the two differences is 0.
        let difference = sub_saturating_u8x4(level, high) | sub_saturating_u8x4(low, level);
        let levels = sub_saturating_u8x4(self.difference_truncation, difference) * self.weight;
        // Halves are rounded down, as the cost of levels is.
        halve_difference_u8x4(self.largest, levels).wrapping_sub(cells)
    }
}

/// Counts the bits of each byte over `BYTES` words.
#[inline(always)]
fn count<const BYTES: usize>(word: impl Fn(usize) -> u32) -> u32 {
    match BYTES {
        4 => {
            let (ones, twos) = add(word(0), word(1), word(2));
            // At most 8 in two nibbles of twos.
            let twos = nibbles(twos);
            let twos = (twos + (twos >> 4)) & 0x0f0f_0f0f;
            bytes_of(nibbles(ones) + nibbles(word(3))) + 2 * twos
        }
        6 => {
            let (ones, twos_a) = add(word(0), word(1), word(2));
            let (ones, twos_b) = add(ones, word(3), word(4));
            bytes_of(nibbles(ones) + nibbles(word(5)))
                + 2 * bytes_of(nibbles(twos_a) + nibbles(twos_b))
        }
        PART => {
            let (ones, twos_a) = add(word(0), word(1), word(2));
            let (ones, twos_b) = add(ones, word(3), word(4));
            let (ones, twos_c) = add(ones, word(5), word(6));
            let (twos, fours) = add(twos_a, twos_b, twos_c);
            bytes_of(nibbles(ones) + nibbles(word(7)))
                + 2 * bytes_of(nibbles(twos) + 2 * nibbles(fours))
        }
        _ => 0,
    }
}

/// Adds three bits in every place: the sum's two bits.
#[inline(always)]
fn add(a: u32, b: u32, c: u32) -> (u32, u32) {
    (in_order(a ^ b ^ c), in_order(a & b | (a ^ b) & c))
}

/// Bits of every four.
#[inline(always)]
fn nibbles(word: u32) -> u32 {
    // Masked before they are shifted: an addition shifts its operand for nothing.
    let pairs = word - (opaque(word & 0xaaaa_aaaa) >> 1);
    (pairs & 0x3333_3333) + (opaque(pairs & 0xcccc_cccc) >> 2)
}

/// Sums of the two nibbles of each byte.
#[inline(always)]
fn bytes_of(nibbles: u32) -> u32 {
    (nibbles & 0x0f0f_0f0f) + (opaque(nibbles & 0xf0f0_f0f0) >> 4)
}
