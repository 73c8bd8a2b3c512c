//! Median over a square window, by a histogram that slides along the line.
//!
//! The window is cut at the edges of the image; pixels without a disparity do not
//! count, and stay without one. Of an even number of values the lower middle one.

use crate::disparity::{DisparityRange, INVALID};
use crate::memory::{Arena, OutOfMemory, words};

/// A `size x size` median over a ring of `size` rows.
#[derive(Debug)]
pub struct Median<'m> {
    rows_px: &'m mut [i16],
    output_px: &'m mut [i16],
    histogram: &'m mut [u16],
    width: usize,
    reach: u32,
    minimum_px: i32,
    rows_in: u32,
    rows_out: u32,
}

impl<'m> Median<'m> {
    /// Words of memory: `size + 1` rows and one bin per disparity.
    #[must_use]
    pub const fn memory_words(width: usize, reach: u8, disparities: u16) -> usize {
        let size = 2 * reach as usize + 1;
        words(size * width, size_of::<i16>())
            + words(width, size_of::<i16>())
            + words(disparities as usize, size_of::<u16>())
    }

    /// A median of `2 reach + 1` by `2 reach + 1` pixels for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Median::memory_words`] left.
    pub fn new(
        width: usize,
        reach: u8,
        disparities: DisparityRange,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let size = 2 * usize::from(reach) + 1;
        Ok(Self {
            rows_px: arena.take(size * width)?,
            output_px: arena.take(width)?,
            histogram: arena.take(disparities.count.into())?,
            width,
            reach: reach.into(),
            minimum_px: disparities.minimum_px.into(),
            rows_in: 0,
            rows_out: 0,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows_in = 0;
        self.rows_out = 0;
    }

    /// Takes a row, px. True when this completes a row, then [`Median::row`].
    pub fn push(&mut self, row_px: &[i16]) -> bool {
        let start = self.slot(self.rows_in);
        if let Some(kept) = self.rows_px.get_mut(start..start + self.width)
            && let Some(row_px) = row_px.get(..self.width)
        {
            kept.copy_from_slice(row_px);
        }
        self.rows_in += 1;
        self.rows_in > self.rows_out + self.reach && self.filter()
    }

    /// After the last row: completes the next of the rows still to come; false when
    /// there are no more.
    pub fn flush(&mut self) -> bool {
        self.rows_out < self.rows_in && self.filter()
    }

    /// The row last completed, px.
    #[must_use]
    pub fn row(&self) -> &[i16] {
        self.output_px
    }

    fn filter(&mut self) -> bool {
        let middle = self.rows_out;
        self.rows_out += 1;
        let rows = middle.saturating_sub(self.reach)..(middle + self.reach + 1).min(self.rows_in);
        let reach = self.reach as usize;
        let own = self.slot(middle);
        self.histogram.fill(0);
        // Values in the window, those of them below bin `median`, and that bin.
        let (mut total, mut below, mut median) = (0_u16, 0_u16, 0_usize);
        for x in 0..self.width + reach {
            for row in rows.clone() {
                let start = self.slot(row);
                if x < self.width
                    && let Some(bin) = self.bin(start + x)
                    && let Some(count) = self.histogram.get_mut(bin)
                {
                    *count += 1;
                    total += 1;
                    below += u16::from(bin < median);
                }
                if let Some(leaving) = x.checked_sub(2 * reach + 1)
                    && let Some(bin) = self.bin(start + leaving)
                    && let Some(count) = self.histogram.get_mut(bin)
                {
                    *count -= 1;
                    total -= 1;
                    below -= u16::from(bin < median);
                }
            }
            let Some(centre) = x.checked_sub(reach) else {
                continue;
            };
            let rank = total.saturating_sub(1) / 2;
            while below > rank && median > 0 {
                median -= 1;
                below -= self.histogram.get(median).copied().unwrap_or(0);
            }
            while let Some(&count) = self.histogram.get(median)
                && below + count <= rank
                && median + 1 < self.histogram.len()
            {
                below += count;
                median += 1;
            }
            let valid = self.bin(own + centre).is_some();
            if let Some(output) = self.output_px.get_mut(centre) {
                // Within the range of disparities, which fits `i16`.
                *output = if valid {
                    (self.minimum_px + median as i32) as i16
                } else {
                    INVALID
                };
            }
        }
        true
    }

    /// Bin of a kept pixel; none for one without a disparity.
    #[inline]
    fn bin(&self, index: usize) -> Option<usize> {
        let value = self.rows_px.get(index).copied().unwrap_or(INVALID);
        usize::try_from(i32::from(value) - self.minimum_px)
            .ok()
            .filter(|_| value != INVALID)
    }

    fn slot(&self, row: u32) -> usize {
        (row % (2 * self.reach + 1)) as usize * self.width
    }
}
