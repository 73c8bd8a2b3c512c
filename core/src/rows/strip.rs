//! A strip: the newest lines of one channel, padded so that every sample is a plain read.
//!
//! Each line has copies of its first and last pixel at its ends: the border rule is *clamp*, so
//! that a sample outside the image takes the nearest pixel inside. Above the first line and
//! below the last, the nearest line stands in. The memory of a strip does not depend on the
//! number of lines of the image.

use super::arena::{Arena, OutOfMemory};
use super::moved::{CameLines, RowOffsets};
use super::ring::Ring;

/// A displacement between two pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Offset {
    /// Columns to the right, px.
    pub dx: i8,
    /// Lines down.
    pub dy: i8,
}

/// Order in which a strip stores the pixels of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Stored position `i` is column `i`.
    Columns,
    /// Stored position `i` is column `width - 1 - i`.
    Mirrored,
}

/// The newest lines of one channel of a view.
#[derive(Debug)]
pub struct Strip<'m> {
    ring: Ring<'m, u8>,
    order: Order,
    /// The newest lines as they came, in stored order.
    came: CameLines<'m>,
}

impl<'m> Strip<'m> {
    /// Words of memory: `depth` lines of `width + 2 padding` bytes.
    #[must_use]
    pub const fn words(width: usize, padding: usize, depth: usize) -> usize {
        Ring::<u8>::words(width, padding, depth)
    }

    /// An empty strip for `depth` lines of `width` pixels, each with `padding` copies of its first
    /// and last pixel at the ends.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the arena has fewer than [`Strip::words`] left.
    pub fn new(
        width: usize,
        padding: usize,
        depth: usize,
        order: Order,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self {
            ring: Ring::new(width, padding, depth, 0, arena)?,
            order,
            came: CameLines::default(),
        })
    }

    /// Words of memory that [`Strip::moving`] takes: `reach_lines` lines of `width` bytes.
    #[must_use]
    pub const fn moving_words(width: usize, reach_lines: usize) -> usize {
        CameLines::words(width, reach_lines)
    }

    /// Takes the memory that [`Strip::push_moved`] needs to move pixels by up to `reach_lines` lines; the
    /// strip keeps one line more at least.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the arena has fewer than [`Strip::moving_words`] left.
    pub fn moving(self, reach_lines: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        Ok(Self {
            came: CameLines::new(self.ring.width(), reach_lines, arena)?,
            ..self
        })
    }

    /// Whether the strip keeps any line.
    #[must_use]
    pub fn keeps_lines(&self) -> bool {
        self.ring.depth() > 0
    }

    /// Number of lines pushed since the frame began.
    #[must_use]
    pub fn lines(&self) -> u32 {
        self.ring.rows_in()
    }

    /// Forgets all lines: the next one pushed is line 0.
    pub fn clear(&mut self) {
        self.ring.clear();
    }

    /// Stores the next line over the oldest: `write` writes its pixels from the left.
    pub fn push(&mut self, write: impl FnOnce(&mut [u8])) {
        self.push_mended(write, |_| {});
    }

    /// Stores the next line over the oldest: `write` writes its pixels from the left, and `mend`
    /// changes them in stored order.
    fn push_mended(&mut self, write: impl FnOnce(&mut [u8]), mend: impl FnOnce(&mut [u8])) {
        let order = self.order;
        self.store(self.lines(), |row| {
            write(row);
            if order == Order::Mirrored {
                row.reverse();
            }
            mend(row);
        });
    }

    /// Stores a line that `write` writes in stored order: the next one, or one of the newest
    /// `depth` again. Its ends are repeated into the padding.
    pub fn store(&mut self, line: u32, write: impl FnOnce(&mut [u8])) {
        if line >= self.lines() {
            self.ring.push();
        }
        write(self.ring.row_mut(line));
        self.ring.replicate_edges(line);
    }

    /// Stores the next line of a view and moves its pixels to their places, which lie `offsets` above: each
    /// is mixed from the two lines about its place. A pixel that lies too low is stored as it came until the
    /// lines below have come with the next pushes. `write` writes the pixels from the left, and `mend`
    /// changes them in stored order before they are moved.
    ///
    /// A strip that is not [`Strip::moving`] moves no line.
    pub fn push_moved(
        &mut self,
        offsets: RowOffsets,
        write: impl FnOnce(&mut [u8]),
        mend: impl FnOnce(&mut [u8]),
    ) {
        self.push_mended(write, mend);
        if self.came.is_used() {
            self.came.move_newest(&mut self.ring, offsets);
        }
    }

    /// The `count` pixels of a line from stored position `from` on, in stored order. They may lie
    /// in the padding; empty if they leave it.
    ///
    /// The line must be among the newest `depth`; for a line after the newest, the newest is
    /// returned.
    #[must_use]
    #[inline]
    pub fn run(&self, line: u32, from: isize, count: usize) -> &[u8] {
        let Some(from) = self.ring.padding().checked_add_signed(from) else {
            return &[];
        };
        let row = self.ring.padded(line).get(from..from + count);
        row.unwrap_or_default()
    }

    /// The lines around `line`, for many lookups. All lines that are looked up must be among the
    /// newest `depth`; for a line after the newest, the newest is returned.
    #[must_use]
    pub fn window(&self, line: u32) -> StripWindow<'_> {
        let newest = self.lines().saturating_sub(1);
        let line = line.min(newest);
        StripWindow {
            pixels: self.ring.values(),
            stride: self.ring.stride(),
            depth: self.ring.depth(),
            padding: self.ring.padding(),
            order: self.order,
            slot: self.ring.slot(line),
            // More than an offset reaches is as good as that.
            above: line.min(u8::MAX.into()) as i32,
            below: (newest - line).min(u8::MAX.into()) as i32,
        }
    }

    /// All stored pixels; see [`StripWindow::start`].
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        self.ring.values()
    }

    /// A line without its padding, in stored order; see [`Strip::run`].
    #[must_use]
    pub fn row(&self, line: u32) -> &[u8] {
        self.run(line, 0, self.ring.width())
    }

    /// A line with one pixel of its padding at both ends, in stored order; empty without
    /// padding.
    #[must_use]
    pub fn padded(&self, line: u32) -> &[u8] {
        self.run(line, -1, self.ring.width() + 2)
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
    /// Index of the place at which the middle line is stored.
    slot: usize,
    /// Number of lines of the frame above the middle line.
    above: i32,
    /// Number of lines below the middle line, up to the newest.
    below: i32,
}

impl<'a> StripWindow<'a> {
    /// The samples that one synapse takes for `count` neighbouring neurons of the middle line, from
    /// stored position `first` on, in stored order. Empty if the offset leaves the padding or the
    /// neurons leave the line.
    #[must_use]
    #[inline(always)]
    pub fn samples(&self, offset: Offset, first: usize, count: usize) -> &'a [u8] {
        let start = self.start(offset, first, count);
        let samples = start.and_then(|start| self.pixels.get(start..)?.get(..count));
        samples.unwrap_or_default()
    }

    /// Index in [`Strip::pixels`] of the first sample that [`StripWindow::samples`] returns; `None`
    /// if there is none. Strips of one shape with equally many lines have equal indices.
    #[must_use]
    #[inline(always)]
    pub fn start(&self, offset: Offset, first: usize, count: usize) -> Option<usize> {
        let column = self.column(offset.dx, first);
        let last = self.stride.checked_sub(count)?;
        (column <= last).then(|| self.row(offset.dy).wrapping_add(column))
    }

    /// Index in [`Strip::pixels`] at which the line begins that is `dy` below the middle one.
    #[inline(always)]
    fn row(&self, dy: i8) -> usize {
        let dy = i32::from(dy).max(-self.above).min(self.below);
        let slot = self.slot.wrapping_add_signed(dy as isize);
        // Below the first slot comes the last, and the other way round: the least number is the slot, because
        // what is below 0 wraps round.
        let others = [slot.wrapping_add(self.depth), slot.wrapping_sub(self.depth)];
        slot.min(others[0]).min(others[1]).wrapping_mul(self.stride)
    }

    /// Index in a stored line of the sample `dx` to the right of stored position `first`. Before the line it
    /// wraps round, and is then beyond its end.
    #[inline(always)]
    fn column(&self, dx: i8, first: usize) -> usize {
        let dx = match self.order {
            Order::Columns => isize::from(dx),
            Order::Mirrored => -isize::from(dx),
        };
        (self.padding + first).wrapping_add_signed(dx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    #[test]
    fn a_line_is_stored_anew_with_its_ends() {
        for order in [Order::Columns, Order::Mirrored] {
            let mut block = [0; 64];
            let mut strip = Strip::new(4, 2, 3, order, &mut Arena::new(&mut block)).unwrap();
            for line in [[1, 2, 3, 4], [5, 6, 7, 8]] {
                strip.push(|row| row.copy_from_slice(&line));
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
        narrow.push(|row| row.copy_from_slice(&[1, 2, 3, 4]));
        assert_eq!(narrow.padded(0), []);
    }

    /// Every sample of a strip equals the clamped sample of the whole image.
    #[test]
    fn samples_equal_those_of_the_clamped_image() {
        let seed = 7;
        let mut random = Pcg32::seed_from_u64(seed);
        for (width, height, x_px, y_px) in [
            (1, 1, 3_u8, 2_u8),
            (7, 3, 9, 4),
            (12, 20, 2, 3),
            (5, 9, 0, 0),
        ] {
            let pixels: std::vec::Vec<u8> = (0..width * height)
                .map(|_| random.next_u32() as u8)
                .collect();
            let sample = |x: usize, y: usize, dx: i8, dy: i8| {
                let column = x.saturating_add_signed(dx.into()).min(width - 1);
                let line = y.saturating_add_signed(dy.into()).min(height - 1);
                pixels[line * width + column]
            };
            let depth = 2 * usize::from(y_px) + 1;
            for order in [Order::Columns, Order::Mirrored] {
                let mut block = [0; 4096];
                let words = Strip::words(width, x_px.into(), depth);
                let mut arena = Arena::new(&mut block[..words]);
                let mut strip = Strip::new(width, x_px.into(), depth, order, &mut arena).unwrap();
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
                                    sample(x, y, dx, dy),
                                    "seed {seed}, {width}x{height}, {order:?}, ({x}, {y}), ({dx}, {dy})"
                                );
                            }
                        }
                    }
                };
                for (y, line) in pixels.chunks_exact(width).enumerate() {
                    strip.push(|row| row.copy_from_slice(line));
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
    fn requests_outside_the_padding_are_empty() {
        for order in [Order::Columns, Order::Mirrored] {
            let mut block = [0; 16];
            let mut strip = Strip::new(4, 1, 3, order, &mut Arena::new(&mut block)).unwrap();
            strip.push(|row| row.fill(3));
            let window = strip.window(0);
            let (centre, beyond) = (Offset { dx: 0, dy: 0 }, Offset { dx: 2, dy: 0 });
            assert_eq!(window.samples(centre, 0, 4), [3; 4]);
            assert!(window.samples(beyond, 0, 4).is_empty());
            assert_eq!(window.start(beyond, 0, 4), None);
            assert!(window.samples(centre, 2, 4).is_empty());
            assert!(strip.run(0, -2, 4).is_empty());
            assert!(strip.run(0, 0, 6).is_empty());
        }
    }
}
