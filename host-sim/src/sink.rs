//! A sink that collects whole frames of disparities. The host has the memory for them.

use vgstereo_core::DisparityLine;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};

/// A whole frame of disparities with their confidences. Both are row-major without gaps:
/// `info.region.height` lines of `info.region.width` columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DisparityFrame {
    /// The number and the time of the frame, and the region of the reference view that has
    /// disparities.
    pub info: FrameInfo,
    /// The disparity of each pixel of the region, 1/16 px;
    /// [`INVALID`](vgstereo_core::disparity::INVALID) where none is known.
    pub disparities_q4: Vec<i16>,
    /// The confidence of each disparity, 0 to 255; 0 where it was filled in or is not known.
    pub confidences: Vec<u8>,
}

/// The error of a [`FrameCollector`]: a call does not continue the frame that is being
/// collected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnexpectedLine;

impl std::fmt::Display for UnexpectedLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the line is not the next one of the frame that is being collected")
    }
}

impl std::error::Error for UnexpectedLine {}

/// A sink that collects the lines of frames, and keeps the last whole frame.
#[derive(Debug, Clone, Default)]
pub struct FrameCollector {
    partial: Option<DisparityFrame>,
    whole: Option<DisparityFrame>,
    aborted: Vec<(u32, Fault)>,
}

impl FrameCollector {
    /// Returns a collector that has not seen any frame.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the last whole frame; `None` if there was none, or if it was taken.
    #[must_use]
    pub fn frame(&self) -> Option<&DisparityFrame> {
        self.whole.as_ref()
    }

    /// Removes the last whole frame from the collector and returns it.
    pub fn take_frame(&mut self) -> Option<DisparityFrame> {
        self.whole.take()
    }

    /// Returns the numbers of the frames that were aborted, each with its fault, in the order
    /// in which this happened.
    #[must_use]
    pub fn aborted(&self) -> &[(u32, Fault)] {
        &self.aborted
    }
}

impl DisparitySink for FrameCollector {
    type Error = UnexpectedLine;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), UnexpectedLine> {
        if self.partial.is_some() {
            return Err(UnexpectedLine);
        }
        self.partial = Some(DisparityFrame {
            info: *info,
            disparities_q4: Vec::new(),
            confidences: Vec::new(),
        });
        Ok(())
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), UnexpectedLine> {
        let partial = self.partial.as_mut().ok_or(UnexpectedLine)?;
        let region = &partial.info.region;
        let columns = usize::from(region.width);
        let lines = u64::try_from(partial.disparities_q4.len() / columns).unwrap_or(u64::MAX);
        let is_next = frame == partial.info.frame
            && u64::from(line.line) == u64::from(region.y) + lines
            && lines < u64::from(region.height)
            && (line.column, line.disparities_q4.len()) == (region.x, columns)
            && line.confidences.len() == columns;
        if !is_next {
            return Err(UnexpectedLine);
        }
        partial
            .disparities_q4
            .extend_from_slice(line.disparities_q4);
        partial.confidences.extend_from_slice(line.confidences);
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), UnexpectedLine> {
        let region = &info.region;
        let pixels = u64::from(region.width) * u64::from(region.height);
        let is_whole = |partial: &DisparityFrame| {
            partial.info == *info && u64::try_from(partial.disparities_q4.len()) == Ok(pixels)
        };
        if !self.partial.as_ref().is_some_and(is_whole) {
            return Err(UnexpectedLine);
        }
        self.whole = self.partial.take();
        Ok(())
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        self.partial = None;
        self.aborted.push((frame, fault));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::{INVALID, Region};

    const INFO: FrameInfo = FrameInfo {
        frame: 7,
        timestamp_us: 99,
        region: Region {
            x: 2,
            y: 1,
            width: 3,
            height: 2,
        },
    };

    fn line(line: u32, disparities_q4: &[i16]) -> DisparityLine<'_> {
        DisparityLine {
            line,
            column: 2,
            disparities_q4,
            confidences: &[7, 0, 255],
        }
    }

    #[test]
    fn collects_a_region() {
        let mut collector = FrameCollector::new();
        collector.begin_frame(&INFO).unwrap();
        collector.line(7, &line(1, &[16, 32, INVALID])).unwrap();
        collector.line(7, &line(2, &[0, -16, 1])).unwrap();
        assert_eq!(collector.frame(), None);
        collector.end_frame(&INFO).unwrap();
        let frame = collector.take_frame().unwrap();
        assert_eq!(frame.info, INFO);
        assert_eq!(frame.disparities_q4, [16, 32, INVALID, 0, -16, 1]);
        assert_eq!(frame.confidences, [7, 0, 255, 7, 0, 255]);
    }

    #[test]
    fn refuses_what_is_not_next() {
        let mut collector = FrameCollector::new();
        assert!(collector.line(7, &line(1, &[0; 3])).is_err(), "no frame");
        assert!(collector.end_frame(&INFO).is_err(), "no frame");
        collector.begin_frame(&INFO).unwrap();
        assert!(collector.begin_frame(&INFO).is_err(), "twice");
        assert!(collector.line(8, &line(1, &[0; 3])).is_err(), "frame");
        assert!(collector.line(7, &line(2, &[0; 3])).is_err(), "line");
        assert!(collector.line(7, &line(1, &[0; 4])).is_err(), "width");
        let without_confidences = DisparityLine {
            confidences: &[],
            ..line(1, &[0; 3])
        };
        assert!(
            collector.line(7, &without_confidences).is_err(),
            "confidences"
        );
        assert!(collector.end_frame(&INFO).is_err(), "lines to come");
        for number in [1, 2] {
            collector.line(7, &line(number, &[0; 3])).unwrap();
        }
        assert!(collector.line(7, &line(3, &[0; 3])).is_err(), "height");
    }

    #[test]
    fn an_aborted_frame_leaves_the_last_whole_one() {
        let mut collector = FrameCollector::new();
        collector.begin_frame(&INFO).unwrap();
        for number in [1, 2] {
            collector.line(7, &line(number, &[5; 3])).unwrap();
        }
        collector.end_frame(&INFO).unwrap();
        let next = FrameInfo { frame: 8, ..INFO };
        collector.begin_frame(&next).unwrap();
        collector.line(8, &line(1, &[6; 3])).unwrap();
        collector.abort_frame(8, Fault::Sequence);
        assert_eq!(collector.aborted(), [(8, Fault::Sequence)]);
        assert_eq!(collector.frame().unwrap().info.frame, 7);
    }
}
