//! Implementation of the camera trait over the camera port and the trigger of the sensors.

use embassy_stm32::dcmi::FrameDma;
use embassy_stm32::dma;
use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::peripherals::DCMI;
use embassy_time::Duration;
use vgstereo_firmware::Watchdog;
use vgstereo_firmware::camera::{ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};

use crate::capture::Capture;
use crate::clock::{self, wait_for};
use crate::rig::Rig;
use crate::sensors::Sensors;
use crate::watchdog::Iwdg;

/// Time between two attempts to set up a sensor that does not answer.
const RETRY: Duration = Duration::from_millis(500);

/// Two sensors that start a frame at the same edge of their trigger, when line 0 is asked for. The
/// lines are not rectified. A pair that is not read before the next line ends is lost, together
/// with the rest of the frame.
///
/// A sensor that does not answer is an error of the bus, again and again until it does. That
/// feeds the watchdog: a reset would not bring the sensor back.
pub struct StereoCamera<D: FrameDma<DCMI>, I> {
    rig: Rig,
    sensors: Sensors,
    capture: Capture<D, I>,
    trigger: Output<'static>,
    watchdog: Iwdg,
    /// The raw line that was copied out of the ring.
    raw: &'static mut [u32],
    /// Number of frames started so far, modulo 2^32.
    frames: u32,
    /// Number of the next line of the current frame, or `None` if a new frame must be started.
    line: Option<u32>,
    /// Pairs lost since the last one delivered, or `None` if none was delivered yet.
    dropped: Option<u32>,
}

impl<D, I> StereoCamera<D, I>
where
    D: FrameDma<DCMI>,
    I: Binding<D::Interrupt, dma::InterruptHandler<D>> + Copy + 'static,
{
    /// Creates a camera whose sensors start a frame at the rising edge of `trigger`, which is low.
    /// `raw` holds a raw line.
    pub fn new(
        rig: Rig,
        sensors: Sensors,
        capture: Capture<D, I>,
        trigger: Output<'static>,
        watchdog: Iwdg,
        raw: &'static mut [u32],
    ) -> Self {
        Self {
            rig,
            sensors,
            capture,
            trigger,
            watchdog,
            raw,
            frames: 0,
            line: None,
            dropped: None,
        }
    }

    /// Longest wait for a line, or for the end of a frame.
    fn longest(&self) -> Duration {
        Duration::from_micros(self.rig.frame_us().into())
    }

    /// Returns the number of the next line of the current frame, or starts a new frame and returns
    /// 0.
    fn next_line(&mut self) -> Result<u32, ErrorKind> {
        if let Some(line) = self.line {
            return Ok(line);
        }
        // The sensors always send a whole frame: lines below the geometry, or the rest after a
        // fault, have to pass. The wait for a frame that never ends is bounded.
        wait_for(self.longest(), || self.capture.progress().has_ended);
        if let Err(not_ready) = self.sensors.make_ready() {
            if not_ready.is_absent {
                self.watchdog.feed();
            }
            wait_for(RETRY, || false);
            return Err(not_ready.kind);
        }
        self.capture.begin_frame();
        self.trigger.set_high();
        self.frames = self.frames.wrapping_add(1);
        Ok(0)
    }

    /// Ends the trigger, which has been high since the frame was asked for: the sensors have begun,
    /// or they will not.
    fn end_trigger(&mut self) {
        if self.trigger.is_set_high() {
            self.trigger.set_low();
        }
    }

    /// Waits for a line and copies it out of the ring.
    fn receive(&mut self, line: u32) -> Result<(), ErrorKind> {
        let mut progress = self.capture.progress();
        let came = wait_for(self.longest(), || {
            progress = self.capture.progress();
            progress.fault.is_some() || progress.lines > line || progress.has_ended
        });
        self.end_trigger();
        if let Some(fault) = progress.fault {
            return Err(fault);
        }
        if progress.lines > line {
            return self.capture.read(self.raw);
        }
        Err(if came {
            ErrorKind::ShortFrame
        } else {
            ErrorKind::Timeout
        })
    }
}

impl<D: FrameDma<DCMI>, I> ErrorType for StereoCamera<D, I> {
    type Error = ErrorKind;
}

impl<D, I> LinePairSource for StereoCamera<D, I>
where
    D: FrameDma<DCMI>,
    I: Binding<D::Interrupt, dma::InterruptHandler<D>> + Copy + 'static,
{
    fn geometry(&self) -> Geometry {
        self.rig.geometry
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let Rig {
            geometry, layout, ..
        } = self.rig;
        let line_bytes = geometry.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Err(ErrorKind::Other);
        }
        let line = self.next_line()?;
        let raw = self.receive(line);
        let split = raw.and_then(|()| {
            let raw = bytemuck::cast_slice(self.raw);
            layout.split(geometry.format, raw, left, right)
        });
        // A frame is whole only if both sensors have sent all of it.
        let is_last = line + 1 == geometry.height;
        let split = split.and_then(|()| {
            if is_last && !self.sensors.are_ready() {
                return Err(ErrorKind::Bus);
            }
            Ok(())
        });
        if let Err(error) = split {
            self.line = None;
            let lost = geometry.height - line;
            self.dropped = self.dropped.map(|dropped| dropped.saturating_add(lost));
            return Err(error);
        }
        self.line = (!is_last).then_some(line + 1);
        Ok(LinePair {
            frame: self.frames.wrapping_sub(1),
            line,
            timestamp_us: clock::now().as_micros(),
            dropped: self.dropped.replace(0).unwrap_or(0),
        })
    }
}
