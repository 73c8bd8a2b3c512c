//! A sink that writes whole frames to files of the host.

use semihosting::fs::File;
use semihosting::io::{Error, ErrorKind, Seek, SeekFrom, Write};
use vgstereo_core::matcher::DisparityLine;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};

/// Writes lines as they come; a frame that is aborted is written over by the next.
#[derive(Debug)]
pub struct FileSink {
    disparities: File,
    confidences: File,
    /// Pixels of the whole frames.
    pixels: u64,
}

impl FileSink {
    /// A sink that fills empty files: see [`DISPARITIES_FILE`](crate::DISPARITIES_FILE) and
    /// [`CONFIDENCES_FILE`](crate::CONFIDENCES_FILE).
    #[must_use]
    pub fn new(disparities: File, confidences: File) -> Self {
        Self {
            disparities,
            confidences,
            pixels: 0,
        }
    }
}

/// Every target is little-endian, so that a line's bytes are as they stand in memory.
const _: () = assert!(cfg!(target_endian = "little"));

impl DisparitySink for FileSink {
    type Error = Error;

    // Not inlined: what semihosting asserts is then not taken for the pipeline's.
    #[inline(never)]
    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Error> {
        let start = self.pixels;
        self.disparities.seek(SeekFrom::Start(start * 2))?;
        self.confidences.seek(SeekFrom::Start(start))?;
        Ok(())
    }

    #[inline(never)]
    fn line(&mut self, _: u32, line: &DisparityLine<'_>) -> Result<(), Error> {
        write(
            &mut self.disparities,
            bytemuck::cast_slice(line.disparities_q4),
        )?;
        write(&mut self.confidences, line.confidences)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Error> {
        self.pixels += u64::from(info.region.width) * u64::from(info.region.height);
        Ok(())
    }

    fn abort_frame(&mut self, _: u32, _: Fault) {}
}

/// Writes all of `bytes`.
///
/// # Errors
/// What the host says; [`ErrorKind::WriteZero`] when it takes no more.
pub fn write(file: &mut File, mut bytes: &[u8]) -> Result<(), Error> {
    while !bytes.is_empty() {
        let written = file.write(bytes)?;
        if written == 0 {
            return Err(ErrorKind::WriteZero.into());
        }
        bytes = bytes.get(written..).unwrap_or_default();
    }
    Ok(())
}
