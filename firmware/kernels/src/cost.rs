//! Matching costs of four disparities at once: bits counted in bytes side by side.
//!
//! The patterns of a run's pixels and those they are compared with are first copied to
//! rows of a constant length, so that a loop over disparities needs one register to reach
//! all of them.

use core::array::from_fn;

use vgstereo_core::matching::{CostRun, NO_COST, cost_run as portable, cost_stride};
use vgstereo_core::minchinton::{CELLS_PER_BYTE, Planes};

use crate::simd::{
    even_bytes, halve_difference_u8x4, in_order, load, min_u8x4, odd_bytes, opaque, splat_u8,
    splat_u16, store, sub_saturating_u8x4,
};

/// Most disparities, rounded up.
const MAX_STRIDE: usize = 64;

/// Pixels that are copied at a time.
const PIXELS: usize = 64;

/// Positions that these pixels' disparities reach, to a power of two, and a block.
const POSITIONS: usize = (PIXELS + MAX_STRIDE).next_power_of_two() + BLOCK;

/// Disparities that share what is loaded of a pixel.
const BLOCK: usize = 16;

/// Writes the costs of every pixel of the run.
pub fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    let fits = (1..=MAX_STRIDE).contains(&run.disparities);
    let weighing = Weighing::new(run).filter(|_| fits);
    // Whole costs of cells, of which all together cost no more than a byte holds.
    let are_whole = || {
        let bits = run.cell_costs_q8.iter().fold(0, |bits, &cost| bits | cost);
        bits.is_multiple_of(256)
            && usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE <= u8::MAX.into()
    };
    let Some(weighing) = &weighing else {
        return portable(run, costs);
    };
    let has_levels = run.difference_weight_q4 > 0;
    match (run.inputs.count, run.masks.count, has_levels) {
        (4, 0, true) if are_whole() => {
            cost_pixels::<4, 6, { tile(6) }, false>(run, weighing, costs);
        }
        (8, 0, false) if are_whole() => {
            cost_pixels::<8, 8, { tile(8) }, false>(run, weighing, costs);
        }
        (6, 6, true) => cost_pixels::<6, 8, { tile(8) }, true>(run, weighing, costs),
        (8, 8, true) => cost_pixels::<8, 10, { tile(10) }, true>(run, weighing, costs),
        _ => portable(run, costs),
    }
}

/// Bytes from a block of disparities in the first of so many rows to that in the last.
const fn tile(rows: usize) -> usize {
    (rows - 1) * POSITIONS + BLOCK
}

/// The same for patterns of `BYTES` bytes. There are two more rows, of the levels, or none;
/// `TILE` is the [`tile`] of all of them. Without masks all cells count, and a cell's cost is
/// whole.
#[inline(never)]
fn cost_pixels<const BYTES: usize, const ROWS: usize, const TILE: usize, const MASKED: bool>(
    run: &CostRun<'_>,
    weighing: &Weighing,
    costs: &mut [u8],
) {
    let stride = cost_stride(run.disparities).max(1);
    let mut inputs = [[0; PIXELS]; BYTES];
    let mut masks = [[0; PIXELS]; BYTES];
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
        copy_planes(run.inputs, run.start + first, pixels, &mut inputs);
        if MASKED {
            copy_planes(run.masks, first, pixels, &mut masks);
        }
        copy_planes(run.stored, lowest, positions, &mut rows);
        if let [.., low, high] = &mut rows[BYTES..] {
            copy(run.levels[0], run.start + first, pixels, &mut levels);
            copy(run.other_low[0], lowest, positions, low);
            copy(run.other_high[0], lowest, positions, high);
        }
        let pixels = costs.chunks_exact_mut(stride).zip(cell_costs);
        for (x, (costs, &cell_cost)) in pixels.enumerate() {
            let four = |plane: &[u8; PIXELS]| splat_u8(plane[x % PIXELS]);
            let pixel = Pixel::<BYTES, MASKED> {
                input: from_fn(|byte| four(&inputs[byte])),
                mask: from_fn(|byte| four(&masks[byte])),
                level: four(&levels),
                cell_cost: cell_cost.into(),
            };
            let mut at = run.first_position - (first + x) - lowest;
            for block in costs.as_chunks_mut::<BLOCK>().0 {
                // The bound is above all positions that there are.
                let from = at % (POSITIONS - BLOCK);
                let tile = rows.as_flattened().get(from..);
                let Some(tile) = tile.and_then(<[u8]>::first_chunk::<TILE>) else {
                    break;
                };
                let [first, second, third, fourth] = block.as_chunks_mut().0 else {
                    break;
                };
                store(pixel.costs::<ROWS, TILE, 0>(tile, weighing), first);
                store(pixel.costs::<ROWS, TILE, 1>(tile, weighing), second);
                store(pixel.costs::<ROWS, TILE, 2>(tile, weighing), third);
                store(pixel.costs::<ROWS, TILE, 3>(tile, weighing), fourth);
                at += BLOCK;
            }
            if run.disparities < stride
                && let Some(beyond) = costs.get_mut(run.disparities..)
            {
                beyond.fill(NO_COST);
            }
        }
    }
}

/// A pixel, four times side by side.
struct Pixel<const BYTES: usize, const MASKED: bool> {
    input: [u32; BYTES],
    mask: [u32; BYTES],
    level: u32,
    cell_cost: u32,
}

impl<const BYTES: usize, const MASKED: bool> Pixel<BYTES, MASKED> {
    /// Costs of four disparities: those of word `WORD` of the block.
    #[inline(always)]
    fn costs<const ROWS: usize, const TILE: usize, const WORD: usize>(
        &self,
        tile: &[u8; TILE],
        weighing: &Weighing,
    ) -> u32 {
        let load = |row: usize| load_at(tile, row * POSITIONS + 4 * WORD);
        let count = count::<BYTES>(|byte| {
            let differ = load(byte) ^ self.input[byte];
            if MASKED {
                differ & self.mask[byte]
            } else {
                differ
            }
        });
        let cells = if MASKED {
            rounded(count, self.cell_cost)
        } else {
            count * (self.cell_cost >> 8)
        };
        in_order(if BYTES < ROWS {
            weighing.cost(cells, self.level, [load(BYTES), load(BYTES + 1)])
        } else {
            min_u8x4(cells, weighing.hamming_truncation)
        })
    }
}

/// Four bytes of a tile.
#[inline(always)]
fn load_at<const TILE: usize>(tile: &[u8; TILE], at: usize) -> u32 {
    let bytes = tile.get(at..).and_then(<[u8]>::first_chunk);
    bytes.map_or(0, load)
}

/// Copies a run of positions; beyond the planes, nothing.
fn copy_planes<const LENGTH: usize>(
    planes: Planes<'_>,
    first: usize,
    count: usize,
    copies: &mut [[u8; LENGTH]],
) {
    for (byte, to) in copies.iter_mut().take(planes.count).enumerate() {
        copy(planes.bytes, byte * planes.stride + first, count, to);
    }
}

/// Copies a run of a row; beyond the row, nothing.
fn copy(row: &[u8], first: usize, count: usize, to: &mut [u8]) {
    if let Some(run) = row.get(first..first + count)
        && let Some(to) = to.get_mut(..count)
    {
        // Words at once: a call to copy memory would take longer.
        let (run, run_rest) = run.as_chunks();
        let (to, to_rest) = to.as_chunks_mut();
        for (to, from) in to.iter_mut().zip(run) {
            store(opaque(load(from)), to);
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

    /// Costs of what the cells cost, before truncation, and of a level that differs from
    /// others, less and more their dead zone.
    #[inline(always)]
    fn cost(&self, cells: u32, level: u32, [low, high]: [u32; 2]) -> u32 {
        // Both terms as what is missing up to their truncation: that needs no minimum.
        let cells = sub_saturating_u8x4(self.hamming_truncation, cells);
        // One of the two is 0.
        let difference = sub_saturating_u8x4(level, high) | sub_saturating_u8x4(low, level);
        let levels = sub_saturating_u8x4(self.difference_truncation, difference) * self.weight;
        // Halves are rounded down, as the cost of levels is.
        halve_difference_u8x4(self.largest, levels).wrapping_sub(cells)
    }
}

/// The costs of so many cells.
#[inline(always)]
fn rounded(counts: u32, cost_q8: u32) -> u32 {
    // With the rounding, each product is less than 2^16.
    let (counts, rounding) = (opaque(counts), splat_u16(128));
    let even = even_bytes(counts) * cost_q8 + rounding;
    let odd = odd_bytes(counts) * cost_q8 + rounding;
    odd_bytes(even) | odd & 0xff00_ff00
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
        8 => {
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
    (a ^ b ^ c, a & b | (a ^ b) & c)
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
