//! The options of a pair of images and of the cameras that took it.

use std::path::PathBuf;

use anyhow::Result;
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
        let files = match (&self.left, &self.right) {
            (Some(left), Some(right)) => Some((ImageFile::open(left)?, ImageFile::open(right)?)),
            _ => None,
        };
        let size = files.as_ref().map(|(left, _)| left.dimensions());
        let cameras = Cameras::read(&self.calibration, &self.views, size)?;
        let rectification = cameras.rectification.as_deref();
        let rectification = rectification.map(Rectification::from_bytes).transpose()?;
        let pair = match (files, &rectification) {
            (Some((left, right)), _) => {
                let views = ViewImages::decode(&left, &right, None)?;
                let name = self.left.as_ref().map(|path| path.display().to_string());
                Pair {
                    name: name.unwrap_or_default(),
                    left: views.left,
                    right: views.right,
                    format: PixelFormat::Grey8,
                    disparities: DisparityRange::up_to(disparities.saturating_sub(1)),
                    rectification: None,
                    camera: None,
                }
            }
            (None, Some(raw)) => Pair {
                name: "courtyard, raw".to_owned(),
                ..Pair::rendered(raw.raw_width.into(), raw.raw_height.into(), disparities)
            },
            (None, None) => return Ok(None),
        };
        let camera = rectification.and_then(|raw| raw.camera(Reference::Left));
        Ok(Some(Pair {
            camera: camera.map(|camera| (camera, None)),
            rectification: cameras.rectification,
            ..pair
        }))
    }
}
