//! Events: what became of one read of the camera.

use crate::fault::Fault;

/// Outcome of one read of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Event {
    /// The pair of lines was the expected one and was taken: matched, if the sink asks for disparities.
    Line {
        /// The camera's number of the frame that the pair belongs to.
        frame: u32,
        /// Number of the line within its frame, counted from 0 at the top.
        line: u32,
    },
    /// The pair of lines was the last of its frame, and the sink has taken all disparities
    /// of the frame. In frames of a single line this event also stands for
    /// [`Event::Resync`].
    FrameDone {
        /// The camera's number of the frame that is done.
        frame: u32,
    },
    /// The pair of lines was not the expected one but the first of a later frame, which
    /// has begun with it. The frame that was being read, if any, is dropped.
    Resync {
        /// The camera's number of the frame that has begun.
        frame: u32,
    },
    /// The pair of lines was left out: its frame is already dropped or did not begin with
    /// line 0.
    Skipped {
        /// The camera's number of the frame that the pair belongs to.
        frame: u32,
        /// Number of the line within its frame, counted from 0 at the top.
        line: u32,
    },
    /// The read brought no pair of lines, or one of no use. The frame that was being read,
    /// if any, is dropped.
    Fault(Fault),
}
