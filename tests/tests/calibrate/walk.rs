//! The walk from pictures of a board to distances, as a person takes it, with rendered cameras: `vgstereo
//! demo --board`, `tools/calibrate.py`, `vgstereo calibration` and `vgstereo match`.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use glam::{DVec2, DVec3};
use vgstereo_sim::calibration::{Keep, Options, RectifiedPair, StereoCalibration, rectify};
use vgstereo_sim::commands::CommandLine;
use vgstereo_sim::dataset::save_scene;
use vgstereo_sim::pfm::Pfm;
use vgstereo_sim::render::{RenderOptions, render_distorted, surface_points};
use vgstereo_sim::scene::Scene;
use vgstereo_tests::command::vgstereo;
use vgstereo_tests::python::Python;

use super::BoardPictures;

/// The preset that matches the scene.
const PRESET: &str = "balanced";
/// Beyond this distance there is nothing but the wall, m.
const WALL_M: f64 = 5.2;

/// Asserts that the distances are as good as with the true calibration.
pub(crate) fn walk(python: &Python, pictures: &BoardPictures) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let scene = folder.join("scene");
    let calibrated = folder.join("calibration.yml");
    let outcome = python.calibrate(
        pictures.folder()?,
        &[
            "--board",
            "9x6",
            "--square",
            "40mm",
            "--out",
            calibrated.to_str().context("a name")?,
        ],
    );
    ensure!(outcome.code == Some(0), "{}", outcome.stderr);
    print!("{}", outcome.stdout);

    // The cameras of `demo --board`.
    let options = RenderOptions::default();
    let (rendered, calibration) = render_distorted(&options)?;
    save_scene(&scene, &rendered, Some(&calibration))?;
    let truth = Truth::new(&options, &rendered, &calibration)?;
    let infos = [scene.join("left.yaml"), scene.join("right.yaml")];
    let by_truth = truth.measure(folder, &scene, &infos)?;
    let by_pictures = truth.measure(folder, &scene, &[calibrated])?;
    println!("true calibration: {by_truth:?}\nfrom the pictures: {by_pictures:?}");
    ensure!(
        by_truth.bad_percent < 12.0,
        "the scene is not matched: {by_truth:?}"
    );
    ensure!(
        by_pictures.bad_percent <= by_truth.bad_percent + 0.5,
        "{by_pictures:?} against {by_truth:?}"
    );
    ensure!(
        (by_pictures.wall_depth_ratio - 1.0).abs() <= 0.01,
        "{by_pictures:?}"
    );
    Ok(())
}

/// What was rendered, and by which cameras.
struct Truth<'a> {
    scene: &'a Scene,
    calibration: &'a StereoCalibration,
    pair: RectifiedPair,
    /// Which pixels of the true left view show the wall.
    wall: Vec<bool>,
}

/// A map of disparities and depths against the truth.
#[derive(Debug)]
struct Measured {
    /// Not occluded pixels whose disparity is more than 1 px off.
    bad_percent: f64,
    /// The depths of the wall over the true ones: the median.
    wall_depth_ratio: f64,
}

impl<'a> Truth<'a> {
    fn new(
        options: &RenderOptions,
        scene: &'a Scene,
        calibration: &'a StereoCalibration,
    ) -> Result<Self> {
        let size = [
            u16::try_from(options.width)?,
            u16::try_from(options.height)?,
        ];
        let pair = RectifiedPair::from_stored(calibration, size)?;
        let points = surface_points(options).into_iter();
        let is_wall = |point: Option<[f64; 3]>| point.is_some_and(|[.., forward]| forward > WALL_M);
        Ok(Self {
            scene,
            calibration,
            pair: pair.context("the calibration has its rectification")?,
            wall: points.map(is_wall).collect(),
        })
    }

    /// Matches the scene with these files as the calibration, and measures what was found.
    fn measure(
        &self,
        folder: &Path,
        scene: &Path,
        files: &[std::path::PathBuf],
    ) -> Result<Measured> {
        let [cameras, map, depth] =
            ["cameras.vgr", "map.pfm", "depth.pfm"].map(|name| folder.join(name));
        let views = [scene.join("left.png"), scene.join("right.png")];
        // Of both calibrations, what is seen by both cameras, in views that are chosen alike.
        let mut words = vec![OsString::from("vgstereo"), "calibration".into()];
        words.extend(files.iter().map(|file| file.clone().into_os_string()));
        words.extend(["--keep", "valid", "--out"].map(OsString::from));
        words.push(cameras.clone().into_os_string());
        CommandLine::try_parse_from(words)?.run()?;
        vgstereo([
            &"match",
            &views[0],
            &views[1],
            &"--calibration",
            &cameras,
            &"--preset",
            &PRESET,
            &"--d-max",
            &self.scene.d_max.to_string(),
            &"--out",
            &map,
            &"--depth",
            &depth,
        ])?;
        let files: Result<Vec<(String, Vec<u8>)>> = files
            .iter()
            .map(|file| Ok((file.display().to_string(), fs::read(file)?)))
            .collect();
        let options = Options {
            keep: Some(Keep::Valid),
            ..Options::default()
        };
        let pair = rectify(&files?, &options)?.pair;
        let [disparities_px, depths_m] = [map, depth].map(|path| -> Result<Pfm> {
            Pfm::from_bytes(&fs::read(&path)?, &path.display().to_string())
        });
        self.compare(&pair, &disparities_px?, &depths_m?)
    }

    /// Compares what was found in the views of `pair` with where its pixels' points are seen, and how far
    /// away they are.
    fn compare(
        &self,
        pair: &RectifiedPair,
        disparities_px: &Pfm,
        depths_m: &Pfm,
    ) -> Result<Measured> {
        let (mut pixels, mut bad, mut ratios) = (0, 0, Vec::new());
        let [width, height] = pair.size.map(usize::from);
        let found = disparities_px.values.iter().zip(&depths_m.values);
        for (index, (&found_px, &found_m)) in found.enumerate() {
            let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
            ensure!(index < width * height, "the map has another size");
            let (raw, is_seen) = pair.raw_position(0, pixel);
            let Some((point, place)) = is_seen.then(|| self.point(raw)).flatten() else {
                continue;
            };
            let right = self.calibration.rotation * point + self.calibration.translation;
            let (raw_right, is_seen) = self.calibration.cameras[1].project(right);
            let Some(tangents) = pair.rectified_ray(1, raw_right).filter(|_| is_seen) else {
                continue;
            };
            let right_px = tangents * pair.focal_px + pair.principal_px[1];
            let true_px = pixel.x - right_px.x;
            pixels += 1;
            bad +=
                usize::from((f64::from(found_px) - true_px).abs() > 1.0 || !found_px.is_finite());
            if self.wall[place] && found_m.is_finite() && found_m > 0.0 {
                let true_mm = (pair.rotations[0] * point).z;
                ratios.push(f64::from(found_m) * 1000.0 / true_mm);
            }
        }
        ensure!(pixels > 100_000 && ratios.len() > 20_000, "little is seen");
        ratios.sort_by(f64::total_cmp);
        let median = ratios.get(ratios.len() / 2);
        Ok(Measured {
            bad_percent: 100.0 * f64::from(u32::try_from(bad)?) / pixels as f64,
            wall_depth_ratio: *median.context("there is no wall")?,
        })
    }

    /// The point that the raw left camera sees at a place, mm, seen from it, and its pixel in the true left
    /// view; `None` where that view does not have it or the right camera does not see it.
    fn point(&self, raw: DVec2) -> Option<(DVec3, usize)> {
        let pair = &self.pair;
        let tangents = pair.rectified_ray(0, raw)?;
        let at = (tangents * pair.focal_px + pair.principal_px[0]).round();
        let [width, height] = pair.size.map(f64::from);
        if !(0.0..width).contains(&at.x) || !(0.0..height).contains(&at.y) {
            return None;
        }
        let place = at.y as usize * usize::from(pair.size[0]) + at.x as usize;
        let truth = self.scene.truth.as_ref()?;
        let known_px = f64::from(truth.left_px[place]);
        if !truth.nonocc.as_ref()?[place] || known_px.is_nan() {
            return None;
        }
        let depth_mm = pair.focal_px * pair.baseline / known_px;
        let turned = tangents.extend(1.0) * depth_mm;
        Some((pair.rotations[0].transpose() * turned, place))
    }
}
