//! The camera trait over the port and the sensors' trigger.

use embassy_stm32::gpio::Output;
use embassy_time::{Duration, Instant};
use vgstereo_core::camera::{ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};

use crate::capture::{Capture, RAW_WORDS};
use crate::{FRAME_US, GEOMETRY, LAYOUT};

/// Two sensors that begin a frame at the same edge of their trigger: a frame comes when
/// its line 0 is asked for. Lines are not rectified. A pair that was not read when the next
/// line ends is lost, and with it the rest of the frame.
pub struct StereoCamera {
    capture: Capture,
    trigger: Output<'static>,
    raw: [u32; RAW_WORDS],
    /// Frames begun so far.
    frames: u32,
    /// The next line of the frame, if there is one.
    line: Option<u32>,
    /// Pairs lost since the one delivered last, if there is one.
    dropped: Option<u32>,
}

impl StereoCamera {
    /// A camera whose sensors wait for the rise of `trigger`.
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

    /// The next line of the frame that is being read, or line 0 of a new one.
    fn next_line(&mut self) -> u32 {
        if let Some(line) = self.line {
            return line;
        }
        // The sensors send a frame to its end: with the lines below the geometry, or after
        // a fault. One that never ends is given up.
        let _ = wait_for(|| self.capture.progress().has_ended);
        self.trigger.set_low();
        self.capture.begin_frame();
        self.trigger.set_high();
        self.frames = self.frames.wrapping_add(1);
        0
    }

    /// Waits for a line and takes it out of the ring.
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

/// Whether it happens in the time of a frame.
fn wait_for(mut has_happened: impl FnMut() -> bool) -> bool {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_micros(FRAME_US.into()) {
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
            timestamp_us: Instant::now().as_micros(),
            dropped: self.dropped.replace(0).unwrap_or(0),
        })
    }
}
