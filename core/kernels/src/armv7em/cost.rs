//! Matching costs of four disparities at once: differing cells are counted in four bytes of a
//! register.
//!
//! The patterns of a run's pixels and the patterns that they are compared with are first copied to
//! rows of a constant length, so that the loop over disparities needs only one register to address
//! all of them. Patterns of more bytes than fit the registers are counted in parts; meanwhile the
//! counts so far stand where the costs will.

use bytemuck::must_cast_slice_mut;
use vgstereo_core::kernel::{CELLS_PER_BYTE, CostRun, MASK_LANES, NO_COST, Planes, cost_stride};

use super::others;
use super::simd::{
    add_even_bytes, add_odd_bytes, afresh, even_bytes, halve_difference_u8x4, in_order, load,
    load_four, load_six, min_u8x4, odd_bytes, opaque, splat_u8, splat_u16, store,
    sub_saturating_u8x4, subtract_product,
};

/// Largest number of disparities, rounded up to a multiple of 16.
const MAX_STRIDE: usize = 64;

/// Largest number of pixels whose patterns are copied at a time.
const MAX_PIXELS: usize = 64;

/// Number of pixels at a time if there are masks, which come for as many.
const MASKED_PIXELS: usize = MASK_LANES;

/// Number of disparities compared at a time.
const BLOCK: usize = 16;

/// Any content of words that are to be overwritten. It is not zero: what fills memory with zeros is a
/// function of the compiler's that takes four instructions a word.
const NOT_ZERO: u32 = 0x0102_0304;

/// Largest number of bytes of a pattern that are counted at a time.
const PART: usize = 8;

/// Largest number of parts: the counts of all but the last part fit 8 bits.
const MAX_PARTS: usize = 4;

/// Writes the costs of every pixel of the run.
pub(super) fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    if cost_registers(run, costs).is_none() {
        others::cost_run(run, costs);
    }
}

/// Writes the costs of a run, or returns `None` without a result if this code does not support it.
fn cost_registers(run: &CostRun<'_>, costs: &mut [u8]) -> Option<()> {
    let fits = (1..=MAX_STRIDE).contains(&run.disparities);
    let weighing = Weighing::new(run).filter(|_| fits)?;
    // Whether the cost per cell is a whole number and all cells together cost at most 255.
    let are_whole = || {
        let (pairs, odd) = run.cell_costs_q8.as_chunks::<2>();
        let both = pairs
            .iter()
            .fold(0, |bits, &[a, b]| bits | u32::from(a) | u32::from(b) << 16);
        let bits = both as u16 | (both >> 16) as u16 | odd.first().copied().unwrap_or(0);
        bits.is_multiple_of(256)
            && usize::from(bits / 256) * run.inputs.count * CELLS_PER_BYTE <= u8::MAX.into()
    };
    let has_levels = run.difference_weight_q4 > 0;
    let bytes = run.inputs.count;
    // All lengths are constants, those of a pixel's row of disparities as well.
    macro_rules! cost_pixels {
        ($first_byte:expr, $finish:expr; $($shape:tt)+) => {
            match cost_stride(run.disparities) / BLOCK {
                1 => cost_pixels!(@ 1, $first_byte, $finish; $($shape)+),
                2 => cost_pixels!(@ 2, $first_byte, $finish; $($shape)+),
                3 => cost_pixels!(@ 3, $first_byte, $finish; $($shape)+),
                _ => cost_pixels!(@ 4, $first_byte, $finish; $($shape)+),
            }
        };
        (@ $blocks:literal, $first_byte:expr, $finish:expr;
            bytes: $bytes:expr, terms: $terms:literal, levels: $levels:literal, pixels: $pixels:expr) => {{
            const POSITIONS: usize = $pixels + $blocks * BLOCK;
            cost_pixels::<
                { $bytes },
                $terms,
                { $pixels },
                { ($bytes * $terms + 1) * $pixels / 4 },
                { $bytes * $terms * $pixels + 1 },
                POSITIONS,
                { ($bytes + $levels) * POSITIONS / 4 },
                { ($bytes + $levels - 1) * POSITIONS + $blocks * BLOCK },
                $blocks,
            >(run, $first_byte, &weighing, costs, $finish)
        }};
    }
    match (bytes, run.masks.count, has_levels) {
        (4, 0, true) if are_whole() => {
            let finish = |counts, weights: &Weights, levels, _| {
                let cells = counts * weights.cell_cost;
                weights.cost(sub_saturating_u8x4(weights.truncation, cells), levels)
            };
            cost_pixels!(0, finish; bytes: 4, terms: 1, levels: 2, pixels: MAX_PIXELS);
        }
        (8, 0, false) if are_whole() => {
            let finish = |counts, weights: &Weights, _, _| {
                min_u8x4(counts * weights.cell_cost, weights.truncation)
            };
            cost_pixels!(0, finish; bytes: 8, terms: 1, levels: 0, pixels: MAX_PIXELS);
        }
        (6, 6, true) => {
            let finish = |counts, weights: &Weights, levels, _| {
                let missing = weights.missing([even_bytes(counts), odd_bytes(counts)]);
                weights.cost(missing, levels)
            };
            cost_pixels!(0, finish; bytes: 6, terms: 2, levels: 2, pixels: MASKED_PIXELS);
        }
        (_, masks, true)
            if masks == bytes
                && bytes.is_multiple_of(PART)
                && (1..=MAX_PARTS).contains(&(bytes / PART)) =>
        {
            costs.fill(0);
            let last = bytes - PART;
            for first in (0..last).step_by(PART) {
                let add = |counts, _: &Weights, _, before| before + counts;
                cost_pixels!(first, add; bytes: PART, terms: 2, levels: 0, pixels: MASKED_PIXELS);
            }
            let finish = |counts, weights: &Weights, levels, before| {
                let even = add_even_bytes(even_bytes(counts), before);
                let odd = add_odd_bytes(odd_bytes(counts), before);
                weights.cost(weights.missing([even, odd]), levels)
            };
            cost_pixels!(last, finish; bytes: PART, terms: 2, levels: 2, pixels: MASKED_PIXELS);
        }
        _ => return None,
    }
    fill_beyond(run, costs);
    Some(())
}

/// Fills what lies in the row of each pixel beyond its disparities, up to a multiple of 16 of them.
pub(crate) fn fill_beyond(run: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(run.disparities).max(1);
    if run.disparities < stride {
        for costs in costs.chunks_exact_mut(stride) {
            if let Some(beyond) = costs.get_mut(run.disparities..) {
                beyond.fill(NO_COST);
            }
        }
    }
}

/// Counts the differing cells in `BYTES` bytes of the patterns from byte `first_byte` on, and
/// stores what `finish` returns. Its arguments are the counts of four disparities, the pixel's
/// weights, the lowest and highest levels of the other view that count as equal, and the values so
/// far in place of the costs.
///
/// `TERMS` is 2 with masks and 1 if all cells count. `PIXELS` pixels, at most [`MAX_PIXELS`], are
/// copied at a time, to rows of `OWN_WORDS` in all: the bytes of the patterns, each followed by that
/// of the mask if there are masks, and the levels. A pixel has `OWN_TILE` bytes from its first byte to its
/// last. Of the other view, rows of `POSITIONS` are copied, of `OTHER_WORDS` in all: the bytes of the
/// patterns and, if levels are compared, two of levels. All `BLOCKS` blocks of a pixel's disparities have
/// `TILE` bytes from their first byte to their last.
#[inline(never)]
fn cost_pixels<
    const BYTES: usize,
    const TERMS: usize,
    const PIXELS: usize,
    const OWN_WORDS: usize,
    const OWN_TILE: usize,
    const POSITIONS: usize,
    const OTHER_WORDS: usize,
    const TILE: usize,
    const BLOCKS: usize,
>(
    run: &CostRun<'_>,
    first_byte: usize,
    weighing: &Weighing,
    costs: &mut [u8],
    finish: impl Fn(u32, &Weights, [u32; 2], u32) -> u32 + Copy,
) {
    let stride = BLOCKS * BLOCK;
    let mut own = [NOT_ZERO; OWN_WORDS];
    let own: &mut [u8] = must_cast_slice_mut(own.as_mut_slice());
    let mut others = [NOT_ZERO; OTHER_WORDS];
    let others: &mut [u8] = must_cast_slice_mut(others.as_mut_slice());
    let mut pixel = Pixel {
        patterns: [[0; TERMS]; BYTES],
        weights: weighing.words(),
    };
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
        let mut rows = own.chunks_exact_mut(PIXELS);
        let mut other_rows = others.chunks_exact_mut(POSITIONS);
        for byte in first_byte..first_byte + BYTES {
            let terms = [(run.inputs, run.start + first), (run.masks, first)];
            for ((planes, first), row) in terms.into_iter().take(TERMS).zip(&mut rows) {
                copy_plane(planes, byte, first, pixels, row);
            }
            if let Some(row) = other_rows.next() {
                copy_plane(run.stored, byte, lowest, positions, row);
            }
        }
        if let (Some(levels), Some(low), Some(high)) =
            (rows.next(), other_rows.next(), other_rows.next())
        {
            copy(run.levels[0], run.start + first, pixels, levels);
            copy(run.other_low[0], lowest, positions, low);
            copy(run.other_high[0], lowest, positions, high);
        }
        let blocks = costs.as_chunks_mut::<BLOCK>().0;
        let costs = blocks.as_chunks_mut::<BLOCKS>().0.iter_mut();
        let cells = cell_costs.iter().zip(truncations);
        for (x, (costs, (&cell_cost, &truncation))) in costs.zip(cells).enumerate() {
            // Remainders change nothing; they spare bounds checks.
            let own = own.get(x % PIXELS..);
            let own = own.and_then(<[u8]>::first_chunk::<OWN_TILE>);
            let at = run.first_position - (first + x) - lowest;
            let tile = others.get(at % PIXELS..);
            let tile = tile.and_then(<[u8]>::first_chunk::<TILE>);
            let (Some(own), Some(tile)) = (own.map(afresh), tile) else {
                return;
            };
            let four = |row: usize| splat_u8(own.get(row * PIXELS).copied().unwrap_or(0));
            // If all cells count, the cost per cell is a whole number.
            let cell_cost = u32::from(cell_cost >> if TERMS == 1 { 8 } else { 0 });
            // What is unrolled takes more flash.
            if TERMS == 1 && BYTES < PART && !cfg!(feature = "compact") {
                let weights = |level| {
                    let mut words = weighing.words();
                    weighing.set(&mut words, level, cell_cost, truncation);
                    Weights::of(words)
                };
                cost_in_registers::<BYTES, POSITIONS, TILE>(
                    four,
                    tile,
                    costs.as_flattened_mut(),
                    weights,
                    finish,
                );
                continue;
            }
            for (pattern, row) in pixel.patterns.as_flattened_mut().iter_mut().zip(0..) {
                *pattern = in_order(four(row));
            }
            let level = four(BYTES * TERMS);
            weighing.set(&mut pixel.weights, level, cell_cost, truncation);
            for (block, costs) in costs.iter_mut().enumerate() {
                cost_block::<BYTES, TERMS, POSITIONS, TILE>(&pixel, tile, block, costs, finish);
            }
        }
    }
}

/// A pixel's values.
struct Pixel<const BYTES: usize, const TERMS: usize> {
    /// Each byte of the pattern, and of the mask if there is one, repeated in all four bytes.
    patterns: [[u32; TERMS]; BYTES],
    /// Its [`Weights`].
    weights: [u32; 6],
}

/// Writes the costs of a pixel whose pattern, without mask, fits registers. `four` returns a byte of the pattern, and
/// after these the level, in all four bytes of a word; `weights` takes the level.
///
/// First come the counts of all disparities, in place of their costs: so few values are in use at a time that registers
/// have room for them. There is no loop, which would take them from memory again.
#[inline(always)]
fn cost_in_registers<const BYTES: usize, const POSITIONS: usize, const TILE: usize>(
    four: impl Fn(usize) -> u32,
    tile: &[u8; TILE],
    costs: &mut [u8],
    weights: impl FnOnce(u32) -> Weights,
    finish: impl Fn(u32, &Weights, [u32; 2], u32) -> u32 + Copy,
) {
    let quads = costs.as_chunks_mut().0;
    macro_rules! each_quad {
        ($body:ident: $($quad:literal)+) => {
            $(if let Some(costs) = quads.get_mut($quad) {
                $body!(costs, |row| in_order(load_at(tile, row * POSITIONS + 4 * $quad)));
            })+
        };
        ($body:ident) => { each_quad!($body: 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15); };
    }
    let patterns: [[u32; 1]; BYTES] = core::array::from_fn(|row| [in_order(four(row))]);
    let constants = Constants::new();
    macro_rules! count {
        ($costs:ident, $other:expr) => {
            store(count_quad(constants, &patterns, $other), $costs)
        };
    }
    each_quad!(count);
    let weights = weights(four(BYTES));
    macro_rules! finish {
        ($costs:ident, $other:expr) => {
            let levels = [BYTES, BYTES + 1].map($other);
            store(in_order(finish(load($costs), &weights, levels, 0)), $costs);
        };
    }
    each_quad!(finish);
}

/// Writes the costs of a block of disparities.
#[inline(always)]
fn cost_block<const BYTES: usize, const TERMS: usize, const POSITIONS: usize, const TILE: usize>(
    pixel: &Pixel<BYTES, TERMS>,
    tile: &[u8; TILE],
    block: usize,
    costs: &mut [u8; BLOCK],
    finish: impl Fn(u32, &Weights, [u32; 2], u32) -> u32 + Copy,
) {
    // First all counts, then all costs: there are too few registers for what both take of a pixel,
    // which is kept in memory.
    let at = BLOCK * block;
    let own = afresh(pixel);
    let constants = Constants::new();
    let count = |at| {
        let other = |byte| load_at(tile, byte * POSITIONS + at);
        count_quad::<BYTES, TERMS>(constants, &own.patterns, other)
    };
    let counts = [count(at), count(at + 4), count(at + 8), count(at + 12)];
    let weights = Weights::of(load_six(&pixel.weights));
    let [a, b, c, d] = costs.as_chunks_mut().0 else {
        return;
    };
    let write = |counts, at: usize, costs: &mut [u8; 4]| {
        let level = |row| load_at(tile, row * POSITIONS + at);
        let levels = if BYTES * POSITIONS < TILE {
            [level(BYTES), level(BYTES + 1)]
        } else {
            [0; 2]
        };
        store(
            in_order(finish(counts, &weights, levels, load(costs))),
            costs,
        );
    };
    write(counts[0], at, a);
    write(counts[1], at + 4, b);
    write(counts[2], at + 8, c);
    write(counts[3], at + 12, d);
}

/// Counts the differing cells of four disparities, whose bytes of the patterns `other` returns.
#[inline(always)]
fn count_quad<const BYTES: usize, const TERMS: usize>(
    constants: Constants,
    patterns: &[[u32; TERMS]; BYTES],
    other: impl Fn(usize) -> u32,
) -> u32 {
    let differing = |byte: usize| match (patterns[byte].as_slice(), other(byte)) {
        ([input, mask], other) => (other ^ input) & mask,
        ([input], other) => other ^ input,
        _ => 0,
    };
    let three = |first: usize| {
        let words = patterns.get(first..first + 3).map(<[_]>::as_flattened);
        let words = words.and_then(<[u32]>::first_chunk);
        if TERMS == 2
            && let Some(words) = words
        {
            let [a, a_mask, b, b_mask, c, c_mask] = load_six(words);
            [
                in_order((a ^ other(first)) & a_mask),
                in_order((b ^ other(first + 1)) & b_mask),
                in_order((c ^ other(first + 2)) & c_mask),
            ]
        } else {
            [0, 1, 2].map(|next| differing(first + next))
        }
    };
    let two = |first: usize| {
        let words = patterns.get(first..first + 2).map(<[_]>::as_flattened);
        let words = words.and_then(<[u32]>::first_chunk);
        if TERMS == 2
            && let Some(words) = words
        {
            let [a, a_mask, b, b_mask] = load_four(words);
            [
                in_order((a ^ other(first)) & a_mask),
                in_order((b ^ other(first + 1)) & b_mask),
            ]
        } else {
            [0, 1].map(|next| differing(first + next))
        }
    };
    let last = || differing(BYTES - 1);
    in_order(count::<BYTES>(constants, three, two, last))
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
    let run = row.get(first..first + count);
    let (Some(run), Some(to)) = (run, to.get_mut(..count)) else {
        return;
    };
    let blocks = to.as_chunks_mut().0.iter_mut().zip(run.as_chunks().0);
    for (to, from) in blocks {
        copy_block(to, from);
    }
    // The last block overlaps the one before it, so that nothing remains.
    if let (Some(to), Some(from)) = (to.last_chunk_mut(), run.last_chunk()) {
        copy_block(to, from);
    } else {
        for (to, from) in to.iter_mut().zip(run) {
            *to = *from;
        }
    }
}

/// Copies by words, because a call of `memcpy` would take longer.
#[inline(always)]
fn copy_block(to: &mut [u8; BLOCK], from: &[u8; BLOCK]) {
    for (to, from) in to.as_chunks_mut().0.iter_mut().zip(from.as_chunks().0) {
        store(opaque(load(from)), to);
    }
}

/// Parameters that turn differences of levels into costs.
struct Weighing {
    /// Largest difference that counts, repeated in all four bytes.
    difference_truncation: u32,
    /// Twice the cost of a difference of one level.
    weight: u32,
    /// Twice the largest cost of levels, repeated in all four bytes.
    largest: u32,
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
            largest: splat_u8(levels),
        })
    }

    /// The words of the [`Weights`] of any pixel.
    fn words(&self) -> [u32; 6] {
        [0, 0, 0, 0, self.difference_truncation, self.weight]
    }

    /// Sets those of a pixel with this level in all four bytes.
    #[inline(always)]
    fn set(&self, words: &mut [u32; 6], level: u32, cell_cost: u32, truncation: u8) {
        let truncation = splat_u8(truncation);
        let largest = self.largest.wrapping_add(2 * truncation);
        [words[0], words[1], words[2], words[3]] = [level, cell_cost, truncation, largest];
    }
}

/// Factors and bounds by which the counts of differing cells of a pixel, and the levels, become costs. All but
/// `cell_cost` and `weight` are repeated in all four bytes.
struct Weights {
    level: u32,
    /// Cost of a differing cell; 1/256 of a cost if there are masks.
    cell_cost: u32,
    /// Largest cost of the pattern.
    truncation: u32,
    /// Twice the largest cost, which is that of pattern and levels.
    largest: u32,
    /// Largest difference of levels that counts.
    difference_truncation: u32,
    /// Twice the cost of a difference of one level.
    weight: u32,
}

impl Weights {
    #[inline(always)]
    fn of(words: [u32; 6]) -> Self {
        let [
            level,
            cell_cost,
            truncation,
            largest,
            difference_truncation,
            weight,
        ] = words;
        Self {
            level,
            cell_cost,
            truncation,
            largest,
            difference_truncation,
            weight,
        }
    }

    /// Returns by how much the costs of differing cells are below their truncation. `counts` holds the
    /// counts of bytes 0 and 2, and of bytes 1 and 3.
    #[inline(always)]
    fn missing(&self, counts: [u32; 2]) -> u32 {
        // Each product is less than 2^16, also after rounding.
        let half = opaque(splat_u16(128));
        let [even, odd] = counts.map(|counts| counts * self.cell_cost + half);
        let cells = add_odd_bytes(odd & 0xff00_ff00, even);
        sub_saturating_u8x4(self.truncation, cells)
    }

    /// Returns the costs, given by how much those of `cells` are below their truncation, and the
    /// lowest and highest levels that count as equal.
    #[inline(always)]
    fn cost(&self, cells: u32, [low, high]: [u32; 2]) -> u32 {
        // Levels are also expressed by how much they are below their truncation, which needs no
        // minimum. One of the two differences is 0.
        let level = self.level;
        let difference = sub_saturating_u8x4(level, high) | sub_saturating_u8x4(low, level);
        let levels = sub_saturating_u8x4(self.difference_truncation, difference) * self.weight;
        // Rounded down, as the reference rounds the cost of levels.
        halve_difference_u8x4(self.largest, levels).wrapping_sub(cells)
    }
}

/// Constants that are kept in registers, because as parts of instructions they take one more.
#[derive(Clone, Copy)]
pub(crate) struct Constants {
    /// The lower two bits of each nibble.
    low_pairs: u32,
    three: u32,
}

impl Constants {
    pub(crate) fn new() -> Self {
        Self {
            low_pairs: opaque(0x3333_3333),
            three: opaque(3),
        }
    }

    /// The upper two bits of each nibble, as a number.
    #[inline(always)]
    fn upper(self, pairs: u32) -> u32 {
        pairs >> 2 & self.low_pairs
    }

    /// Adds both pairs of bits of each nibble, over two words. Sums of two pairs need not fit two bits, those
    /// of a nibble fit four.
    #[inline(always)]
    fn nibbles_of_two(self, a: u32, b: u32) -> u32 {
        let upper = self.upper(a) + self.upper(b);
        // Each nibble is its lower pair and four times its upper one.
        subtract_product(opaque(a.wrapping_add(b)), upper, self.three)
    }

    /// Adds both pairs of bits of each nibble.
    #[inline(always)]
    fn nibbles(self, pairs: u32) -> u32 {
        subtract_product(pairs, self.upper(pairs), self.three)
    }
}

/// Counts the bits of each byte over `BYTES` words.
#[inline(always)]
pub(crate) fn count<const BYTES: usize>(
    constants: Constants,
    three: impl Fn(usize) -> [u32; 3],
    two: impl Fn(usize) -> [u32; 2],
    last: impl Fn() -> u32,
) -> u32 {
    match BYTES {
        4 => {
            let [a, b] = pairs_of_three(three(0));
            // At most 3 times 4, and 4.
            let nibbles = constants.nibbles_of_two(a, b);
            let last = constants.nibbles(pairs(last()));
            bytes_of(nibbles) + opaque((last + (last >> 4)) & 0x0f0f_0f0f)
        }
        6 => {
            let [a, b] = pairs_of_three(three(0));
            let first = in_order(bytes_of(constants.nibbles_of_two(a, b)));
            let [a, b] = pairs_of_three(three(3));
            first + bytes_of(constants.nibbles_of_two(a, b))
        }
        PART => {
            // One group of words after the other, each in one word, because there are few registers.
            let [a, b] = pairs_of_three(three(0));
            let first = in_order(bytes_of(constants.nibbles_of_two(a, b)));
            let [a, b] = pairs_of_three(three(3));
            let second = in_order(first + bytes_of(constants.nibbles_of_two(a, b)));
            let [a, b] = two(6).map(pairs);
            second + bytes_of(constants.nibbles_of_two(a, b))
        }
        _ => 0,
    }
}

/// Counts the bits of each pair of bits.
#[inline(always)]
fn pairs(word: u32) -> u32 {
    // Masked before shifting, because the subtraction can shift its operand at no cost.
    word - (opaque(word & 0xaaaa_aaaa) >> 1)
}

/// Counts the bits of each pair of bits over three words, in two words: those of the last are in either.
#[inline(always)]
fn pairs_of_three([a, b, c]: [u32; 3]) -> [u32; 2] {
    [
        pairs(a) + (c & 0x5555_5555),
        pairs(b) + (opaque(c & 0xaaaa_aaaa) >> 1),
    ]
}

/// Adds the two nibbles of each byte.
#[inline(always)]
fn bytes_of(nibbles: u32) -> u32 {
    (nibbles & 0x0f0f_0f0f) + (opaque(nibbles & 0xf0f0_f0f0) >> 4)
}
