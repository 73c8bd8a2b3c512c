//! Request to a board, as words on its command line.

use core::fmt;
use core::str::FromStr;

use heapless::Vec;
use vgstereo_core::geometry::{Depth, LaserScan, RectifiedCamera, ScanConfig};
use vgstereo_core::{Config, DisparityRange, Method, Preset};
use vgstereo_firmware::camera::{Geometry, PixelFormat};
use vgstereo_firmware::scripted::ScriptedFault;
use vgstereo_firmware::{live, session};

/// Number of cells of the patterns if [`Request::hamming_alone`] is set.
pub const HAMMING_CELLS: u8 = 64;

/// Number of disparities of boards that are built for one preset.
pub const ALONE_DISPARITIES: u16 = 48;

/// Largest number of faults in a script.
pub const MAX_FAULTS: usize = 32;

/// Reason for which a request is not served.
#[derive(Debug, Clone, Copy)]
pub struct Refusal(pub &'static str);

/// What a board has to know of a rectification before it reads it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Calibration {
    /// Its length, bytes.
    pub bytes: u32,
    /// Words of 32 bits that the rectifier takes.
    pub rectifier_words: u32,
    /// Width of the rectified views, px.
    pub width: u16,
}

/// The left camera of a rectified pair: a [`RectifiedCamera`] in whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraRequest {
    /// The numerator and the offset of [`Depth`], 1/256 mm px and 1/256 px.
    pub depth: (u32, i32),
    /// Focal length, 1/256 px.
    pub focal_q8: u32,
    /// Principal point, column and line, 1/256 px.
    pub principal_q8: [i32; 2],
}

impl CameraRequest {
    /// The request for this camera.
    #[must_use]
    pub fn new(camera: &RectifiedCamera) -> Self {
        let depth = camera.depth();
        Self {
            depth: (depth.numerator_q8(), depth.offset_q8()),
            focal_q8: camera.focal_q8(),
            principal_q8: camera.principal_q8(),
        }
    }

    /// The camera; `None` if one of its numbers is out of its range.
    #[must_use]
    pub fn camera(&self) -> Option<RectifiedCamera> {
        let (numerator_q8, offset_q8) = self.depth;
        let depth = Depth::new(numerator_q8, offset_q8)?;
        RectifiedCamera::new(depth, self.focal_q8, self.principal_q8)
    }

    /// Parses its numbers, which are the next of the texts.
    fn of<'a>(texts: &mut impl Iterator<Item = &'a str>) -> Result<Self, NotARequest> {
        Ok(Self {
            depth: (number(texts)?, number(texts)?),
            focal_q8: number(texts)?,
            principal_q8: [number(texts)?, number(texts)?],
        })
    }
}

/// Writes its numbers, separated by colons.
impl fmt::Display for CameraRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ((numerator_q8, offset_q8), [cx_q8, cy_q8]) = (self.depth, self.principal_q8);
        write!(f, "{numerator_q8}:{offset_q8}:{}:", self.focal_q8)?;
        write!(f, "{cx_q8}:{cy_q8}")
    }
}

/// A laser scan to make of each frame: a [`ScanConfig`] in whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanRequest {
    /// The camera.
    pub camera: CameraRequest,
    /// Number of bearings.
    pub bearings: u16,
    /// Pitch of the camera, µrad: the angle of its optical axis below the horizon.
    pub pitch_urad: i32,
    /// Lowest and highest height that counts, mm.
    pub heights_mm: [i16; 2],
    /// Largest range that counts, mm.
    pub range_max_mm: u16,
    /// Number of lines in which something must be seen.
    pub lines_min: u8,
}

impl ScanRequest {
    /// The request for a scan over all columns of every found disparity.
    #[must_use]
    pub fn new(config: &ScanConfig) -> Self {
        Self {
            camera: CameraRequest::new(&config.camera),
            bearings: config.bearings,
            // The cast saturates, and what is out of range is refused.
            pitch_urad: (config.pitch_rad * 1e6) as i32,
            heights_mm: [*config.heights_mm.start(), *config.heights_mm.end()],
            range_max_mm: config.range_max_mm,
            lines_min: config.lines_min,
        }
    }

    /// The configuration of the scan for views of `width` columns; `None` if a number of the camera is
    /// out of its range.
    #[must_use]
    pub fn config(&self, width: u16) -> Option<ScanConfig> {
        let [low, high] = self.heights_mm;
        Some(ScanConfig {
            camera: self.camera.camera()?,
            columns: 0..width,
            bearings: self.bearings,
            pitch_rad: self.pitch_urad as f32 / 1e6,
            heights_mm: low..=high,
            range_max_mm: self.range_max_mm,
            lines_min: self.lines_min,
            confidence_min: 1,
        })
    }

    /// Words of 32 bits that the scan takes.
    #[must_use]
    pub const fn words(&self) -> usize {
        LaserScan::words(self.bearings, self.lines_min)
    }
}

/// Writes its numbers, separated by colons.
impl fmt::Display for ScanRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.heights_mm;
        write!(f, "{}:{}:{}:", self.camera, self.bearings, self.pitch_urad)?;
        write!(f, "{low}:{high}:")?;
        write!(f, "{}:{}", self.range_max_mm, self.lines_min)
    }
}

impl FromStr for ScanRequest {
    type Err = NotARequest;

    fn from_str(text: &str) -> Result<Self, NotARequest> {
        let mut numbers = text.split(':');
        let scan = Self {
            camera: CameraRequest::of(&mut numbers)?,
            bearings: number(&mut numbers)?,
            pitch_urad: number(&mut numbers)?,
            heights_mm: [number(&mut numbers)?, number(&mut numbers)?],
            range_max_mm: number(&mut numbers)?,
            lines_min: number(&mut numbers)?,
        };
        match numbers.next() {
            None => Ok(scan),
            Some(_) => Err(NotARequest),
        }
    }
}

/// Parses the next of the texts.
fn number<'a, T: FromStr>(texts: &mut impl Iterator<Item = &'a str>) -> Result<T, NotARequest> {
    let text = texts.next().ok_or(NotARequest)?;
    text.parse().map_err(|_| NotARequest)
}

/// The frames to match, and how to match them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// Preset of the matcher.
    pub preset: Preset,
    /// Whether the matching costs are the plain Hamming distances of patterns of [`HAMMING_CELLS`]
    /// cells instead, without masks, weights and levels. Applies to SGM presets only.
    pub hamming_alone: bool,
    /// Size and pixel format of the camera's lines.
    pub geometry: Geometry,
    /// The rectification of the camera's lines; `None` if they are rectified.
    pub calibration: Option<Calibration>,
    /// The laser scan to make of each frame, if any.
    pub scan: Option<ScanRequest>,
    /// The camera of rectified lines that come without a calibration, if it is known. For the link.
    pub camera: Option<CameraRequest>,
    /// Whether the board serves the link over its serial port, for ever, and writes no files.
    pub is_live: bool,
    /// Range of disparities to search.
    pub disparities: DisparityRange,
    /// Number of whole frames to deliver, if the board is not live.
    pub frames: u32,
    /// Faults that the camera simulates.
    pub faults: Vec<ScriptedFault, MAX_FAULTS>,
}

impl Request {
    /// Configuration of the matcher.
    #[must_use]
    pub fn config(&self) -> Config {
        let mut parameters = self.preset.parameters();
        if let Method::Sgm(method) = &mut parameters.method
            && self.hamming_alone
        {
            parameters.synapses = HAMMING_CELLS.into();
            method.kept_cells_q8 = 256;
            method.hamming_scale = HAMMING_CELLS;
            method.hamming_truncation = HAMMING_CELLS;
            method.difference_weight_q4 = 0;
        }
        Config {
            colour: !self.geometry.format.is_grey(),
            ..Config::new(parameters, self.width(), self.disparities)
        }
    }

    /// Width of the lines of disparities, px.
    #[must_use]
    pub fn width(&self) -> u16 {
        let rectified = self.calibration.map(|calibration| calibration.width);
        rectified.unwrap_or(self.geometry.width)
    }

    /// Words of 32 bits that the rectification takes, and its rectifier.
    #[must_use]
    pub fn calibration_words(&self) -> [usize; 2] {
        self.calibration.map_or([0; 2], |calibration| {
            let Calibration {
                bytes,
                rectifier_words,
                ..
            } = calibration;
            [bytes.div_ceil(4) as usize, rectifier_words as usize]
        })
    }

    /// Words of 32 bits that the link takes.
    #[must_use]
    pub fn link_words(&self) -> usize {
        if self.is_live {
            live::memory_words(&self.geometry, &self.config())
        } else {
            0
        }
    }

    /// Bytes of the lent memory that session, matcher, rectifier, rectification, scan and link
    /// take.
    #[must_use]
    pub fn working_bytes(&self) -> usize {
        let [rectification, rectifier] = self.calibration_words();
        let words = session::memory_words(&self.geometry) + self.config().memory_words();
        let scan = self.scan.map_or(0, |scan| scan.words());
        let link = self.link_words();
        (words + rectification + rectifier + scan + link) * size_of::<u32>()
    }
}

/// Writes words `KEY=VALUE`, which [`FromStr`] accepts in any order.
impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Geometry {
            width,
            height,
            format,
        } = self.geometry;
        let DisparityRange { minimum_px, count } = self.disparities;
        write!(f, "preset={} width={width} height={height} ", self.preset)?;
        write!(f, "pixels={} minimum={minimum_px} ", pixels_name(format))?;
        write!(f, "disparities={count} frames={}", self.frames)?;
        if self.hamming_alone {
            f.write_str(" costs=hamming")?;
        }
        if let Some(calibration) = self.calibration {
            let Calibration {
                bytes,
                rectifier_words,
                width,
            } = calibration;
            write!(f, " calibration={bytes}:{rectifier_words}:{width}")?;
        }
        if let Some(scan) = self.scan {
            write!(f, " scan={scan}")?;
        }
        if let Some(camera) = self.camera {
            write!(f, " camera={camera}")?;
        }
        if self.is_live {
            f.write_str(" output=link")?;
        }
        for fault in &self.faults {
            write!(f, " fault={fault}")?;
        }
        Ok(())
    }
}

/// Error of parsing a command line that is not a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotARequest;

impl fmt::Display for NotARequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the command line has a word that is unknown, not a value or too many")
    }
}

impl core::error::Error for NotARequest {}

impl FromStr for Request {
    type Err = NotARequest;

    fn from_str(words: &str) -> Result<Self, NotARequest> {
        fn value<T: FromStr>(text: &str) -> Result<T, NotARequest> {
            text.parse().map_err(|_| NotARequest)
        }
        let mut request = Self {
            preset: Preset::Lite,
            hamming_alone: false,
            geometry: Geometry {
                width: 0,
                height: 0,
                format: PixelFormat::Grey8,
            },
            calibration: None,
            scan: None,
            camera: None,
            is_live: false,
            disparities: DisparityRange::up_to(0),
            frames: 1,
            faults: Vec::new(),
        };
        for word in words.split_ascii_whitespace() {
            let (key, text) = word.split_once('=').ok_or(NotARequest)?;
            match key {
                "preset" => request.preset = value(text)?,
                "width" => request.geometry.width = value(text)?,
                "height" => request.geometry.height = value(text)?,
                "pixels" => {
                    let mut formats = PixelFormat::ALL.into_iter();
                    let format = formats.find(|&format| pixels_name(format) == text);
                    request.geometry.format = format.ok_or(NotARequest)?;
                }
                "minimum" => request.disparities.minimum_px = value(text)?,
                "disparities" => request.disparities.count = value(text)?,
                "costs" if text == "hamming" => request.hamming_alone = true,
                "frames" => request.frames = value(text)?,
                "calibration" => {
                    let mut parts = text.splitn(3, ':');
                    request.calibration = Some(Calibration {
                        bytes: number(&mut parts)?,
                        rectifier_words: number(&mut parts)?,
                        width: number(&mut parts)?,
                    });
                }
                "scan" => request.scan = Some(value(text)?),
                "camera" => {
                    let mut numbers = text.splitn(5, ':');
                    request.camera = Some(CameraRequest::of(&mut numbers)?);
                }
                "output" if text == "link" => request.is_live = true,
                "fault" => {
                    let fault = value(text)?;
                    request.faults.push(fault).map_err(|_| NotARequest)?;
                }
                _ => return Err(NotARequest),
            }
        }
        Ok(request)
    }
}

const fn pixels_name(format: PixelFormat) -> &'static str {
    match format {
        PixelFormat::Grey8 => "grey8",
        PixelFormat::Rgb888 => "rgb888",
        PixelFormat::Rgb565 => "rgb565",
        PixelFormat::Yuv422 => "yuv422",
        // No request can name a format that is added later.
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::string::ToString;
    use vgstereo_firmware::camera::ErrorKind;
    use vgstereo_firmware::scripted::FaultKind;

    #[test]
    fn requests_are_read_as_they_are_written() {
        for preset in Preset::ALL {
            for format in PixelFormat::ALL {
                let mut request = Request {
                    preset,
                    hamming_alone: false,
                    geometry: Geometry {
                        width: 320,
                        height: 240,
                        format,
                    },
                    calibration: None,
                    scan: None,
                    camera: None,
                    is_live: false,
                    disparities: DisparityRange {
                        minimum_px: -3,
                        count: 48,
                    },
                    frames: 5,
                    faults: Vec::new(),
                };
                assert_eq!(request.to_string().parse(), Ok(request.clone()));
                request.hamming_alone = true;
                request.calibration = Some(Calibration {
                    bytes: 9_001,
                    rectifier_words: 77,
                    width: 300,
                });
                request.is_live = true;
                let camera = CameraRequest {
                    depth: (u32::MAX, i32::MIN),
                    focal_q8: u32::MAX,
                    principal_q8: [i32::MIN, i32::MAX],
                };
                request.camera = Some(camera);
                request.scan = Some(ScanRequest {
                    camera,
                    bearings: 90,
                    pitch_urad: -150_000,
                    heights_mm: [i16::MIN, i16::MAX],
                    range_max_mm: 60_000,
                    lines_min: 3,
                });
                assert_eq!(request.to_string().parse(), Ok(request.clone()));
                let kind = FaultKind::Error(ErrorKind::Bus);
                let (frame, line) = (u32::MAX, u32::MAX);
                while request
                    .faults
                    .push(ScriptedFault { frame, line, kind })
                    .is_ok()
                {}
                assert_eq!(request.to_string().parse(), Ok(request.clone()));
                let one_more = format!("{request} fault=1:1:overrun");
                assert_eq!(one_more.parse::<Request>(), Err(NotARequest));
            }
        }
    }

    #[test]
    fn other_words_are_refused() {
        for words in [
            "wide",
            "wide=1",
            "width=-1",
            "preset=best",
            "pixels=",
            "costs=",
            "fault=1",
            "calibration=1:2",
            "camera=1:2:3:4",
            "camera=1:2:3:4:5:6",
            "output=files",
            "scan=1:2:3:4:5:6:7:8:9:10",
            "scan=1:2:3:4:5:6:7:8:9:10:11:12",
        ] {
            assert_eq!(words.parse::<Request>(), Err(NotARequest), "{words}");
        }
    }
}
