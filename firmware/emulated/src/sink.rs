//! Sinks that write whole frames, and scans of them, to files of the host.

use semihosting::fs::File;
use semihosting::io::{Error, ErrorKind, Seek, SeekFrom, Write};
use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::Scan;
use vgstereo_core::rows::Arena;
use vgstereo_firmware::sink::ScanSink;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};
use vgstereo_link::{BoardMessage, Encoder, Line, PixelFormat, Streams, Values, memory_bytes};

use crate::meter::{Counter, Meter, Stage};

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

/// A sink that makes packets of the link of the lines of disparities, and leaves them: what they cost is
/// measured.
#[derive(Debug)]
pub struct PacketSink<'m, C> {
    /// None if there is no memory for a packet.
    encoder: Option<Encoder<'m>>,
    meter: &'m Meter<C>,
}

impl<'m, C: Counter> PacketSink<'m, C> {
    /// Creates a sink for lines of `width_px`, in this memory; without enough of it, the sink does
    /// nothing.
    #[must_use]
    pub fn new(memory: &'m mut [u32], width_px: u16, meter: &'m Meter<C>) -> Self {
        let bytes = memory_bytes(width_px, PixelFormat::Grey8, Streams::DISPARITIES);
        let memory = Arena::new(memory).take(bytes);
        Self {
            encoder: memory.ok().map(Encoder::new),
            meter,
        }
    }
}

impl<C: Counter> DisparitySink for PacketSink<'_, C> {
    type Error = Error;

    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Error> {
        Ok(())
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Error> {
        let Some(encoder) = &mut self.encoder else {
            return Ok(());
        };
        let message = BoardMessage::Disparities(Line {
            frame,
            line: line.line,
            column: line.column,
            values: Values::Plain(line.disparities_q4),
        });
        let encoded = self.meter.measure(Stage::Link, || {
            encoder.encode(0, &message).map(|packet| packet.len())
        });
        encoded.map(drop).map_err(|_| ErrorKind::Other.into())
    }

    fn end_frame(&mut self, _: &FrameInfo) -> Result<(), Error> {
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
