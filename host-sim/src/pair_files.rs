//! The image files of a pair: one of each view, or one picture that holds both.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;

use crate::images::{Arrangement, ImageFile, ViewImages};

/// The arguments that name the images of a pair.
#[derive(Debug, Clone, Args)]
pub struct PairArguments {
    /// Left image, rectified unless --calibration is given: PNG, JPEG, TIFF, WebP, BMP, PGM or PPM,
    /// in colour or grey; - reads standard input. With --side-by-side or --top-bottom, the picture
    /// of both views.
    left: PathBuf,
    /// Right image, of the same size; where one of the two is grey, grey is matched.
    #[arg(required_unless_present_any = ["side_by_side", "top_bottom"])]
    right: Option<PathBuf>,
    /// The one image holds both views: the left view is its left half.
    #[arg(long, conflicts_with_all = ["right", "top_bottom"])]
    side_by_side: bool,
    /// The one image holds both views: the left view is its top half.
    #[arg(long, conflicts_with = "right")]
    top_bottom: bool,
}

impl PairArguments {
    /// The paths of the files, that of the left view or of both first.
    #[must_use]
    pub fn paths(&self) -> Vec<&Path> {
        let right = self.right.as_deref();
        std::iter::once(self.left.as_path()).chain(right).collect()
    }

    /// Reads the files and looks at their headers.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn open(&self) -> Result<PairFiles> {
        let standard = Path::new("-");
        if let Some(right) = &self.right {
            ensure!(
                self.left != standard || right != standard,
                "standard input has one image: give the other by its name"
            );
            let left = ImageFile::open(&self.left)?;
            return Ok(PairFiles::Separate(left, ImageFile::open(right)?));
        }
        let arrangement = match (self.side_by_side, self.top_bottom) {
            (true, _) => Arrangement::SideBySide,
            (_, true) => Arrangement::TopBottom,
            // The parser has asked for the right image before.
            _ => bail!("a pair has two views"),
        };
        let both = ImageFile::open(&self.left)?;
        Ok(PairFiles::Joined(both, arrangement))
    }
}

/// The image files of a pair, whose headers were read.
#[derive(Debug)]
pub enum PairFiles {
    /// The left and the right view.
    Separate(ImageFile, ImageFile),
    /// Both views.
    Joined(ImageFile, Arrangement),
}

impl PairFiles {
    /// Width and height of a view, px.
    ///
    /// # Errors
    /// Fails with one line that names the file when it cannot be halved.
    pub fn dimensions(&self) -> Result<(u32, u32)> {
        match self {
            Self::Separate(left, _) => Ok(left.dimensions()),
            Self::Joined(both, arrangement) => arrangement.view_dimensions(both),
        }
    }

    /// Decodes the views, as [`ViewImages::decode`] and [`ViewImages::decode_joined`] do.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn decode(&self, bits: Option<u8>) -> Result<ViewImages> {
        match self {
            Self::Separate(left, right) => ViewImages::decode(left, right, bits),
            Self::Joined(both, arrangement) => ViewImages::decode_joined(both, *arrangement, bits),
        }
    }
}
