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
