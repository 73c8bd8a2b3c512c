//! The command line as a user meets it: what it writes, and how it refuses bad input.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use image::{DynamicImage, GrayImage, Luma, Rgb, RgbImage};
use tempfile::TempDir;

/// A folder of its own with a textured pair, shifted by 5 px.
struct Fixture {
    folder: TempDir,
}

const WIDTH: u32 = 80;
const HEIGHT: u32 = 40;
const SHIFT: u32 = 5;

impl Fixture {
    fn new() -> Self {
        let fixture = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        texture(0).save(fixture.path("left.png")).unwrap();
        texture(SHIFT).save(fixture.path("right.png")).unwrap();
        fixture
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs `vgstereo` in the folder.
    fn run(&self, arguments: &[&str]) -> Outcome {
        let output = Command::cargo_bin("vgstereo")
            .unwrap()
            .current_dir(self.folder.path())
            .args(arguments)
            .output()
            .unwrap();
        Outcome {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// The names of the files in the folder.
    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// A refusal: code 2, one line on standard error with these words, nothing written.
    #[track_caller]
    fn refuses(&self, arguments: &[&str], words: &[&str]) {
        let before = self.files();
        let outcome = self.run(arguments);
        assert_eq!(outcome.code, Some(2), "{arguments:?}: {}", outcome.stderr);
        assert_eq!(outcome.stdout, "", "{arguments:?}");
        assert_eq!(outcome.stderr.lines().count(), 1, "{}", outcome.stderr);
        for word in words {
            assert!(
                outcome.stderr.contains(word),
                "{word:?} in {}",
                outcome.stderr
            );
        }
        assert_eq!(self.files(), before, "{arguments:?} wrote something");
    }
}

struct Outcome {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

/// A texture without repetition, its columns moved to the left by `shift`.
fn texture(shift: u32) -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let mixed = ((x + shift) * 2_654_435 + y * 40_503).wrapping_mul(2_246_822_519) >> 15;
        Rgb([mixed as u8, (mixed >> 3) as u8, (mixed >> 5) as u8])
    })
}

/// The fraction of inner pixels that have this value.
fn fraction(image: &DynamicImage, value: u16) -> f64 {
    let image = image.to_luma16();
    let bits = |pixel: &Luma<u16>| pixel.0[0];
    let inner = (8..HEIGHT - 8).flat_map(|y| (20..WIDTH - 20).map(move |x| (x, y)));
    let found: Vec<u16> = inner.map(|(x, y)| bits(image.get_pixel(x, y))).collect();
    found.iter().filter(|&&v| v == value).count() as f64 / found.len() as f64
}

/// The main job: no command at all, here at a small size.
#[test]
fn the_demo_writes_its_pictures_and_says_so() {
    let fixture = Fixture::new();
    let size = ["--width", "96", "--height", "64", "--d-max", "12"];
    for wire in ["separate", "pixel-multiplexed"] {
        let outcome = fixture.run(&[&size[..], &["--layout", wire, "--out", wire]].concat());
        assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
        for word in [
            "paper-raw",
            "paper ",
            "micro ",
            "KiB",
            "latency lines",
            "ms",
        ] {
            assert!(
                outcome.stdout.contains(word),
                "{word:?} in {}",
                outcome.stdout
            );
        }
        for name in ["left", "right", "truth", "disparity", "error"] {
            let path = format!("{wire}/{name}.png");
            assert!(outcome.stdout.contains(&path), "{}", outcome.stdout);
            let picture = image::open(fixture.path(&path)).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 64));
        }
    }
    // The wire changes nothing that is seen.
    let disparities = |wire| fs::read(fixture.path(wire).join("disparity.png")).unwrap();
    assert_eq!(disparities("separate"), disparities("pixel-multiplexed"));
    fixture.refuses(&["--out", "left.png"], &["left.png"]);
    fixture.refuses(&["--d-max", "241"], &["--d-max", "240"]);
    fixture.refuses(&["--width", "15"], &["--width", "16"]);
    fixture.refuses(&["--texture", "1.5"], &["--texture"]);
    for option in [
        "--texture",
        "--noise",
        "--gain",
        "--gain-gradient",
        "--offset",
        "--offset-gradient",
    ] {
        fixture.refuses(&[option, "nan"], &[option]);
    }
    // Black in the first line.
    fixture.refuses(&["--gain", "1", "--gain-gradient", "2"], &["--gain"]);
}

/// What is written is the scene that is matched, down to its masks.
#[test]
fn the_scene_of_the_demo_is_one_for_eval() {
    let fixture = Fixture::new();
    let size = ["--width", "96", "--height", "64", "--d-max", "12"];
    let arguments = [&size[..], &["--texture", "0.3", "--scene", "yard/bare"]].concat();
    let demo = fixture.run(&arguments);
    assert_eq!((demo.code, demo.stderr.as_str()), (Some(0), ""));
    let eval = fixture.run(&["eval", "yard", "bare", "--preset", "micro"]);
    assert_eq!(eval.code, Some(0), "{}", eval.stderr);
    // The three masks and their average, percent.
    let row = |text: &str| -> Vec<f64> {
        let line = text.lines().find(|line| line.contains("micro")).unwrap();
        let cells = line.split('|').filter_map(|cell| cell.trim().parse().ok());
        cells.take(4).collect()
    };
    let (demo, eval) = (row(&demo.stdout), row(&eval.stdout));
    assert_eq!((demo.len(), eval.len()), (4, 4));
    for (demo, eval) in demo.iter().zip(&eval) {
        // The truth is rounded: a pixel in a thousand may be beyond the threshold by that.
        assert!((demo - eval).abs() < 0.1, "{demo} {eval}");
    }
    fs::write(fixture.path("file"), "").unwrap();
    fixture.refuses(&["--scene", "file"], &["file"]);
}

#[test]
fn match_writes_every_format_and_the_colours() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&[
        "match",
        "left.png",
        "right.png",
        "--out",
        "a.png",
        "--d-max",
        "20",
        "--scale",
        "256",
        "--color",
        "colour.png",
    ]);
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""));
    assert!(outcome.stdout.contains("wrote a.png") && outcome.stdout.contains("wrote colour.png"));
    let map = image::open(fixture.path("a.png")).unwrap();
    assert!(matches!(map, DynamicImage::ImageLuma16(_)));
    assert!(fraction(&map, SHIFT as u16 * 256) > 0.99);
    let colour = image::open(fixture.path("colour.png")).unwrap();
    assert_eq!((colour.width(), colour.height()), (WIDTH, HEIGHT));

    for name in ["b.pgm", "b.png"] {
        let outcome = fixture.run(&[
            "match",
            "left.png",
            "right.png",
            "--out",
            name,
            "--d-max",
            "20",
            "--scale",
            "4",
            "--reference",
            "right",
            "--preset",
            "paper-raw",
        ]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let map = image::open(fixture.path(name)).unwrap();
        assert!(matches!(map, DynamicImage::ImageLuma8(_)));
        // Widening 8 bits to 16 repeats the byte.
        assert!(fraction(&map, SHIFT as u16 * 4 * 257) > 0.99, "{name}");
    }
    let pfm = [
        "match",
        "right.png",
        "left.png",
        "--out",
        "c.pfm",
        "--d-max",
        "3",
        "--min-disparity",
        "-9",
    ];
    assert_eq!(fixture.run(&pfm).code, Some(0));
    let bytes = fs::read(fixture.path("c.pfm")).unwrap();
    let header = format!("Pf\n{WIDTH} {HEIGHT}\n-1.0\n");
    assert_eq!(bytes.len(), header.len() + (WIDTH * HEIGHT * 4) as usize);
    let middle = header.len() + 4 * (HEIGHT / 2 * WIDTH + WIDTH / 2) as usize;
    let px = f32::from_le_bytes(bytes[middle..middle + 4].try_into().unwrap());
    assert_eq!(px, -(SHIFT as f32), "the views exchanged, the sign turns");
}

#[test]
fn match_reads_every_format_and_gives_the_same_map() {
    let fixture = Fixture::new();
    let grey: GrayImage = DynamicImage::from(texture(0)).into_luma8();
    for (name, image) in [
        ("left.ppm", DynamicImage::from(texture(0))),
        ("left.pgm", DynamicImage::from(grey.clone())),
        ("left.jpg", DynamicImage::from(texture(0))),
        ("grey.png", DynamicImage::from(grey)),
    ] {
        image.save(fixture.path(name)).unwrap();
        let outcome = fixture.run(&[
            "match",
            name,
            "right.png",
            "--out",
            "a.png",
            "--d-max",
            "20",
            "--preset",
            "paper-raw",
        ]);
        assert_eq!(outcome.code, Some(0), "{name}: {}", outcome.stderr);
        let map = image::open(fixture.path("a.png")).unwrap();
        // The largest whole scale that keeps 20 px in 8 bits is 12.
        assert!(fraction(&map, SHIFT as u16 * 12 * 257) > 0.9, "{name}");
    }
}

#[test]
fn match_obeys_its_parameters_and_seeds() {
    let fixture = Fixture::new();
    let map = |name: &str, more: &[&str]| {
        let mut arguments = vec![
            "match",
            "left.png",
            "right.png",
            "--preset",
            "paper-raw",
            "--d-max",
            "30",
            "--out",
            name,
        ];
        arguments.extend(more);
        assert_eq!(fixture.run(&arguments).code, Some(0));
        fs::read(fixture.path(name)).unwrap()
    };
    let narrow = ["--synapses", "16", "--sigma", "1", "--seed"];
    let first = map("a.png", &[narrow.as_slice(), &["3"]].concat());
    assert_eq!(
        first,
        map(
            "b.png",
            &[narrow.as_slice(), &["3", "--threads", "3"]].concat()
        )
    );
    assert_ne!(first, map("c.png", &[narrow.as_slice(), &["4"]].concat()));
    assert_ne!(first, map("d.png", &["--seed", "3"]));
}

/// The paper's method looks at grey anyway; what aggregates looks at colour unless asked.
#[test]
fn grey_is_matched_when_asked_for() {
    let fixture = Fixture::new();
    // Grey of the same weights as ours.
    let luma = |shift| {
        let colour = texture(shift);
        DynamicImage::from(GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            let [red, green, blue] = colour.get_pixel(x, y).0.map(u32::from);
            Luma([((77 * red + 150 * green + 29 * blue + 128) >> 8) as u8])
        }))
    };
    luma(0).save(fixture.path("grey-left.png")).unwrap();
    luma(SHIFT).save(fixture.path("grey-right.png")).unwrap();
    let map = |preset: &str, left: &str, right: &str, more: &[&str]| {
        let mut arguments = vec!["match", left, right, "--out", "map.png", "--d-max", "20"];
        arguments.extend(["--scale", "12", "--preset", preset]);
        arguments.extend(more);
        let outcome = fixture.run(&arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        (fs::read(fixture.path("map.png")).unwrap(), outcome.stdout)
    };
    for preset in ["paper", "micro"] {
        let (grey, said) = map(preset, "left.png", "right.png", &["--grey"]);
        let (own, own_said) = map(preset, "grey-left.png", "grey-right.png", &[]);
        assert_eq!(grey, own, "{preset}");
        let (_, colour_said) = map(preset, "left.png", "right.png", &[]);
        let picture = image::open(fixture.path("map.png")).unwrap();
        // A sixteenth or two beside the shift rounds to a step or two of 12.
        let near = (SHIFT * 12 - 2..=SHIFT * 12 + 2).map(|v| fraction(&picture, v as u16 * 257));
        assert!(near.sum::<f64>() > 0.99, "{preset}");
        // Colour takes more memory.
        let kib = |said: &str| -> f64 {
            let words: Vec<&str> = said.split_whitespace().collect();
            let unit = words.iter().position(|&word| word == "KiB").unwrap();
            words[unit - 1].parse().unwrap()
        };
        assert!(kib(&said) < kib(&colour_said) && kib(&said) == kib(&own_said));
    }
}

#[test]
fn match_refuses_bad_input() {
    let fixture = Fixture::new();
    texture(0).save(fixture.path("whole.png")).unwrap();
    RgbImage::new(WIDTH, HEIGHT + 1)
        .save(fixture.path("taller.png"))
        .unwrap();
    fs::write(fixture.path("text.png"), "no image").unwrap();
    fs::write(fixture.path("empty.png"), "").unwrap();
    fs::write(fixture.path("zero.pgm"), "P5\n0 0\n255\n").unwrap();
    let png = fs::read(fixture.path("left.png")).unwrap();
    fs::write(fixture.path("cut.png"), &png[..png.len() / 2]).unwrap();
    let run = |left, right, more: &[&'static str], words: &[&str]| {
        let mut arguments = vec!["match", left, right];
        if !more.contains(&"--out") {
            arguments.extend(["--out", "out.png"]);
        }
        arguments.extend(more);
        fixture.refuses(&arguments, words);
    };
    run("none.png", "right.png", &[], &["none.png", "No such file"]);
    run("left.png", "none.png", &[], &["none.png", "No such file"]);
    run("text.png", "right.png", &[], &["text.png"]);
    run("empty.png", "right.png", &[], &["empty.png"]);
    run("zero.pgm", "zero.pgm", &[], &["zero.pgm"]);
    run("cut.png", "right.png", &[], &["cut.png"]);
    run(
        "left.png",
        "taller.png",
        &[],
        &["taller.png", "80x40", "80x41"],
    );
    run(
        "left.png",
        "right.png",
        &["--d-max", "80"],
        &["80", "width"],
    );
    run(
        "left.png",
        "right.png",
        &["--d-max", "3000"],
        &["3000", "width"],
    );
    run(
        "left.png",
        "right.png",
        &["--d-max", "4", "--min-disparity", "5"],
        &["5", "4"],
    );
    run(
        "left.png",
        "right.png",
        &["--min-disparity", "-80", "--out", "out.pfm"],
        &["-80", "80"],
    );
    run(
        "left.png",
        "right.png",
        &["--min-disparity", "-1"],
        &[".pfm", "negative"],
    );
    run(
        "left.png",
        "right.png",
        &["--out", "out.bmp"],
        &["out.bmp", ".png"],
    );
    run(
        "left.png",
        "right.png",
        &["--out", "no/folder/out.png"],
        &["no/folder/out.png"],
    );
    run(
        "left.png",
        "right.png",
        &["--synapses", "20"],
        &["synapses", "16"],
    );
    run(
        "left.png",
        "right.png",
        &["--sigma", "11"],
        &["sigma", "10"],
    );
    run("left.png", "right.png", &["--sigma", "NaN"], &["sigma"]);
    run("left.png", "right.png", &["--scale", "0"], &["--scale 0"]);
    run(
        "left.png",
        "right.png",
        &["--color", "no/folder/c.png"],
        &["no/folder/c.png"],
    );
    run(
        "left.png",
        "right.png",
        &["--color", "colour.jpg"],
        &["colour.jpg", ".png"],
    );
    run(
        "left.png",
        "right.png",
        &["--color", "out.png"],
        &["--out", "--color", "out.png"],
    );
}

/// What clap itself refuses also ends with code 2.
#[test]
fn unknown_words_are_refused() {
    let fixture = Fixture::new();
    for arguments in [
        &["mach"][..],
        &["match", "left.png"],
        &[
            "match",
            "left.png",
            "right.png",
            "--out",
            "a.png",
            "--preset",
            "best",
        ],
        &[
            "match",
            "left.png",
            "right.png",
            "--out",
            "a.png",
            "--d-max",
            "many",
        ],
        &["eval", ".", "--preset", "paper,,"],
        // Larger than the option's type, but a width as well.
        &[
            "match",
            "left.png",
            "right.png",
            "--out",
            "a.png",
            "--d-max",
            "40000",
        ],
    ] {
        fixture.refuses(arguments, &["error: "]);
    }
    let unknown = fixture.run(&["sweep", ".", "--preset", "best"]);
    assert!(unknown.stderr.contains("paper-raw"), "{}", unknown.stderr);
}

/// Makes a scene folder; `gt` in the file's own steps.
fn write_scene(folder: &Path, gt: &DynamicImage, meta: &str, masks: &[&str]) {
    fs::create_dir_all(folder).unwrap();
    texture(0).save(folder.join("left.png")).unwrap();
    texture(SHIFT).save(folder.join("right.png")).unwrap();
    gt.save(folder.join("gt_left.png")).unwrap();
    fs::write(folder.join("meta.toml"), meta).unwrap();
    for mask in masks {
        let inner = |x, y| (20..WIDTH - 20).contains(&x) && (8..HEIGHT - 8).contains(&y);
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Luma([if inner(x, y) { 255 } else { 128 }])
        })
        .save(folder.join(mask))
        .unwrap();
    }
}

fn two_scenes() -> Fixture {
    let fixture = Fixture::new();
    let byte = GrayImage::from_pixel(WIDTH, HEIGHT, Luma([4 * SHIFT as u8]));
    write_scene(
        &fixture.path("set/a"),
        &byte.into(),
        "d_max = 12\ngt_scale = 4\n",
        &["nonocc.png", "all.png", "disc.png"],
    );
    let wide = image::ImageBuffer::from_pixel(WIDTH, HEIGHT, Luma([256 * (SHIFT as u16 + 2)]));
    write_scene(
        &fixture.path("set/b"),
        &DynamicImage::ImageLuma16(wide),
        "d_max = 12\ngt_scale = 256\n",
        &["nonocc.png"],
    );
    // Not a scene: it has folders, not images.
    fs::create_dir_all(fixture.path("set/group/deep")).unwrap();
    fixture
}

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
    let mut expected = vec![
        "scene",
        "width",
        "height",
        "d_max",
        "nonocc",
        "all",
        "disc",
        "average",
        "invalid",
        "seconds",
        "working_bytes",
        "latency_lines",
    ];
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
        assert!(bytes(&grey) < bytes(&colour), "{preset}");
        if preset == "paper" {
            for key in ["nonocc", "all", "disc", "average", "invalid"] {
                assert_eq!(scene(&grey, key), scene(&colour, key), "{key}");
            }
        }
    }
}

#[test]
fn eval_and_sweep_refuse_bad_folders() {
    let fixture = two_scenes();
    fixture.refuses(&["eval", "nowhere"], &["nowhere", "No such file"]);
    fixture.refuses(&["eval", "set/group"], &["set/group", "no scenes"]);
    fixture.refuses(&["eval", "set", "c"], &["set/c", "left.png"]);
    fixture.refuses(&["eval", "set", "--threshold", "0"], &["--threshold"]);
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
            b"d_max = 80\ngt_scale = 4\n",
            &["a", "disparities"],
        ),
        ("gt_left.png", b"", &["set/a/gt_left.png"]),
        (
            "all.png",
            b"P5 1 1 255\n0",
            &["set/a/all.png", "1x1", "80x40"],
        ),
    ] {
        let path = fixture.path("set/a").join(file);
        let kept = fs::read(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        fixture.refuses(&["eval", "set", "a"], words);
        fs::write(&path, kept).unwrap();
    }
    assert_eq!(fixture.run(&["eval", "set", "a"]).code, Some(0));
}

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
fn parameters_come_from_a_file_and_from_the_command_line() {
    let fixture = two_scenes();
    let toml = fixture.run(&["presets", "--toml", "lite"]);
    assert_eq!(toml.code, Some(0), "{}", toml.stderr);
    fs::write(fixture.path("lite.toml"), toml.stdout).unwrap();
    let map = |name: &str, more: &[&str]| {
        let mut arguments = vec![
            "match",
            "left.png",
            "right.png",
            "--d-max",
            "20",
            "--out",
            name,
        ];
        arguments.extend(more);
        let outcome = fixture.run(&arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        fs::read(fixture.path(name)).unwrap()
    };
    let lite = map("a.png", &["--preset", "lite"]);
    assert_eq!(
        lite,
        map("b.png", &["--preset", "quality", "--config", "lite.toml"])
    );
    let changed = [
        "--preset",
        "lite",
        "--set",
        "method.p1=1",
        "--set",
        "method.p2=20",
    ];
    assert_ne!(lite, map("c.png", &changed));
    fs::write(fixture.path("bad.toml"), "[method]\np1 = 300\n").unwrap();
    fs::write(fixture.path("cut.toml"), "[method\n").unwrap();
    fs::write(fixture.path("typo.toml"), "synapsis = 64\n").unwrap();
    for (more, words) in [
        (
            &["--config", "none.toml"][..],
            &["none.toml", "No such file"][..],
        ),
        (&["--config", "bad.toml"], &["bad.toml", "300"]),
        (&["--config", "cut.toml"], &["cut.toml"]),
        (&["--config", "typo.toml"], &["typo.toml", "synapsis"]),
        (&["--set", "method.p3=1"], &["method.p3=1", "p3"]),
        (&["--set", "p1"], &["KEY=VALUE"]),
        (&["--set", "method.p2=250"], &["255"]),
    ] {
        let mut arguments = vec!["eval", "set", "--preset", "lite"];
        arguments.extend(more);
        fixture.refuses(&arguments, words);
    }
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
        }
    }
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
fn presets_are_listed_with_their_memory() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&["presets", "--width", "450", "--d-max", "59"]);
    assert_eq!(outcome.code, Some(0));
    for word in [
        "paper-raw",
        "paper ",
        "micro ",
        "256",
        "55.1",
        "KiB in colour",
        "any height",
    ] {
        assert!(
            outcome.stdout.contains(word),
            "{word:?} in {}",
            outcome.stdout
        );
    }
    fixture.refuses(&["presets", "--width", "59", "--d-max", "59"], &["59"]);
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let fixture = Fixture::new();
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("vgstereo"))
        .current_dir(fixture.folder.path())
        .arg("presets")
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
    assert!(output.status.success());
}
