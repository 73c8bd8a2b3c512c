//! A sink that makes a laser scan of each frame instead of passing its lines on.

use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::{LaserScan, Scan};

use super::{DisparitySink, FrameInfo};
use crate::fault::Fault;

/// A receiver of laser scans, one for each whole frame.
pub trait ScanSink {
    /// Error of the sink.
    type Error;

    /// Takes the scan of a frame.
    ///
    /// # Errors
    /// The sink cannot take it; the frame then counts as dropped.
    fn scan(&mut self, info: &FrameInfo, scan: &Scan<'_>) -> Result<(), Self::Error>;
}

impl<S: ScanSink + ?Sized> ScanSink for &mut S {
    type Error = S::Error;

    fn scan(&mut self, info: &FrameInfo, scan: &Scan<'_>) -> Result<(), Self::Error> {
        (**self).scan(info, scan)
    }
}

/// A sink of disparities that passes on one [`Scan`] a frame, when that ends. What was seen of a frame
/// that is aborted is forgotten.
#[derive(Debug)]
pub struct ScanningSink<'m, S> {
    scan: LaserScan<'m>,
    sink: S,
}

impl<'m, S: ScanSink> ScanningSink<'m, S> {
    /// Creates a sink before `sink`.
    #[must_use]
    pub fn new(scan: LaserScan<'m>, sink: S) -> Self {
        Self { scan, sink }
    }
}

impl<S: ScanSink> DisparitySink for ScanningSink<'_, S> {
    type Error = S::Error;

    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Self::Error> {
        self.scan.reset();
        Ok(())
    }

    fn line(&mut self, _: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        self.scan.push(line);
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.sink.scan(info, &self.scan.finish())
    }

    fn abort_frame(&mut self, _: u32, _: Fault) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;
    use vgstereo_core::Region;
    use vgstereo_core::geometry::{Depth, RectifiedCamera, ScanConfig};

    #[derive(Default)]
    struct Collector(Vec<(u32, Vec<u16>)>);

    impl ScanSink for Collector {
        type Error = ();

        fn scan(&mut self, info: &FrameInfo, scan: &Scan<'_>) -> Result<(), ()> {
            self.0.push((info.frame, scan.ranges_mm.to_vec()));
            Ok(())
        }
    }

    #[test]
    fn each_whole_frame_gives_its_own_scan() {
        // 100 px and 60 mm: 6 m at a disparity of 1 px.
        let depth = Depth::new(100 * 60 * 256, 0).unwrap();
        let config = ScanConfig {
            camera: RectifiedCamera::new(depth, 100 * 256, [0, 0]).unwrap(),
            columns: 0..1,
            bearings: 1,
            pitch_rad: 0.0,
            heights_mm: -100..=100,
            range_max_mm: 10_000,
            lines_min: 1,
            confidence_min: 1,
        };
        let mut memory = vec![0; LaserScan::words(1, 1)];
        let scan = LaserScan::new(&config, &mut memory).unwrap();
        let mut collector = Collector::default();
        let mut sink = ScanningSink::new(scan, &mut collector);
        let info = |frame| FrameInfo {
            frame,
            timestamp_us: 0,
            region: Region::whole(1),
        };
        let line = |px: &'static [i16]| DisparityLine {
            line: 0,
            column: 0,
            disparities_q4: px,
            confidences: &[1],
        };
        // The nearest is of a frame that was aborted.
        sink.begin_frame(&info(1)).unwrap();
        sink.line(1, &line(&[20 * 16])).unwrap();
        sink.abort_frame(1, Fault::Sequence);
        for (frame, disparities_q4) in [(2, &[6 * 16]), (3, &[2 * 16])] {
            sink.begin_frame(&info(frame)).unwrap();
            sink.line(frame, &line(disparities_q4)).unwrap();
            sink.end_frame(&info(frame)).unwrap();
        }
        assert_eq!(collector.0, [(2, vec![1000]), (3, vec![3000])]);
    }
}
