//! The demo: its pictures, and the scene that it writes.

use std::fs;

use crate::fixture::Fixture;

/// The main job: no command at all, here at a small size.
#[test]
fn the_demo_writes_its_pictures_and_says_so() {
    let fixture = Fixture::new();
    let size = ["--width", "96", "--height", "64", "--d-max", "12"];
    for wire in ["separate", "pixel-multiplexed"] {
        let outcome = fixture.run(&[&size[..], &["--layout", wire, "--out", wire]].concat());
        assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
        for word in [
            "paper-raw",
            "paper ",
            "micro ",
            "KiB",
            "latency lines",
            "ms",
        ] {
            assert!(
                outcome.stdout.contains(word),
                "{word:?} in {}",
                outcome.stdout
            );
        }
        for name in ["left", "right", "truth", "disparity", "error"] {
            let path = format!("{wire}/{name}.png");
            assert!(outcome.stdout.contains(&path), "{}", outcome.stdout);
            let picture = image::open(fixture.path(&path)).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 64));
        }
    }
    // The wire changes nothing that is seen.
    let disparities = |wire| fs::read(fixture.path(wire).join("disparity.png")).unwrap();
    assert_eq!(disparities("separate"), disparities("pixel-multiplexed"));
    fixture.refuses(&["--out", "left.png"], &["left.png"]);
    fixture.refuses(&["--d-max", "241"], &["--d-max", "240"]);
    fixture.refuses(&["--width", "15"], &["--width", "16"]);
    fixture.refuses(&["--texture", "1.5"], &["--texture"]);
    for option in [
        "--texture",
        "--noise",
        "--gain",
        "--gain-gradient",
        "--offset",
        "--offset-gradient",
    ] {
        fixture.refuses(&[option, "nan"], &[option]);
    }
    // Black in the first line.
    fixture.refuses(&["--gain", "1", "--gain-gradient", "2"], &["--gain"]);
}

/// What is written is the scene that is matched, down to its masks.
#[test]
fn the_scene_of_the_demo_is_one_for_eval() {
    let fixture = Fixture::new();
    let size = ["--width", "96", "--height", "64", "--d-max", "12"];
    let arguments = [&size[..], &["--texture", "0.3", "--scene", "yard/bare"]].concat();
    let demo = fixture.run(&arguments);
    assert_eq!((demo.code, demo.stderr.as_str()), (Some(0), ""));
    let eval = fixture.run(&["eval", "yard", "bare", "--preset", "micro"]);
    assert_eq!(eval.code, Some(0), "{}", eval.stderr);
    // The three masks and their average, percent.
    let row = |text: &str| -> Vec<f64> {
        let line = text.lines().find(|line| line.contains("micro")).unwrap();
        let cells = line.split('|').filter_map(|cell| cell.trim().parse().ok());
        cells.take(4).collect()
    };
    let (demo, eval) = (row(&demo.stdout), row(&eval.stdout));
    assert_eq!((demo.len(), eval.len()), (4, 4));
    for (demo, eval) in demo.iter().zip(&eval) {
        // The truth is rounded: a pixel in a thousand may be beyond the threshold by that.
        assert!((demo - eval).abs() < 0.1, "{demo} {eval}");
    }
    fs::write(fixture.path("file"), "").unwrap();
    fixture.refuses(&["--scene", "file"], &["file"]);
}

/// Through two real cameras: the raw views are rectified, and the scene that is written is one for
/// `eval --calibrated`, with the same bad pixels.
#[test]
fn the_demo_can_be_seen_through_distorted_cameras() {
    let fixture = Fixture::new();
    let size = ["--width", "160", "--height", "120", "--d-max", "20"];
    let told = |options: &[&str]| {
        let outcome = fixture.run(options);
        assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
        outcome.stdout
    };
    // The average of `micro`, which is the number before the sizes and times.
    let average = |text: &str, column: usize| -> f64 {
        let row = text
            .lines()
            .find(|line| line.starts_with("| micro"))
            .unwrap();
        row.split('|').nth(column).unwrap().trim().parse().unwrap()
    };
    let plain = told(&[&size[..], &["--out", "plain"]].concat());
    let scene = ["--distort", "--out", "raw", "--scene", "scenes/yard"];
    let distorted = told(&[&size[..], &scene[..]].concat());
    let (before, after) = (average(&plain, 5), average(&distorted, 5));
    assert!(after < before + 5.0, "{before} to {after}");
    for name in ["rectified_left", "rectified_right", "disparity"] {
        let picture = image::open(fixture.path(&format!("raw/{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (160, 120));
    }
    let eval = told(&["eval", "scenes", "--calibrated", "--preset", "micro"]);
    assert!(
        (average(&eval, 6) - after).abs() < 0.1,
        "{eval}\n{distorted}"
    );
}
