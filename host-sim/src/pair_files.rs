//! The images of a pair: a file of each view, or one picture that holds both.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use crate::images::{Arrangement, ImageFile, ViewImages};

/// Where the images of a pair are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pair {
    /// The left and the right view.
    Separate(PathBuf, PathBuf),
    /// Both views.
    Joined(PathBuf, Arrangement),
}

impl Pair {
    /// The paths of the files, that of the left view or of both first.
    #[must_use]
    pub fn paths(&self) -> Vec<&Path> {
        match self {
            Self::Separate(left, right) => vec![left, right],
            Self::Joined(both, _) => vec![both],
        }
    }

    /// Reads the files and looks at their headers.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn open(&self) -> Result<PairFiles> {
        match self {
            Self::Separate(left, right) => {
                let standard = Path::new("-");
                ensure!(
                    left != standard || right != standard,
                    "standard input has one image: give the other by its name"
                );
                let left = ImageFile::open(left)?;
                Ok(PairFiles::Separate(left, ImageFile::open(right)?))
            }
            Self::Joined(both, arrangement) => {
                Ok(PairFiles::Joined(ImageFile::open(both)?, *arrangement))
            }
        }
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
