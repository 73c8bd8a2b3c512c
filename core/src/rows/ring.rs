//! Rings: the newest rows of any kind, in lent memory.

use core::ops::Range;

use bytemuck::Pod;

use super::arena::{Arena, OutOfMemory, words};
use super::copy::copy_common;

/// The newest `depth` rows of `width` values, row-major. Each row has `padding` values on both
/// sides, which the ring itself never writes after it was built.
#[derive(Debug)]
pub(crate) struct Ring<'m, T> {
    values: &'m mut [T],
    width: usize,
    padding: usize,
    depth: usize,
    rows_in: u32,
}

impl<'m, T: Pod> Ring<'m, T> {
    /// Words of memory of such a ring.
    pub(crate) const fn words(width: usize, padding: usize, depth: usize) -> usize {
        words((width + 2 * padding) * depth, size_of::<T>())
    }

    /// An empty ring, all of whose values, those of the padding too, are `outside`.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Ring::words`] left.
    pub(crate) fn new(
        width: usize,
        padding: usize,
        depth: usize,
        outside: T,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let values = arena.take((width + 2 * padding) * depth)?;
        values.fill(outside);
        Ok(Self {
            values,
            width,
            padding,
            depth,
            rows_in: 0,
        })
    }

    /// Forgets all rows: the next one is row 0.
    pub(crate) fn clear(&mut self) {
        self.rows_in = 0;
    }

    /// Number of rows taken since the ring was cleared.
    #[inline]
    pub(crate) fn rows_in(&self) -> u32 {
        self.rows_in
    }

    /// Makes the oldest row the newest, and returns it without its padding, to be written; empty if
    /// the ring keeps no row.
    pub(crate) fn push(&mut self) -> &mut [T] {
        let row = self.rows_in;
        self.rows_in += 1;
        self.row_mut(row)
    }

    /// Stores `row` as the newest; if the widths differ, the common values.
    pub(crate) fn push_copy(&mut self, row: &[T]) {
        copy_common(self.push(), row);
    }

    /// A row without its padding, one of the newest `depth`.
    #[inline]
    pub(crate) fn row(&self, row: u32) -> &[T] {
        let start = self.start(row);
        let row = self.values.get(start..start + self.width);
        row.unwrap_or_default()
    }

    /// [`Ring::row`], to be written.
    #[inline]
    pub(crate) fn row_mut(&mut self, row: u32) -> &mut [T] {
        let start = self.start(row);
        let row = self.values.get_mut(start..start + self.width);
        row.unwrap_or_default()
    }

    /// A row with its padding; for a row after the newest, the newest.
    pub(crate) fn padded(&self, row: u32) -> &[T] {
        let row = row.min(self.rows_in.saturating_sub(1));
        // The padding lies before a row's start.
        let start = self.start(row) - self.padding;
        let row = self.values.get(start..start + self.stride());
        row.unwrap_or_default()
    }

    /// [`Ring::padded`] of row `row` itself, to be written.
    pub(crate) fn padded_mut(&mut self, row: u32) -> &mut [T] {
        let start = self.start(row) - self.padding;
        let stride = self.stride();
        let row = self.values.get_mut(start..start + stride);
        row.unwrap_or_default()
    }

    /// The existing rows at most `reach` away from `row`.
    pub(crate) fn around(&self, row: u32, reach: u8) -> Range<u32> {
        row.saturating_sub(reach.into())..(row + u32::from(reach) + 1).min(self.rows_in)
    }

    /// Index in [`Ring::values`] of the first value of a row. A division: once per row, not per
    /// pixel.
    #[inline]
    pub(crate) fn start(&self, row: u32) -> usize {
        self.slot(row) * self.stride() + self.padding
    }

    /// [`Ring::start`] of each of `rows`, with one division in all.
    #[inline]
    pub(crate) fn starts(&self, rows: Range<u32>) -> impl Iterator<Item = usize> + Clone + use<T> {
        let (stride, end) = (self.stride(), self.depth * self.stride());
        let mut next = self.start(rows.start);
        rows.map(move |_| {
            let start = next;
            next += stride;
            // After the last place comes the first.
            if next >= end {
                next -= end;
            }
            start
        })
    }

    /// Number of the place that a row is kept at, below `depth`.
    #[inline]
    pub(crate) fn slot(&self, row: u32) -> usize {
        row as usize % self.depth.max(1)
    }

    /// The values of all rows, for many lookups.
    #[inline]
    pub(crate) fn values(&self) -> &[T] {
        self.values
    }

    /// [`Ring::values`], to be written.
    #[inline]
    pub(crate) fn values_mut(&mut self) -> &mut [T] {
        self.values
    }

    /// Values from the start of a row's padding to that of the next.
    #[inline]
    pub(crate) fn stride(&self) -> usize {
        self.width + 2 * self.padding
    }

    /// Values of a row without its padding.
    #[inline]
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Values on either side of a row.
    #[inline]
    pub(crate) fn padding(&self) -> usize {
        self.padding
    }

    /// Rows that are kept.
    #[inline]
    pub(crate) fn depth(&self) -> usize {
        self.depth
    }
}

impl<T: Copy> Ring<'_, T> {
    /// Makes the padding of every row the row's own first and last value.
    pub(crate) fn replicate_edges(&mut self) {
        let (first, end) = (self.padding, self.padding + self.width);
        for row in self.values.chunks_exact_mut((end + first).max(1)) {
            let Some((before, rest)) = row.split_at_mut_checked(first) else {
                continue;
            };
            let Some((inside, after)) = rest.split_at_mut_checked(self.width) else {
                continue;
            };
            if let (Some(&first), Some(&last)) = (inside.first(), inside.last()) {
                before.fill(first);
                after.fill(last);
            }
        }
    }
}

/// Schedule of a stage that needs a number of rows ahead: row `y` is due when row `y + ahead` has
/// come, or when no more come.
#[derive(Debug)]
pub(crate) struct Lookahead {
    ahead: u32,
    rows_out: u32,
}

impl Lookahead {
    /// A schedule for a stage that needs `ahead` rows ahead.
    pub(crate) const fn new(ahead: u32) -> Self {
        Self { ahead, rows_out: 0 }
    }

    /// Forgets the frame.
    pub(crate) fn reset(&mut self) {
        self.rows_out = 0;
    }

    /// The next row, if it is due now that `rows_in` rows have come.
    pub(crate) fn due(&mut self, rows_in: u32) -> Option<u32> {
        if rows_in > self.rows_out + self.ahead {
            self.last(rows_in)
        } else {
            None
        }
    }

    /// The next row among the `rows_in` that have come, when no more come.
    pub(crate) fn last(&mut self, rows_in: u32) -> Option<u32> {
        (self.rows_out < rows_in).then(|| {
            self.rows_out += 1;
            self.rows_out - 1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn a_ring_keeps_the_newest_rows() {
        let mut memory = vec![u32::MAX; Ring::<i16>::words(3, 2, 4)];
        let mut arena = Arena::new(&mut memory);
        let mut ring = Ring::<i16>::new(3, 2, 4, -1, &mut arena).unwrap();
        assert_eq!(arena.free_words(), 0);
        for _ in 0..2 {
            ring.clear();
            let row_of = |y: i16| [10 * y, 10 * y + 1, 10 * y + 2];
            for y in 0..11 {
                ring.push_copy(&row_of(y));
                assert_eq!(ring.rows_in(), y as u32 + 1);
                for kept in (y - 3).max(0)..=y {
                    assert_eq!(ring.row(kept as u32), row_of(kept));
                    let start = ring.start(kept as u32);
                    assert_eq!(ring.values()[start..start + 3], row_of(kept));
                    let [a, b, c] = row_of(kept);
                    assert_eq!(ring.padded(kept as u32), [-1, -1, a, b, c, -1, -1]);
                }
                // The newest row stands in for rows after it.
                assert_eq!(ring.padded(y as u32 + 5)[2..5], row_of(y));
            }
        }
        assert_eq!((ring.around(1, 3), ring.around(9, 3)), (0..5, 6..11));
        for rows in [7..11, 8..9, 9..9] {
            let starts: Vec<usize> = rows.clone().map(|row| ring.start(row)).collect();
            assert!(ring.starts(rows).eq(starts));
        }
        ring.replicate_edges();
        assert_eq!(ring.padded(8), [80, 80, 80, 81, 82, 82, 82]);
    }

    #[test]
    fn a_row_is_due_when_those_ahead_have_come() {
        for ahead in 0..4 {
            let mut lookahead = Lookahead::new(ahead);
            for rows in [0, 1, 3, 9] {
                lookahead.reset();
                let mut due: Vec<u32> = vec![];
                for rows_in in 1..=rows {
                    due.extend(lookahead.due(rows_in));
                    assert_eq!(due.len() as u32, rows_in.saturating_sub(ahead));
                }
                while let Some(row) = lookahead.last(rows) {
                    due.push(row);
                }
                assert_eq!(due, (0..rows).collect::<Vec<_>>());
            }
        }
    }
}
