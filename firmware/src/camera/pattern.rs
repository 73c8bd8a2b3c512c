//! A test pattern: pairs of lines that need no camera, with known disparities.

use vgstereo_core::kernel::PixelFormat;

use super::error::{ErrorKind, ErrorType};
use super::source::{Geometry, LinePair, LinePairSource};

/// Number of bands of one disparity each.
const BANDS: u32 = 8;

/// Smallest disparity, px, and the step from one band to the next.
const FIRST_PX: u16 = 2;
const STEP_PX: u16 = 3;

/// A camera that makes its lines itself: grey noise in blocks of 2 x 2 px, which moves 2 px to the left
/// from frame to frame. The lines are rectified. A frame has eight bands from top to bottom, each with
/// one disparity: 2 px in the first and 3 px more in each that follows, as far as a quarter of the width
/// goes ([`TestPattern::disparity_px`]).
///
/// It tells a fault of the camera from one of all that comes after.
#[derive(Debug, Clone)]
pub struct TestPattern {
    geometry: Geometry,
    /// Time of a pair, µs.
    clock: fn() -> u64,
    frame: u32,
    line: u32,
}

impl TestPattern {
    /// A pattern in lines of this geometry. `clock` gives the time, µs.
    #[must_use]
    pub const fn new(geometry: Geometry, clock: fn() -> u64) -> Self {
        Self {
            geometry,
            clock,
            frame: 0,
            line: 0,
        }
    }

    /// The disparity of line `line` of a frame, px: column `x` of the left view is column
    /// `x - disparity` of the right one.
    #[must_use]
    pub fn disparity_px(geometry: &Geometry, line: u32) -> u16 {
        let height = geometry.height.max(1);
        let line = line.min(height - 1);
        // Below 8, whatever the height.
        let band = (u64::from(line) * u64::from(BANDS) / u64::from(height)) as u16;
        (FIRST_PX + STEP_PX * band).min(geometry.width / 4)
    }

    /// Level of a column of the left view; columns to the right of it go on.
    fn level(&self, column: u32) -> u8 {
        let column = column.wrapping_add(self.frame.wrapping_mul(2));
        let mut hash =
            (column / 2).wrapping_mul(0x9e37_79b1) ^ (self.line / 2).wrapping_mul(0x85eb_ca6b);
        hash ^= hash >> 15;
        hash = hash.wrapping_mul(0x2c1b_3c6d);
        (hash >> 24) as u8
    }

    fn write(&self, shift_px: u16, bytes: &mut [u8]) {
        let format = self.geometry.format;
        let pixels = bytes.chunks_exact_mut(format.bytes_per_pixel());
        for (pixel, column) in pixels.zip(u32::from(shift_px)..) {
            let level = self.level(column);
            match pixel {
                [luma, chroma] if format == PixelFormat::Yuv422 => [*luma, *chroma] = [level, 128],
                // Five, six and five bits of one level, the high byte first.
                [high, low] => {
                    let [red, green] = [level >> 3, level >> 2];
                    *high = red << 3 | green >> 3;
                    *low = green << 5 | red;
                }
                components => components.fill(level),
            }
        }
    }
}

impl ErrorType for TestPattern {
    type Error = ErrorKind;
}

impl LinePairSource for TestPattern {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let line_bytes = self.geometry.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Err(ErrorKind::Other);
        }
        self.write(0, left);
        self.write(Self::disparity_px(&self.geometry, self.line), right);
        let pair = LinePair {
            frame: self.frame,
            line: self.line,
            timestamp_us: (self.clock)(),
            dropped: 0,
        };
        self.line += 1;
        if self.line >= self.geometry.height {
            self.line = 0;
            self.frame = self.frame.wrapping_add(1);
        }
        Ok(pair)
    }
}

/// A camera, or a [`TestPattern`] in its place. Frames are numbered as the camera does until the first
/// change; after each, they go on with the next number.
#[derive(Debug)]
pub struct OrTestPattern<C> {
    camera: C,
    pattern: TestPattern,
    is_pattern: bool,
    /// What is added to the number of a frame; `None` until the first pair after a change.
    offset: Option<u32>,
    /// Number of the frame of the pair that was delivered last.
    last_frame: u32,
}

impl<C: LinePairSource> OrTestPattern<C> {
    /// The camera, until the pattern is asked for. `clock` gives the time, µs.
    #[must_use]
    pub fn new(camera: C, clock: fn() -> u64) -> Self {
        Self {
            pattern: TestPattern::new(camera.geometry(), clock),
            camera,
            is_pattern: false,
            offset: Some(0),
            last_frame: 0,
        }
    }

    /// Delivers the pattern, from its line 0 on, or the camera's lines.
    pub fn show_pattern(&mut self, is_pattern: bool) {
        if is_pattern != self.is_pattern {
            self.pattern.line = 0;
            self.is_pattern = is_pattern;
            self.offset = None;
        }
    }
}

impl<C: LinePairSource> ErrorType for OrTestPattern<C> {
    type Error = ErrorKind;
}

impl<C: LinePairSource> LinePairSource for OrTestPattern<C> {
    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let mut pair = if self.is_pattern {
            self.pattern.read_pair(left, right)?
        } else {
            let pair = self.camera.read_pair(left, right);
            pair.map_err(|error| super::Error::kind(&error))?
        };
        let next = self.last_frame.wrapping_add(1);
        let offset = self.offset.get_or_insert(next.wrapping_sub(pair.frame));
        pair.frame = pair.frame.wrapping_add(*offset);
        self.last_frame = pair.frame;
        Ok(pair)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;
    use vgstereo_core::kernel::luma_row;

    fn geometry(format: PixelFormat) -> Geometry {
        Geometry {
            width: 65,
            height: 17,
            format,
        }
    }

    /// Reads so many pairs, as rows of grey.
    fn rows(format: PixelFormat, pairs: u32) -> Vec<(LinePair, [Vec<u8>; 2])> {
        let geometry = geometry(format);
        let mut pattern = TestPattern::new(geometry, || 7);
        let read = |_| {
            let mut lines = [
                vec![0; geometry.line_bytes()],
                vec![0; geometry.line_bytes()],
            ];
            let [left, right] = &mut lines;
            let pair = pattern.read_pair(left, right).unwrap();
            let grey = lines.map(|line| {
                let mut row = vec![0; 65];
                luma_row(format, &line, &mut row);
                row
            });
            (pair, grey)
        };
        (0..pairs).map(read).collect()
    }

    #[test]
    fn both_views_show_one_texture_at_the_stated_disparity() {
        for format in PixelFormat::ALL {
            let mut disparities_px = vec![];
            for (pair, [left, right]) in rows(format, 34) {
                let px = TestPattern::disparity_px(&geometry(format), pair.line);
                let px = usize::from(px);
                assert_eq!(
                    left[px..],
                    right[..65 - px],
                    "{format:?} line {}",
                    pair.line
                );
                let levels: std::collections::BTreeSet<u8> = left.into_iter().collect();
                assert!(levels.len() > 12, "{format:?} is flat");
                disparities_px.push(px);
            }
            disparities_px.truncate(17);
            disparities_px.dedup();
            // A quarter of the width is 16 px.
            assert_eq!(disparities_px, [2, 5, 8, 11, 14, 16]);
        }
    }

    #[test]
    fn frames_follow_each_other_and_move() {
        let rows = rows(PixelFormat::Grey8, 40);
        for (at, (pair, _)) in (0..).zip(&rows) {
            assert_eq!((pair.frame, pair.line), (at / 17, at % 17));
        }
        let [first, second] = [0, 17].map(|at: usize| &rows[at].1[0]);
        assert_eq!(first[2..], second[..63]);
        assert_ne!(first, second);
    }

    #[test]
    fn numbers_go_on_from_camera_to_pattern_and_back() {
        let geometry = geometry(PixelFormat::Grey8);
        let camera = TestPattern::new(geometry, || 7);
        let mut either = OrTestPattern::new(camera, || 7);
        let (mut left, mut right) = ([0; 65], [0; 65]);
        let mut number = |either: &mut OrTestPattern<_>| {
            let pair = either.read_pair(&mut left, &mut right).unwrap();
            (pair.frame, pair.line)
        };
        let mut expected = 0;
        for frames in [2, 1, 1, 3] {
            for at in 0..frames * 17 {
                assert_eq!(number(&mut either), (expected + at / 17, at % 17));
            }
            expected += frames;
            let is_pattern = either.is_pattern;
            either.show_pattern(is_pattern);
            either.show_pattern(!is_pattern);
        }
    }

    #[test]
    fn no_geometry_and_no_line_break_it() {
        for (width, height) in [(0, 0), (1, 1), (3, u32::MAX), (u16::MAX, 2)] {
            let geometry = Geometry {
                width,
                height,
                format: PixelFormat::Grey8,
            };
            for line in [0, 1, height, u32::MAX] {
                assert!(TestPattern::disparity_px(&geometry, line) <= width / 4);
            }
        }
    }
}
