//! What a board is asked to do, as words on its command line.

use core::fmt;
use core::str::FromStr;

use heapless::Vec;
use vgstereo_core::camera::{Geometry, PixelFormat};
use vgstereo_core::config::{Config, Method};
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::preset::Preset;
use vgstereo_firmware::scripted::ScriptedFault;
use vgstereo_firmware::session;

/// Cells of the patterns where Hamming distances alone are asked for.
pub const HAMMING_CELLS: u8 = 64;

/// Most faults of a script.
pub const MAX_FAULTS: usize = 32;

/// Frames to match and how.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// The preset.
    pub preset: Preset,
    /// Whether its costs are instead the plain Hamming distances of patterns of
    /// [`HAMMING_CELLS`]: without masks, weights and levels. For presets that aggregate.
    pub hamming_alone: bool,
    /// Of the camera.
    pub geometry: Geometry,
    /// Disparities to search.
    pub disparities: DisparityRange,
    /// Whole frames to deliver.
    pub frames: u32,
    /// What goes wrong on the way.
    pub faults: Vec<ScriptedFault, MAX_FAULTS>,
}

impl Request {
    /// What the matcher is built from.
    #[must_use]
    pub fn config(&self) -> Config {
        let mut parameters = self.preset.parameters();
        if let Method::Aggregation(method) = &mut parameters.method
            && self.hamming_alone
        {
            parameters.synapses = HAMMING_CELLS.into();
            method.kept_cells_q8 = 256;
            method.hamming_scale = HAMMING_CELLS;
            method.hamming_truncation = HAMMING_CELLS;
            method.difference_weight_q4 = 0;
        }
        Config {
            format: self.geometry.format,
            ..Config::new(parameters, self.geometry.width, self.disparities)
        }
    }

    /// Bytes of the lent memory that session and matcher take.
    #[must_use]
    pub fn working_bytes(&self) -> usize {
        let words = session::memory_words(&self.geometry) + self.config().memory_words();
        words * size_of::<u32>()
    }
}

/// `KEY=VALUE` words, read back by [`FromStr`] in any order.
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
        for fault in &self.faults {
            write!(f, " fault={fault}")?;
        }
        Ok(())
    }
}

/// A command line is not a request.
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
        // A format without a name is not asked for.
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::string::ToString;
    use vgstereo_core::camera::ErrorKind;
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
                    disparities: DisparityRange {
                        minimum_px: -3,
                        count: 48,
                    },
                    frames: 5,
                    faults: Vec::new(),
                };
                assert_eq!(request.to_string().parse(), Ok(request.clone()));
                request.hamming_alone = true;
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
        ] {
            assert_eq!(words.parse::<Request>(), Err(NotARequest), "{words}");
        }
    }
}
