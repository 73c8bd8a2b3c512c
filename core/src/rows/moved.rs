//! Moved lines: pixels that are moved up or down by parts of a line, more at one end of the line than at
//! the other.

use core::ops::Range;

use super::arena::{Arena, OutOfMemory, words};
use super::copy::copy_common;
use super::ring::Ring;

/// Bits after the point of [`RowOffsets`].
pub(crate) const OFFSET_BITS: u32 = 24;

/// Positions that are moved by one offset, px.
const BLOCK_PX: usize = 8;

/// Largest number of pixels that are moved at once.
const RUN_PX: usize = 8 * BLOCK_PX;

/// By how much the pixels of a stored row lie too low: `shift + tilt (position - width / 2)`, in
/// 1/2^24 line.
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

    /// Runs of positions with one offset each, to the nearest 1/16 line and within `reach_lines`: the offset
    /// in the middle of each 8 px.
    fn runs_q4(
        self,
        width: usize,
        reach_lines: usize,
    ) -> impl Iterator<Item = (Range<usize>, i32)> {
        const BELOW_BITS: u32 = OFFSET_BITS - 4;
        let most_q4 = (reach_lines as i32) << 4;
        let from_middle = (BLOCK_PX / 2) as i32 - (width / 2) as i32;
        let first_q24 = self.shift_q24 + self.tilt_q24 * from_middle + (1 << (BELOW_BITS - 1));
        let step_q24 = self.tilt_q24 * BLOCK_PX as i32;
        // Not `clamp`, which panics unless its bounds are in order.
        let rounded_q4 = move |q24: i32| (q24 >> BELOW_BITS).min(most_q4).max(-most_q4);
        let (mut start, mut offset_q24) = (0, first_q24);
        core::iter::from_fn(move || {
            let first = start;
            let offset_q4 = rounded_q4(offset_q24);
            while start < width && start < first + RUN_PX && rounded_q4(offset_q24) == offset_q4 {
                start += BLOCK_PX;
                offset_q24 += step_q24;
            }
            (first < width).then(|| (first..start.min(width), offset_q4))
        })
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

    /// The run of positions of a line, one of the newest `reach` of `width` px.
    fn run(&mut self, line: u32, width: usize, reach: usize, run: &Range<usize>) -> &mut [u8] {
        let first = line as usize % reach.max(1) * width;
        let run = first + run.start..first + run.end;
        self.0.get_mut(run).unwrap_or_default()
    }

    /// Moves the newest line of `lines` to its place, and writes the pixels of the lines above that
    /// waited for it: each is mixed from the lines above and below its place by their shares. A pixel
    /// that lies too low waits as it came.
    // Once, not in each place that stores a line: it is rarely needed, and large.
    #[inline(never)]
    pub(super) fn move_newest(&mut self, lines: &mut Ring<'_, u8>, offsets: RowOffsets) {
        let width = lines.width();
        let reach = self.0.len() / width.max(1);
        let newest = lines.rows_in().saturating_sub(1);
        if offsets == RowOffsets::NONE {
            let row = self.run(newest, width, reach, &(0..width));
            copy_common(row, lines.row(newest));
            return;
        }
        for (run, offset_q4) in offsets.runs_q4(width, reach) {
            // The line above the place of a pixel, seen from its own: from -reach to reach - 1.
            let above = (offset_q4 - 1) >> 4;
            let share_q4 = (offset_q4 - 16 * above) as u16;
            let mut own = [0; RUN_PX];
            copy_common(
                &mut own,
                lines.row(newest).get(run.clone()).unwrap_or_default(),
            );
            let mut back = |count: u32| {
                let mut levels = own;
                // Above the first line, that one.
                let line = newest.saturating_sub(count);
                if line < newest {
                    copy_common(&mut levels, self.run(line, width, reach, &run));
                }
                levels
            };
            let (place, [above, below]) = if above < 0 {
                let count = above.unsigned_abs();
                (Some(newest), [count, count - 1].map(&mut back))
            } else {
                (newest.checked_sub(1 + above as u32), [1, 0].map(&mut back))
            };
            let place = place.and_then(|line| lines.row_mut(line).get_mut(run.clone()));
            let pixels = place.unwrap_or_default().iter_mut();
            for (pixel, (&above, &below)) in pixels.zip(above.iter().zip(&below)) {
                *pixel = mix(above, below, share_q4);
            }
            copy_common(self.run(newest, width, reach, &run), &own);
        }
        for waited in 0..=reach as u32 {
            lines.replicate_edges(newest.saturating_sub(waited));
        }
    }
}

/// Mixes `share_q4` sixteenths of `other` into `level`, rounded to nearest.
#[inline(always)]
fn mix(level: u8, other: u8, share_q4: u16) -> u8 {
    // Sixteen shares of 8 bits, and the result is one.
    let sum = u16::from(level) * (16 - share_q4) + u16::from(other) * share_q4;
    ((sum + 8) >> 4) as u8
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
