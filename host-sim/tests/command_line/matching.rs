//! `vgstereo match`: the formats it reads and writes, its options, and what it refuses.

use std::fs;

use assert_cmd::Command;
use image::{DynamicImage, GrayImage, Luma, RgbImage};
use vgstereo_sim::render::{RenderOptions, render};

use crate::fixture::{Fixture, HEIGHT, SHIFT, WIDTH, texture};

/// The fraction of inner pixels that have this value.
fn fraction(image: &DynamicImage, value: u16) -> f64 {
    let image = image.to_luma16();
    let bits = |pixel: &Luma<u16>| pixel.0[0];
    let inner = (8..HEIGHT - 8).flat_map(|y| (20..WIDTH - 20).map(move |x| (x, y)));
    let found: Vec<u16> = inner.map(|(x, y)| bits(image.get_pixel(x, y))).collect();
    // The sub-pixel step of a whole disparity may be off by 1/16 px.
    let near = |v: u16| v.abs_diff(value) <= value / (16 * SHIFT as u16) + 1;
    found.iter().filter(|&&v| near(v)).count() as f64 / found.len() as f64
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
        "--colour",
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
        assert!(fraction(&map, SHIFT as u16 * 256) > 0.9, "{name}");
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
        // Colour that is used takes more memory.
        let kib = |said: &str| -> f64 {
            let words: Vec<&str> = said.split_whitespace().collect();
            let unit = words.iter().position(|&word| word == "KiB").unwrap();
            words[unit - 1].parse().unwrap()
        };
        assert_eq!(kib(&said), kib(&own_said), "{preset}");
        assert_eq!(
            kib(&said) < kib(&colour_said),
            preset == "micro",
            "{preset}"
        );
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
        &["--colour", "no/folder/c.png"],
        &["no/folder/c.png"],
    );
    run(
        "left.png",
        "right.png",
        &["--colour", "colour.jpg"],
        &["colour.jpg", ".png"],
    );
    run(
        "left.png",
        "right.png",
        &["--colour", "out.png"],
        &["--out", "--colour", "out.png"],
    );
}

#[test]
fn match_says_how_much_it_found_and_what_may_be_wrong() {
    let fixture = Fixture::new();
    let scene = render(&RenderOptions {
        width: 160,
        height: 120,
        d_max: 24,
        ..RenderOptions::default()
    });
    scene.left.save(fixture.path("left.png")).unwrap();
    scene.right.save(fixture.path("right.png")).unwrap();
    let run = |left: &str, right: &str, more: &[&str]| {
        let pair = ["match", left, right, "--out", "d.pfm", "--d-max", "24"];
        let outcome = fixture.run(&[&pair, more].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        outcome.stdout
    };
    let good = run("left.png", "right.png", &[]);
    assert!(
        good.contains(" % of the pixels") && !good.contains("hint:"),
        "{good}"
    );
    let exchanged = run("right.png", "left.png", &[]);
    assert!(
        exchanged.contains("hint: the pair matches far better"),
        "{exchanged}"
    );
    let unchecked = run("right.png", "left.png", &["--no-check"]);
    assert!(!unchecked.contains("hint:"), "{unchecked}");
    let twice = run("left.png", "left.png", &[]);
    assert!(
        twice.contains("hint: both views are the same image"),
        "{twice}"
    );
}

#[test]
fn match_names_the_parameters_that_it_used() {
    let fixture = Fixture::new();
    let toml = fixture.run(&["presets", "--toml", "micro"]).stdout;
    fs::write(fixture.path("mine.toml"), &toml).unwrap();
    let name = |more: &[&str]| {
        let pair = [
            "match",
            "left.png",
            "right.png",
            "--out",
            "d.pfm",
            "--d-max",
            "12",
        ];
        let outcome = fixture.run(&[&pair, more].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        outcome.stdout.split(": ").next().unwrap().to_owned()
    };
    assert_eq!(name(&[]), "balanced");
    assert_eq!(name(&["--config", "mine.toml"]), "micro");
    assert_eq!(name(&["--preset", "lite", "--seed", "3"]), "lite");
    assert_eq!(name(&["--preset", "lite", "--sigma", "3"]), "lite, changed");
}

#[test]
fn a_map_states_its_scale_and_goes_to_standard_output() {
    let fixture = Fixture::new();
    let run = |out: &str| {
        let mut command = Command::cargo_bin("vgstereo").unwrap();
        command.current_dir(fixture.folder.path());
        command.args([
            "match",
            "left.png",
            "right.png",
            "--d-max",
            "12",
            "--out",
            out,
        ]);
        let output = command.output().unwrap();
        assert!(output.status.success());
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (text(&output.stderr), output.stdout)
    };
    let (_, told) = run("d.png");
    let told = String::from_utf8(told).unwrap();
    assert!(
        told.contains("wrote d.png: px = value / 256, 0 = none"),
        "{told}"
    );
    let map = image::open(fixture.path("d.png")).unwrap();
    assert!(fraction(&map, SHIFT as u16 * 256) > 0.99);
    // The same map as in a file, and what there is to say besides it.
    run("d.pfm");
    let before = fixture.files();
    let (told, piped) = run("-");
    assert_eq!(piped, fs::read(fixture.path("d.pfm")).unwrap());
    assert!(told.contains("balanced: 80x40 px"), "{told}");
    assert_eq!(fixture.files(), before);
}
