//! What boards send in the tests: their introduction and frames, as bytes of the link and as recordings.

use std::path::Path;

use image::RgbImage;
use vgstereo_link::board::{Camera, FrameBegun, Hello, LinePair, View};
use vgstereo_link::{BoardMessage, Encoder, Line, PixelFormat, Region, Streams, Values};
use vgstereo_sim::link::recording::Recorder;

/// A board whose camera gives colour.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Board {
    /// Width and height of its views, px: of those of the camera, and of those that are matched.
    pub size: (u16, u32),
    pub rectifies: bool,
    pub camera: Option<Camera>,
}

/// What a board sends of a frame, all of the whole view.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sent {
    pub frame: u32,
    pub raw: Option<[RgbImage; 2]>,
    pub rectified: Option<[RgbImage; 2]>,
    pub disparities_q4: Option<Vec<i16>>,
    pub confidences: Option<Vec<u8>>,
    /// A line of which nothing is sent.
    pub missing: Option<u32>,
}

impl Board {
    /// A board of views of this size, px, that does not rectify.
    pub(crate) fn new(size: (u16, u32)) -> Self {
        Self {
            size,
            rectifies: false,
            camera: None,
        }
    }

    /// Its introduction. It searches 48 disparities.
    pub(crate) fn hello(&self) -> BoardMessage<'static> {
        let view = View {
            width_px: self.size.0,
            height_lines: self.size.1,
            format: PixelFormat::Rgb888,
        };
        BoardMessage::Hello(Hello {
            device: "board",
            firmware: "1",
            raw: view,
            matched: view,
            preset: "lite",
            disparity_min_px: 0,
            disparity_count: 48,
            latency_lines: 2,
            streams: Streams::DISPARITIES.with(Streams::CONFIDENCES),
            calibration_crc32: None,
            rectifies: self.rectifies,
            piece_bytes_max: 0,
        })
    }

    /// The beginning of a frame of the whole view.
    pub(crate) fn begun(&self, frame: u32) -> BoardMessage<'static> {
        BoardMessage::FrameBegun(FrameBegun {
            frame,
            timestamp_us: 0,
            region: Region {
                x_px: 0,
                y_lines: 0,
                width_px: self.size.0,
                height_lines: self.size.1,
            },
        })
    }

    /// The bytes of the link from its introduction to the end of the last of these frames.
    pub(crate) fn bytes(&self, frames: &[Sent]) -> Vec<u8> {
        let mut memory = vec![0; 1 << 16];
        let mut encoder = Encoder::new(&mut memory);
        let mut bytes = Vec::new();
        let mut send = |message: &BoardMessage<'_>| {
            bytes.extend_from_slice(encoder.encode(0, message).unwrap());
        };
        send(&self.hello());
        if let Some(camera) = self.camera {
            send(&BoardMessage::Camera(camera));
        }
        for sent in frames {
            send(&self.begun(sent.frame));
            for line in (0..self.size.1).filter(|line| Some(*line) != sent.missing) {
                self.line(sent, line, &mut send);
            }
            send(&BoardMessage::FrameDone { frame: sent.frame });
        }
        bytes
    }

    fn line(&self, sent: &Sent, line: u32, send: &mut dyn FnMut(&BoardMessage<'_>)) {
        let (frame, width) = (sent.frame, usize::from(self.size.0));
        let row =
            |view: &RgbImage| view.as_raw()[line as usize * 3 * width..][..3 * width].to_vec();
        for (pair, is_rectified) in [(&sent.raw, false), (&sent.rectified, true)] {
            let Some([left, right]) = pair else { continue };
            let pair = LinePair {
                frame,
                line,
                format: PixelFormat::Rgb888,
                left: &row(left),
                right: &row(right),
            };
            send(&if is_rectified {
                BoardMessage::RectifiedPair(pair)
            } else {
                BoardMessage::RawPair(pair)
            });
        }
        if let Some(disparities_q4) = &sent.disparities_q4 {
            let values = Values::Plain(&disparities_q4[line as usize * width..][..width]);
            send(&BoardMessage::Disparities(Line {
                frame,
                line,
                column: 0,
                values,
            }));
        }
        if let Some(confidences) = &sent.confidences {
            let values = Values::Plain(&confidences[line as usize * width..][..width]);
            send(&BoardMessage::Confidences(Line {
                frame,
                line,
                column: 0,
                values,
            }));
        }
    }
}

/// Writes bytes of the link as a recording, in pieces of which none ends with a packet but by chance.
pub(crate) fn record(path: &Path, bytes: &[u8]) {
    let mut recorder = Recorder::create(path).unwrap();
    for (at, piece) in (0..).zip(bytes.chunks(997)) {
        recorder.push(1_000_000 * at, piece).unwrap();
    }
    recorder.finish().unwrap();
}
