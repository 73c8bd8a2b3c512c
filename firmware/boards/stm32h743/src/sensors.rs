//! Set-up of an HM01B0: a window of 324x244 px, line period as the matcher needs it, fixed
//! exposure.

use embassy_time::Delay;
use embedded_hal::i2c::I2c;
use hm01b0::{Error, Exposure, Hm01b0, Mode, registers};

/// Pixel clocks per millisecond: half the clock that is fed to the sensor.
const PIXEL_CLOCKS_PER_MS: u32 = 4000;
/// Lines per frame, including the gap.
const FRAME_LINES: u16 = 260;
/// Exposure of both sensors: with lines as long as here, 4 of them suit rooms. It is fixed, because
/// automatic exposures of the two sensors would drift apart.
const EXPOSURE: Exposure = Exposure {
    integration_lines: 4,
    analog_gain: 0,
    digital_gain: 0x100,
};

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

/// Sets up the sensor on `bus`, and leaves it waiting for its trigger. `line_us` is the line
/// period.
///
/// # Errors
/// An error of the bus, or an answer that is not that of an HM01B0.
pub fn start<B: I2c>(bus: B, line_us: u32) -> Result<(), Error<B::Error>> {
    let mut sensor = Hm01b0::new(bus);
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
    sensor.set_exposure(&EXPOSURE)?;
    sensor.set_mode(Mode::Trigger)
}
