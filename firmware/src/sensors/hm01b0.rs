//! HM01B0 of Himax: 324x324 px, rolling shutter, 8 bits of grey.
//!
//! The crate `hm01b0` names its registers and brings it up with values that are known to give good
//! pictures. What it has no names for follows the data sheet, as the drivers of OpenMV and
//! PicoHM01B0 quote it.
//!
//! A pixel lasts two clocks, and a line at least 376 pixels. The sensor has two windows, whose
//! place it does not let choose: [`FULL_WINDOW`] and [`QVGA_WINDOW`], either binned by two or not.
//! The pixel clock runs between lines as well, so that a port sees the sync signals.
//!
//! With [`FrameSync::Triggered`] the sensor exposes and sends a frame for each rise of its pin
//! TRIG: on one wire, both of a pair begin at the same time.

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::I2c;
// `::` is for the crate, of which this module has the name.
use ::hm01b0::{Error, Exposure, MODEL_ID, Mode, TestPattern as Pattern, registers};

use super::error::{SensorError, Setting, SettingError};
use super::sensor::Sensor;
use super::settings::{Binning, FrameSync, SensorSettings, TestPattern, Window};

/// Whole picture: 324x324 px.
pub const FULL_WINDOW: Window = Window {
    left_px: 0,
    top_px: 0,
    width_px: 324,
    height_px: 324,
    binning: Binning::None,
};

/// Fewer rows: 324x244 px.
pub const QVGA_WINDOW: Window = Window {
    height_px: 244,
    ..FULL_WINDOW
};

// Registers for which the driver has no names.
const FRAME_LENGTH_LINES_HIGH: u16 = 0x0340;
const FRAME_LENGTH_LINES_LOW: u16 = 0x0341;
const LINE_LENGTH_HIGH: u16 = 0x0342;
const LINE_LENGTH_LOW: u16 = 0x0343;
const READOUT_X: u16 = 0x0383;
const READOUT_Y: u16 = 0x0387;
const BINNING_MODE: u16 = 0x0390;
const QVGA_WINDOW_ENABLE: u16 = 0x3010;
/// Value of [`READOUT_X`], [`READOUT_Y`] and [`BINNING_MODE`].
const BINNED_BY_TWO: u8 = 3;
/// Bits of [`registers::OSC_CLK_DIV`]: the clock divider, its value for 2, and the gating of the
/// pixel clock between lines.
const CLOCK_DIVIDER: u8 = 0b11;
const DIVIDED_BY_2: u8 = 0b10;
const GATED_CLOCK: u8 = 1 << 5;

/// Clocks of a pixel.
const PIXEL_CLOCKS: u32 = 2;
const MIN_LINE_PX: u32 = 376;
const MIN_EXPOSURE_LINES: u16 = 2;
/// Most of the gain that is analogue: eight times.
const MAX_DOUBLINGS: u32 = 3;

/// An HM01B0.
#[derive(Debug)]
pub struct Hm01b0<B> {
    device: ::hm01b0::Hm01b0<B>,
}

impl<B: I2c> Hm01b0<B> {
    /// Takes the bus of a sensor, whose address is 0x24.
    pub fn new(bus: B) -> Self {
        Self {
            device: ::hm01b0::Hm01b0::new(bus),
        }
    }

    fn write_all(&mut self, plan: &Plan, delay: &mut impl DelayNs) -> Result<(), Error<B::Error>> {
        let device = &mut self.device;
        device.init(delay)?;
        device.modify_register(registers::OSC_CLK_DIV, |bits| {
            bits & !(GATED_CLOCK | CLOCK_DIVIDER) | DIVIDED_BY_2
        })?;
        let [line_high, line_low] = plan.line_px.to_be_bytes();
        let [frame_high, frame_low] = plan.frame_lines.to_be_bytes();
        for (register, value) in [
            (QVGA_WINDOW_ENABLE, plan.is_qvga.into()),
            (LINE_LENGTH_HIGH, line_high),
            (LINE_LENGTH_LOW, line_low),
            (FRAME_LENGTH_LINES_HIGH, frame_high),
            (FRAME_LENGTH_LINES_LOW, frame_low),
        ] {
            device.write_register(register, value)?;
        }
        // After the reset that `init` begins with, nothing is binned.
        if plan.is_binned {
            for register in [READOUT_X, READOUT_Y, BINNING_MODE] {
                device.write_register(register, BINNED_BY_TWO)?;
            }
        }
        device.set_exposure(&plan.exposure)?;
        if plan.pattern != Pattern::None {
            device.set_test_pattern(plan.pattern)?;
        }
        device.set_mode(plan.mode)
    }
}

impl<B: I2c> Sensor for Hm01b0<B> {
    type BusError = B::Error;

    /// Takes 100 ms if the sensor does not answer, because it is asked ten times.
    fn set_up(
        &mut self,
        settings: &SensorSettings,
        delay: &mut impl DelayNs,
    ) -> Result<(), SensorError<B::Error>> {
        let plan = Plan::new(settings)?;
        self.write_all(&plan, delay).map_err(of_driver)
    }

    fn is_set_up(&mut self) -> Result<bool, SensorError<B::Error>> {
        let mode = self.device.mode();
        let found = self.device.read_register(registers::MODE_SELECT);
        let found = found.map_err(of_driver)?;
        Ok(mode != Mode::Standby && found == mode as u8)
    }
}

fn of_driver<E: embedded_hal::i2c::Error>(error: Error<E>) -> SensorError<E> {
    match error {
        Error::I2c(error) => SensorError::of_bus(error),
        Error::ModelId { found } => SensorError::WrongChip {
            found,
            expected: MODEL_ID,
        },
        _ => SensorError::Driver,
    }
}

/// What follows from the settings.
struct Plan {
    is_qvga: bool,
    is_binned: bool,
    line_px: u16,
    frame_lines: u16,
    exposure: Exposure,
    pattern: Pattern,
    mode: Mode,
}

impl Plan {
    fn new(settings: &SensorSettings) -> Result<Self, SettingError> {
        let SensorSettings {
            window,
            frame_lines,
            gain_q4,
            ..
        } = *settings;
        let (full, qvga) = (FULL_WINDOW.height_px, QVGA_WINDOW.height_px);
        let width = u32::from(FULL_WINDOW.width_px);
        Setting::Left.within(window.left_px, 0..=0)?;
        Setting::Top.within(window.top_px, 0..=0)?;
        Setting::Width.within(window.width_px, width..=width)?;
        Setting::Height.within_steps(window.height_px, qvga.into()..=full.into(), full - qvga)?;
        Setting::Binning.within(window.binning.factor(), 1..=2)?;
        let (is_qvga, is_binned) = (window.height_px == qvga, window.binning == Binning::Two);
        Setting::Clock.within(settings.clock_hz, PIXEL_CLOCKS..=u32::MAX)?;
        let pixel_hz = settings.clock_hz / PIXEL_CLOCKS;
        let line_px = settings.line_clocks(pixel_hz, MIN_LINE_PX..=u16::MAX.into())?;
        let min_frame_lines = match (is_binned, is_qvga) {
            // By measurement of the library PicoHM01B0; the data sheet does not tell for all rows.
            (true, _) => 172,
            (false, true) => 260,
            (false, false) => 344,
        };
        Setting::FrameLines.within(frame_lines, min_frame_lines..=u16::MAX.into())?;
        let lines = MIN_EXPOSURE_LINES..=frame_lines - 2;
        let (integration_lines, _) = settings.exposure(pixel_hz, line_px, lines)?;
        Setting::Gain.within(gain_q4, 16..=16 * 31)?;
        let doublings = (gain_q4 / 16).checked_ilog2().unwrap_or(0);
        let doublings = doublings.min(MAX_DOUBLINGS);
        let digital_gain_q6 = (gain_q4 * 4) >> doublings;
        Ok(Self {
            is_qvga,
            is_binned,
            line_px: line_px as u16,
            frame_lines,
            exposure: Exposure {
                integration_lines,
                analog_gain: (doublings as u8) << 4,
                digital_gain: digital_gain_q6 << 2,
            },
            pattern: match settings.test_pattern {
                TestPattern::Off => Pattern::None,
                TestPattern::ColourBars => Pattern::ColorBar,
                TestPattern::WalkingOnes => Pattern::WalkingOnes,
                other => return Err(SettingError::TestPattern(other)),
            },
            mode: match settings.sync {
                FrameSync::FreeRunning => Mode::Streaming,
                FrameSync::Triggered => Mode::Trigger,
                FrameSync::Slave => return Err(SettingError::Sync(FrameSync::Slave)),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::testing::{are_refused, each_step_may_fail, on_bus, out_of_bounds};
    use embedded_hal_mock::eh1::delay::{CheckedDelay, NoopDelay, Transaction as Delay};
    use embedded_hal_mock::eh1::i2c::{Mock, Transaction};
    use std::vec;
    use std::vec::Vec;

    const TRIGGERED: SensorSettings = SensorSettings {
        window: QVGA_WINDOW,
        clock_hz: 8_000_000,
        line_us: 3750,
        frame_lines: 260,
        exposure_us: 30_000,
        gain_q4: 16,
        sync: FrameSync::Triggered,
        test_pattern: TestPattern::Off,
    };

    /// What is written after the reset, whatever the settings: the values of Google's firmware for
    /// the Coral Dev Board Micro (`SetDefaultRegisters` in its `camera.cc`), and no detection of
    /// motion.
    const BROUGHT_UP: [(u16, u8); 47] = [
        (0x1003, 0x08),
        (0x1007, 0x08),
        (0x3044, 0x0a),
        (0x3045, 0x00),
        (0x3047, 0x0a),
        (0x3050, 0xc0),
        (0x3051, 0x42),
        (0x3052, 0x50),
        (0x3053, 0x00),
        (0x3054, 0x03),
        (0x3055, 0xf7),
        (0x3056, 0xf8),
        (0x3057, 0x29),
        (0x3058, 0x1f),
        (0x3059, 0x1e),
        (0x1000, 0x43), // black level calibration: on
        (0x1001, 0x40),
        (0x1002, 0x32),
        (0x0350, 0x7f),
        (0x1006, 0x01),
        (0x1008, 0x00),
        (0x1009, 0xa0),
        (0x100a, 0x60),
        (0x100b, 0x90),
        (0x100c, 0x40),
        (0x2000, 0x07),
        (0x2100, 0x01),
        (0x2101, 0x5f),
        (0x2102, 0x0a),
        (0x2103, 0x03),
        (0x2104, 0x05),
        (0x2105, 0x02),
        (0x2106, 0x14),
        (0x2107, 0x02),
        (0x2108, 0x03),
        (0x2109, 0x03),
        (0x210a, 0x00),
        (0x210b, 0x80),
        (0x210c, 0x40),
        (0x210d, 0x20),
        (0x210e, 0x03),
        (0x210f, 0x00),
        (0x2110, 0x85),
        (0x2111, 0x00),
        (0x2112, 0xa0),
        (0x2150, 0x00),
        (0x1012, 0x00),
    ];

    fn read(register: u16, value: u8) -> Transaction {
        Transaction::write_read(0x24, register.to_be_bytes().to_vec(), vec![value])
    }

    fn write((register, value): (u16, u8)) -> Transaction {
        let [high, low] = register.to_be_bytes();
        Transaction::write(0x24, vec![high, low, value])
    }

    /// The transactions of a set-up, with the registers that depend on settings. The numbers of
    /// registers and their bits are those that OpenMV's `hm01b0_regs.h` and PicoHM01B0 quote of the
    /// data sheet.
    fn script(registers: &[(u16, u8)]) -> Vec<Transaction> {
        let mut script = vec![
            read(0x0000, 0x01),
            read(0x0001, 0xb0),
            write((0x0103, 0x00)), // reset
            read(0x3060, 0x08),
            write((0x3060, 0x28)),
        ];
        script.extend(BROUGHT_UP.map(write));
        // Bit 5, gating, is clear again, and bits 1:0 divide the clock by two.
        script.extend([read(0x3060, 0x28), write((0x3060, 0x0a))]);
        script.extend(registers.iter().copied().map(write));
        script
    }

    /// 30 000 clocks are 15 000 px; eight lines of exposure.
    const OF_TRIGGERED: [(u16, u8); 14] = [
        (0x3010, 0x01), // window of 324x244
        (0x0342, 0x3a), // 15 000
        (0x0343, 0x98),
        (0x0340, 0x01), // 260
        (0x0341, 0x04),
        (0x0104, 0x01), // hold
        (0x2100, 0x00), // no automatic exposure
        (0x0202, 0x00),
        (0x0203, 0x08),
        (0x0205, 0x00), // once
        (0x020e, 0x01), // once, in 2.6 bits from bit 2 on
        (0x020f, 0x00),
        (0x0104, 0x00),
        (0x0100, 0x05), // waits for its trigger
    ];

    /// 1200 clocks are 600 px; 100 lines of exposure. Three times is 2 x 1.5.
    const STREAMING: (SensorSettings, [(u16, u8); 24]) = (
        SensorSettings {
            window: Window {
                binning: Binning::Two,
                ..FULL_WINDOW
            },
            clock_hz: 24_000_000,
            line_us: 50,
            frame_lines: 200,
            exposure_us: 5000,
            gain_q4: 48,
            sync: FrameSync::FreeRunning,
            test_pattern: TestPattern::WalkingOnes,
        },
        [
            (0x3010, 0x00),
            (0x0342, 0x02), // 600
            (0x0343, 0x58),
            (0x0340, 0x00), // 200
            (0x0341, 0xc8),
            (0x0383, 0x03), // binned by two
            (0x0387, 0x03),
            (0x0390, 0x03),
            (0x0104, 0x01),
            (0x2100, 0x00),
            (0x0202, 0x00),
            (0x0203, 0x64),
            (0x0205, 0x10), // twice
            (0x020e, 0x01), // 1.5
            (0x020f, 0x80),
            (0x0104, 0x00),
            (0x2100, 0x00), // what would change the pattern is off
            (0x1000, 0x00),
            (0x1008, 0x00),
            (0x0205, 0x00),
            (0x020e, 0x01),
            (0x020f, 0x00),
            (0x0601, 0x11), // walking ones
            (0x0100, 0x01), // streams
        ],
    );

    #[test]
    fn is_set_up_as_the_data_sheet_says() {
        let (streaming, of_streaming) = STREAMING;
        let scripts = [
            (TRIGGERED, script(&OF_TRIGGERED)),
            (streaming, script(&of_streaming)),
        ];
        for (settings, script) in scripts {
            let mut delay = CheckedDelay::new(&[Delay::delay_ms(10)]);
            let set_up = on_bus(&script, Hm01b0::new, |sensor| {
                sensor.set_up(&settings, &mut delay)
            });
            assert_eq!(set_up, Ok(()));
            delay.done();
        }
    }

    #[test]
    fn each_step_of_the_set_up_may_fail() {
        // Number and reset are tried ten times.
        each_step_may_fail(&script(&OF_TRIGGERED), 3, Hm01b0::new, &TRIGGERED);
    }

    #[test]
    fn another_chip_is_told() {
        // An HM0360, which has the same address.
        let attempt = [
            read(0x0000, 0x03),
            read(0x0001, 0x60),
            write((0x0103, 0x00)),
        ];
        let id: Vec<_> = (0..10).flat_map(|_| attempt.clone()).collect();
        let set_up = on_bus(&id, Hm01b0::new, |sensor| {
            sensor.set_up(&TRIGGERED, &mut NoopDelay::new())
        });
        let expected = SensorError::WrongChip {
            found: 0x0360,
            expected: 0x01b0,
        };
        assert_eq!(set_up, Err(expected));
    }

    #[test]
    fn a_sensor_that_was_reset_is_not_set_up() {
        let first = on_bus(&[read(0x0100, 0)], Hm01b0::new, Hm01b0::is_set_up);
        assert_eq!(first, Ok(false));
        let mut transactions = script(&OF_TRIGGERED);
        // It waits for its trigger; it is in standby, as after a reset; it streams.
        transactions.extend([0x05, 0x00, 0x01].map(|mode| read(0x0100, mode)));
        on_bus(&transactions, Hm01b0::<Mock>::new, |sensor| {
            sensor.set_up(&TRIGGERED, &mut NoopDelay::new()).unwrap();
            for is_set_up in [true, false, false] {
                assert_eq!(sensor.is_set_up(), Ok(is_set_up));
            }
        });
    }

    #[test]
    fn what_the_sensor_cannot_do_is_refused_before_anything_is_written() {
        let triggered = |window: Window| SensorSettings {
            window,
            ..TRIGGERED
        };
        let mut cases = vec![];
        let moved = Window {
            left_px: 2,
            ..QVGA_WINDOW
        };
        cases.push((triggered(moved), out_of_bounds(Setting::Left, 2, 0, 0, 1)));
        let lowered = Window {
            top_px: 40,
            ..QVGA_WINDOW
        };
        cases.push((triggered(lowered), out_of_bounds(Setting::Top, 40, 0, 0, 1)));
        let narrow = Window {
            width_px: 320,
            ..QVGA_WINDOW
        };
        cases.push((
            triggered(narrow),
            out_of_bounds(Setting::Width, 320, 324, 324, 1),
        ));
        for height_px in [0, 240, 245, 404] {
            let window = Window {
                height_px,
                ..QVGA_WINDOW
            };
            let error = out_of_bounds(Setting::Height, height_px.into(), 244, 324, 80);
            cases.push((triggered(window), error));
        }
        let binned = Window {
            binning: Binning::Four,
            ..QVGA_WINDOW
        };
        cases.push((
            triggered(binned),
            out_of_bounds(Setting::Binning, 4, 1, 2, 1),
        ));
        for clock_hz in [0, 1] {
            let settings = SensorSettings {
                clock_hz,
                ..TRIGGERED
            };
            let error = out_of_bounds(Setting::Clock, clock_hz, 2, u32::MAX, 1);
            cases.push((settings, error));
        }
        // 376 and 65 535 px at 4 MHz.
        for line_us in [0, 93, 16_384, u32::MAX] {
            let settings = SensorSettings {
                line_us,
                ..TRIGGERED
            };
            cases.push((
                settings,
                out_of_bounds(Setting::Line, line_us, 94, 16_383, 1),
            ));
        }
        for (window, least) in [(QVGA_WINDOW, 260), (FULL_WINDOW, 344)] {
            let settings = SensorSettings {
                frame_lines: least - 1,
                ..triggered(window)
            };
            let (value, min) = ((least - 1).into(), least.into());
            let error = out_of_bounds(Setting::FrameLines, value, min, 65_535, 1);
            cases.push((settings, error));
        }
        // 2 lines, and 260 - 2.
        for exposure_us in [0, 7499, 967_501, u32::MAX] {
            let settings = SensorSettings {
                exposure_us,
                ..TRIGGERED
            };
            let error = out_of_bounds(Setting::Exposure, exposure_us, 7500, 967_500, 1);
            cases.push((settings, error));
        }
        for gain_q4 in [0, 15, 497, u16::MAX] {
            let settings = SensorSettings {
                gain_q4,
                ..TRIGGERED
            };
            cases.push((
                settings,
                out_of_bounds(Setting::Gain, gain_q4.into(), 16, 496, 1),
            ));
        }
        let sync = FrameSync::Slave;
        let settings = SensorSettings { sync, ..TRIGGERED };
        cases.push((settings, SettingError::Sync(sync)));
        let test_pattern = TestPattern::FadingBars;
        let settings = SensorSettings {
            test_pattern,
            ..TRIGGERED
        };
        cases.push((settings, SettingError::TestPattern(test_pattern)));
        are_refused(Hm01b0::new, &cases);
    }

    /// The product of both gains is the one that was asked for, or less by under 1/64 of the
    /// digital one.
    #[test]
    fn gains_are_those_of_the_settings() {
        for gain_q4 in 16..=496_u16 {
            let settings = SensorSettings {
                gain_q4,
                ..TRIGGERED
            };
            let exposure = Plan::new(&settings).unwrap().exposure;
            let analog = 1 << (exposure.analog_gain >> 4);
            let digital_q6 = exposure.digital_gain >> 2;
            assert_eq!(digital_q6 << 2, exposure.digital_gain);
            assert!(analog <= 8 && (64..256).contains(&digital_q6));
            let asked_q6 = gain_q4 * 4;
            assert!((0..analog).contains(&(asked_q6 - analog * digital_q6)));
        }
    }
}
