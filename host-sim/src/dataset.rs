//! Scenes from disk: one folder each, in the layout of the Middlebury pairs.

use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use image::DynamicImage;
use serde::Deserialize;

use crate::files::read_image;
use crate::scene::{GroundTruth, Mask, Scene};

/// What `meta.toml` of a scene must say; other keys are the data set's own.
#[derive(Debug, Deserialize)]
struct Meta {
    d_max: u16,
    gt_scale: f32,
}

/// The scenes of `folder`: its sub-folders that have a left view, by name. With `names`,
/// those, in that order; `group/scene` reaches a nested one.
///
/// # Errors
/// When the folder cannot be read, a named scene is not there, or there is none.
pub fn find_scenes(folder: &Path, names: &[String]) -> Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    if !names.is_empty() {
        ensure_distinct("scene", names)?;
        let paths = names.iter().map(|name| folder.join(name));
        return paths
            .map(|path| {
                ensure!(
                    path.join("left.png").is_file(),
                    "{} is not a scene: it has no left.png",
                    path.display()
                );
                Ok(path)
            })
            .collect();
    }
    let mut scenes = Vec::new();
    for entry in entries {
        let path = entry
            .with_context(|| format!("cannot read {}", folder.display()))?
            .path();
        if path.join("left.png").is_file() {
            scenes.push(path);
        }
    }
    ensure!(
        !scenes.is_empty(),
        "{} has no scenes: no folder in it has a left.png",
        folder.display()
    );
    scenes.sort();
    Ok(scenes)
}

/// Refuses a list that names something twice: it would count twice in every mean.
///
/// # Errors
/// One line that names what is repeated.
pub fn ensure_distinct<T: PartialEq + Display>(what: &str, list: &[T]) -> Result<()> {
    for (index, item) in list.iter().enumerate() {
        ensure!(
            !list[..index].contains(item),
            "{what} {item} is given twice"
        );
    }
    Ok(())
}

/// Loads one scene: `left.png`, `right.png`, `gt_left.png` (8 or 16 bits, 0 = unknown),
/// `meta.toml` with `d_max` in px and `gt_scale` in steps per px; masks `nonocc.png`,
/// `all.png`, `disc.png` and `gt_right.png` where there are.
///
/// # Errors
/// One line that names the file and the reason.
pub fn load_scene(folder: &Path) -> Result<Scene> {
    let name = folder.file_name().map_or_else(
        || folder.display().to_string(),
        |n| n.to_string_lossy().into_owned(),
    );
    let meta_path = folder.join("meta.toml");
    let text = fs::read_to_string(&meta_path)
        .with_context(|| format!("cannot read {}", meta_path.display()))?;
    let meta: Meta = toml::from_str(&text)
        .map_err(|error| anyhow::anyhow!("{}: {}", meta_path.display(), error.message()))?;
    ensure!(
        meta.gt_scale > 0.0,
        "{}: gt_scale must be above 0",
        meta_path.display()
    );
    let left = read_image(&folder.join("left.png"))?.into_rgb8();
    let size = left.dimensions();
    let load = |file: &str| -> Result<DynamicImage> {
        let path = folder.join(file);
        let image = read_image(&path)?;
        ensure_size(&path, &image, size)?;
        Ok(image)
    };
    let optional = |file: &str| -> Result<Option<DynamicImage>> {
        folder.join(file).is_file().then(|| load(file)).transpose()
    };
    let mask = |file: &str| -> Result<Option<Mask>> { Ok(optional(file)?.map(to_mask)) };
    let right = load("right.png")?.into_rgb8();
    let truth = GroundTruth {
        left_px: to_disparities(load("gt_left.png")?, meta.gt_scale),
        right_px: optional("gt_right.png")?.map(|image| to_disparities(image, meta.gt_scale)),
        nonocc: mask("nonocc.png")?,
        all: mask("all.png")?,
        disc: mask("disc.png")?,
    };
    Ok(Scene {
        name,
        left,
        right,
        d_max: meta.d_max,
        truth: Some(truth),
    })
}

/// Refuses an image of another size than its scene's left view.
fn ensure_size(path: &Path, image: &DynamicImage, (width, height): (u32, u32)) -> Result<()> {
    if (image.width(), image.height()) != (width, height) {
        bail!(
            "{} is {}x{}, but the left view is {width}x{height}",
            path.display(),
            image.width(),
            image.height()
        );
    }
    Ok(())
}

fn to_disparities(image: DynamicImage, scale: f32) -> Vec<f32> {
    let px = |value: u16| match value {
        0 => f32::NAN,
        known => f32::from(known) / scale,
    };
    // A conversion between depths would rescale the values.
    match image {
        DynamicImage::ImageLuma16(image) => image.into_raw().into_iter().map(px).collect(),
        image => {
            let values = image.into_luma8().into_raw().into_iter();
            values.map(|value| px(value.into())).collect()
        }
    }
}

fn to_mask(image: DynamicImage) -> Mask {
    let values = image.into_luma8().into_raw().into_iter();
    values
        .map(|value| value == u8::MAX)
        .collect::<Vec<bool>>()
        .into()
}
