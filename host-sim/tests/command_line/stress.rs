//! `vgstereo stress`: disturbed scenes, measured as `eval` measures them.

use std::fs;

use serde_json::Value;

use crate::fixture::{Fixture, two_scenes};

fn json(fixture: &Fixture, arguments: &[&str]) -> Value {
    let outcome = fixture.run(arguments);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    serde_json::from_str(&outcome.stdout).unwrap()
}

/// What is written and then measured by `eval` has the figures of the table, so that another program
/// measures the same pictures.
#[test]
fn written_scenes_are_those_that_were_measured() {
    let fixture = two_scenes();
    let kinds = "noise=20,line-offset,periodic=6,jpeg=30";
    let words = [
        "stress",
        "set",
        "a",
        "b",
        "--preset",
        "lite,micro",
        "--kind",
        kinds,
    ];
    let report = json(
        &fixture,
        &[&words[..], &["--write", "out", "--json"]].concat(),
    );
    let measured = json(
        &fixture,
        &["eval", "out", "--preset", "lite,micro", "--json"],
    );
    let mut compared = 0;
    for scene in report["scenes"].as_array().unwrap() {
        let rows = scene["rows"].as_array().unwrap();
        // As it is, three amounts that were given, and two of the battery.
        assert_eq!(rows.len(), 6);
        assert!(rows[0]["kind"].is_null());
        for row in &rows[1..] {
            let folder = format!(
                "{}-{}-{}",
                scene["scene"].as_str().unwrap(),
                row["kind"].as_str().unwrap(),
                row["amount"]
            );
            let folder = folder.trim_end_matches(".0");
            assert!(
                fs::metadata(fixture.path("out").join(folder)).is_ok(),
                "{folder}"
            );
            for preset in row["presets"].as_array().unwrap() {
                let presets = measured["presets"].as_array().unwrap();
                let same = |it: &&Value| it["preset"] == preset["preset"];
                let scenes = presets.iter().find(same).unwrap()["scenes"]
                    .as_array()
                    .unwrap();
                let found = scenes.iter().find(|it| it["scene"] == folder).unwrap();
                let difference =
                    found["average"].as_f64().unwrap() - preset["average"].as_f64().unwrap();
                // The truth is stored with 16 bits.
                assert!(difference.abs() < 0.5, "{folder}: {found} {preset}");
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 2 * 5 * 2);
}

/// A picture that is taken for several frames is matched better where lines lie too low, and else as before.
#[test]
fn later_frames_begin_with_what_the_first_one_taught() {
    let fixture = two_scenes();
    let measured = |frames: &str| {
        let words = [
            "stress",
            "--preset",
            "lite",
            "--kind",
            "line-offset=0.9",
            "--json",
        ];
        let report = json(&fixture, &[&words[..], &["--frames", frames]].concat());
        let row =
            |index: usize| report["scenes"][0]["rows"][index]["presets"][0]["average"].as_f64();
        [row(0).unwrap(), row(1).unwrap()]
    };
    let [undisturbed, first] = measured("1");
    let [undisturbed_later, later] = measured("3");
    assert_eq!(undisturbed, undisturbed_later);
    assert!(later < first, "{later} after {first}");
    fixture.refuses(&["stress", "--frames", "0"], &["--frames"]);
}

/// What `match` tells of the lines of a pair is taken by its option, and then there is nothing left to tell.
#[test]
fn line_offsets_that_were_told_are_taken() {
    let fixture = two_scenes();
    let words = [
        "stress",
        "--kind",
        "roll=0.25",
        "--preset",
        "lite",
        "--write",
        "out",
    ];
    assert_eq!(fixture.run(&words).code, Some(0));
    let folder = fs::read_dir(fixture.path("out"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap();
    let [left, right] = ["left.png", "right.png"].map(|name| {
        let path = folder.path().join(name);
        assert!(path.exists(), "{}", path.display());
        path.to_str().unwrap().to_owned()
    });
    let mut given = None::<String>;
    for _ in 0..4 {
        let mut words = vec![
            "match", &left, &right, "--preset", "lite", "--out", "map.pfm",
        ];
        words.extend(given.as_deref());
        let outcome = fixture.run(&words);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let told = outcome
            .stdout
            .lines()
            .find(|line| line.contains("--line-offsets="));
        let Some(told) = told else {
            assert!(given.is_some(), "{}", outcome.stdout);
            return;
        };
        let option = told.split(' ').next_back().unwrap().to_owned();
        let degrees: f64 = option.split(',').nth(1).unwrap().parse().unwrap();
        assert!((degrees.abs() - 0.25).abs() < 0.06, "{told}");
        given = Some(option);
    }
    panic!("there is always something to tell: {given:?}");
}

#[test]
fn what_cannot_be_disturbed_is_refused() {
    let fixture = two_scenes();
    fixture.refuses(
        &["stress", "set", "--kind", "snow"],
        &["snow", "there are texture"],
    );
    fixture.refuses(
        &["stress", "set", "--kind", "jpeg=0"],
        &["0 is no amount of jpeg"],
    );
    fixture.refuses(&["stress", "nowhere"], &["nowhere"]);
    fs::remove_file(fixture.path("set/b/gt_left.png")).unwrap();
    fixture.refuses(
        &["stress", "set", "b", "--kind", "noise"],
        &["b", "gt_left.png"],
    );
}
