//! `vgstereo match` of many pairs: what is written is what single matches write, whatever the number of
//! threads, and a bad pair spoils no other.

use std::fs;

use image::imageops::crop_imm;
use serde_json::Value;

use crate::fixture::{Fixture, HEIGHT, Outcome, SHIFT, WIDTH, files_below, texture};

/// Width and first column of each pair: the views are cut out of a texture.
const PAIRS: [(&str, u32, u32); 5] = [
    ("01", 60, 0),
    ("02", 60, 7),
    ("03", 48, 3),
    ("04", 60, 11),
    ("10", 60, 18),
];
/// What is written of a pair, `{}` in the place of its name.
const OUTPUTS: [&str; 10] = [
    "--out",
    "o/{}.png",
    "--colour",
    "o/{}_colour.png",
    "--depth",
    "o/{}_depth.pfm",
    "--points",
    "o/{}/cloud.ply",
    "--confidence",
    "o/{}_confidence.png",
];
const OPTIONS: [&str; 6] = ["--d-max", "12", "--focal", "100", "--baseline", "60"];

/// A folder `pictures` with the pairs.
fn fixture() -> Fixture {
    let fixture = Fixture::new();
    fs::create_dir(fixture.path("pictures")).unwrap();
    for (name, width, column) in PAIRS {
        for (side, shift) in [("left", 0), ("right", SHIFT)] {
            let view = crop_imm(&texture(shift), column, 0, width, HEIGHT).to_image();
            let path = format!("pictures/{side}_{name}.png");
            view.save(fixture.path(&path)).unwrap();
        }
    }
    fixture
}

fn matched(fixture: &Fixture, images: &[&str], outputs: &[&str], more: &[&str]) -> Outcome {
    fixture.run(&[&["match"], images, outputs, &OPTIONS, more].concat())
}

#[test]
fn many_pairs_give_the_files_of_single_matches_at_any_number_of_threads() {
    let fixture = fixture();
    for (name, ..) in PAIRS {
        let [left, right] = ["left", "right"].map(|side| format!("pictures/{side}_{name}.png"));
        let outputs: Vec<String> = OUTPUTS.map(|word| word.replace("{}", name)).to_vec();
        let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
        fs::create_dir_all(fixture.path(&format!("o/{name}"))).unwrap();
        let outcome = matched(&fixture, &[&left, &right], &outputs, &[]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    }
    let expected = files_below(&fixture.path("o"));
    assert_eq!(expected.len(), 25);
    for threads in ["1", "2", "3", "9"] {
        fs::remove_dir_all(fixture.path("o")).unwrap();
        let outcome = matched(&fixture, &["pictures"], &OUTPUTS, &["--threads", threads]);
        assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
        assert!(
            files_below(&fixture.path("o")) == expected,
            "{threads} threads"
        );
        for words in ["| 01 ", "60x40", "| 03 ", "48x40", "5 of 5 pairs"] {
            assert!(
                outcome.stdout.contains(words),
                "{words}: {}",
                outcome.stdout
            );
        }
    }
    // Other ways to name them.
    let names = PAIRS.map(|(name, ..)| name);
    let lines = names.map(|name| format!("left_{name}.png right_{name}.png\n"));
    fs::write(fixture.path("pictures/pairs.txt"), lines.concat()).unwrap();
    let images =
        names.map(|name| ["left", "right"].map(|side| format!("pictures/{side}_{name}.png")));
    let images: Vec<&str> = images.as_flattened().iter().map(String::as_str).collect();
    for side in ["left", "right"] {
        fs::create_dir_all(fixture.path(&format!("apart/{side}"))).unwrap();
        for name in names {
            fs::copy(
                fixture.path(&format!("pictures/{side}_{name}.png")),
                fixture.path(&format!("apart/{side}/{name}.png")),
            )
            .unwrap();
        }
    }
    for images in [
        &["pictures/pairs.txt"][..],
        &images,
        &["apart"],
        &["apart/left", "apart/right"],
    ] {
        fs::remove_dir_all(fixture.path("o")).unwrap();
        let outcome = matched(&fixture, images, &OUTPUTS, &[]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        assert!(files_below(&fixture.path("o")) == expected, "{images:?}");
    }
}

#[test]
fn a_bad_pair_is_named_with_the_reason_and_the_others_are_matched() {
    let fixture = fixture();
    let good = matched(&fixture, &["pictures"], &OUTPUTS, &[]);
    assert_eq!(good.code, Some(0), "{}", good.stderr);
    let mut expected = files_below(&fixture.path("o"));
    expected.retain(|(path, _)| !path.starts_with("02") && !path.starts_with("03"));
    fs::remove_dir_all(fixture.path("o")).unwrap();
    // One breaks off, the views of another differ in size, and one has no partner.
    let cut = fixture.path("pictures/right_02.png");
    let bytes = fs::read(&cut).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let other = texture(0);
    other.save(fixture.path("pictures/left_03.png")).unwrap();
    other.save(fixture.path("pictures/left_77.png")).unwrap();
    for threads in ["1", "3"] {
        let more = ["--threads", threads];
        let outcome = matched(&fixture, &["pictures"], &OUTPUTS, &more);
        assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
        assert!(
            files_below(&fixture.path("o")) == expected,
            "{threads} threads"
        );
        assert!(
            outcome.stdout.contains("3 of 5 pairs"),
            "{}",
            outcome.stdout
        );
        assert_eq!(outcome.stdout.matches("not matched").count(), 2);
        let error = outcome.stderr.lines().last().unwrap();
        for words in [
            "error: 2 of 5 pairs",
            "02: ",
            "right_02.png",
            "03: ",
            "one size",
        ] {
            assert!(error.contains(words), "{words}: {error}");
        }
        let alone = "left_77.png has no partner";
        assert!(outcome.stderr.contains(alone), "{}", outcome.stderr);
    }
    let outcome = matched(&fixture, &["pictures"], &OUTPUTS, &["--json"]);
    assert_eq!(outcome.code, Some(2));
    let report: Value = serde_json::from_str(&outcome.stdout).unwrap();
    let pairs = report["pairs"].as_array().unwrap();
    let names: Vec<&str> = pairs
        .iter()
        .map(|pair| pair["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, PAIRS.map(|(name, ..)| name));
    assert_eq!(
        (&pairs[0]["width"], &pairs[0]["height"]),
        (&60.into(), &HEIGHT.into())
    );
    assert!(pairs[0]["found_percent"].as_u64().unwrap() > 30);
    assert!(pairs[0]["seconds"].as_f64().unwrap() > 0.0);
    assert_eq!(pairs[0]["error"], Value::Null);
    assert!(pairs[1]["error"].as_str().unwrap().contains("right_02.png"));
    assert_eq!(pairs[1]["width"], Value::Null);
    assert_eq!(report["alone"][0], "pictures/left_77.png");
}

#[test]
fn what_holds_for_all_pairs_is_refused_before_any_is_matched() {
    let fixture = fixture();
    fs::create_dir(fixture.path("empty")).unwrap();
    fs::write(fixture.path("pairs.txt"), "left.png\n").unwrap();
    let refuses = |images: &[&str], more: &[&str], words: &[&str]| {
        fixture.refuses(&[&["match"], images, more].concat(), words);
    };
    let out = ["--out", "o_{}.png"];
    refuses(&["empty"], &out, &["empty", "left_01.png and right_01.png"]);
    refuses(&["pairs.txt"], &out, &["pairs.txt, line 1"]);
    refuses(&["none.txt"], &out, &["none.txt", "No such file"]);
    refuses(&["pictures"], &["--out", "o.png"], &["--out o.png", "{}"]);
    refuses(&["pictures"], &["--out", "-"], &["--out -", "{}"]);
    let colour = [&out[..], &["--colour", "c.png"]].concat();
    refuses(&["pictures"], &colour, &["--colour c.png", "{}"]);
    let over = ["--out", "pictures/left_{}.png"];
    refuses(&["pictures"], &over, &["left_01.png", "input"]);
    let twice = ["--out", "o_{}.png", "--colour", "o_{}.png"];
    refuses(&["pictures"], &twice, &["o_01.png", "one file"]);
    refuses(
        &["pictures"],
        &["--out", "left.png/{}.png"],
        &["left.png", "folder"],
    );
    refuses(&["pictures"], &["--out", "{}.tga"], &[".tga", ".pfm"]);
    let wide = [&out[..], &["--d-max", "60"]].concat();
    refuses(&["pictures"], &wide, &["--d-max 60", "width of 60 px"]);
    let depth = [&out[..], &["--depth", "d_{}.png"]].concat();
    refuses(&["pictures"], &depth, &["--depth", "--calibration"]);
    refuses(&["pictures", "left.png"], &out, &["pictures", "folder"]);
    let three = ["left.png", "right.png", "left.png"];
    refuses(&three, &out, &["3 images"]);
    let same = ["left.png", "right.png", "left.png", "right.png"];
    refuses(&same, &out, &["one name"]);
    let json = [&out[..], &["--json"]].concat();
    refuses(&["left.png", "right.png"], &json, &["--json", "many"]);
}

/// With an arrangement each image is a pair.
#[test]
fn joined_pictures_of_a_folder_are_matched() {
    let fixture = Fixture::new();
    fs::create_dir(fixture.path("both")).unwrap();
    for name in ["a", "b"] {
        let mut both = image::RgbImage::new(2 * WIDTH, HEIGHT);
        image::imageops::replace(&mut both, &texture(0), 0, 0);
        image::imageops::replace(&mut both, &texture(SHIFT), WIDTH.into(), 0);
        both.save(fixture.path(&format!("both/{name}.png")))
            .unwrap();
    }
    let single = [
        "match",
        "left.png",
        "right.png",
        "--out",
        "single.png",
        "--d-max",
        "12",
    ];
    assert_eq!(fixture.run(&single).code, Some(0));
    let many = [
        "match",
        "both",
        "--side-by-side",
        "--out",
        "{}_map.png",
        "--d-max",
        "12",
    ];
    let outcome = fixture.run(&many);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let bytes = |name: &str| fs::read(fixture.path(name)).unwrap();
    assert!(bytes("a_map.png") == bytes("single.png") && bytes("b_map.png") == bytes("single.png"));
}
