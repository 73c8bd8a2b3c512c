//! The arithmetic of a sensor's times: clocks of a line, lines of an exposure.

use core::ops::RangeInclusive;

use super::error::{Setting, SettingError};
use super::settings::SensorSettings;

const US_PER_S: u64 = 1_000_000;

/// Whole microseconds that last as long as `clocks` at `hz`.
fn microseconds(clocks: RangeInclusive<u64>, hz: u32) -> RangeInclusive<u32> {
    let hz = u64::from(hz.max(1));
    let (least, most) = clocks.into_inner();
    let least_us = least.saturating_mul(US_PER_S).div_ceil(hz);
    let most_us = most.saturating_mul(US_PER_S) / hz;
    let saturated = |us| u32::try_from(us).unwrap_or(u32::MAX);
    saturated(least_us)..=saturated(most_us)
}

impl SensorSettings {
    /// Returns the clocks of a line, for a pixel clock of `hz`: the least that last `line_us`. They
    /// lie within `clocks`.
    ///
    /// # Errors
    /// [`SettingError`] if no number within `clocks` lasts so long.
    pub(super) fn line_clocks(
        &self,
        hz: u32,
        clocks: RangeInclusive<u32>,
    ) -> Result<u32, SettingError> {
        let (least, most) = clocks.into_inner();
        let bounds_us = microseconds(least.into()..=most.into(), hz);
        Setting::Line.within(self.line_us, bounds_us)?;
        let line = (u64::from(self.line_us) * u64::from(hz)).div_ceil(US_PER_S);
        Ok(u32::try_from(line).unwrap_or(u32::MAX))
    }

    /// Returns the exposure as whole lines of so many clocks and the clocks that remain, for a
    /// pixel clock of `hz`: the most that do not last longer than `exposure_us`. It has at least as
    /// many lines as `lines` begins with, and not more than it ends with.
    ///
    /// # Errors
    /// [`SettingError`] if the exposure is shorter or longer than `lines`.
    pub(super) fn exposure(
        &self,
        hz: u32,
        line_clocks: u32,
        lines: RangeInclusive<u16>,
    ) -> Result<(u16, u32), SettingError> {
        let (fewest, most) = lines.into_inner();
        let clocks = |lines| u64::from(lines) * u64::from(line_clocks);
        let bounds_us = microseconds(clocks(fewest)..=clocks(most), hz);
        Setting::Exposure.within(self.exposure_us, bounds_us)?;
        let clocks = u64::from(self.exposure_us) * u64::from(hz) / US_PER_S;
        let line = u64::from(line_clocks.max(1));
        let whole = u16::try_from(clocks / line).unwrap_or(u16::MAX);
        Ok((whole, (clocks % line) as u32))
    }
}
