//! Moved lines: pixels that are moved up or down by parts of a line, more at one end of the line than at
//! the other.

use super::arena::{Arena, OutOfMemory, words};
use super::copy::copy_common;
use super::ring::Ring;

/// Bits after the point of [`RowOffsets`].
pub(crate) const OFFSET_BITS: u32 = 24;

/// Positions that are moved by one offset, px.
const BLOCK_PX: usize = 8;

/// Largest number of lines that pixels are moved by.
pub(crate) const MAX_MOVED_LINES: usize = 4;

/// Offset of each pixel of a stored row, 1/2^24 line, positive where it lies too low: `shift + tilt (position -
/// width / 2)`.
///
/// The shift is within 2^27, and the tilt so small that it makes as much of half the width.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RowOffsets {
    /// Offset in the middle of the row.
    pub shift_q24: i32,
    /// Increment from position to position.
    pub tilt_q24: i32,
}

impl RowOffsets {
    /// The row is where it should be.
    pub const NONE: Self = Self {
        shift_q24: 0,
        tilt_q24: 0,
    };

    /// The largest tilt of rows of `width` px.
    #[must_use]
    pub const fn tilt_max_q24(width: usize) -> i32 {
        // A block more, as offsets are those of the middles of blocks. Widths have 16 bits.
        (1 << 27) / (width / 2 + BLOCK_PX) as i32
    }

    /// The largest offset of rows of `width` px, in either direction.
    pub(crate) fn largest_q24(self, width: usize) -> u64 {
        let tilt_q24 = u64::from(self.tilt_q24.unsigned_abs()) * (width / 2) as u64;
        u64::from(self.shift_q24.unsigned_abs()) + tilt_q24
    }

    /// The offset in the middle of each block of 8 px, to the nearest 1/16 line and within `reach_lines`.
    fn blocks_q4(self, width: usize, reach_lines: usize) -> impl Iterator<Item = i32> {
        const BELOW_BITS: u32 = OFFSET_BITS - 4;
        let most_q4 = (reach_lines as i32) << 4;
        let from_middle = (BLOCK_PX / 2) as i32 - (width / 2) as i32;
        let first_q24 = self.shift_q24 + self.tilt_q24 * from_middle + (1 << (BELOW_BITS - 1));
        let step_q24 = self.tilt_q24 * BLOCK_PX as i32;
        let offsets_q24 =
            (0..width.div_ceil(BLOCK_PX) as i32).map(move |block| first_q24 + step_q24 * block);
        // Not `clamp`, which panics unless its bounds are in order.
        offsets_q24.map(move |q24| (q24 >> BELOW_BITS).min(most_q4).max(-most_q4))
    }
}

/// The newest lines of a strip as they came, from which lines are moved; none if lines are not moved. No
/// more than a slice, as strips lie on the stack.
#[derive(Debug, Default)]
pub(super) struct CameLines<'m>(&'m mut [u8]);

impl<'m> CameLines<'m> {
    /// Words of memory, for offsets of up to `reach_lines`.
    pub(super) const fn words(width: usize, reach_lines: usize) -> usize {
        words(width * reach_lines, 1)
    }

    /// Lines for offsets of up to `reach_lines`.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the arena has fewer than [`CameLines::words`] left.
    pub(super) fn new(
        width: usize,
        reach_lines: usize,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self(arena.take(width * reach_lines)?))
    }

    /// Whether lines are moved.
    pub(super) fn is_used(&self) -> bool {
        !self.0.is_empty()
    }

    /// Moves the newest line of `lines` to its place, and writes the pixels of the lines above that
    /// waited for it: each is mixed from the lines above and below its place by their shares. A pixel
    /// that lies too low waits as it came.
    // Not part of each function that stores a line, for it is large.
    #[inline(never)]
    pub(super) fn move_newest(&mut self, lines: &mut Ring<'_, u8>, offsets: RowOffsets) {
        let Self(came) = self;
        let width = lines.width();
        let reach = came.len() / width.max(1);
        let newest = lines.rows_in().saturating_sub(1);
        let came_start = |line: u32| line as usize % reach.max(1) * width;
        if offsets == RowOffsets::NONE {
            let row = came.get_mut(came_start(newest)..).unwrap_or_default();
            copy_common(row, lines.row(newest));
            return;
        }
        // Where the newest lines begin, from the newest up; above the first, that one. A line replaces the
        // oldest among those as they came.
        let back = |back: usize| newest.saturating_sub(back as u32);
        let starts: [usize; MAX_MOVED_LINES + 1] = core::array::from_fn(|b| lines.start(back(b)));
        let came_starts: [usize; MAX_MOVED_LINES + 1] =
            core::array::from_fn(|b| came_start(back(b)));
        for (block, offset_q4) in offsets.blocks_q4(width, reach).enumerate() {
            let at = BLOCK_PX * block;
            // The last block may be narrower.
            let count = BLOCK_PX.min(width - at);
            let place_of = |starts: &[usize], back: usize| {
                starts
                    .get(back)
                    .map_or(usize::MAX - width, |start| start + at)
            };
            let own = load(lines.values(), place_of(&starts, 0), count);
            if offset_q4 != 0 {
                // The line above the place of a pixel, seen from its own: from -reach to reach - 1.
                let above = (offset_q4 - 1) >> 4;
                let share_q4 = (offset_q4 - 16 * above) as u32;
                let level = |back: usize| match back.min(newest as usize) {
                    0 => own,
                    _ => load(came, place_of(&came_starts, back), count),
                };
                let (place, [above, below]) = if above < 0 {
                    let count = above.unsigned_abs() as usize;
                    (0, [level(count), level(count - 1)])
                } else {
                    (1 + above as usize, [level(1), own])
                };
                if place <= newest as usize {
                    let mixed = mix(above, below, share_q4);
                    store(lines.values_mut(), place_of(&starts, place), count, mixed);
                }
            }
            store(came, place_of(&came_starts, 0), count, own);
        }
        for waited in 0..=reach {
            lines.replicate_edges(back(waited));
        }
    }
}

/// The levels of `count` px, at most 8, from `start` on, the first in the lowest byte; zero beyond.
#[inline(always)]
fn load(levels: &[u8], start: usize, count: usize) -> u64 {
    let levels = levels.get(start..).unwrap_or_default();
    match levels.first_chunk() {
        Some(levels) if count == BLOCK_PX => u64::from_le_bytes(*levels),
        _ => {
            let mut narrow = [0; BLOCK_PX];
            copy_common(&mut narrow, levels.get(..count).unwrap_or_default());
            u64::from_le_bytes(narrow)
        }
    }
}

/// Writes what [`load`] reads.
#[inline(always)]
fn store(levels: &mut [u8], start: usize, count: usize, block: u64) {
    let levels = levels.get_mut(start..).unwrap_or_default();
    match levels.first_chunk_mut() {
        Some(levels) if count == BLOCK_PX => *levels = block.to_le_bytes(),
        _ => copy_common(
            levels.get_mut(..count).unwrap_or_default(),
            &block.to_le_bytes(),
        ),
    }
}

/// Mixes `share_q4` sixteenths, 1 to 16, of the levels below into those above, rounded to nearest.
#[inline(always)]
fn mix(above: u64, below: u64, share_q4: u32) -> u64 {
    // By words of 32 bits: two levels at once, each with room for its sixteen shares.
    let words = |shift: u32| {
        let [above, below] = [(above >> shift) as u32, (below >> shift) as u32];
        let levels = |shift: u32| {
            const LOW: u32 = 0x00FF_00FF;
            let above = (above >> shift & LOW) * (16 - share_q4);
            let sum = above + (below >> shift & LOW) * share_q4 + 0x0008_0008;
            sum >> 4 & LOW
        };
        u64::from(levels(0) | levels(8) << 8) << shift
    };
    words(0) | words(32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::{Order, Strip};
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    const LINES: usize = 14;

    fn random_lines(width: usize, seed: u64) -> Vec<Vec<u8>> {
        let mut random = Pcg32::seed_from_u64(seed);
        let mut line = || (0..width).map(|_| random.next_u32() as u8).collect();
        (0..LINES).map(|_| line()).collect()
    }

    /// Compared with mixing whole images: each pixel of the strip is a mixture of the two lines about its
    /// place, once these have come.
    #[test]
    fn pixels_are_mixed_from_the_lines_about_their_place() {
        let ends_q4 = [
            [0, 0],
            [5, 5],
            [-16, -16],
            [16, 16],
            [-13, 11],
            [40, -40],
            [70, 20],
        ];
        for (seed, (reach, width)) in [(1, 7), (1, 41), (2, 70), (3, 200), (4, 97)]
            .into_iter()
            .enumerate()
        {
            let lines = random_lines(width, seed as u64);
            let depth = 9;
            for (order, ends_q4) in [Order::Columns, Order::Mirrored]
                .into_iter()
                .flat_map(|order| ends_q4.map(|ends| (order, ends)))
            {
                let [start, end] = ends_q4.map(|q4: i32| q4 << 20);
                let offsets = RowOffsets {
                    shift_q24: (start + end) / 2,
                    tilt_q24: ((end - start) / width as i32)
                        .min(RowOffsets::tilt_max_q24(width))
                        .max(-RowOffsets::tilt_max_q24(width)),
                };
                let words = Strip::words(width, 2, depth) + Strip::moving_words(width, reach);
                let mut block = std::vec![0; words];
                let mut arena = Arena::new(&mut block);
                let strip = Strip::new(width, 2, depth, order, &mut arena).unwrap();
                let mut strip = strip.moving(reach, &mut arena).unwrap();
                assert_eq!(arena.free_words(), 0);
                let stored = |line: usize, position: usize| match order {
                    Order::Columns => lines[line][position],
                    Order::Mirrored => lines[line][width - 1 - position],
                };
                // The second time, after a frame of other lines.
                for _ in 0..2 {
                    strip.clear();
                    for (y, line) in lines.iter().enumerate() {
                        strip.push_moved(offsets, |row| row.copy_from_slice(line), |_| {});
                        let kept = y.saturating_sub(depth - 1)..=y;
                        for (line, x) in kept.flat_map(|line| (0..width).map(move |x| (line, x))) {
                            let middle = (x / 8 * 8 + 4) as f64 - (width / 2) as f64;
                            let q24 =
                                f64::from(offsets.shift_q24) + f64::from(offsets.tilt_q24) * middle;
                            let most_q4 = 16.0 * reach as f64;
                            let offset_q4 = (q24 / f64::from(1 << 20) + 0.5).floor();
                            let offset_q4 = offset_q4.clamp(-most_q4, most_q4) as i32;
                            // Lines further down have not come yet. Above the first, that stands in.
                            let place_q4 = 16 * line as i32 + offset_q4;
                            let has_come = place_q4 <= 16 * y as i32;
                            let place_q4 = if has_come { place_q4 } else { 16 * line as i32 };
                            let at = |line: i32| f64::from(stored(line.max(0) as usize, x));
                            let above = place_q4.div_euclid(16);
                            let share = f64::from(place_q4.rem_euclid(16)) / 16.0;
                            let below = if share > 0.0 { at(above + 1) } else { 0.0 };
                            // To nearest, halves up.
                            let mixed = at(above) * (1.0 - share) + below * share;
                            assert_eq!(
                                f64::from(strip.row(line as u32)[x]),
                                (mixed + 0.5).floor(),
                                "seed {seed}, {order:?}, {ends_q4:?}, line {line} of {y}, position {x}"
                            );
                        }
                        let padded = strip.run(y as u32, -2, width + 4);
                        assert_eq!(
                            [padded[0], padded[width + 3]],
                            [padded[2], padded[width + 1]]
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_strip_that_is_not_moving_moves_no_line() {
        let mut block = [0; 16];
        let mut arena = Arena::new(&mut block);
        let mut strip = Strip::new(3, 0, 3, Order::Columns, &mut arena).unwrap();
        let offsets = RowOffsets {
            shift_q24: 1 << 23,
            tilt_q24: 0,
        };
        strip.push_moved(offsets, |row| row.copy_from_slice(&[1, 2, 3]), |_| {});
        strip.push_moved(offsets, |row| row.copy_from_slice(&[9, 9, 9]), |_| {});
        assert_eq!(strip.row(0), [1, 2, 3]);
        assert_eq!(strip.row(1), [9, 9, 9]);
    }
}
