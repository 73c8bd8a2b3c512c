//! The options of a pair of images and of the cameras that took it.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use vgstereo_core::geometry::Rectification;
use vgstereo_core::{DisparityRange, Reference};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_sim::arguments::RectifiedViews;
use vgstereo_sim::cameras::Cameras;
use vgstereo_sim::images::{ImageFile, ViewImages};

use crate::pair::Pair;

/// The options of the verbs that take a pair of images.
#[derive(Debug, Args)]
#[command(next_help_heading = "Images")]
pub struct Images {
    /// Left image: PNG, PPM, PGM or JPEG, rectified unless --calibration is given.
    #[arg(long, value_name = "FILE", requires = "right")]
    left: Option<PathBuf>,
    /// Right image, of the same size.
    #[arg(long, value_name = "FILE", requires = "left")]
    right: Option<PathBuf>,
    /// Calibration of the cameras, as for `vgstereo match`: the images are raw, and the board
    /// rectifies them. Without images, the built-in scene is taken for what these cameras see.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    calibration: Vec<PathBuf>,
    #[command(flatten)]
    views: RectifiedViews,
}

impl Images {
    /// Returns the pair that the options name, to be sent in grey and searched for this number of
    /// disparities from 0 on; `None` if they name none.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn pair(&self, disparities: u16) -> Result<Option<Pair>> {
        let (Some(left), Some(right)) = (&self.left, &self.right) else {
            let cameras = Cameras::read(&self.calibration, &self.views, None)?;
            let Some(bytes) = cameras.rectification else {
                return Ok(None);
            };
            let raw = Rectification::from_bytes(&bytes)?;
            let (width, height) = (raw.raw_width.into(), raw.raw_height.into());
            let pair = Pair {
                name: "courtyard, raw".to_owned(),
                camera: None,
                ..Pair::rendered(width, height, disparities)
            };
            return seen_by(pair, Some(bytes)).map(Some);
        };
        let (left_file, right_file) = (ImageFile::open(left)?, ImageFile::open(right)?);
        let size = left_file.dimensions();
        let cameras = Cameras::read(&self.calibration, &self.views, Some(size))?;
        let views = ViewImages::decode(&left_file, &right_file, None)?;
        let pair = Pair {
            camera: None,
            rectification: None,
            name: left.display().to_string(),
            left: views.left,
            right: views.right,
            format: PixelFormat::Grey8,
            disparities: DisparityRange::up_to(disparities.saturating_sub(1)),
        };
        seen_by(pair, cameras.rectification).map(Some)
    }
}

/// The pair as the views of cameras with this rectification; with `None`, as it is.
fn seen_by(pair: Pair, rectification: Option<Vec<u8>>) -> Result<Pair> {
    let Some(bytes) = rectification else {
        return Ok(pair);
    };
    let camera = Rectification::from_bytes(&bytes)
        .context("--calibration")?
        .camera(Reference::Left);
    Ok(Pair {
        camera: camera.map(|camera| (camera, None)),
        rectification: Some(bytes),
        ..pair
    })
}
