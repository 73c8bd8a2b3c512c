//! Accuracy on real pairs: the paper's results, and the bounds of the SGM presets.
//!
//! The tests run if `MIDDLEBURY_DIR` or `KITTI_DIR` names a folder of scenes in the layout that
//! `vgstereo eval` reads; otherwise they are listed as ignored.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Failed, Trial};
use vgstereo_core::Preset;
use vgstereo_sim::dataset::load_scene;
use vgstereo_sim::metrics::ByConfidence;
use vgstereo_sim::prepared::Prepared;
use vgstereo_tests::{Found, bad_percent_in, failed, matched_with_and_without_doubt};

/// Scenes, and the largest percentage of bad pixels, averaged over the three masks, with the preset
/// `paper`. The bounds are the paper's own figures, with some allowance because its tables differ.
const MIDDLEBURY: [(&str, f64); 4] = [
    ("tsukuba", 13.5),
    ("venus", 13.0),
    ("teddy", 21.5),
    ("cones", 15.5),
];

const KITTI: [&str; 6] = [
    "000005_10",
    "000045_10",
    "000085_10",
    "000125_10",
    "000165_10",
    "000185_10",
];

/// Bounds of the mean percentage of bad pixels over the Middlebury scenes. The paper's table has 15.0 with its filters; the
/// plain network of the code that it builds on has about 17.5.
const PAPER_RAW: RangeInclusive<f64> = 16.0..=18.5;
const PAPER_MAX: f64 = 15.0;
const GREY_MICRO_MAX: f64 = 6.0;

/// Presets that aggregate, each with the largest mean percentage of bad pixels over the Middlebury scenes, and over
/// the KITTI pairs, there of pixels that are more than 3 px off.
const MEANS_MAX: [(Preset, f64, f64); 4] = [
    (Preset::Lite, 9.5, 9.0),
    (Preset::Micro, 5.5, 7.0),
    (Preset::Balanced, 4.6, 6.5),
    (Preset::Quality, 4.4, 6.5),
];

fn main() {
    let middlebury = MIDDLEBURY.map(|(scene, _)| scene);
    let mut trials = vec![
        trial("MIDDLEBURY_DIR", "middlebury::paper", |folder| {
            let mut sum = 0.0;
            for (scene, largest) in MIDDLEBURY {
                let bad = mean(folder, &[scene], Preset::Paper, false)?;
                within(scene, bad, 0.0..=largest)?;
                sum += bad;
            }
            within("mean", sum / MIDDLEBURY.len() as f64, 0.0..=PAPER_MAX)
        }),
        trial("MIDDLEBURY_DIR", "middlebury::paper-raw", move |folder| {
            let bad = mean(folder, &middlebury, Preset::PaperRaw, false)?;
            within("mean", bad, PAPER_RAW)
        }),
        trial("MIDDLEBURY_DIR", "middlebury::micro::grey", move |folder| {
            let bad = mean(folder, &middlebury, Preset::Micro, true)?;
            within("mean", bad, 0.0..=GREY_MICRO_MAX)
        }),
    ];
    for (preset, middlebury_max, kitti_max) in MEANS_MAX {
        let name = format!("middlebury::{preset}");
        trials.push(trial("MIDDLEBURY_DIR", &name, move |folder| {
            let measured = Measured::new(folder, &middlebury, preset, 1.0)?;
            within("mean", measured.bad, 0.0..=middlebury_max)?;
            measured.little_is_lost(1.0)
        }));
        trials.push(trial(
            "KITTI_DIR",
            &format!("kitti::{preset}"),
            move |folder| {
                let measured = Measured::new(folder, &KITTI, preset, 3.0)?;
                within("mean", measured.bad, 0.0..=kitti_max)?;
                measured.little_is_lost(2.0)?;
                measured.the_confident_are_right()
            },
        ));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// What a preset makes of the scenes of a data set.
struct Measured {
    /// Bad pixels, percent, averaged over the masks of each scene and then over the scenes.
    bad: f64,
    /// What it finds, and what it finds without its doubt of rivals: right and wrong, summed over the scenes.
    found: [[f64; 2]; 2],
    by_confidence: ByConfidence,
}

impl Measured {
    fn new(
        folder: &Path,
        scenes: &[&str],
        preset: Preset,
        threshold_px: f32,
    ) -> Result<Self, Failed> {
        let mut measured = Self {
            bad: 0.0,
            found: [[0.0; 2]; 2],
            by_confidence: ByConfidence::NONE,
        };
        for scene in scenes {
            let prepared = Prepared::load(&folder.join(scene), false).map_err(failed)?;
            let scene = &prepared.scene;
            let truth = scene.truth.as_ref().ok_or("no truth")?;
            let both = matched_with_and_without_doubt(&prepared, preset);
            for (sums, matched) in measured.found.iter_mut().zip(&both) {
                let found = Found::new(matched, scene, threshold_px);
                sums[0] += found.right;
                sums[1] += found.wrong;
            }
            let [matched, _] = both;
            let bad = prepared.measure(&matched, threshold_px, false);
            let bad = bad.map_err(failed)?.average().ok_or("no mask")?;
            measured.bad += bad / scenes.len() as f64;
            let (map, confidences) = (&matched.disparities_q4, &matched.confidences);
            let counts = &mut measured.by_confidence;
            counts.count(map, confidences, truth, threshold_px);
        }
        Ok(measured)
    }

    /// Checks that with doubt where a second disparity fits, at most this share, percent, of what is found and right
    /// is lost, and that no more is found and wrong than without.
    fn little_is_lost(&self, largest: f64) -> Result<(), Failed> {
        let [found, before] = self.found;
        let [right, wrong] = [0, 1].map(|index| 100.0 * (1.0 - found[index] / before[index]));
        println!("of the wrong ones {wrong:.2} % are lost");
        if wrong < 0.0 {
            return Err(format!("{wrong:.2} % of the wrong ones").into());
        }
        within("of the right ones lost", right, 0.0..=largest)
    }

    /// Checks that the more confident disparities are the right ones: in each tenth of them fewer are wrong than
    /// in the one before.
    fn the_confident_are_right(&self) -> Result<(), Failed> {
        let tenths = self.by_confidence.tenths().ok_or("nothing was found")?;
        println!("{tenths:.2?} %");
        if tenths.is_sorted_by(|a, b| a > b) {
            Ok(())
        } else {
            Err(format!("{tenths:.2?} does not fall").into())
        }
    }
}

/// Creates a test on the folder that an environment variable names, ignored if it is not set.
fn trial(
    variable: &str,
    name: &str,
    test: impl FnOnce(&Path) -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let folder = std::env::var_os(variable).map(PathBuf::from);
    let absent = folder.is_none();
    Trial::test(name, move || test(&folder.unwrap_or_default())).with_ignored_flag(absent)
}

/// Returns the percentage of bad pixels, averaged over the masks of each scene and then over the
/// scenes.
fn mean(folder: &Path, scenes: &[&str], preset: Preset, grey: bool) -> Result<f64, Failed> {
    let mut sum = 0.0;
    for scene in scenes {
        let scene = load_scene(&folder.join(scene)).map_err(failed)?;
        sum += bad_percent_in(preset.parameters(), &scene, grey);
    }
    Ok(sum / scenes.len() as f64)
}

fn within(what: &str, percent: f64, bounds: RangeInclusive<f64>) -> Result<(), Failed> {
    println!("{what}: {percent:.2} %");
    if bounds.contains(&percent) {
        Ok(())
    } else {
        Err(format!("{what}: {percent:.2} % is not in {bounds:?}").into())
    }
}
