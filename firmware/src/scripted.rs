//! Scripted faults: a camera that fails at given lines in given ways.
//!
//! It serves tests of the session and of code around it, on the host and on boards.

use core::fmt;
use core::str::FromStr;

use crate::camera::{Error, ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};

/// Fault at a pair of lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FaultKind {
    /// The pair is lost and an error of this kind reported.
    Error(ErrorKind),
    /// The pair is lost and no error reported.
    DroppedLine,
    /// The pair is delivered twice.
    DuplicatedLine,
    /// The pair and the rest of the frame are lost and [`ErrorKind::SyncLost`] reported.
    LostSync,
    /// The pair and the rest of the frame are lost and no error reported.
    Truncated,
    /// After the pair, the frame's pairs up to it are delivered again; at the last line,
    /// the whole frame is.
    DuplicatedFrame,
}

impl FaultKind {
    /// All kinds.
    pub const ALL: [Self; 12] = [
        Self::DroppedLine,
        Self::DuplicatedLine,
        Self::LostSync,
        Self::Truncated,
        Self::DuplicatedFrame,
        Self::Error(ErrorKind::Overrun),
        Self::Error(ErrorKind::SyncLost),
        Self::Error(ErrorKind::ShortLine),
        Self::Error(ErrorKind::ShortFrame),
        Self::Error(ErrorKind::Timeout),
        Self::Error(ErrorKind::Bus),
        Self::Error(ErrorKind::Other),
    ];

    /// Name of the kind in scripts.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::DroppedLine => "dropped-line",
            Self::DuplicatedLine => "duplicated-line",
            Self::LostSync => "lost-sync",
            Self::Truncated => "truncated",
            Self::DuplicatedFrame => "duplicated-frame",
            Self::Error(ErrorKind::Overrun) => "overrun",
            Self::Error(ErrorKind::SyncLost) => "sync-error",
            Self::Error(ErrorKind::ShortLine) => "short-line",
            Self::Error(ErrorKind::ShortFrame) => "short-frame",
            Self::Error(ErrorKind::Timeout) => "timeout",
            Self::Error(ErrorKind::Bus) => "bus-error",
            Self::Error(_) => "other-error",
        }
    }
}

/// One fault of a [`FaultyCamera`]'s script; as text, `FRAME:LINE:KIND`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ScriptedFault {
    /// Number of the frame in which it happens.
    pub frame: u32,
    /// Line at which it happens, from 0.
    pub line: u32,
    /// Kind of the fault.
    pub kind: FaultKind,
}

impl fmt::Display for ScriptedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.frame, self.line, self.kind.name())
    }
}

/// Error of parsing a text that is not a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotAFault;

impl fmt::Display for NotAFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a fault is FRAME:LINE:KIND, with one of these kinds: ")?;
        for (index, kind) in FaultKind::ALL.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{}", kind.name())?;
        }
        Ok(())
    }
}

impl core::error::Error for NotAFault {}

impl FromStr for ScriptedFault {
    type Err = NotAFault;

    fn from_str(text: &str) -> Result<Self, NotAFault> {
        let mut parts = text.splitn(3, ':');
        let mut part = || parts.next().ok_or(NotAFault);
        let frame = part()?.parse().map_err(|_| NotAFault)?;
        let line = part()?.parse().map_err(|_| NotAFault)?;
        let name = part()?;
        let mut kinds = FaultKind::ALL.into_iter();
        let kind = kinds.find(|kind| kind.name() == name).ok_or(NotAFault)?;
        Ok(Self { frame, line, kind })
    }
}

/// A camera that can deliver earlier pairs again.
pub trait Rewind {
    /// Goes back by `pairs` pairs, so that the last ones delivered are delivered again.
    fn rewind(&mut self, pairs: u32);
}

/// The error of a [`FaultyCamera`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultyError<E> {
    /// Error that the script asked for.
    Scripted(ErrorKind),
    /// Error of the wrapped camera.
    Camera(E),
}

impl<E: Error> Error for FaultyError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Scripted(kind) => *kind,
            Self::Camera(error) => error.kind(),
        }
    }
}

/// A wrapper that adds scripted faults to a camera.
///
/// Each fault happens once, when the wrapped camera delivers its pair. Pairs that are delivered
/// again cause no further faults.
#[derive(Debug, Clone)]
pub struct FaultyCamera<C, S> {
    camera: C,
    script: S,
    /// Number of the frame whose remaining pairs are lost.
    lost_frame: Option<u32>,
    /// Pairs lost since the last one delivered.
    dropped: u32,
    /// Whether a pair was delivered: those lost before the first are not told of.
    has_begun: bool,
    /// Number of pairs still to be delivered again.
    again: u32,
}

impl<C: LinePairSource + Rewind, S: AsRef<[ScriptedFault]>> FaultyCamera<C, S> {
    /// Wraps a camera. If several faults concern one pair, the first in the script applies.
    pub fn new(camera: C, script: S) -> Self {
        Self {
            camera,
            script,
            lost_frame: None,
            dropped: 0,
            has_begun: false,
            again: 0,
        }
    }

    /// Returns the wrapped camera.
    #[must_use]
    pub fn into_inner(self) -> C {
        self.camera
    }

    fn fault_at(&self, pair: &LinePair) -> Option<FaultKind> {
        // A pair that is lost already cannot fail again.
        if self.lost_frame == Some(pair.frame) {
            return None;
        }
        let mut script = self.script.as_ref().iter();
        let fault = script.find(|fault| fault.frame == pair.frame && fault.line == pair.line)?;
        Some(fault.kind)
    }

    fn repeat(&mut self, pairs: u32) {
        self.camera.rewind(pairs);
        self.again = pairs;
    }
}

impl<C: LinePairSource, S> ErrorType for FaultyCamera<C, S> {
    type Error = FaultyError<C::Error>;
}

impl<C: LinePairSource + Rewind, S: AsRef<[ScriptedFault]>> LinePairSource for FaultyCamera<C, S> {
    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, Self::Error> {
        loop {
            let pair = self.camera.read_pair(left, right);
            let mut pair = pair.map_err(FaultyError::Camera)?;
            if self.again > 0 {
                self.again -= 1;
                return Ok(LinePair { dropped: 0, ..pair });
            }
            self.dropped = self.dropped.saturating_add(pair.dropped);
            let fault = self.fault_at(&pair);
            match fault {
                Some(FaultKind::DuplicatedLine) => self.repeat(1),
                Some(FaultKind::DuplicatedFrame) => self.repeat(pair.line.saturating_add(1)),
                Some(FaultKind::LostSync | FaultKind::Truncated) => {
                    self.lost_frame = Some(pair.frame);
                }
                Some(FaultKind::Error(_) | FaultKind::DroppedLine) | None => {}
            }
            let lost = self.lost_frame == Some(pair.frame)
                || matches!(fault, Some(FaultKind::Error(_) | FaultKind::DroppedLine));
            if !lost {
                let dropped = core::mem::take(&mut self.dropped);
                pair.dropped = if self.has_begun { dropped } else { 0 };
                self.has_begun = true;
                return Ok(pair);
            }
            self.dropped = self.dropped.saturating_add(1);
            match fault {
                Some(FaultKind::Error(kind)) => return Err(FaultyError::Scripted(kind)),
                Some(FaultKind::LostSync) => {
                    return Err(FaultyError::Scripted(ErrorKind::SyncLost));
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn faults_are_read_as_they_are_written() {
        for kind in FaultKind::ALL {
            let (frame, line) = (7, 4_000_000_000);
            let fault = ScriptedFault { frame, line, kind };
            assert_eq!(fault.to_string().parse(), Ok(fault));
        }
        assert_eq!("1:2:overrun".parse::<ScriptedFault>().unwrap().line, 2);
        for text in [
            "",
            "1",
            "1:2",
            "1:2:",
            "1:-2:overrun",
            "1:2:overrun:3",
            "x:2:overrun",
        ] {
            assert_eq!(text.parse::<ScriptedFault>(), Err(NotAFault), "{text}");
        }
        assert!(NotAFault.to_string().ends_with("bus-error, other-error"));
    }
}
