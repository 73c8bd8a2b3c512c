//! The cameras of a pair of images, as the options of a command tell them.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use vgstereo_core::geometry::Rectification;

use crate::arguments::RectifiedViews;
use crate::calibration::rectify;
use crate::files::read_all;

/// The cameras of a pair of images: their rectification, and what to warn of.
#[derive(Debug, Clone, Default)]
pub struct Cameras {
    /// The bytes that [`Rectification::from_bytes`] reads; `None` if the views are rectified.
    pub rectification: Option<Vec<u8>>,
    /// What may be wrong with the calibration, a sentence each.
    pub warnings: Vec<String>,
}

impl Cameras {
    /// Reads the files of `--calibration`, for images of this size, px; `None`: of that which the files
    /// state.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn read(
        files: &[PathBuf],
        views: &RectifiedViews,
        size: Option<(u32, u32)>,
    ) -> Result<Self> {
        let files = read_all(files)?;
        match files.as_slice() {
            [] => {
                ensure!(
                    *views == RectifiedViews::default(),
                    "--view-size, --keep, --projection, --unit, --cropped and --binned need --calibration"
                );
                Ok(Self::default())
            }
            [(name, bytes)] if bytes.starts_with(b"VGRF") => {
                ensure!(
                    *views == RectifiedViews::default(),
                    "{name} is made already: give --view-size, --keep and the like to vgstereo calibration"
                );
                Rectification::from_bytes(bytes).with_context(|| name.clone())?;
                Ok(Self {
                    rectification: Some(bytes.clone()),
                    ..Self::default()
                })
            }
            files => {
                let size = match size {
                    Some((width, height)) => Some([u16::try_from(width)?, u16::try_from(height)?]),
                    None => None,
                };
                let made = rectify(files, &views.options(size)?)?;
                Ok(Self {
                    rectification: Some(made.maps.bytes),
                    warnings: made.calibration.warnings,
                })
            }
        }
    }

    /// Lines that tell what the views are rectified by, and the warnings.
    #[must_use]
    pub fn told(&self, r: &Rectification<'_>) -> String {
        let focal_px = f64::from(r.focal_q8) / 256.0;
        let baseline = r.depth.map_or_else(
            || "baseline unknown".to_owned(),
            |depth| {
                let baseline_mm = f64::from(depth.numerator_q8()) / f64::from(r.focal_q8);
                format!("baseline {baseline_mm:.1} mm")
            },
        );
        let mut text = format!(
            "rectified from {}x{} px: focal length {focal_px:.1} px, {baseline}; {} and {} raw lines are kept\n",
            r.raw_width,
            r.raw_height,
            r.left.kept_lines(),
            r.right.kept_lines()
        );
        for warning in &self.warnings {
            text += &format!("warning: {warning}\n");
        }
        text
    }
}
