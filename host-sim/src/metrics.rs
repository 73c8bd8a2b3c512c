//! The measure of the Middlebury benchmark: the percentage of bad pixels over each mask.

use vgstereo_core::{INVALID, STEPS_PER_PX};

use crate::scene::{GroundTruth, Mask};

/// Percentages of bad pixels. A pixel is bad when it has no disparity, or one that is further
/// than a threshold from the ground truth (Scharstein and Szeliski 2002, equation 2). A
/// percentage is `None` if the mask is missing or counts no pixel with known ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BadPixels {
    /// Bad pixels among those that are not occluded, percent.
    pub nonocc: Option<f64>,
    /// Bad pixels among all pixels to measure at, percent.
    pub all: Option<f64>,
    /// Bad pixels among those near discontinuities, percent.
    pub disc: Option<f64>,
    /// Pixels without a disparity, percent of the image.
    pub invalid: f64,
}

impl BadPixels {
    /// Returns the percentages for disparities of the left view, which are in 1/16 px,
    /// row-major. With `sparse`, pixels without a disparity do not count as bad; they are left
    /// out.
    #[must_use]
    pub fn measure(
        disparities_q4: &[i16],
        truth: &GroundTruth,
        threshold_px: f32,
        sparse: bool,
    ) -> Self {
        let over = |mask: &Option<Mask>| {
            let mask = mask.as_deref()?;
            let mut pixels = 0_u32;
            let mut bad = 0_u32;
            for ((&found, &known), &inside) in disparities_q4.iter().zip(&truth.left_px).zip(mask) {
                if inside && !known.is_nan() && !(sparse && found == INVALID) {
                    pixels += 1;
                    bad += u32::from(is_bad(found, known, threshold_px));
                }
            }
            (pixels > 0).then(|| 100.0 * f64::from(bad) / f64::from(pixels))
        };
        let invalid = disparities_q4.iter().filter(|&&d| d == INVALID).count();
        Self {
            nonocc: over(&truth.nonocc),
            all: over(&truth.all),
            disc: over(&truth.disc),
            invalid: 100.0 * invalid as f64 / disparities_q4.len().max(1) as f64,
        }
    }

    /// Returns the mean of the percentages that are known; `None` if none is.
    #[must_use]
    pub fn average(&self) -> Option<f64> {
        mean([self.nonocc, self.all, self.disc].into_iter().flatten())
    }
}

/// Returns whether a disparity in 1/16 px is missing, or further than `threshold_px` from the
/// ground truth in px.
#[must_use]
pub fn is_bad(found_q4: i16, truth_px: f32, threshold_px: f32) -> bool {
    found_q4 == INVALID
        || (f32::from(found_q4) / f32::from(STEPS_PER_PX) - truth_px).abs() > threshold_px
}

/// Returns the mean of some numbers; `None` if there are none.
#[must_use]
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_is_further_than_the_threshold_or_nothing() {
        assert!(!is_bad(160, 9.0, 1.0));
        assert!(is_bad(161, 9.0, 1.0));
        assert!(is_bad(INVALID, 9.0, 1.0));
        let truth = GroundTruth {
            left_px: vec![1.0, 2.0, 3.0, f32::NAN],
            right_px: None,
            nonocc: Some(vec![true, false, false, true].into()),
            all: Some(vec![true; 4].into()),
            disc: None,
        };
        let found = BadPixels::measure(&[16, 16 * 4, INVALID, 0], &truth, 1.0, false);
        assert_eq!(found.nonocc, Some(0.0));
        assert!((found.all.unwrap() - 200.0 / 3.0).abs() < 1e-9);
        assert_eq!(found.disc, None);
        assert_eq!(found.invalid, 25.0);
        assert!((found.average().unwrap() - 100.0 / 3.0).abs() < 1e-9);
        let sparse = BadPixels::measure(&[16, 16 * 4, INVALID, 0], &truth, 1.0, true);
        assert_eq!((sparse.all, sparse.invalid), (Some(50.0), 25.0));
    }
}
