//! MT9V034 of onsemi, before of Aptina: 752x480 px, global shutter, 10 bits of grey.
//!
//! Registers are written by its data sheet MT9V034/D, revision G, and its register reference. A
//! crate for it, `mt9v034-i2c` 0.1.5, is for embedded-hal 0.2.
//!
//! A line lasts a clock for each column of the window, and a gap of 61 (binned by two 71, by four
//! 91) to 1023 clocks, together at least 704. Frames are slowed down by
//! [`frame_lines`](SensorSettings::frame_lines). [`Binning`] slows the pixel clock down, not the
//! line. For `Grey8` connect DOUT9 to DOUT2.
//!
//! - [`FrameSync::FreeRunning`] is master mode. Its pins STFRM_OUT and STLN_OUT drive a slave.
//! - [`FrameSync::Triggered`] is snapshot mode: the rising edge at EXPOSURE starts an exposure,
//!   whose end the frame follows. Connected to one wire, both of a pair expose at the same time.
//! - [`FrameSync::Slave`] takes start and end of the exposure, and each line, from the pins
//!   EXPOSURE, STFRM_OUT and STLN_OUT. `exposure_us` and `frame_lines` have no effect.

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::I2c;

use super::error::{SensorError, Setting, SettingError};
use super::reset::ResetTiming;
use super::sensor::Sensor;
use super::settings::{Binning, FrameSync, SensorSettings, TestPattern, Window};

/// Whole picture: 752x480 px.
pub const FULL_WINDOW: Window = Window {
    left_px: 0,
    top_px: 0,
    width_px: WIDTH_PX,
    height_px: HEIGHT_PX,
    binning: Binning::None,
};

/// RESET_BAR is low for 750 ns, and 10 clocks later the bus may be used, 0.8 us at the slowest
/// clock.
pub const RESET: ResetTiming = ResetTiming {
    low_us: 1,
    settling_us: 1,
};

const WIDTH_PX: u16 = 752;
const HEIGHT_PX: u16 = 480;

const CHIP_VERSION: u8 = 0x00;
const MT9V034: u16 = 0x1324;
const COLUMN_START: u8 = 0x01;
const FIRST_COLUMN: u16 = 1;
const ROW_START: u8 = 0x02;
const FIRST_ROW: u16 = 4;
const WINDOW_HEIGHT: u8 = 0x03;
const WINDOW_WIDTH: u8 = 0x04;
const HORIZONTAL_BLANKING: u8 = 0x05;
const MAX_BLANKING_CLOCKS: u16 = 1023;
const MIN_LINE_CLOCKS: u16 = 704;
const VERTICAL_BLANKING: u8 = 0x06;
const MIN_BLANKING_ROWS: u16 = 4;
const MAX_BLANKING_ROWS: u16 = 32_288;
const CHIP_CONTROL: u8 = 0x07;
/// Bits of [`CHIP_CONTROL`]: correction of defective pixels, exposure during the readout, parallel
/// output; progressive scan of context A is all zeros.
const CHIP_CONTROL_BITS: u16 = 1 << 9 | 1 << 8 | 1 << 7;
/// Values of bits 3 and 4 of [`CHIP_CONTROL`].
const SLAVE: u16 = 0;
const MASTER: u16 = 1 << 3;
const SNAPSHOT: u16 = 3 << 3;
const COARSE_SHUTTER_WIDTH: u8 = 0x0b;
const EXPOSURE_LINES: [u16; 2] = [2, 32_765];
const RESET_REGISTER: u8 = 0x0c;
/// Bit of [`RESET_REGISTER`]: ends the current frame and starts a new one.
const RESET_LOGIC: u16 = 1;
const READ_MODE: u8 = 0x0d;
/// Bits of [`READ_MODE`] that are reserved, as they are after a reset.
const READ_MODE_BITS: u16 = 3 << 8;
/// Colour and high dynamic range, both of which are off.
const PIXEL_OPERATION_MODE: u8 = 0x0f;
const COMPANDING: u8 = 0x1c;
/// Linear conversion to 10 bits, for both contexts.
const LINEAR: u16 = 0x0202;
/// Dark offset; of the registers whose recommended value is not that after a reset, one to tell by
/// whether the sensor was reset.
const DARK_OFFSET: (u8, u16) = (0x24, 0x001b);
/// What the data sheet recommends for its reserved registers (table 8).
const RECOMMENDED: [(u8, u16); 5] = [
    (0x13, 0x2d2e),
    (0x20, 0x03c7),
    DARK_OFFSET,
    (0x2b, 0x0003),
    (0x2f, 0x0003),
];
const ANALOG_GAIN: u8 = 0x35;
const BLACK_LEVEL_CONTROL: u8 = 0x47;
/// Bit of [`BLACK_LEVEL_CONTROL`]: the black level is set by hand.
const BLACK_LEVEL_BY_HAND: u16 = 1;
const ROW_NOISE_CORRECTION: u8 = 0x70;
const TEST_PATTERN: u8 = 0x7f;
/// Bits of [`TEST_PATTERN`].
const TEST_ENABLE: u16 = 1 << 13;
const VERTICAL_SHADES: u16 = 1 << 11;
const HORIZONTAL_SHADES: u16 = 2 << 11;
const DIAGONAL_SHADES: u16 = 3 << 11;
const AUTOMATIC_EXPOSURE_AND_GAIN: u8 = 0xaf;
const FINE_SHUTTER_WIDTH: u8 = 0xd5;

/// An MT9V034.
#[derive(Debug)]
pub struct Mt9v034<B> {
    bus: B,
    address: u8,
}

impl<B: I2c> Mt9v034<B> {
    /// Takes the bus of a sensor with this address: 0x48, 0x4c, 0x58 or 0x5c, by its pins
    /// S_CTRL_ADR1 and S_CTRL_ADR0.
    pub const fn new(bus: B, address: u8) -> Self {
        Self { bus, address }
    }

    fn read(&mut self, register: u8) -> Result<u16, SensorError<B::Error>> {
        let mut value = [0; 2];
        let read = self.bus.write_read(self.address, &[register], &mut value);
        read.map_err(SensorError::of_bus)?;
        Ok(u16::from_be_bytes(value))
    }

    fn write(&mut self, register: u8, value: u16) -> Result<(), SensorError<B::Error>> {
        let [high, low] = value.to_be_bytes();
        let written = self.bus.write(self.address, &[register, high, low]);
        written.map_err(SensorError::of_bus)
    }
}

impl<B: I2c> Sensor for Mt9v034<B> {
    type BusError = B::Error;

    fn set_up(
        &mut self,
        settings: &SensorSettings,
        _: &mut impl DelayNs,
    ) -> Result<(), SensorError<B::Error>> {
        let registers = registers(settings)?;
        let found = self.read(CHIP_VERSION)?;
        if found != MT9V034 {
            return Err(SensorError::WrongChip {
                found,
                expected: MT9V034,
            });
        }
        for (register, value) in registers {
            self.write(register, value)?;
        }
        for (register, value) in RECOMMENDED {
            self.write(register, value)?;
        }
        let black_level = self.read(BLACK_LEVEL_CONTROL)?;
        self.write(BLACK_LEVEL_CONTROL, black_level & !BLACK_LEVEL_BY_HAND)?;
        self.write(RESET_REGISTER, RESET_LOGIC)
    }

    fn is_set_up(&mut self) -> Result<bool, SensorError<B::Error>> {
        let (register, value) = DARK_OFFSET;
        Ok(self.read(register)? == value)
    }
}

/// Returns the registers that follow from the settings, in the order in which they are written:
/// what starts a frame is first.
fn registers(settings: &SensorSettings) -> Result<[(u8, u16); 16], SettingError> {
    let SensorSettings {
        window, clock_hz, ..
    } = *settings;
    let factor = window.binning.factor();
    Setting::Width.within_steps(window.width_px, factor.into()..=WIDTH_PX.into(), factor)?;
    Setting::Height.within_steps(window.height_px, factor.into()..=HEIGHT_PX.into(), factor)?;
    Setting::Left.within(window.left_px, 0..=(WIDTH_PX - window.width_px).into())?;
    Setting::Top.within(window.top_px, 0..=(HEIGHT_PX - window.height_px).into())?;
    Setting::Clock.within(clock_hz, 13_000_000..=27_000_000)?;
    let (binning, min_blanking) = match window.binning {
        Binning::None => (0, 61),
        Binning::Two => (1, 71),
        Binning::Four => (2, 91),
    };
    let min_line = MIN_LINE_CLOCKS.max(window.width_px + min_blanking);
    let max_line = window.width_px + MAX_BLANKING_CLOCKS;
    let line_clocks = settings.line_clocks(clock_hz, min_line.into()..=max_line.into())?;
    let rows = window.height_px / factor;
    let frame_rows = settings.frame_lines;
    let bounds = rows + MIN_BLANKING_ROWS..=rows + MAX_BLANKING_ROWS;
    Setting::FrameLines.within(
        frame_rows,
        (*bounds.start()).into()..=(*bounds.end()).into(),
    )?;
    let [shortest, longest] = EXPOSURE_LINES;
    let lines = shortest..=longest.min(frame_rows - 2);
    let (coarse, fine) = settings.exposure(clock_hz, line_clocks, lines)?;
    Setting::Gain.within(settings.gain_q4, 16..=64)?;
    // From twice on only even numbers make a difference.
    let gain = if settings.gain_q4 < 32 {
        settings.gain_q4
    } else {
        settings.gain_q4 & !1
    };
    let (mode, blanking_rows) = match settings.sync {
        FrameSync::FreeRunning => (MASTER, frame_rows - rows),
        FrameSync::Triggered => (SNAPSHOT, frame_rows - rows),
        FrameSync::Slave => (SLAVE, MIN_BLANKING_ROWS),
    };
    let pattern = match settings.test_pattern {
        TestPattern::Off => 0,
        TestPattern::VerticalShades => TEST_ENABLE | VERTICAL_SHADES,
        TestPattern::HorizontalShades => TEST_ENABLE | HORIZONTAL_SHADES,
        TestPattern::DiagonalShades => TEST_ENABLE | DIAGONAL_SHADES,
        other => return Err(SettingError::TestPattern(other)),
    };
    Ok([
        (CHIP_CONTROL, CHIP_CONTROL_BITS | mode),
        (AUTOMATIC_EXPOSURE_AND_GAIN, 0),
        (COLUMN_START, FIRST_COLUMN + window.left_px),
        (ROW_START, FIRST_ROW + window.top_px),
        (WINDOW_HEIGHT, window.height_px),
        (WINDOW_WIDTH, window.width_px),
        (HORIZONTAL_BLANKING, line_clocks as u16 - window.width_px),
        (VERTICAL_BLANKING, blanking_rows),
        (COARSE_SHUTTER_WIDTH, coarse),
        (FINE_SHUTTER_WIDTH, fine as u16),
        (READ_MODE, READ_MODE_BITS | binning << 2 | binning),
        (PIXEL_OPERATION_MODE, 0),
        (COMPANDING, LINEAR),
        (ANALOG_GAIN, gain),
        // It would take the test pattern for a picture.
        (ROW_NOISE_CORRECTION, 0),
        (TEST_PATTERN, pattern),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::testing::{are_refused, each_step_may_fail, on_bus, out_of_bounds};
    use embedded_hal_mock::eh1::delay::NoopDelay;
    use embedded_hal_mock::eh1::i2c::{Mock, Transaction};
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    const WHOLE: SensorSettings = SensorSettings {
        window: FULL_WINDOW,
        clock_hz: 27_000_000,
        line_us: 32,
        frame_lines: 525,
        exposure_us: 5000,
        gain_q4: 40,
        sync: FrameSync::FreeRunning,
        test_pattern: TestPattern::Off,
    };

    /// The transactions of a set-up, with the registers that depend on settings. Numbers are those
    /// of the data sheet MT9V034/D, revision G: table 7 (p. 21) has the registers, table 8 (p. 22)
    /// recommends values of reserved ones, R0x47 is on p. 37 and R0x0C on p. 40. The chip's version
    /// and the bits of R0x07, R0x0D, R0x0F and R0x7F are those of the register reference.
    fn script(address: u8, registers: [(u8, u16); 16]) -> Vec<Transaction> {
        let write = |(register, value): (u8, u16)| {
            let [high, low] = value.to_be_bytes();
            Transaction::write(address, vec![register, high, low])
        };
        let read = |register, value: u16| {
            Transaction::write_read(address, vec![register], value.to_be_bytes().to_vec())
        };
        let mut script = vec![read(0x00, 0x1324)];
        script.extend(registers.map(write));
        script.extend(
            [
                (0x13, 0x2d2e),
                (0x20, 0x03c7),
                (0x24, 0x001b),
                (0x2b, 0x0003),
                (0x2f, 0x0003),
            ]
            .map(write),
        );
        // The calibration of the black level is automatic while bit 0 is clear; the others stay.
        script.extend([read(0x47, 0x8081), write((0x47, 0x8080))]);
        script.push(write((0x0c, 0x0001)));
        script
    }

    /// A row is R0x04 + R0x05 = 864 clocks (table 4, p. 14), which are 32 us. 135 000 clocks of
    /// exposure are 156 rows and 216 clocks (EQ 2, p. 29), and 480 + 45 rows a frame. The gain is
    /// R0x35 / 16 (p. 35).
    fn whole_script() -> Vec<Transaction> {
        script(
            0x48,
            [
                (0x07, 0x0388), // master: bit 3
                (0xaf, 0x0000),
                (0x01, 1),
                (0x02, 4),
                (0x03, 480),
                (0x04, 752),
                (0x05, 112),
                (0x06, 45),
                (0x0b, 156),
                (0xd5, 216),
                (0x0d, 0x0300),
                (0x0f, 0x0000),
                (0x1c, 0x0202),
                (0x35, 40),
                (0x70, 0x0000),
                (0x7f, 0x0000),
            ],
        )
    }

    /// 800 clocks are 40 us at 20 MHz. Rows that are binned by two are half as many: 200 + 50 are a
    /// frame. 80 000 clocks of exposure are 100 rows.
    const TRIGGERED: (SensorSettings, [(u8, u16); 16]) = (
        SensorSettings {
            window: Window {
                left_px: 56,
                top_px: 20,
                width_px: 640,
                height_px: 400,
                binning: Binning::Two,
            },
            clock_hz: 20_000_000,
            line_us: 40,
            frame_lines: 250,
            exposure_us: 4000,
            gain_q4: 24,
            sync: FrameSync::Triggered,
            test_pattern: TestPattern::VerticalShades,
        },
        [
            (0x07, 0x0398), // snapshot: bits 4 and 3
            (0xaf, 0x0000),
            (0x01, 57),
            (0x02, 24),
            (0x03, 400),
            (0x04, 640),
            (0x05, 160),
            (0x06, 50),
            (0x0b, 100),
            (0xd5, 0),
            (0x0d, 0x0305), // bits 3:2 and 1:0
            (0x0f, 0x0000),
            (0x1c, 0x0202),
            (0x35, 24),
            (0x70, 0x0000),
            (0x7f, 0x2800), // bits 13 and 12:11
        ],
    );

    /// 1008 clocks are 42 us at 24 MHz, and 48 000 are 47 rows and 624 clocks. In slave mode the
    /// gap is to be 4 rows (p. 25). Of gains from twice on, odd ones are as the even ones below
    /// them (p. 35).
    const SLAVE_OF_ANOTHER: (SensorSettings, [(u8, u16); 16]) = (
        SensorSettings {
            window: Window {
                binning: Binning::Four,
                ..FULL_WINDOW
            },
            clock_hz: 24_000_000,
            line_us: 42,
            frame_lines: 130,
            exposure_us: 2000,
            gain_q4: 63,
            sync: FrameSync::Slave,
            test_pattern: TestPattern::DiagonalShades,
        },
        [
            (0x07, 0x0380), // slave: bits 4 and 3 clear
            (0xaf, 0x0000),
            (0x01, 1),
            (0x02, 4),
            (0x03, 480),
            (0x04, 752),
            (0x05, 256),
            (0x06, 4),
            (0x0b, 47),
            (0xd5, 624),
            (0x0d, 0x030a),
            (0x0f, 0x0000),
            (0x1c, 0x0202),
            (0x35, 62),
            (0x70, 0x0000),
            (0x7f, 0x3800),
        ],
    );

    fn new(bus: Mock) -> Mt9v034<Mock> {
        Mt9v034::new(bus, 0x48)
    }

    #[test]
    fn is_set_up_as_the_data_sheet_says() {
        let (triggered, registers) = TRIGGERED;
        let (slave, of_slave) = SLAVE_OF_ANOTHER;
        for (settings, address, script) in [
            (WHOLE, 0x48, whole_script()),
            (triggered, 0x5c, script(0x5c, registers)),
            (slave, 0x4c, script(0x4c, of_slave)),
        ] {
            let set_up = on_bus(
                &script,
                |bus| Mt9v034::new(bus, address),
                |sensor| sensor.set_up(&settings, &mut NoopDelay::new()),
            );
            assert_eq!(set_up, Ok(()));
        }
    }

    #[test]
    fn each_step_of_the_set_up_may_fail() {
        each_step_may_fail(&whole_script(), 0, new, &WHOLE);
    }

    #[test]
    fn another_chip_is_told_and_left_alone() {
        // An MT9V032, revision 3.
        let id = [Transaction::write_read(0x48, vec![0x00], vec![0x13, 0x13])];
        let set_up = on_bus(&id, new, |sensor| {
            sensor.set_up(&WHOLE, &mut NoopDelay::new())
        });
        let expected = SensorError::WrongChip {
            found: 0x1313,
            expected: 0x1324,
        };
        assert_eq!(set_up, Err(expected));
    }

    #[test]
    fn a_sensor_that_was_reset_is_not_set_up() {
        // R0x24 is 0x0010 after a reset (table 8).
        for (value, is_set_up) in [(0x1b, true), (0x10, false), (0xff, false)] {
            let read = Transaction::write_read(0x48, vec![0x24], vec![0, value]);
            let found = on_bus(&[read], new, Mt9v034::is_set_up);
            assert_eq!(found, Ok(is_set_up));
        }
    }

    #[test]
    fn what_the_sensor_cannot_do_is_refused_before_anything_is_written() {
        let whole = |window: Window| SensorSettings { window, ..WHOLE };
        let mut cases = vec![];
        for width_px in [0, 753, u16::MAX] {
            let window = Window {
                width_px,
                ..FULL_WINDOW
            };
            let error = out_of_bounds(Setting::Width, width_px.into(), 1, 752, 1);
            cases.push((whole(window), error));
        }
        let binned = Window {
            height_px: 478,
            binning: Binning::Four,
            ..FULL_WINDOW
        };
        cases.push((
            whole(binned),
            out_of_bounds(Setting::Height, 478, 4, 480, 4),
        ));
        let moved = Window {
            left_px: 1,
            ..FULL_WINDOW
        };
        cases.push((whole(moved), out_of_bounds(Setting::Left, 1, 0, 0, 1)));
        let lowered = Window {
            top_px: 300,
            height_px: 240,
            ..FULL_WINDOW
        };
        cases.push((whole(lowered), out_of_bounds(Setting::Top, 300, 0, 240, 1)));
        for clock_hz in [0, 12_999_999, 27_000_001, u32::MAX] {
            let settings = SensorSettings { clock_hz, ..WHOLE };
            let error = out_of_bounds(Setting::Clock, clock_hz, 13_000_000, 27_000_000, 1);
            cases.push((settings, error));
        }
        // 752 + 61 clocks are 30.1 us, and 752 + 1023 are 65.7 us.
        for line_us in [0, 30, 66, u32::MAX] {
            let settings = SensorSettings { line_us, ..WHOLE };
            cases.push((settings, out_of_bounds(Setting::Line, line_us, 31, 65, 1)));
        }
        // Of a narrow window the line is 704 clocks at least, 26.1 us.
        let narrow = Window {
            width_px: 320,
            ..FULL_WINDOW
        };
        let settings = SensorSettings {
            line_us: 26,
            ..whole(narrow)
        };
        cases.push((settings, out_of_bounds(Setting::Line, 26, 27, 49, 1)));
        for frame_lines in [0, 483, 32_769, u16::MAX] {
            let settings = SensorSettings {
                frame_lines,
                ..WHOLE
            };
            let error = out_of_bounds(Setting::FrameLines, frame_lines.into(), 484, 32_768, 1);
            cases.push((settings, error));
        }
        // 2 rows of 32 us, and 525 - 2 (EQ 1, p. 15).
        for exposure_us in [0, 63, 16_737, u32::MAX] {
            let settings = SensorSettings {
                exposure_us,
                ..WHOLE
            };
            let error = out_of_bounds(Setting::Exposure, exposure_us, 64, 16_736, 1);
            cases.push((settings, error));
        }
        for gain_q4 in [0, 15, 65, u16::MAX] {
            let settings = SensorSettings { gain_q4, ..WHOLE };
            cases.push((
                settings,
                out_of_bounds(Setting::Gain, gain_q4.into(), 16, 64, 1),
            ));
        }
        let settings = SensorSettings {
            test_pattern: TestPattern::ColourBars,
            ..WHOLE
        };
        let error = SettingError::TestPattern(TestPattern::ColourBars);
        cases.push((settings, error));
        are_refused(new, &cases);
    }

    /// Whatever is accepted lasts as long as it was asked to, by the equations of the data sheet.
    #[test]
    fn times_are_those_of_the_settings() {
        let mut generator = Pcg32::seed_from_u64(1);
        let mut below = |bound: u32| generator.next_u32() % bound;
        let mut accepted = 0;
        for _ in 0..20_000 {
            let binning = [Binning::None, Binning::Two, Binning::Four][below(3) as usize];
            let settings = SensorSettings {
                window: Window {
                    left_px: 0,
                    top_px: 0,
                    width_px: 4 + 4 * below(188) as u16,
                    height_px: 4 + 4 * below(120) as u16,
                    binning,
                },
                clock_hz: 13_000_000 + below(14_000_001),
                line_us: 20 + below(90),
                frame_lines: below(65_536) as u16 >> below(9),
                exposure_us: below(1 << 21) >> below(12),
                ..WHOLE
            };
            let Ok(registers) = registers(&settings) else {
                continue;
            };
            accepted += 1;
            let value = |register| {
                let mut found = registers.iter().filter(|(number, _)| *number == register);
                u64::from(found.next().unwrap().1)
            };
            let hz = u64::from(settings.clock_hz);
            let row = value(0x04) + value(0x05);
            let asked = u64::from(settings.line_us) * hz;
            assert!((row - 1) * 1_000_000 < asked && asked <= row * 1_000_000);
            assert!(row >= 704 && (61..=1023).contains(&value(0x05)));
            let rows = value(0x03) / u64::from(binning.factor()) + value(0x06);
            assert_eq!(rows, u64::from(settings.frame_lines));
            let exposure = value(0x0b) * row + value(0xd5);
            let asked = u64::from(settings.exposure_us) * hz;
            assert!(exposure * 1_000_000 <= asked && asked < (exposure + 1) * 1_000_000);
            assert!(exposure <= (rows - 2) * row && value(0xd5) < row);
            assert!((2..=32_765).contains(&value(0x0b)));
        }
        assert!(accepted > 1000, "{accepted}");
    }
}
