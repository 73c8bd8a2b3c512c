//! Conversion of a camera's bytes to the lines that the matcher takes.

use vgstereo_core::Line;
use vgstereo_core::kernel::{Kernels, PixelFormat};

/// A line of one view as a camera stores it. The kernels of a set convert it to rows of grey and
/// of colour, directly where the matcher keeps them.
///
/// ```
/// use vgstereo_core::{Line, Portable};
/// use vgstereo_firmware::camera::{PixelFormat, RawLine};
///
/// let line = RawLine::new(PixelFormat::Rgb888, &[10, 20, 30, 255, 255, 255], Portable);
/// assert_eq!((line.width(), line.has_colour()), (2, true));
/// let mut row = [0; 2];
/// line.write_channel(1, &mut row);
/// assert_eq!(row, [20, 255]);
/// line.write_grey(&mut row);
/// assert_eq!(row, [18, 255]);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct RawLine<'a, K> {
    format: PixelFormat,
    bytes: &'a [u8],
    kernels: K,
}

impl<'a, K: Kernels> RawLine<'a, K> {
    /// Creates a line from the bytes of its pixels, one after another without gaps. A line that
    /// ends within a pixel has a width of 0, which every matcher refuses.
    #[must_use]
    pub const fn new(format: PixelFormat, bytes: &'a [u8], kernels: K) -> Self {
        Self {
            format,
            bytes,
            kernels,
        }
    }
}

impl<K: Kernels> Line for RawLine<'_, K> {
    #[inline]
    fn width(&self) -> usize {
        let bytes_per_pixel = self.format.bytes_per_pixel();
        if self.bytes.len().is_multiple_of(bytes_per_pixel) {
            self.bytes.len() / bytes_per_pixel
        } else {
            0
        }
    }

    #[inline]
    fn has_colour(&self) -> bool {
        !self.format.is_grey()
    }

    #[inline]
    fn write_grey(&self, row: &mut [u8]) {
        if self.format.is_grey() && row.len() == self.bytes.len() {
            row.copy_from_slice(self.bytes);
        } else {
            self.kernels.luma_row(self.format, self.bytes, row);
        }
    }

    #[inline]
    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        self.kernels
            .channel_row(self.format, self.bytes, channel, row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::Portable;

    #[test]
    fn a_line_that_ends_amid_a_pixel_has_no_width() {
        for format in PixelFormat::ALL {
            let bytes = [7; 12];
            let bytes_per_pixel = format.bytes_per_pixel();
            let whole = RawLine::new(format, &bytes, Portable);
            assert_eq!(whole.width(), 12 / bytes_per_pixel);
            let cut = RawLine::new(format, &bytes[..11], Portable);
            assert_eq!(cut.width(), if bytes_per_pixel == 1 { 11 } else { 0 });
        }
    }
}
