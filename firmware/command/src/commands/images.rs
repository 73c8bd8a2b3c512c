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
    #[command(flatten)]
    calibration: Calibration,
}

/// The options of what takes lines of cameras that are not rectified.
#[derive(Debug, Args)]
pub struct Calibration {
    /// Calibration of the cameras, as for `vgstereo match`: they send raw lines, and the board
    /// rectifies them. Without images, the built-in scene is taken for what they see.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    calibration: Vec<PathBuf>,
    #[command(flatten)]
    views: RectifiedViews,
}

impl Calibration {
    /// Returns the built-in scene as what these cameras see in views of this size, px, or of the size that the
    /// calibration is for; `None` if the options name no cameras.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn pair(&self, size: Option<(u32, u32)>, disparities: u16) -> Result<Option<Pair>> {
        self.with_images(None, size, disparities)
    }

    /// Returns this pair of images, or the built-in scene, as what these cameras see in views of this size.
    fn with_images(
        &self,
        images: Option<Pair>,
        size: Option<(u32, u32)>,
        disparities: u16,
    ) -> Result<Option<Pair>> {
        let cameras = Cameras::read(&self.calibration, &self.views, size)?;
        let rectification = cameras.rectification.as_deref();
        let rectification = rectification.map(Rectification::from_bytes).transpose()?;
        let pair = match (images, &rectification) {
            (Some(pair), _) => pair,
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

impl Images {
    /// Returns the pair that the options name, to be sent in grey and searched for this number of
    /// disparities from 0 on; `None` if they name none.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn pair(&self, disparities: u16) -> Result<Option<Pair>> {
        let (Some(left), Some(right)) = (&self.left, &self.right) else {
            return self.calibration.pair(None, disparities);
        };
        let views = ViewImages::decode(&ImageFile::open(left)?, &ImageFile::open(right)?, None)?;
        let size = views.left.dimensions();
        let pair = Pair {
            name: left.display().to_string(),
            left: views.left,
            right: views.right,
            format: PixelFormat::Grey8,
            disparities: DisparityRange::up_to(disparities.saturating_sub(1)),
            rectification: None,
            camera: None,
        };
        self.calibration
            .with_images(Some(pair), Some(size), disparities)
    }
}
