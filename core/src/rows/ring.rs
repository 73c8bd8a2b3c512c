//! Rings: the newest rows of any kind, in lent memory.

use core::ops::Range;

use bytemuck::Pod;

use super::arena::{Arena, OutOfMemory, words};
use super::copy::{copy_common, extend_run};
use crate::disparity::INVALID;

/// The newest `depth` rows of `width` values, row-major. Each row has `padding` values on both
/// sides, which only [`Ring::replicate_edges`] writes after the ring was built.
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
    fn padded_mut(&mut self, row: u32) -> &mut [T] {
        let start = self.start(row) - self.padding;
        let stride = self.stride();
        let row = self.values.get_mut(start..start + stride);
        row.unwrap_or_default()
    }

    /// Makes the padding of a row the row's own first and last value.
    pub(crate) fn replicate_edges(&mut self, row: u32) {
        let inside = self.padding..self.padding + self.width;
        extend_run(self.padded_mut(row), inside);
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

/// A ring for a stage that looks `reach` rows back and `reach` rows ahead: row `y` is due when row
/// `y + reach` has come, or when no more come. Values outside the rows are [`INVALID`].
#[derive(Debug)]
pub(crate) struct RowWindow<'m> {
    /// The newest `2 reach + 1` rows.
    pub(crate) rows: Ring<'m, i16>,
    reach: u8,
    rows_out: u32,
}

impl<'m> RowWindow<'m> {
    /// Words of memory of such a window.
    pub(crate) const fn words(width: usize, padding: usize, reach: u8) -> usize {
        Ring::<i16>::words(width, padding, 2 * reach as usize + 1)
    }

    /// An empty window of rows of `width` values, with `padding` values on both sides of each.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`RowWindow::words`] left.
    pub(crate) fn new(
        width: usize,
        padding: usize,
        reach: u8,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let depth = 2 * usize::from(reach) + 1;
        Ok(Self {
            rows: Ring::new(width, padding, depth, INVALID, arena)?,
            reach,
            rows_out: 0,
        })
    }

    /// Forgets all rows: the next one is row 0.
    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.rows_out = 0;
    }

    /// Stores the next row, and returns the number of the row that is due, if any.
    pub(crate) fn push(&mut self, row: &[i16]) -> Option<u32> {
        self.rows.push_copy(row);
        if self.rows.rows_in() > self.rows_out + u32::from(self.reach) {
            self.flush()
        } else {
            None
        }
    }

    /// The number of the next row among those that have come, when no more come.
    pub(crate) fn flush(&mut self) -> Option<u32> {
        (self.rows_out < self.rows.rows_in()).then(|| {
            self.rows_out += 1;
            self.rows_out - 1
        })
    }

    /// The existing rows at most `reach` away from `row`.
    pub(crate) fn around(&self, row: u32) -> Range<u32> {
        let reach = u32::from(self.reach);
        row.saturating_sub(reach)..(row + reach + 1).min(self.rows.rows_in())
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
        for rows in [7..11, 8..9, 9..9] {
            let starts: Vec<usize> = rows.clone().map(|row| ring.start(row)).collect();
            assert!(ring.starts(rows).eq(starts));
        }
        ring.replicate_edges(8);
        assert_eq!(ring.padded(8), [80, 80, 80, 81, 82, 82, 82]);
        // No other row's.
        assert_eq!(ring.padded(9), [-1, -1, 90, 91, 92, -1, -1]);
    }

    #[test]
    fn a_row_is_due_when_those_ahead_have_come() {
        for reach in 0..4_u8 {
            let mut memory = vec![u32::MAX; RowWindow::words(1, 0, reach)];
            let mut arena = Arena::new(&mut memory);
            let mut window = RowWindow::new(1, 0, reach, &mut arena).unwrap();
            assert_eq!(arena.free_words(), 0);
            for rows in [0, 1, 3, 9_u32] {
                window.clear();
                let mut due: Vec<u32> = vec![];
                for rows_in in 1..=rows {
                    due.extend(window.push(&[rows_in as i16]));
                    assert_eq!(due.len() as u32, rows_in.saturating_sub(reach.into()));
                }
                while let Some(row) = window.flush() {
                    due.push(row);
                }
                assert_eq!(due, (0..rows).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn a_window_is_cut_at_the_frame() {
        let mut memory = [0; 16];
        let mut window = RowWindow::new(1, 0, 3, &mut Arena::new(&mut memory)).unwrap();
        for row in 0..11 {
            window.push(&[row]);
        }
        assert_eq!((window.around(1), window.around(9)), (0..5, 6..11));
    }
}
