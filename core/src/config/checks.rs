//! Checks: the parameters that may change while a matcher lives.

use core::fmt;

use super::{Config, Method, Output};

/// The checks that disparities of [`Method::Sgm`] pass, and what becomes of those that fail. Neither
/// memory nor latency depends on them, so that a matcher takes others between frames:
/// [`Matcher::set_checks`](crate::Matcher::set_checks).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Checks {
    /// As of [`SgmParameters::left_right_tolerance_px`](super::SgmParameters::left_right_tolerance_px).
    pub left_right_tolerance_px: u8,
    /// As of [`SgmParameters::margin`](super::SgmParameters::margin).
    pub margin: i16,
    /// As of [`SgmParameters::texture_min`](super::SgmParameters::texture_min).
    pub texture_min: u16,
    /// The speckle removal; `None` where the parameters leave it out.
    pub speckle: Option<SpeckleChecks>,
    /// Treatment of pixels whose disparity was not found.
    pub output: Output,
}

/// Bounds of a speckle: a region of the map that is so small is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpeckleChecks {
    /// As of [`SpeckleParameters::size_min`](super::SpeckleParameters::size_min).
    pub size_min: u8,
    /// As of [`SpeckleParameters::step_q4`](super::SpeckleParameters::step_q4).
    pub step_q4: u8,
}

/// Reason for which a matcher refuses other checks; it keeps those that it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ChecksError {
    /// [`Method::Recall`] has no checks.
    Method,
    /// The matcher was built without speckle removal, or with it.
    Speckle,
    /// Speckles are larger than those that the matcher was built with, on which its memory depends.
    SpeckleSize,
}

impl fmt::Display for ChecksError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Method => "the method has no checks",
            Self::Speckle => "the speckle removal cannot be added or left out",
            Self::SpeckleSize => "speckles are larger than the matcher has memory for",
        })
    }
}

impl core::error::Error for ChecksError {}

impl Config {
    /// The checks; `None` for [`Method::Recall`], which has none.
    #[must_use]
    pub const fn checks(&self) -> Option<Checks> {
        let Method::Sgm(sgm) = &self.parameters.method else {
            return None;
        };
        let speckle = match &sgm.speckle {
            Some(speckle) => Some(SpeckleChecks {
                size_min: speckle.size_min,
                step_q4: speckle.step_q4,
            }),
            None => None,
        };
        Some(Checks {
            left_right_tolerance_px: sgm.left_right_tolerance_px,
            margin: sgm.margin,
            texture_min: sgm.texture_min,
            speckle,
            output: self.output,
        })
    }

    /// Takes other checks.
    ///
    /// # Errors
    /// [`ChecksError`]; the configuration is then unchanged.
    pub(crate) fn set_checks(&mut self, checks: &Checks) -> Result<(), ChecksError> {
        let Method::Sgm(sgm) = &mut self.parameters.method else {
            return Err(ChecksError::Method);
        };
        match (&mut sgm.speckle, &checks.speckle) {
            (Some(own), Some(other)) => {
                (own.size_min, own.step_q4) = (other.size_min, other.step_q4)
            }
            (None, None) => {}
            _ => return Err(ChecksError::Speckle),
        }
        sgm.left_right_tolerance_px = checks.left_right_tolerance_px;
        sgm.margin = checks.margin;
        sgm.texture_min = checks.texture_min;
        self.output = checks.output;
        Ok(())
    }
}
