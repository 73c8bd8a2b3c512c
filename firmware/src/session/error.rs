//! Errors: why a session is refused, and why a run gave up.

use core::fmt;

use crate::camera::PixelFormat;
use vgstereo_core::rows::OutOfMemory;

use crate::fault::Fault;

/// Why a session is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SessionError {
    /// The camera's lines and the matcher's differ in width.
    Width {
        /// Width of the camera's lines, in pixels.
        camera_px: u16,
        /// Width of the lines that the matcher is configured for, in pixels.
        matcher_px: u16,
    },
    /// The matcher is configured for colour, which the camera's lines do not have.
    Colour {
        /// Pixel format of the camera's lines.
        camera: PixelFormat,
    },
    /// The camera's frames end above the first line of the matcher's region.
    Height {
        /// Height of the camera's frames, in lines.
        camera_lines: u32,
        /// Number of the region's first line, counted from 0 at the top of the frame.
        first_line: u32,
    },
    /// The rectification is not for the camera's frames or not for the matcher's lines.
    Rectification {
        /// Width and height of the camera's frames.
        camera_px: [u32; 2],
        /// Width and height of the frames that the rectification is for.
        raw_px: [u16; 2],
        /// Width of its rectified lines, in pixels.
        rectified_px: u16,
        /// Width of the lines that the matcher is configured for, in pixels.
        matcher_px: u16,
    },
    /// The program leaves rectification out: see [`Scope`](vgstereo_core::kernel::Scope).
    Scope,
    /// The lent memory has fewer words than [`memory_words`](super::memory_words) asks for.
    Memory(OutOfMemory),
}

impl fmt::Display for SessionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Width {
                camera_px,
                matcher_px,
            } => write!(
                f,
                "the camera's lines have {camera_px} px, the matcher's {matcher_px} px"
            ),
            Self::Colour { camera } => write!(
                f,
                "the camera's pixels are {camera:?}, but the matcher is configured for colour"
            ),
            Self::Height {
                camera_lines,
                first_line,
            } => write!(
                f,
                "the camera's frames have {camera_lines} lines, the region begins at line {first_line}"
            ),
            Self::Rectification {
                camera_px: [width, height],
                raw_px: [raw_width, raw_height],
                rectified_px,
                matcher_px,
            } => write!(
                f,
                "the rectification is from {raw_width}x{raw_height} px to lines of {rectified_px} px; the \
                 camera's frames have {width}x{height} px, the matcher's lines {matcher_px} px"
            ),
            Self::Scope => f.write_str("the program leaves rectification out"),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for SessionError {}

impl From<OutOfMemory> for SessionError {
    fn from(error: OutOfMemory) -> Self {
        Self::Memory(error)
    }
}

/// Why [`Session::run_frame`](super::Session::run_frame) gave up. `E` is the sink's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RunError<E> {
    /// No frame came whole.
    Attempts {
        /// Number of times that the camera was read.
        reads: u32,
        /// Fault of the latest of these reads that had one; `None` if none had.
        last_fault: Option<Fault>,
    },
    /// The sink failed with this error; the frame is dropped.
    Sink(E),
}

impl<E: fmt::Display> fmt::Display for RunError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Attempts { reads, last_fault } => {
                write!(f, "no frame came whole in {reads} reads of the camera")?;
                match last_fault {
                    Some(fault) => write!(f, "; last fault: {fault}"),
                    None => Ok(()),
                }
            }
            Self::Sink(error) => error.fmt(f),
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for RunError<E> {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn a_refusal_says_what_does_not_fit() {
        for (error, parts) in [
            (
                SessionError::Width {
                    camera_px: 320,
                    matcher_px: 640,
                },
                ["320 px", "640 px"],
            ),
            (
                SessionError::Colour {
                    camera: PixelFormat::Grey8,
                },
                ["Grey8", "colour"],
            ),
            (
                SessionError::Height {
                    camera_lines: 480,
                    first_line: 500,
                },
                ["480 lines", "line 500"],
            ),
            (
                SessionError::Rectification {
                    camera_px: [320, 240],
                    raw_px: [640, 480],
                    rectified_px: 640,
                    matcher_px: 320,
                },
                ["640x480", "320x240"],
            ),
            (OutOfMemory.into(), ["memory", "smaller"]),
        ] {
            let text = error.to_string();
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        }
    }

    #[test]
    fn a_run_that_gave_up_tells_its_reads_and_its_last_fault() {
        let gave_up = |last_fault| {
            let reads = 8;
            RunError::<Fault>::Attempts { reads, last_fault }.to_string()
        };
        let text = gave_up(Some(Fault::Sequence));
        assert!(text.contains("8 reads"), "{text}");
        assert!(text.ends_with(&Fault::Sequence.to_string()), "{text}");
        let text = gave_up(None);
        assert!(text.ends_with("8 reads of the camera"), "{text}");
        let sink = RunError::Sink(Fault::Sequence).to_string();
        assert_eq!(sink, Fault::Sequence.to_string());
    }
}
