//! A view's lines taken apart as they come in: grey, and a strip per channel.

use super::cost::MAX_CHANNELS;
use crate::camera::PixelFormat;
use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory, words};
use crate::strip::{Order, Strip};

/// The newest lines of a view, channel by channel: red, green and blue, or grey alone.
#[derive(Debug)]
pub struct ChannelStrips<'m> {
    strips: [Strip<'m>; MAX_CHANNELS],
    format: PixelFormat,
    count: usize,
    /// A line's grey or one of its channels, before it goes to a strip; empty where lines
    /// are grey.
    line: &'m mut [u8],
}

/// What strips of channels are sized for.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChannelsSize {
    /// Channels to keep: 3, 1 for grey, or 0 where only the grey line is asked for.
    pub(super) count: usize,
    pub(super) width: usize,
    pub(super) padding: usize,
    pub(super) depth: usize,
    pub(super) format: PixelFormat,
    /// Whether lines are moved; see [`Strip::push_moved`].
    pub(super) moving: bool,
}

impl ChannelsSize {
    const fn line_bytes(&self) -> usize {
        if self.format.is_grey() { 0 } else { self.width }
    }
}

impl<'m> ChannelStrips<'m> {
    pub(super) const fn memory_words(size: ChannelsSize) -> usize {
        let moving = if size.moving {
            Strip::moving_words(size.width)
        } else {
            0
        };
        size.count * (Strip::memory_words(size.width, size.padding, size.depth) + moving)
            + words(size.line_bytes(), 1)
    }

    pub(super) fn new(
        size: ChannelsSize,
        order: Order,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let mut strip = |index| {
            // A strip without lines takes no memory.
            let is_there = index < size.count;
            let depth = if is_there { size.depth } else { 0 };
            let strip = Strip::new(size.width, size.padding, depth, order, arena)?;
            if is_there && size.moving {
                strip.moving(arena)
            } else {
                Ok(strip)
            }
        };
        Ok(Self {
            strips: [strip(0)?, strip(1)?, strip(2)?],
            format: size.format,
            count: size.count,
            line: arena.take(size.line_bytes())?,
        })
    }

    /// Takes the next line, in the configured pixel format; gives its grey.
    pub fn push<'a>(&'a mut self, line: &'a [u8], kernels: &impl Kernels) -> &'a [u8] {
        self.push_moved(line, 0, kernels)
    }

    /// The same for a view whose lines lie too low; see [`Strip::push_moved`]. The grey is that
    /// of the line as it came.
    pub(super) fn push_moved<'a>(
        &'a mut self,
        line: &'a [u8],
        offset_q4: i8,
        kernels: &impl Kernels,
    ) -> &'a [u8] {
        if self.count == MAX_CHANNELS {
            for (channel, strip) in self.strips.iter_mut().enumerate() {
                kernels.channel_row(self.format, line, channel, self.line);
                strip.push_moved(self.line, offset_q4);
            }
        }
        let grey = if self.format.is_grey() {
            line
        } else {
            kernels.luma_row(self.format, line, self.line);
            &*self.line
        };
        if let ([strip, ..], 1) = (&mut self.strips, self.count) {
            strip.push_moved(grey, offset_q4);
        }
        grey
    }

    /// Forgets the frame.
    pub(super) fn clear(&mut self) {
        for strip in &mut self.strips {
            strip.clear();
        }
    }

    /// The channels; none where only grey is asked for.
    #[must_use]
    pub fn strips(&self) -> &[Strip<'m>] {
        self.strips.get(..self.count).unwrap_or_default()
    }
}
