//! Errors: what a sensor cannot do, and why it is not set up.

use core::fmt;
use core::ops::RangeInclusive;

use embedded_hal::i2c;

use super::settings::{FrameSync, TestPattern};
use crate::camera;

/// A setting that has bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Setting {
    /// First column of the window.
    Left,
    /// First row of the window.
    Top,
    /// Width of the window, in pixels before they are binned.
    Width,
    /// Height of the window, in pixels before they are binned.
    Height,
    /// Pixels that are binned to one, in each direction.
    Binning,
    /// Clock that is fed to the sensor, Hz.
    Clock,
    /// Period of a line, us.
    Line,
    /// Lines of a frame.
    FrameLines,
    /// Time of exposure, us.
    Exposure,
    /// Gain, in 1/16.
    Gain,
}

impl Setting {
    /// Checks a value against a sensor's bounds.
    ///
    /// # Errors
    /// [`SettingError::OutOfBounds`] if it lies outside.
    pub(super) fn within(
        self,
        value: impl Into<u32>,
        bounds: RangeInclusive<u32>,
    ) -> Result<(), SettingError> {
        self.within_steps(value, bounds, 1)
    }

    /// Checks a value against a sensor's bounds, from the first of which on only each `step`-th
    /// number will do.
    ///
    /// # Errors
    /// [`SettingError::OutOfBounds`] if it will not.
    pub(super) fn within_steps(
        self,
        value: impl Into<u32>,
        bounds: RangeInclusive<u32>,
        step: u16,
    ) -> Result<(), SettingError> {
        let (value, step) = (value.into(), u32::from(step));
        let (min, max) = bounds.into_inner();
        let above = value.checked_sub(min);
        if value <= max && above.is_some_and(|above| above.is_multiple_of(step)) {
            return Ok(());
        }
        Err(SettingError::OutOfBounds {
            setting: self,
            value,
            min,
            max,
            step,
        })
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Left => "first column of the window",
            Self::Top => "first row of the window",
            Self::Width => "width of the window, px,",
            Self::Height => "height of the window, px,",
            Self::Binning => "binning",
            Self::Clock => "clock, Hz,",
            Self::Line => "period of a line, us,",
            Self::FrameLines => "number of a frame's lines",
            Self::Exposure => "exposure, us,",
            Self::Gain => "gain, in 1/16,",
        })
    }
}

/// What a sensor cannot do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingError {
    /// A number is out of bounds. These may depend on the other settings; where nothing satisfies
    /// them, `min` is larger than `max`.
    OutOfBounds {
        /// The setting.
        setting: Setting,
        /// Its value.
        value: u32,
        /// The least that the sensor takes with the other settings.
        min: u32,
        /// The most that the sensor takes with the other settings.
        max: u32,
        /// Difference of neighbouring values, from the least on, that it takes.
        step: u32,
    },
    /// Nothing starts this sensor's frames so.
    Sync(FrameSync),
    /// The sensor has no such test pattern.
    TestPattern(TestPattern),
}

impl fmt::Display for SettingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfBounds {
                setting,
                value,
                min,
                max,
                step,
            } => {
                write!(
                    f,
                    "the {setting} is {value}; the sensor takes {min} to {max}"
                )?;
                if *step != 1 {
                    write!(f, " in steps of {step}")?;
                }
                Ok(())
            }
            Self::Sync(sync) => write!(f, "the sensor's frames cannot be started as {sync:?}"),
            Self::TestPattern(pattern) => write!(f, "the sensor has no test pattern {pattern:?}"),
        }
    }
}

impl core::error::Error for SettingError {}

/// Why a sensor is not set up. `E` is the error of its bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SensorError<E> {
    /// The sensor cannot do this; nothing was written.
    Setting(SettingError),
    /// Nobody acknowledges: the bus works, and the sensor is not there.
    Nack(E),
    /// The bus failed in any other way, which includes that it hangs.
    Bus(E),
    /// Another chip answers.
    WrongChip {
        /// Its number.
        found: u16,
        /// The number of the sensor that was to answer.
        expected: u16,
    },
    /// The sensor's driver failed in a way that it did not when this was written.
    Driver,
}

impl<E: i2c::Error> SensorError<E> {
    /// Tells a missing acknowledgement from the bus's other errors.
    pub(super) fn of_bus(error: E) -> Self {
        match error.kind() {
            i2c::ErrorKind::NoAcknowledge(_) => Self::Nack(error),
            _ => Self::Bus(error),
        }
    }
}

impl<E: fmt::Debug> fmt::Display for SensorError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setting(error) => error.fmt(f),
            Self::Nack(error) => write!(f, "the sensor does not acknowledge: {error:?}"),
            Self::Bus(error) => write!(f, "the sensor's bus fails: {error:?}"),
            Self::WrongChip { found, expected } => write!(
                f,
                "another chip answers: its number is {found:#06x}, the sensor's {expected:#06x}"
            ),
            Self::Driver => f.write_str("the sensor's driver failed"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for SensorError<E> {}

impl<E> From<SettingError> for SensorError<E> {
    fn from(error: SettingError) -> Self {
        Self::Setting(error)
    }
}

impl<E: fmt::Debug> camera::Error for SensorError<E> {
    fn kind(&self) -> camera::ErrorKind {
        match self {
            Self::Nack(_) | Self::Bus(_) => camera::ErrorKind::Bus,
            Self::Setting(_) | Self::WrongChip { .. } | Self::Driver => camera::ErrorKind::Other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Error as _, ErrorKind};
    use std::string::ToString;

    /// The setting that is wrong, its value and its bounds are in the message; a session learns
    /// whether the bus or something else failed.
    #[test]
    fn errors_tell_what_failed() {
        let lines = SettingError::OutOfBounds {
            setting: Setting::FrameLines,
            value: 100,
            min: 260,
            max: 65_535,
            step: 1,
        };
        let height = SettingError::OutOfBounds {
            setting: Setting::Height,
            value: 300,
            min: 244,
            max: 324,
            step: 80,
        };
        let chip = SensorError::WrongChip {
            found: 0x0360,
            expected: 0x01b0,
        };
        let other = i2c::ErrorKind::Other;
        for (error, kind, message) in [
            (
                lines.into(),
                ErrorKind::Other,
                "the number of a frame's lines is 100; the sensor takes 260 to 65535",
            ),
            (
                height.into(),
                ErrorKind::Other,
                "the height of the window, px, is 300; the sensor takes 244 to 324 in steps of 80",
            ),
            (
                chip,
                ErrorKind::Other,
                "another chip answers: its number is 0x0360, the sensor's 0x01b0",
            ),
            (
                SensorError::Bus(other),
                ErrorKind::Bus,
                "the sensor's bus fails: Other",
            ),
            (
                SensorError::Nack(other),
                ErrorKind::Bus,
                "the sensor does not acknowledge: Other",
            ),
        ] {
            assert_eq!(error.kind(), kind);
            assert_eq!(error.to_string(), message);
        }
    }
}
