//! A simulated stereo camera, which sends an image pair over a simulated wire.

use image::{DynamicImage, RgbImage};
use vgstereo_core::kernel::luma_row;
use vgstereo_firmware::camera::{
    ErrorKind, ErrorType, Geometry, Layout, LinePair, LinePairSource, PixelFormat,
};
use vgstereo_firmware::scripted::Rewind;

/// The time from one pair of lines of [`SimulatedCamera`] to the next, us. With 480 lines these
/// are about 30 frames per second.
pub const LINE_PERIOD_US: u64 = 69;

/// The reasons for which [`SimulatedCamera::new`] refuses images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CameraError {
    /// The two views differ in size.
    Sizes {
        /// Width and height of the left view, px.
        left: (u32, u32),
        /// Width and height of the right view, px.
        right: (u32, u32),
    },
    /// The views are empty or wider than 65535 px.
    Size,
    /// This pixel format is not simulated.
    Format(PixelFormat),
}

impl std::fmt::Display for CameraError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Sizes { left, right } => write!(
                f,
                "the views differ in size: {} x {} and {} x {}",
                left.0, left.1, right.0, right.1
            ),
            Self::Size => f.write_str("the views are empty or wider than 65535 pixels"),
            Self::Format(format) => write!(f, "{format:?} is not simulated"),
        }
    }
}

impl std::error::Error for CameraError {}

/// A stereo camera that sends one image pair as every frame.
///
/// Each pair of lines goes over a simulated wire: it is encoded, merged to raw bytes, and then
/// taken apart by [`Layout::split`] as a driver does. Frames are numbered from 0. Pairs of lines
/// are [`LINE_PERIOD_US`] apart, without a gap between frames.
#[derive(Debug, Clone)]
pub struct SimulatedCamera {
    left: RgbImage,
    right: RgbImage,
    layout: Layout,
    geometry: Geometry,
    /// The number of pairs of lines that were sent.
    pairs: u64,
    /// The bytes of the last pair of lines on the wire.
    raw: Vec<u8>,
}

impl SimulatedCamera {
    /// Returns a camera that sends `left` and `right`, images of any type. Where the pixel
    /// format has no colour, colours are sent as their luma.
    ///
    /// # Errors
    /// Fails with [`CameraError`] when the views differ in size, are empty or too wide, or when
    /// the pixel format is not simulated.
    pub fn new(
        left: impl Into<DynamicImage>,
        right: impl Into<DynamicImage>,
        layout: Layout,
        format: PixelFormat,
    ) -> Result<Self, CameraError> {
        // Grey v becomes (v, v, v), whose luma is v.
        let (left, right) = (left.into().into_rgb8(), right.into().into_rgb8());
        if left.dimensions() != right.dimensions() {
            return Err(CameraError::Sizes {
                left: left.dimensions(),
                right: right.dimensions(),
            });
        }
        let (width, height) = left.dimensions();
        let width = u16::try_from(width).map_err(|_| CameraError::Size)?;
        if width == 0 || height == 0 {
            return Err(CameraError::Size);
        }
        if !PixelFormat::ALL.contains(&format) {
            return Err(CameraError::Format(format));
        }
        Ok(Self {
            left,
            right,
            layout,
            geometry: Geometry {
                width,
                height,
                format,
            },
            pairs: 0,
            raw: Vec::new(),
        })
    }
}

impl ErrorType for SimulatedCamera {
    type Error = ErrorKind;
}

impl LinePairSource for SimulatedCamera {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let Geometry {
            width,
            height,
            format,
        } = self.geometry;
        let line_bytes = self.geometry.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Err(ErrorKind::Other);
        }
        let height = u64::from(height);
        let (frame, line) = (self.pairs / height, self.pairs % height);
        let row = |image: &RgbImage| {
            let rgb_bytes = PixelFormat::Rgb888.line_bytes(width);
            let start = usize::try_from(line).map_err(|_| ErrorKind::Other)? * rgb_bytes;
            Ok::<_, ErrorKind>(encode(format, &image.as_raw()[start..start + rgb_bytes]))
        };
        let (wire_left, wire_right) = (row(&self.left)?, row(&self.right)?);
        merge(self.layout, format, &wire_left, &wire_right, &mut self.raw);
        self.layout.split(format, &self.raw, left, right)?;
        let pair = LinePair {
            // Frame numbers wrap.
            frame: (frame & u64::from(u32::MAX)) as u32,
            // Below the height, a u32.
            line: line as u32,
            timestamp_us: self.pairs * LINE_PERIOD_US,
            dropped: 0,
        };
        self.pairs += 1;
        Ok(pair)
    }
}

impl Rewind for SimulatedCamera {
    fn rewind(&mut self, pairs: u32) {
        self.pairs = self.pairs.saturating_sub(pairs.into());
    }
}

/// Returns a line of RGB pixels in this pixel format.
fn encode(format: PixelFormat, rgb: &[u8]) -> Vec<u8> {
    let mut luma = vec![0; rgb.len() / 3];
    luma_row(PixelFormat::Rgb888, rgb, &mut luma);
    let (pixels, _) = rgb.as_chunks::<3>();
    match format {
        PixelFormat::Rgb888 => rgb.to_vec(),
        PixelFormat::Rgb565 => pixels
            .iter()
            .flat_map(|&[red, green, blue]| {
                let [red, green, blue] = [red >> 3, green >> 2, blue >> 3].map(u16::from);
                (red << 11 | green << 5 | blue).to_be_bytes()
            })
            .collect(),
        PixelFormat::Yuv422 => pixels
            .iter()
            .zip(luma)
            .enumerate()
            .flat_map(|(x, (&[red, _, blue], luma))| [luma, chroma(x, red, blue, luma)])
            .collect(),
        // `SimulatedCamera::new` lets no other format in.
        _ => luma,
    }
}

/// Returns the chroma byte of the pixel in column `x`: U in even and V in odd columns, as BT.601
/// defines them over the full range.
fn chroma(x: usize, red: u8, blue: u8, luma: u8) -> u8 {
    let (colour, scale) = if x.is_multiple_of(2) {
        (blue, 0.564)
    } else {
        (red, 0.713)
    };
    // A float to u8 cast saturates.
    (128.0 + scale * (f64::from(colour) - f64::from(luma))).round() as u8
}

/// Merges a pair of lines to the raw bytes that [`Layout::split`] takes apart. Pixels that
/// `split` skips get an arbitrary value.
fn merge(layout: Layout, format: PixelFormat, left: &[u8], right: &[u8], raw: &mut Vec<u8>) {
    raw.clear();
    let bytes_per_pixel = format.bytes_per_pixel();
    match layout {
        Layout::Separate | Layout::SideBySide | Layout::LineMultiplexed => {
            raw.extend_from_slice(left);
            raw.extend_from_slice(right);
        }
        Layout::PixelMultiplexed { phase } => {
            raw.resize(usize::from(phase) * bytes_per_pixel, 0xa5);
            let pixels = |line| <[u8]>::chunks_exact(line, bytes_per_pixel);
            for (left, right) in pixels(left).zip(pixels(right)) {
                raw.extend_from_slice(left);
                raw.extend_from_slice(right);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;
    use vgstereo_firmware::camera::Error;
    use vgstereo_firmware::scripted::{FaultKind, FaultyCamera, ScriptedFault};

    const LAYOUTS: [Layout; 6] = [
        Layout::Separate,
        Layout::SideBySide,
        Layout::LineMultiplexed,
        Layout::PixelMultiplexed { phase: 0 },
        Layout::PixelMultiplexed { phase: 1 },
        Layout::PixelMultiplexed { phase: 5 },
    ];

    fn colours(seed: u32) -> RgbImage {
        RgbImage::from_fn(7, 3, |x, y| {
            image::Rgb([1u32, 2, 3].map(|i| ((x * 31 + y * 17 + seed) * i * 37 % 256) as u8))
        })
    }

    fn greys() -> SimulatedCamera {
        let image = |seed| GrayImage::from_fn(5, 4, |x, y| image::Luma([(x + 9 * y + seed) as u8]));
        let (layout, format) = (Layout::SideBySide, PixelFormat::Grey8);
        SimulatedCamera::new(image(1), image(101), layout, format).unwrap()
    }

    /// Frame, line and dropped of each pair, or the error, until `count` reads.
    fn reads(script: &[ScriptedFault], count: usize) -> Vec<Result<(u32, u32, u32), ErrorKind>> {
        let mut camera = FaultyCamera::new(greys(), script);
        let (mut left, mut right) = ([0; 5], [0; 5]);
        (0..count)
            .map(|_| {
                let pair = camera.read_pair(&mut left, &mut right);
                let pair = pair.map_err(|error| error.kind())?;
                let first = (9 * pair.line) as u8;
                assert_eq!((left[0], right[0]), (first + 1, first + 101));
                Ok((pair.frame, pair.line, pair.dropped))
            })
            .collect()
    }

    fn fault(line: u32, kind: FaultKind) -> ScriptedFault {
        let frame = 0;
        ScriptedFault { frame, line, kind }
    }

    #[test]
    fn every_layout_and_format_brings_the_views_back() {
        for layout in LAYOUTS {
            for format in PixelFormat::ALL {
                let (left, right) = (colours(1), colours(90));
                let mut camera =
                    SimulatedCamera::new(left.clone(), right.clone(), layout, format).unwrap();
                let bytes = camera.geometry().line_bytes();
                let (mut wire_left, mut wire_right) = (vec![0; bytes], vec![0; bytes]);
                for pair in 0..7u32 {
                    let got = camera.read_pair(&mut wire_left, &mut wire_right).unwrap();
                    assert_eq!((got.frame, got.line), (pair / 3, pair % 3));
                    assert_eq!(got.timestamp_us, u64::from(pair) * LINE_PERIOD_US);
                    let row = |image: &RgbImage| {
                        let line: Vec<u8> = (0..7)
                            .flat_map(|x| image.get_pixel(x, got.line).0)
                            .collect();
                        encode(format, &line)
                    };
                    assert_eq!(wire_left, row(&left), "{layout:?} {format:?}");
                    assert_eq!(wire_right, row(&right), "{layout:?} {format:?}");
                }
            }
        }
    }

    #[test]
    fn encodings_of_known_colours() {
        let rgb = [255, 0, 0, 0, 0, 255];
        assert_eq!(encode(PixelFormat::Rgb888, &rgb), rgb);
        assert_eq!(encode(PixelFormat::Rgb565, &rgb), [0xf8, 0, 0, 0x1f]);
        assert_eq!(encode(PixelFormat::Grey8, &rgb), [77, 29]);
        // U of red, V of blue.
        assert_eq!(encode(PixelFormat::Yuv422, &rgb), [77, 85, 29, 107]);
    }

    #[test]
    fn images_that_make_no_camera_are_refused() {
        let camera = |left: (u32, u32), right: (u32, u32)| {
            let image = |(width, height)| GrayImage::new(width, height);
            let (layout, format) = (Layout::Separate, PixelFormat::Grey8);
            SimulatedCamera::new(image(left), image(right), layout, format).map(|_| ())
        };
        let (left, right) = ((4, 3), (4, 2));
        assert_eq!(camera(left, right), Err(CameraError::Sizes { left, right }));
        assert_eq!(camera((0, 3), (0, 3)), Err(CameraError::Size));
        assert_eq!(camera((65536, 1), (65536, 1)), Err(CameraError::Size));
        assert_eq!(camera((65535, 1), (65535, 1)), Ok(()));
    }

    #[test]
    fn buffers_of_another_length_are_refused_and_nothing_is_lost() {
        let mut camera = FaultyCamera::new(greys(), []);
        let refused = camera.read_pair(&mut [0; 4], &mut [0; 4]);
        assert_eq!(refused.unwrap_err().kind(), ErrorKind::Other);
        let mut camera = camera.into_inner();
        let refused = camera.read_pair(&mut [0; 5], &mut [0; 6]);
        assert_eq!(refused, Err(ErrorKind::Other));
        let pair = camera.read_pair(&mut [0; 5], &mut [0; 5]).unwrap();
        assert_eq!((pair.frame, pair.line), (0, 0));
    }

    #[test]
    fn lost_pairs_are_counted_in_the_next() {
        let error = fault(1, FaultKind::Error(ErrorKind::Bus));
        let silent = fault(2, FaultKind::DroppedLine);
        let expected = [
            Ok((0, 0, 0)),
            Err(ErrorKind::Bus),
            Ok((0, 3, 2)),
            Ok((1, 0, 0)),
        ];
        assert_eq!(reads(&[error, silent], 4), expected);
        // Before the first pair there is nothing from which to count.
        let first = fault(0, FaultKind::Error(ErrorKind::Bus));
        let expected = [Err(ErrorKind::Bus), Ok((0, 1, 0))];
        assert_eq!(reads(&[first], 2), expected);
    }

    #[test]
    fn the_rest_of_a_frame_is_lost() {
        let expected = [Ok((0, 0, 0)), Err(ErrorKind::SyncLost), Ok((1, 0, 3))];
        assert_eq!(reads(&[fault(1, FaultKind::LostSync)], 3), expected);
        // A fault in what is lost already does not happen.
        let script = [
            fault(1, FaultKind::Truncated),
            fault(2, FaultKind::LostSync),
        ];
        assert_eq!(
            reads(&script, 3),
            [Ok((0, 0, 0)), Ok((1, 0, 3)), Ok((1, 1, 0))]
        );
    }

    #[test]
    fn lines_and_frames_come_again() {
        let expected = [Ok((0, 0, 0)), Ok((0, 0, 0)), Ok((0, 1, 0))];
        assert_eq!(reads(&[fault(0, FaultKind::DuplicatedLine)], 3), expected);
        let lines = [0, 1, 0, 1, 2, 3];
        let expected: Vec<_> = lines.map(|line| Ok((0, line, 0))).into();
        assert_eq!(reads(&[fault(1, FaultKind::DuplicatedFrame)], 6), expected);
    }
}
