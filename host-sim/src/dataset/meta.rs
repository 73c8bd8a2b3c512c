//! What a scene's `meta.toml` states.

use anyhow::{Result, anyhow, ensure};
use serde::{Deserialize, Serialize};

use super::truth::SCALE_RANGE;

/// The keys of a scene's `meta.toml` that are read. Others are ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// The largest disparity to search, px.
    pub d_max: u16,
    /// The steps per px of ground truth in a PNG, in [`SCALE_RANGE`].
    pub gt_scale: Option<f32>,
    /// Calibration files in the scene's folder, of a pair that is not rectified: see
    /// [`load_calibrated`](super::load_calibrated).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration_files: Vec<String>,
}

impl Meta {
    /// Reads the text of a `meta.toml`; `name` is for messages.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        let meta: Self =
            toml::from_str(text).map_err(|error| anyhow!("{name}: {}", error.message()))?;
        ensure!(
            meta.gt_scale
                .is_none_or(|scale| SCALE_RANGE.contains(&scale)),
            "{name}: gt_scale must be from {} to {} steps per px",
            SCALE_RANGE.start(),
            SCALE_RANGE.end()
        );
        Ok(meta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_refused() {
        let parse = |text| Meta::parse(text, "meta.toml");
        let meta = parse("d_max = 59\ngt_scale = 4\nname = 'x'").unwrap();
        assert_eq!((meta.d_max, meta.gt_scale), (59, Some(4.0)));
        assert_eq!(parse("d_max = 0").unwrap().gt_scale, None);
        for (text, word) in [
            ("gt_scale = 4", "d_max"),
            ("d_max = -1", "meta.toml"),
            ("d_max = 70000", "meta.toml"),
            ("d_max = 5\ngt_scale = 'four'", "meta.toml"),
            ("d_max = 5\ngt_scale = inf", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = nan", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 0", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 1e39", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 1e-45", "0.015625 to 65535"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
