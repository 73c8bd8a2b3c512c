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
