//! Set-up of the two HM01B0: a window of 324x244 px, line period as the matcher needs it, fixed
//! exposure.
//!
//! A sensor is set up when a frame is asked for and it does not wait for its trigger: at the
//! start, when it answers late, and when it has lost its power since.

use embassy_stm32::i2c::{self, I2c};
use embassy_stm32::mode::Blocking;
use embassy_time::{Delay, Duration};
use hm01b0::{Error, Exposure, Hm01b0, Mode, registers};
use vgstereo_firmware::camera::ErrorKind;

use crate::rig::{FRAME_LINES, Rig};

/// Pixel clocks per millisecond: half the clock that is fed to the sensor.
const PIXEL_CLOCKS_PER_MS: u32 = 4000;
/// Time of exposure, which suits rooms. It is fixed, because automatic exposures of the two sensors
/// would drift apart.
const EXPOSURE_US: u32 = 30_000;

// Registers for which the driver has no names.
const FRAME_LENGTH_LINES_HIGH: u16 = 0x0340;
const FRAME_LENGTH_LINES_LOW: u16 = 0x0341;
const LINE_LENGTH_HIGH: u16 = 0x0342;
const LINE_LENGTH_LOW: u16 = 0x0343;
const QVGA_WINDOW: u16 = 0x3010;
/// Bits of [`registers::OSC_CLK_DIV`]: the clock divider, its value for 2, and the gating of the
/// pixel clock between lines. The port needs the clock there, to see the sync signals.
const CLOCK_DIVIDER: u8 = 0b11;
const DIVIDED_BY_2: u8 = 0b10;
const GATED_CLOCK: u8 = 1 << 5;

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

/// Bus of one sensor.
pub type Bus = I2c<'static, Blocking, i2c::Master>;

/// Why a sensor is not ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotReady {
    /// Kind of the error for the session.
    pub kind: ErrorKind,
    /// Whether the bus works and no HM01B0 is there, so that a reset of the board would change
    /// nothing.
    pub is_absent: bool,
}

/// Both sensors.
pub struct Sensors {
    left: Sensor,
    right: Sensor,
}

impl Sensors {
    /// Takes the buses of the sensors, which are not set up yet.
    pub fn new(left: Bus, right: Bus, rig: &Rig) -> Self {
        Self {
            left: Sensor::new("left", left, rig.line_us),
            right: Sensor::new("right", right, rig.line_us),
        }
    }

    /// Leaves both sensors waiting for their trigger: sets those up that do not. Takes up to a
    /// quarter of a second for each that does not answer.
    ///
    /// # Errors
    /// [`NotReady`] if a sensor does not answer or is none.
    pub fn make_ready(&mut self) -> Result<(), NotReady> {
        self.left.make_ready()?;
        self.right.make_ready()
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
    device: Hm01b0<Bus>,
    /// Period of a line, us.
    line_us: u32,
    /// Whether it was set up and has answered since.
    is_up: bool,
    /// Number of times that it was set up.
    setups: u32,
    /// Number of times that this failed.
    failures: u32,
}

impl Sensor {
    fn new(name: &'static str, bus: Bus, line_us: u32) -> Self {
        Self {
            name,
            device: Hm01b0::new(bus),
            line_us,
            is_up: false,
            setups: 0,
            failures: 0,
        }
    }

    /// Whether it was set up and still waits for its trigger. One that was unplugged has forgotten
    /// its mode.
    fn is_ready(&mut self) -> bool {
        let was_up = self.is_up;
        self.is_up =
            was_up && self.device.read_register(registers::MODE_SELECT) == Ok(Mode::Trigger as u8);
        if was_up && !self.is_up {
            defmt::warn!("the {} sensor was lost", self.name);
        }
        self.is_up
    }

    fn make_ready(&mut self) -> Result<(), NotReady> {
        if self.is_ready() {
            return Ok(());
        }
        match set_up(&mut self.device, self.line_us) {
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
                Err(match error {
                    Error::I2c(error) => NotReady {
                        kind: ErrorKind::Bus,
                        is_absent: error == i2c::Error::Nack,
                    },
                    _ => NotReady {
                        kind: ErrorKind::Other,
                        is_absent: true,
                    },
                })
            }
        }
    }
}

/// Sets a sensor up with this period of a line, us, and leaves it waiting for its trigger.
fn set_up(sensor: &mut Hm01b0<Bus>, line_us: u32) -> Result<(), Error<i2c::Error>> {
    sensor.init(&mut Delay)?;
    sensor.modify_register(registers::OSC_CLK_DIV, |bits| {
        bits & !(GATED_CLOCK | CLOCK_DIVIDER) | DIVIDED_BY_2
    })?;
    let line_clocks = (line_us * PIXEL_CLOCKS_PER_MS / 1000).min(u16::MAX.into()) as u16;
    let [line_high, line_low] = line_clocks.to_be_bytes();
    let [frame_high, frame_low] = FRAME_LINES.to_be_bytes();
    for (register, value) in [
        (QVGA_WINDOW, 1),
        (LINE_LENGTH_HIGH, line_high),
        (LINE_LENGTH_LOW, line_low),
        (FRAME_LENGTH_LINES_HIGH, frame_high),
        (FRAME_LENGTH_LINES_LOW, frame_low),
    ] {
        sensor.write_register(register, value)?;
    }
    sensor.set_exposure(&Exposure {
        integration_lines: (EXPOSURE_US / line_us) as u16,
        analog_gain: 0,
        digital_gain: 0x100,
    })?;
    sensor.set_mode(Mode::Trigger)
}
