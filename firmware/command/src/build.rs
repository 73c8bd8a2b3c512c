//! Building the boards' firmware.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

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
    let Some(toolchain) = Toolchain::find(board.target)? else {
        bail!(
            "there is no Rust for {}: cargo firmware setup tells how to install it",
            board.target
        );
    };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    // Flags change the library too: one folder for each set of them.
    let variant = match board.compiler_flags {
        [] => "plain",
        _ => board.name,
    };
    let folder = root().join("target/boards").join(variant);
    let mut command = Command::new(cargo);
    command
        .args(["build", "--release", "--locked", "--target", board.target])
        .arg("--target-dir")
        .arg(&folder)
        .current_dir(root().join("firmware/boards").join(board.folder))
        .stdout(std::io::stderr());
    // Where nobody looks on, only what is wrong is said.
    if !std::io::stderr().is_terminal() {
        command.arg("--quiet");
    }
    // What is set for the host's build is not meant for the board's.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        command.env_remove(variable);
    }
    if !board.compiler_flags.is_empty() {
        let flags: Vec<_> = board
            .compiler_flags
            .iter()
            .map(|f| format!("{f:?}"))
            .collect();
        let setting = format!("target.{}.rustflags=[{}]", board.target, flags.join(","));
        command.args(["--config", &setting]);
    }
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
    }
    let status = command.status().context("cannot run cargo")?;
    ensure!(
        status.success(),
        "the firmware of {} does not build",
        board.name
    );
    Ok(folder.join(board.target).join("release").join(board.folder))
}
