//! Set-up of the two HM01B0: a window of 324x244 px, line period as the matcher needs it, fixed
//! exposure.
//!
//! A sensor is set up when a frame is asked for and it does not wait for its trigger: at the
//! start, when it answers late, and when it has lost its power since.

use embassy_stm32::i2c::{self, I2c};
use embassy_stm32::mode::Blocking;
use embassy_time::{Delay, Duration};
use embedded_hal::i2c::{ErrorType, Operation};
use vgstereo_firmware::camera::{Error, ErrorKind};
use vgstereo_firmware::sensors::hm01b0::{Hm01b0, QVGA_WINDOW};
use vgstereo_firmware::sensors::{
    FrameSync, Sensor as _, SensorError, SensorSettings, TestPattern,
};

use crate::rig::{FRAME_LINES, Rig};

/// Clock that is fed to the sensors.
const CLOCK_HZ: u32 = 8_000_000;
/// Time of exposure, which suits rooms.
const EXPOSURE_US: u32 = 30_000;

/// Longest wait for a step on a sensor's bus. The ten attempts of a set-up take less than the
/// watchdog waits.
const BUS_TIMEOUT: Duration = Duration::from_millis(10);

/// Returns how a sensor's bus is to be set up.
#[must_use]
pub fn bus_config() -> i2c::Config {
    let mut config = i2c::Config::default();
    config.timeout = BUS_TIMEOUT;
    config
}

/// Bus of one sensor, as the chip's driver has it.
pub type Bus = I2c<'static, Blocking, i2c::Master>;

/// Bus of one sensor whose driver is not inlined into what uses it: the test that looks for panics
/// could not tell the driver's from those of the set-up.
struct SensorBus(Bus);

impl ErrorType for SensorBus {
    type Error = i2c::Error;
}

impl embedded_hal::i2c::I2c for SensorBus {
    #[inline(never)]
    fn read(&mut self, address: u8, bytes: &mut [u8]) -> Result<(), i2c::Error> {
        self.0.read(address, bytes)
    }

    #[inline(never)]
    fn write(&mut self, address: u8, bytes: &[u8]) -> Result<(), i2c::Error> {
        self.0.write(address, bytes)
    }

    #[inline(never)]
    fn write_read(&mut self, address: u8, to: &[u8], from: &mut [u8]) -> Result<(), i2c::Error> {
        self.0.write_read(address, to, from)
    }

    #[inline(never)]
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), i2c::Error> {
        self.0.transaction(address, operations)
    }
}

/// Why a sensor is not ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotReady {
    /// Kind of the error for the session.
    pub kind: ErrorKind,
    /// Whether the bus works and no HM01B0 is there, or none that can do what is asked for, so that
    /// a reset of the board would change nothing.
    pub is_absent: bool,
}

/// Both sensors.
pub struct Sensors {
    left: Sensor,
    right: Sensor,
    settings: SensorSettings,
}

impl Sensors {
    /// Takes the buses of the sensors, which are not set up yet.
    pub fn new(left: Bus, right: Bus, rig: &Rig) -> Self {
        Self {
            left: Sensor::new("left", left),
            right: Sensor::new("right", right),
            settings: SensorSettings {
                window: QVGA_WINDOW,
                clock_hz: CLOCK_HZ,
                line_us: rig.line_us,
                frame_lines: FRAME_LINES,
                exposure_us: EXPOSURE_US,
                gain_q4: 16,
                sync: FrameSync::Triggered,
                test_pattern: TestPattern::Off,
            },
        }
    }

    /// Leaves both sensors waiting for their trigger: sets those up that do not. Takes up to a
    /// quarter of a second for each that does not answer.
    ///
    /// # Errors
    /// [`NotReady`] if a sensor does not answer or is none.
    pub fn make_ready(&mut self) -> Result<(), NotReady> {
        self.left.make_ready(&self.settings)?;
        self.right.make_ready(&self.settings)
    }

    /// Returns whether both sensors are still as they were set up. The port sees neither that the
    /// right one is gone, whose syncs it does not take, nor that one was gone for a while.
    pub fn are_ready(&mut self) -> bool {
        self.left.is_ready() && self.right.is_ready()
    }
}

/// One sensor.
struct Sensor {
    name: &'static str,
    device: Hm01b0<SensorBus>,
    /// Whether it was set up and has answered since.
    is_up: bool,
    /// Number of times that it was set up.
    setups: u32,
    /// Number of times that this failed.
    failures: u32,
}

impl Sensor {
    fn new(name: &'static str, bus: Bus) -> Self {
        Self {
            name,
            device: Hm01b0::new(SensorBus(bus)),
            is_up: false,
            setups: 0,
            failures: 0,
        }
    }

    /// Whether it was set up and still waits for its trigger.
    fn is_ready(&mut self) -> bool {
        let was_up = self.is_up;
        self.is_up = was_up && self.device.is_set_up() == Ok(true);
        if was_up && !self.is_up {
            defmt::warn!("the {} sensor was lost", self.name);
        }
        self.is_up
    }

    fn make_ready(&mut self, settings: &SensorSettings) -> Result<(), NotReady> {
        if self.is_ready() {
            return Ok(());
        }
        match self.device.set_up(settings, &mut Delay) {
            Ok(()) => {
                self.is_up = true;
                self.setups = self.setups.saturating_add(1);
                defmt::info!("the {} sensor is set up, set-up {}", self.name, self.setups);
                Ok(())
            }
            Err(error) => {
                self.failures = self.failures.saturating_add(1);
                let failures = self.failures;
                defmt::warn!("no {} sensor, failure {}: {}", self.name, failures, error);
                Err(NotReady {
                    kind: error.kind(),
                    is_absent: !matches!(error, SensorError::Bus(_)),
                })
            }
        }
    }
}
