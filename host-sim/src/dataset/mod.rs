//! Scenes on disk. Each has a folder in the layout of the Middlebury pairs.

use std::cell::Cell;
use std::fmt::Display;
use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result, ensure};
use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma};
use vgstereo_core::geometry::Interpolation;

use crate::calibration::{
    Options, Rectified, StereoCalibration, camera_infos, projections, rectify,
};
use crate::escapes::shown;
use crate::files::{encode, make_folder, read_all, read_file, read_text, write_files};
use crate::images::{FILE_BYTES_MAX, ImageFile, ViewImages};
use crate::scene::{GroundTruth, Mask, Scene};

mod mask;
mod meta;
mod truth;
mod values;

pub use mask::StoredMask;
pub use meta::Meta;
pub use truth::{SCALE_RANGE, Truth};

/// What a scene states in numbers.
const META: &str = "meta.toml";
/// The views of a scene.
const VIEWS: [&str; 2] = ["left.png", "right.png"];
/// The files with the truth of a scene.
const TRUTHS: [&str; 4] = ["gt_left.png", "gt_left.pfm", "gt_right.png", "gt_right.pfm"];
/// The masks of a scene.
const MASKS: [&str; 3] = ["nonocc.png", "all.png", "disc.png"];

/// Returns the paths of all files that [`load_scene`] and [`load_calibrated`] may read of these scenes.
///
/// # Errors
/// Fails with one line that names the file and the reason when a `meta.toml` cannot be read.
pub fn scene_files(folders: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for folder in folders {
        let names = [META].into_iter().chain(VIEWS).chain(TRUTHS).chain(MASKS);
        files.extend(names.map(|name| folder.join(name)));
        let calibrations = read_meta(folder)?.calibration_files;
        files.extend(calibrations.iter().map(|name| folder.join(name)));
    }
    Ok(files)
}

/// Returns the folders of scenes in `folder`. Without `names`, these are its sub-folders that
/// have a left view, sorted by name. With `names`, they are the named ones in that order; a name
/// such as `group/scene` stands for a nested folder.
///
/// # Errors
/// Fails when the folder cannot be read, when a named scene does not exist or is named twice, or
/// when there is no scene.
pub fn find_scenes(folder: &Path, names: &[String]) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", shown(folder)))?;
    if !names.is_empty() {
        ensure_distinct("scene", names)?;
        let mut seen = Vec::new();
        return names
            .iter()
            .map(|name| {
                let path = folder.join(name);
                ensure!(
                    path.join("left.png").is_file(),
                    "{} is not a scene: it has no left.png",
                    shown(&path)
                );
                // One folder has many spellings: `a`, `./a`, `a/`, a link.
                let canonical = path.canonicalize();
                let canonical =
                    canonical.with_context(|| format!("cannot read {}", shown(&path)))?;
                ensure!(!seen.contains(&canonical), "scene {name} is given twice");
                seen.push(canonical);
                Ok(path)
            })
            .collect();
    }
    let mut scenes = Vec::new();
    for entry in entries {
        let path = entry
            .with_context(|| format!("cannot read {}", shown(folder)))?
            .path();
        if path.join("left.png").is_file() {
            scenes.push(path);
        }
    }
    ensure!(
        !scenes.is_empty(),
        "{} has no scenes: no folder in it has a left.png",
        shown(folder)
    );
    scenes.sort();
    Ok(scenes)
}

/// Returns names by which scenes are told apart: of each folder the last name of its path, or as many
/// more above it, joined by `/`, as no other of the folders ends with.
#[must_use]
pub fn distinct_names(folders: &[PathBuf]) -> Vec<String> {
    let paths: Vec<PathBuf> = folders
        .iter()
        .map(|folder| folder.canonicalize().unwrap_or_else(|_| folder.clone()))
        .collect();
    let end = |path: &Path, count: usize| -> Vec<String> {
        let normal = path
            .components()
            .filter(|part| matches!(part, Component::Normal(_)));
        let names: Vec<String> = normal
            .map(|part| part.as_os_str().to_string_lossy().into_owned())
            .collect();
        names[names.len().saturating_sub(count)..].to_vec()
    };
    let name = |(index, path): (usize, &PathBuf)| {
        let others = || {
            paths
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index)
        };
        let count = (1..=path.components().count())
            .find(|&count| others().all(|(_, other)| end(other, count) != end(path, count)));
        end(path, count.unwrap_or(usize::MAX)).join("/")
    };
    paths.iter().enumerate().map(name).collect()
}

/// Checks that no item of a list is given twice, since it would count twice in every mean.
/// `what` says what an item is, for the error.
///
/// # Errors
/// Fails with one line that names the repeated item.
pub fn ensure_distinct<T: PartialEq + Display>(what: &str, list: &[T]) -> Result<()> {
    for (index, item) in list.iter().enumerate() {
        ensure!(
            !list[..index].contains(item),
            "{what} {item} is given twice"
        );
    }
    Ok(())
}

/// Loads the scene in a folder.
///
/// The folder must have the views `left.png` and `right.png`, which may be of any format that is
/// read, the ground truth `gt_left.png` or `gt_left.pfm` (see [`Truth`]), and `meta.toml` with `d_max`
/// in px and, for a PNG, `gt_scale` in steps per px. It may have the ground truth `gt_right.png` or
/// `gt_right.pfm` and the masks `nonocc.png`, `all.png` and `disc.png` (see [`StoredMask`]). Without
/// any mask, all pixels with a known truth count, as those of `all`.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn load_scene(folder: &Path) -> Result<Scene> {
    load_scene_with(folder, None)
}

/// Loads the scene in a folder as [`load_scene`] does, with this number of used bits of views
/// that have 16: see [`ViewImages::decode`].
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn load_scene_with(folder: &Path, bits: Option<u8>) -> Result<Scene> {
    let meta = read_meta(folder)?;
    let views = read_views(folder, bits)?;
    let (truth, _) = read_truth(folder, &meta, Some(views.left.dimensions()))?;
    Ok(scene(folder, &meta, views, truth))
}

/// Loads a scene whose views are as the cameras gave them, and the rectification that its truth is
/// for. `meta.toml` names the `calibration_files` of the folder, and may have the projections `P1` and
/// `P2` in a table `rectified`. Otherwise as [`load_scene_with`].
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn load_calibrated(
    folder: &Path,
    bits: Option<u8>,
    interpolation: Interpolation,
) -> Result<(Scene, Rectified)> {
    let meta = read_meta(folder)?;
    let views = read_views(folder, bits)?;
    let (truth, size) = read_truth(folder, &meta, None)?;
    let raw_size = views.left.dimensions();
    let made = rectification(folder, &meta, [raw_size, size], interpolation)?;
    Ok((scene(folder, &meta, views, truth), made))
}

/// The ground truth of a scene, for views from elsewhere.
#[derive(Debug, Clone)]
pub struct KnownScene {
    /// The folder of the scene.
    pub folder: PathBuf,
    meta: Meta,
    /// The ground truth.
    pub truth: GroundTruth,
    /// Width and height of its view, px.
    pub size: (u32, u32),
}

impl KnownScene {
    /// Loads the truth of the scene in a folder, which needs no views. Otherwise as [`load_scene`].
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn load(folder: &Path) -> Result<Self> {
        let meta = read_meta(folder)?;
        let (truth, size) = read_truth(folder, &meta, None)?;
        Ok(Self {
            folder: folder.to_owned(),
            meta,
            truth,
            size,
        })
    }

    /// The largest disparity to search, px.
    #[must_use]
    pub fn d_max(&self) -> u16 {
        self.meta.d_max
    }

    /// The rectification that the truth is for, of views of this size, px, as the cameras gave them, by the
    /// calibration that [`load_calibrated`] takes.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn rectification(
        &self,
        raw_size: (u32, u32),
        interpolation: Interpolation,
    ) -> Result<Rectified> {
        rectification(
            &self.folder,
            &self.meta,
            [raw_size, self.size],
            interpolation,
        )
    }
}

/// The rectification by the calibration of a scene, for raw views and rectified ones of these sizes, px.
fn rectification(
    folder: &Path,
    meta: &Meta,
    sizes: [(u32, u32); 2],
    interpolation: Interpolation,
) -> Result<Rectified> {
    let (name, text) = meta_text(folder)?;
    ensure!(
        !meta.calibration_files.is_empty(),
        "{name}: there are no calibration_files"
    );
    let paths = meta.calibration_files.iter().map(|file| folder.join(file));
    let files = read_all(&paths.collect::<Vec<_>>())?;
    let side = |px: u32| u16::try_from(px).context("a view is too large");
    let [raw, view] = sizes.map(|(width, height)| anyhow::Ok([side(width)?, side(height)?]));
    let options = Options {
        size: Some(raw?),
        view_size: Some(view?),
        projections: projections(&name, text.as_bytes())?,
        interpolation,
        ..Options::default()
    };
    rectify(&files, &options)
}

fn read_meta(folder: &Path) -> Result<Meta> {
    let (name, text) = meta_text(folder)?;
    Meta::parse(&text, &name)
}

/// The name of a scene's `meta.toml`, for messages, and its text.
fn meta_text(folder: &Path) -> Result<(String, String)> {
    let path = folder.join(META);
    Ok((shown(&path), read_text(&path)?))
}

fn read_views(folder: &Path, bits: Option<u8>) -> Result<ViewImages> {
    let [left, right] = VIEWS.map(|file| ImageFile::open(&folder.join(file)));
    ViewImages::decode(&left?, &right?, bits)
}

fn scene(folder: &Path, meta: &Meta, views: ViewImages, truth: GroundTruth) -> Scene {
    let name = folder
        .file_name()
        .map_or_else(|| shown(folder), |n| n.to_string_lossy().into_owned());
    Scene {
        name,
        left: views.left,
        right: views.right,
        bits: views.bits,
        d_max: meta.d_max,
        truth: Some(truth),
    }
}

/// Reads the truth and the masks of a scene, which must be of this size if one is given, and otherwise
/// of one size; and that size, px.
fn read_truth(
    folder: &Path,
    meta: &Meta,
    size: Option<(u32, u32)>,
) -> Result<(GroundTruth, (u32, u32))> {
    let size = Cell::new(size);
    let ensure_size = |path: &Path, found| match size.get() {
        Some(size) => ensure_size(path, found, size),
        None => {
            size.set(Some(found));
            Ok(())
        }
    };
    let truth = |view: &str| -> Result<Option<Vec<f32>>> {
        for extension in ["png", "pfm"] {
            let path = folder.join(format!("gt_{view}.{extension}"));
            if path.is_file() {
                let name = shown(&path);
                ensure!(
                    extension != "png" || meta.gt_scale.is_some(),
                    "{}: gt_scale is missing, the steps per px of {name}",
                    shown(&folder.join(META))
                );
                let truth =
                    Truth::from_bytes(&read_file(&path, FILE_BYTES_MAX)?, meta.gt_scale, &name)?;
                ensure_size(&path, (truth.width, truth.height))?;
                return Ok(Some(truth.px));
            }
        }
        Ok(None)
    };
    let mask = |file: &str| -> Result<Option<Mask>> {
        let path = folder.join(file);
        if !path.is_file() {
            return Ok(None);
        }
        let mask = StoredMask::from_bytes(&read_file(&path, FILE_BYTES_MAX)?, &shown(&path))?;
        ensure_size(&path, (mask.width, mask.height))?;
        Ok(Some(mask.pixels))
    };
    let left_px = truth("left")?
        .with_context(|| format!("{} has neither gt_left.png nor gt_left.pfm", shown(folder)))?;
    let mut truth = GroundTruth {
        right_px: truth("right")?,
        nonocc: mask("nonocc.png")?,
        all: mask("all.png")?,
        disc: mask("disc.png")?,
        left_px,
    };
    if truth.nonocc.is_none() && truth.all.is_none() && truth.disc.is_none() {
        let known: Vec<bool> = truth.left_px.iter().map(|px| !px.is_nan()).collect();
        truth.all = Some(known.into());
    }
    Ok((truth, size.get().unwrap_or_default()))
}

/// Saves a scene that has ground truth in a folder, which is made if it does not exist, so that
/// [`load_scene`] can load it, or [`load_calibrated`] if its views are raw: then with the calibration, as
/// ROS's `left.yaml` and `right.yaml`. Disparities have 16 bits. Other files in the folder are kept.
///
/// # Errors
/// Fails with one line that names the file or folder and the reason, or when the scene has no
/// ground truth. No file is written then.
pub fn save_scene(
    folder: &Path,
    scene: &Scene,
    calibration: Option<&StereoCalibration>,
) -> Result<()> {
    let truth = scene.truth.as_ref();
    let truth = truth.with_context(|| format!("the scene {} has no truth", scene.name))?;
    let (width, height) = scene.left.dimensions();
    // As fine as 16 bits hold.
    let gt_scale = f32::from(u16::MAX / scene.d_max.max(1)).min(256.0);
    let calibrations = match calibration {
        Some(calibration) => {
            let [left, right] = camera_infos(calibration)?;
            vec![("left.yaml", left), ("right.yaml", right)]
        }
        None => Vec::new(),
    };
    let meta = Meta {
        d_max: scene.d_max,
        gt_scale: Some(gt_scale),
        calibration_files: calibrations
            .iter()
            .map(|(name, _)| (*name).to_owned())
            .collect(),
    };
    let disparities = |px: &[f32]| -> Result<DynamicImage> {
        // 0 is unknown, as casts make of NaN; they saturate.
        let values = px.iter().map(|&px| match (px * gt_scale).round() {
            known if known >= 0.0 => (known as u16).max(1),
            _ => 0,
        });
        let image = ImageBuffer::<Luma<u16>, _>::from_raw(width, height, values.collect());
        Ok(image
            .context("the truth has another size than its view")?
            .into())
    };
    let mask = |mask: &Mask| -> Result<DynamicImage> {
        let values = mask.iter().map(|&counts| if counts { u8::MAX } else { 0 });
        let image = GrayImage::from_raw(width, height, values.collect());
        Ok(image
            .context("a mask has another size than its view")?
            .into())
    };
    let mut images = vec![
        ("left.png", scene.left.clone().into()),
        ("right.png", scene.right.clone().into()),
        ("gt_left.png", disparities(&truth.left_px)?),
    ];
    if let Some(right_px) = &truth.right_px {
        images.push(("gt_right.png", disparities(right_px)?));
    }
    let masks = [
        ("nonocc.png", &truth.nonocc),
        ("all.png", &truth.all),
        ("disc.png", &truth.disc),
    ];
    for (name, pixels) in masks {
        if let Some(pixels) = pixels {
            images.push((name, mask(pixels)?));
        }
    }
    let mut paths = vec![folder.join(META)];
    let mut contents = vec![toml::to_string(&meta)?.into_bytes()];
    for (name, image) in &images {
        paths.push(folder.join(name));
        contents.push(encode(image, ImageFormat::Png)?);
    }
    for (name, text) in calibrations {
        paths.push(folder.join(name));
        contents.push(text.into_bytes());
    }
    make_folder(folder)?;
    let files: Vec<_> = paths.iter().map(PathBuf::as_path).zip(contents).collect();
    write_files(&files)
}

/// Checks that a file's image is as large as the left view of its scene.
fn ensure_size(path: &Path, found: (u32, u32), view: (u32, u32)) -> Result<()> {
    ensure!(
        found == view,
        "{} is {}x{}, but the left view is {}x{}",
        shown(path),
        found.0,
        found.1,
        view.0,
        view.1
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    #[test]
    fn scenes_are_named_apart() {
        let names = |paths: &[&str]| {
            let folders: Vec<PathBuf> = paths.iter().map(PathBuf::from).collect();
            distinct_names(&folders)
        };
        assert_eq!(
            names(&["/x/v2/tsukuba", "/x/v2/teddy"]),
            ["tsukuba", "teddy"]
        );
        assert_eq!(
            names(&["/x/g1/a", "/x/g2/a", "/x/b"]),
            ["g1/a", "g2/a", "b"]
        );
        assert_eq!(
            names(&["/x/g/a", "/y/g/a", "/x/g-a"]),
            ["x/g/a", "y/g/a", "g-a"]
        );
        assert_eq!(names(&["/a", "/x/a"]), ["a", "x/a"]);
    }

    /// What is saved is what is loaded, disparities to a step of 16 bits.
    #[test]
    fn a_saved_scene_is_loaded_again() {
        let folder = tempfile::tempdir().unwrap();
        for d_max in [3, 47, 2000] {
            let path = folder.path().join(format!("far {d_max}"));
            let left_px = vec![f32::NAN, 0.0, 0.3, 1.0, 2.97, f32::from(d_max)];
            let mask = |flags: [bool; 6]| Some(Mask::from(flags.to_vec()));
            let scene = Scene {
                name: format!("far {d_max}"),
                left: RgbImage::from_fn(3, 2, |x, y| image::Rgb([x as u8, y as u8, 200])),
                right: RgbImage::from_fn(3, 2, |x, y| image::Rgb([9, x as u8, y as u8])),
                bits: None,
                d_max,
                truth: Some(GroundTruth {
                    left_px: left_px.clone(),
                    right_px: Some(left_px.iter().rev().copied().collect()),
                    nonocc: mask([true, false, true, true, false, true]),
                    all: mask([true; 6]),
                    disc: mask([false, false, true, false, false, true]),
                }),
            };
            save_scene(&path, &scene, None).unwrap();
            let loaded = load_scene(&path).unwrap();
            assert_eq!(
                (&loaded.name, &loaded.left, &loaded.right, loaded.d_max),
                (&scene.name, &scene.left, &scene.right, d_max)
            );
            let (truth, saved) = (loaded.truth.unwrap(), scene.truth.unwrap());
            let masks = |truth: &GroundTruth| {
                [&truth.nonocc, &truth.all, &truth.disc].map(|mask| mask.clone().unwrap())
            };
            assert_eq!(masks(&truth), masks(&saved));
            let pairs = truth.left_px.iter().zip(&saved.left_px);
            let pairs = pairs.chain(
                truth
                    .right_px
                    .iter()
                    .flatten()
                    .zip(saved.right_px.iter().flatten()),
            );
            // 0 is unknown in the file: what is known is a step from it at least.
            let step = (f32::from(d_max) / f32::from(u16::MAX - 2000)).max(1.0 / 256.0);
            for (&loaded, &saved) in pairs {
                assert_eq!(loaded.is_nan(), saved.is_nan());
                assert!(
                    loaded.is_nan() || (loaded - saved).abs() <= step,
                    "{loaded} {saved}"
                );
            }
            let without = Scene {
                truth: None,
                ..load_scene(&path).unwrap()
            };
            assert!(save_scene(&path, &without, None).is_err());
        }
    }
}
