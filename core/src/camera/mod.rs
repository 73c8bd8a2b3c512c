//! Cameras: a source of numbered line pairs, and what the wire carries.
//!
//! Two sensors reach a chip in many ways: over two ports, side by side, line by line or
//! pixel by pixel. A driver hides which; [`Layout`] takes the raw bytes apart and
//! [`PixelFormat`] turns a line into grey. What is above a driver sees pairs of lines,
//! each with its number, or an error that says what went wrong.

mod format;
mod layout;

pub use format::PixelFormat;
pub use layout::Layout;

use core::convert::Infallible;
use core::fmt;

/// What a source of line pairs delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Geometry {
    /// Pixels of a line of one view.
    pub width: u16,
    /// Line pairs of a frame.
    pub height: u32,
    /// How a pixel is stored.
    pub format: PixelFormat,
}

impl Geometry {
    /// Bytes of a line of one view.
    #[must_use]
    pub const fn line_bytes(&self) -> usize {
        self.format.line_bytes(self.width)
    }
}

/// Names a pair of lines that was delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinePair {
    /// Frame since the source started; wraps from `u32::MAX` to 0. Every frame that the
    /// source knows to have begun takes a number, even if nothing of it is delivered.
    pub frame: u32,
    /// Line of the frame, from 0, below [`Geometry::height`].
    pub line: u32,
    /// When the pair was exposed or, if that is not known, received. Any origin, but
    /// monotonic while the source lives.
    pub timestamp_us: u64,
    /// Pairs known to be lost between the pair delivered last and this one, whether or
    /// not errors told of them in between; saturates. 0 for the first pair delivered.
    pub dropped: u32,
}

/// What went wrong in a source, whatever its own error says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ErrorKind {
    /// Pixels came faster than they were stored or lines faster than they were read.
    Overrun,
    /// The source no longer knows which line, or which view, the pixels belong to.
    SyncLost,
    /// A line ended before all its pixels had come.
    ShortLine,
    /// A frame ended before all its lines had come.
    ShortFrame,
    /// Nothing came in the time that the driver allows.
    Timeout,
    /// The interface or the bus to the sensor reports an error.
    Bus,
    /// Anything else.
    Other,
}

impl fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overrun => "pixels or lines came faster than they were taken",
            Self::SyncLost => "synchronisation with the camera is lost",
            Self::ShortLine => "a line ended before all its pixels had come",
            Self::ShortFrame => "a frame ended before all its lines had come",
            Self::Timeout => "the camera sent nothing in the time allowed",
            Self::Bus => "the camera's interface or bus reports an error",
            Self::Other => "the camera failed",
        })
    }
}

impl core::error::Error for ErrorKind {}

/// An error of a source, mapped to a kind that generic code can act on.
pub trait Error: fmt::Debug {
    /// The kind that fits best.
    fn kind(&self) -> ErrorKind;
}

impl Error for ErrorKind {
    fn kind(&self) -> ErrorKind {
        *self
    }
}

impl Error for Infallible {
    fn kind(&self) -> ErrorKind {
        match *self {}
    }
}

/// The error type of a source.
pub trait ErrorType {
    /// What reading a pair may fail with.
    type Error: Error;
}

impl<T: ErrorType + ?Sized> ErrorType for &mut T {
    type Error = T::Error;
}

/// A stereo camera that delivers pairs of lines, top to bottom, frame after frame.
///
/// # For driver authors
///
/// - **Every wait is bounded.** When no pair came in the time the driver allows, report
///   [`ErrorKind::Timeout`]. A frame period is ample; the gap between frames must fit.
/// - **Numbers come from the sync signals**, not from counting calls: a lost line leaves
///   a gap in [`LinePair::line`]. Each pair delivered is later than the one before, by
///   frame, then by line; none is delivered twice.
/// - **After an error, go on**: the next call delivers a later pair, or the next error.
///   Which one is yours to choose. If the line number is in doubt, wait for the next
///   frame and deliver its line 0. Restarting DMA and the like is the driver's affair.
/// - **One pair, one exposure**: both lines have the same number in both views. If only
///   one of the two came, neither is delivered.
/// - **Do not correct or repeat pixels.** A pair that is not whole is an error.
/// - Lines are rectified already or by a stage above; say which.
/// - The geometry does not change while the source lives.
/// - The time from a line's end to its overwriting is the caller's time for one line:
///   state it.
///
/// # For users
///
/// - On `Ok`, both buffers hold the whole line that the [`LinePair`] names.
/// - On `Err`, their content is unspecified. The source is still usable: call again.
/// - After an error, the next pair may be any later line, usually line 0 of the next
///   frame: check the number, always.
/// - An error may come at any time, and a gap in the numbers without one.
///
/// ```
/// use vgstereo_core::camera::{ErrorKind, ErrorType, Geometry, LinePair};
/// use vgstereo_core::camera::{LinePairSource, PixelFormat};
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
    /// What is delivered.
    fn geometry(&self) -> Geometry;

    /// Waits for the next pair of lines and writes it to the buffers, each of
    /// [`Geometry::line_bytes`]. The wait is bounded.
    ///
    /// # Errors
    /// What was lost; the buffers' content is then unspecified and the source goes on
    /// with a later pair. [`ErrorKind::Other`] if a buffer has another length.
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
    use std::string::ToString;

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

    #[test]
    fn kinds_tell_themselves_apart() {
        let kinds = [
            ErrorKind::Overrun,
            ErrorKind::SyncLost,
            ErrorKind::ShortLine,
            ErrorKind::ShortFrame,
            ErrorKind::Timeout,
            ErrorKind::Bus,
            ErrorKind::Other,
        ];
        for (i, a) in kinds.iter().enumerate() {
            assert_eq!(a.kind(), *a);
            for b in &kinds[..i] {
                assert_ne!(a.to_string(), b.to_string());
            }
        }
    }
}
