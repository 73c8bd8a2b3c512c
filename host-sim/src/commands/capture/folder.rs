//! The folder of the pairs that are captured.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};

use crate::escapes::shown;
use crate::files::{encode, make_folder, write_files};
use crate::link::pixels::Pixels;

/// A folder whose pairs are numbered.
#[derive(Debug)]
pub(super) struct PairFolder {
    path: PathBuf,
    /// The number of the first pair that is written.
    first: u32,
    written: u32,
    size: Option<[u32; 2]>,
}

impl PairFolder {
    /// Looks into a folder, whose pairs stay. One that does not exist is made when the first pair is
    /// written.
    ///
    /// # Errors
    /// Fails with one line that names the folder and the reason.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let context = || shown(path);
        let mut first = 1;
        let entries = match fs::read_dir(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            entries => Some(entries.with_context(context)?),
        };
        for entry in entries.into_iter().flatten() {
            let name = entry.with_context(context)?.file_name();
            let number = name.to_str().and_then(number_of).unwrap_or_default();
            first = first.max(number.saturating_add(1));
        }
        Ok(Self {
            path: path.to_owned(),
            first,
            written: 0,
            size: None,
        })
    }

    /// Number of pairs that were written.
    pub(super) fn written(&self) -> u32 {
        self.written
    }

    /// Writes a pair, both views or none, and returns its names.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub(super) fn write(&mut self, views: &[Pixels; 2]) -> Result<String> {
        let names = names(self.first.saturating_add(self.written));
        let mut files = Vec::new();
        for (name, view) in names.iter().zip(views) {
            let picture = picture(view)?;
            self.size = Some([picture.width(), picture.height()]);
            files.push((self.path.join(name), encode(&picture, ImageFormat::Png)?));
        }
        make_folder(&self.path)?;
        write_files(&files)?;
        self.written += 1;
        Ok(names.join(" "))
    }

    /// The names of the last pair that was written.
    pub(super) fn last(&self) -> Option<[String; 2]> {
        let last = self.written.checked_sub(1)?;
        Some(names(self.first.saturating_add(last)))
    }

    /// How many pairs were written, their size and names, as a sentence for the terminal.
    pub(super) fn told(&self) -> String {
        let folder = shown(&self.path);
        match (self.last(), self.size) {
            (Some([_, last]), Some([width, height])) => {
                let [first, _] = names(self.first);
                let pairs = match self.written {
                    1 => "1 pair".to_owned(),
                    count => format!("{count} pairs"),
                };
                format!("wrote {pairs} of {width}x{height} px to {folder}: {first} to {last}")
            }
            _ => format!("wrote no pair to {folder}"),
        }
    }
}

/// The names of a pair, as `tools/calibrate.py` knows them.
fn names(number: u32) -> [String; 2] {
    ["left", "right"].map(|side| format!("{side}_{number:02}.png"))
}

/// The number of a picture with such a name.
fn number_of(name: &str) -> Option<u32> {
    let number = name
        .strip_prefix("left_")
        .or_else(|| name.strip_prefix("right_"))?;
    number.strip_suffix(".png")?.parse().ok()
}

fn picture(view: &Pixels) -> Result<DynamicImage> {
    let plane = view.colour.as_ref().unwrap_or(&view.grey);
    let width = u32::try_from(view.grey.width)?;
    let height = u32::try_from(plane.height())?;
    let values = plane.values.clone();
    let picture = match view.colour {
        Some(_) => RgbImage::from_raw(width, height, values).map(DynamicImage::from),
        None => GrayImage::from_raw(width, height, values).map(DynamicImage::from),
    };
    picture.context("the views are not made of whole lines")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::plane::Plane;

    fn plane(width: u32, values: &[u8]) -> Plane<u8> {
        let mut plane = Plane::new([0, 0], [width, 2], 0).unwrap();
        for (line, row) in (0..).zip(values.chunks(width as usize)) {
            plane.put(line, 0, row.len(), |place| {
                place.copy_from_slice(row);
                true
            });
        }
        plane
    }

    #[test]
    fn pairs_are_numbered_after_those_that_are_there() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["left_07.png", "right_101.png", "left_x.png", "left_900.jpg"] {
            fs::write(folder.path().join(name), name).unwrap();
        }
        let grey = plane(2, &[1, 2, 3, 4]);
        let colour = plane(6, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        let views = [
            Pixels {
                grey: grey.clone(),
                colour: None,
            },
            Pixels {
                grey,
                colour: Some(colour.clone()),
            },
        ];
        let mut pairs = PairFolder::open(folder.path()).unwrap();
        assert!(
            pairs.told().starts_with("wrote no pair"),
            "{}",
            pairs.told()
        );
        assert_eq!(pairs.write(&views).unwrap(), "left_102.png right_102.png");
        assert_eq!(pairs.write(&views).unwrap(), "left_103.png right_103.png");
        let told = pairs.told();
        for words in ["2 pairs of 2x2 px", "left_102.png to right_103.png"] {
            assert!(told.contains(words), "{told}");
        }
        let left = image::open(folder.path().join("left_103.png")).unwrap();
        assert_eq!(
            left,
            DynamicImage::from(GrayImage::from_raw(2, 2, vec![1, 2, 3, 4]).unwrap())
        );
        let right = image::open(folder.path().join("right_103.png")).unwrap();
        assert_eq!(right.into_rgb8().into_raw(), colour.values);
        assert_eq!(
            fs::read(folder.path().join("left_07.png")).unwrap(),
            b"left_07.png"
        );
    }
}
