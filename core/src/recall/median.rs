//! The paper's median over a square window, by a histogram that slides along the line.
//!
//! The window is clipped at the edges of the image. Pixels without a disparity are not counted, and
//! remain without one. The median of an even number of values is the lower of the two in the
//! middle.

use crate::disparity::{DisparityRange, INVALID};
use crate::rows::{Arena, OutOfMemory, Part, RowStage, RowWindow, words};

/// A median of `2 reach + 1` by `2 reach + 1` pixels, of rows of disparities in px.
#[derive(Debug)]
pub(super) struct Median<'m> {
    window: RowWindow<'m>,
    histogram: &'m mut [u16],
    reach: u8,
    minimum_px: i32,
}

impl<'m> Median<'m> {
    /// Demand of the median: a row per line of the window, a bin per disparity, and `reach` lines
    /// of latency.
    pub(super) const fn part(width: usize, reach: u8, disparities: u16) -> Part {
        Part {
            name: "median",
            words: RowWindow::words(width, 0, reach)
                + words(disparities as usize, size_of::<u16>()),
            look_back_lines: 0,
            latency_lines: reach as u32,
        }
    }

    /// A median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`Median::part`] says.
    pub(super) fn new(
        width: usize,
        reach: u8,
        disparities: DisparityRange,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self {
            window: RowWindow::new(width, 0, reach, arena)?,
            histogram: arena.take(disparities.count.into())?,
            reach,
            minimum_px: disparities.minimum_px.into(),
        })
    }

    /// Writes the medians of row `middle` to `output`, if there is such a row; returns whether
    /// there is.
    fn filter(&mut self, middle: Option<u32>, output: &mut [i16]) -> bool {
        let Some(middle) = middle else { return false };
        let rows = self.window.around(middle);
        let starts = self.window.rows.starts(rows);
        let reach = usize::from(self.reach);
        let width = self.window.rows.width();
        let own = self.window.rows.start(middle);
        self.histogram.fill(0);
        // Number of values in the window, number of those below bin `median`, and that bin.
        let (mut total, mut below, mut median) = (0_u16, 0_u16, 0_usize);
        for x in 0..width + reach {
            for start in starts.clone() {
                if x < width
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
            if let Some(output) = output.get_mut(centre) {
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

    /// Bin of the value at `index` of the ring; `None` for a pixel without a disparity.
    #[inline]
    fn bin(&self, index: usize) -> Option<usize> {
        let value = self
            .window
            .rows
            .values()
            .get(index)
            .copied()
            .unwrap_or(INVALID);
        usize::try_from(i32::from(value) - self.minimum_px)
            .ok()
            .filter(|_| value != INVALID)
    }
}

impl<C> RowStage<C> for Median<'_> {
    fn reset(&mut self) {
        self.window.clear();
    }

    fn push(&mut self, row: &mut [i16], _: &mut C) -> bool {
        let due = self.window.push(row);
        self.filter(due, row)
    }

    fn flush(&mut self, row: &mut [i16], _: &mut C) -> bool {
        let next = self.window.flush();
        self.filter(next, row)
    }
}
