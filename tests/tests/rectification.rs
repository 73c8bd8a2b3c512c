//! Calibrations of real cameras: files are read as the numbers that OpenCV read from them, and views are
//! rectified as OpenCV rectifies them.
//!
//! The oracle is `meta.toml` and `corners.csv` beside the files, computed by OpenCV 5. The tests run if
//! `UNRECTIFIED_DIR` names the folder; otherwise they are listed as ignored.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DVec2, DVec3};
use libtest_mimic::{Arguments, Trial};
use serde::Deserialize;
use vgstereo_core::geometry::{Interpolation, Rectification, Rectifier, ViewMap};
use vgstereo_core::{Config, DisparityRange, INVALID, Output, Preset, Reference};
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::calibration::{
    Keep, Lens, Maps, Options, RectifiedPair, StereoCalibration, checked, read, rectify,
};
use vgstereo_sim::dataset::load_calibrated;
use vgstereo_sim::point_files::PointFormat;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::rectify::rectified;
use vgstereo_sim::views::{picture_of, views_of};
use vgstereo_tests::failed;

/// The folders of pairs, with further files of the same calibration.
const PAIRS: [(&str, &[&[&str]]); 10] = [
    ("stereopi_room", &[]),
    ("stereopi_board", &[]),
    ("opencv_board", &[&["left.yaml", "right.yaml"]]),
    (
        "bumblebee_garden",
        &[&["stereo.yaml"], &["extrinsics.yml", "intrinsics.yml"]],
    ),
    (
        "bumblebee_board",
        &[&["stereo.yaml"], &["right.yaml", "left.yaml"]],
    ),
    (
        "euroc_hall",
        &[&["kalibr_imucam_chain.yaml"], &["ORB_SLAM2_EuRoC.yaml"]],
    ),
    ("teddy_warped", &[]),
    ("cones_warped", &[]),
    ("tsukuba_warped", &[]),
    ("venus_warped", &[]),
];

fn main() {
    let mut trials = Vec::new();
    for (name, others) in PAIRS {
        trials.push(trial(format!("{name}::is_read"), move |root| {
            is_read(&root.join(name), others)
        }));
        trials.push(trial(
            format!("{name}::is_rectified_as_opencv_does"),
            move |root| is_rectified(&root.join(name)),
        ));
        trials.push(trial(
            format!("{name}::maps_are_near_and_strips_small"),
            move |root| maps_are_near(&root.join(name)),
        ));
    }
    for name in ["stereopi_board", "opencv_board", "bumblebee_board"] {
        trials.push(trial(
            format!("{name}::corners_are_found_in_the_raw_views"),
            move |root| corners_are_found(&root.join(name)),
        ));
        trials.push(trial(
            format!("{name}::corners_are_on_one_line_of_both_views"),
            move |root| corners_are_on_one_line(&root.join(name)),
        ));
    }
    // Squares repeat: on one board `lite` takes 41 % of the pixels that it finds for those two
    // squares further, by the disparities of the corners, and its points have no plane.
    for (name, square_mm, spared) in [
        ("stereopi_board", 25.0, None),
        ("opencv_board", 25.0, Some(Preset::Lite)),
        ("bumblebee_board", 30.0, None),
    ] {
        trials.push(trial(
            format!("{name}::squares_have_their_size_in_clouds_of_points"),
            move |root| squares_have_their_size(&root.join(name), square_mm, spared),
        ));
    }
    trials.push(trial(
        "warped_pairs::are_matched_as_well_as_opencv_rectifies_them".to_owned(),
        warped_pairs_are_matched,
    ));
    for name in ["bumblebee_garden", "euroc_hall"] {
        trials.push(trial(
            format!("{name}::is_found_for_the_most_part"),
            move |root| most_is_found(&root.join(name)),
        ));
    }
    trials.push(trial(
        "calibrations::are_read_refused_or_warned_of".to_owned(),
        |root| loose_files(&root.join("calibrations")),
    ));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// A test that gets the folder of the data, or is ignored if there is none.
fn trial(name: String, test: impl FnOnce(&Path) -> Result<()> + Send + 'static) -> Trial {
    let folder = std::env::var_os("UNRECTIFIED_DIR").map(PathBuf::from);
    let absent = folder.is_none();
    let run = move || test(&folder.unwrap_or_default()).map_err(failed);
    Trial::test(name, run).with_ignored_flag(absent)
}

/// What OpenCV read and computed.
struct Truth {
    meta: toml::Table,
    is_warped: bool,
}

impl Truth {
    fn open(folder: &Path) -> Result<Self> {
        let text = fs::read_to_string(folder.join("meta.toml"))?;
        let is_warped = folder.display().to_string().ends_with("_warped");
        Ok(Self {
            meta: text.parse()?,
            is_warped,
        })
    }

    fn numbers(&self, table: &str, key: &str) -> Vec<f64> {
        let values = self.meta[table][key].as_array().unwrap();
        values
            .iter()
            .map(|value| {
                let whole = value.as_integer().map(|number| number as f64);
                value.as_float().or(whole).unwrap()
            })
            .collect()
    }

    fn matrix(&self, table: &str, key: &str) -> DMat3 {
        let numbers: [f64; 9] = self.numbers(table, key).try_into().unwrap();
        DMat3::from_cols_array(&numbers).transpose()
    }

    fn vector(&self, table: &str, key: &str) -> DVec3 {
        let numbers: [f64; 3] = self.numbers(table, key).try_into().unwrap();
        DVec3::from_array(numbers)
    }

    fn projections(&self) -> [[f64; 12]; 2] {
        ["P1", "P2"].map(|key| self.numbers("rectified", key).try_into().unwrap())
    }

    fn size(&self) -> [u16; 2] {
        ["width", "height"].map(|key| self.meta[key].as_integer().unwrap() as u16)
    }

    /// The unit of the translation, mm, where the files leave it open or state another one.
    fn unit_mm(&self) -> Option<f64> {
        if let Some(unit) = self.meta["rectified"].get("unit_mm") {
            return Some(unit.as_integer().unwrap() as f64);
        }
        (self.meta["format"].as_str() == Some("opencv")).then_some(1.0)
    }

    fn calibration_files(&self) -> Vec<&str> {
        let files = self.meta["calibration_files"].as_array().unwrap();
        files.iter().map(|file| file.as_str().unwrap()).collect()
    }
}

fn contents(folder: &Path, names: &[&str]) -> Result<Vec<(String, Vec<u8>)>> {
    let file = |name: &&str| {
        let bytes = fs::read(folder.join(name)).with_context(|| (*name).to_owned())?;
        Ok(((*name).to_owned(), bytes))
    };
    names.iter().map(file).collect()
}

fn options(truth: &Truth) -> Options {
    Options {
        size: Some(truth.size()),
        projections: Some(truth.projections()),
        unit_mm: truth.unit_mm(),
        ..Options::default()
    }
}

fn close(what: &str, found: f64, expected: f64, tolerance: f64) -> Result<()> {
    ensure!(
        (found - expected).abs() <= tolerance,
        "{what}: {found}, and OpenCV has {expected}"
    );
    Ok(())
}

fn is_read(folder: &Path, others: &[&[&str]]) -> Result<()> {
    let truth = Truth::open(folder)?;
    let named = truth.calibration_files();
    for names in [named.as_slice()].into_iter().chain(others.iter().copied()) {
        let calibration = read(&contents(folder, names)?)?;
        // The numbers of meta.toml have ten digits.
        for (view, camera) in calibration.cameras.iter().enumerate() {
            let matrix = truth.numbers("calibration", ["K1", "K2"][view]);
            for (found, at) in [
                (camera.focal_px.x, 0),
                (camera.principal_px.x, 2),
                (camera.focal_px.y, 4),
                (camera.principal_px.y, 5),
            ] {
                close(&format!("{names:?} K{}", view + 1), found, matrix[at], 1e-6)?;
            }
            let coefficients = truth.numbers("calibration", ["D1", "D2"][view]);
            let expected = Lens::radial_tangential(&coefficients)?;
            for step in 0..40 {
                let ray = DVec2::from_angle(f64::from(step)) * 0.01 * f64::from(step);
                let error = camera.lens.distort(ray) - expected.distort(ray);
                close(
                    &format!("{names:?} D{} at {ray}", view + 1),
                    error.length(),
                    0.0,
                    1e-8,
                )?;
            }
            ensure!(camera.size.is_none_or(|size| size == truth.size()));
        }
        let rotation = calibration.rotation - truth.matrix("calibration", "R");
        let largest = rotation
            .to_cols_array()
            .into_iter()
            .fold(0.0, |a: f64, b| a.max(b.abs()));
        // ORB-SLAM's file has its own rectification, and R by way of that.
        close(&format!("{names:?} R"), largest, 0.0, 2e-9)?;
        // ROS has the rectified translation in metres, whatever the unit of the others.
        let expected = truth.vector("calibration", "T");
        let mut translation = calibration.translation;
        if truth.is_warped && calibration.unit_mm.is_some() {
            translation *= 1000.0;
        }
        let error = (translation - expected).length() / expected.length();
        close(&format!("{names:?} T {translation}"), error, 0.0, 1e-6)?;
    }
    Ok(())
}

fn is_rectified(folder: &Path) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let (calibration, size) = checked(read(&files)?, Some(truth.size()))?;
    let pair = RectifiedPair::compute(&calibration, size, size, false)?;
    for (found, key) in pair.rotations.iter().zip(["R1", "R2"]) {
        let expected = truth.matrix("rectified", key);
        // Ten digits, and twelve of ROS's rotations that R was computed from.
        ensure!(
            found.abs_diff_eq(expected, 2e-9),
            "{key}: {found} {expected}"
        );
    }
    let expected = truth.projections();
    // Those of the warped pairs are Middlebury's. OpenCV inverts the distortion in 5 steps, which do not
    // converge at the corners of the StereoPi: its focal length, 380.728 px, is what 5 steps give, and
    // what converges is shorter and shows more.
    let is_alpha_0 = !truth.is_warped && !folder.display().to_string().contains("stereopi");
    if is_alpha_0 {
        for (view, expected) in expected.iter().enumerate() {
            let found = pair.principal_px[view];
            // OpenCV's five steps leave up to 0.02 px here as well.
            close("focal length", pair.focal_px, expected[0], 0.05)?;
            close("cx", found.x, expected[2], 0.05)?;
            close("cy", found.y, expected[6], 0.05)?;
        }
        let baseline = -expected[1][3] / expected[1][0];
        close("baseline", pair.baseline / baseline, 1.0, 1e-6)?;
    }
    // The part that is kept is valid, all but a seam.
    let maps = Maps::new(&pair, None, Interpolation::Bilinear)?;
    ensure!(
        maps.valid.iter().all(|&share| share > 0.99),
        "{:?}",
        maps.valid
    );
    // And all that the cameras see is more than that.
    let all = RectifiedPair::compute(&calibration, size, size, true)?;
    ensure!(all.focal_px < pair.focal_px);
    Ok(())
}

fn maps_are_near(folder: &Path) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let made = rectify(&files, &options(&truth))?;
    let bound_px = if truth.is_warped { 0.15 } else { 0.1 };
    ensure!(made.maps.error_px <= bound_px, "{} px", made.maps.error_px);
    let rectification = made.maps.rectification()?;
    // The bytes say what the exact map says, as far as it is told.
    let mut largest: f64 = 0.0;
    for view in [0, 1] {
        let map = [&rectification.left, &rectification.right][view];
        for y in 0..rectification.height {
            for x in map.valid_columns(y) {
                let (place, is_seen) = made.pair.raw_position(view, DVec2::new(x.into(), y.into()));
                ensure!(is_seen, "{x}, {y} is valid and not seen");
                largest = largest.max((position(map, x, y) - place).length());
            }
        }
    }
    close("told error", made.maps.error_px, largest, 1e-9)?;
    let focal_baseline = truth.projections()[1][3].abs();
    // meta.toml has that of warped pairs in mm.
    let unit_mm = if truth.is_warped {
        None
    } else {
        truth.unit_mm()
    }
    .unwrap_or(1.0);
    let depth = rectification.depth.context("no depth")?;
    let doffs = truth.projections()[1][2] - truth.projections()[0][2];
    for disparity in [10, 40, 100] {
        let expected = focal_baseline * unit_mm / (f64::from(disparity) + doffs);
        close("depth, mm", depth.mm(disparity * 16).into(), expected, 0.51)?;
    }
    // A strip of 320 columns: lines grow with the width.
    let narrow = narrowed(made.calibration, made.pair, 320)?;
    let maps = Maps::new(&narrow, None, Interpolation::Bilinear)?;
    let words = Rectifier::words(&maps.rectification()?, false);
    let kib = words as f64 * 4.0 / 1024.0;
    // What a strip may take on a microcontroller with 128 KB, set before it was measured.
    let bound_kib = if truth.is_warped { 18.0 } else { 14.0 };
    ensure!(kib <= bound_kib, "{kib} KiB at 320 columns");
    Ok(())
}

/// Bad pixels of the raw views, rectified by the core, are on average at most 0.3 % above those of the
/// views that OpenCV rectified.
fn warped_pairs_are_matched(root: &Path) -> Result<()> {
    let presets = [
        Preset::Lite,
        Preset::Micro,
        Preset::Balanced,
        Preset::Quality,
    ];
    let mut sums = [[0.0; 2]; 4];
    for (name, _) in PAIRS {
        if !name.ends_with("_warped") {
            continue;
        }
        let (scene, made) = load_calibrated(&root.join(name), None, Interpolation::Bilinear)?;
        let mut by_opencv = scene.clone();
        for (view, side) in [
            (&mut by_opencv.left, "left"),
            (&mut by_opencv.right, "right"),
        ] {
            let path = root.join(name).join(format!("{side}_rect.png"));
            *view = image::open(path)?.into_rgb8();
        }
        let ours = Prepared::rectified(scene, false, &made.maps.rectification()?)?;
        let opencv = Prepared::new(by_opencv, false)?;
        for (preset, sums) in presets.iter().zip(&mut sums) {
            for (prepared, sum) in [&ours, &opencv].into_iter().zip(sums) {
                let matched = prepared.matched(preset.parameters(), Output::Dense, 2)?;
                let bad = prepared.measure(&matched, 1.0, false)?;
                *sum += bad.average().context("no masks")? / 4.0;
            }
        }
    }
    for (preset, [ours, opencv]) in presets.iter().zip(sums) {
        println!("{preset}: {ours:.2} % bad, {opencv:.2} % as OpenCV rectifies");
        ensure!(
            ours <= opencv + 0.3,
            "{preset}: {ours} %, OpenCV {opencv} %"
        );
    }
    Ok(())
}

/// `balanced` finds at least 80 % of the valid pixels of a real pair, and nothing where the camera saw
/// nothing.
fn most_is_found(folder: &Path) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let made = rectify(&files, &options(&truth))?;
    let rectification = made.maps.rectification()?;
    let [left, right] = ["left.png", "right.png"].map(|name| image::open(folder.join(name)));
    let raw = views_of(left?.into_rgb8(), right?.into_rgb8(), false)?;
    let views = rectified(&raw, &rectification)?;
    let d_max = truth.meta["d_max"].as_integer().context("no d_max")?;
    let disparities = DisparityRange::up_to(u16::try_from(d_max)?);
    let config = Config {
        colour: views.has_colour(),
        ..Config::new(Preset::Balanced.parameters(), views.width, disparities)
    };
    let matched = match_frame(&config, &views, NativeKernels::fastest(), 2)?;
    let (mut valid, mut found) = (0, 0);
    let pixels = matched.disparities_q4.iter().zip(&matched.confidences);
    for (at, (&disparity_q4, &confidence)) in pixels.enumerate() {
        let (x, y) = (at % usize::from(views.width), at / usize::from(views.width));
        let columns = rectification.left.valid_columns(u16::try_from(y)?);
        if columns.contains(&u16::try_from(x)?) {
            valid += 1;
            found += usize::from(confidence > 0);
        } else {
            ensure!(disparity_q4 == INVALID && confidence == 0, "{x}, {y}");
        }
        if confidence > 0 {
            let other = f64::from(x as u32) - f64::from(disparity_q4) / 16.0;
            let columns = rectification.right.valid_columns(u16::try_from(y)?);
            // The step below a pixel may lead half a pixel beyond.
            let is_seen =
                other > f64::from(columns.start) - 0.6 && other < f64::from(columns.end) - 0.4;
            ensure!(is_seen, "{x}, {y} matches {other}, outside of {columns:?}");
        }
    }
    println!(
        "found {:.1} % of the valid pixels",
        100.0 * f64::from(found as u32) / f64::from(valid)
    );
    ensure!(
        found * 100 >= usize::try_from(valid)? * 80,
        "{found} of {valid}"
    );
    Ok(())
}

/// The pair with pixels joined until it has this many columns, the same for raw and rectified views.
fn narrowed(
    calibration: StereoCalibration,
    mut pair: RectifiedPair,
    columns: u16,
) -> Result<RectifiedPair> {
    let by = f64::from(pair.raw_size[0]) / f64::from(columns);
    let joined = |px: DVec2| (px + 0.5) / by - 0.5;
    let lines = (f64::from(pair.raw_size[1]) / by).round() as u16;
    ensure!(calibration.cameras == pair.cameras);
    for camera in &mut pair.cameras {
        camera.focal_px /= by;
        camera.principal_px = joined(camera.principal_px);
    }
    pair.focal_px /= by;
    pair.principal_px = pair.principal_px.map(joined);
    pair.raw_size = [columns, lines];
    pair.size = pair.raw_size;
    Ok(pair)
}

/// Where the stored map says that a rectified pixel lies, px.
fn position(map: &ViewMap<'_>, x: u16, y: u16) -> DVec2 {
    let step = 1_u16 << map.step_shift();
    let cell = usize::from(x / step);
    let knot = |column| {
        let [x, y] = map.knot(column, y);
        DVec2::new(x.into(), y.into()) / (64.0 * f64::from(step))
    };
    knot(cell).lerp(knot(cell + 1), f64::from(x % step) / f64::from(step))
}

/// Where the stored map says that a place of the rectified view lies: between the four pixels around
/// it, px.
fn raw_position(map: &ViewMap<'_>, rectified: DVec2) -> DVec2 {
    let corner = rectified.floor();
    let share = rectified - corner;
    let [x, y] = corner.to_array().map(|at| at as u16);
    let upper = position(map, x, y).lerp(position(map, x + 1, y), share.x);
    let lower = position(map, x, y + 1).lerp(position(map, x + 1, y + 1), share.x);
    upper.lerp(lower, share.y)
}

/// The place of a rectified view, up to `last`, that its map leads to a place of the raw view,
/// searched for from `start` on, and by how much its raw place is off, px.
fn rectified_position(map: &ViewMap<'_>, raw: DVec2, start: DVec2, last: DVec2) -> (DVec2, f64) {
    let mut place = start;
    // The maps hardly turn or scale: what is missing in the raw view is nearly what is missing
    // here.
    for _ in 0..60 {
        place = (place + (raw - raw_position(map, place)) * 0.7).clamp(DVec2::ZERO, last);
    }
    (place, (raw_position(map, place) - raw).length())
}

/// Corners that lie on one line of both views after OpenCV's rectification, but for so much, do so after
/// the core's: the rectified places are those that its maps lead back to the raw corners.
fn corners_are_on_one_line(folder: &Path) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let made = rectify(&files, &options(&truth))?;
    let rectification: Rectification<'_> = made.maps.rectification()?;
    let last = DVec2::from(truth.size().map(|side| f64::from(side) - 2.0));
    let is_inside = |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.cmple(last).all();
    let text = fs::read_to_string(folder.join("corners.csv"))?;
    let (mut sum, mut opencv_sum, mut corners) = (0.0, 0.0, 0.0);
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        let at = |first: usize| DVec2::new(numbers[first], numbers[first + 1]);
        let opencv = [at(6), at(8)];
        let mut places = opencv;
        for (view, place) in places.iter_mut().enumerate() {
            let map = [&rectification.left, &rectification.right][view];
            let raw = at(2 + 2 * view);
            let off;
            (*place, off) = rectified_position(map, raw, *place, last);
            if is_inside(opencv[view]) {
                ensure!(
                    off < 0.02,
                    "no place of view {view} leads to {raw}: {off} px"
                );
            }
        }
        if opencv.into_iter().all(is_inside) {
            sum += (places[0].y - places[1].y).powi(2);
            opencv_sum += (opencv[0].y - opencv[1].y).powi(2);
            corners += 1.0;
        }
    }
    let [rms, opencv_rms] = [sum, opencv_sum].map(|sum: f64| (sum / corners).sqrt());
    println!(
        "{}: {corners} corners, vertical rms {rms:.3} px, OpenCV's {opencv_rms:.3}",
        folder.display()
    );
    ensure!(
        corners >= 20.0 && rms <= opencv_rms + 0.05,
        "{rms} px, {opencv_rms} by OpenCV"
    );
    Ok(())
}

fn corners_are_found(folder: &Path) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let made = rectify(&files, &options(&truth))?;
    let rectification: Rectification<'_> = made.maps.rectification()?;
    let text = fs::read_to_string(folder.join("corners.csv"))?;
    let mut corners = 0;
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        for view in [0, 1] {
            let at = |first: usize| DVec2::new(numbers[first], numbers[first + 1]);
            let (raw, rectified) = (at(2 + 2 * view), at(6 + 2 * view));
            let map = [&rectification.left, &rectification.right][view];
            let [width, height] = truth.size().map(|side| f64::from(side) - 1.0);
            let is_inside =
                (0.0..width).contains(&rectified.x) && (0.0..height).contains(&rectified.y);
            if !is_inside {
                continue;
            }
            let off = (raw_position(map, rectified) - raw).length();
            let bound_px = made.maps.error_px + 0.02;
            ensure!(off <= bound_px, "{off} px at {rectified} of view {view}");
            corners += 1;
        }
    }
    // Of the boards' corners 108, 84 and 48 lie inside the views.
    ensure!(corners >= 48, "{corners} corners");
    Ok(())
}

/// A point of a PLY, as a reader that did not write it finds it.
#[derive(Debug, Deserialize)]
struct CloudPoint {
    x: f32,
    y: f32,
    z: f32,
    confidence: u8,
}

/// In the cloud of a board, its squares are within 2 % of their size with each preset but one: the
/// rays of the corners meet the plane of the board, which is fitted to the points found between its
/// corners, so far apart.
fn squares_have_their_size(folder: &Path, square_mm: f64, spared: Option<Preset>) -> Result<()> {
    let truth = Truth::open(folder)?;
    let files = contents(folder, &truth.calibration_files())?;
    let mut options = options(&truth);
    // One of the calibrations has its translation in squares.
    options.unit_mm = options.unit_mm.or(Some(square_mm));
    let made = rectify(&files, &options)?;
    let rectification = made.maps.rectification()?;
    let [left, right] = ["left.png", "right.png"].map(|name| image::open(folder.join(name)));
    let raw = views_of(left?.into_rgb8(), right?.into_rgb8(), false)?;
    let views = rectified(&raw, &rectification)?;
    let camera = rectification
        .camera(Reference::Left)
        .context("no camera of the left view")?;
    let corners = corners_of_left_view(folder, &rectification)?;
    let (focal_px, principal_px) = (made.pair.focal_px, made.pair.principal_px[0]);
    let ray = |place: DVec2| ((place - principal_px) / focal_px).extend(1.0);
    let d_max = truth.meta["d_max"].as_integer().context("no d_max")?;
    for preset in Preset::ALL {
        let config = Config {
            colour: views.has_colour(),
            ..Config::new(
                preset.parameters(),
                views.width,
                DisparityRange::up_to(u16::try_from(d_max)?),
            )
        };
        let matched = match_frame(&config, &views, NativeKernels::fastest(), 2)?;
        let lines = matched.lines(views.width);
        let ply = PointFormat::Ply.encode(lines, &picture_of(&views, 0)?, &camera)?;
        let mut reader = serde_ply::PlyReader::from_reader(ply.as_slice())?;
        let points: Vec<CloudPoint> = reader.next_element()?;
        let on_board = pixels_between(&corners, views.width.into()).filter_map(|at| {
            let point = points.get(at)?;
            let place = DVec3::new(point.x.into(), point.y.into(), point.z.into());
            (point.confidence > 0 && place.is_finite()).then_some(place)
        });
        let on_board: Vec<DVec3> = on_board.collect();
        let (plane, median) = plane_of(&on_board)?;
        let place = |corner: DVec2| ray(corner) / plane.dot(ray(corner));
        let mut sides_mm = Vec::new();
        for (&[row, column], &corner) in &corners {
            for next in [[row + 1, column], [row, column + 1]] {
                if let Some(&next) = corners.get(&next) {
                    sides_mm.push(place(corner).distance(place(next)) * 1000.0);
                }
            }
        }
        let count = sides_mm.len() as f64;
        let mean_mm = sides_mm.iter().sum::<f64>() / count;
        let squares: f64 = sides_mm.iter().map(|mm| (mm - mean_mm).powi(2)).sum();
        println!(
            "{}, {preset}: {count} sides of squares, mean {mean_mm:.2} mm ({:+.2} %), standard \
             deviation {:.2}; {} points, half of them within {:.2} % of the plane",
            folder.display(),
            100.0 * (mean_mm / square_mm - 1.0),
            (squares / count).sqrt(),
            on_board.len(),
            100.0 * median
        );
        ensure!(count >= 20.0, "{count} sides");
        let is_right = (mean_mm / square_mm - 1.0).abs() <= 0.02;
        ensure!(is_right || spared == Some(preset), "{preset}: {mean_mm} mm");
    }
    Ok(())
}

/// The corners of a board, by row and column, at their places of the rectified left view.
fn corners_of_left_view(
    folder: &Path,
    rectification: &Rectification<'_>,
) -> Result<BTreeMap<[u32; 2], DVec2>> {
    let size = [rectification.width, rectification.height];
    let last = DVec2::from(size.map(|side| f64::from(side) - 2.0));
    let mut corners = BTreeMap::new();
    for line in fs::read_to_string(folder.join("corners.csv"))?
        .lines()
        .skip(1)
    {
        let numbers: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
        let at = |first: usize| DVec2::new(numbers[first], numbers[first + 1]);
        let (place, off) = rectified_position(&rectification.left, at(2), at(6), last);
        // Those that the rectified view does not show lead elsewhere.
        if off < 0.02 {
            corners.insert([numbers[0] as u32, numbers[1] as u32], place);
        }
    }
    Ok(corners)
}

/// The pixels of a view, row by row, that lie in squares of the board whose four corners are known.
fn pixels_between(
    corners: &BTreeMap<[u32; 2], DVec2>,
    width: usize,
) -> impl Iterator<Item = usize> {
    let squares = corners.keys().filter_map(|&[row, column]| {
        let around = [
            [row, column],
            [row, column + 1],
            [row + 1, column + 1],
            [row + 1, column],
        ];
        let found: Option<Vec<DVec2>> = around
            .map(|at| corners.get(&at).copied())
            .into_iter()
            .collect();
        found
    });
    squares.flat_map(move |square| {
        let low = square.iter().fold(DVec2::MAX, |low, &at| low.min(at));
        let high = square.iter().fold(DVec2::ZERO, |high, &at| high.max(at));
        let [left, top] = low.ceil().to_array().map(|at| at as usize);
        let [right, bottom] = high.floor().to_array().map(|at| at as usize);
        let pixels = (top..=bottom).flat_map(move |y| (left..=right).map(move |x| [x, y]));
        pixels.filter_map(move |[x, y]| {
            let pixel = DVec2::new(x as f64, y as f64);
            let sides = (0..4).map(|side| {
                let (from, to) = (square[side], square[(side + 1) % 4]);
                (to - from).perp_dot(pixel - from) > 0.0
            });
            let left_of = sides.filter(|&is_left| is_left).count();
            (left_of % 4 == 0).then_some(y * width + x)
        })
    })
}

/// The plane `n . p = 1` that most of these points lie on, and the median of how far the points are
/// off it, as a share of their inverse depth. What is fitted is the inverse depth, in which an
/// error of the disparity is the same everywhere; what is far off counts little.
fn plane_of(points: &[DVec3]) -> Result<(DVec3, f64)> {
    let off = |plane: DVec3, p: &DVec3| (plane.dot(*p) - 1.0).abs() / p.z;
    let mut weights = vec![1.0; points.len()];
    let mut plane = DVec3::ZERO;
    let mut median = 0.0;
    for _ in 0..60 {
        let (mut products, mut sum) = (DMat3::ZERO, DVec3::ZERO);
        for (p, weight) in points.iter().zip(&weights) {
            let ray = *p / p.z;
            products += DMat3::from_cols(ray * ray.x, ray * ray.y, ray) * *weight;
            sum += ray / p.z * *weight;
        }
        plane = products.inverse() * sum;
        let mut offs: Vec<f64> = points.iter().map(|p| off(plane, p)).collect();
        weights = offs.clone();
        offs.sort_by(f64::total_cmp);
        median = *offs.get(offs.len() / 2).context("no points on the board")?;
        for weight in &mut weights {
            *weight = 1.0 / (1.0 + (*weight / median).powi(2));
        }
    }
    let mut inverse_depths: Vec<f64> = points.iter().map(|p| 1.0 / p.z).collect();
    inverse_depths.sort_by(f64::total_cmp);
    Ok((plane, median / inverse_depths[points.len() / 2]))
}

fn loose_files(folder: &Path) -> Result<()> {
    let made = |names: &[&str], size, keep| {
        let options = Options {
            size,
            keep,
            ..Options::default()
        };
        rectify(&contents(folder, names)?, &options)
    };
    let refused = |names: &[&str], words: &[&str]| -> Result<()> {
        let error = made(names, None, None).err().context("is not refused")?;
        let message = format!("{error:#}");
        ensure!(
            message.contains(names[0]) && words.iter().all(|word| message.contains(word)),
            "{message}"
        );
        Ok(())
    };
    for name in ["euroc_ds_calib.json", "tumvi_512_ds_calib.json"] {
        refused(&[name], &["double sphere"])?;
    }
    refused(
        &["stereopi_ros_left.yaml", "stereopi_ros_right.yaml"],
        &["634.9", "another resolution", "baseline is 0"],
    )?;
    refused(&["ps4eye_left.yaml"], &["one camera"])?;
    let good = made(&["ps4eye_left.yaml", "ps4eye_right.yaml"], None, None)?;
    ensure!(good.is_stored && good.calibration.warnings.is_empty());
    close("baseline", good.pair.baseline, 34.083392 / 433.812194, 1e-9)?;
    let good = made(&["tum_vi_chain.yaml"], None, None)?;
    ensure!(good.calibration.warnings.is_empty() && !good.is_stored);
    ensure!(good.maps.error_px <= 0.1, "{} px", good.maps.error_px);
    // The cameras of the TUM VI device are 10 cm apart, those of the T265 6.4 cm.
    close("baseline", good.pair.baseline, 0.1011, 2e-4)?;
    let good = made(&["rs_t265_chain.yaml"], None, None)?;
    ensure!(good.calibration.warnings.is_empty());
    close("baseline", good.pair.baseline, 0.0627, 2e-4)?;
    let swapped = ["swapped_intrinsics.yml", "swapped_extrinsics.yml"];
    let warned = made(&swapped, Some([640, 480]), None)?;
    let warnings = warned.calibration.warnings.join("; ");
    ensure!(warnings.contains("exchanged"), "{warnings}");
    let all = made(&["tum_vi_chain.yaml"], None, Some(Keep::All))?;
    ensure!(all.pair.focal_px < 100.0);
    Ok(())
}
