//! What a scene's `meta.toml` states.

use anyhow::{Context, Result, anyhow};
use serde::Serialize;
use toml::Table;
use vgstereo_core::disparity::MAX_MAGNITUDE_PX;

use super::truth::SCALE_RANGE;

/// Largest disparity that can be searched, px.
const D_MAX_PX: u16 = MAX_MAGNITUDE_PX as u16;

/// The keys of a scene's `meta.toml` that are read. Others are ignored.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Meta {
    /// The largest disparity to search, px, at most 2047.
    pub d_max: u16,
    /// The steps per px of ground truth in a PNG, in [`SCALE_RANGE`].
    pub gt_scale: Option<f32>,
    /// Calibration files in the scene's folder, of a pair that is not rectified: see
    /// [`load_calibrated`](super::load_calibrated).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub calibration_files: Vec<String>,
}

impl Meta {
    /// Reads the text of a `meta.toml`; `name` is for messages.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        let table: Table = text
            .parse()
            .map_err(|error: toml::de::Error| anyhow!("{name}: {}", error.message()))?;
        let d_max = table.get("d_max").with_context(|| {
            format!("{name}: d_max is missing, the largest disparity to search")
        })?;
        let whole = d_max.as_integer().and_then(|px| u16::try_from(px).ok());
        let d_max = whole.filter(|&px| px <= D_MAX_PX).with_context(|| {
            format!(
                "{name}: d_max must be a whole number from 0 to {D_MAX_PX} px, and it is {d_max}"
            )
        })?;
        let gt_scale =
            table.get("gt_scale").map(|scale| {
                let whole = scale.as_integer().map(|steps| steps as f64);
                let steps = scale.as_float().or(whole).map(|steps| steps as f32);
                steps.filter(|steps| SCALE_RANGE.contains(steps)).with_context(|| {
                format!(
                    "{name}: gt_scale must be from {} to {} steps per px, and it is {scale}",
                    SCALE_RANGE.start(),
                    SCALE_RANGE.end()
                )
            })
            });
        let no_list = || format!("{name}: calibration_files must be a list of names");
        let calibration_files = match table.get("calibration_files") {
            Some(files) => {
                let files = files.as_array().with_context(no_list)?.iter();
                let names = files.map(|file| file.as_str().map(str::to_owned));
                names.collect::<Option<_>>().with_context(no_list)?
            }
            None => Vec::new(),
        };
        Ok(Self {
            d_max,
            gt_scale: gt_scale.transpose()?,
            calibration_files,
        })
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
        assert_eq!(parse("d_max = 2047").unwrap().d_max, 2047);
        for (text, word) in [
            ("gt_scale = 4", "d_max"),
            (
                "d_max = -1",
                "d_max must be a whole number from 0 to 2047 px",
            ),
            (
                "d_max = 2048",
                "d_max must be a whole number from 0 to 2047 px",
            ),
            ("d_max = 70000", "it is 70000"),
            ("d_max = 'many'", "it is \"many\""),
            ("d_max = 5.5", "it is 5.5"),
            ("d_max = [5]", "d_max must"),
            (
                "d_max = 5\ngt_scale = 'four'",
                "gt_scale must be from 0.015625 to 65535",
            ),
            ("d_max = 5\ngt_scale = true", "gt_scale must be"),
            (
                "d_max = 5\ncalibration_files = 'a'",
                "calibration_files must be a list",
            ),
            (
                "d_max = 5\ncalibration_files = ['a', 5]",
                "calibration_files must be a list",
            ),
            ("d_max = 5\ngt_scale = inf", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = nan", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 0", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 1e39", "0.015625 to 65535"),
            ("d_max = 5\ngt_scale = 1e-45", "0.015625 to 65535"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            let is_named = error.starts_with("meta.toml: ") && !error.contains('\n');
            assert!(is_named && error.contains(word), "{text}: {error}");
        }
    }
}
