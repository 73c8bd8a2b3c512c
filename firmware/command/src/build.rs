//! Building the boards' firmware, and linting it.

use std::ffi::OsString;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::board::Board;
use crate::toolchain::Toolchain;

/// The repository.
fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own)
}

/// Builds a board's firmware as it is released; gives the file that was linked.
///
/// # Errors
/// When there is no compiler for the board or it does not compile.
pub fn build(board: &Board) -> Result<PathBuf> {
    let mut command = Command::new(cargo());
    command.arg("build");
    configure(&mut command, board, &toolchain(board)?);
    command.current_dir(board_folder(board));
    let status = command.status().context("cannot run cargo")?;
    ensure!(
        status.success(),
        "the firmware of {} does not build",
        board.name
    );
    let folder = target_folder(board).join(board.target).join("release");
    Ok(folder.join(board.folder))
}

/// Lints a board's crate, and as they are for its processor the crates that differ there.
///
/// # Errors
/// When there is no clippy for the board's compiler or it finds something.
pub fn lint(board: &Board) -> Result<()> {
    let toolchain = toolchain(board)?;
    let linter = toolchain.linter()?.with_context(|| {
        format!(
            "there is no clippy for {}: cargo firmware setup tells how to install it",
            board.target
        )
    })?;
    let shared = ["-p", "vgstereo-chip-kernels", "-p", "vgstereo-emulated"];
    for (folder, packages) in [(board_folder(board), &[][..]), (root().into(), &shared[..])] {
        let mut command = Command::new(&linter);
        // As cargo runs its subcommands.
        command.arg("clippy").env("CARGO", cargo());
        configure(&mut command, board, &toolchain);
        command.args(packages).args(["--", "-D", "warnings"]);
        let status = command.current_dir(folder).status();
        let status = status.with_context(|| format!("cannot run {}", linter.display()))?;
        ensure!(
            status.success(),
            "clippy finds fault with the firmware of {}",
            board.name
        );
    }
    Ok(())
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

fn board_folder(board: &Board) -> PathBuf {
    root().join("firmware/boards").join(board.folder)
}

/// Flags change the library too: one folder for each set of them.
fn target_folder(board: &Board) -> PathBuf {
    let variant = match board.compiler_flags {
        [] => "plain",
        _ => board.name,
    };
    root().join("target/boards").join(variant)
}

/// Lets cargo compile with a toolchain for the board, as it is released.
fn configure(command: &mut Command, board: &Board, toolchain: &Toolchain) {
    command
        .args(["--release", "--locked", "--target", board.target])
        .arg("--target-dir")
        .arg(target_folder(board))
        .stdout(std::io::stderr());
    // Where nobody looks on, only what is wrong is said.
    if !std::io::stderr().is_terminal() {
        command.arg("--quiet");
    }
    // What is set for the host's build is not meant for the board's.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        command.env_remove(variable);
    }
    let mut flags = board.compiler_flags.to_vec();
    if let Toolchain::Debian { linker } = toolchain {
        let setting = format!(
            "target.{}.linker={:?}",
            board.target,
            linker.display().to_string()
        );
        command
            .args(["-Zbuild-std=core", "--config", &setting])
            .env("RUSTC", "/usr/bin/rustc")
            .env("RUSTC_BOOTSTRAP", "1");
        // Takes no flash.
        flags.push("-Zemit-stack-sizes");
    }
    if !flags.is_empty() {
        let setting = format!("target.{}.rustflags={flags:?}", board.target);
        command.args(["--config", &setting]);
    }
}
