//! The verbs from outside: one line of error and code 2 for whatever is wrong.

use assert_cmd::Command;

fn firmware(arguments: &[&str]) -> Command {
    let mut command = Command::cargo_bin("vgstereo-boards").unwrap();
    command.args(arguments);
    command
}

/// What standard error says, which must be one line, with code 2 and nothing printed.
fn refusal(arguments: &[&str]) -> String {
    let output = firmware(arguments).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty(), "{arguments:?}");
    let error = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<_> = error.lines().collect();
    let [line] = lines[..] else {
        panic!("{arguments:?}: {error}");
    };
    line.to_owned()
}

#[test]
fn help_names_every_verb_and_option() {
    let output = firmware(&["--help"])
        .assert()
        .success()
        .get_output()
        .clone();
    let help = String::from_utf8(output.stdout).unwrap();
    for verb in [
        "setup", "build", "lint", "run", "live", "verify", "bench", "size", "image",
    ] {
        assert!(help.contains(&format!("  {verb}  ")), "{verb}: {help}");
    }
    let output = firmware(&["run", "--help"])
        .assert()
        .success()
        .get_output()
        .clone();
    let help = String::from_utf8(output.stdout).unwrap();
    for kind in vgstereo_firmware::scripted::FaultKind::ALL {
        assert!(help.contains(kind.name()), "{}: {help}", kind.name());
    }
}

#[test]
fn what_is_wrong_is_said_on_one_line() {
    let run = |arguments: &[&str]| {
        let always = ["run", "--board", "stm32f405", "--out", "never.png"];
        refusal(&[&always, arguments].concat())
    };
    let modelled = |arguments: &[&str]| {
        let always = ["run", "--board", "stm32h743", "--out", "never.png"];
        refusal(&[&always, arguments].concat())
    };
    let simulated = |arguments: &[&str]| {
        let always = ["run", "--board", "softcore", "--out", "never.png"];
        refusal(&[&always, arguments].concat())
    };
    for (error, words) in [
        (
            refusal(&["build", "--board", "nothing"]),
            "stm32f405, mps2-an500",
        ),
        (refusal(&["flash"]), "flash"),
        (
            refusal(&["image", "--board", "stm32f405", "--out", "never"]),
            "not those of an FPGA",
        ),
        (refusal(&["verify", "--left", "left.png"]), "--right"),
        (
            refusal(&["verify", "--calibration", "never.yaml"]),
            "never.yaml",
        ),
        (
            refusal(&["bench", "--calibration", "never.yaml"]),
            "never.yaml",
        ),
        (refusal(&["bench", "--binned", "2"]), "--calibration"),
        (
            refusal(&[
                "run",
                "--board",
                "stm32f405",
                "--out",
                "never.png",
                "--scene",
                "teddy",
                "--calibration",
                "never.yaml",
            ]),
            "--scene",
        ),
        (
            refusal(&["bench", "--board", "stm32h743"]),
            "stm32h743 is a real board and not emulated",
        ),
        (
            refusal(&["run", "--board", "stm32f407", "--out", "never.png"]),
            "build, lint and size take it",
        ),
        (
            refusal(&["verify", "--board", "stm32f407"]),
            "build, lint and size take it",
        ),
        (modelled(&["--preset", "micro"]), "is built for lite"),
        (modelled(&["--d-max", "31"]), "320x240 px in grey and 48"),
        (
            modelled(&["--fault", "0:3:bus-error"]),
            "overrun, short-line",
        ),
        (
            modelled(&["--fault", "0:3:overrun", "--fault", "0:4:overrun"]),
            "one in a frame",
        ),
        (simulated(&["--preset", "micro"]), "without its stereo unit"),
        (simulated(&["--cpu", "z80"]), "vexriscv and cv32e40p"),
        (
            simulated(&["--fault", "0:3:bus-error"]),
            "dropped-line, lost-sync",
        ),
        (
            refusal(&["live", "--board", "softcore", "--preset", "micro"]),
            "without its stereo unit",
        ),
        (refusal(&["run", "--board", "stm32f405"]), "--out"),
        (run(&["--preset", "best"]), "lite, micro"),
        (run(&["--fault", "1:2"]), "FRAME:LINE:KIND"),
        (run(&["--left", "left.png"]), "--right"),
        (
            run(&["--left", "absent.png", "--right", "absent.png"]),
            "absent.png",
        ),
        (run(&["--scene", "absent"]), "absent"),
        (run(&["--frames", "0"]), "--frames"),
        (run(&["--d-max", "160"]), "disparities"),
        (
            refusal(&["run", "--board", "stm32f405", "--out", "never.txt"]),
            ".png",
        ),
        (refusal(&["verify", "--lines", "0"]), "--lines"),
        (refusal(&["live"]), "--board"),
        (
            refusal(&["live", "--board", "stm32f407"]),
            "stm32f407 is a real board and not emulated",
        ),
        (
            refusal(&["live", "--board", "stm32h743", "--preset", "micro"]),
            "is built for lite",
        ),
        (
            refusal(&["live", "--board", "stm32h743", "--fault", "0:3:overrun"]),
            "has no faults here",
        ),
        (
            refusal(&["live", "--board", "stm32h743", "--d-max", "31"]),
            "320x240 px in grey and 48",
        ),
        (
            refusal(&["live", "--board", "stm32f405", "--listen", "here"]),
            "--listen",
        ),
    ] {
        assert!(
            error.starts_with("error: ") && error.contains(words),
            "{error}"
        );
    }
    assert!(!std::path::Path::new("never.png").exists());
}
