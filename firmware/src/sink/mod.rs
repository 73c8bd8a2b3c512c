//! Sinks: where lines of disparities go.

#[cfg(feature = "serial")]
pub mod serial;

use vgstereo_core::config::Region;
use vgstereo_core::matcher::DisparityLine;

use crate::fault::Fault;

/// A frame of disparities, as a sink is told of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameInfo {
    /// The camera's number of the frame.
    pub frame: u32,
    /// The camera's timestamp of line 0.
    pub timestamp_us: u64,
    /// The part of the reference view that has disparities: `height` lines of `width`
    /// columns come. It ends with the frame.
    pub region: Region,
}

/// Takes frames of disparities, line by line.
///
/// Calls come in this order: `begin_frame`; then `line` for each line of the region, from
/// the top; then `end_frame`. Every frame begun without error sees exactly one of
/// `end_frame` without error and `abort_frame`, and does so before the next one begins.
/// After an error the sink is called again, from the next frame's `begin_frame` on.
///
/// Calls come from within the time of a line: a sink that waits makes the camera lose
/// lines.
pub trait DisparitySink {
    /// What taking a line may fail with.
    type Error;

    /// A frame begins.
    ///
    /// # Errors
    /// The sink cannot take the frame; it counts as not begun.
    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// The next line of frame `frame`; [`INVALID`](vgstereo_core::disparity::INVALID) marks what is not known.
    ///
    /// # Errors
    /// The sink cannot take the line; the frame is then aborted.
    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error>;

    /// All lines of the frame were given; `info` is that of `begin_frame`.
    ///
    /// # Errors
    /// The sink cannot end the frame; the frame is then aborted.
    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// The frame begun last ends here, incomplete, because of `fault`. It cannot fail: a
    /// sink that cannot pass this on lets its receiver see a frame without an end.
    fn abort_frame(&mut self, frame: u32, fault: Fault);
}

impl<T: DisparitySink + ?Sized> DisparitySink for &mut T {
    type Error = T::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        (**self).begin_frame(info)
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        (**self).line(frame, line)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        (**self).end_frame(info)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        (**self).abort_frame(frame, fault);
    }
}
