//! Implementation of the camera trait over the camera port and the trigger of the sensors.

use embassy_stm32::gpio::Output;
use embassy_time::Duration;
use vgstereo_firmware::camera::{ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};

use crate::capture::{Capture, RAW_WORDS};
use crate::{FRAME_US, GEOMETRY, LAYOUT, clock};

/// Two sensors that start a frame at the same edge of their trigger, when line 0 is asked for. The
/// lines are not rectified. A pair that is not read before the next line ends is lost, together
/// with the rest of the frame.
pub struct StereoCamera {
    capture: Capture,
    trigger: Output<'static>,
    raw: [u32; RAW_WORDS],
    /// Number of frames started so far, modulo 2^32.
    frames: u32,
    /// Number of the next line of the current frame, or `None` if a new frame must be started.
    line: Option<u32>,
    /// Pairs lost since the last one delivered, or `None` if none was delivered yet.
    dropped: Option<u32>,
}

impl StereoCamera {
    /// Creates a camera whose sensors start a frame at the rising edge of `trigger`.
    pub fn new(capture: Capture, trigger: Output<'static>) -> Self {
        Self {
            capture,
            trigger,
            raw: [0; RAW_WORDS],
            frames: 0,
            line: None,
            dropped: None,
        }
    }

    /// Returns the number of the next line of the current frame, or starts a new frame and returns
    /// 0.
    fn next_line(&mut self) -> u32 {
        if let Some(line) = self.line {
            return line;
        }
        // The sensors always send a whole frame: lines below the geometry, or the rest after a
        // fault, have to pass. The wait for a frame that never ends is bounded.
        let _ = wait_for(|| self.capture.progress().has_ended);
        self.trigger.set_low();
        self.capture.begin_frame();
        self.trigger.set_high();
        self.frames = self.frames.wrapping_add(1);
        0
    }

    /// Waits for a line and copies it out of the ring.
    fn receive(&mut self, line: u32) -> Result<(), ErrorKind> {
        let mut progress = self.capture.progress();
        let came = wait_for(|| {
            progress = self.capture.progress();
            progress.fault.is_some() || progress.lines() > line || progress.has_ended
        });
        if let Some(fault) = progress.fault {
            return Err(fault);
        }
        if progress.lines() > line {
            return self.capture.read(&mut self.raw);
        }
        Err(if came {
            ErrorKind::ShortFrame
        } else {
            ErrorKind::Timeout
        })
    }
}

/// Waits until `has_happened` returns true, for at most the time of a frame. Returns whether it
/// did.
fn wait_for(mut has_happened: impl FnMut() -> bool) -> bool {
    let begun = clock::now();
    while clock::since(begun) < Duration::from_micros(FRAME_US.into()) {
        if has_happened() {
            return true;
        }
    }
    false
}

impl ErrorType for StereoCamera {
    type Error = ErrorKind;
}

impl LinePairSource for StereoCamera {
    fn geometry(&self) -> Geometry {
        GEOMETRY
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let line_bytes = GEOMETRY.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Err(ErrorKind::Other);
        }
        let line = self.next_line();
        let raw = self.receive(line);
        let split = raw.and_then(|()| {
            let raw = bytemuck::cast_slice(&self.raw);
            LAYOUT.split(GEOMETRY.format, raw, left, right)
        });
        if let Err(error) = split {
            self.line = None;
            let lost = GEOMETRY.height - line;
            self.dropped = self.dropped.map(|dropped| dropped.saturating_add(lost));
            return Err(error);
        }
        self.line = Some(line + 1).filter(|&next| next < GEOMETRY.height);
        Ok(LinePair {
            frame: self.frames.wrapping_sub(1),
            line,
            timestamp_us: clock::now().as_micros(),
            dropped: self.dropped.replace(0).unwrap_or(0),
        })
    }
}
