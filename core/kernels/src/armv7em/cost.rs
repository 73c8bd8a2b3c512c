//! Matching costs of four disparities at once: differing cells are counted in four bytes of a
//! register.
//!
//! The patterns of a run's pixels and the patterns that they are compared with are first copied to
//! rows of a constant length, so that the loop over disparities needs only one register to address
//! all of them. Patterns of more bytes than fit the registers are counted in parts; meanwhile the
//! counts so far stand where the costs will.

use vgstereo_core::kernel::{
    CELLS_PER_BYTE, CostRun, MASK_LANES, NO_COST, Planes, cost_run as portable, cost_stride,
};

use super::simd::{
    add_even_bytes, add_odd_bytes, afresh, even_bytes, halve_difference_u8x4, in_order, load,
    min_u8x4, odd_bytes, opaque, splat_u8, splat_u16, store, sub_saturating_u8x4,
};

/// Largest number of disparities, rounded up to a multiple of 16.
const MAX_STRIDE: usize = 64;

/// Largest number of pixels whose patterns are copied at a time.
const MAX_PIXELS: usize = 64;

/// Number of pixels at a time if there are masks, which come for as many.
const MASKED_PIXELS: usize = MASK_LANES;

/// Positions per row: all that the disparities of these pixels reach, rounded up to a power of two,
/// and one block more.
const POSITIONS: usize = (MAX_PIXELS + MAX_STRIDE).next_power_of_two() + BLOCK;

/// Number of disparities compared at a time.
const BLOCK: usize = 16;

/// Largest number of bytes of a pattern that are counted at a time.
const PART: usize = 8;

/// Largest number of parts: the counts of all but the last part fit 8 bits.
const MAX_PARTS: usize = 4;

/// Writes the costs of every pixel of the run.
pub(super) fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    if cost_registers(run, costs).is_none() {
        portable(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it.
fn cost_registers(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    let fits = (1..=MAX_STRIDE).contains(&run.disparities);
    let weighing = Weighing::new(run).filter(|_| fits)?;
    // Whether the cost per cell is a whole number and all cells together cost at most 255.
    let are_whole = || {
        let bits = run.cell_costs_q8.iter().fold(0, |bits, &cost| bits | cost);
        bits.is_multiple_of(256)
            && usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE <= u8::MAX.into()
    };
    let has_levels = run.difference_weight_q4 > 0;
    let bytes = run.inputs.count;
    match (bytes, run.masks.count, has_levels) {
        (4, 0, true) if are_whole() => {
            cost_pixels::<4, 6, { tile(6) }, 1, MAX_PIXELS>(
                run,
                0,
                costs,
                |counts, pixel, levels, _| {
                    let cells = counts * pixel.cell_cost;
                    weighing.cost(pixel, sub_saturating_u8x4(pixel.truncation, cells), levels)
                },
            );
        }
        (8, 0, false) if are_whole() => {
            cost_pixels::<8, 8, { tile(8) }, 1, MAX_PIXELS>(
                run,
                0,
                costs,
                |counts, pixel, _, _| min_u8x4(counts * pixel.cell_cost, pixel.truncation),
            );
        }
        (6, 6, true) => {
            cost_pixels::<6, 8, { tile(8) }, 2, MASKED_PIXELS>(
                run,
                0,
                costs,
                |counts, pixel, levels, _| {
                    let counts = [even_bytes(counts), odd_bytes(counts)];
                    let missing = missing(pixel, counts);
                    weighing.cost(pixel, missing, levels)
                },
            );
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
                cost_pixels::<PART, PART, { tile(PART) }, 2, MASKED_PIXELS>(run, first, costs, add);
            }
            let finish = |counts, pixel: &Pixel<PART, 2>, levels, before| {
                let even = add_even_bytes(even_bytes(counts), before);
                let odd = add_odd_bytes(odd_bytes(counts), before);
                let missing = missing(pixel, [even, odd]);
                weighing.cost(pixel, missing, levels)
            };
            cost_pixels::<PART, 10, { tile(10) }, 2, MASKED_PIXELS>(run, last, costs, finish);
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

/// Bytes from the start of a block of disparities in the first row to the end of that block in the
/// last of `rows` rows.
const fn tile(rows: usize) -> usize {
    (rows - 1) * POSITIONS + BLOCK
}

/// Counts the differing cells in `BYTES` bytes of the patterns from byte `first_byte` on, and
/// stores what `finish` returns. Its arguments are the counts of four disparities, the pixel, the
/// lowest and highest levels of the other view that count as equal, and the values so far in place
/// of the costs. There are `BYTES` rows of patterns and, if levels are compared, two of levels;
/// `TILE` is the [`tile`] of all rows. `TERMS` is 2 with masks and 1 if all cells count. `PIXELS` pixels,
/// at most [`MAX_PIXELS`], are copied at a time.
#[inline(never)]
fn cost_pixels<
    const BYTES: usize,
    const ROWS: usize,
    const TILE: usize,
    const TERMS: usize,
    const PIXELS: usize,
>(
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
    let cells = run.cell_costs_q8.chunks(PIXELS);
    let cells = cells.zip(run.truncations.chunks(PIXELS));
    for (group, (costs, (cell_costs, truncations))) in groups.zip(cells).enumerate() {
        let first = group * PIXELS;
        let pixels = cell_costs.len();
        // The lowest position is that of the last pixel's lowest disparity.
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
        let pixels = costs.chunks_exact_mut(stride);
        let pixels = pixels.zip(cell_costs.iter().zip(truncations));
        for (x, (costs, (&cell_cost, &truncation))) in pixels.enumerate() {
            let four = |row: &[u8; PIXELS]| splat_u8(row[x % PIXELS]);
            let pixel = Pixel {
                patterns: patterns.each_ref().map(|terms| terms.each_ref().map(four)),
                level: four(&levels),
                // If all cells count, the cost per cell is a whole number.
                cell_cost: (cell_cost >> if TERMS == 1 { 8 } else { 0 }).into(),
                truncation: splat_u8(truncation),
                largest: splat_u8(largest(truncation, run)),
            };
            let at = run.first_position - (first + x) - lowest;
            let blocks = costs.as_chunks_mut::<BLOCK>().0.iter_mut();
            for (block, at) in blocks.zip((at..).step_by(BLOCK)) {
                // The remainder changes nothing, as every position is lower; it spares a bounds
                // check.
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

/// A pixel's values, each repeated in all four bytes.
struct Pixel<const BYTES: usize, const TERMS: usize> {
    /// Each byte of the pattern, and of the mask if there is one.
    patterns: [[u32; TERMS]; BYTES],
    level: u32,
    /// Cost of a differing cell; 1/256 of a cost if there are masks.
    cell_cost: u32,
    /// Largest cost of the pattern.
    truncation: u32,
    /// Twice the largest cost, which is that of pattern and levels.
    largest: u32,
}

impl<const BYTES: usize, const TERMS: usize> Pixel<BYTES, TERMS> {
    /// Returns the unmasked cells of a byte that differ from those of four other patterns.
    #[inline(always)]
    fn differing(&self, byte: usize, others: u32) -> u32 {
        match self.patterns[byte].as_slice() {
            [input, mask] => (others ^ input) & mask,
            [input] => others ^ input,
            _ => 0,
        }
    }
}

/// Writes the costs of the four disparities `4 * QUAD` to `4 * QUAD + 3` of a block.
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
    // The pixel is kept in memory, from which one instruction loads two words, because there are
    // too few registers for all of it.
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

/// Loads four bytes of a tile.
#[inline(always)]
fn load_at<const TILE: usize>(tile: &[u8; TILE], at: usize) -> u32 {
    let bytes = tile.get(at..).and_then(<[u8]>::first_chunk);
    bytes.map_or(0, load)
}

/// Copies `count` positions of plane `byte`, from `first` on; does nothing if there is no such
/// plane.
fn copy_plane(planes: Planes<'_>, byte: usize, first: usize, count: usize, to: &mut [u8]) {
    if byte < planes.count {
        copy(planes.bytes, byte * planes.stride + first, count, to);
    }
}

/// Copies `count` elements of a row, from `first` on; does nothing if the row ends before.
#[inline(never)]
fn copy(row: &[u8], first: usize, count: usize, to: &mut [u8]) {
    if let Some(run) = row.get(first..first + count)
        && let Some(to) = to.get_mut(..count)
    {
        // Copied by words, because a call of `memcpy` would take longer.
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

/// Twice the largest cost of a pixel with this largest cost of its pattern. Wraps round where
/// [`Weighing::new`] refuses the run.
fn largest(truncation: u8, run: &CostRun<'_>) -> u8 {
    let levels = (run.difference_weight_q4 / 8).wrapping_mul(run.difference_truncation);
    truncation.wrapping_mul(2).wrapping_add(levels)
}

/// Returns by how much the costs of differing cells are below their truncation. `counts` holds the
/// counts of bytes 0 and 2, and of bytes 1 and 3.
#[inline(always)]
fn missing<const BYTES: usize, const TERMS: usize>(
    pixel: &Pixel<BYTES, TERMS>,
    counts: [u32; 2],
) -> u32 {
    // Each product is less than 2^16, also after rounding.
    let [even, odd] = counts.map(|counts| counts * pixel.cell_cost + splat_u16(128));
    let cells = odd_bytes(even) | odd & 0xff00_ff00;
    sub_saturating_u8x4(pixel.truncation, cells)
}

/// Parameters that turn differences of levels into costs.
struct Weighing {
    /// Largest difference that counts, repeated in all four bytes.
    difference_truncation: u32,
    /// Twice the cost of a difference of one level.
    weight: u32,
}

impl Weighing {
    /// Returns the parameters if the levels, where they are compared, have one channel, their
    /// weight is a multiple of 1/2, and twice the largest cost fits 8 bits.
    fn new(run: &CostRun<'_>) -> Option<Self> {
        let weight = run.difference_weight_q4 / 8;
        let levels = weight.checked_mul(run.difference_truncation)?;
        run.hamming_truncation.checked_mul(2)?.checked_add(levels)?;
        let is_halves = run.difference_weight_q4.is_multiple_of(8);
        let has_one_channel = run.channels == 1 || run.difference_weight_q4 == 0;
        (has_one_channel && is_halves).then(|| Self {
            difference_truncation: splat_u8(run.difference_truncation),
            weight: weight.into(),
        })
    }

    /// Returns the costs, given by how much those of `cells` are below their truncation, and the
    /// lowest and highest levels that count as equal.
    #[inline(always)]
    fn cost<const BYTES: usize, const TERMS: usize>(
        &self,
        pixel: &Pixel<BYTES, TERMS>,
        cells: u32,
        [low, high]: [u32; 2],
    ) -> u32 {
        // Levels are also expressed by how much they are below their truncation, which needs no
        // minimum. One of the two differences is 0.
        let level = pixel.level;
        let difference = sub_saturating_u8x4(level, high) | sub_saturating_u8x4(low, level);
        let levels = sub_saturating_u8x4(self.difference_truncation, difference) * self.weight;
        // Rounded down, as the reference rounds the cost of levels.
        halve_difference_u8x4(pixel.largest, levels).wrapping_sub(cells)
    }
}

/// Counts the bits of each byte over `BYTES` words.
#[inline(always)]
fn count<const BYTES: usize>(word: impl Fn(usize) -> u32) -> u32 {
    match BYTES {
        4 => {
            let (ones, twos) = add(word(0), word(1), word(2));
            // The two nibbles of a byte add up to at most 8, which fits a nibble.
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

/// Full adder of three bits in every position: returns the low and the high bits of the sums.
#[inline(always)]
fn add(a: u32, b: u32, c: u32) -> (u32, u32) {
    (in_order(a ^ b ^ c), in_order(a & b | (a ^ b) & c))
}

/// Counts the bits of each nibble.
#[inline(always)]
fn nibbles(word: u32) -> u32 {
    // Masked before shifting, because the addition can shift its operand at no cost.
    let pairs = word - (opaque(word & 0xaaaa_aaaa) >> 1);
    (pairs & 0x3333_3333) + (opaque(pairs & 0xcccc_cccc) >> 2)
}

/// Adds the two nibbles of each byte.
#[inline(always)]
fn bytes_of(nibbles: u32) -> u32 {
    (nibbles & 0x0f0f_0f0f) + (opaque(nibbles & 0xf0f0_f0f0) >> 4)
}
