//! Files that commands write: none over another or over an input, links followed, nothing left
//! beside them.

use std::fs;

use crate::fixture::{Fixture, two_scenes};

const MATCH: [&str; 7] = [
    "match",
    "left.png",
    "right.png",
    "--preset",
    "lite",
    "--d-max",
    "12",
];

#[test]
fn no_output_replaces_another_or_an_input_however_it_is_spelt() {
    let fixture = Fixture::new();
    fs::create_dir(fixture.path("sub")).unwrap();
    fs::write(fixture.path("old.png"), "old").unwrap();
    fs::hard_link(fixture.path("old.png"), fixture.path("hard.png")).unwrap();
    let absolute = fixture.path("o.png");
    let absolute = absolute.to_str().unwrap();
    for (out, colour) in [
        ("o.png", "./o.png"),
        ("o.png", "sub/../o.png"),
        ("o.png", absolute),
        ("old.png", "hard.png"),
        ("./left.png", "c.png"),
        ("o.png", "sub/../right.png"),
    ] {
        let arguments = [&MATCH[..], &["--out", out, "--colour", colour]].concat();
        fixture.refuses(&arguments, &["--out", "--colour"]);
    }
    let config = [&MATCH[..], &["--config", "p.png", "--out", "./p.png"]].concat();
    fs::write(fixture.path("p.png"), "synapses = 64\n").unwrap();
    fixture.refuses(&config, &["p.png"]);
    assert_eq!(fs::read(fixture.path("old.png")).unwrap(), b"old");
}

#[test]
fn a_calibration_is_not_replaced_by_what_is_made_of_it() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), "left: 1\n").unwrap();
    for outputs in [
        ["--out", "./cal.yml", "--rust", "cal.rs"],
        ["--out", "cal.vgr", "--rust", "./cal.vgr"],
    ] {
        let arguments = [&["calibration", "cal.yml"][..], &outputs].concat();
        fixture.refuses(&arguments, &["--out, --rust", "cal."]);
    }
    assert_eq!(fs::read(fixture.path("cal.yml")).unwrap(), b"left: 1\n");
}

/// What is measured keeps its images, though a link makes a name of an output one of an input.
#[cfg(unix)]
#[test]
fn scenes_are_not_replaced_by_what_is_measured_on_them() {
    use std::os::unix::fs::symlink;
    let fixture = two_scenes();
    fs::create_dir(fixture.path("out")).unwrap();
    symlink("../set/a/left.png", fixture.path("out/a-lite-error.png")).unwrap();
    symlink("set/a/all.png", fixture.path("plot.svg")).unwrap();
    let [left, all] =
        ["set/a/left.png", "set/a/all.png"].map(|name| fs::read(fixture.path(name)).unwrap());
    let eval = ["eval", "set", "a", "--preset", "lite", "--out", "out"];
    fixture.refuses(&eval, &["--out", "a-lite-error.png", "left.png"]);
    let sweep = [
        "sweep",
        "set",
        "a",
        "--synapses",
        "16",
        "--sigma",
        "1",
        "--plot",
        "plot.svg",
    ];
    fixture.refuses(&sweep, &["--plot", "plot.svg", "all.png"]);
    // Parameters are an input as well.
    fs::write(fixture.path("p.toml"), "synapses = 64\n").unwrap();
    fs::remove_file(fixture.path("out/a-lite-error.png")).unwrap();
    symlink("../p.toml", fixture.path("out/a-lite-disparity.png")).unwrap();
    fixture.refuses(
        &[&eval[..], &["--config", "p.toml"]].concat(),
        &["--out", "p.toml"],
    );
    assert_eq!(fs::read(fixture.path("set/a/left.png")).unwrap(), left);
    assert_eq!(fs::read(fixture.path("set/a/all.png")).unwrap(), all);
}

#[test]
fn the_pictures_of_each_seed_have_its_name() {
    let fixture = two_scenes();
    let arguments = ["eval", "set", "a", "--preset", "lite", "--out", "out"];
    let files = |more: &[&str]| {
        let outcome = fixture.run(&[&arguments[..], more].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let entries = fs::read_dir(fixture.path("out")).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        fs::remove_dir_all(fixture.path("out")).unwrap();
        names
    };
    assert_eq!(
        files(&["--seeds", "7,3"]),
        [
            "a-lite-seed-3-disparity.png",
            "a-lite-seed-3-error.png",
            "a-lite-seed-7-disparity.png",
            "a-lite-seed-7-error.png"
        ]
    );
    assert_eq!(
        files(&["--seed", "7"]),
        ["a-lite-disparity.png", "a-lite-error.png"]
    );
}

#[cfg(unix)]
#[test]
fn links_and_devices_stay_what_they_are() {
    use std::os::unix::fs::symlink;
    let fixture = Fixture::new();
    fs::create_dir(fixture.path("sub")).unwrap();
    fs::write(fixture.path("sub/old.png"), "old").unwrap();
    symlink("sub/old.png", fixture.path("link.png")).unwrap();
    symlink("sub/new.png", fixture.path("dangling.png")).unwrap();
    symlink("/dev/null", fixture.path("null.png")).unwrap();
    let before = fixture.files();
    let both = ["--out", "link.png", "--colour", "dangling.png"];
    let outcome = fixture.run(&[&MATCH[..], &both].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    for (link, target) in [("link.png", "sub/old.png"), ("dangling.png", "sub/new.png")] {
        assert!(fixture.path(link).is_symlink());
        assert!(!fixture.path(target).is_symlink());
        image::open(fixture.path(target)).unwrap();
    }
    let nowhere = ["--out", "null.png", "--colour", "null.png"];
    let outcome = fixture.run(&[&MATCH[..], &nowhere].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(fixture.path("null.png").is_symlink());
    assert_eq!(fixture.files(), before);
    let same = ["--out", "o.png", "--colour", "l.png"];
    symlink("o.png", fixture.path("l.png")).unwrap();
    fixture.refuses(&[&MATCH[..], &same].concat(), &["o.png", "l.png"]);
}

#[test]
fn errors_do_not_name_temporary_files() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&[&MATCH[..], &["--out", "no/o.png"]].concat());
    assert_eq!(outcome.code, Some(2));
    assert_eq!(
        outcome.stderr,
        "error: cannot write no/o.png: its folder does not exist\n"
    );
}

#[test]
fn a_scene_counts_once_however_it_is_spelt() {
    let fixture = two_scenes();
    for spelling in ["./a", "a/", "../set/a", "b/../a"] {
        let arguments = ["eval", "set", "a", spelling, "--preset", "lite"];
        fixture.refuses(&arguments, &[spelling, "twice"]);
    }
}

#[test]
fn scenes_with_one_last_name_stay_apart() {
    let fixture = two_scenes();
    for group in ["g1", "g2"] {
        let folder = fixture.path("set").join(group).join("a");
        fs::create_dir_all(&folder).unwrap();
        for entry in fs::read_dir(fixture.path("set/a")).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
        }
    }
    let arguments = [
        "eval", "set", "g1/a", "g2/a", "--preset", "lite", "--out", "pictures",
    ];
    let outcome = fixture.run(&arguments);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    for name in ["g1/a", "g2/a"] {
        assert!(
            outcome.stdout.contains(&format!("| {name} ")),
            "{}",
            outcome.stdout
        );
        for what in ["disparity", "error"] {
            let picture = fixture
                .path("pictures")
                .join(format!("{name}-lite-{what}.png"));
            assert!(picture.is_file(), "{}", picture.display());
        }
    }
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_demo_its_table_and_no_picture() {
    let fixture = Fixture::new();
    let program = assert_cmd::cargo::cargo_bin("vgstereo");
    // Files of at most 8 blocks, where a picture takes more; the signal of that is ignored.
    let script = format!(
        "trap '' XFSZ; ulimit -f 8; exec {} --width 96 --height 72 --d-max 16",
        program.display()
    );
    let output = std::process::Command::new("sh")
        .args(["-c", &script])
        .current_dir(fixture.folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("| quality"), "{said}");
    assert_eq!(fs::read_dir(fixture.path("out")).unwrap().count(), 0);
}

#[cfg(unix)]
#[test]
fn signals_leave_no_temporary_file_and_no_half_pair() {
    use std::time::Duration;
    let fixture = Fixture::new();
    let program = assert_cmd::cargo::cargo_bin("vgstereo");
    let before = fixture.files();
    let mut ended = 0;
    for round in 0..40 {
        let mut child = std::process::Command::new(&program)
            .args(MATCH)
            .args(["--no-check", "--out", "o.png", "--colour", "c.png"])
            .current_dir(fixture.folder.path())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        if round % 2 == 0 {
            std::thread::sleep(Duration::from_micros(400 * round));
        } else {
            // At the write.
            while child.try_wait().unwrap().is_none() && fixture.files() == before {}
        }
        let signal = if round % 4 < 2 { "-INT" } else { "-TERM" };
        let killed = std::process::Command::new("kill")
            .args([signal, &child.id().to_string()])
            .stderr(std::process::Stdio::null())
            .status();
        let status = child.wait().unwrap();
        assert!(killed.is_ok());
        ended += u32::from(status.code().is_none());
        let mut files = fixture.files();
        files.retain(|name| !before.contains(name));
        assert!(
            files.is_empty() || files == ["c.png", "o.png"],
            "round {round}: {files:?}"
        );
        for file in files {
            let bytes = fs::read(fixture.path(&file)).unwrap();
            image::load_from_memory(&bytes).unwrap();
            fs::remove_file(fixture.path(&file)).unwrap();
        }
    }
    assert!(ended > 0, "no signal ended the program");
}
