//! Disparities: their unit, their range and the value that means "none".
//!
//! A disparity `d` says that column `x` of the left view and column `x - d` of
//! the right view show the same point. Lines of disparities are `i16` in
//! 1/16 px (suffix `_q4`); whole pixels inside the pipeline are `i16` in px.
//! Both share one sentinel, [`INVALID`], which is no disparity.

use core::ops::Range;

/// Steps per pixel of a `_q4` value.
pub const STEPS_PER_PX: i16 = 16;

/// No disparity is known here. Not 0: 0 is a point at infinity.
pub const INVALID: i16 = i16::MIN;

/// Largest magnitude of a disparity, px: what fits an `i16` in 1/16 px.
pub const MAX_MAGNITUDE_PX: i16 = i16::MAX / STEPS_PER_PX;

/// Whole pixels to 1/16 px; [`INVALID`] stays [`INVALID`].
#[inline]
#[must_use]
pub const fn px_to_q4(disparity_px: i16) -> i16 {
    if disparity_px == INVALID {
        INVALID
    } else {
        disparity_px.saturating_mul(STEPS_PER_PX)
    }
}

/// The disparities to search: `minimum_px .. minimum_px + count`.
///
/// The minimum may be negative, for cameras that converge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DisparityRange {
    /// Smallest disparity searched, px.
    pub minimum_px: i16,
    /// Number of disparities searched, at least 1.
    pub count: u16,
}

impl DisparityRange {
    /// The disparities 0 to `d_max` px, as benchmarks state them.
    #[must_use]
    pub const fn up_to(d_max: u16) -> Self {
        Self {
            minimum_px: 0,
            count: d_max.saturating_add(1),
        }
    }

    /// The disparities, px, lowest first.
    #[must_use]
    pub const fn range_px(self) -> Range<i32> {
        self.minimum_px as i32..self.minimum_px as i32 + self.count as i32
    }

    /// Whether the range is not empty, fits [`MAX_MAGNITUDE_PX`] and every disparity is shorter
    /// than a line of `width` px, so that each is possible for some column.
    #[must_use]
    pub const fn fits(self, width: u16) -> bool {
        let range = self.range_px();
        let limit = if (width as i32) <= MAX_MAGNITUDE_PX as i32 {
            width as i32
        } else {
            MAX_MAGNITUDE_PX as i32 + 1
        };
        self.count > 0 && range.start > -limit && range.end <= limit
    }
}

/// The view whose pixels get a disparity; the other view is the one searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reference {
    /// Disparity of left pixel `x`: it matches right pixel `x - d`.
    Left,
    /// Disparity of right pixel `x`: it matches left pixel `x + d`.
    Right,
}

/// A line of disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DisparityLine<'a> {
    /// Line of the frame, from 0.
    pub line: u32,
    /// Column of the frame that the first disparity belongs to.
    pub column: u16,
    /// Disparities of the reference view from that column to the right, `region.width` of them,
    /// 1/16 px; [`INVALID`] where none is known.
    pub disparities_q4: &'a [i16],
    /// Confidence of each disparity: 1 to 255 if it was found, 0 if it was filled in or is not
    /// known. The paper's method does not measure it, and states 255 for every disparity that it
    /// finds.
    pub confidences: &'a [u8],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn q4_keeps_the_sentinel_apart_from_zero() {
        assert_eq!(px_to_q4(0), 0);
        assert_eq!(px_to_q4(-5), -80);
        assert_eq!(px_to_q4(MAX_MAGNITUDE_PX), 32752);
        assert_eq!(px_to_q4(INVALID), INVALID);
    }

    #[test]
    fn ranges_fit_lines_longer_than_their_disparities() {
        assert!(DisparityRange::up_to(0).fits(1));
        assert!(DisparityRange::up_to(15).fits(16));
        assert!(!DisparityRange::up_to(16).fits(16));
        let all = DisparityRange {
            minimum_px: -15,
            count: 31,
        };
        assert!(all.fits(16));
        assert!(!all.fits(15));
        assert!(
            !DisparityRange {
                minimum_px: 0,
                count: 0
            }
            .fits(16)
        );
        assert!(DisparityRange::up_to(2047).fits(u16::MAX));
        assert!(!DisparityRange::up_to(2048).fits(u16::MAX));
    }
}
