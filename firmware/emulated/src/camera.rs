//! Camera that reads its lines from a file of the host, and repeats its frames for ever.

use semihosting::fs::File;
use semihosting::io::{Read, Seek, SeekFrom};
use vgstereo_firmware::camera::{ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};
use vgstereo_firmware::scripted::Rewind;

/// A camera that reads each pair of lines from a file when it is asked for it, so that no more than
/// one pair is in memory. Frames are numbered from 0; those of the file come in turn.
#[derive(Debug)]
pub struct FileCamera<'f> {
    lines: &'f File,
    geometry: Geometry,
    /// Time of a pair, µs.
    clock: fn() -> u64,
    /// Number of frames in the file, at least 1.
    frames: u32,
    frame: u32,
    line: u32,
}

impl<'f> FileCamera<'f> {
    /// Creates a camera over an open [`LINES_FILE`](crate::LINES_FILE). `clock` gives the time of a
    /// pair, µs.
    #[must_use]
    pub fn new(mut lines: &'f File, geometry: Geometry, clock: fn() -> u64) -> Self {
        // A file without an end cannot be read either, which is told with the first line.
        let length = lines.seek(SeekFrom::End(0)).unwrap_or(0);
        let frames = length.checked_div(frame_bytes(&geometry)).unwrap_or(0);
        Self {
            lines,
            geometry,
            clock,
            frames: frames.try_into().unwrap_or(u32::MAX).max(1),
            frame: 0,
            line: 0,
        }
    }
}

/// Bytes of a frame in the file.
fn frame_bytes(geometry: &Geometry) -> u64 {
    2 * geometry.line_bytes() as u64 * u64::from(geometry.height)
}

/// Fills `bytes` from a file.
///
/// # Errors
/// [`ErrorKind::Bus`] when the file cannot be read, [`ErrorKind::ShortFrame`] when it ends before.
pub(crate) fn read_exactly(mut file: &File, mut bytes: &mut [u8]) -> Result<(), ErrorKind> {
    // Each read returns at least one byte, or 0 at the end of the file.
    while !bytes.is_empty() {
        let count = file.read(bytes).map_err(|_| ErrorKind::Bus)?;
        if count == 0 {
            return Err(ErrorKind::ShortFrame);
        }
        bytes = bytes.get_mut(count..).unwrap_or_default();
    }
    Ok(())
}

impl ErrorType for FileCamera<'_> {
    type Error = ErrorKind;
}

impl LinePairSource for FileCamera<'_> {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    // Not inlined, so that the assertions of semihosting are not counted as the pipeline's.
    #[inline(never)]
    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let line_bytes = self.geometry.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Err(ErrorKind::Other);
        }
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
        let shown = pair.frame.checked_rem(self.frames).unwrap_or(0);
        let start = u64::from(shown) * frame_bytes(&self.geometry);
        let start = start + u64::from(pair.line) * 2 * line_bytes as u64;
        let at_line = self.lines.seek(SeekFrom::Start(start));
        at_line.map_err(|_| ErrorKind::Bus)?;
        read_exactly(self.lines, left)?;
        read_exactly(self.lines, right)?;
        Ok(pair)
    }
}

impl Rewind for FileCamera<'_> {
    fn rewind(&mut self, pairs: u32) {
        for _ in 0..pairs {
            self.line = self.line.checked_sub(1).unwrap_or_else(|| {
                self.frame = self.frame.wrapping_sub(1);
                self.geometry.height.saturating_sub(1)
            });
        }
    }
}
