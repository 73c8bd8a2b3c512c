//! Matching costs of four disparities at once: bits counted in bytes side by side.
//!
//! The patterns of a run's pixels and those they are compared with are first copied to
//! rows of a constant length, so that a loop over disparities needs one register to reach
//! all of them.

use core::array::from_fn;

use vgstereo_core::matching::{CostRun, NO_COST, cost_run as portable, cost_stride};
use vgstereo_core::minchinton::Planes;

use crate::simd::{
    add_saturating_u8x4, even_bytes, load, min_u8x4, odd_bytes, opaque, splat_u8, splat_u16, store,
    sub_saturating_u8x4,
};

/// Most disparities, rounded up.
const MAX_STRIDE: usize = 64;

/// Pixels whose patterns are copied at a time.
const PIXELS: usize = 32;

/// Positions that these pixels' disparities reach.
const POSITIONS: usize = PIXELS + MAX_STRIDE;

/// Disparities that share what is loaded of a pixel.
const BLOCK: usize = 8;

/// Writes the costs of every pixel of the run.
pub fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(run.disparities);
    // Costs of levels are those of one channel.
    let is_grey = run.channels == 1 || run.difference_weight_q4 == 0;
    if !is_grey || stride > MAX_STRIDE || run.disparities == 0 {
        return portable(run, costs);
    }
    match (run.inputs.count, run.masks.count) {
        (4, 0) => cost_pixels::<4, { tile(4) }, false>(run, stride, costs),
        (8, 0) => cost_pixels::<8, { tile(8) }, false>(run, stride, costs),
        (8, 8) => cost_pixels::<8, { tile(8) }, true>(run, stride, costs),
        _ => portable(run, costs),
    }
}

/// Bytes of the copied rows from a block of disparities in the first to that in the last.
const fn tile(bytes: usize) -> usize {
    (bytes - 1) * POSITIONS + BLOCK
}

/// The same for patterns of `BYTES` bytes and `TILE` of that many.
#[inline(never)]
fn cost_pixels<const BYTES: usize, const TILE: usize, const MASKED: bool>(
    run: &CostRun<'_>,
    stride: usize,
    costs: &mut [u8],
) {
    let mut inputs = [[0; PIXELS]; BYTES];
    let mut masks = [[0; PIXELS]; BYTES];
    let mut stored = [[0; POSITIONS]; BYTES];
    let weighing = Weighing::new(run);
    let groups = costs.chunks_mut((stride * PIXELS).max(1));
    for (group, (costs, cell_costs)) in groups.zip(run.cell_costs_q8.chunks(PIXELS)).enumerate() {
        let first = group * PIXELS;
        let pixels = cell_costs.len();
        // The last pixel's lowest disparity has the lowest position.
        let Some(lowest) = run.first_position.checked_sub(first + pixels - 1) else {
            return;
        };
        copy_planes(run.inputs, run.start + first, pixels, &mut inputs);
        if MASKED {
            copy_planes(run.masks, first, pixels, &mut masks);
        }
        copy_planes(run.stored, lowest, pixels - 1 + stride, &mut stored);
        let pixels = costs.chunks_exact_mut(stride.max(1)).zip(cell_costs);
        for (x, (costs, &cell_cost)) in pixels.enumerate() {
            let input: [u32; BYTES] = from_fn(|byte| pixel(&inputs[byte], x));
            let mask: [u32; BYTES] =
                from_fn(|byte| if MASKED { pixel(&masks[byte], x) } else { 0 });
            let scale = u32::from(cell_cost);
            let position = run.first_position - (first + x);
            let level = run.levels[0]
                .get(run.start + first + x)
                .copied()
                .unwrap_or(0);
            let low = others(run.other_low[0], position);
            let high = others(run.other_high[0], position);
            let tiles = stored
                .as_flattened()
                .get(position - lowest..)
                .unwrap_or_default();
            let tiles = (0..)
                .step_by(BLOCK)
                .map_while(|at| tiles.get(at..)?.first_chunk::<TILE>());
            let differing = |tile: &[u8; TILE], word: usize| {
                count::<BYTES>(|byte| {
                    let stored = tile.get(byte * POSITIONS + 4 * word..);
                    let stored = stored.and_then(<[u8]>::first_chunk).map_or(0, load);
                    let cells = stored ^ input[byte];
                    if MASKED { cells & mask[byte] } else { cells }
                })
            };
            let blocks = costs.as_chunks_mut::<BLOCK>().0.iter_mut().zip(tiles);
            if run.difference_weight_q4 == 0 {
                for (block, tile) in blocks {
                    for (word, costs) in block.as_chunks_mut().0.iter_mut().enumerate() {
                        store(weighing.cells(differing(tile, word), scale), costs);
                    }
                }
            } else {
                let level = splat_u8(level);
                for ((block, tile), (low, high)) in blocks.zip(low.iter().zip(high)) {
                    let levels = low.as_chunks().0.iter().zip(high.as_chunks().0);
                    let words = block.as_chunks_mut().0.iter_mut().zip(levels);
                    for (word, (costs, (low, high))) in words.enumerate() {
                        let cells = weighing.cells(differing(tile, word), scale);
                        let levels = weighing.levels(level, load(low), load(high));
                        store(add_saturating_u8x4(cells, levels), costs);
                    }
                }
            }
            if run.disparities < stride
                && let Some(beyond) = costs.get_mut(run.disparities..)
            {
                beyond.fill(NO_COST);
            }
        }
    }
}

/// Copies a run of positions; beyond the planes, nothing.
fn copy_planes<const BYTES: usize, const LENGTH: usize>(
    planes: Planes<'_>,
    first: usize,
    count: usize,
    copies: &mut [[u8; LENGTH]; BYTES],
) {
    for (byte, copy) in copies.iter_mut().enumerate() {
        let start = byte * planes.stride + first;
        if let Some(run) = planes.bytes.get(start..start + count)
            && let Some(copy) = copy.get_mut(..count)
        {
            copy.copy_from_slice(run);
        }
    }
}

/// A byte of a pixel's pattern, four times.
#[inline(always)]
fn pixel(plane: &[u8; PIXELS], x: usize) -> u32 {
    splat_u8(plane[x % PIXELS])
}

/// Levels of the other view from a position on.
#[inline(always)]
fn others(levels: &[u8], position: usize) -> &[[u8; BLOCK]] {
    levels.get(position..).unwrap_or_default().as_chunks().0
}

/// What turns counts and differences into costs, for all bytes of a register.
struct Weighing {
    hamming_truncation: u32,
    difference_truncation: u32,
    difference_weight_q4: u32,
}

impl Weighing {
    fn new(run: &CostRun<'_>) -> Self {
        Self {
            hamming_truncation: splat_u8(run.hamming_truncation),
            difference_truncation: splat_u8(run.difference_truncation),
            difference_weight_q4: run.difference_weight_q4.into(),
        }
    }

    /// Costs of so many cells that differ.
    #[inline(always)]
    fn cells(&self, counts: u32, scale_q8: u32) -> u32 {
        // With the rounding, each product is less than 2^16.
        let rounding = splat_u16(128);
        let even = even_bytes(counts) * scale_q8 + rounding;
        let odd = odd_bytes(counts) * scale_q8 + rounding;
        min_u8x4(odd_bytes(even) | odd & 0xff00_ff00, self.hamming_truncation)
    }

    /// Costs of a level that differs from others, dead zone included.
    #[inline(always)]
    fn levels(&self, level: u32, low: u32, high: u32) -> u32 {
        // One of the two is 0.
        let difference = sub_saturating_u8x4(level, high) | sub_saturating_u8x4(low, level);
        let difference = min_u8x4(difference, self.difference_truncation);
        // Products fit 16 bits, and their quotients 8: the configuration bounds them.
        let even = even_bytes(difference) * self.difference_weight_q4;
        let odd = odd_bytes(difference) * self.difference_weight_q4;
        even_bytes(even >> 4) | even_bytes(odd >> 4) << 8
    }
}

/// Counts the bits of each byte over `BYTES` words.
#[inline(always)]
fn count<const BYTES: usize>(word: impl Fn(usize) -> u32) -> u32 {
    match BYTES {
        4 => {
            let (ones, twos) = add(word(0), word(1), word(2));
            let last = word(3);
            bytes_of(nibbles(ones) + 2 * nibbles(twos)) + bytes_of(nibbles(last))
        }
        8 => {
            let (ones, twos_a) = add(word(0), word(1), word(2));
            let (ones, twos_b) = add(ones, word(3), word(4));
            let (ones, twos_c) = add(ones, word(5), word(6));
            let (twos, fours) = add(twos_a, twos_b, twos_c);
            let last = word(7);
            bytes_of(nibbles(ones) + nibbles(last))
                + 2 * bytes_of(nibbles(twos) + 2 * nibbles(fours))
        }
        _ => 0,
    }
}

/// Adds three bits in every place: the sum's two bits.
#[inline(always)]
fn add(a: u32, b: u32, c: u32) -> (u32, u32) {
    let differ = a ^ b;
    (differ ^ c, a & b | differ & c)
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
