//! What holds for several commands: parameters, unknown words and closed pipes.

use std::fs;

use crate::fixture::{Fixture, two_scenes};

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
fn presets_are_listed_with_their_memory() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&["presets", "--width", "450", "--d-max", "59"]);
    assert_eq!(outcome.code, Some(0));
    for word in [
        "paper-raw",
        "paper ",
        "micro ",
        "256",
        "55.2",
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

#[test]
fn the_demo_has_a_name_and_shells_and_man_are_served() {
    let fixture = Fixture::new();
    let small = ["--width", "64", "--height", "48", "--d-max", "8"];
    let named = fixture.run(&[&["demo"][..], &small].concat());
    assert_eq!(named.code, Some(0), "{}", named.stderr);
    assert!(fixture.path("out/error.png").is_file());
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = fixture.run(&["completions", shell]);
        assert_eq!(script.code, Some(0), "{}", script.stderr);
        for word in ["match", "min-disparity", "exposure"] {
            assert!(script.stdout.contains(word), "{shell} completes {word}");
        }
    }
    let page = fixture.run(&["man"]).stdout;
    assert!(page.contains(".TH vgstereo 1"));
    assert!(page.contains("vgstereo match") && page.contains("min\\-disparity"));
}

#[test]
fn names_reach_the_terminal_escaped_and_whole() {
    let fixture = Fixture::new();
    let refused = |left: &str| {
        let outcome = fixture.run(&["match", left, "right.png", "--out", "o.png"]);
        assert_eq!(outcome.code, Some(2));
        assert!(
            !outcome.stderr.trim_end().contains(|c: char| c.is_control()),
            "{left:?}"
        );
        outcome.stderr
    };
    assert!(refused("a  b   c.png").contains("a  b   c.png"));
    assert!(refused("no\u{1b}]0;title\u{7}.png").contains("no\\u001b]0;title\\u0007.png"));
    assert!(refused("right\u{202e}gnp.png").contains("right\\u202egnp.png"));
    if cfg!(unix) {
        let name = "map\u{1b}[2J.pfm";
        let wrote = fixture.run(&["match", "left.png", "right.png", "--out", name]);
        assert_eq!(wrote.code, Some(0), "{}", wrote.stderr);
        assert!(
            wrote.stdout.contains("wrote map\\u001b[2J.pfm"),
            "{}",
            wrote.stdout
        );
        assert!(fixture.path(name).is_file());
        // A name of two lines, one of which looks like the program's own.
        let name = "map\nwrote other\u{200b}.pfm";
        let wrote = fixture.run(&["match", "left.png", "right.png", "--out", name]);
        assert_eq!(wrote.code, Some(0), "{}", wrote.stderr);
        let lines: Vec<&str> = wrote.stdout.lines().collect();
        let named = |line: &&&str| line.starts_with("wrote ");
        assert_eq!(lines.iter().filter(named).count(), 1, "{}", wrote.stdout);
        assert!(
            wrote
                .stdout
                .contains("wrote map\\u000awrote other\\u200b.pfm")
        );
        assert!(refused("no\nerror: \u{feff}.png").contains("no\\u000aerror: \\ufeff.png"));
    }
}

/// Of what has no end, no more is read than tells that it is of no use.
#[cfg(target_os = "linux")]
#[test]
fn what_has_no_end_is_refused_early() {
    use assert_cmd::Command;
    let fixture = Fixture::new();
    for (arguments, word) in [
        (
            &["match", "/dev/zero", "right.png", "--out", "o.png"][..],
            "neither PNG",
        ),
        (
            &[
                "match",
                "left.png",
                "right.png",
                "--out",
                "o.png",
                "--config",
                "/dev/zero",
            ],
            "more than",
        ),
        (&["calibration", "/dev/zero", "--out", "o.vgr"], "more than"),
        (
            &["calibration", "left.png", "--projection", "/dev/zero"],
            "more than",
        ),
    ] {
        // As much memory as the program takes by itself, and little more.
        let limited = "ulimit -v 400000; exec \"$0\" \"$@\"";
        let output = Command::new("sh")
            .current_dir(fixture.folder.path())
            .args(["-c", limited, env!("CARGO_BIN_EXE_vgstereo")])
            .args(arguments)
            .output()
            .unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(
            error.contains("/dev/zero") && error.contains(word),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

/// Parameters are refused by the options that they came from, whatever else is wrong.
#[test]
fn parameters_out_of_range_are_refused_by_their_options() {
    let fixture = Fixture::new();
    fs::write(fixture.path("p.toml"), "synapses = 17\n").unwrap();
    let refuses = |more: &[&str], words: &[&str]| {
        let arguments = ["match", "left.png", "right.png", "--out", "o.png"];
        fixture.refuses(&[&arguments[..], more].concat(), words);
        fixture.refuses(&[&["eval", "nowhere"][..], more].concat(), words);
    };
    refuses(
        &["--config", "p.toml"],
        &["--config p.toml", "multiple of 16"],
    );
    refuses(&["--sigma", "nan"], &["--sigma NaN", "at most 10 px"]);
    refuses(
        &["--preset", "lite", "--set", "method.p1=250"],
        &["--set method.p1=250", "P1"],
    );
    // Out of range alone, and within it together.
    let both = ["--set", "method.p1=90", "--set", "method.p2=100"];
    let arguments = [
        "match",
        "left.png",
        "right.png",
        "--out",
        "o.pfm",
        "--preset",
        "lite",
    ];
    let outcome = fixture.run(&[&arguments[..], &both].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
}

#[test]
fn a_setting_is_one_value_and_its_key_short() {
    let fixture = Fixture::new();
    let refuses = |setting: &str, word: &str| {
        let arguments = [
            "match",
            "left.png",
            "right.png",
            "--out",
            "o.png",
            "--set",
            setting,
        ];
        fixture.refuses(&arguments, &[word]);
    };
    refuses(&("a.".repeat(60_000) + "a=1"), "at most 8 names");
    refuses("method.p1=3\nsynapses=16", "not a TOML value");
}
