//! `vgstereo wall`, and `demo --wall`, which makes pictures for it.

use crate::fixture::Fixture;

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

#[test]
fn what_is_no_wall_is_refused() {
    let fixture = Fixture::new();
    let camera = ["--focal", "100", "--baseline", "50", "--d-max", "12"];
    for (arguments, words) in [
        (&["left.png"][..], ["1 images", "a left and a right"]),
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
