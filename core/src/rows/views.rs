//! Views: the newest lines of one camera, for all parts that read them.

use core::ops::Range;

use super::arena::{Arena, OutOfMemory};
use super::copy::copy_common;
use super::line::Line;
use super::moved::RowOffsets;
use super::runs::ValidRuns;
use super::strip::{Order, Strip};
use crate::disparity::Reference;
use crate::kernel::{Kernels, LevelConversion, MAX_CHANNELS};

/// The newest lines of one view: grey; red, green and blue if there is colour; and smoothed grey,
/// each in a strip of its own.
#[derive(Debug)]
pub struct View<'m> {
    grey: Strip<'m>,
    colour: Option<[Strip<'m>; MAX_CHANNELS]>,
    /// Smoothed grey. The newest line is stored unsmoothed until the line below comes.
    smoothed: Option<Strip<'m>>,
    step_max: u8,
    /// Number of lines above the line before the newest that is smoothed when the newest comes.
    smoothing_latency_lines: u32,
    /// For each line, the run of stored positions that the camera saw.
    valid: ValidRuns<'m>,
    order: Order,
}

/// Shape of a [`View`].
#[derive(Debug, Clone, Copy)]
pub struct ViewSize {
    /// Columns, px.
    pub width: usize,
    /// Number of lines of grey that are kept; 0 if grey is not used.
    pub grey_lines: usize,
    /// Copies of the first and last pixel at the ends of a line of grey, px.
    pub grey_padding: usize,
    /// Number of lines of each colour channel that are kept; 0 without colour.
    pub colour_lines: usize,
    /// Copies of the first and last pixel at the ends of a line of a colour channel, px.
    pub colour_padding: usize,
    /// Number of lines of smoothed grey that are kept; 0 if nothing is smoothed.
    pub smoothed_lines: usize,
    /// Copies of the first and last pixel at the ends of a line of smoothed grey, px.
    pub smoothed_padding: usize,
    /// Largest step between neighbours that is smoothed, levels.
    pub smoothing_step: u8,
    /// Largest number of lines by which a pixel is moved up or down, see [`Strip::push_moved`]; 0 if lines are
    /// used as they come.
    pub moving_lines: usize,
    /// Number of lines after a line that must come, besides the one below it, before the line is smoothed.
    pub smoothing_latency_lines: usize,
    /// Number of lines whose valid columns are kept.
    pub valid_lines: usize,
}

impl ViewSize {
    /// Words of memory of such a view.
    #[must_use]
    pub const fn words(&self) -> usize {
        let moving = Strip::moving_words(self.width, self.moving_lines);
        let mut total = 0;
        if self.grey_lines > 0 {
            total += Strip::words(self.width, self.grey_padding, self.grey_lines) + moving;
        }
        if self.colour_lines > 0 {
            let strip = Strip::words(self.width, self.colour_padding, self.colour_lines);
            total += MAX_CHANNELS * (strip + moving);
        }
        total
            + Strip::words(self.width, self.smoothed_padding, self.smoothed_lines)
            + ValidRuns::words(self.valid_lines)
    }

    /// Number of channels of [`View::channels`]: 3 with colour, else 1.
    #[must_use]
    pub const fn channels(&self) -> usize {
        if self.colour_lines > 0 {
            MAX_CHANNELS
        } else {
            1
        }
    }
}

impl<'m> View<'m> {
    /// An empty view.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`ViewSize::words`] left.
    pub fn new(size: ViewSize, order: Order, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        let width = size.width;
        let mut strip = |padding, lines, moving| {
            let strip = Strip::new(width, padding, lines, order, arena)?;
            if lines > 0 && moving > 0 {
                strip.moving(moving, arena)
            } else {
                Ok(strip)
            }
        };
        let grey = strip(size.grey_padding, size.grey_lines, size.moving_lines)?;
        let colour = if size.colour_lines > 0 {
            let mut channel = || strip(size.colour_padding, size.colour_lines, size.moving_lines);
            Some([channel()?, channel()?, channel()?])
        } else {
            None
        };
        let smoothed = if size.smoothed_lines > 0 {
            Some(strip(size.smoothed_padding, size.smoothed_lines, 0)?)
        } else {
            None
        };
        Ok(Self {
            grey,
            colour,
            smoothed,
            step_max: size.smoothing_step,
            smoothing_latency_lines: size.smoothing_latency_lines as u32,
            valid: ValidRuns::new(size.valid_lines, arena)?,
            order,
        })
    }

    /// Takes the next line, of the view's width, with colour where the view keeps it.
    pub fn push(&mut self, line: &(impl Line + ?Sized), kernels: &impl Kernels) {
        self.push_mended(line, RowOffsets::NONE, |_, _| None, kernels);
    }

    /// Takes the next line of a view and moves it by `offsets`: see [`Strip::push_moved`]. Before that, its
    /// levels are converted by what `conversion` returns for its grey and the positions that the camera saw,
    /// both in stored order.
    fn push_mended(
        &mut self,
        line: &(impl Line + ?Sized),
        offsets: RowOffsets,
        conversion: impl FnOnce(&[u8], Range<usize>) -> Option<LevelConversion>,
        kernels: &impl Kernels,
    ) {
        let Range { start, end } = line.valid_columns();
        let end = end.min(line.width());
        let columns = start.min(end)..end;
        let valid = match self.order {
            Order::Columns => columns,
            Order::Mirrored => mirrored(columns, line.width()),
        };
        self.valid.push(valid.clone());
        let mut found = None;
        if self.grey.keeps_lines() {
            self.grey.push_moved(
                offsets,
                |row| line.write_grey(row),
                |row| {
                    found = conversion(row, valid);
                    convert_inside(row, found);
                },
            );
            self.smooth(kernels);
        }
        if let Some(colour) = &mut self.colour {
            for (channel, strip) in colour.iter_mut().enumerate() {
                strip.push_moved(
                    offsets,
                    |row| line.write_channel(channel, row),
                    |row| convert_inside(row, found),
                );
            }
        }
    }

    /// Sets the largest step between neighbours that is smoothed from the next line on, levels.
    fn set_smoothing_step(&mut self, step: u8) {
        self.step_max = step;
    }

    /// Smooths the line above the newest, or that as many lines higher as pixels wait for to be moved. The
    /// lines below it are not smoothed yet.
    fn smooth(&mut self, kernels: &impl Kernels) {
        let (Some(smoothed), Some(newest)) = (&mut self.smoothed, self.grey.lines().checked_sub(1))
        else {
            return;
        };
        let grey = &self.grey;
        if let Some(line) = newest.checked_sub(1 + self.smoothing_latency_lines) {
            // The padding is at least one pixel if lines are smoothed.
            let around = [line.saturating_sub(1), line, line + 1].map(|line| grey.padded(line));
            smoothed.store(line, |levels| {
                kernels.smooth_row(around, self.step_max, levels);
            });
        }
        smoothed.store(newest, |levels| copy_common(levels, grey.row(newest)));
    }

    /// Turns a conversion by the newest lines of both views into one by that of the other view: this view
    /// is the reference view, and has its newest line.
    fn beside_newest(
        &self,
        conversion: impl FnOnce(NewestRows<'_>) -> Option<LevelConversion>,
    ) -> impl FnOnce(&[u8], Range<usize>) -> Option<LevelConversion> {
        let newest = self.lines().saturating_sub(1);
        move |levels, valid| {
            conversion(NewestRows {
                levels: [self.grey.row(newest), levels],
                valid: [self.valid(newest), valid],
            })
        }
    }

    /// Forgets the frame: the next line is line 0.
    pub fn clear(&mut self) {
        self.grey.clear();
        for strip in self.colour.iter_mut().flatten() {
            strip.clear();
        }
        if let Some(smoothed) = &mut self.smoothed {
            smoothed.clear();
        }
        self.valid.clear();
    }

    /// The positions of a line, in stored order, that the camera saw.
    #[must_use]
    pub fn valid(&self, line: u32) -> Range<usize> {
        self.valid.row(line)
    }

    /// Number of lines of grey that have come since the frame began.
    #[must_use]
    pub fn lines(&self) -> u32 {
        self.grey.lines()
    }

    /// Grey.
    #[must_use]
    pub fn grey(&self) -> &Strip<'m> {
        &self.grey
    }

    /// Smoothed grey, or grey if nothing is smoothed.
    #[must_use]
    pub fn smoothed(&self) -> &Strip<'m> {
        self.smoothed.as_ref().unwrap_or(&self.grey)
    }

    /// Red, green and blue, or grey alone without colour.
    #[must_use]
    pub fn channels(&self) -> &[Strip<'m>] {
        match &self.colour {
            Some(colour) => colour,
            None => core::slice::from_ref(&self.grey),
        }
    }

    /// Line `line` of each of the [`View::channels`], in stored order; empty for channels that do
    /// not exist.
    #[must_use]
    pub fn rows(&self, line: u32) -> [&[u8]; MAX_CHANNELS] {
        let mut rows = [&[][..]; MAX_CHANNELS];
        for (row, channel) in rows.iter_mut().zip(self.channels()) {
            *row = channel.row(line);
        }
        rows
    }
}

/// Converts the levels of a row, if they are to be converted. Levels at either end of the range, which
/// may have been clipped, stay.
fn convert_inside(levels: &mut [u8], conversion: Option<LevelConversion>) {
    let Some(conversion) = conversion else {
        return;
    };
    for level in levels {
        *level = conversion.apply_inside(*level);
    }
}

/// Grey of the newest line of the reference view and of the other view, in that order, each in the stored
/// order of its view.
#[derive(Debug)]
pub(crate) struct NewestRows<'a> {
    /// The levels.
    pub(crate) levels: [&'a [u8]; 2],
    /// The positions that the camera saw.
    pub(crate) valid: [Range<usize>; 2],
}

/// A run of columns as positions of a row that is stored from right to left.
fn mirrored(columns: Range<usize>, width: usize) -> Range<usize> {
    width.saturating_sub(columns.end)..width.saturating_sub(columns.start)
}

/// The two views of a matcher, by their roles.
#[derive(Debug)]
pub struct ViewPair<'m> {
    /// The view whose pixels get a disparity.
    pub reference: View<'m>,
    /// The view that is searched.
    pub other: View<'m>,
    side: Reference,
}

impl<'m> ViewPair<'m> {
    /// Two empty views; `side` is the camera of the reference view. `sizes` and `orders` are those
    /// of the reference view and of the other.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer words left than both [`ViewSize::words`] together.
    pub fn new(
        side: Reference,
        sizes: [ViewSize; 2],
        orders: [Order; 2],
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let ([size, other_size], [order, other_order]) = (sizes, orders);
        Ok(Self {
            reference: View::new(size, order, arena)?,
            other: View::new(other_size, other_order, arena)?,
            side,
        })
    }

    /// Takes the next line of each camera.
    pub fn push(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
        kernels: &impl Kernels,
    ) {
        self.push_mended(left, right, RowOffsets::NONE, |_| None, kernels);
    }

    /// Takes the next line of each camera. The levels of the other view's line are converted by what
    /// `conversion` returns for both lines, but for those at either end of the range; then that line is
    /// moved by `offsets`: see [`Strip::push_moved`].
    pub(crate) fn push_mended(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
        offsets: RowOffsets,
        conversion: impl FnOnce(NewestRows<'_>) -> Option<LevelConversion>,
        kernels: &impl Kernels,
    ) {
        let Self {
            reference, other, ..
        } = self;
        match self.side {
            Reference::Left => {
                reference.push(left, kernels);
                let conversion = reference.beside_newest(conversion);
                other.push_mended(right, offsets, conversion, kernels);
            }
            Reference::Right => {
                reference.push(right, kernels);
                let conversion = reference.beside_newest(conversion);
                other.push_mended(left, offsets, conversion, kernels);
            }
        }
    }

    /// Sets the largest step between neighbours that is smoothed in either view from the next pair of
    /// lines on, levels.
    pub(crate) fn set_smoothing_step(&mut self, step: u8) {
        self.reference.set_smoothing_step(step);
        self.other.set_smoothing_step(step);
    }

    /// Forgets the frame: the next lines are line 0.
    pub fn clear(&mut self) {
        self.reference.clear();
        self.other.clear();
    }

    /// Number of pairs of lines that have come since the frame began.
    #[must_use]
    pub fn lines(&self) -> u32 {
        self.reference.lines()
    }
}
