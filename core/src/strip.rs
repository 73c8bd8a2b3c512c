//! A strip: the last few lines of one view, padded so that every sample is a plain read.
//!
//! A strip of support (x, y) keeps `2 y + 1` lines, each with `x` copies of its first
//! and last pixel at its ends: the border rule is *clamp*, a sample outside the image
//! takes the nearest pixel inside. Above the first and below the last line the nearest
//! line stands in. Its memory does not depend on the number of lines of the image.

use crate::memory::{Arena, OutOfMemory, words};
use crate::synapse::{Offset, Support};

/// Order in which a strip stores the pixels of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Stored position `i` is column `i`.
    Columns,
    /// Stored position `i` is column `width - 1 - i`.
    Mirrored,
}

/// The newest lines of one view: at least the `2 * support.y_px + 1` that a row of neurons looks at.
#[derive(Debug)]
pub struct Strip<'m> {
    pixels: &'m mut [u8],
    width: usize,
    stride: usize,
    depth: usize,
    padding: usize,
    order: Order,
    lines: u32,
    /// The newest line as it came, where lines are moved; else empty.
    newest: &'m mut [u8],
}

impl<'m> Strip<'m> {
    /// Lines that neurons of this support look at.
    #[must_use]
    pub const fn depth(support: Support) -> usize {
        2 * support.y_px as usize + 1
    }

    /// Words of memory: `depth` lines of `width + 2 padding` bytes.
    #[must_use]
    pub const fn memory_words(width: usize, padding: usize, depth: usize) -> usize {
        words(depth * (width + 2 * padding), 1)
    }

    /// An empty strip for `depth` lines of `width` pixels, each with `padding` copies of
    /// its first and last pixel.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Strip::memory_words`] left.
    pub fn new(
        width: usize,
        padding: usize,
        depth: usize,
        order: Order,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let stride = width + 2 * padding;
        Ok(Self {
            pixels: arena.take(depth * stride)?,
            width,
            stride,
            depth,
            padding,
            order,
            lines: 0,
            newest: Default::default(),
        })
    }

    /// Words of memory that [`Strip::moving`] takes besides.
    #[must_use]
    pub const fn moving_words(width: usize) -> usize {
        words(width, 1)
    }

    /// The same strip, for [`Strip::push_moved`].
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Strip::moving_words`] left.
    pub fn moving(self, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        Ok(Self {
            newest: arena.take(self.width)?,
            ..self
        })
    }

    /// Lines pushed since the frame began.
    #[must_use]
    pub fn lines(&self) -> u32 {
        self.lines
    }

    /// Forgets all lines: the next one pushed is line 0.
    pub fn clear(&mut self) {
        self.lines = 0;
    }

    /// Stores the next line over the oldest. A line longer than the strip is cut; of a
    /// shorter one the last pixel is repeated. An empty one repeats black.
    pub fn push(&mut self, line: &[u8]) {
        let line = line.get(..self.width).unwrap_or(line);
        let last = line.last().copied().unwrap_or(0);
        let missing = self.width - line.len();
        let order = self.order;
        self.store(self.lines, |inside| match order {
            Order::Columns => {
                let (given, repeated) = inside.split_at_mut(line.len());
                given.copy_from_slice(line);
                repeated.fill(last);
            }
            Order::Mirrored => {
                let (repeated, given) = inside.split_at_mut(missing);
                repeated.fill(last);
                for (to, from) in given.iter_mut().rev().zip(line) {
                    *to = *from;
                }
            }
        });
    }

    /// Has `write` write a line in stored order: the next, or one of the newest `depth`
    /// anew. Its ends are repeated into the padding.
    pub fn store(&mut self, line: u32, write: impl FnOnce(&mut [u8])) {
        let start = self.slot(line) * self.stride;
        self.lines = self.lines.max(line + 1);
        let stored = self.pixels.get_mut(start..start + self.stride);
        let Some((before, rest)) = stored.and_then(|s| s.split_at_mut_checked(self.padding)) else {
            return;
        };
        let Some((inside, after)) = rest.split_at_mut_checked(self.width) else {
            return;
        };
        write(inside);
        before.fill(inside.first().copied().unwrap_or(0));
        after.fill(inside.last().copied().unwrap_or(0));
    }

    /// Stores the next line of a view whose lines lie `offset_q4` too low, 1/16 line, -16 to
    /// 16, so that they come to lie where they should: each is mixed with the line above, or
    /// below, by its share. What is below comes with the next line: until then, a line too low
    /// stands as it came.
    ///
    /// All lines have the strip's width. One that is not [`Strip::moving`] moves none.
    pub fn push_moved(&mut self, line: &[u8], offset_q4: i8) {
        let newest = core::mem::take(&mut self.newest);
        let share_q4 = u16::from(offset_q4.unsigned_abs().min(16));
        if offset_q4 == 0 || self.lines == 0 || newest.is_empty() {
            self.push(line);
        } else if offset_q4 > 0 {
            mix_row(newest, line, share_q4);
            self.lines -= 1;
            self.push(newest);
            self.push(line);
        } else {
            mix_row(newest, line, 16 - share_q4);
            self.push(newest);
        }
        let kept = newest.len().min(line.len());
        if let (Some(newest), Some(line)) = (newest.get_mut(..kept), line.get(..kept)) {
            newest.copy_from_slice(line);
        }
        self.newest = newest;
    }

    /// `count` pixels of a line from stored position `from` on, in stored order. They may
    /// lie in the padding; empty when they leave it.
    ///
    /// The line must be among the newest `depth`; lines after the newest are the newest.
    #[must_use]
    #[inline]
    pub fn run(&self, line: u32, from: isize, count: usize) -> &[u8] {
        let line = line.min(self.lines.saturating_sub(1));
        let start = self.slot(line) * self.stride;
        let Some(from) = self.padding.checked_add_signed(from) else {
            return &[];
        };
        self.pixels
            .get(start..start + self.stride)
            .and_then(|row| row.get(from..from + count))
            .unwrap_or_default()
    }

    /// The lines around `line`, which together are among the newest `depth`; lines after
    /// the newest are the newest.
    #[must_use]
    pub fn window(&self, line: u32) -> StripWindow<'_> {
        let newest = self.lines.saturating_sub(1);
        let line = line.min(newest);
        StripWindow {
            pixels: self.pixels,
            stride: self.stride,
            depth: self.depth,
            padding: self.padding,
            order: self.order,
            slot: self.slot(line),
            above: line,
            below: newest - line,
        }
    }

    /// All pixels; see [`StripWindow::start`].
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        self.pixels
    }

    /// A line, in stored order; see [`Strip::run`].
    #[must_use]
    pub fn row(&self, line: u32) -> &[u8] {
        self.run(line, 0, self.width)
    }

    /// The same with a pixel of the padding at both ends; empty without padding.
    #[must_use]
    pub fn padded(&self, line: u32) -> &[u8] {
        self.run(line, -1, self.width + 2)
    }

    /// Once per line, not per pixel.
    fn slot(&self, line: u32) -> usize {
        line as usize % self.depth.max(1)
    }
}

/// The lines of a strip around one, looked up without a division.
#[derive(Debug, Clone, Copy)]
pub struct StripWindow<'a> {
    pixels: &'a [u8],
    stride: usize,
    depth: usize,
    padding: usize,
    order: Order,
    /// Where the line in the middle is stored.
    slot: usize,
    /// Lines of the frame above it.
    above: u32,
    /// Lines below it up to the newest.
    below: u32,
}

impl<'a> StripWindow<'a> {
    /// The samples of `count` neighbouring neurons of the middle line that one synapse sees,
    /// from stored position `first` on, in stored order. Empty when the offset leaves the
    /// support or the neurons leave the line.
    #[must_use]
    #[inline(always)]
    pub fn samples(&self, offset: Offset, first: usize, count: usize) -> &'a [u8] {
        let start = self.start(offset, first, count);
        let samples = start.and_then(|start| self.pixels.get(start..start + count));
        samples.unwrap_or_default()
    }

    /// Where in [`Strip::pixels`] the samples begin that [`StripWindow::samples`]
    /// gives; `None` when those are empty. Strips of one shape that got the same number of
    /// lines agree on it.
    #[must_use]
    #[inline(always)]
    pub fn start(&self, offset: Offset, first: usize, count: usize) -> Option<usize> {
        let column = self.column(offset.dx, first)?;
        (column + count <= self.stride).then_some(self.row(offset.dy)? + column)
    }

    /// Where in [`Strip::pixels`] the line begins that is `dy` below the middle one.
    #[inline(always)]
    fn row(&self, dy: i8) -> Option<usize> {
        let distance = u32::from(dy.unsigned_abs());
        let slot = if dy < 0 {
            let up = distance.min(self.above) as usize;
            // Below the first slot comes the last.
            match self.slot.checked_sub(up) {
                Some(slot) => slot,
                None => (self.slot + self.depth).checked_sub(up)?,
            }
        } else {
            let slot = self.slot + distance.min(self.below) as usize;
            if slot < self.depth {
                slot
            } else {
                slot - self.depth
            }
        };
        Some(slot * self.stride)
    }

    /// Where in a stored line the sample is that a synapse `dx` away from stored position
    /// `first` sees.
    #[inline(always)]
    fn column(&self, dx: i8, first: usize) -> Option<usize> {
        let dx = match self.order {
            Order::Columns => isize::from(dx),
            Order::Mirrored => -isize::from(dx),
        };
        (self.padding + first).checked_add_signed(dx)
    }
}

/// Mixes `line` into `row`: so many sixteenths of it, rounded to nearest.
fn mix_row(row: &mut [u8], line: &[u8], share_q4: u16) {
    for (mixed, &level) in row.iter_mut().zip(line) {
        // Sixteen shares of 8 bits, and the result is one.
        let sum = u16::from(*mixed) * (16 - share_q4) + u16::from(level) * share_q4;
        *mixed = ((sum + 8) >> 4) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::View;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    #[test]
    fn a_line_is_stored_anew_with_its_ends() {
        for order in [Order::Columns, Order::Mirrored] {
            let mut block = [0; 64];
            let mut strip = Strip::new(4, 2, 3, order, &mut Arena::new(&mut block)).unwrap();
            for line in [[1, 2, 3, 4], [5, 6, 7, 8]] {
                strip.push(&line);
            }
            // In stored order, whatever that is.
            strip.store(0, |levels| levels.copy_from_slice(&[9, 8, 7, 6]));
            assert_eq!(strip.lines(), 2);
            assert_eq!(strip.run(0, -2, 8), [9, 9, 9, 8, 7, 6, 6, 6]);
            assert_eq!(strip.padded(0), [9, 9, 8, 7, 6, 6]);
            let kept = match order {
                Order::Columns => [5, 5, 6, 7, 8, 8],
                Order::Mirrored => [8, 8, 7, 6, 5, 5],
            };
            assert_eq!(strip.padded(1), kept);
            strip.store(2, |levels| levels.fill(3));
            assert_eq!((strip.lines(), strip.padded(2)), (3, &[3; 6][..]));
        }
        let mut block = [0; 64];
        let mut narrow = Strip::new(4, 0, 3, Order::Columns, &mut Arena::new(&mut block)).unwrap();
        narrow.push(&[1, 2, 3, 4]);
        assert_eq!(narrow.padded(0), []);
    }

    /// Every sample of a strip equals the clamped sample of the whole image.
    #[test]
    fn samples_equal_those_of_the_clamped_image() {
        let seed = 7;
        let mut random = Pcg32::seed_from_u64(seed);
        for (width, height, x_px, y_px) in
            [(1, 1, 3, 2), (7, 3, 9, 4), (12, 20, 2, 3), (5, 9, 0, 0)]
        {
            let pixels: std::vec::Vec<u8> = (0..width * height)
                .map(|_| random.next_u32() as u8)
                .collect();
            let view = View::new(&pixels, width, height).unwrap();
            let support = Support { x_px, y_px };
            for order in [Order::Columns, Order::Mirrored] {
                let mut block = [0; 4096];
                let mut arena = Arena::new(
                    &mut block[..Strip::memory_words(width, x_px.into(), Strip::depth(support))],
                );
                let mut strip =
                    Strip::new(width, x_px.into(), Strip::depth(support), order, &mut arena)
                        .unwrap();
                assert_eq!(arena.free_words(), 0);
                let check = |strip: &Strip<'_>, y: usize| {
                    for dy in -(y_px as i8)..=y_px as i8 {
                        for dx in -(x_px as i8)..=x_px as i8 {
                            let window = strip.window(y as u32);
                            let row = window.samples(Offset { dx, dy }, 0, width);
                            let start = window.start(Offset { dx, dy }, 0, width).unwrap();
                            assert_eq!(row, &strip.pixels()[start..start + width]);
                            for x in 0..width {
                                let stored = match order {
                                    Order::Columns => x,
                                    Order::Mirrored => width - 1 - x,
                                };
                                assert_eq!(
                                    row[stored],
                                    view.sample(x, y, dx, dy),
                                    "seed {seed}, {width}x{height}, {order:?}, ({x}, {y}), ({dx}, {dy})"
                                );
                            }
                        }
                    }
                };
                for (y, line) in view.lines().enumerate() {
                    strip.push(line);
                    if let Some(middle) = y.checked_sub(usize::from(y_px)) {
                        check(&strip, middle);
                    }
                }
                for y in height.saturating_sub(usize::from(y_px))..height {
                    check(&strip, y);
                }
            }
        }
    }

    #[test]
    fn short_lines_are_filled_and_bad_requests_are_empty() {
        for order in [Order::Columns, Order::Mirrored] {
            let mut block = [0; 16];
            let mut strip = Strip::new(4, 1, 3, order, &mut Arena::new(&mut block)).unwrap();
            strip.push(&[1, 2]);
            let row = strip.window(0).samples(Offset { dx: 0, dy: 0 }, 0, 4);
            match order {
                Order::Columns => assert_eq!(row, [1, 2, 2, 2]),
                Order::Mirrored => assert_eq!(row, [2, 2, 2, 1]),
            }
            strip.push(&[]);
            assert_eq!(
                strip.window(1).samples(Offset { dx: 0, dy: 0 }, 0, 4),
                [0; 4]
            );
            assert!(
                strip
                    .window(0)
                    .samples(Offset { dx: 2, dy: 0 }, 0, 4)
                    .is_empty()
            );
            let beyond = strip.window(0).start(Offset { dx: 2, dy: 0 }, 0, 4);
            assert_eq!(beyond, None);
            assert!(
                strip
                    .window(0)
                    .samples(Offset { dx: 0, dy: 0 }, 2, 4)
                    .is_empty()
            );
        }
    }

    /// Against mixing whole images: each line of the strip is the two lines about its place.
    #[test]
    fn moved_lines_are_mixed_from_the_lines_about_their_place() {
        let (width, depth) = (7, 5);
        let mut random = Pcg32::seed_from_u64(3);
        let lines: [[u8; 7]; 12] =
            core::array::from_fn(|_| core::array::from_fn(|_| random.next_u32() as u8));
        for order in [Order::Columns, Order::Mirrored] {
            for offset_q4 in -16..=16_i8 {
                let mut block = [0; 64];
                let words = Strip::memory_words(width, 2, depth) + Strip::moving_words(width);
                let mut arena = Arena::new(&mut block[..words]);
                let strip = Strip::new(width, 2, depth, order, &mut arena).unwrap();
                let mut strip = strip.moving(&mut arena).unwrap();
                assert_eq!(arena.free_words(), 0);
                for (y, line) in lines.iter().enumerate() {
                    strip.push_moved(line, offset_q4);
                    for line in y.saturating_sub(depth - 1)..=y {
                        // What lies further down is still to come, what further up never was.
                        let place_q4 = 16 * line as i32 + i32::from(offset_q4);
                        let is_there = place_q4 >= 0 && place_q4 <= 16 * y as i32;
                        let place_q4 = if is_there { place_q4 } else { 16 * line as i32 };
                        let (above, below) = (place_q4 / 16, (place_q4 + 15) / 16);
                        let share = f64::from(place_q4 % 16) / 16.0;
                        let pairs = lines[above as usize].iter().zip(&lines[below as usize]);
                        // To nearest, halves up.
                        let mixed = pairs.map(|(&above, &below)| {
                            let (above, below) = (f64::from(above), f64::from(below));
                            (above + (below - above) * share + 0.5).floor() as u8
                        });
                        let mut expected: std::vec::Vec<u8> = mixed.collect();
                        if order == Order::Mirrored {
                            expected.reverse();
                        }
                        let found = strip.row(line as u32);
                        assert_eq!(
                            found, expected,
                            "{order:?}, {offset_q4}, line {line} of {y}"
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
        strip.push_moved(&[1, 2, 3], 8);
        strip.push_moved(&[9, 9, 9], 8);
        assert_eq!(strip.row(0), [1, 2, 3]);
        assert_eq!(strip.row(1), [9, 9, 9]);
    }
}
