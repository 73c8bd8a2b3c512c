//! Lines: the input of the matcher.

use core::ops::Range;

use super::copy::copy_common;

/// One line of one view, which converts itself to rows of levels.
///
/// Rows are written directly where the pipeline keeps them, so that a line in a camera's pixel
/// format needs no buffer between. A row of grey, `&[u8]`, is a line; so is [`ColourRows`]. The
/// crate `vgstereo-firmware` has lines for cameras' pixel formats.
pub trait Line {
    /// Number of pixels.
    fn width(&self) -> usize;

    /// The columns that the camera saw, one run of them. What a rectified line has beyond is
    /// made up: nothing is matched there, and nothing found. All columns, unless a line says
    /// otherwise.
    fn valid_columns(&self) -> Range<usize> {
        0..self.width()
    }

    /// Whether [`Line::write_channel`] writes more than the grey levels.
    fn has_colour(&self) -> bool;

    /// Writes the grey level of each pixel, 0 black to 255 white, from the left. `row` has
    /// [`Line::width`] elements.
    fn write_grey(&self, row: &mut [u8]);

    /// Writes the level of one channel of each pixel: 0 is red, 1 green, 2 blue. `row` has
    /// [`Line::width`] elements.
    fn write_channel(&self, channel: usize, row: &mut [u8]);
}

impl Line for [u8] {
    fn width(&self) -> usize {
        self.len()
    }

    fn has_colour(&self) -> bool {
        false
    }

    #[inline]
    fn write_grey(&self, row: &mut [u8]) {
        copy_common(row, self);
    }

    fn write_channel(&self, _: usize, row: &mut [u8]) {
        self.write_grey(row);
    }
}

impl<const N: usize> Line for [u8; N] {
    fn width(&self) -> usize {
        N
    }

    fn has_colour(&self) -> bool {
        self[..].has_colour()
    }

    #[inline]
    fn write_grey(&self, row: &mut [u8]) {
        self[..].write_grey(row);
    }

    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        self[..].write_channel(channel, row);
    }
}

impl<T: Line + ?Sized> Line for &T {
    fn width(&self) -> usize {
        (**self).width()
    }

    fn valid_columns(&self) -> Range<usize> {
        (**self).valid_columns()
    }

    fn has_colour(&self) -> bool {
        (**self).has_colour()
    }

    #[inline]
    fn write_grey(&self, row: &mut [u8]) {
        (**self).write_grey(row);
    }

    #[inline]
    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        (**self).write_channel(channel, row);
    }
}

/// A line in colour whose levels are already in rows, one level per pixel in each.
#[derive(Debug, Clone, Copy)]
pub struct ColourRows<'a> {
    /// Grey levels.
    pub grey: &'a [u8],
    /// Red, green and blue levels, as many as there are grey ones.
    pub channels: [&'a [u8]; 3],
}

impl Line for ColourRows<'_> {
    fn width(&self) -> usize {
        // A line is as wide as its narrowest row.
        let rows = self.channels.iter();
        rows.fold(self.grey.len(), |width, row| width.min(row.len()))
    }

    fn has_colour(&self) -> bool {
        true
    }

    #[inline]
    fn write_grey(&self, row: &mut [u8]) {
        copy_common(row, self.grey);
    }

    #[inline]
    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        copy_common(row, self.channels.get(channel).copied().unwrap_or_default());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_write_their_rows() {
        let grey = [1, 2, 3];
        let line = ColourRows {
            grey: &grey,
            channels: [&[4, 5, 6], &[7, 8, 9], &[10, 11]],
        };
        assert_eq!((line.width(), line.has_colour()), (2, true));
        let mut row = [0; 2];
        line.write_grey(&mut row);
        assert_eq!(row, [1, 2]);
        for (channel, expected) in [(0, [4, 5]), (1, [7, 8]), (2, [10, 11]), (3, [10, 11])] {
            line.write_channel(channel, &mut row);
            assert_eq!(row, expected);
        }
        let line: &dyn Line = &&grey[..];
        assert_eq!((line.width(), line.has_colour()), (3, false));
        line.write_channel(2, &mut row);
        assert_eq!(row, [1, 2]);
    }
}
