//! The cameras of a pair of images, as the options of a command tell them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use vgstereo_core::Reference;
use vgstereo_core::geometry::{Depth, Rectification, RectifiedCamera};

use crate::arguments::{RectifiedViews, parse_point};
use crate::calibration::rectify;
use crate::files::read_all;
use crate::terminal::note;

/// The options that name the cameras of a pair of images.
#[derive(Debug, Clone, Args)]
pub struct CameraOptions {
    /// Calibration of the cameras: the files that `vgstereo calibration` reads, or one that it wrote.
    /// The images are then taken as the cameras gave them, and rectified first.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    calibration: Vec<PathBuf>,
    /// Focal length of a rectified pair, px.
    #[arg(
        long,
        value_name = "PX",
        requires = "baseline",
        conflicts_with = "calibration"
    )]
    focal: Option<f64>,
    /// Principal point of the left camera of a rectified pair, column and line, px [default: the middle
    /// of the view].
    #[arg(long, value_name = "X,Y", requires = "focal", value_parser = parse_point, allow_hyphen_values = true)]
    principal: Option<[f64; 2]>,
    /// Distance between the cameras of a rectified pair, mm.
    #[arg(long, value_name = "MM", requires = "focal")]
    baseline: Option<f64>,
    /// Column of the right camera's principal point less that of the left one's, px, as Middlebury's
    /// calib.txt has it.
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 0.0,
        requires = "focal",
        allow_negative_numbers = true
    )]
    doffs: f64,
    #[command(flatten)]
    views: RectifiedViews,
}

impl CameraOptions {
    /// The files that are read.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let calibration = self.calibration.iter().map(PathBuf::as_path);
        calibration.chain(self.views.files())
    }

    /// Whether one of them is given.
    #[must_use]
    pub fn are_given(&self) -> bool {
        self.focal.is_some() || self.is_calibrated()
    }

    /// Whether a calibration is given.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        !self.calibration.is_empty()
    }

    /// Reads the files, for images of this size, px; `None`: of that which the files state.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn read(&self, size: Option<(u32, u32)>) -> Result<Cameras> {
        Cameras::read(&self.calibration, &self.views, size)
    }

    /// Returns the conversion of disparities to depth. `option` is what asks for it, which the error names.
    ///
    /// # Errors
    /// Fails with one line that says which option is missing or out of its range.
    pub fn depth(
        &self,
        option: &str,
        rectification: Option<&Rectification<'_>>,
        warnings: &[String],
    ) -> Result<Depth> {
        if let Some(rectification) = rectification {
            return rectification.depth.with_context(|| {
                let warnings: String = warnings.iter().map(|warning| format!("; {warning}")).collect();
                format!(
                    "{option}: the unit of the calibration's baseline is not known: give it with --unit{warnings}"
                )
            });
        }
        let (Some(focal_px), Some(baseline_mm)) = (self.focal, self.baseline) else {
            bail!("{option} needs --calibration, or --focal and --baseline");
        };
        // Casts saturate, and what is out of range is refused.
        let numerator_q8 = (focal_px * baseline_mm * 256.0).round() as u32;
        let offset_q8 = (self.doffs * 256.0).round() as i32;
        Depth::new(numerator_q8, offset_q8).with_context(|| {
            format!(
                "--focal {focal_px}, --baseline {baseline_mm}, --doffs {}: their product must be above 0 \
                 and at most 8388 m px, and doffs within 4096 px",
                self.doffs
            )
        })
    }

    /// Returns the camera of the reference view, which is of this size, px. `option` is what asks for it.
    ///
    /// # Errors
    /// Fails with one line that says which option is missing or out of its range.
    pub fn camera(
        &self,
        option: &str,
        rectification: Option<&Rectification<'_>>,
        warnings: &[String],
        size: [u32; 2],
        reference: Reference,
    ) -> Result<RectifiedCamera> {
        let depth = self.depth(option, rectification, warnings)?;
        let camera = match (rectification, self.focal) {
            (Some(rectification), _) => rectification.camera(reference),
            (None, Some(focal_px)) => {
                let middle = size.map(|side| (f64::from(side) - 1.0) / 2.0);
                let [mut x_px, y_px] = self.principal.unwrap_or(middle);
                if reference == Reference::Right {
                    x_px += self.doffs;
                }
                // Casts saturate, and what is out of range is refused.
                let q8 = |px: f64| (px * 256.0).round();
                let principal_q8 = [q8(x_px) as i32, q8(y_px) as i32];
                RectifiedCamera::new(depth, q8(focal_px) as u32, principal_q8)
            }
            (None, None) => None,
        };
        camera.with_context(|| {
            format!(
                "{option}: the focal length must be from 16 to 65536 px, and the principal point \
                 within that"
            )
        })
    }
}

/// The options that name the camera that a board's disparities are seen with.
#[derive(Debug, Clone, Args)]
pub struct SeenWith {
    /// Calibration of the cameras, as of `match`, for distances where the board does not tell its
    /// camera.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    calibration: Vec<PathBuf>,
    #[command(flatten)]
    views: RectifiedViews,
}

impl SeenWith {
    /// The files that are read.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let calibration = self.calibration.iter().map(PathBuf::as_path);
        calibration.chain(self.views.files())
    }

    /// The left camera of `--calibration`, if that is given. Warnings go to standard error.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn camera(&self) -> Result<Option<RectifiedCamera>> {
        let cameras = Cameras::read(&self.calibration, &self.views, None)?;
        let Some(bytes) = &cameras.rectification else {
            return Ok(None);
        };
        let rectification = Rectification::from_bytes(bytes)?;
        for warning in &cameras.warnings {
            note(&format!("warning: {warning}"));
        }
        let camera = rectification.camera(Reference::Left);
        camera
            .map(Some)
            .context("--calibration: the unit of the baseline is not known: give it with --unit")
    }
}

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
