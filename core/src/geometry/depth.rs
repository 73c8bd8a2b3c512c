//! Depth: the distance along the optical axis, from disparities.

use crate::disparity::{INVALID, STEPS_PER_PX};

/// Converts the disparities of a pair of cameras to depths: `Z = f B / (d + doffs)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Depth {
    /// `256 f B`, with the focal length in px and the baseline in mm, rounded.
    numerator_q8: u32,
    /// `256 doffs`, rounded: the column of the right camera's principal point less that of the
    /// left one's, px.
    offset_q8: i32,
}

impl Depth {
    /// Smallest and largest numerator: a focal length and a baseline whose product is below 16 m px
    /// measures nothing, and rounding needs a bit.
    const NUMERATOR_MAX_Q8: u32 = u32::MAX >> 1;

    /// The conversion for a numerator of `256 f B`, in px and mm, and an offset of
    /// `256 (cx_right - cx_left)`, in px; `None` when the numerator is 0 or above 2^31, or the offset
    /// is above 2^20 in magnitude.
    #[must_use]
    pub const fn new(numerator_q8: u32, offset_q8: i32) -> Option<Self> {
        let is_valid = numerator_q8 > 0
            && numerator_q8 <= Self::NUMERATOR_MAX_Q8
            && offset_q8.unsigned_abs() <= 1 << 20;
        if is_valid {
            Some(Self {
                numerator_q8,
                offset_q8,
            })
        } else {
            None
        }
    }

    /// `256 f B`, with the focal length in px and the baseline in mm.
    #[must_use]
    pub const fn numerator_q8(&self) -> u32 {
        self.numerator_q8
    }

    /// 256 times what is added to a disparity, px.
    #[must_use]
    pub const fn offset_q8(&self) -> i32 {
        self.offset_q8
    }

    /// Returns the depth of a disparity in 1/16 px, in mm, rounded to nearest. It is 0, which stands
    /// for no depth, where the disparity is [`INVALID`], where the point would lie at infinity or
    /// behind the cameras, and beyond 65,535 mm. One division.
    #[must_use]
    #[inline]
    pub fn mm(&self, disparity_q4: i16) -> u16 {
        let steps_q8 = 256 / i32::from(STEPS_PER_PX);
        let denominator_q8 = i32::from(disparity_q4) * steps_q8 + self.offset_q8;
        let Ok(denominator_q8) = u32::try_from(denominator_q8) else {
            return 0;
        };
        if disparity_q4 == INVALID || denominator_q8 == 0 {
            return 0;
        }
        // Both fit 31 bits.
        let mm = (self.numerator_q8 + denominator_q8 / 2) / denominator_q8;
        u16::try_from(mm).unwrap_or(0)
    }

    /// Writes the depths of a line, mm; if the lengths differ, those of the common columns.
    pub fn line_mm(&self, disparities_q4: &[i16], depths_mm: &mut [u16]) {
        for (depth_mm, &disparity_q4) in depths_mm.iter_mut().zip(disparities_q4) {
            *depth_mm = self.mm(disparity_q4);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_within_half_a_millimetre_of_the_quotient() {
        let (offset_q8_max, numerator_max) = (1 << 20, Depth::NUMERATOR_MAX_Q8);
        for numerator_q8 in [1, 255, 5_267_000, 20_000_000, 1 << 27, numerator_max] {
            for offset_q8 in [-offset_q8_max, -2048, -1, 0, 3, 2048, offset_q8_max] {
                let depth = Depth::new(numerator_q8, offset_q8).unwrap();
                for disparity_q4 in i16::MIN..=i16::MAX {
                    let mm = depth.mm(disparity_q4);
                    let px = f64::from(disparity_q4) / 16.0 + f64::from(offset_q8) / 256.0;
                    let exact = f64::from(numerator_q8) / 256.0 / px;
                    if disparity_q4 == INVALID || px <= 0.0 || exact >= 65_535.5 {
                        assert_eq!(mm, 0, "{numerator_q8} {offset_q8} {disparity_q4}");
                    } else {
                        assert!((f64::from(mm) - exact).abs() <= 0.5 + 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn numbers_without_a_meaning_are_refused() {
        assert_eq!(Depth::new(0, 0), None);
        assert_eq!(Depth::new(Depth::NUMERATOR_MAX_Q8 + 1, 0), None);
        assert_eq!(Depth::new(1, (1 << 20) + 1), None);
        assert_eq!(Depth::new(1, i32::MIN), None);
    }

    #[test]
    fn a_line_is_converted_pixel_by_pixel() {
        // 381 px and 54 mm: 20,574 mm at a disparity of 1 px.
        let depth = Depth::new(381 * 54 * 256, 0).unwrap();
        let mut depths_mm = [7; 5];
        depth.line_mm(&[16, 160, INVALID, 0], &mut depths_mm);
        assert_eq!(depths_mm, [20_574, 2_057, 0, 0, 7]);
    }
}
