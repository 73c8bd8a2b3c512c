//! Set-up of the two OV7670: a window that is binned by two, fixed exposure.
//!
//! They have one clock, one reset, and take each write at the same time, so that they begin their frames together.
//! Neither can follow the other: that they are in step is what the ports compare.

use embedded_hal::delay::DelayNs;
use vgstereo_firmware::camera::{Error, ErrorKind, Geometry};
use vgstereo_firmware::sensors::ov7670::{self, Ov7670};
use vgstereo_firmware::sensors::{
    Binning, FrameSync, Sensor, SensorError, SensorSettings, TestPattern, Window, reset_by_pin,
};

use crate::board::{LED_LEFT_SENSOR, LEDS_RUNNING};
use crate::clock::{self, Delay};
use crate::i2c::{BusError, ResetPin, SensorBus};
use crate::news::{Log, News, Problem};
use crate::registers::LEDS;

/// Clock that is fed to the sensors.
const CLOCK_HZ: u32 = 24_000_000;
/// Period of a line before it is binned: a little more than the least at this clock.
const LINE_US: u32 = 66;
const FRAME_LINES: u16 = 510;
/// Time of exposure, which suits rooms.
const EXPOSURE_US: u32 = 30_000;

/// Time between two attempts to set up sensors of which one does not answer.
const RETRY_US: u32 = 50_000;

/// Both sensors.
pub(crate) struct Sensors<'l> {
    both: Ov7670<SensorBus>,
    settings: SensorSettings,
    log: &'l dyn Log,
    /// Whether they were set up and have answered since.
    are_up: bool,
    /// The problem that the log has named last; `None` if the sensors have been set up since.
    told: Option<Problem>,
}

impl<'l> Sensors<'l> {
    /// The sensors, which are not set up yet. None if they have no window of this size.
    pub(crate) fn new(geometry: &Geometry, log: &'l dyn Log) -> Option<Self> {
        const FULL: Window = ov7670::FULL_WINDOW;
        const FACTOR: u16 = Binning::Two.factor();
        let (width_px, height_px) = (
            geometry.width.checked_mul(FACTOR)?,
            u16::try_from(geometry.height).ok()?.checked_mul(FACTOR)?,
        );
        // In the middle. Two pixels share their colours.
        let is_whole = width_px.is_multiple_of(2 * FACTOR);
        let left_px = FULL.width_px.checked_sub(width_px)? / 2;
        let top_px = FULL.height_px.checked_sub(height_px)? / 2;
        let window = Window {
            left_px: left_px & !(2 * FACTOR - 1),
            top_px: top_px & !(FACTOR - 1),
            width_px,
            height_px,
            binning: Binning::Two,
        };
        is_whole.then(|| Self {
            both: Ov7670::new(SensorBus::new()),
            settings: SensorSettings {
                window,
                clock_hz: CLOCK_HZ,
                line_us: LINE_US,
                frame_lines: FRAME_LINES,
                exposure_us: EXPOSURE_US,
                gain_q4: 16,
                sync: FrameSync::FreeRunning,
                test_pattern: TestPattern::Off,
            },
            log,
            are_up: false,
            told: None,
        })
    }

    /// Sets the sensors up if they are not; returns whether they were not. Waits before the next attempt after one that
    /// has failed.
    ///
    /// # Errors
    /// The kind of what has failed. The reason is told, once.
    pub(crate) fn make_ready(&mut self) -> Result<bool, ErrorKind> {
        if self.are_up {
            return Ok(false);
        }
        let Ok(()) = reset_by_pin(&mut ResetPin::new(), ov7670::RESET, &mut Delay);
        let problem = self.both.set_up(&self.settings, &mut Delay).err();
        if problem.is_some() || self.told.is_some() {
            self.tell(problem);
        }
        let Some(problem) = problem else {
            self.are_up = true;
            return Ok(true);
        };
        // A reset of the board would not bring a sensor back.
        clock::feed();
        Delay.delay_us(RETRY_US);
        Err(problem.kind())
    }

    /// Asks the sensors whether they still are set up.
    pub(crate) fn check(&mut self) {
        self.are_up &= self.both.is_set_up() == Ok(true);
    }

    /// Tells a problem, or that there is none any more, unless that was told last.
    #[inline(never)]
    fn tell(&mut self, problem: Option<Problem>) {
        let missing = match problem {
            Some(SensorError::Nack(BusError::NoAcknowledge(sides))) => sides as u32,
            _ => 0,
        };
        LEDS.write(LEDS_RUNNING | missing << LED_LEFT_SENSOR);
        if self.told != problem {
            self.told = problem;
            self.log.tell(News::Sensors(problem));
        }
    }
}
