//! `vgstereo match` and `eval` of recordings: what is made of a recorded pair is what is made of its pictures.

use std::fs;

use image::imageops::crop_imm;
use image::{GrayImage, Luma, Rgb, RgbImage};
use serde_json::Value;
use vgstereo_core::INVALID;
use vgstereo_link::board::Camera;

use crate::eval::FIGURES;
use crate::fixture::{Fixture, HEIGHT, Outcome, SHIFT, WIDTH, files_below, texture, two_scenes};
use crate::link::{Board, Sent, record};

/// Width of the views, which are cut out of a texture, px.
const CUT_WIDTH: u32 = 60;
const BOARD: Board = Board {
    size: (CUT_WIDTH as u16, HEIGHT),
    rectifies: false,
    camera: None,
};
const OUTPUTS: [&str; 4] = ["--out", "o/{}.png", "--confidence", "o/{}_confidence.png"];

/// The pair whose first column is this one of the texture. One of them has no colour.
fn pair(column: u32) -> [RgbImage; 2] {
    [0, SHIFT].map(|shift| {
        let mut view = crop_imm(&texture(shift), column, 0, CUT_WIDTH, HEIGHT).to_image();
        if column == 7 {
            for pixel in view.pixels_mut() {
                *pixel = Rgb([pixel.0[1]; 3]);
            }
        }
        view
    })
}

fn raw(frame: u32, column: u32) -> Sent {
    Sent {
        frame,
        raw: Some(pair(column)),
        ..Sent::default()
    }
}

/// Four whole pairs, the board begins anew before the last of them, and a frame with a gap.
fn frames() -> Vec<Sent> {
    let gap = Sent {
        missing: Some(3),
        ..raw(8, 2)
    };
    vec![raw(3, 0), raw(7, 7), gap, raw(12, 11), raw(3, 18)]
}
const NAMES: [(&str, u32); 4] = [
    ("000003", 0),
    ("000007", 7),
    ("000012", 11),
    ("000003_2", 18),
];

fn matched(fixture: &Fixture, images: &[&str], outputs: &[&str], more: &[&str]) -> Outcome {
    fixture.run(&[&["match"], images, outputs, &["--d-max", "12"], more].concat())
}

/// The files that matching the pictures of the pairs writes.
fn expected(fixture: &Fixture) -> Vec<(String, Vec<u8>)> {
    fs::create_dir(fixture.path("o")).unwrap();
    for (name, column) in NAMES {
        for (view, path) in pair(column).iter().zip(["l.png", "r.png"]) {
            view.save(fixture.path(path)).unwrap();
        }
        let outputs = OUTPUTS.map(|word| word.replace("{}", name));
        let outputs = outputs.each_ref().map(String::as_str);
        let outcome = matched(fixture, &["l.png", "r.png"], &outputs, &[]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    }
    let files = files_below(&fixture.path("o"));
    fs::remove_dir_all(fixture.path("o")).unwrap();
    files
}

#[test]
fn recorded_pairs_give_the_files_of_their_pictures_at_any_number_of_threads() {
    let fixture = Fixture::new();
    let expected = expected(&fixture);
    assert_eq!(expected.len(), 2 * NAMES.len());
    // Disparities of the board do not stand in the way of its pairs.
    let mut frames = frames();
    frames[1].disparities_q4 = Some(vec![16; (CUT_WIDTH * HEIGHT) as usize]);
    frames.push(Sent {
        frame: 4,
        disparities_q4: Some(vec![0; (CUT_WIDTH * HEIGHT) as usize]),
        ..Sent::default()
    });
    let bytes = BOARD.bytes(&frames);
    fs::write(fixture.path("a.bin"), &bytes).unwrap();
    record(&fixture.path("a.mcap"), &bytes);
    // As the board has rectified them, from views that are not those.
    let rectified: Vec<Sent> = frames
        .into_iter()
        .map(|sent| Sent {
            rectified: sent.raw.clone(),
            raw: sent.raw.map(|[left, right]| [right, left]),
            ..sent
        })
        .collect();
    let board = Board {
        rectifies: true,
        ..BOARD
    };
    record(&fixture.path("b.mcap"), &board.bytes(&rectified));
    for (recording, threads) in [
        ("a.mcap", "1"),
        ("a.mcap", "2"),
        ("a.mcap", "5"),
        ("a.bin", "2"),
        ("b.mcap", "2"),
    ] {
        let outcome = matched(&fixture, &[recording], &OUTPUTS, &["--threads", threads]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let files = files_below(&fixture.path("o"));
        assert!(files == expected, "{recording}, {threads} threads");
        fs::remove_dir_all(fixture.path("o")).unwrap();
        let left_out = format!("{recording}: frames left out: 2");
        assert!(outcome.stderr.contains(&left_out), "{}", outcome.stderr);
        for words in ["| 000003 ", "| 000003_2 ", "60x40", "4 of 4 frames"] {
            assert!(outcome.stdout.contains(words), "{}", outcome.stdout);
        }
    }
    let outcome = matched(&fixture, &["a.mcap"], &OUTPUTS, &["--json"]);
    let report: Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert_eq!(report["left_out"], 2);
    assert_eq!(report["damage"], Value::Null);
    let names = report["pairs"].as_array().unwrap().iter();
    let names: Vec<&str> = names.map(|pair| pair["name"].as_str().unwrap()).collect();
    assert_eq!(names, NAMES.map(|(name, _)| name));
}

#[test]
fn a_recording_that_is_cut_is_matched_up_to_there_and_the_end_is_told() {
    let fixture = Fixture::new();
    let expected = expected(&fixture);
    record(&fixture.path("a.mcap"), &BOARD.bytes(&frames()));
    let whole = fs::read(fixture.path("a.mcap")).unwrap();
    let mut counts = Vec::new();
    for part in 1..7 {
        let length = whole.len() * part / 7;
        fs::write(fixture.path("cut.mcap"), &whole[..length]).unwrap();
        let outcome = matched(&fixture, &["cut.mcap"], &OUTPUTS, &[]);
        let told = "cut.mcap is damaged: read up to byte ";
        assert!(outcome.stderr.contains(told), "{}", outcome.stderr);
        if counts.is_empty() && outcome.code == Some(2) {
            // There is no whole frame, and nothing is written.
            assert!(
                outcome
                    .stderr
                    .contains("no whole frame with a pair of views")
            );
            assert!(!fixture.path("o").exists());
            continue;
        }
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let files = files_below(&fixture.path("o"));
        assert!(files.iter().all(|file| expected.contains(file)), "{length}");
        counts.push(files.len());
        fs::remove_dir_all(fixture.path("o")).unwrap();
    }
    // Each has two files, and of the first four frames one has a gap.
    assert!(counts.is_sorted() && counts.len() >= 4, "{counts:?}");
    assert_eq!((counts[0], counts.last()), (2, Some(&6)));
}

/// As many bytes of memory as a process may take for its data here.
#[cfg(target_os = "linux")]
const DATA_BYTES_MAX: u64 = 20 << 20;

#[cfg(target_os = "linux")]
#[test]
fn a_long_recording_is_matched_in_less_memory_than_its_frames_take() {
    let fixture = Fixture::new();
    let board = Board::new((320, 240));
    let tile = texture(0);
    let view = RgbImage::from_fn(320, 240, |x, y| *tile.get_pixel(x % WIDTH, y % HEIGHT));
    let frame = |frame| Sent {
        frame,
        raw: Some([view.clone(), view.clone()]),
        ..Sent::default()
    };
    let frames: Vec<Sent> = (0..64).map(frame).collect();
    let bytes = board.bytes(&frames);
    assert!(bytes.len() as u64 > DATA_BYTES_MAX);
    fs::write(fixture.path("a.bin"), bytes).unwrap();
    let kib = DATA_BYTES_MAX >> 10;
    let program = assert_cmd::cargo::cargo_bin!("vgstereo").display();
    let line = format!(
        "ulimit -d {kib} && exec '{program}' match a.bin --out 'o/{{}}.png' --threads 2 --grey \
         --preset lite --d-max 3 --no-check"
    );
    let output = std::process::Command::new("sh")
        .args(["-c", &line])
        .current_dir(fixture.folder.path())
        .output()
        .unwrap();
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{:?}", output.stderr);
    assert!(told.contains("64 of 64 frames"), "{told}");
}

/// The folder of a scene that was seen through distorted cameras, `scenes/yard`, and its raw pair.
fn distorted() -> (Fixture, Board, [RgbImage; 2]) {
    let fixture = Fixture::new();
    let made = fixture.run(&[
        "demo",
        "--width",
        "160",
        "--height",
        "120",
        "--d-max",
        "20",
        "--distort",
        "--out",
        "raw",
        "--scene",
        "scenes/yard",
    ]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    let view = |side| {
        let path = fixture.path(&format!("scenes/yard/{side}.png"));
        image::open(path).unwrap().into_rgb8()
    };
    let views = ["left", "right"].map(view);
    let board = Board {
        rectifies: true,
        ..Board::new((160, 120))
    };
    (fixture, board, views)
}

#[test]
fn raw_pairs_of_a_board_that_rectifies_take_a_calibration() {
    let (fixture, board, views) = distorted();
    let sent = |frame| Sent {
        frame,
        raw: Some(views.clone()),
        ..Sent::default()
    };
    record(&fixture.path("a.mcap"), &board.bytes(&[sent(0), sent(1)]));
    let calibration = [
        "--calibration",
        "scenes/yard/left.yaml",
        "scenes/yard/right.yaml",
        "--unit",
        "m",
    ];
    let outputs = ["--out", "o_{}.png", "--depth", "d_{}.pfm"];
    let words = ["error: a.mcap: frame 000000", "raw", "--calibration"];
    fixture.refuses(&["match", "a.mcap", "--out", "o_{}.png"], &words);
    let outcome = matched(&fixture, &["a.mcap"], &outputs, &calibration);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let pictures = ["scenes/yard/left.png", "scenes/yard/right.png"];
    let outputs = ["--out", "o.png", "--depth", "d.pfm"];
    let outcome = matched(&fixture, &pictures, &outputs, &calibration);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let bytes = |name: &str| fs::read(fixture.path(name)).unwrap();
    for frame in ["000000", "000001"] {
        assert!(bytes(&format!("o_{frame}.png")) == bytes("o.png"));
        assert!(bytes(&format!("d_{frame}.pfm")) == bytes("d.pfm"));
    }
    // `eval` takes the calibration of the scene.
    let truth = ["eval", "a.mcap", "--truth", "scenes/yard"];
    let preset = ["--preset", "lite"];
    fixture.refuses(
        &[&truth[..], &preset].concat(),
        &["a.mcap: frame 000000", "raw", "--calibrated"],
    );
    let calibrated = ["--calibrated", "--json"];
    let outcome = fixture.run(&[&truth[..], &preset, &calibrated].concat());
    let of_recording = report(&outcome);
    let outcome = fixture.run(&[&["eval", "scenes"], &preset[..], &calibrated].concat());
    let of_scene = report(&outcome);
    for frame in 0..2 {
        assert_same_figures(&of_recording["presets"][0], frame, &of_scene["presets"][0]);
    }
}

#[test]
fn distances_are_by_the_camera_that_the_board_has_told() {
    let fixture = Fixture::new();
    // 100 px, 60 mm, an offset of 1.5 px.
    let camera = Camera {
        focal_q8: 100 << 8,
        principal_x_q8: 30 << 8,
        principal_y_q8: 20 << 8,
        depth_q8: 6000 << 8,
        offset_q8: 384,
    };
    let board = Board {
        camera: Some(camera),
        ..BOARD
    };
    record(&fixture.path("a.mcap"), &board.bytes(&[raw(0, 0)]));
    for (view, path) in pair(0).iter().zip(["l.png", "r.png"]) {
        view.save(fixture.path(path)).unwrap();
    }
    let options = [
        "--focal",
        "100",
        "--baseline",
        "60",
        "--doffs",
        "1.5",
        "--principal",
        "30,20",
    ];
    for reference in ["left", "right"] {
        let reference = ["--reference", reference];
        let single = ["--out", "o.pfm", "--depth", "d.pfm", "--points", "p.ply"];
        let more = [&options[..], &reference].concat();
        let outcome = matched(&fixture, &["l.png", "r.png"], &single, &more);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let many = single.map(|word| word.replace('.', "{}."));
        let many = many.each_ref().map(String::as_str);
        let outcome = matched(&fixture, &["a.mcap"], &many, &reference);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        for name in ["o.pfm", "d.pfm", "p.ply"] {
            let bytes = |name: &str| fs::read(fixture.path(name)).unwrap();
            assert!(
                bytes(name) == bytes(&name.replace('.', "000000.")),
                "{name}"
            );
        }
    }
}

fn report(outcome: &Outcome) -> Value {
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    serde_json::from_str(&outcome.stdout).unwrap()
}

/// Asserts that a frame of a preset has the figures of the scene of the other report of the preset.
fn assert_same_figures(preset: &Value, frame: usize, of_scene: &Value) {
    let (frame, scene) = (&preset["scenes"][frame], &of_scene["scenes"][0]);
    assert!(scene["average"].as_f64().is_some(), "{of_scene}");
    for figure in FIGURES {
        assert_eq!(frame[figure], scene[figure], "{figure}");
    }
}

#[test]
fn frames_are_judged_by_the_truth_of_a_scene_as_the_scene_is() {
    let fixture = two_scenes();
    // The truth of `a` alone: the views come from the recording.
    let scene = fixture.path("set/a");
    let views = ["left", "right"].map(|side| {
        let path = scene.join(format!("{side}.png"));
        image::open(path).unwrap().into_rgb8()
    });
    let of_scene = report(&fixture.run(&["eval", "set", "a", "--preset", "paper,lite", "--json"]));
    for side in ["left", "right"] {
        fs::remove_file(scene.join(format!("{side}.png"))).unwrap();
    }
    let pixels = (WIDTH * HEIGHT) as usize;
    let truth_q4 = 16 * SHIFT as i16;
    // In the first frame all is right but a column, 2 px off; in the second, that column was filled in.
    let mut disparities_q4 = vec![truth_q4; pixels];
    let mut confidences = vec![200; pixels];
    for at in (30..pixels).step_by(WIDTH as usize) {
        disparities_q4[at] += 32;
        confidences[at] = 0;
    }
    disparities_q4[31] = INVALID;
    let seen = Sent {
        raw: Some(views.clone()),
        disparities_q4: Some(disparities_q4),
        ..Sent::default()
    };
    let sure = Sent {
        frame: 1,
        confidences: Some(confidences),
        ..seen.clone()
    };
    let pair_alone = Sent {
        frame: 5,
        disparities_q4: None,
        ..seen.clone()
    };
    let board = Board::new((WIDTH as u16, HEIGHT));
    record(
        &fixture.path("a.mcap"),
        &board.bytes(&[seen, sure, pair_alone.clone()]),
    );
    let truth = ["eval", "a.mcap", "--truth", "set/a", "--json"];
    let presets = ["--preset", "paper,lite"];
    let judged = report(&fixture.run(&[&truth[..], &presets].concat()));
    for frame in 0..3 {
        for preset in 0..2 {
            let of_scene = &of_scene["presets"][preset];
            assert_same_figures(&judged["presets"][preset + 1], frame, of_scene);
        }
    }
    let of_board = &judged["presets"][0];
    assert_eq!(of_board["preset"], "board");
    let scenes = of_board["scenes"].as_array().unwrap();
    let names: Vec<&str> = scenes
        .iter()
        .map(|s| s["scene"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["000000", "000001"]);
    // The masks have columns 20 to 59 of the inner lines, of which one is bad.
    for scene in scenes {
        for mask in ["nonocc", "all", "disc", "average"] {
            let bad = scene[mask].as_f64().unwrap();
            assert!((bad - 100.0 / 40.0).abs() < 1e-9, "{mask}: {bad}");
        }
        let invalid = scene["invalid"].as_f64().unwrap();
        assert!((invalid - 100.0 / pixels as f64).abs() < 1e-9);
        assert_eq!(scene["d_max"], 47);
        assert_eq!(scene["seconds"], Value::Null);
    }
    // Of what was found alone, only the frame with confidences can tell what was filled in.
    let sparse = report(&fixture.run(&[&truth[..], &["--sparse"]].concat()));
    let of_board = &sparse["presets"][0]["scenes"];
    assert!((of_board[0]["all"].as_f64().unwrap() - 2.5).abs() < 1e-9);
    assert_eq!(of_board[1]["all"], 0.0);
    // Without --preset, the frame with a pair alone is matched with all.
    assert_eq!(sparse["presets"].as_array().unwrap().len(), 7);
    assert_eq!(sparse["presets"][1]["scenes"].as_array().unwrap().len(), 1);

    let table = ["eval", "a.mcap", "--truth", "set/a", "--out", "p"];
    let outcome = fixture.run(&[&table[..], &["--preset", "lite"]].concat());
    assert!(outcome.stdout.contains("| board "), "{}", outcome.stdout);
    for name in ["000001-board-error", "000005-lite-disparity"] {
        let picture = image::open(fixture.path(&format!("p/{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (WIDTH, HEIGHT));
    }
    // What a cut leaves is judged, and what is missing told.
    let whole = fs::read(fixture.path("a.mcap")).unwrap();
    fs::write(fixture.path("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let outcome = fixture.run(&["eval", "cut.mcap", "--truth", "set/a", "--json"]);
    let cut = report(&outcome);
    let damage = cut["damage"].as_str().unwrap();
    assert!(damage.starts_with("read up to byte "), "{damage}");
    assert!(outcome.stderr.contains(damage), "{}", outcome.stderr);
    assert_eq!(cut["presets"][0]["scenes"].as_array().unwrap().len(), 1);
}

#[test]
fn what_cannot_be_matched_or_judged_of_recordings_is_refused() {
    let fixture = two_scenes();
    record(&fixture.path("a.mcap"), &BOARD.bytes(&frames()));
    record(&fixture.path("none.mcap"), &BOARD.bytes(&[]));
    let q4 = Sent {
        disparities_q4: Some(vec![0; (CUT_WIDTH * HEIGHT) as usize]),
        ..Sent::default()
    };
    record(&fixture.path("q4.mcap"), &BOARD.bytes(&[q4]));
    let matched = |more: &[&str], words: &[&str]| {
        fixture.refuses(&[&["match"], more].concat(), words);
    };
    let out = ["--out", "o_{}.png"];
    let of = |name, more: &[&'static str]| [&[name], &out[..], more].concat();
    matched(&["a.mcap", "--out", "o.png"], &["--out o.png", "{}"]);
    matched(&of("none.mcap", &[]), &["none.mcap", "no whole frame"]);
    matched(&of("q4.mcap", &[]), &["q4.mcap", "left out: 1"]);
    matched(&of("q4.mcap", &["--bits", "12"]), &["--bits"]);
    matched(
        &of("a.mcap", &["--d-max", "60"]),
        &["a.mcap: frame 000003", "--d-max 60"],
    );
    matched(
        &of("a.mcap", &["--depth", "d_{}.png"]),
        &["--depth", "--calibration"],
    );
    matched(&of("a.mcap", &["--colour", "o_{}.png"]), &["one file"]);
    matched(&of("left.png", &[]), &["left.png is one image"]);
    fs::write(fixture.path("text"), "no recording").unwrap();
    matched(&of("text", &[]), &["text", "no whole frame"]);

    let judged = |more: &[&str], words: &[&str]| {
        fixture.refuses(&[&["eval"], more].concat(), words);
    };
    judged(&["a.mcap"], &["a.mcap", "--truth"]);
    judged(&["set", "--truth", "set/a"], &["set", "recording"]);
    judged(&["a.mcap", "--truth", "set"], &["set/meta.toml"]);
    for recording in ["a.mcap", "q4.mcap"] {
        judged(
            &[recording, "--truth", "set/a"],
            &[recording, "60x40 px", "set/a of 80x40"],
        );
    }
    judged(&["none.mcap", "--truth", "set/a"], &["no whole frame"]);
    judged(
        &["a.mcap", "--truth", "set/a", "--seeds", "1,2"],
        &["--seeds"],
    );
    let truth = GrayImage::from_pixel(CUT_WIDTH, HEIGHT, Luma([8]));
    fs::create_dir(fixture.path("narrow")).unwrap();
    truth.save(fixture.path("narrow/gt_left.png")).unwrap();
    fs::write(
        fixture.path("narrow/meta.toml"),
        "d_max = 12\ngt_scale = 4\n",
    )
    .unwrap();
    let narrow = ["--truth", "narrow", "--preset", "lite"];
    judged(
        &[&["q4.mcap"], &narrow[..]].concat(),
        &["q4.mcap", "--preset"],
    );
}
