//! Sinks that write whole frames, and scans of them, to files of the host.

use semihosting::fs::File;
use semihosting::io::{Error, ErrorKind, Seek, SeekFrom, Write};
use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::Scan;
use vgstereo_firmware::sink::ScanSink;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};

/// A sink that writes each line at once. The next frame overwrites an aborted one.
#[derive(Debug)]
pub struct FileSink {
    disparities: File,
    confidences: File,
    /// Number of pixels of the frames completed so far.
    pixels: u64,
}

impl FileSink {
    /// Creates a sink over two empty files, [`DISPARITIES_FILE`](crate::DISPARITIES_FILE) and
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

/// Disparities are written as they are in memory, which every target makes little-endian.
const _: () = assert!(cfg!(target_endian = "little"));

impl DisparitySink for FileSink {
    type Error = Error;

    // Not inlined, so that the assertions of semihosting are not counted as the pipeline's.
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

/// A sink that writes scans, as [`SCANS_FILE`](crate::SCANS_FILE) has them.
#[derive(Debug)]
pub struct ScanFile(File);

impl ScanFile {
    /// Creates a sink over an empty file.
    #[must_use]
    pub fn new(scans: File) -> Self {
        Self(scans)
    }
}

impl ScanSink for ScanFile {
    type Error = Error;

    #[inline(never)]
    fn scan(&mut self, _: &FrameInfo, scan: &Scan<'_>) -> Result<(), Error> {
        for angle_rad in [scan.bearing_min_rad, scan.bearing_step_rad] {
            write(&mut self.0, &angle_rad.to_le_bytes())?;
        }
        write(&mut self.0, bytemuck::cast_slice(scan.ranges_mm))
    }
}

/// Writes all of `bytes`.
///
/// # Errors
/// The error that the host reports, or [`ErrorKind::WriteZero`] if it writes no more bytes.
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
