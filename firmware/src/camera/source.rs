//! Camera trait: a source of numbered pairs of lines.

use vgstereo_core::kernel::PixelFormat;

use super::error::ErrorType;

/// Size and pixel format of the lines that a source delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Geometry {
    /// Number of columns of one view, px.
    pub width: u16,
    /// Number of line pairs per frame.
    pub height: u32,
    /// Pixel format of the lines.
    pub format: PixelFormat,
}

impl Geometry {
    /// Number of bytes in a line of one view.
    #[must_use]
    pub const fn line_bytes(&self) -> usize {
        self.format.line_bytes(self.width)
    }
}

/// Number and time of a delivered pair of lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinePair {
    /// Number of the frame since the source started; wraps from `u32::MAX` to 0. Every frame that
    /// the source knows to have begun is counted, even if none of its pairs is delivered.
    pub frame: u32,
    /// Number of the line in the frame, from 0, below [`Geometry::height`].
    pub line: u32,
    /// Time at which the pair was exposed or, if that is not known, received, µs. The origin is
    /// arbitrary; the time never decreases while the source lives.
    pub timestamp_us: u64,
    /// Number of pairs known to be lost between the pair delivered before and this one, whether or
    /// not errors reported them; saturates. 0 for the first pair delivered.
    pub dropped: u32,
}

/// A stereo camera that delivers pairs of lines, top to bottom, frame after frame.
///
/// # For driver authors
///
/// - **Every wait is bounded.** If no pair comes within the time that the driver allows, report
///   [`ErrorKind::Timeout`](super::ErrorKind::Timeout). A frame period is ample; the time must be longer than the gap
///   between frames.
/// - **Numbers come from the sync signals**, not from counting calls: a lost line leaves
///   a gap in [`LinePair::line`]. Each pair delivered is later than the one before, by
///   frame, then by line; none is delivered twice.
/// - **After an error, go on**: the next call delivers a later pair, or the next error.
///   The driver chooses how much to skip. If the line number is in doubt, wait for the next
///   frame and deliver its line 0. Restarting DMA and the like is up to the driver.
/// - **One pair, one exposure**: the two lines have the same number in their views. If only
///   one of the two came, neither is delivered.
/// - **Do not correct or repeat pixels.** A pair that is not whole is an error.
/// - Document whether the lines are rectified, or must be rectified by the caller.
/// - The geometry does not change while the source lives.
/// - Document the time from the end of a line until it is overwritten, because the caller must
///   process a line within it.
///
/// # For users
///
/// - On `Ok`, both buffers hold the whole line that the [`LinePair`] names.
/// - On `Err`, their content is unspecified. The source is still usable: call again.
/// - After an error, the next pair may be any later line, usually line 0 of the next
///   frame: always check the number.
/// - An error may come at any time, and so may a gap in the numbers without an error.
///
/// ```
/// use vgstereo_firmware::camera::{ErrorKind, ErrorType, Geometry, LinePair};
/// use vgstereo_firmware::camera::{LinePairSource, PixelFormat};
///
/// /// A test pattern: vertical bars, 3 px further left in the right view.
/// struct Bars {
///     pairs: u32,
/// }
///
/// impl ErrorType for Bars {
///     type Error = ErrorKind;
/// }
///
/// impl LinePairSource for Bars {
///     fn geometry(&self) -> Geometry {
///         Geometry { width: 64, height: 16, format: PixelFormat::Grey8 }
///     }
///
///     fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
///         for (x, (left, right)) in (0u8..64).zip(left.iter_mut().zip(right)) {
///             *left = (x & 8) * 16;
///             *right = ((x + 3) & 8) * 16;
///         }
///         let (frame, line) = (self.pairs >> 4, self.pairs & 15);
///         self.pairs = self.pairs.wrapping_add(1);
///         Ok(LinePair { frame, line, timestamp_us: 0, dropped: 0 })
///     }
/// }
///
/// let (mut left, mut right) = ([0; 64], [0; 64]);
/// let pair = Bars { pairs: 17 }.read_pair(&mut left, &mut right)?;
/// assert_eq!((pair.frame, pair.line), (1, 1));
/// assert_eq!(left[3..], right[..61]);
/// # Ok::<(), ErrorKind>(())
/// ```
pub trait LinePairSource: ErrorType {
    /// Size and pixel format of the lines.
    fn geometry(&self) -> Geometry;

    /// Waits, for a bounded time, for the next pair of lines and writes it to the buffers, each of
    /// [`Geometry::line_bytes`].
    ///
    /// # Errors
    /// The reason for which a pair was lost. The content of the buffers is then unspecified, and
    /// the source goes on with a later pair. [`ErrorKind::Other`](super::ErrorKind::Other) if a buffer has the wrong length.
    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, Self::Error>;
}

impl<T: LinePairSource + ?Sized> LinePairSource for &mut T {
    fn geometry(&self) -> Geometry {
        (**self).geometry()
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, Self::Error> {
        (**self).read_pair(left, right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Error, ErrorKind};

    struct Failing;

    impl ErrorType for Failing {
        type Error = ErrorKind;
    }

    impl LinePairSource for Failing {
        fn geometry(&self) -> Geometry {
            Geometry {
                width: 3,
                height: 2,
                format: PixelFormat::Rgb888,
            }
        }

        fn read_pair(&mut self, _: &mut [u8], _: &mut [u8]) -> Result<LinePair, ErrorKind> {
            Err(ErrorKind::Bus)
        }
    }

    #[test]
    fn a_borrowed_source_is_a_source() {
        fn kind<C: LinePairSource>(mut source: C) -> ErrorKind {
            assert_eq!(source.geometry().line_bytes(), 9);
            source.read_pair(&mut [], &mut []).unwrap_err().kind()
        }
        let mut source = Failing;
        assert_eq!(kind(&mut source), ErrorKind::Bus);
        assert_eq!(
            kind(&mut source as &mut dyn LinePairSource<Error = ErrorKind>),
            ErrorKind::Bus
        );
    }
}
