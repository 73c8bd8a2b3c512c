//! Costs of four disparities at once: differing cells are counted in the four bytes of a register.
//!
//! Loads of words must be aligned, and the patterns of a pixel's disparities begin at any byte. So the rows of
//! patterns are copied and then moved by one byte three times, and each time every fourth pixel is compared.

use bytemuck::{must_cast_slice_mut, try_cast_slice_mut};

use super::group::{BLOCK, Group, POSITIONS};
use super::levels::{LevelCosts, PLACES, cost_at};
use crate::armv7em::cost::{Constants, count};
use crate::armv7em::simd::{even_bytes, in_order, odd_bytes, splat_u8, splat_u16};

/// Disparities that share a word of costs, and the words of a block.
const QUAD: usize = 4;
const WORDS: usize = BLOCK / QUAD;

/// Words of a row of patterns.
const ROW: usize = POSITIONS / QUAD;

/// Words of the rows of patterns of `bytes` bytes from a block's first in the first row to its last in the last. A
/// slice of constant length spares bounds checks.
pub(super) const fn tile_words(bytes: usize) -> usize {
    (bytes - 1) * ROW + WORDS
}

/// Writes the costs of a group; `TILE` is [`tile_words`].
#[inline(never)]
pub(super) fn write<const BYTES: usize, const TERMS: usize, const TILE: usize>(
    group: &Group<'_, BYTES, TERMS>,
    levels: &LevelCosts,
    costs: &mut [u8],
) -> Option<()> {
    let costs: &mut [u32] = try_cast_slice_mut(costs).ok()?;
    let mut rows = [[0; ROW]; BYTES];
    for (row, stored) in rows.iter_mut().zip(group.stored) {
        let row: &mut [u8] = must_cast_slice_mut(row.as_mut_slice());
        row.get_mut(..stored.len())?.copy_from_slice(stored);
    }
    let words = group.stride / QUAD;
    for moved in 0..QUAD {
        if moved > 0 {
            rows.iter_mut().for_each(move_by_a_byte);
        }
        let pixels = (0..group.levels.len()).rev().skip(moved).step_by(QUAD);
        for (word, x) in pixels.enumerate() {
            let pixel = Pixel::<BYTES, TERMS, TILE>::new(group, x, levels)?;
            let places = group.places.get(QUAD * word + moved..)?;
            let costs = costs.get_mut(words * x..words * (x + 1))?;
            pixel.write(rows.as_flattened(), word, places, costs);
        }
    }
    Some(())
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

impl<'a, const BYTES: usize, const TERMS: usize, const TILE: usize> Pixel<'a, BYTES, TERMS, TILE> {
    #[inline(always)]
    fn new(group: &Group<'_, BYTES, TERMS>, x: usize, levels: &'a LevelCosts) -> Option<Self> {
        let mut patterns = [[0; TERMS]; BYTES];
        for (pattern, (input, mask)) in patterns
            .iter_mut()
            .zip(group.inputs.iter().zip(group.masks))
        {
            for (pattern, row) in pattern.iter_mut().zip([input, mask]) {
                *pattern = splat_u8(*row.get(x)?);
            }
        }
        let cell_cost_q8 = u32::from(*group.cell_costs_q8.get(x)?);
        Some(Self {
            patterns,
            // If all cells count, the cost of a cell is a whole number.
            cell_cost: cell_cost_q8 >> if TERMS == 1 { 8 } else { 0 },
            truncation: splat_u8(*group.truncations.get(x)?),
            levels: levels.of(*group.levels.get(x)?)?,
        })
    }

    /// Writes the pixel's costs. The patterns of its disparities begin at a word of each row.
    #[inline(always)]
    fn write(&self, rows: &[u32], word: usize, places: &[u16], costs: &mut [u32]) {
        let constants = Constants::new();
        let blocks = costs
            .as_chunks_mut::<WORDS>()
            .0
            .iter_mut()
            .zip(places.as_chunks::<BLOCK>().0);
        for ((costs, places), word) in blocks.zip((word..).step_by(WORDS)) {
            let tile = rows.get(word..).and_then(<[u32]>::first_chunk::<TILE>);
            let Some(tile) = tile else {
                return;
            };
            // Not by a closure, which the compiler would not inline so often.
            costs[0] = self.cost::<0>(constants, tile, places);
            costs[1] = self.cost::<1>(constants, tile, places);
            costs[2] = self.cost::<2>(constants, tile, places);
            costs[3] = self.cost::<3>(constants, tile, places);
        }
    }

    /// The costs of a block's word `AT`. The tile begins with the block's patterns, and the places with its
    /// intervals.
    #[inline(always)]
    fn cost<const AT: usize>(
        &self,
        constants: Constants,
        tile: &[u32; TILE],
        places: &[u16; BLOCK],
    ) -> u32 {
        let differing = |byte: usize| {
            // The remainder changes nothing; it spares a bounds check.
            let others = tile[(byte * ROW + AT) % TILE];
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
        let level = |lane: usize| cost_at(self.levels, places[QUAD * AT + lane]);
        let levels = level(0) | level(1) << 8 | level(2) << 16 | level(3) << 24;
        // One word after the other, because there are few registers.
        in_order(self.truncation + levels - self.missing(counts))
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
