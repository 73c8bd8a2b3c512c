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

/// How many disparities that were found are bad, by their confidence.
#[derive(Debug, Clone)]
pub struct ByConfidence {
    /// Disparities of each confidence, and those of them that are bad.
    counts: [[u64; 2]; 256],
}

impl ByConfidence {
    /// Before anything is counted.
    pub const NONE: Self = Self {
        counts: [[0; 2]; 256],
    };

    /// Counts what was found of a scene: the disparities of the left view, 1/16 px, row-major, that have a
    /// confidence above 0. Those count that are known and not occluded, or all known ones if the truth does
    /// not tell.
    pub fn count(
        &mut self,
        disparities_q4: &[i16],
        confidences: &[u8],
        truth: &GroundTruth,
        threshold_px: f32,
    ) {
        let mask = truth.nonocc.as_deref().or(truth.all.as_deref());
        let pixels = disparities_q4.iter().zip(confidences).zip(&truth.left_px);
        for (index, ((&found_q4, &confidence), &known_px)) in pixels.enumerate() {
            let is_inside = mask.is_none_or(|mask| mask[index]);
            if is_inside && confidence > 0 && !known_px.is_nan() {
                let [found, bad] = &mut self.counts[usize::from(confidence)];
                *found += 1;
                *bad += u64::from(is_bad(found_q4, known_px, threshold_px));
            }
        }
    }

    /// Returns the share of bad disparities, percent, in each tenth of those that were found, from the least
    /// confident to the most; `None` if nothing was found. Of disparities of one confidence at the bound of
    /// two tenths, as large a share is bad in either.
    #[must_use]
    pub fn tenths(&self) -> Option<[f64; 10]> {
        let found: u64 = self.counts.iter().map(|[found, _]| found).sum();
        let tenth = found as f64 / 10.0;
        let mut bad = [0.0; 10];
        let mut begin = 0.0;
        for [found, of_them] in self.counts {
            let end = begin + found as f64;
            for (index, bad) in bad.iter_mut().enumerate() {
                let [from, to] = [index, index + 1].map(|edge| edge as f64 * tenth);
                let inside = (end.min(to) - begin.max(from)).max(0.0);
                *bad += of_them as f64 * inside / (found as f64).max(1.0);
            }
            begin = end;
        }
        (found > 0).then(|| bad.map(|bad| 100.0 * bad / tenth))
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
    fn tenths_are_from_the_least_confident_to_the_most() {
        // Disparities of 2 px where 1 px is true are bad: all of confidence 5, half of 6, none of 200.
        let truth = GroundTruth {
            left_px: vec![1.0; 40],
            right_px: None,
            nonocc: None,
            all: None,
            disc: None,
        };
        let disparities_q4: Vec<i16> = (0..40).map(|x| if x < 12 { 32 } else { 16 }).collect();
        let confidences: Vec<u8> = (0..40)
            .map(|x| match x {
                0..8 => 5,
                8..16 => 6,
                16..36 => 200,
                _ => 0,
            })
            .collect();
        let mut counts = ByConfidence::NONE;
        assert_eq!(counts.tenths(), None);
        counts.count(&disparities_q4, &confidences, &truth, 0.75);
        // A tenth is 3.6 disparities: 7.2 of confidence 5 in the first two, 0.8 in the third.
        let mixed = 100.0 * (0.8 + 2.8 / 2.0) / 3.6;
        let expected = [100.0, 100.0, mixed, 50.0, 100.0 * 1.6 / 2.0 / 3.6];
        let tenths = counts.tenths().unwrap();
        for (found, expected) in tenths.iter().zip(expected.into_iter().chain([0.0; 5])) {
            assert!((found - expected).abs() < 1e-9, "{tenths:?}");
        }
    }

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
