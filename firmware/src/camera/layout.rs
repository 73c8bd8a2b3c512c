//! Layouts: the order of the two views' pixels on the wire.

use vgstereo_core::kernel::PixelFormat;

use super::error::ErrorKind;

/// Order in which the raw bytes of a pair of lines hold its two lines.
///
/// For lines of `n` pixels, the table gives the raw pixel at which pixel `x` of each view is found:
///
/// | layout | left | right | raw pixels |
/// |---|---|---|---|
/// | `Separate`, `SideBySide`, `LineMultiplexed` | `x` | `n + x` | `2 n` |
/// | `PixelMultiplexed { phase: p }` | `p + 2 x` | `p + 2 x + 1` | `p + 2 n` |
///
/// A raw pixel is [`PixelFormat::bytes_per_pixel`] bytes. If a board sends the right view before
/// the left, exchange the two buffers that [`Layout::split`] fills.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Layout {
    /// Two ports with a sensor each. The raw bytes are those that the left port received, then
    /// those of the right port, as after two transfers into the halves of one buffer. Two transfers
    /// directly into the line buffers need no splitting.
    Separate,
    /// One raw line of twice the width: the whole left line, then the whole right line.
    SideBySide,
    /// Two raw lines, each with its own line sync: the left line, then the right one. In memory
    /// they are like [`Layout::SideBySide`].
    LineMultiplexed,
    /// One raw line of twice the width in which the two views alternate pixel by pixel.
    PixelMultiplexed {
        /// Number of raw pixels to skip before the first left one: 0 if even pixels are left and
        /// odd ones right; 1 if the multiplexer starts a pixel late, so that odd pixels are left;
        /// more for a camera that starts later still.
        phase: u8,
    },
}

impl Layout {
    /// Number of bytes on the wire per pair of lines of `width` pixels.
    #[must_use]
    pub const fn raw_bytes(self, format: PixelFormat, width: u16) -> usize {
        let skipped = match self {
            Self::PixelMultiplexed { phase } => phase as usize * format.bytes_per_pixel(),
            Self::Separate | Self::SideBySide | Self::LineMultiplexed => 0,
        };
        2 * format.line_bytes(width) + skipped
    }

    /// Number of raw lines, each with a line sync, that make a pair: the transfers that a driver
    /// starts per pair. The two of [`Layout::Separate`] run at the same time.
    #[must_use]
    pub const fn lines_per_pair(self) -> u8 {
        match self {
            Self::Separate | Self::LineMultiplexed => 2,
            Self::SideBySide | Self::PixelMultiplexed { .. } => 1,
        }
    }

    /// Splits the raw bytes of a pair into its two lines, whose length gives the width. Raw bytes
    /// beyond [`Layout::raw_bytes`], such as padding of a transfer, are ignored.
    ///
    /// # Errors
    /// [`ErrorKind::ShortLine`] if there are fewer raw bytes, or if `left` and `right` differ in
    /// length or end within a pixel; they are then unchanged.
    pub fn split(
        self,
        format: PixelFormat,
        raw: &[u8],
        left: &mut [u8],
        right: &mut [u8],
    ) -> Result<(), ErrorKind> {
        let bytes_per_pixel = format.bytes_per_pixel();
        let line_bytes = left.len();
        if right.len() != line_bytes || !line_bytes.is_multiple_of(bytes_per_pixel) {
            return Err(ErrorKind::ShortLine);
        }
        match self {
            Self::Separate | Self::SideBySide | Self::LineMultiplexed => {
                let halves = raw.split_at_checked(line_bytes);
                let (raw_left, rest) = halves.ok_or(ErrorKind::ShortLine)?;
                let raw_right = rest.get(..line_bytes).ok_or(ErrorKind::ShortLine)?;
                left.copy_from_slice(raw_left);
                right.copy_from_slice(raw_right);
                Ok(())
            }
            Self::PixelMultiplexed { phase } => {
                let skipped = usize::from(phase) * bytes_per_pixel;
                let raw = raw.get(skipped..).ok_or(ErrorKind::ShortLine)?;
                match bytes_per_pixel {
                    1 => split_pixels::<1>(raw, left, right),
                    2 => split_pixels::<2>(raw, left, right),
                    3 => split_pixels::<3>(raw, left, right),
                    _ => Err(ErrorKind::Other),
                }
            }
        }
    }
}

/// Splits alternating pixels of `N` bytes, the left one first.
fn split_pixels<const N: usize>(
    raw: &[u8],
    left: &mut [u8],
    right: &mut [u8],
) -> Result<(), ErrorKind> {
    let (pairs, _padding) = raw.as_chunks::<N>().0.as_chunks::<2>();
    let (left, right) = (left.as_chunks_mut::<N>().0, right.as_chunks_mut::<N>().0);
    let pairs = pairs.get(..left.len()).ok_or(ErrorKind::ShortLine)?;
    for ((pair, left), right) in pairs.iter().zip(left).zip(right) {
        [*left, *right] = *pair;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn layouts() -> impl Iterator<Item = Layout> {
        let phases = [0, 1, 2, 3, 255];
        let multiplexed = phases.map(|phase| Layout::PixelMultiplexed { phase });
        [
            Layout::Separate,
            Layout::SideBySide,
            Layout::LineMultiplexed,
        ]
        .into_iter()
        .chain(multiplexed)
    }

    /// Index of the raw byte for byte `byte` of pixel `x`, by the table of [`Layout`].
    fn raw_index(
        layout: Layout,
        bytes: usize,
        width: usize,
        x: usize,
        byte: usize,
        right: usize,
    ) -> usize {
        let pixel = match layout {
            Layout::PixelMultiplexed { phase } => usize::from(phase) + 2 * x + right,
            _ => right * width + x,
        };
        pixel * bytes + byte
    }

    #[test]
    fn splits_as_the_index_formula_says() {
        for layout in layouts() {
            for format in PixelFormat::ALL {
                let bytes = format.bytes_per_pixel();
                for width in [0u16, 1, 2, 3, 7, 8, 33, 320] {
                    let total = layout.raw_bytes(format, width);
                    // The modulus is prime, so that neighbouring lines and views differ.
                    let raw: Vec<u8> = (0..total).map(|i| u8::try_from(i % 251).unwrap()).collect();
                    let line_bytes = format.line_bytes(width);
                    let (mut left, mut right) = (vec![0; line_bytes], vec![0; line_bytes]);
                    layout.split(format, &raw, &mut left, &mut right).unwrap();
                    let width = usize::from(width);
                    for x in 0..width {
                        for byte in 0..bytes {
                            let index = |right| raw_index(layout, bytes, width, x, byte, right);
                            assert_eq!(left[x * bytes + byte], raw[index(0)], "{layout:?}");
                            assert_eq!(right[x * bytes + byte], raw[index(1)], "{layout:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn padding_is_ignored_and_a_byte_too_few_is_short() {
        for layout in layouts() {
            for format in PixelFormat::ALL {
                let total = layout.raw_bytes(format, 5);
                let mut raw = vec![3; total + 4];
                raw[total..].fill(9);
                let (mut left, mut right) = (vec![0; format.line_bytes(5)], vec![]);
                right.resize(left.len(), 0);
                layout.split(format, &raw, &mut left, &mut right).unwrap();
                assert!(left.iter().chain(&right).all(|&byte| byte == 3));

                left.fill(1);
                right.fill(1);
                for length in [0, 1, total - 1] {
                    assert_eq!(
                        layout.split(format, &raw[..length], &mut left, &mut right),
                        Err(ErrorKind::ShortLine)
                    );
                }
                assert!(left.iter().chain(&right).all(|&byte| byte == 1));
            }
        }
    }

    #[test]
    fn lines_of_unlike_length_or_broken_pixels_are_refused() {
        let raw = [0; 64];
        for layout in [Layout::SideBySide, Layout::PixelMultiplexed { phase: 0 }] {
            let (mut left, mut right) = ([1; 6], [1; 5]);
            let split = layout.split(PixelFormat::Grey8, &raw, &mut left, &mut right);
            assert_eq!(split, Err(ErrorKind::ShortLine));
            let (left, right) = (&mut left[..5], &mut right);
            let split = layout.split(PixelFormat::Rgb565, &raw, left, right);
            assert_eq!(split, Err(ErrorKind::ShortLine));
            assert_eq!((&*left, &*right), (&[1; 5][..], &[1; 5]));
        }
    }

    #[test]
    fn raw_lines_per_pair() {
        let lines: Vec<u8> = layouts().take(4).map(Layout::lines_per_pair).collect();
        assert_eq!(lines, [2, 1, 2, 1]);
    }
}
