//! `vgstereo eval`: figures, pictures, ranking, seeds, and what it refuses.

use std::fs;

use image::{GrayImage, Luma};

use crate::fixture::{Fixture, HEIGHT, SHIFT, WIDTH, two_scenes, write_scene};

/// The keys of the figures of a scene that do not depend on the machine.
pub(crate) const FIGURES: [&str; 10] = [
    "width",
    "height",
    "d_max",
    "nonocc",
    "all",
    "disc",
    "average",
    "invalid",
    "working_bytes",
    "latency_lines",
];

#[test]
fn eval_prints_the_stated_json() {
    let fixture = two_scenes();
    let outcome = fixture.run(&["eval", "set", "--preset", "paper", "--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    let preset = &report["presets"][0];
    assert_eq!(preset["preset"], "paper");
    let scenes = preset["scenes"].as_array().unwrap();
    assert_eq!(scenes.len(), 2);
    let keys: Vec<&str> = scenes[0]
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    let mut expected = [&["scene", "seconds"], &FIGURES[..]].concat();
    expected.sort_unstable();
    let mut sorted = keys.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected);
    assert_eq!(
        (
            &scenes[0]["scene"],
            &scenes[0]["width"],
            &scenes[0]["height"],
            &scenes[0]["d_max"]
        ),
        (&"a".into(), &WIDTH.into(), &HEIGHT.into(), &12.into())
    );
    for mask in ["nonocc", "all", "disc", "average"] {
        assert!(scenes[0][mask].as_f64().unwrap() < 1.0, "{mask}");
    }
    // 2 px off everywhere, and only one mask.
    assert!(scenes[1]["nonocc"].as_f64().unwrap() > 99.0);
    assert!(scenes[1]["all"].is_null() && scenes[1]["disc"].is_null());
    assert_eq!(scenes[1]["average"], scenes[1]["nonocc"]);
    let mean =
        (scenes[0]["average"].as_f64().unwrap() + scenes[1]["average"].as_f64().unwrap()) / 2.0;
    assert!((preset["average"].as_f64().unwrap() - mean).abs() < 1e-9);
    assert_eq!(scenes[0]["latency_lines"], 20);

    let loose = fixture.run(&[
        "eval",
        "set",
        "b",
        "--preset",
        "paper",
        "--json",
        "--threshold",
        "3",
    ]);
    let report: serde_json::Value = serde_json::from_str(&loose.stdout).unwrap();
    assert!(report["presets"][0]["average"].as_f64().unwrap() < 1.0);
}

#[test]
fn eval_prints_tables_and_writes_pictures() {
    let fixture = two_scenes();
    let outcome = fixture.run(&["eval", "set", "--out", "pictures", "--threads", "2"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    for word in [
        "paper-raw",
        "paper ",
        "micro ",
        "| a ",
        "| b ",
        "average",
        "lines",
    ] {
        assert!(
            outcome.stdout.contains(word),
            "{word:?} in {}",
            outcome.stdout
        );
    }
    for name in [
        "a-paper-disparity.png",
        "a-paper-error.png",
        "b-paper-raw-error.png",
    ] {
        let picture = image::open(fixture.path("pictures").join(name)).unwrap();
        assert_eq!((picture.width(), picture.height()), (WIDTH, HEIGHT));
    }
    let spread = fixture.run(&["eval", "set", "--seeds", "1,2,3", "--preset", "paper"]);
    assert!(spread.stdout.contains("3 seeds"), "{}", spread.stdout);
}

/// The four scenes of the benchmark, by name; found but for nothing.
fn benchmark_scenes(fixture: &Fixture, masks: &[&str]) {
    for scene in ["tsukuba", "venus", "teddy", "cones"] {
        let truth = GrayImage::from_pixel(WIDTH, HEIGHT, Luma([4 * SHIFT as u8]));
        write_scene(
            &fixture.path("v2").join(scene),
            &truth.into(),
            "d_max = 12\ngt_scale = 4\n",
            masks,
        );
    }
}

#[test]
fn eval_ranks_the_presets_among_published_results() {
    let fixture = two_scenes();
    benchmark_scenes(&fixture, &["nonocc.png", "all.png", "disc.png"]);
    let arguments = ["eval", "v2", "--preset", "paper,lite", "--compare"];
    let outcome = fixture.run(&[&arguments[..], &["--json"]].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert_eq!(report["presets"].as_array().unwrap().len(), 2);
    let ranked = report["comparison"].as_array().unwrap();
    let averages: Vec<f64> = ranked
        .iter()
        .map(|method| method["average"].as_f64().unwrap())
        .collect();
    assert!(averages.is_sorted(), "{averages:?}");
    let (published, measured): (Vec<_>, Vec<_>) = ranked
        .iter()
        .partition(|method| method["published"] == true);
    assert_eq!((published.len(), measured.len()), (11, 2));
    assert!(published.iter().all(|method| method["source"].is_string()));
    assert_eq!(published[0]["method"], "AD-Census");
    assert_eq!(published[0]["scenes"][2]["scene"], "teddy");
    assert_eq!(published[0]["scenes"][2]["disc"], 10.9);
    // A shifted texture is found, so the presets come first.
    for (method, preset) in measured.iter().zip(&ranked[..2]) {
        assert_eq!(method["method"], preset["method"]);
        assert_eq!(method["scenes"].as_array().unwrap().len(), 4);
    }

    let table = fixture.run(&arguments);
    let line_of = |words: [&str; 2]| {
        let mut lines = table.stdout.lines();
        let found = lines.position(|line| words.iter().all(|word| line.contains(word)));
        found.unwrap_or_else(|| panic!("{words:?} in {}", table.stdout))
    };
    let order = [
        line_of(["| lite ", "measured here"]),
        line_of(["AD-Census", "3.97"]),
        line_of(["SemiGlob", "7.50"]),
        line_of(["VG-RAM", "15.00"]),
    ];
    assert!(order.is_sorted(), "{}", table.stdout);
    let plain = fixture.run(&["eval", "v2", "--preset", "lite"]);
    assert!(!plain.stdout.contains("AD-Census"), "{}", plain.stdout);
}

#[test]
fn eval_compares_only_what_was_measured_alike() {
    let fixture = two_scenes();
    benchmark_scenes(&fixture, &["nonocc.png", "all.png"]);
    fixture.refuses(&["eval", "set", "--compare"], &["--compare", "tsukuba"]);
    fixture.refuses(
        &["eval", "v2", "tsukuba", "venus", "teddy", "--compare"],
        &["--compare", "cones is not"],
    );
    fixture.refuses(
        &["eval", "v2", "--compare", "--threshold", "2"],
        &["--compare", "threshold"],
    );
    fixture.refuses(&["eval", "v2", "--compare"], &["--compare", "disc.png"]);
    for other in [&["--sparse"][..], &["--seeds", "1,2"]] {
        let arguments = [&["eval", "v2", "--compare"][..], other].concat();
        fixture.refuses(&arguments, &["--compare", other[0]]);
    }
}

#[test]
fn eval_measures_grey_when_asked_for() {
    let fixture = two_scenes();
    let report = |preset, more: &[&str]| -> serde_json::Value {
        let mut arguments = vec!["eval", "set", "a", "--json", "--preset", preset];
        arguments.extend(more);
        let outcome = fixture.run(&arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        serde_json::from_str(&outcome.stdout).unwrap()
    };
    let scene = |report: &serde_json::Value, key: &str| {
        report["presets"][0]["scenes"][0][key].as_f64().unwrap()
    };
    for preset in ["paper", "micro"] {
        let (grey, colour) = (report(preset, &["--grey"]), report(preset, &[]));
        for report in [&grey, &colour] {
            assert!(scene(report, "nonocc") < 1.0, "{preset}");
        }
        let bytes = |report| scene(report, "working_bytes");
        if preset == "paper" {
            // It keeps nothing but the grey of either.
            assert_eq!(bytes(&grey), bytes(&colour), "{preset}");
            for key in ["nonocc", "all", "disc", "average", "invalid"] {
                assert_eq!(scene(&grey, key), scene(&colour, key), "{key}");
            }
        } else {
            assert!(bytes(&grey) < bytes(&colour), "{preset}");
        }
    }
}

/// Of several seeds, what each alone gives at its least and its most.
#[test]
fn seeds_are_reported_together() {
    let fixture = two_scenes();
    let json = |more: &[&str]| -> serde_json::Value {
        let arguments = ["eval", "set", "--preset", "lite,micro", "--json"];
        let outcome = fixture.run(&[&arguments[..], more].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        serde_json::from_str(&outcome.stdout).unwrap()
    };
    let alone = ["1", "7", "3"].map(|seed| json(&["--seed", seed]));
    let together = json(&["--seeds", "1,7,3"]);
    assert_eq!(together["seeds"], serde_json::json!([1, 7, 3]));
    for preset in 0..2 {
        let pick = |report: &serde_json::Value| report["presets"][preset].clone();
        let of_scene = |scene: usize| {
            alone
                .each_ref()
                .map(|r| pick(r)["scenes"][scene]["average"].clone())
        };
        let spreads = [
            (
                pick(&together)["average"].clone(),
                alone.each_ref().map(|r| pick(r)["average"].clone()),
            ),
            (pick(&together)["scenes"][0].clone(), of_scene(0)),
            (pick(&together)["scenes"][1].clone(), of_scene(1)),
        ];
        assert_eq!(pick(&together)["preset"], pick(&alone[0])["preset"]);
        assert_eq!(
            pick(&together)["scenes"][1]["scene"],
            pick(&alone[0])["scenes"][1]["scene"]
        );
        for (spread, averages) in spreads {
            let averages = averages.map(|average| average.as_f64().unwrap());
            let least = averages.into_iter().fold(f64::INFINITY, f64::min);
            let most = averages.into_iter().fold(0.0, f64::max);
            assert_eq!(
                (spread["smallest"].as_f64(), spread["largest"].as_f64()),
                (Some(least), Some(most))
            );
            let mean = averages.iter().sum::<f64>() / 3.0;
            assert!((spread["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
            // Of three numbers, the mean square of the differences of two is twice the variance.
            let [a, b, c] = averages;
            let squares = (a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2);
            let deviation = spread["deviation"].as_f64().unwrap();
            assert!((deviation - (squares / 6.0).sqrt()).abs() < 1e-9);
        }
    }
}

/// The tenths are of all scenes together: their mean is the share of bad ones of all that was found.
#[test]
fn bad_disparities_are_told_by_confidence() {
    let fixture = two_scenes();
    let arguments = [
        "eval",
        "set",
        "--preset",
        "micro",
        "--sparse",
        "--by-confidence",
    ];
    let outcome = fixture.run(&arguments);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(
        outcome
            .stdout
            .contains("from the least confident to the most")
    );
    let outcome = fixture.run(&[&arguments[..], &["--json"]].concat());
    let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
    let tenths = report["presets"][0]["tenths"].as_array().unwrap();
    let tenths: Vec<f64> = tenths.iter().map(|bad| bad.as_f64().unwrap()).collect();
    assert_eq!(tenths.len(), 10);
    let mean = tenths.iter().sum::<f64>() / 10.0;
    let scenes = report["presets"][0]["scenes"].as_array().unwrap();
    let bad: Vec<f64> = scenes
        .iter()
        .map(|scene| scene["nonocc"].as_f64().unwrap())
        .collect();
    let [least, most] = [f64::min, f64::max].map(|pick| bad.iter().copied().reduce(pick).unwrap());
    assert!((least..=most).contains(&mean), "{mean} of {bad:?}");
    let outcome = fixture.run(&["eval", "set", "--json", "--preset", "micro"]);
    assert!(!outcome.stdout.contains("tenths"));
}

/// What only one view sees is filled in, or left out when asked for.
#[test]
fn sparse_leaves_out_what_was_not_found() {
    let fixture = two_scenes();
    let invalid = |more: &[&str]| {
        let mut arguments = vec!["eval", "set", "a", "--preset", "micro", "--json"];
        arguments.extend(more);
        let outcome = fixture.run(&arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let report: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
        report["presets"][0]["scenes"][0]["invalid"]
            .as_f64()
            .unwrap()
    };
    assert_eq!(invalid(&[]), 0.0);
    // The first five of eighty columns match outside the right view.
    assert!(invalid(&["--sparse"]) >= 6.25);
}

#[test]
fn eval_and_sweep_refuse_bad_folders() {
    let fixture = two_scenes();
    fixture.refuses(&["eval", "nowhere"], &["nowhere", "No such file"]);
    fixture.refuses(&["eval", "set/group"], &["set/group", "no scenes"]);
    fixture.refuses(&["eval", "set", "c"], &["set/c", "left.png"]);
    for threshold in ["0", "inf", "NaN", "3000"] {
        for command in ["eval", "sweep", "ablate", "exposure"] {
            let arguments = [command, "set", "--threshold", threshold];
            fixture.refuses(&arguments, &["--threshold"]);
        }
    }
    fixture.refuses(&["eval", "set", "--threads", "0"], &["--threads"]);
    fixture.refuses(
        &["sweep", "set", "--plot", "plot.png"],
        &["plot.png", ".svg"],
    );
    for (twice, words) in [
        (&["eval", "set", "a", "b", "a"][..], "scene a"),
        (&["eval", "set", "--preset", "paper,paper"], "preset paper"),
        (&["eval", "set", "--seeds", "1,2,1"], "seed 1"),
        (&["sweep", "set", "--sigma", "4,2,4"], "sigma 4"),
    ] {
        fixture.refuses(twice, &[words, "twice"]);
    }
    fixture.refuses(&["sweep", "set", "--synapses", "20"], &["synapses"]);
    let mut tiny = std::io::Cursor::new(Vec::new());
    let pixel = GrayImage::from_pixel(1, 1, Luma([255]));
    pixel.write_to(&mut tiny, image::ImageFormat::Png).unwrap();
    let tiny = tiny.into_inner();
    for (file, bytes, words) in [
        (
            "meta.toml",
            &b"d_max = 12\n"[..],
            &["set/a/meta.toml", "gt_scale"][..],
        ),
        (
            "meta.toml",
            b"d_max = 12\ngt_scale = 0\n",
            &["set/a/meta.toml", "gt_scale"],
        ),
        (
            "meta.toml",
            b"d_max = 12\ngt_scale = inf\n",
            &["set/a/meta.toml", "gt_scale"],
        ),
        (
            "meta.toml",
            b"d_max = 12\ngt_scale = 1e-45\n",
            &["set/a/meta.toml", "gt_scale"],
        ),
        (
            "meta.toml",
            b"d_max = 80\ngt_scale = 4\n",
            &["set/a", "d_max, 80 px", "smaller than the width"],
        ),
        ("gt_left.png", b"", &["set/a/gt_left.png"]),
        ("all.png", &tiny, &["set/a/all.png", "1x1", "80x40"]),
    ] {
        let path = fixture.path("set/a").join(file);
        let kept = fs::read(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        fixture.refuses(&["eval", "set", "a"], words);
        fs::write(&path, kept).unwrap();
    }
    assert_eq!(fixture.run(&["eval", "set", "a"]).code, Some(0));
}

/// Without a mask, all pixels whose truth is known count, as a mask of all pixels does.
#[test]
fn a_scene_without_a_mask_is_measured_everywhere() {
    let fixture = two_scenes();
    let folder = fixture.path("set/a");
    GrayImage::from_pixel(WIDTH, HEIGHT, Luma([1]))
        .save(folder.join("all.png"))
        .unwrap();
    let all = || {
        let run = fixture.run(&["eval", "set", "a", "--preset", "lite", "--json"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        report["presets"][0]["scenes"][0]["all"].as_f64().unwrap()
    };
    let masked = all();
    for mask in ["nonocc.png", "all.png", "disc.png"] {
        // Not every scene has every mask.
        let _ = fs::remove_file(folder.join(mask));
    }
    assert_eq!(all(), masked);
}
