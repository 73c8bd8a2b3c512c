//! Faults: why a frame was dropped.

use core::fmt;

use crate::camera::ErrorKind;
use vgstereo_core::PushError;
use vgstereo_core::geometry::RawLineError;

/// Why a frame was dropped or synchronisation with the camera was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Fault {
    /// The camera reported an error of this kind.
    Camera(ErrorKind),
    /// The camera delivered another pair of lines than the expected one.
    Sequence,
    /// The rectifier refused the pair of lines.
    Rectifier(RawLineError),
    /// The matcher refused the pair of lines.
    Matcher(PushError),
    /// The sink reported an error.
    Sink,
    /// The user of the session changed what is done with frames.
    Stopped,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(kind) => kind.fmt(f),
            Self::Sequence => f.write_str("the camera delivered another line than the next"),
            Self::Rectifier(error) => error.fmt(f),
            Self::Matcher(error) => error.fmt(f),
            Self::Sink => f.write_str("the sink failed"),
            Self::Stopped => f.write_str("what is done with frames was changed"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn a_fault_says_what_failed() {
        for (fault, cause) in [
            (Fault::Camera(ErrorKind::Timeout), "time allowed"),
            (Fault::Sequence, "another line"),
            (Fault::Rectifier(RawLineError::NotTaken), "not taken"),
            (Fault::Matcher(PushError::TooManyLines), "too many lines"),
            (Fault::Sink, "sink"),
            (Fault::Stopped, "changed"),
        ] {
            let text = fault.to_string();
            assert!(text.contains(cause), "{text}");
        }
    }
}
