//! The check of pairs: what is planted in a good pair is named, and a good pair is left in peace.
//!
//! The built-in scene is always tested. Pairs of data sets are if `MIDDLEBURY_DIR`, `KITTI_DIR` or
//! `UNRECTIFIED_DIR` names a folder of them; otherwise those tests are listed as ignored. With
//! `--include-ignored --nocapture` the scores of all pairs are printed as the rows of the table in docs/accuracy.md.

use std::path::{Path, PathBuf};

use image::RgbImage;
use libtest_mimic::{Arguments, Failed, Trial};
use vgstereo_core::DisparityRange;
use vgstereo_sim::pair_check::{Hint, hints, outside, scores};
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::views::views_of;

/// Folders of scenes by the variable that names the data set, with their largest disparity, px.
/// It is that of the data set but for two, whose pictures show nearer surfaces: a pallet at 125 px
/// in `euroc_hall`, a table at 240 px in `bumblebee_board`.
const PAIRS: [(&str, &str, u16); 22] = [
    ("MIDDLEBURY_DIR", "tsukuba", 15),
    ("MIDDLEBURY_DIR", "venus", 19),
    ("MIDDLEBURY_DIR", "teddy", 59),
    ("MIDDLEBURY_DIR", "cones", 59),
    ("MIDDLEBURY_DIR", "extra/art", 75),
    ("MIDDLEBURY_DIR", "extra/baby1", 46),
    ("KITTI_DIR", "000005_10", 69),
    ("KITTI_DIR", "000045_10", 121),
    ("KITTI_DIR", "000085_10", 92),
    ("KITTI_DIR", "000125_10", 68),
    ("KITTI_DIR", "000165_10", 76),
    ("KITTI_DIR", "000185_10", 70),
    ("UNRECTIFIED_DIR", "bumblebee_garden", 79),
    ("UNRECTIFIED_DIR", "bumblebee_board", 255),
    ("UNRECTIFIED_DIR", "euroc_hall", 127),
    ("UNRECTIFIED_DIR", "opencv_board", 127),
    ("UNRECTIFIED_DIR", "stereopi_board", 71),
    ("UNRECTIFIED_DIR", "stereopi_room", 47),
    ("UNRECTIFIED_DIR", "teddy_warped", 59),
    ("UNRECTIFIED_DIR", "cones_warped", 59),
    ("UNRECTIFIED_DIR", "venus_warped", 19),
    ("UNRECTIFIED_DIR", "tsukuba_warped", 15),
];

/// Pairs of [`PAIRS`] that take longest, and are like others that do not. They are listed as ignored, and tested with
/// `--include-ignored`.
const LONG: [&str; 5] = [
    "000045_10",
    "000085_10",
    "000125_10",
    "000165_10",
    "bumblebee_board",
];

fn main() {
    let mut trials: Vec<Trial> = (1..=3)
        .map(|seed| {
            Trial::test(format!("rendered::{seed}"), move || {
                let scene = render(&RenderOptions {
                    seed,
                    ..RenderOptions::default()
                });
                check("rendered", &scene.left, &scene.right, scene.d_max)
            })
        })
        .collect();
    trials.push(Trial::test("rendered::converging", || {
        // What is farther than half the scene gets negative disparities.
        let scene = render(&RenderOptions::default());
        let truth = scene.truth.as_ref().unwrap();
        let mut px = truth.left_px.clone();
        px.sort_by(f32::total_cmp);
        let right = to_the_right(&scene.right, px[px.len() / 2] as u32);
        let views = views_of(scene.left, right, true).unwrap();
        let hints = hints(&views, DisparityRange::up_to(scene.d_max)).unwrap();
        assert!(matches!(hints.as_slice(), [Hint::Below(_)]), "{hints:?}");
        Ok(())
    }));
    for (variable, name, d_max) in PAIRS {
        let folder = std::env::var_os(variable).map(PathBuf::from);
        let is_ignored = folder.is_none() || LONG.contains(&name);
        let test = move || {
            let folder = folder.unwrap_or_default().join(name);
            // The pictures of unrectified cameras have rectified ones beside them.
            let suffix = if variable == "UNRECTIFIED_DIR" {
                "_rect"
            } else {
                ""
            };
            let left = open(&folder.join(format!("left{suffix}.png")))?;
            let right = open(&folder.join(format!("right{suffix}.png")))?;
            check(name, &left, &right, d_max)
        };
        trials.push(Trial::test(name, test).with_ignored_flag(is_ignored));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

fn open(path: &Path) -> Result<RgbImage, Failed> {
    let image = image::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(image.into_rgb8())
}

/// Checks a pair as it is, and with each fault planted in it.
fn check(name: &str, left: &RgbImage, right: &RgbImage, d_max: u16) -> Result<(), Failed> {
    let range = DisparityRange::up_to(d_max);
    let views =
        |left: &RgbImage, right: &RgbImage| views_of(left.clone(), right.clone(), true).unwrap();
    let found = |left: &RgbImage, right: &RgbImage, range| {
        hints(&views(left, right), range).map_err(|error| Failed::from(error.to_string()))
    };
    let expect = |what: &str, hints: Vec<Hint>, is_right: fn(&Hint, i8) -> bool, lines: i8| {
        let only = matches!(hints.as_slice(), [hint] if is_right(hint, lines));
        if only {
            Ok(())
        } else {
            Err(Failed::from(format!("{name}, {what}: {hints:?}")))
        }
    };
    let as_it_is = scores(&views(left, right), range).map_err(|error| error.to_string())?;
    let [below, beyond] = outside(&views(left, right), range).map_err(|error| error.to_string())?;
    let half = DisparityRange::up_to(d_max / 2);
    let [_, half_beyond] = outside(&views(left, right), half).map_err(|error| error.to_string())?;
    let moved = as_it_is.moved.iter().map(|&(_, score)| score).max();
    println!(
        "| {name} | {} | {} | {} | {:.1} | {:.1} |",
        as_it_is.given,
        as_it_is.exchanged,
        moved.unwrap_or(0),
        below.percent.max(beyond.percent),
        half_beyond.percent
    );
    let good = found(left, right, range)?;
    if !good.is_empty() {
        return Err(format!("{name}, a good pair: {good:?}").into());
    }
    expect(
        "exchanged",
        found(right, left, range)?,
        |hint, _| matches!(hint, Hint::Exchanged),
        0,
    )?;
    for lines in [-3, -2, -1, 1, 2, 3] {
        expect(
            &format!("{lines} lines too low"),
            found(left, &lowered(right, lines), range)?,
            |hint, lines| *hint == Hint::LinesOff { too_low: lines },
            lines,
        )?;
    }
    expect(
        "half the range",
        found(left, right, half)?,
        |hint, _| matches!(hint, Hint::Beyond(_)),
        0,
    )?;
    expect(
        "the same image twice",
        found(left, left, range)?,
        |hint, _| *hint == Hint::Identical,
        0,
    )
}

/// Returns a view whose content lies some lines lower; its outermost line is repeated.
fn lowered(view: &RgbImage, lines: i8) -> RgbImage {
    let last = view.height() - 1;
    RgbImage::from_fn(view.width(), view.height(), |x, y| {
        let line = y.saturating_add_signed(-i32::from(lines)).min(last);
        *view.get_pixel(x, line)
    })
}

/// Returns a view whose content lies some columns further to the right, so that disparities become
/// smaller; its outermost column is repeated.
fn to_the_right(view: &RgbImage, columns: u32) -> RgbImage {
    RgbImage::from_fn(view.width(), view.height(), |x, y| {
        *view.get_pixel(x.saturating_sub(columns), y)
    })
}
