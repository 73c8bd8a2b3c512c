//! Sinks of depths and points, and the adapter that makes them of disparities.

use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::{Depth, Point, RectifiedCamera};

use super::{DisparitySink, FrameInfo};
use crate::fault::Fault;

/// A line of what disparities were converted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvertedLine<'a, T> {
    /// Line of the frame, from 0.
    pub line: u32,
    /// Column of the frame that the first value belongs to.
    pub column: u16,
    /// The values from that column to the right: depths in mm, 0 for none, or points.
    pub values: &'a [T],
    /// The confidence of each value, as of [`DisparityLine::confidences`].
    pub confidences: &'a [u8],
}

/// A receiver of frames of depths (`u16`, mm) or of [`Point`]s, line by line. The calls come in the
/// order of those of [`DisparitySink`].
pub trait ConvertedSink<T> {
    /// Error of the sink.
    type Error;

    /// Begins a frame.
    ///
    /// # Errors
    /// The sink cannot take the frame, which then counts as not begun.
    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// Takes the next line of frame `frame`.
    ///
    /// # Errors
    /// The sink cannot take the line; the frame is then aborted.
    fn line(&mut self, frame: u32, line: &ConvertedLine<'_, T>) -> Result<(), Self::Error>;

    /// Ends the frame after its last line; `info` is that of `begin_frame`.
    ///
    /// # Errors
    /// The sink cannot end the frame; the frame is then aborted.
    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error>;

    /// Ends the frame begun last before it is complete, because of `fault`.
    fn abort_frame(&mut self, frame: u32, fault: Fault);
}

impl<T, S: ConvertedSink<T> + ?Sized> ConvertedSink<T> for &mut S {
    type Error = S::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        (**self).begin_frame(info)
    }

    fn line(&mut self, frame: u32, line: &ConvertedLine<'_, T>) -> Result<(), Self::Error> {
        (**self).line(frame, line)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        (**self).end_frame(info)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        (**self).abort_frame(frame, fault);
    }
}

/// A conversion of lines of disparities, pixel by pixel: [`Depth`] makes depths in mm,
/// [`RectifiedCamera`] makes [`Point`]s in mm.
pub trait Conversion {
    /// Type of the values that disparities are converted to: `u16` in mm, or [`Point`].
    type Value;

    /// Writes what the disparities of a line become; if there are more of them than values, of the
    /// first ones.
    fn convert(&self, line: &DisparityLine<'_>, values: &mut [Self::Value]);
}

impl Conversion for Depth {
    type Value = u16;

    fn convert(&self, line: &DisparityLine<'_>, values: &mut [u16]) {
        self.line_mm(line.disparities_q4, values);
    }
}

impl Conversion for RectifiedCamera {
    type Value = Point;

    fn convert(&self, line: &DisparityLine<'_>, values: &mut [Point]) {
        self.line_points(line.line, line.column, line.disparities_q4, values);
    }
}

/// Error of a [`ConvertingSink`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConversionError<E> {
    /// The lent memory has fewer values than the region has columns.
    Memory,
    /// Error of the sink behind.
    Sink(E),
}

/// A sink of disparities that passes on what they are converted to: depths with [`Depth`], points
/// with [`RectifiedCamera`].
#[derive(Debug)]
pub struct ConvertingSink<'m, C: Conversion, S> {
    conversion: C,
    sink: S,
    values: &'m mut [C::Value],
}

impl<'m, C: Conversion, S: ConvertedSink<C::Value>> ConvertingSink<'m, C, S> {
    /// Creates a sink before `sink`. `values` is memory for a line: one value for each column of the
    /// region.
    #[must_use]
    pub fn new(conversion: C, sink: S, values: &'m mut [C::Value]) -> Self {
        Self {
            conversion,
            sink,
            values,
        }
    }
}

impl<C: Conversion, S: ConvertedSink<C::Value>> DisparitySink for ConvertingSink<'_, C, S> {
    type Error = ConversionError<S::Error>;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        if self.values.len() < info.region.width.into() {
            return Err(ConversionError::Memory);
        }
        self.sink.begin_frame(info).map_err(ConversionError::Sink)
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        let values = self.values.get_mut(..line.disparities_q4.len());
        let values = values.ok_or(ConversionError::Memory)?;
        self.conversion.convert(line, values);
        let converted = ConvertedLine {
            line: line.line,
            column: line.column,
            values,
            confidences: line.confidences,
        };
        let taken = self.sink.line(frame, &converted);
        taken.map_err(ConversionError::Sink)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.sink.end_frame(info).map_err(ConversionError::Sink)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        self.sink.abort_frame(frame, fault);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;
    use vgstereo_core::{INVALID, Region};

    const INFO: FrameInfo = FrameInfo {
        frame: 3,
        timestamp_us: 5,
        region: Region {
            x: 7,
            y: 2,
            width: 3,
            height: 1,
        },
    };
    const LINE: DisparityLine<'_> = DisparityLine {
        line: 2,
        column: 7,
        disparities_q4: &[16, INVALID, 160],
        confidences: &[9, 0, 8],
    };

    /// Collects the lines and calls; refuses lines if it is told to.
    #[derive(Default)]
    struct Collector<T> {
        calls: Vec<&'static str>,
        values: Vec<T>,
        refuses: bool,
    }

    impl<T: Copy> ConvertedSink<T> for Collector<T> {
        type Error = ();

        fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), ()> {
            assert_eq!(*info, INFO);
            self.calls.push("begin");
            Ok(())
        }

        fn line(&mut self, frame: u32, line: &ConvertedLine<'_, T>) -> Result<(), ()> {
            assert_eq!((frame, line.line, line.column), (3, 2, 7));
            assert_eq!(line.confidences, [9, 0, 8]);
            self.calls.push("line");
            self.values.extend_from_slice(line.values);
            if self.refuses { Err(()) } else { Ok(()) }
        }

        fn end_frame(&mut self, info: &FrameInfo) -> Result<(), ()> {
            assert_eq!(*info, INFO);
            self.calls.push("end");
            Ok(())
        }

        fn abort_frame(&mut self, frame: u32, fault: Fault) {
            assert_eq!((frame, fault), (3, Fault::Sink));
            self.calls.push("abort");
        }
    }

    #[test]
    fn depths_and_points_are_passed_on() {
        // 100 px and 60 mm: 6 m at a disparity of 1 px.
        let depth = Depth::new(100 * 60 * 256, 0).unwrap();
        let mut collector = Collector::default();
        let mut values = [0; 4];
        let mut sink = ConvertingSink::new(depth, &mut collector, &mut values);
        sink.begin_frame(&INFO).unwrap();
        sink.line(3, &LINE).unwrap();
        sink.end_frame(&INFO).unwrap();
        sink.abort_frame(3, Fault::Sink);
        assert_eq!(collector.values, [6000, 0, 600]);
        assert_eq!(collector.calls, ["begin", "line", "end", "abort"]);

        let camera = RectifiedCamera::new(depth, 100 * 256, [5 * 256, 4 * 256]).unwrap();
        let mut collector = Collector::default();
        let mut values = [Point::NONE; 3];
        let mut sink = ConvertingSink::new(camera, &mut collector, &mut values);
        sink.begin_frame(&INFO).unwrap();
        sink.line(3, &LINE).unwrap();
        let point = |x_mm, y_mm, z_mm| Point { x_mm, y_mm, z_mm };
        let expected = [point(120, -120, 6000), Point::NONE, point(24, -12, 600)];
        assert_eq!(collector.values, expected);
    }

    #[test]
    fn too_little_memory_and_refusals_are_told() {
        let depth = Depth::new(256, 0).unwrap();
        let mut collector = Collector {
            refuses: true,
            ..Collector::default()
        };
        let mut values = vec![0; 2];
        let mut sink = ConvertingSink::new(depth, &mut collector, &mut values);
        assert_eq!(sink.begin_frame(&INFO), Err(ConversionError::Memory));
        assert_eq!(sink.line(3, &LINE), Err(ConversionError::Memory));
        let mut values = vec![0; 3];
        let mut sink = ConvertingSink::new(depth, &mut collector, &mut values);
        assert_eq!(sink.line(3, &LINE), Err(ConversionError::Sink(())));
    }
}
