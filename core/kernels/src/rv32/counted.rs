//! Costs of one disparity after the other: the differing cells of a word are counted by one instruction, which
//! Zbb has. The bytes of the other view's patterns are joined to words before.

use core::array::from_fn;

use super::group::{BLOCK, Group, POSITIONS};
use super::levels::{LevelCosts, PLACES, cost_at};
use super::unrolled::unrolled;

/// Writes the costs of a group, whose patterns have `WORDS` words.
#[inline(never)]
pub(super) fn write<const BYTES: usize, const TERMS: usize, const WORDS: usize>(
    group: &Group<'_, BYTES, TERMS>,
    levels: &LevelCosts,
    costs: &mut [u8],
) -> Option<()> {
    let mut others = [[0; WORDS]; POSITIONS];
    join(group.stored, &mut others);
    let stride = group.stride;
    for (at, x) in (0..group.levels.len()).rev().enumerate() {
        let costs = costs.get_mut(stride * x..stride * (x + 1))?;
        let pixel = Pixel::<TERMS, WORDS>::new(group, x, levels)?;
        pixel.write(others.get(at..)?, group.places.get(at..)?, costs);
    }
    Some(())
}

/// Joins the bytes of each position's pattern.
#[inline(always)]
fn join<const BYTES: usize, const WORDS: usize>(
    rows: [&[u8]; BYTES],
    patterns: &mut [[u32; WORDS]; POSITIONS],
) {
    let count = rows.iter().map(|row| row.len()).min().unwrap_or(0);
    let rows: [&[u8]; BYTES] = rows.map(|row| row.get(..count).unwrap_or_default());
    for (at, pattern) in patterns.iter_mut().enumerate().take(count) {
        *pattern = words_at(&rows, at);
    }
}

/// The bytes at a position of each row, joined to words.
#[inline(always)]
fn words_at<const BYTES: usize, const WORDS: usize>(
    rows: &[&[u8]; BYTES],
    at: usize,
) -> [u32; WORDS] {
    let byte = |row: usize| {
        rows.get(row)
            .and_then(|row| row.get(at))
            .copied()
            .unwrap_or(0)
    };
    from_fn(|word| u32::from_le_bytes(from_fn(|lane| byte(4 * word + lane))))
}

/// A pixel's values.
struct Pixel<'a, const TERMS: usize, const WORDS: usize> {
    pattern: [u32; WORDS],
    /// Unused if all cells count.
    mask: [u32; WORDS],
    cell_cost_q8: u32,
    /// Largest cost of the pattern.
    truncation: u32,
    /// Costs of the level.
    levels: &'a [u8; PLACES],
}

impl<'a, const TERMS: usize, const WORDS: usize> Pixel<'a, TERMS, WORDS> {
    #[inline(always)]
    fn new<const BYTES: usize>(
        group: &Group<'_, BYTES, TERMS>,
        x: usize,
        levels: &'a LevelCosts,
    ) -> Option<Self> {
        Some(Self {
            pattern: words_at(&group.inputs, x),
            mask: words_at(&group.masks, x),
            cell_cost_q8: (*group.cell_costs_q8.get(x)?).into(),
            truncation: (*group.truncations.get(x)?).into(),
            levels: levels.of(*group.levels.get(x)?)?,
        })
    }

    /// Writes the pixel's costs. The patterns of its disparities begin with the first.
    #[inline(always)]
    fn write(&self, others: &[[u32; WORDS]], places: &[u16], costs: &mut [u8]) {
        let blocks = costs.as_chunks_mut::<BLOCK>().0.iter_mut();
        let others = others
            .as_chunks::<BLOCK>()
            .0
            .iter()
            .zip(places.as_chunks::<BLOCK>().0);
        for (costs, (others, places)) in blocks.zip(others) {
            unrolled::<BLOCK>(|lane| {
                let pattern = self.pattern_cost(&others[lane]);
                costs[lane] = (pattern + cost_at(self.levels, places[lane])) as u8;
            });
        }
    }

    #[inline(always)]
    fn pattern_cost(&self, other: &[u32; WORDS]) -> u32 {
        let mut cells = 0;
        for (other, (pattern, mask)) in other.iter().zip(self.pattern.iter().zip(&self.mask)) {
            let differing = other ^ pattern;
            let counted = if TERMS == 1 {
                differing
            } else {
                differing & mask
            };
            cells += counted.count_ones();
        }
        let cost = if TERMS == 1 {
            // The cost of a cell is a whole number.
            cells * (self.cell_cost_q8 >> 8)
        } else {
            (cells * self.cell_cost_q8 + 128) >> 8
        };
        cost.min(self.truncation)
    }
}
