//! Errors of cameras, mapped to kinds that generic code can act on.

use core::convert::Infallible;
use core::fmt;

/// Kind of an error of a source, for code that does not know the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ErrorKind {
    /// Pixels came faster than they were stored, or lines faster than they were read.
    Overrun,
    /// The source has lost track of the line, or of the view, to which pixels belong.
    SyncLost,
    /// A line ended before all of its pixels had come.
    ShortLine,
    /// A frame ended before all of its lines had come.
    ShortFrame,
    /// Nothing came within the time that the driver allows.
    Timeout,
    /// The interface or the bus to the sensor reported an error.
    Bus,
    /// Any other error.
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

/// An error of a source, with a kind for code that does not know the source.
pub trait Error: fmt::Debug {
    /// Returns the kind that fits best.
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

/// Error type of a source.
pub trait ErrorType {
    /// Error of reading a pair of lines.
    type Error: Error;
}

impl<T: ErrorType + ?Sized> ErrorType for &mut T {
    type Error = T::Error;
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

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
