//! The arguments that name the images of a pair, or of many, or a recording.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::escapes::shown;
use crate::images::{Arrangement, is_image};
use crate::pair_files::Pair;
use crate::pair_lists::{self, Found};

/// The arguments that name the images of a pair, or of many.
#[derive(Debug, Clone, Args)]
pub struct PairArguments {
    /// Left image, rectified unless --calibration is given: PNG, JPEG, TIFF, WebP, BMP, PGM or PPM,
    /// in colour or grey; - reads standard input. With --side-by-side or --top-bottom, the picture
    /// of both views. Of many pairs: a folder, a list whose name ends in .txt, or a recording of a
    /// board's link.
    left: PathBuf,
    /// Right image, of the same size; where one of the two is grey, grey is matched. Beside a folder of
    /// left images, that of the right ones.
    right: Option<PathBuf>,
    /// The left and the right images of more pairs.
    #[arg(value_name = "LEFT RIGHT", requires = "right")]
    more: Vec<PathBuf>,
    /// The one image holds both views: the left view is its left half.
    #[arg(long, conflicts_with_all = ["right", "top_bottom"])]
    side_by_side: bool,
    /// The one image holds both views: the left view is its top half.
    #[arg(long, conflicts_with = "right")]
    top_bottom: bool,
}

/// What the arguments name.
#[derive(Debug, Clone)]
pub enum Given {
    /// A pair.
    One(Pair),
    /// Many pairs, or those of a folder or a list, though it were one.
    Many(Found),
    /// A recording of a board's link, or what is meant as one: a file that is no image.
    Recording(PathBuf),
}

impl PairArguments {
    /// The pair, the pairs or the recording. Of one pair, nothing was read yet.
    ///
    /// # Errors
    /// Fails with one line that names the file, folder or argument and the reason.
    pub fn given(&self) -> Result<Given> {
        let arrangement = match (self.side_by_side, self.top_bottom) {
            (true, _) => Some(Arrangement::SideBySide),
            (_, true) => Some(Arrangement::TopBottom),
            _ => None,
        };
        let left = &self.left;
        if left.is_dir() {
            return Ok(Given::Many(match &self.right {
                None => pair_lists::in_folder(left, arrangement)?,
                Some(right) => {
                    ensure!(
                        right.is_dir() && self.more.is_empty(),
                        "{} is a folder: name it alone, or with the folder of the right images",
                        shown(left)
                    );
                    pair_lists::of_folders(left, right)?
                }
            }));
        }
        let Some(right) = &self.right else {
            if left.extension().is_some_and(|ending| ending == "txt") {
                return Ok(Given::Many(pair_lists::in_list(left, arrangement)?));
            }
            if arrangement.is_none() && left.is_file() && !is_image(left) {
                return Ok(Given::Recording(left.clone()));
            }
            let arrangement = arrangement.with_context(|| {
                format!(
                    "{} is one image: RIGHT is missing, or --side-by-side or --top-bottom",
                    shown(left)
                )
            })?;
            return Ok(Given::One(Pair::Joined(left.clone(), arrangement)));
        };
        if self.more.is_empty() {
            return Ok(Given::One(Pair::Separate(left.clone(), right.clone())));
        }
        let images = [left, right].into_iter().chain(&self.more);
        let images: Vec<PathBuf> = images.cloned().collect();
        Ok(Given::Many(pair_lists::of_images(&images)?))
    }
}
