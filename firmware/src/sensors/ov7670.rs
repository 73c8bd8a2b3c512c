//! OV7670 of OmniVision: 640x480 px, rolling shutter, colour as `Yuv422`.
//!
//! Registers are written by its data sheet and its implementation guide, as the Linux driver
//! `ov7670.c` and pico-jxglib's `OV7670.cpp` quote them. There is a crate for embedded-hal 1.0,
//! `ov7670` 0.1.0. It is not used: it reads with a repeated start, which OmniVision's bus (SCCB)
//! does not have, and it gives no access to scaling, clock, blanking, black level and test
//! patterns.
//!
//! A line lasts at least 784 pixels of two clocks, which a prescaler divides by 1 to 64; a frame
//! has at least 510 lines, whatever the window. [`Binning`] is down-sampling by two: a line of up
//! to 320 px is sent in every second period. The picture settles within ten frames after the
//! set-up.
//!
//! **The sensor has no trigger and is nobody's slave.** A pair must share clock and reset, or its
//! views drift apart in time. All these sensors have one address: two on one bus are set up as one
//! [`Ov7670`] and take each write at the same time, where two that are set up one by one start
//! their frames as far apart as that takes. What is read from two is both answers, joined by "and".

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::I2c;

use super::error::{SensorError, Setting, SettingError};
use super::reset::ResetTiming;
use super::sensor::Sensor;
use super::settings::{Binning, FrameSync, SensorSettings, TestPattern, Window};

/// Whole picture: 640x480 px.
pub const FULL_WINDOW: Window = Window {
    left_px: 0,
    top_px: 0,
    width_px: WIDTH_PX,
    height_px: HEIGHT_PX,
    binning: Binning::None,
};

/// The sensor needs 1 ms after a reset, by its pin as by its register.
pub const RESET: ResetTiming = ResetTiming {
    low_us: 1000,
    settling_us: 1000 * SETTLING_MS,
};

const SETTLING_MS: u32 = 1;
const WIDTH_PX: u16 = 640;
const HEIGHT_PX: u16 = 480;
/// Pixels of a line without dummy pixels, over which its columns are counted.
const LINE_PX: u16 = 784;
const MAX_DUMMY_PX: u16 = 0xfff;
const MAX_PRESCALER: u32 = 64;
/// Clocks of a pixel, which has two bytes.
const PIXEL_CLOCKS: u32 = 2;
/// Lines of a frame without dummy lines.
const FRAME_LINES: u16 = 510;

const ADDRESS: u8 = 0x21;
const OV7670: u16 = 0x7673;
const GAIN: u8 = 0x00;
const VREF: u8 = 0x03;
const COM1: u8 = 0x04;
const AECHH: u8 = 0x07;
const PID: u8 = 0x0a;
const VER: u8 = 0x0b;
const COM3: u8 = 0x0c;
const AECH: u8 = 0x10;
const CLKRC: u8 = 0x11;
/// Bit of [`CLKRC`] that is reserved, as it is after a reset.
const CLKRC_BIT: u8 = 1 << 7;
const COM7: u8 = 0x12;
/// Values of [`COM7`].
const RESET_REGISTERS: u8 = 1 << 7;
const YUV: u8 = 0;
/// Automatic exposure, gain and white balance are off; their speed is what remains, which is not
/// the value after a reset.
const COM8: (u8, u8) = (0x13, 0xc0);
const HSTART: u8 = 0x17;
const HSTOP: u8 = 0x18;
const VSTART: u8 = 0x19;
const VSTOP: u8 = 0x1a;
const EXHCH: u8 = 0x2a;
const EXHCL: u8 = 0x2b;
const HREF: u8 = 0x32;
/// Bits of [`HREF`]: offset of its edge, as it is after a reset.
const HREF_BITS: u8 = 2 << 6;
const TSLB: u8 = 0x3a;
/// Bits of [`TSLB`]: luma first, and the window does not follow the format.
const LUMA_FIRST: u8 = 0x04;
const COM13: u8 = 0x3d;
/// Bits of [`COM13`]: gamma, and U before V.
const U_FIRST: u8 = 0x88;
const COM14: u8 = 0x3e;
const COM15: u8 = 0x40;
/// Bits of [`COM15`]: levels of 0 to 255.
const FULL_RANGE: u8 = 0xc0;
const DBLV: u8 = 0x6b;
/// Bits of [`DBLV`]: no multiplied clock.
const NO_PLL: u8 = 0x0a;
const SCALING_XSC: u8 = 0x70;
const SCALING_YSC: u8 = 0x71;
/// Bit of [`SCALING_XSC`] and [`SCALING_YSC`], which make the number of a test pattern.
const PATTERN_BIT: u8 = 1 << 7;
const SCALING_DCWCTR: u8 = 0x72;
const SCALING_PCLK_DIV: u8 = 0x73;
const DM_LNL: u8 = 0x92;
const DM_LNH: u8 = 0x93;
const SCALING_PCLK_DELAY: u8 = 0xa2;
const ABLC1: u8 = 0xb1;
/// Bit of [`ABLC1`]: the black level is calibrated.
const BLACK_LEVEL_CALIBRATION: u8 = 1 << 2;
const THL_ST: u8 = 0xb3;
/// Level to which black is calibrated, as it is after a reset.
const BLACK_LEVEL: u8 = 0x80;

/// An OV7670, or two that share a bus.
#[derive(Debug)]
pub struct Ov7670<B> {
    bus: B,
}

impl<B: I2c> Ov7670<B> {
    /// Takes the bus of a sensor, whose address is 0x21.
    pub const fn new(bus: B) -> Self {
        Self { bus }
    }

    /// Reads as SCCB has it: the bus is free between register and value.
    fn read(&mut self, register: u8) -> Result<u8, SensorError<B::Error>> {
        let mut value = [0];
        let named = self.bus.write(ADDRESS, &[register]);
        let read = named.and_then(|()| self.bus.read(ADDRESS, &mut value));
        read.map_err(SensorError::of_bus)?;
        let [value] = value;
        Ok(value)
    }

    fn write(&mut self, register: u8, value: u8) -> Result<(), SensorError<B::Error>> {
        let written = self.bus.write(ADDRESS, &[register, value]);
        written.map_err(SensorError::of_bus)
    }
}

impl<B: I2c> Sensor for Ov7670<B> {
    type BusError = B::Error;

    fn set_up(
        &mut self,
        settings: &SensorSettings,
        delay: &mut impl DelayNs,
    ) -> Result<(), SensorError<B::Error>> {
        let registers = registers(settings)?;
        let found = u16::from_be_bytes([self.read(PID)?, self.read(VER)?]);
        if found != OV7670 {
            return Err(SensorError::WrongChip {
                found,
                expected: OV7670,
            });
        }
        self.write(COM7, RESET_REGISTERS)?;
        delay.delay_ms(SETTLING_MS);
        for (register, value) in registers {
            self.write(register, value)?;
        }
        Ok(())
    }

    fn is_set_up(&mut self) -> Result<bool, SensorError<B::Error>> {
        let (register, value) = COM8;
        Ok(self.read(register)? == value)
    }
}

/// What depends on the down-sampling.
struct Scaling {
    /// Numbers of the first column and row, by the Linux driver; those of the whole picture are by
    /// OmniVision, the others were found by trial.
    first: [u16; 2],
    com3: u8,
    com14: u8,
    clock_divider: u8,
}

/// Returns the registers that follow from the settings, in the order in which they are written.
fn registers(settings: &SensorSettings) -> Result<[(u8, u8); 30], SettingError> {
    let SensorSettings {
        window, clock_hz, ..
    } = *settings;
    let factor = window.binning.factor();
    Setting::Binning.within(factor, 1..=2)?;
    let scaling = match window.binning {
        Binning::None => Scaling {
            first: [158, 10],
            com3: 0x00,
            com14: 0x00,
            clock_divider: 0xf0,
        },
        Binning::Two | Binning::Four => Scaling {
            first: [168, 12],
            com3: 0x04,
            com14: 0x19,
            clock_divider: 0xf1,
        },
    };
    // Two pixels share their colours.
    let columns = 2 * factor;
    Setting::Width.within_steps(window.width_px, columns.into()..=WIDTH_PX.into(), columns)?;
    Setting::Height.within_steps(window.height_px, factor.into()..=HEIGHT_PX.into(), factor)?;
    let (max_left, max_top) = (WIDTH_PX - window.width_px, HEIGHT_PX - window.height_px);
    Setting::Left.within_steps(window.left_px, 0..=max_left.into(), columns)?;
    Setting::Top.within_steps(window.top_px, 0..=max_top.into(), factor)?;
    let [first_column, first_row] = scaling.first;
    let column_start = (first_column + window.left_px) % LINE_PX;
    let column_stop = (column_start + window.width_px) % LINE_PX;
    let row_start = first_row + window.top_px;
    let row_stop = row_start + window.height_px;

    Setting::Clock.within(clock_hz, 10_000_000..=48_000_000)?;
    let max_line_px = u32::from(LINE_PX + MAX_DUMMY_PX);
    let min_line = PIXEL_CLOCKS * u32::from(LINE_PX);
    let max_line = PIXEL_CLOCKS * max_line_px * MAX_PRESCALER;
    let line_clocks = settings.line_clocks(clock_hz, min_line..=max_line)?;
    let prescaler = line_clocks.div_ceil(PIXEL_CLOCKS * max_line_px).max(1);
    let line_px = line_clocks.div_ceil(PIXEL_CLOCKS * prescaler);
    let line_clocks = PIXEL_CLOCKS * prescaler * line_px;
    let [_, _, dummy_px_high, dummy_px_low] = (line_px - u32::from(LINE_PX)).to_be_bytes();

    let frame_lines = settings.frame_lines;
    Setting::FrameLines.within(frame_lines, FRAME_LINES.into()..=u16::MAX.into())?;
    let [dummy_lines_high, dummy_lines_low] = (frame_lines - FRAME_LINES).to_be_bytes();
    let (exposure, _) = settings.exposure(clock_hz, line_clocks, 1..=frame_lines - 2)?;

    // Each of the upper four bits doubles the gain, the lower four are sixteenths of it.
    Setting::Gain.within(settings.gain_q4, 16..=16 * 31)?;
    let doublings = (settings.gain_q4 / 16).checked_ilog2().unwrap_or(0);
    let sixteenths = (settings.gain_q4 >> doublings) - 16;
    let gain = ((1_u16 << doublings) - 1) << 4 | sixteenths;

    if settings.sync != FrameSync::FreeRunning {
        return Err(SettingError::Sync(settings.sync));
    }
    let (pattern_x, pattern_y) = match settings.test_pattern {
        TestPattern::Off => (0, 0),
        TestPattern::WalkingOnes => (PATTERN_BIT, 0),
        TestPattern::ColourBars => (0, PATTERN_BIT),
        TestPattern::FadingBars => (PATTERN_BIT, PATTERN_BIT),
        other => return Err(SettingError::TestPattern(other)),
    };
    let columns_low = (column_stop as u8 & 7) << 3 | column_start as u8 & 7;
    let rows_low = (row_stop as u8 & 3) << 2 | row_start as u8 & 3;
    Ok([
        (COM7, YUV),
        COM8,
        (CLKRC, CLKRC_BIT | (prescaler - 1) as u8),
        (DBLV, NO_PLL),
        (TSLB, LUMA_FIRST),
        (COM13, U_FIRST),
        (COM15, FULL_RANGE),
        (COM3, scaling.com3),
        (COM14, scaling.com14),
        (SCALING_XSC, 0x3a | pattern_x),
        (SCALING_YSC, 0x35 | pattern_y),
        (SCALING_DCWCTR, 0x11),
        (SCALING_PCLK_DIV, scaling.clock_divider),
        (SCALING_PCLK_DELAY, 0x02),
        (HSTART, (column_start >> 3) as u8),
        (HSTOP, (column_stop >> 3) as u8),
        (HREF, HREF_BITS | columns_low),
        (VSTART, (row_start >> 2) as u8),
        (VSTOP, (row_stop >> 2) as u8),
        (VREF, rows_low),
        (EXHCH, dummy_px_high << 4),
        (EXHCL, dummy_px_low),
        (DM_LNL, dummy_lines_low),
        (DM_LNH, dummy_lines_high),
        (ABLC1, BLACK_LEVEL_CALIBRATION),
        (THL_ST, BLACK_LEVEL),
        (GAIN, gain as u8),
        (AECHH, (exposure >> 10) as u8),
        (AECH, (exposure >> 2) as u8),
        (COM1, exposure as u8 & 3),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::testing::{are_refused, each_step_may_fail, on_bus, out_of_bounds};
    use embedded_hal_mock::eh1::delay::{CheckedDelay, NoopDelay, Transaction as Delay};
    use embedded_hal_mock::eh1::i2c::{Mock, Transaction};
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    const WHOLE: SensorSettings = SensorSettings {
        window: FULL_WINDOW,
        clock_hz: 24_000_000,
        line_us: 100,
        frame_lines: 510,
        exposure_us: 10_000,
        gain_q4: 16,
        sync: FrameSync::FreeRunning,
        test_pattern: TestPattern::Off,
    };

    /// The transactions of a set-up, with its registers. Numbers and bits of these are those of the
    /// data sheet's list of registers: PID is 0x76 and VER 0x73, and COM7[7] resets.
    fn script(registers: &[(u8, u8)]) -> Vec<Transaction> {
        let write = |&(register, value)| Transaction::write(0x21, vec![register, value]);
        let read = |register, value| {
            [
                Transaction::write(0x21, vec![register]),
                Transaction::read(0x21, vec![value]),
            ]
        };
        let mut script = [read(0x0a, 0x76), read(0x0b, 0x73)].concat();
        script.push(write(&(0x12, 0x80)));
        script.extend(registers.iter().map(write));
        script
    }

    /// 2400 clocks are 1200 pixels, 784 and 416 dummy ones; the exposure is 100 lines. Columns,
    /// rows and scaling are those of OmniVision's settings for 640x480 (implementation guide, table
    /// 2-2, and `ov7670_default_regs` of the Linux driver).
    const OF_WHOLE: [(u8, u8); 30] = [
        (0x12, 0x00), // COM7: YUV
        (0x13, 0xc0), // COM8: none of AGC, AWB, AEC
        (0x11, 0x80), // CLKRC: divided by 1
        (0x6b, 0x0a), // DBLV: PLL bypassed
        (0x3a, 0x04), // TSLB: Y first
        (0x3d, 0x88), // COM13: U before V
        (0x40, 0xc0), // COM15: 0x00 to 0xff
        (0x0c, 0x00), // COM3
        (0x3e, 0x00), // COM14
        (0x70, 0x3a), // SCALING_XSC
        (0x71, 0x35), // SCALING_YSC
        (0x72, 0x11), // SCALING_DCWCTR
        (0x73, 0xf0), // SCALING_PCLK_DIV
        (0xa2, 0x02), // SCALING_PCLK_DELAY
        (0x17, 0x13), // HSTART
        (0x18, 0x01), // HSTOP
        (0x32, 0xb6), // HREF
        (0x19, 0x02), // VSTRT
        (0x1a, 0x7a), // VSTOP
        (0x03, 0x0a), // VREF
        (0x2a, 0x10), // EXHCH: 416 = 0x1a0
        (0x2b, 0xa0), // EXHCL
        (0x92, 0x00), // DM_LNL
        (0x93, 0x00), // DM_LNH
        (0xb1, 0x04), // ABLC1: enabled
        (0xb3, 0x80), // THL_ST
        (0x00, 0x00), // GAIN: once
        (0x07, 0x00), // AECHH: 100 = 0x064
        (0x10, 0x19), // AECH
        (0x04, 0x00), // COM1
    ];

    /// A part of the picture, down-sampled. 45 000 clocks, divided by 5, are 4500 pixels: 784 and
    /// 3716 dummy ones. 2000 lines are 510 and 1490 dummy ones; 60 000 000 clocks are 1333 lines.
    /// The gain is 2 x 2 x (1 + 8 / 16) (implementation guide, table 4-1).
    const PART: (SensorSettings, [(u8, u8); 30]) = (
        SensorSettings {
            window: Window {
                left_px: 100,
                top_px: 50,
                width_px: 320,
                height_px: 240,
                binning: Binning::Two,
            },
            clock_hz: 12_000_000,
            line_us: 3750,
            frame_lines: 2000,
            exposure_us: 5_000_000,
            gain_q4: 96,
            sync: FrameSync::FreeRunning,
            test_pattern: TestPattern::ColourBars,
        },
        [
            (0x12, 0x00),
            (0x13, 0xc0),
            (0x11, 0x84), // divided by 4 + 1
            (0x6b, 0x0a),
            (0x3a, 0x04),
            (0x3d, 0x88),
            (0x40, 0xc0),
            (0x0c, 0x04), // DCW enable
            (0x3e, 0x19), // PCLK by 2
            (0x70, 0x3a),
            (0x71, 0xb5), // pattern 2: eight bars
            (0x72, 0x11), // both by 2
            (0x73, 0xf1), // by 2
            (0xa2, 0x02),
            (0x17, 0x21), // 168 + 100 = 8 * 0x21 + 4
            (0x18, 0x49), // 268 + 320 = 8 * 0x49 + 4
            (0x32, 0xa4),
            (0x19, 0x0f), // 12 + 50 = 4 * 0x0f + 2
            (0x1a, 0x4b), // 62 + 240 = 4 * 0x4b + 2
            (0x03, 0x0a),
            (0x2a, 0xe0), // 3716 = 0xe84
            (0x2b, 0x84),
            (0x92, 0xd2), // 1490 = 0x5d2
            (0x93, 0x05),
            (0xb1, 0x04),
            (0xb3, 0x80),
            (0x00, 0x38), // bits 5 and 4, and 8
            (0x07, 0x01), // 1333 = 0x535
            (0x10, 0x4d),
            (0x04, 0x01),
        ],
    );

    #[test]
    fn is_set_up_as_the_data_sheet_says() {
        let (part, of_part) = PART;
        for (settings, registers) in [(WHOLE, OF_WHOLE), (part, of_part)] {
            // tS:RESET.
            let mut delay = CheckedDelay::new(&[Delay::delay_ms(1)]);
            let set_up = on_bus(&script(&registers), Ov7670::new, |sensor| {
                sensor.set_up(&settings, &mut delay)
            });
            assert_eq!(set_up, Ok(()));
            delay.done();
        }
    }

    #[test]
    fn each_step_of_the_set_up_may_fail() {
        each_step_may_fail(&script(&OF_WHOLE), 0, Ov7670::new, &WHOLE);
    }

    #[test]
    fn another_chip_is_told_and_left_alone() {
        // An OV7725.
        let mut id = script(&[]);
        id.truncate(2);
        id[1] = Transaction::read(0x21, vec![0x77]);
        id.push(Transaction::write(0x21, vec![0x0b]));
        id.push(Transaction::read(0x21, vec![0x21]));
        let set_up = on_bus(&id, Ov7670::new, |sensor| {
            sensor.set_up(&WHOLE, &mut NoopDelay::new())
        });
        let expected = SensorError::WrongChip {
            found: 0x7721,
            expected: 0x7673,
        };
        assert_eq!(set_up, Err(expected));
    }

    #[test]
    fn a_sensor_that_was_reset_is_not_set_up() {
        // COM8 is 0x8f after a reset.
        for (value, is_set_up) in [(0xc0, true), (0x8f, false), (0xff, false)] {
            let read = [
                Transaction::write(0x21, vec![0x13]),
                Transaction::read(0x21, vec![value]),
            ];
            assert_eq!(
                on_bus(&read, Ov7670::<Mock>::new, Ov7670::is_set_up),
                Ok(is_set_up)
            );
        }
    }

    #[test]
    fn what_the_sensor_cannot_do_is_refused_before_anything_is_written() {
        let whole = |window: Window| SensorSettings { window, ..WHOLE };
        let mut cases = vec![];
        let binned = Window {
            binning: Binning::Four,
            ..FULL_WINDOW
        };
        cases.push((whole(binned), out_of_bounds(Setting::Binning, 4, 1, 2, 1)));
        for width_px in [0, 3, 642, u16::MAX] {
            let window = Window {
                width_px,
                ..FULL_WINDOW
            };
            let error = out_of_bounds(Setting::Width, width_px.into(), 2, 640, 2);
            cases.push((whole(window), error));
        }
        let odd = Window {
            height_px: 239,
            binning: Binning::Two,
            ..FULL_WINDOW
        };
        cases.push((whole(odd), out_of_bounds(Setting::Height, 239, 2, 480, 2)));
        let moved = Window {
            left_px: 2,
            ..FULL_WINDOW
        };
        cases.push((whole(moved), out_of_bounds(Setting::Left, 2, 0, 0, 2)));
        let lowered = Window {
            top_px: 241,
            height_px: 240,
            ..FULL_WINDOW
        };
        cases.push((whole(lowered), out_of_bounds(Setting::Top, 241, 0, 240, 1)));
        for clock_hz in [0, 9_999_999, 48_000_001, u32::MAX] {
            let settings = SensorSettings { clock_hz, ..WHOLE };
            let error = out_of_bounds(Setting::Clock, clock_hz, 10_000_000, 48_000_000, 1);
            cases.push((settings, error));
        }
        // 784 x 2 clocks are 65.3 us; 4879 x 2 x 64 are 26 021.3 us.
        for line_us in [0, 65, 26_022, u32::MAX] {
            let settings = SensorSettings { line_us, ..WHOLE };
            cases.push((
                settings,
                out_of_bounds(Setting::Line, line_us, 66, 26_021, 1),
            ));
        }
        for frame_lines in [0, 509] {
            let settings = SensorSettings {
                frame_lines,
                ..WHOLE
            };
            let error = out_of_bounds(Setting::FrameLines, frame_lines.into(), 510, 65_535, 1);
            cases.push((settings, error));
        }
        for exposure_us in [0, 99, 50_801, u32::MAX] {
            let settings = SensorSettings {
                exposure_us,
                ..WHOLE
            };
            let error = out_of_bounds(Setting::Exposure, exposure_us, 100, 50_800, 1);
            cases.push((settings, error));
        }
        for gain_q4 in [0, 15, 497, u16::MAX] {
            let settings = SensorSettings { gain_q4, ..WHOLE };
            cases.push((
                settings,
                out_of_bounds(Setting::Gain, gain_q4.into(), 16, 496, 1),
            ));
        }
        for sync in [FrameSync::Triggered, FrameSync::Slave] {
            let settings = SensorSettings { sync, ..WHOLE };
            cases.push((settings, SettingError::Sync(sync)));
        }
        let test_pattern = TestPattern::DiagonalShades;
        let settings = SensorSettings {
            test_pattern,
            ..WHOLE
        };
        cases.push((settings, SettingError::TestPattern(test_pattern)));
        are_refused(Ov7670::new, &cases);
    }

    /// Whatever is accepted lasts as long as it was asked to, and has the gain that it was asked to
    /// have, by the formulas of the implementation guide.
    #[test]
    fn times_and_gains_are_those_of_the_settings() {
        let mut generator = Pcg32::seed_from_u64(2);
        let mut below = |bound: u32| generator.next_u32() % bound;
        let mut accepted = 0;
        for _ in 0..20_000 {
            let settings = SensorSettings {
                clock_hz: 10_000_000 + below(38_000_001),
                line_us: below(1 << 16) >> below(11),
                frame_lines: below(65_536) as u16 >> below(7),
                exposure_us: below(1 << 30) >> below(20),
                gain_q4: 16 + below(481) as u16,
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
            let prescaler = (value(0x11) & 0x3f) + 1;
            let line_px = 784 + (value(0x2a) >> 4 << 8 | value(0x2b));
            let line = line_px * 2 * prescaler;
            let asked = u64::from(settings.line_us) * hz;
            // The next shorter line that the prescaler allows is too short.
            let step = 2 * prescaler;
            assert!(asked <= line * 1_000_000 && asked > (line - step) * 1_000_000);
            let lines = 510 + (value(0x93) << 8 | value(0x92));
            assert_eq!(lines, u64::from(settings.frame_lines));
            let exposed = value(0x07) << 10 | value(0x10) << 2 | value(0x04);
            let asked = u64::from(settings.exposure_us) * hz;
            let lasting = |lines: u64| lines * line * 1_000_000;
            assert!(lasting(exposed) <= asked && asked < lasting(exposed + 1));
            assert!(exposed >= 1 && exposed <= lines - 2);
            let gain = value(0x00);
            let doubled = 1 << (gain >> 4).count_ones();
            let (gain_q4, next) = (doubled * (16 + (gain & 15)), doubled);
            let asked = u64::from(settings.gain_q4);
            assert!(gain_q4 <= asked && asked < gain_q4 + next, "{settings:?}");
        }
        assert!(accepted > 1000, "{accepted}");
    }
}
