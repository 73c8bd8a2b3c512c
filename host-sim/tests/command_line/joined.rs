//! `vgstereo match --side-by-side` and `--top-bottom`: one picture that holds both views.

use std::fs;

use assert_cmd::Command;
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageEncoder, RgbImage};

use crate::calibrated::parallel;
use crate::fixture::{Fixture, HEIGHT, SHIFT, WIDTH, texture};
use crate::images::{exif, widened};

/// The options, each with the picture of both views of the fixture.
fn arrangements() -> [(&'static str, RgbImage); 2] {
    let views = [texture(0), texture(SHIFT)];
    let beside = RgbImage::from_fn(2 * WIDTH, HEIGHT, |x, y| {
        *views[(x / WIDTH) as usize].get_pixel(x % WIDTH, y)
    });
    let below = RgbImage::from_fn(WIDTH, 2 * HEIGHT, |x, y| {
        *views[(y / HEIGHT) as usize].get_pixel(x, y % HEIGHT)
    });
    [("--side-by-side", beside), ("--top-bottom", below)]
}

const OPTIONS: [&str; 6] = ["--out", "m.pfm", "--d-max", "12", "--preset", "micro"];

/// Matches these images and returns the map and what was said, without times.
fn matched(fixture: &Fixture, images: &[&str], more: &[&str]) -> (Vec<u8>, Vec<String>) {
    let outcome = fixture.run(&[&["match"], images, &OPTIONS, more].concat());
    assert_eq!(outcome.code, Some(0), "{images:?}: {}", outcome.stderr);
    let said = outcome.stdout.lines().map(|line| {
        let words = line.split(", ").filter(|words| !words.ends_with(" ms"));
        words.collect::<Vec<_>>().join(", ")
    });
    (fs::read(fixture.path("m.pfm")).unwrap(), said.collect())
}

#[test]
fn one_picture_is_matched_as_two_are() {
    let fixture = Fixture::new();
    let (expected, said) = matched(&fixture, &["left.png", "right.png"], &[]);
    for (option, picture) in arrangements() {
        picture.save(fixture.path("both.png")).unwrap();
        let (map, told) = matched(&fixture, &["both.png"], &[option]);
        assert!(map == expected, "{option}");
        assert_eq!(told, said);
        // Exchanged, the views no longer match: the halves are not taken for each other.
        let (other, _) = matched(&fixture, &["right.png", "left.png"], &[]);
        assert!(other != expected);
    }
}

#[test]
fn bits_are_those_that_both_halves_use() {
    let fixture = Fixture::new();
    for (name, shift) in [("l.png", 0), ("r.png", SHIFT)] {
        widened(&texture(shift), 4)
            .save(fixture.path(name))
            .unwrap();
    }
    for more in [&[][..], &["--bits", "14"]] {
        let (expected, said) = matched(&fixture, &["l.png", "r.png"], more);
        assert!(said.iter().any(|line| line.contains("bits")), "{said:?}");
        for (option, picture) in arrangements() {
            widened(&picture, 4)
                .save(fixture.path("both.tiff"))
                .unwrap();
            let (map, told) = matched(&fixture, &["both.tiff"], &[more, &[option]].concat());
            assert!(map == expected, "{option} {more:?}");
            assert_eq!(told, said);
        }
    }
}

/// Orientation 6: the stored picture is turned by a quarter to be upright, and then halved.
#[test]
fn the_upright_picture_is_halved() {
    let fixture = Fixture::new();
    let (expected, _) = matched(&fixture, &["left.png", "right.png"], &[]);
    for (option, picture) in arrangements() {
        let stored = DynamicImage::from(picture).rotate270().into_rgb8();
        let mut png = Vec::new();
        let mut encoder = PngEncoder::new(&mut png);
        encoder.set_exif_metadata(exif(6)).unwrap();
        let (width, height) = stored.dimensions();
        let kind = ExtendedColorType::Rgb8;
        encoder.write_image(&stored, width, height, kind).unwrap();
        fs::write(fixture.path("turned.png"), png).unwrap();
        let (map, _) = matched(&fixture, &["turned.png"], &[option]);
        assert!(map == expected, "{option}");
    }
}

#[test]
fn the_picture_comes_from_standard_input() {
    let fixture = Fixture::new();
    let (expected, _) = matched(&fixture, &["left.png", "right.png"], &[]);
    for (option, picture) in arrangements() {
        picture.save(fixture.path("both.png")).unwrap();
        let output = Command::cargo_bin("vgstereo")
            .unwrap()
            .current_dir(fixture.folder.path())
            .args([&["match", "-", option], &OPTIONS[..]].concat())
            .write_stdin(fs::read(fixture.path("both.png")).unwrap())
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        assert!(fs::read(fixture.path("m.pfm")).unwrap() == expected);
    }
}

/// The calibration is for views of half the picture.
#[test]
fn a_calibration_is_for_the_halves() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), parallel()).unwrap();
    let calibrated = ["--calibration", "cal.yml", "--unit", "mm"];
    let more = [&["--depth", "depth.png"], &calibrated[..]].concat();
    let depth = || fs::read(fixture.path("depth.png")).unwrap();
    let (expected, said) = matched(&fixture, &["left.png", "right.png"], &more);
    assert!(said.iter().any(|line| line.contains("80x40")), "{said:?}");
    let expected_depth = depth();
    for (option, picture) in arrangements() {
        picture.save(fixture.path("both.png")).unwrap();
        fs::write(fixture.path("depth.png"), "").unwrap();
        let (map, told) = matched(&fixture, &["both.png", option], &more);
        assert!(map == expected && depth() == expected_depth, "{option}");
        assert_eq!(told, said);
    }
}

#[test]
fn what_cannot_be_halved_and_too_many_files_are_refused() {
    let fixture = Fixture::new();
    for (name, width, height) in [("wide.png", 81, 40), ("tall.png", 80, 41)] {
        RgbImage::new(width, height)
            .save(fixture.path(name))
            .unwrap();
    }
    let refuses = |arguments: &[&str], words: &[&str]| {
        let all = [&["match"], arguments, &["--out", "o.png"]].concat();
        fixture.refuses(&all, words);
    };
    refuses(
        &["wide.png", "--side-by-side"],
        &["wide.png", "81x40", "even width"],
    );
    refuses(
        &["tall.png", "--top-bottom"],
        &["tall.png", "80x41", "even height"],
    );
    // A picture of one line has no two halves, nor has one of a column.
    RgbImage::new(80, 1).save(fixture.path("line.png")).unwrap();
    refuses(&["line.png", "--top-bottom"], &["line.png", "80x1"]);
    for option in ["--side-by-side", "--top-bottom"] {
        refuses(&["left.png", "right.png", option], &[option, "RIGHT"]);
        refuses(&["none.png", option], &["none.png", "No such file"]);
        refuses(&[option], &["LEFT"]);
    }
    let both = ["left.png", "--side-by-side", "--top-bottom"];
    refuses(&both, &["--side-by-side", "--top-bottom"]);
    refuses(&["left.png"], &["RIGHT"]);
    let over = ["match", "left.png", "--side-by-side", "--out", "./left.png"];
    fixture.refuses(&over, &["input", "left.png"]);
    // The search range is measured against a half, 40 px wide.
    let range = ["left.png", "--side-by-side", "--d-max", "40"];
    refuses(&range, &["--d-max 40", "width of 40 px"]);
}
