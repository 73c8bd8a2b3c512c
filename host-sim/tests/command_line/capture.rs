//! `vgstereo capture`: the pairs are what the board's camera sees, and a board of squares is seen or not.

use std::fs;
use std::path::Path;
use std::sync::mpsc::channel;
use std::time::Instant;

use image::GrayImage;
use vgstereo_link::board::Outcome;
use vgstereo_link::{HostMessage, Selection, Streams};
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::views::views_of;

use crate::fixture::Fixture;
use crate::scripted::Script;

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn grey(path: &Path) -> GrayImage {
    match image::open(path).unwrap() {
        image::DynamicImage::ImageLuma8(picture) => picture,
        other => panic!("{}: {:?}", path.display(), other.color()),
    }
}

/// What the cameras of the demo's board see.
fn demo_views() -> [Vec<u8>; 2] {
    let options = RenderOptions {
        width: 320,
        height: 240,
        d_max: 47,
        ..RenderOptions::default()
    };
    let scene = render(&options);
    let views = views_of(scene.left, scene.right, true).unwrap();
    [views.left, views.right]
}

/// Rendered pairs of the board of squares, of 9 by 6 corners.
fn squares(fixture: &Fixture, poses: &str) -> Vec<[GrayImage; 2]> {
    let size = ["--width", "320", "--height", "240", "--d-max", "47"];
    let board = ["demo", "--board", "board", "--poses", poses];
    let outcome = fixture.run(&[&board[..], &size[..]].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    (1..=poses.parse().unwrap())
        .map(|pose: u32| {
            ["left", "right"].map(|side| {
                let path = fixture.path(&format!("board/{side}_{pose:02}.png"));
                image::open(path).unwrap().into_luma8()
            })
        })
        .collect()
}

#[test]
fn as_many_pairs_are_written_as_were_asked_for_and_they_are_what_the_camera_sees() {
    let fixture = Fixture::new();
    let run = |count: &str| fixture.run(&["capture", "--demo", "pictures", "--count", count]);
    let outcome = run("2");
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let told = "wrote 2 pairs of 320x240 px to pictures: left_01.png to right_02.png\n";
    assert_eq!(outcome.stdout, told);
    assert_eq!(outcome.stderr.lines().count(), 2, "{}", outcome.stderr);
    let outcome = run("1");
    assert!(outcome.stdout.contains("1 pair"), "{}", outcome.stdout);
    let folder = fixture.path("pictures");
    let expected = [
        "left_01", "left_02", "left_03", "right_01", "right_02", "right_03",
    ];
    assert_eq!(names(&folder), expected.map(|name| format!("{name}.png")));
    let [left, right] = demo_views();
    for number in 1..=3 {
        let picture = |side| grey(&folder.join(format!("{side}_0{number}.png")));
        assert_eq!(picture("left").into_raw(), left, "{number}");
        assert_eq!(picture("right").into_raw(), right, "{number}");
    }
}

#[test]
fn pairs_are_taken_at_equal_times() {
    let fixture = Fixture::new();
    let texture = GrayImage::from_fn(32, 20, |x, y| image::Luma([(7 * x + 13 * y) as u8]));
    let address = Script::of(vec![[texture.clone(), texture]]).serve();
    let begun = Instant::now();
    let outcome = fixture.run(&[
        "capture", &address, "pictures", "--every", "0.3", "--count", "3",
    ]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(begun.elapsed().as_millis() >= 900, "{:?}", begun.elapsed());
    assert_eq!(names(&fixture.path("pictures")).len(), 6);
}

#[test]
fn a_board_of_squares_is_told_from_the_courtyard() {
    let fixture = Fixture::new();
    let squares = squares(&fixture, "4");
    let (width, height) = squares[0][0].dimensions();
    let blank = GrayImage::from_pixel(width, height, image::Luma([128]));
    // Half of the pairs show it in one view, or in none.
    let mut pairs = squares.clone();
    pairs.insert(1, [blank.clone(), squares[0][1].clone()]);
    pairs.insert(2, [squares[0][0].clone(), blank.clone()]);
    pairs.insert(0, [blank.clone(), blank]);
    let address = Script::of(pairs).serve();
    let of_board = ["--corners", "9x6", "--seen-only", "--count", "4"];
    let outcome = fixture.run(&[&["capture", &address, "seen"][..], &of_board].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let whole = "a board of 9x6 corners is seen whole in both views of 4\n";
    assert!(outcome.stdout.ends_with(whole), "{}", outcome.stdout);
    for number in 1..=4 {
        let taken = ["left", "right"]
            .map(|side| grey(&fixture.path(&format!("seen/{side}_0{number}.png"))));
        assert!(squares.contains(&taken), "{number}");
    }
    let outcome = fixture.run(&[
        "capture",
        "--demo",
        "yard",
        "--corners",
        "9x6",
        "--count",
        "1",
    ]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(
        outcome.stdout.ends_with("both views of 0\n"),
        "{}",
        outcome.stdout
    );
    assert!(!outcome.stderr.contains("whole"), "{}", outcome.stderr);
}

/// A board that was sending disparities sends them again.
#[test]
fn a_board_is_left_as_it_was_found() {
    let fixture = Fixture::new();
    let texture = GrayImage::from_fn(32, 20, |x, y| image::Luma([(7 * x + 13 * y) as u8]));
    let (sender, commands) = channel();
    let mut script = Script::of(vec![[texture.clone(), texture]]);
    script.answer = Box::new(move |message| {
        let _ = match message {
            HostMessage::Select(selection) => sender.send(Some(*selection)),
            HostMessage::Stop => sender.send(None),
            _ => Ok(()),
        };
        Some(Outcome::Done)
    });
    let address = script.serve();
    let outcome = fixture.run(&["capture", &address, "pictures", "--count", "1"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let [raw, before] = [Streams::RAW, Streams::DISPARITIES].map(Selection::whole);
    let expected = [None, Some(raw), Some(before), None];
    assert_eq!(commands.iter().collect::<Vec<_>>(), expected);
}

#[test]
fn what_cannot_be_captured_is_refused() {
    let fixture = Fixture::new();
    let refuses = |arguments: &[&str], words: &[&str]| {
        fixture.refuses(&[&["capture"][..], arguments].concat(), words);
    };
    refuses(&["--demo", "pictures"], &["--every", "--count", "terminal"]);
    refuses(&["pictures", "--count", "1"], &["HOST:PORT", "--demo"]);
    refuses(&["--demo", "--count", "1"], &["FOLDER"]);
    refuses(&["--demo", "left.png", "--count", "1"], &["left.png"]);
    refuses(&["--demo", "x", "--count", "0"], &["--count"]);
    refuses(&["--demo", "x", "--every", "0"], &["--every"]);
    refuses(&["--demo", "x", "--corners", "9"], &["--corners", "9x6"]);
    refuses(
        &["--demo", "x", "--count", "1", "--seen-only"],
        &["--corners"],
    );
    let mut script = Script::of(vec![]);
    script.streams = Streams::DISPARITIES;
    refuses(&[&script.serve(), "x", "--count", "1"], &["no raw views"]);
    let mut script = Script::of(vec![]);
    script.answer = Box::new(|message| {
        let is_select = matches!(message, HostMessage::Select(_));
        Some(if is_select {
            Outcome::OutOfBounds
        } else {
            Outcome::Done
        })
    });
    refuses(
        &[&script.serve(), "x", "--count", "1"],
        &["select raw views", "out of bounds"],
    );
}

/// The pairs that were written stay, and the error tells of them.
#[test]
fn a_board_that_is_lost_leaves_whole_pairs() {
    let fixture = Fixture::new();
    let texture = GrayImage::from_fn(32, 20, |x, y| image::Luma([(7 * x + 13 * y) as u8]));
    let mut script = Script::of(vec![[texture.clone(), texture.clone()]]);
    script.frames_max = Some(2);
    let address = script.serve();
    let outcome = fixture.run(&["capture", &address, "pictures", "--count", "9"]);
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    let error = outcome.stderr.lines().last().unwrap();
    for words in ["error: ", "2 pairs", &address, "closed"] {
        assert!(error.contains(words), "{words} in {error}");
    }
    let folder = fixture.path("pictures");
    assert_eq!(names(&folder).len(), 4);
    assert_eq!(grey(&folder.join("right_02.png")), texture);
}
