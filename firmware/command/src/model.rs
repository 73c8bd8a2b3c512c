//! Runs a real board's firmware on a model of its chip: the very file that is flashed, with two
//! sensors at its camera port.
//!
//! The model is a program of its own in `firmware/boards`, apart from the workspace, because the
//! crate that has the chip asks for a newer compiler than the rest.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;
use vgstereo_core::DisparityRange;
use vgstereo_firmware::camera::{ErrorKind, PixelFormat};
use vgstereo_firmware::scripted::{FaultKind, ScriptedFault};
use wait_timeout::ChildExt;

use crate::board::{Board, Model};
use crate::host::{self, Frames};
use crate::log;
use crate::pair::Pair;
use crate::received::{Received, SentFrame};
use crate::toolchain::ModelCompiler;

/// The longest times that the start of a run and each of its frames may take; a model that takes
/// longer is considered hung.
const LONGEST_START: Duration = Duration::from_secs(300);
const LONGEST_FRAME: Duration = Duration::from_secs(120);
/// The faults that the wires of the camera can have.
const WIRE_FAULTS: [ErrorKind; 4] = [
    ErrorKind::Overrun,
    ErrorKind::ShortLine,
    ErrorKind::ShortFrame,
    ErrorKind::Timeout,
];

/// A run of the model: how long it lasts, the faults of its wires, and what is wrong for a time.
#[derive(Debug, Clone, Default)]
pub struct Scenario {
    /// Number of frames that the sensors end before the run ends.
    pub frames: u32,
    /// Faults at the wires: overruns, short lines, short frames and time-outs, one in a frame. Frames
    /// are those that the sensors send.
    pub faults: Vec<ScriptedFault>,
    /// What is wrong, from and to, ms: `left-absent`, `left-other-chip` (another chip in the sensor's
    /// place), `left-sda-low` (its bus is stuck), the same of the right sensor, `clock-stuck` and
    /// `lvld-low` (wires of the camera port).
    pub troubles: Vec<(&'static str, u64, u64)>,
    /// Time on the board after which the run ends in any case, ms.
    pub until_ms: u64,
}

/// What happened to the chip, as the model reports it.
#[derive(Debug, Clone, Default, Deserialize)]
pub struct Report {
    /// Time on the board at the end, ms.
    pub time_ms: u64,
    /// Instructions, sleep left out.
    pub instructions: u64,
    /// Number of frames that the sensors began.
    pub frames_begun: u32,
    /// When they did, ms.
    pub begun_ms: Vec<u64>,
    /// How often the left and the right sensor were set up.
    pub armed: [u32; 2],
    /// How often the watchdog was fed.
    pub meals: u32,
    /// The longest time between two meals, ms.
    pub longest_hunger_ms: u64,
    /// Restarts of the board, each with its cause.
    pub resets: Vec<String>,
    /// Accesses without a register or without a clock, and transfers that DMA cannot make.
    pub refused: Vec<String>,
    /// Registers that were reached and of which there is no model.
    pub unmodelled: Vec<String>,
}

impl Report {
    /// Checks that the chip took every access.
    ///
    /// # Errors
    /// Fails with one line that names the accesses that were refused, and the registers without a
    /// model.
    pub fn ensure_all_accesses_taken(&self) -> Result<()> {
        let (refused, unmodelled) = (&self.refused, &self.unmodelled);
        ensure!(
            refused.is_empty() && unmodelled.is_empty(),
            "accesses refused: {refused:?}, registers without a model: {unmodelled:?}"
        );
        Ok(())
    }
}

impl Scenario {
    /// Checks that the wires can have its faults.
    ///
    /// # Errors
    /// Fails when they cannot have a kind, or when a frame has several.
    pub fn validate(&self) -> Result<()> {
        let mut frames = BTreeSet::new();
        for fault in &self.faults {
            let kinds = WIRE_FAULTS.map(|kind| FaultKind::Error(kind).name());
            ensure!(
                kinds.contains(&fault.kind.name()) && frames.insert(fault.frame),
                "{fault}: the camera of the model has these faults, one in a frame: {}",
                kinds.join(", ")
            );
        }
        Ok(())
    }
}

/// What came of a run.
#[derive(Debug, Clone, Default)]
pub struct Ran {
    /// The frames of which the board has sent the begin.
    pub frames: Vec<SentFrame>,
    /// The lines of its log.
    pub log: Vec<String>,
    /// What happened to the chip.
    pub report: Report,
}

/// Returns the pair that a board's sensors send unless another is given: the built-in scene in the
/// size for which its firmware is built.
#[must_use]
pub fn built_in_pair(model: &Model) -> Pair {
    let (width, height) = model.size;
    Pair::rendered(width, height, model.disparities)
}

/// Checks that a board's firmware is built for pairs like this one.
///
/// # Errors
/// Fails with one line that says what it is built for.
pub fn ensure_built_for(model: &Model, pair: &Pair) -> Result<()> {
    let (width, height) = model.size;
    ensure!(
        pair.left.dimensions() == model.size
            && pair.format == PixelFormat::Grey8
            && pair.disparities == DisparityRange::up_to(model.disparities - 1),
        "the firmware is built for {width}x{height} px in grey and {} disparities",
        model.disparities
    );
    Ok(())
}

/// Returns the frames that the host makes of a pair as a board does.
///
/// # Errors
/// Fails when the pair is not of the size for which the board's firmware is built.
pub fn expected(model: &Model, pair: &Pair) -> Result<Frames> {
    ensure_built_for(model, pair)?;
    let (frames, _) = host::run(pair, &pair.request(model.preset, 1, &[])?)?;
    Ok(frames)
}

/// Builds the model of a board and returns the path of the program.
///
/// # Errors
/// Fails when the board has no model, when no compiler is new enough, or when it does not compile.
pub fn build(board: &Board) -> Result<PathBuf> {
    let model = model(board)?;
    let compiler = compiler(board)?;
    let status = cargo(compiler, model, "build").status();
    ensure!(
        status.context("cannot run cargo")?.success(),
        "the model of {} does not build",
        board.name
    );
    Ok(target_folder().join("release").join(model.folder))
}

/// Lints the model of a board with the clippy of its compiler. What it depends on is built for that
/// as for a run, so that it is built once.
///
/// # Errors
/// Fails when the board has no model, when no compiler is new enough or has no clippy, or when
/// clippy finds something.
pub fn lint(board: &Board) -> Result<()> {
    let compiler = compiler(board)?;
    ensure!(
        compiler.lints(),
        "there is no clippy for the model of {}: rustup component add clippy, of the compiler that builds it",
        board.name
    );
    let mut cargo = cargo(compiler, model(board)?, "rustc");
    cargo
        .env("RUSTC_WORKSPACE_WRAPPER", "clippy-driver")
        .args(["--", "-D", "warnings"]);
    ensure!(
        cargo.status().context("cannot run cargo")?.success(),
        "clippy finds fault with the model of {}",
        board.name
    );
    Ok(())
}

fn model(board: &Board) -> Result<Model> {
    board
        .model
        .with_context(|| format!("there is no model of {}", board.name))
}

fn compiler(board: &Board) -> Result<ModelCompiler> {
    ModelCompiler::find().with_context(|| {
        format!(
            "there is no compiler for the model of {}: cargo firmware setup tells how to install it",
            board.name
        )
    })
}

/// The folder that models are built in.
fn target_folder() -> PathBuf {
    crate::toolchain::root().join("target/model")
}

/// The command that compiles a model with this verb of cargo.
fn cargo(compiler: ModelCompiler, model: Model, verb: &str) -> Command {
    let folder = crate::toolchain::root().join("firmware/boards");
    let mut cargo = compiler.cargo();
    cargo
        .args([verb, "--release", "--locked", "--quiet"])
        .args(compiler.options())
        .arg("--target-dir")
        .arg(target_folder())
        .current_dir(folder.join(model.folder))
        .stdout(std::io::stderr());
    cargo
}

/// Runs a board's firmware on its model while the sensors send a pair.
///
/// # Errors
/// Fails with one line when the scenario is not valid, when the model fails or does not end, or when
/// what the board sent or logged cannot be read.
pub fn run(program: &Path, firmware: &Path, pair: &Pair, scenario: &Scenario) -> Result<Ran> {
    scenario.validate()?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let mut command = Command::new(program);
    command
        .args(inputs(firmware, pair, folder.path())?)
        .args(["--frames", &scenario.frames.to_string()])
        .args(["--until-ms", &scenario.until_ms.to_string()])
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    for fault in &scenario.faults {
        command.args(["--fault", &fault.to_string()]);
    }
    for (what, from_ms, to_ms) in &scenario.troubles {
        command.args(["--trouble", &format!("{what}:{from_ms}:{to_ms}")]);
    }
    let child = command.spawn();
    let mut child = child.with_context(|| format!("cannot run {}", program.display()))?;
    let longest = LONGEST_START + LONGEST_FRAME.saturating_mul(scenario.frames);
    let Some(status) = child.wait_timeout(longest)? else {
        child.kill()?;
        child.wait()?;
        bail!("the model is not done after {longest:?}");
    };
    ensure!(status.success(), "the model ended with {status}");
    let read = |name: &str| {
        let path = folder.path().join(name);
        fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
    };
    Ok(Ran {
        frames: Received::of(&read("serial.bin")?)?.frames,
        log: log::lines(firmware, &read("log.defmt")?)?,
        report: serde_json::from_slice(&read("report.json")?)?,
    })
}

/// Writes the files that a model reads into a folder, and returns the arguments that name them.
pub(crate) fn inputs(firmware: &Path, pair: &Pair, folder: &Path) -> Result<Vec<OsString>> {
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        fs::write(&path, bytes).context("cannot write a temporary file")?;
        anyhow::Ok(path)
    };
    let views = write("views.bin", &pair.lines()?)?;
    let width = pair.left.width().to_string();
    let mut arguments = vec![firmware.into(), views.into(), width.into(), folder.into()];
    if let Some(bytes) = &pair.rectification {
        arguments.push("--calibration".into());
        arguments.push(write("calibration.bin", bytes)?.into());
    }
    Ok(arguments)
}
