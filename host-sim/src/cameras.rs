//! The cameras of a pair of images, as the options of a command tell them.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use vgstereo_core::geometry::Rectification;

use crate::arguments::RectifiedViews;
use crate::calibration::{Rectified, rectify};
use crate::files::read_all;

/// What is known of the cameras: nothing, or their rectification and what it was made from.
#[derive(Debug, Clone)]
pub enum Cameras {
    /// Nothing: the views are rectified.
    Unknown,
    /// A rectification that was made before.
    Stored(Vec<u8>),
    /// Calibration files.
    Calibrated(Box<Rectified>),
}

impl Cameras {
    /// Reads the files of `--calibration`, for images of this size.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn read(
        files: &[PathBuf],
        views: &RectifiedViews,
        (width, height): (u32, u32),
    ) -> Result<Self> {
        let files = read_all(files)?;
        match files.as_slice() {
            [] => {
                ensure!(
                    *views == RectifiedViews::default(),
                    "--view-size, --keep, --projection, --unit, --cropped and --binned need --calibration"
                );
                Ok(Self::Unknown)
            }
            [(name, bytes)] if bytes.starts_with(b"VGRF") => {
                ensure!(
                    *views == RectifiedViews::default(),
                    "{name} is made already: give --view-size, --keep and the like to vgstereo calibration"
                );
                Rectification::from_bytes(bytes).with_context(|| name.clone())?;
                Ok(Self::Stored(bytes.clone()))
            }
            files => {
                let size = [u16::try_from(width)?, u16::try_from(height)?];
                let made = rectify(files, &views.options(Some(size))?)?;
                Ok(Self::Calibrated(Box::new(made)))
            }
        }
    }

    /// The bytes of the rectification; `None` if the views are rectified.
    #[must_use]
    pub fn bytes(&self) -> Option<&[u8]> {
        match self {
            Self::Unknown => None,
            Self::Stored(bytes) => Some(bytes),
            Self::Calibrated(made) => Some(&made.maps.bytes),
        }
    }

    /// The rectification; `None` if the views are rectified.
    ///
    /// # Errors
    /// None: it was checked when it was read.
    pub fn rectification(&self) -> Result<Option<Rectification<'_>>> {
        let bytes = self.bytes();
        Ok(bytes.map(Rectification::from_bytes).transpose()?)
    }

    /// What is told of the cameras: nothing if they are unknown.
    ///
    /// # Errors
    /// None: see [`Cameras::rectification`].
    pub fn told(&self) -> Result<String> {
        let Some(r) = self.rectification()? else {
            return Ok(String::new());
        };
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
        for warning in self.warnings() {
            writeln!(text, "warning: {warning}")?;
        }
        Ok(text)
    }

    /// What is to be warned of.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Calibrated(made) => &made.calibration.warnings,
            Self::Unknown | Self::Stored(_) => &[],
        }
    }
}
