//! `vgstereo match --calibration` and depth: pairs that are rectified first, and distances.

use std::fs;

use image::DynamicImage;
use vgstereo_sim::pfm::Pfm;

use crate::fixture::{Fixture, HEIGHT, SHIFT, WIDTH};

/// Focal length of the cameras of [`parallel`], px.
const FOCAL_PX: u32 = 100;
/// Distance between them, mm.
const BASELINE_MM: u32 = 60;

/// OpenCV's file of two cameras without distortion that look in parallel. Rectification changes
/// nothing then, and every pixel is valid.
pub(crate) fn parallel() -> String {
    let list = |values: [f64; 9]| format!("{values:?}");
    let matrix = |name: &str, rows: u32, columns: u32, data: String| {
        format!(
            "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {data}\n"
        )
    };
    let focal = f64::from(FOCAL_PX);
    let camera = list([focal, 0.0, 39.0, 0.0, focal, 20.0, 0.0, 0.0, 1.0]);
    let mut text = "%YAML:1.0\n---\n".to_owned();
    for (name, data) in [("M1", &camera), ("M2", &camera)] {
        text += &matrix(name, 3, 3, data.clone());
    }
    for name in ["D1", "D2"] {
        text += &matrix(name, 1, 5, "[0., 0., 0., 0., 0.]".to_owned());
    }
    text += &matrix(
        "R",
        3,
        3,
        list([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
    );
    text + &matrix("T", 3, 1, format!("[-{BASELINE_MM}., 0., 0.]"))
}

const MATCH: [&str; 5] = ["match", "left.png", "right.png", "--d-max", "20"];

fn run(fixture: &Fixture, more: &[&str]) -> String {
    let outcome = fixture.run(&[&MATCH[..], more].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    outcome.stdout
}

/// The share of pixels away from the borders for which a condition holds.
fn share(of: impl Fn(u32, u32) -> bool) -> f64 {
    let inner = || (8..HEIGHT - 8).flat_map(|y| (20..WIDTH - 20).map(move |x| (x, y)));
    inner().filter(|&(x, y)| of(x, y)).count() as f64 / inner().count() as f64
}

#[test]
fn a_calibration_without_distortion_changes_nothing_and_gives_depth() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), parallel()).unwrap();
    run(
        &fixture,
        &["--out", "plain.png", "--confidence", "sure.png"],
    );
    let size = format!("{WIDTH}x{HEIGHT}");
    let made = fixture.run(&[
        "calibration",
        "cal.yml",
        "--size",
        &size,
        "--unit",
        "mm",
        "--out",
        "cal.vgr",
    ]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    let read = |name: &str| fs::read(fixture.path(name)).unwrap();
    for calibration in [&["cal.yml", "--unit", "mm"][..], &["cal.vgr"]] {
        let outputs = [
            "--out",
            "map.png",
            "--depth",
            "depth.png",
            "--confidence",
            "also.png",
            "--rectified",
            "views",
            "--calibration",
        ];
        let told = run(&fixture, &[&outputs[..], calibration].concat());
        for word in [
            "focal length 100.0 px",
            "baseline 60.0 mm",
            "mm, 0 = none",
            "views/left.png",
        ] {
            assert!(told.contains(word), "{word:?} in {told}");
        }
        assert_eq!(read("map.png"), read("plain.png"));
        assert_eq!(read("also.png"), read("sure.png"));
        for name in ["left.png", "right.png"] {
            let picture = |path: &str| image::open(fixture.path(path)).unwrap().into_luma8();
            assert_eq!(picture(name), picture(&format!("views/{name}")));
        }
        let depth = image::open(fixture.path("depth.png")).unwrap();
        let DynamicImage::ImageLuma16(depth) = depth else {
            panic!("a depth map has 16 bits");
        };
        let expected = FOCAL_PX * BASELINE_MM / SHIFT;
        // Off by 1/16 px at most.
        let off_max = expected / (16 * SHIFT - 1) + 1;
        let is_right = |x, y| u32::from(depth.get_pixel(x, y).0[0]).abs_diff(expected) <= off_max;
        assert!(share(is_right) > 0.99);
    }
    let sure = image::open(fixture.path("sure.png")).unwrap().into_luma8();
    assert!(share(|x, y| sure.get_pixel(x, y).0[0] > 0) > 0.9);
}

#[test]
fn a_rectified_pair_has_depth_by_focal_length_and_baseline() {
    let fixture = Fixture::new();
    let camera = ["--focal", "100", "--baseline", "60", "--doffs", "1.5"];
    run(
        &fixture,
        &[&["--out", "map.png", "--depth", "depth.pfm"], &camera[..]].concat(),
    );
    let depth =
        Pfm::from_bytes(&fs::read(fixture.path("depth.pfm")).unwrap(), "depth.pfm").unwrap();
    let expected_m = 100.0 * 0.06 / (SHIFT as f32 + 1.5);
    // Off by 1/16 px at most.
    let off_max_m = expected_m / (16.0 * (SHIFT as f32 + 1.5) - 1.0) + 1e-4;
    let is_right = |x, y| (depth.values[(y * WIDTH + x) as usize] - expected_m).abs() < off_max_m;
    assert!(share(is_right) > 0.99);
}

/// A wall across the view: the nearest range at each bearing is its distance, longer to the sides.
#[test]
fn a_scan_has_the_ranges_of_the_wall() {
    let fixture = Fixture::new();
    let camera = ["--focal", "100", "--baseline", "60"];
    let scan = ["--scan", "scan.yaml", "--scan-bearings", "20"];
    let heights = ["--scan-heights", "-100,100"];
    let told = run(
        &fixture,
        &[&["--out", "map.png"][..], &camera, &scan, &heights].concat(),
    );
    assert!(told.contains("scan.yaml"), "{told}");
    let text = fs::read_to_string(fixture.path("scan.yaml")).unwrap();
    let number = |name: &str| -> f64 {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_once(": ").unwrap().1.parse().unwrap()
    };
    let ranges = text.lines().skip_while(|line| *line != "ranges:").skip(1);
    let ranges: Vec<f64> = ranges
        .map_while(|line| line.trim_start().strip_prefix("- "))
        .map(|range| range.replace(".nan", "nan").parse().unwrap())
        .collect();
    assert_eq!(ranges.len(), 20);
    let wall_m = f64::from(FOCAL_PX * BASELINE_MM / SHIFT) / 1000.0;
    let mut right = 0;
    for (index, range_m) in (0_u32..).zip(&ranges) {
        let bearing = number("angle_min") + f64::from(index) * number("angle_increment");
        right += u32::from((range_m * bearing.cos() / wall_m - 1.0).abs() < 0.014);
    }
    // All but those at the border that only one camera sees.
    assert!(right >= 17, "{right}: {ranges:?}");

    let plan = ["--scan", "plan.png"];
    run(
        &fixture,
        &[&["--out", "map.png"][..], &camera, &plan].concat(),
    );
    assert!(image::open(fixture.path("plan.png")).is_ok());
}

#[test]
fn what_is_known_of_the_cameras_must_suffice() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), parallel()).unwrap();
    fs::write(fixture.path("broken.vgr"), b"VGRF and no more").unwrap();
    let refuses = |more: &[&str], words: &[&str]| {
        let arguments = [&MATCH[..], &["--out", "o.png"], more].concat();
        fixture.refuses(&arguments, words);
    };
    refuses(&["--depth", "z.png"], &["--calibration", "--focal"]);
    refuses(
        &["--scan", "z.yaml"],
        &["--scan", "--calibration", "--focal"],
    );
    let known = ["--focal", "100", "--baseline", "60", "--scan"];
    refuses(&[&known[..], &["z.txt"]].concat(), &["z.txt", ".yaml"]);
    let none = ["z.png", "--scan-bearings", "0"];
    refuses(&[&known[..], &none].concat(), &["--scan", "bearing"]);
    let heights = ["z.png", "--scan-heights", "9,1"];
    refuses(&[&known[..], &heights].concat(), &["LOW,HIGH"]);
    refuses(
        &["--depth", "z.tif", "--focal", "1", "--baseline", "1"],
        &["z.tif", ".pfm"],
    );
    refuses(
        &["--depth", "z.png", "--focal", "0", "--baseline", "60"],
        &["--focal 0"],
    );
    refuses(
        &["--depth", "z.png", "--focal", "nan", "--baseline", "60"],
        &["--focal"],
    );
    let no_unit = ["--depth", "z.png", "--calibration", "cal.yml"];
    refuses(&no_unit, &["--unit"]);
    refuses(&["--unit", "mm"], &["--calibration"]);
    refuses(&["--calibration", "broken.vgr"], &["broken.vgr"]);
    refuses(&["--calibration", "none.yml"], &["none.yml"]);
    let over = [
        "--calibration",
        "cal.yml",
        "--unit",
        "mm",
        "--depth",
        "./cal.yml",
    ];
    refuses(&over, &["cal.yml"]);
    let over = ["--calibration", "cal.yml", "--rectified", "."];
    refuses(&over, &["left.png"]);
    // A rectification is for one size of raw views.
    let made = fixture.run(&[
        "calibration",
        "cal.yml",
        "--size",
        "64x40",
        "--unit",
        "mm",
        "--out",
        "other.vgr",
    ]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    refuses(&["--calibration", "other.vgr"], &["64x40", "80x40"]);
    refuses(
        &["--calibration", "other.vgr", "--keep", "all"],
        &["other.vgr", "--keep"],
    );
}
