//! The lines of a frame, collected by whoever receives them.

use crate::board::FrameBegun;
use crate::message::Line;
use crate::pack::Sample;

/// Collects the lines of one stream of a frame in lent memory, and tells which are missing. Lines of
/// other frames, or outside of its region, are not taken.
#[derive(Debug)]
pub struct FrameAssembler<'m, T> {
    values: &'m mut [T],
    /// A bit for each line that has come.
    present: &'m mut [u32],
    begun: Option<FrameBegun>,
    lines: u32,
}

impl<'m, T: Sample> FrameAssembler<'m, T> {
    /// Words of `present` for frames of so many lines.
    #[must_use]
    pub const fn present_words(height_lines: usize) -> usize {
        height_lines.div_ceil(32)
    }

    /// An assembler without a frame. `values` has a place for each pixel of the largest frame, and
    /// `present` [`FrameAssembler::present_words`] words.
    #[must_use]
    pub fn new(values: &'m mut [T], present: &'m mut [u32]) -> Self {
        Self {
            values,
            present,
            begun: None,
            lines: 0,
        }
    }

    /// Begins a frame, whose pixels have no values yet, and forgets the one before. Returns whether
    /// it fits the memory; if not, no line of it is taken.
    pub fn begin(&mut self, begun: &FrameBegun) -> bool {
        let region = &begun.region;
        let pixels = u64::from(region.width_px) * u64::from(region.height_lines);
        let fits = pixels <= self.values.len() as u64
            && u64::from(region.height_lines) <= 32 * self.present.len() as u64;
        self.values.fill(T::NONE);
        self.present.fill(0);
        self.lines = 0;
        self.begun = fits.then_some(*begun);
        fits
    }

    /// Takes a line, or a part of one, and returns whether it is one of the frame's and not damaged. A line
    /// counts as come with its first part.
    pub fn push(&mut self, line: &Line<'_, T>) -> bool {
        let Some(begun) = &self.begun else {
            return false;
        };
        let region = &begun.region;
        let (Some(row), Some(column)) = (
            line.line.checked_sub(region.y_lines),
            line.column.checked_sub(region.x_px),
        ) else {
            return false;
        };
        let count = line.values.count();
        let width = usize::from(region.width_px);
        let column = usize::from(column);
        if line.frame != begun.frame || row >= region.height_lines || column + count > width {
            return false;
        }
        let row = row as usize;
        let start = row * width + column;
        let Some(values) = self.values.get_mut(start..start + count) else {
            return false;
        };
        if line.values.unpack(values).is_err() {
            values.fill(T::NONE);
            return false;
        }
        if let Some(word) = self.present.get_mut(row / 32) {
            let bit = 1 << (row % 32);
            self.lines += u32::from(*word & bit == 0);
            *word |= bit;
        }
        true
    }

    /// The frame that was begun.
    #[must_use]
    pub fn begun(&self) -> Option<&FrameBegun> {
        self.begun.as_ref()
    }

    /// The values of the frame, line after line of the region; [`Sample::NONE`] where none has come.
    #[must_use]
    pub fn values(&self) -> &[T] {
        let pixels = self.begun.as_ref().map_or(0, |begun| {
            usize::from(begun.region.width_px) * begun.region.height_lines as usize
        });
        self.values.get(..pixels).unwrap_or_default()
    }

    /// Number of lines that have come.
    #[must_use]
    pub fn lines(&self) -> u32 {
        self.lines
    }

    /// The numbers in the frame of the lines that are missing, from the top.
    pub fn missing(&self) -> impl Iterator<Item = u32> + '_ {
        let region = self.begun.as_ref().map(|begun| &begun.region);
        let (first, height) = region.map_or((0, 0), |region| (region.y_lines, region.height_lines));
        let is_present = |row: u32| {
            let word = self.present.get(row as usize / 32);
            word.is_some_and(|word| word >> (row % 32) & 1 != 0)
        };
        (0..height)
            .filter(move |row| !is_present(*row))
            .map(move |row| first.saturating_add(row))
    }
}
