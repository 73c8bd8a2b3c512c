//! `vgstereo wall`, and `demo --wall`, which makes pictures for it.

use std::fs;

use vgstereo_link::board::Camera;

use crate::fixture::Fixture;
use crate::link::{Board, Sent};

#[test]
fn a_rendered_wall_is_judged_and_pictured() {
    let fixture = Fixture::new();
    let made = fixture.run(&[
        "demo", "--wall", "1500", "--frames", "2", "--width", "160", "--height", "120", "--d-max",
        "31", "--out", "wall",
    ]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    // The options that it says are those of the cameras.
    let (_, options) = made.stdout.trim().split_once("--distance").unwrap();
    let options = format!("--distance{options}");
    let mut arguments = vec!["wall"];
    let pictures = ["left_01", "right_01", "left_02", "right_02"];
    let pictures = pictures.map(|name| format!("wall/{name}.png"));
    arguments.extend(pictures.iter().map(String::as_str));
    arguments.extend(options.split(' '));
    arguments.extend(["--d-max", "31", "--residuals", "r.png"]);
    let outcome = fixture.run(&arguments);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    for figure in [
        "fill rate",
        "Z accuracy",
        "RMS from the plane",
        "sub-pixel RMS",
        "temporal noise",
    ] {
        assert!(outcome.stdout.contains(figure), "{}", outcome.stdout);
    }
    let picture = image::open(fixture.path("r.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (64, 48));

    // A single pair and no distance: what they cannot tell is left out by name.
    let single = [
        "wall",
        "wall/left_01.png",
        "wall/right_01.png",
        "--d-max",
        "31",
    ];
    let camera = ["--focal", "168", "--baseline", "225"];
    let outcome = fixture.run(&[&single[..], &camera].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("Z accuracy is left out"));
    assert!(outcome.stdout.contains("temporal noise is left out"));
    assert!(!outcome.stdout.contains("| Z accuracy"));
}

const WIDTH: u16 = 160;
const HEIGHT: u32 = 120;

/// The numbers of the table that `wall` prints.
fn figures(text: &str) -> Vec<f64> {
    let cells = text
        .lines()
        .filter(|line| line.contains('|') || line.contains('│'));
    cells
        .flat_map(|line| line.split(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))))
        .filter_map(|number| number.parse().ok())
        .collect()
}

#[test]
fn a_recording_is_judged_as_its_pairs_are_and_its_disparities_are_those_of_the_board() {
    let fixture = Fixture::new();
    let made = fixture.run(&[
        "demo", "--wall", "1500", "--frames", "2", "--width", "160", "--height", "120", "--d-max",
        "31", "--out", "wall",
    ]);
    let (_, options) = made.stdout.trim().split_once("--distance").unwrap();
    let options = format!("--distance{options} --d-max 31");
    let options: Vec<&str> = options.split(' ').collect();
    let number = |name: &str| -> f64 {
        let at = options.iter().position(|option| *option == name).unwrap();
        options[at + 1].parse().unwrap()
    };
    let (focal_px, baseline_mm) = (number("--focal"), number("--baseline"));
    let camera = Camera {
        focal_q8: (focal_px * 256.0).round() as u32,
        principal_x_q8: (79.5 * 256.0) as i32,
        principal_y_q8: (59.5 * 256.0) as i32,
        depth_q8: (focal_px * baseline_mm * 256.0).round() as u32,
        offset_q8: 0,
    };
    let board = Board {
        camera: Some(camera),
        ..Board::new((WIDTH, HEIGHT))
    };
    let pairs = ["01", "02"].map(|number| {
        let view = |side| {
            let path = fixture.path(&format!("wall/{side}_{number}.png"));
            image::open(path).unwrap().into_rgb8()
        };
        Sent {
            raw: Some(["left", "right"].map(view)),
            ..Sent::default()
        }
    });
    fs::write(fixture.path("pairs.bin"), board.bytes(&pairs)).unwrap();
    let pictures = [
        "wall/left_01.png",
        "wall/right_01.png",
        "wall/left_02.png",
        "wall/right_02.png",
    ];
    let of_pictures = fixture.run(&[&["wall"], &pictures[..], &options].concat());
    // With the camera that the board has told, and with the same one as options.
    for options in [&options[..], &["--distance", "1500", "--d-max", "31"]] {
        let outcome = fixture.run(&[&["wall", "pairs.bin"], options].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        assert!(
            outcome.stdout.contains("raw pairs, 2 frames"),
            "{}",
            outcome.stdout
        );
        assert_eq!(figures(&outcome.stdout), figures(&of_pictures.stdout));
        assert!(figures(&outcome.stdout).len() > 8);
    }

    // Disparities: half a pixel to and fro about those of a wall at 1500 mm, from frame to frame.
    let exact = focal_px * baseline_mm / 1500.0 * 16.0;
    let frames = [-4.0, 4.0].map(|error| {
        let q4 = (exact + error).round() as i16;
        Sent {
            disparities_q4: Some(vec![q4; usize::from(WIDTH) * HEIGHT as usize]),
            ..Sent::default()
        }
    });
    fs::write(fixture.path("disparities.bin"), board.bytes(&frames)).unwrap();
    let outcome = fixture.run(&["wall", "disparities.bin", "--distance", "1500"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("the board's disparities, 2 frames"));
    assert!(outcome.stdout.contains("it sent no confidences"));
    let depth_mm = |q4: f64| focal_px * baseline_mm * 16.0 / q4;
    let apart_mm = depth_mm((exact - 4.0).round()) - depth_mm((exact + 4.0).round());
    let noise = outcome
        .stdout
        .lines()
        .find(|line| line.contains("temporal noise"));
    let noise_mm = figures(noise.unwrap())[0];
    // The standard deviation of two values is their difference by the root of two.
    assert!(
        (noise_mm / (apart_mm / 2.0_f64.sqrt()) - 1.0).abs() < 0.01,
        "{noise_mm} {apart_mm}"
    );
    let one = fixture.run(&[
        "wall",
        "disparities.bin",
        "--distance",
        "1500",
        "--frames",
        "1",
    ]);
    assert!(
        one.stdout.contains("temporal noise is left out"),
        "{}",
        one.stdout
    );
}

#[test]
fn what_is_no_wall_is_refused() {
    let fixture = Fixture::new();
    let camera = ["--focal", "100", "--baseline", "50", "--d-max", "12"];
    for (arguments, words) in [
        (&["left.png"][..], ["left.png", "no pair"]),
        (
            &["left.png", "right.png", "--distance", "0"],
            ["--distance", "above 0"],
        ),
        (&["left.png", "missing.png"], ["missing.png", ""]),
        (
            &["left.png", "right.png", "--residuals", "r.jpg"],
            ["r.jpg", "png"],
        ),
        (
            &["left.png", "right.png", "--residuals", "left.png"],
            ["--residuals", "left.png"],
        ),
        (
            &["left.png", "right.png", "--d-max", "4000"],
            ["left.png", "d-max"],
        ),
    ] {
        let camera = if arguments.contains(&"--d-max") {
            &camera[..4]
        } else {
            &camera
        };
        fixture.refuses(&[&["wall"], arguments, camera].concat(), &words);
    }
    fixture.refuses(
        &["wall", "left.png", "right.png", "--d-max", "12"],
        &["--calibration", "--focal"],
    );
    fixture.refuses(&["demo", "--wall", "1"], &["--wall 1", "--d-max"]);
}
