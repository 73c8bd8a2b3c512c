//! Ground truth: the disparity of each pixel.

use anyhow::{Result, bail};

use super::values::Values;
use crate::pfm::Pfm;

/// Smallest and largest number of steps per px that ground truth is stored with.
pub const SCALE_RANGE: std::ops::RangeInclusive<f32> = 1.0 / 64.0..=65_535.0;

/// Disparities of a view, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Disparity of each pixel, px; NaN where it is not known.
    pub px: Vec<f32>,
}

impl Truth {
    /// Reads ground truth in memory; `name` is for messages. It is a PNG, whose values are steps of
    /// which `scale` make a px, 0 for unknown; or a portable float map of px, in which infinity,
    /// negative numbers and what is no number are unknown.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason: the file cannot be read, or it is a PNG and
    /// there is no scale in [`SCALE_RANGE`].
    pub fn from_bytes(bytes: &[u8], scale: Option<f32>, name: &str) -> Result<Self> {
        if bytes.starts_with(b"P") {
            let map = Pfm::from_bytes(bytes, name)?;
            let known = |px: f32| {
                if px.is_finite() && px >= 0.0 {
                    px
                } else {
                    f32::NAN
                }
            };
            return Ok(Self {
                width: map.width,
                height: map.height,
                px: map.values.into_iter().map(known).collect(),
            });
        }
        let Some(scale) = scale.filter(|scale| SCALE_RANGE.contains(scale)) else {
            bail!(
                "{name}: gt_scale must be from {} to {} steps per px",
                SCALE_RANGE.start(),
                SCALE_RANGE.end()
            );
        };
        let stored = Values::from_bytes(bytes, name)?;
        let px = |&value: &u16| match value {
            0 => f32::NAN,
            known => f32::from(known) / scale,
        };
        Ok(Self {
            width: stored.width,
            height: stored.height,
            px: stored.values.iter().map(px).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::values::tests::png;
    use super::*;
    use ::png::{BitDepth, ColorType};

    #[test]
    fn steps_become_px_and_zero_is_unknown() {
        let bytes = png((3, 1), ColorType::Indexed, BitDepth::Eight, &[0, 5, 255]);
        let truth = Truth::from_bytes(&bytes, Some(4.0), "gt").unwrap();
        assert!(truth.px[0].is_nan());
        assert_eq!(truth.px[1..], [1.25, 63.75]);
        let bytes = png((1, 1), ColorType::Grayscale, BitDepth::Sixteen, &[1, 128]);
        assert_eq!(
            Truth::from_bytes(&bytes, Some(256.0), "gt").unwrap().px,
            [1.5]
        );
        for scale in [
            0.0,
            -1.0,
            1e-45,
            1e39_f64 as f32,
            f32::INFINITY,
            f32::NAN,
            1e-3,
            7e4,
        ] {
            let error = Truth::from_bytes(&bytes, Some(scale), "gt")
                .unwrap_err()
                .to_string();
            assert!(error.contains("0.015625 to 65535"), "{scale}: {error}");
        }
        assert!(Truth::from_bytes(&bytes, None, "gt").is_err());
    }

    #[test]
    fn float_maps_hold_px() {
        let map = Pfm {
            width: 2,
            height: 2,
            values: vec![0.0, f32::INFINITY, -1.0, 7.25],
        };
        let truth = Truth::from_bytes(&map.to_bytes(), None, "gt.pfm").unwrap();
        assert_eq!((truth.px[0], truth.px[3]), (0.0, 7.25));
        assert!(truth.px[1].is_nan() && truth.px[2].is_nan());
    }
}
