//! A ring of rows between a producer and a stage that looks a few rows ahead.

use crate::memory::{Arena, OutOfMemory, words};

/// The newest `depth` rows, each with `padding` values on both sides that say "outside".
///
/// A stage that looks `ahead` rows ahead is given row `y` when row `y + ahead` is in, or
/// when the frame has ended.
#[derive(Debug)]
pub(super) struct RowRing<'m> {
    values: &'m mut [i16],
    width: usize,
    padding: usize,
    depth: usize,
    ahead: u32,
    rows_in: u32,
    rows_out: u32,
}

impl<'m> RowRing<'m> {
    pub(super) const fn memory_words(width: usize, padding: usize, depth: usize) -> usize {
        words((width + 2 * padding) * depth, size_of::<i16>())
    }

    pub(super) fn new(
        width: usize,
        padding: usize,
        depth: usize,
        ahead: u8,
        outside: i16,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let values = arena.take((width + 2 * padding) * depth)?;
        values.fill(outside);
        Ok(Self {
            values,
            width,
            padding,
            depth,
            ahead: ahead.into(),
            rows_in: 0,
            rows_out: 0,
        })
    }

    pub(super) fn reset(&mut self) {
        self.rows_in = 0;
        self.rows_out = 0;
    }

    /// Rows taken so far.
    pub(super) fn rows_in(&self) -> u32 {
        self.rows_in
    }

    /// Takes the next row; gives the one to work on, if any.
    pub(super) fn push(&mut self, row: &[i16]) -> Option<u32> {
        let line = self.rows_in;
        if let Some(kept) = self.row_mut(line)
            && let Some(row) = row.get(..kept.len())
        {
            kept.copy_from_slice(row);
        }
        self.rows_in += 1;
        if self.rows_in > self.rows_out + self.ahead {
            self.flush()
        } else {
            None
        }
    }

    /// After the last row: gives the next one to work on, if any.
    pub(super) fn flush(&mut self) -> Option<u32> {
        (self.rows_out < self.rows_in).then(|| {
            self.rows_out += 1;
            self.rows_out - 1
        })
    }

    /// The rows that are there around `line`, at most `reach` away.
    pub(super) fn around(&self, line: u32, reach: u8) -> core::ops::Range<u32> {
        line.saturating_sub(reach.into())..(line + u32::from(reach) + 1).min(self.rows_in)
    }

    /// The nearest row that is there, with its padding.
    pub(super) fn padded(&self, line: u32) -> &[i16] {
        let line = line.min(self.rows_in.saturating_sub(1));
        let start = self.start(line);
        self.values
            .get(start..start + self.width + 2 * self.padding)
            .unwrap_or_default()
    }

    /// Makes the padding of every row the row's own first and last value.
    pub(super) fn replicate_edges(&mut self) {
        let stride = self.width + 2 * self.padding;
        let (first, last) = (self.padding, self.padding + self.width - 1);
        for row in self.values.chunks_exact_mut(stride.max(1)) {
            for (from, to) in [(first, first.saturating_sub(1)), (last, last + 1)] {
                let value = row.get(from).copied();
                if let (Some(to), Some(value)) = (row.get_mut(to), value) {
                    *to = value;
                }
            }
        }
    }

    /// A row without its padding.
    pub(super) fn row(&self, line: u32) -> &[i16] {
        let start = self.start(line) + self.padding;
        self.values
            .get(start..start + self.width)
            .unwrap_or_default()
    }

    fn row_mut(&mut self, line: u32) -> Option<&mut [i16]> {
        let start = self.start(line) + self.padding;
        self.values.get_mut(start..start + self.width)
    }

    /// Where a row without its padding begins in [`RowRing::values`].
    pub(super) fn row_start(&self, line: u32) -> usize {
        self.start(line) + self.padding
    }

    /// The values of all rows, for many lookups.
    pub(super) fn values(&self) -> &[i16] {
        self.values
    }

    pub(super) fn values_mut(&mut self) -> &mut [i16] {
        self.values
    }

    /// Once per row, not per pixel.
    fn start(&self, line: u32) -> usize {
        (line as usize % self.depth.max(1)) * (self.width + 2 * self.padding)
    }
}
