//! Builds the firmware of the boards, and lints it.

use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use vgstereo_sim::files::write_files;

use crate::board::{Board, Simulation};
use crate::toolchain::{Toolchain, lock, root};

/// Builds a board's firmware as it is released and returns the path of the linked file.
///
/// # Errors
/// Fails when there is no compiler for the board or the firmware does not compile.
pub fn build(board: &Board) -> Result<PathBuf> {
    let program = board.program();
    let (profile, options) = profile_and_options(board);
    // The next build for another preset replaces the file: none begins before it is kept.
    let _lock = lock(&target_folder(board))?;
    let linked = build_program(board, board.folder, program, profile, &options)?;
    let simulated = board.simulation.map(|simulation| simulation.preset);
    let Some(preset) = board.alone.or(simulated) else {
        return Ok(linked);
    };
    keep(&linked, &format!("{program}-{preset}"))
}

/// Returns the profile in the boards' workspace that a board's firmware is built in, and the options of cargo that name the
/// preset that it is built for alone.
fn profile_and_options(board: &Board) -> (&'static str, Vec<&'static str>) {
    match board.alone {
        Some(preset) => (
            "small",
            vec!["--no-default-features", "--features", preset.name()],
        ),
        None => ("release", vec![]),
    }
}

/// Copies a linked file to one of this name beside it, and returns its path. Whoever reads an earlier copy at the same time
/// reads all of that.
///
/// # Errors
/// Fails with one line when a file cannot be read or written.
fn keep(linked: &Path, name: &str) -> Result<PathBuf> {
    let kept = linked.with_file_name(name);
    let bytes = std::fs::read(linked);
    let bytes = bytes.with_context(|| format!("cannot read {}", linked.display()))?;
    write_files(&[(kept.clone(), bytes)])?;
    Ok(kept)
}

/// Builds the program that compares a board's kernels with the reference, with debug assertions in the kernels,
/// and returns the path of the linked file.
///
/// # Errors
/// Fails when the board has none, when there is no compiler for it, or when it does not compile.
pub fn build_suite(board: &Board) -> Result<PathBuf> {
    let suite = board.kernel_suite;
    let suite = suite.with_context(|| format!("{} has no suite of kernels", board.name))?;
    let assertions = "profile.release.package.vgstereo-kernels.debug-assertions=true";
    build_program(board, suite, suite, "release", &["--config", assertions])
}

/// Builds a program of the package of this name, whose folder below `firmware/boards` has it too, in a profile of their
/// workspace.
fn build_program(
    board: &Board,
    package: &str,
    program: &str,
    profile: &str,
    options: &[&str],
) -> Result<PathBuf> {
    let mut command = Command::new(cargo());
    command.args(["build", "--bin", program]);
    if !std::io::stderr().is_terminal() {
        eprintln!("compiling the firmware of {program}");
    }
    configure(&mut command, board, &toolchain(board)?, profile);
    command
        .args(simulation_options(board))
        .args(options)
        .current_dir(package_folder(package));
    let status = command.status().context("cannot run cargo")?;
    ensure!(status.success(), "the firmware of {program} does not build");
    let folder = target_folder(board).join(board.target).join(profile);
    Ok(folder.join(program))
}

/// The options of cargo that name the processor and the preset of a board in RTL.
fn simulation_options(board: &Board) -> impl Iterator<Item = &'static str> {
    let options = board.simulation.map(|simulation| {
        let Simulation {
            processor, preset, ..
        } = simulation;
        let processor = ["--no-default-features", "--features", processor.name()];
        processor.into_iter().chain(["--features", preset.name()])
    });
    options.into_iter().flatten()
}

/// The release profile of the boards' workspace, for a build in the workspace of the host: the standard library is
/// then the one that the boards are built with, and not compiled again.
const COMMON_PROFILE: [&str; 6] = [
    "--config",
    "profile.release.codegen-units=1",
    "--config",
    "profile.release.lto=true",
    "--config",
    "profile.release.package.\"*\".debug=\"line-tables-only\"",
];

/// Compiler flags for a crate that is only linted. They come after those of the profile and override them: its code is
/// neither optimised nor linked.
const LINT_ONLY: [&str; 4] = [
    "-Copt-level=0",
    "-Cdebug-assertions=off",
    "-Clto=off",
    "-Clinker=true",
];

/// Lints the crate of a board and what it shares with other boards, and those shared crates whose code
/// depends on the processor.
///
/// # Errors
/// Fails when there is no clippy for the board's compiler, or when clippy finds something.
pub fn lint(board: &Board) -> Result<()> {
    let toolchain = toolchain(board)?;
    let linter = toolchain.linter()?.with_context(|| {
        format!(
            "there is no clippy for {}: cargo firmware setup tells how to install it",
            board.target
        )
    })?;
    let mut commands = Vec::new();
    let own = (board.folder, board.program());
    let without_unit = board.with_unit(0).program();
    let other = (without_unit != own.1).then_some((board.folder, without_unit));
    let suite = board.kernel_suite.map(|suite| (suite, suite));
    let (profile, options) = profile_and_options(board);
    for (package, program) in [Some(own), other, suite].into_iter().flatten() {
        // In a build, which takes what the dependencies were compiled to: to check those apart takes
        // minutes. Only members of the boards' workspace go through the driver.
        let mut own = Command::new(cargo());
        own.args(["rustc", "--bin", program])
            .env(
                "RUSTC_WORKSPACE_WRAPPER",
                linter.with_file_name("clippy-driver"),
            )
            // What cargo's own subcommand tells it.
            .env("CLIPPY_ARGS", "-Dwarnings__CLIPPY_HACKERY__")
            .current_dir(package_folder(package));
        configure(&mut own, board, &toolchain, profile);
        own.args(simulation_options(board)).args(&options);
        own.arg("--").args(LINT_ONLY);
        commands.push(own);
    }
    // What a board in RTL shares is seen alike by the emulated one with this instruction set.
    if board.simulation.is_none() {
        commands.push(lint_common(board, &linter, &toolchain));
    }
    for mut command in commands {
        let status = command.status();
        let status = status.with_context(|| format!("cannot run {}", linter.display()))?;
        ensure!(
            status.success(),
            "clippy finds fault with the firmware of {}",
            board.name
        );
    }
    Ok(())
}

/// Returns the command that lints the crates that boards share, as this board's compiler sees them.
fn lint_common(board: &Board, linter: &Path, toolchain: &Toolchain) -> Command {
    let mut common = Command::new(linter);
    // Cargo itself runs its subcommands like this.
    common
        .arg("clippy")
        .env("CARGO", cargo())
        .current_dir(root());
    configure(&mut common, board, toolchain, "release");
    common
        .args(COMMON_PROFILE)
        .args(["-p", "vgstereo-kernels", "-p", "vgstereo-emulated"]);
    if let Some(preset) = board.alone {
        let feature = format!("vgstereo-emulated/{preset},vgstereo-kernels/compact");
        common.args(["--no-default-features", "--features", &feature]);
    }
    common.args(["--", "-D", "warnings"]);
    common
}

fn toolchain(board: &Board) -> Result<Toolchain> {
    Toolchain::find(board.target)?.with_context(|| {
        format!(
            "there is no Rust for {}: cargo firmware setup tells how to install it",
            board.target
        )
    })
}

fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

fn package_folder(package: &str) -> PathBuf {
    root().join("firmware/boards").join(package)
}

/// Returns the folder that cargo builds in. Compiler flags change the standard library as
/// well, so a board whose flags are not those of every board of its target has its own folder. The
/// others share the build scripts and macros, which are of the host.
fn target_folder(board: &Board) -> PathBuf {
    let mut all = Board::ALL.into_iter();
    let is_alike =
        |other: Board| other.target != board.target || other.compiler_flags == board.compiler_flags;
    let variant = match board.compiler_flags {
        [] => "plain",
        _ if all.all(is_alike) => "plain",
        _ => board.name,
    };
    root().join("target/boards").join(variant)
}

/// Adds the arguments and variables with which cargo compiles a release for the board, in a profile that is or inherits
/// that of releases.
fn configure(command: &mut Command, board: &Board, toolchain: &Toolchain, profile: &str) {
    command
        .args(["--profile", profile, "--locked", "--target", board.target])
        .arg("--target-dir")
        .arg(target_folder(board))
        .stdout(std::io::stderr());
    // Without a terminal, only warnings and errors are printed.
    if !std::io::stderr().is_terminal() {
        command.arg("--quiet");
    }
    // As the boards' folders have it: elsewhere, another level would have all that logs compiled anew.
    if std::env::var_os("DEFMT_LOG").is_none() {
        command.env("DEFMT_LOG", "info");
    }
    // Settings for builds of the host must not change those of the board.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        command.env_remove(variable);
    }
    let simulation = board.simulation.iter();
    for package in simulation.flat_map(Simulation::small_packages) {
        let setting = format!("profile.release.package.{package}.opt-level=\"s\"");
        command.args(["--config", &setting]);
    }
    let mut flags = board.compiler_flags.to_vec();
    if let Toolchain::Debian { linker } = toolchain {
        let setting = format!(
            "target.{}.linker={:?}",
            board.target,
            linker.display().to_string()
        );
        // Its suite of kernels makes its tasks on a heap. What both depend on is built once.
        let libraries = match board.kernel_suite {
            Some(_) => "-Zbuild-std=core,alloc",
            None => "-Zbuild-std=core",
        };
        command
            .args([libraries, "--config", &setting])
            .env("RUSTC", "/usr/bin/rustc")
            .env("RUSTC_BOOTSTRAP", "1");
        // The section of stack sizes takes no flash.
        flags.push("-Zemit-stack-sizes");
    }
    if !flags.is_empty() {
        let setting = format!("target.{}.rustflags={flags:?}", board.target);
        command.args(["--config", &setting]);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn who_reads_a_kept_file_sees_no_other_take_its_place() {
        let folder = tempfile::tempdir().expect("there is room for a folder");
        let linked = folder.path().join("program");
        let [first, second] = [[1; 1000], [2; 1000]];
        std::fs::write(&linked, first).expect("there is room");
        let kept = keep(&linked, "program-lite").expect("it is kept");
        let mut reader = std::fs::File::open(&kept).expect("it is there");
        std::fs::write(&linked, second).expect("there is room");
        keep(&linked, "program-lite").expect("it is kept");
        let mut read = Vec::new();
        reader.read_to_end(&mut read).expect("it can be read");
        assert_eq!(read, first);
        assert_eq!(std::fs::read(&kept).expect("it is there"), second);
    }
}
