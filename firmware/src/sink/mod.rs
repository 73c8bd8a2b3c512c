//! Sinks: receivers of the lines of disparities.
//!
//! A board implements [`DisparitySink`], or [`ConvertedSink`] behind a [`ConvertingSink`] for depths
//! or points, or [`ScanSink`] behind a [`ScanningSink`] for one laser scan a frame. [`BothSinks`]
//! joins two.

mod both;
mod convert;
mod scan;

pub use both::BothSinks;
pub use convert::{Conversion, ConversionError, ConvertedLine, ConvertedSink, ConvertingSink};
pub use scan::{ScanSink, ScanningSink};

use vgstereo_core::{DisparityLine, Line, Region};

use crate::camera::LinePair;
use crate::fault::Fault;

/// Description of a frame of disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameInfo {
    /// Number of the frame, as the camera counts.
    pub frame: u32,
    /// The camera's timestamp of line 0, µs.
    pub timestamp_us: u64,
    /// Part of the reference view that has disparities: `height` lines of `width` columns. It lies
    /// within the frame.
    pub region: Region,
}

/// What a sink needs of a frame; what it does not need is not computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// Rectified pairs of lines, if the session rectifies.
    pub rectified: bool,
    /// Disparities.
    pub disparities: bool,
}

impl Needs {
    /// Nothing.
    pub const NONE: Self = Self {
        rectified: false,
        disparities: false,
    };
    /// Disparities alone.
    pub const DISPARITIES: Self = Self {
        rectified: false,
        disparities: true,
    };

    /// What is needed by one of two.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self {
            rectified: self.rectified || other.rectified,
            disparities: self.disparities || other.disparities,
        }
    }
}

/// A receiver of frames of disparities, line by line.
///
/// The calls come in this order: `begin_frame`; then `line` for each line of the region, from the
/// top, if the sink [needs](Self::needs) them; then `end_frame`. Between, raw and rectified pairs come as
/// soon as they are there. For every frame that was begun without error, there is exactly one
/// successful `end_frame` or one `abort_frame`, before the next frame begins. After an error, the
/// sink is called again from the next frame's `begin_frame` on.
///
/// The calls are made within the time that the session has for a line: a sink that waits makes the
/// camera lose lines.
pub trait DisparitySink {
    /// Error of the sink.
    type Error;

    /// Begins a frame.
    ///
    /// # Errors
    /// The sink cannot take the frame, which then counts as not begun.
    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// What is needed of the frame that has just begun: by default, disparities alone.
    fn needs(&self) -> Needs {
        Needs::DISPARITIES
    }

    /// Takes a pair of lines as the camera delivered it, left and right, before it is matched. By
    /// default it is left alone.
    fn raw_pair(&mut self, pair: &LinePair, lines: [&[u8]; 2]) {
        let _ = (pair, lines);
    }

    /// Takes line `line` of the rectified views of frame `frame`, left and right, if such lines are
    /// [needed](Self::needs). By default it is left alone.
    fn rectified_pair(&mut self, frame: u32, line: u32, lines: [&dyn Line; 2]) {
        let _ = (frame, line, lines);
    }

    /// Takes the next line of frame `frame`. [`INVALID`](vgstereo_core::disparity::INVALID) marks
    /// pixels without a disparity.
    ///
    /// # Errors
    /// The sink cannot take the line; the frame is then aborted.
    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error>;

    /// Ends the frame after its last line; `info` is that of `begin_frame`.
    ///
    /// # Errors
    /// The sink cannot end the frame; the frame is then aborted.
    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// Ends the frame begun last before it is complete, because of `fault`. It cannot fail: if a
    /// sink cannot pass this on, its receiver sees a frame without an end.
    fn abort_frame(&mut self, frame: u32, fault: Fault);
}

impl<T: DisparitySink + ?Sized> DisparitySink for &mut T {
    type Error = T::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        (**self).begin_frame(info)
    }

    fn needs(&self) -> Needs {
        (**self).needs()
    }

    fn raw_pair(&mut self, pair: &LinePair, lines: [&[u8]; 2]) {
        (**self).raw_pair(pair, lines);
    }

    fn rectified_pair(&mut self, frame: u32, line: u32, lines: [&dyn Line; 2]) {
        (**self).rectified_pair(frame, line, lines);
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

/// Nothing takes everything and keeps nothing.
impl<T: DisparitySink> DisparitySink for Option<T> {
    type Error = T::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.as_mut().map_or(Ok(()), |sink| sink.begin_frame(info))
    }

    fn needs(&self) -> Needs {
        self.as_ref().map_or(Needs::NONE, DisparitySink::needs)
    }

    fn raw_pair(&mut self, pair: &LinePair, lines: [&[u8]; 2]) {
        if let Some(sink) = self {
            sink.raw_pair(pair, lines);
        }
    }

    fn rectified_pair(&mut self, frame: u32, line: u32, lines: [&dyn Line; 2]) {
        if let Some(sink) = self {
            sink.rectified_pair(frame, line, lines);
        }
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        self.as_mut().map_or(Ok(()), |sink| sink.line(frame, line))
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.as_mut().map_or(Ok(()), |sink| sink.end_frame(info))
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        if let Some(sink) = self {
            sink.abort_frame(frame, fault);
        }
    }
}
