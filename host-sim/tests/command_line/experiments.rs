//! `vgstereo sweep`, `ablate` and `exposure`, which measure variants of presets and scenes.

use std::fs;

use image::GrayImage;

use crate::fixture::{Fixture, HEIGHT, WIDTH, two_scenes, write_scene};

#[test]
fn sweep_prints_the_stated_json_and_plots() {
    let fixture = two_scenes();
    let outcome = fixture.run(&[
        "sweep",
        "set",
        "a",
        "--synapses",
        "16,64",
        "--sigma",
        "1,2.5,4",
        "--json",
        "--plot",
        "plot.svg",
    ]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    let points = report["points"].as_array().unwrap();
    assert_eq!(points.len(), 6);
    assert_eq!(points[1]["scene"], "a");
    assert_eq!(points[1]["synapses"], 16);
    assert_eq!(points[1]["sigma"], 2.5);
    for mask in ["nonocc", "all", "disc", "average"] {
        assert!(points.iter().all(|point| point[mask].is_f64()), "{mask}");
    }
    let svg = fs::read_to_string(fixture.path("plot.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("|W| = 64") && svg.contains("sigma, px"));
}

#[test]
fn ablation_lists_the_stages_that_a_preset_has() {
    let fixture = two_scenes();
    for (preset, stages, missing) in [
        (
            "lite",
            &[
                "nothing",
                "aggregation",
                "left-right check",
                "speckle removal",
            ][..],
            "vote",
        ),
        (
            "micro",
            &["nothing", "masks", "vote", "weighted median"],
            "recall",
        ),
    ] {
        let outcome = fixture.run(&["ablate", "set", "a", "--preset", preset]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        for stage in stages {
            assert!(
                outcome.stdout.contains(&format!("| {stage} ")),
                "{}",
                outcome.stdout
            );
        }
        assert!(!outcome.stdout.contains(missing), "{}", outcome.stdout);
    }
    fixture.refuses(
        &["ablate", "set", "--preset", "paper"],
        &["paper", "no stages"],
    );
}

#[test]
fn a_wedge_of_exposures_is_measured() {
    let fixture = two_scenes();
    let outcome = fixture.run(&["exposure", "set", "a", "--preset", "lite", "--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    for (scene, name) in ["courtyard", "a"].into_iter().enumerate() {
        let scene = &report["scenes"][scene];
        assert_eq!(scene["scene"], name);
        let exposures = scene["exposures"].as_array().unwrap();
        assert_eq!(exposures[0]["gain"], serde_json::json!([1.0, 1.0]));
        assert_eq!(exposures[0]["presets"][0]["cost"], 0.0);
        for gain in [0.6, 1.6] {
            let is_at =
                |e: &&serde_json::Value| (e["gain"][0].as_f64().unwrap() - gain).abs() < 1e-6;
            let exposure = exposures.iter().find(is_at).unwrap();
            assert_eq!(exposure["presets"][0]["preset"], "lite");
            assert!(exposure["presets"][0]["average"].is_f64());
        }
    }
    fixture.refuses(&["exposure", "nowhere"], &["nowhere"]);
    fixture.refuses(&["exposure", "--preset", "lite,lite"], &["lite", "twice"]);
}

/// Where no truth is known there is nothing to measure, and no number.
#[test]
fn a_scene_without_a_known_truth_has_dashes() {
    let fixture = Fixture::new();
    let unknown = GrayImage::new(WIDTH, HEIGHT);
    let meta = "d_max = 12\ngt_scale = 4\n";
    write_scene(
        &fixture.path("set/a"),
        &unknown.into(),
        meta,
        &["nonocc.png"],
    );
    for arguments in [
        &["eval", "set", "--preset", "lite"][..],
        &["eval", "set", "--preset", "lite", "--seeds", "1,2"],
        &["ablate", "set", "--preset", "lite"],
        &[
            "sweep",
            "set",
            "--synapses",
            "16",
            "--sigma",
            "1",
            "--plot",
            "plot.svg",
        ],
    ] {
        let outcome = fixture.run(arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        assert!(!outcome.stdout.contains("NaN"), "{}", outcome.stdout);
        let is_row = |line: &&str| {
            line.starts_with("| a ") || line.starts_with("| lite") || line.starts_with("| nothing")
        };
        let mut rows = outcome.stdout.lines().filter(is_row).peekable();
        assert!(rows.peek().is_some(), "{}", outcome.stdout);
        for row in rows {
            let cells: Vec<&str> = row.split('|').map(str::trim).collect();
            assert!(cells.contains(&"-"), "{row}");
        }
    }
}
