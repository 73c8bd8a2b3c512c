//! Runs a board in its emulator. The board reads its lines from a file, and writes files of
//! disparities and confidences and a report.

use std::ffi::{CStr, OsString};
use std::fs::{self, File};
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::slice;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use vgstereo_emulated::{
    CALIBRATION_FILE, CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE, REPORT_FILE, Report, Request,
    SCANS_FILE,
};
use wait_timeout::ChildExt;

use crate::board::{Board, Emulation};
use crate::host::Frames;
use crate::log;
use crate::pair::Pair;

/// The longest time that a run may take; an emulator that takes longer is considered hung.
const LONGEST_RUN: Duration = Duration::from_secs(600);

/// The arguments with which the emulator shows no window and takes no commands.
const NO_DISPLAY: [&str; 4] = ["-display", "none", "-monitor", "none"];

/// The file for the board's log, which is the emulator's standard output.
const LOG_FILE: &CStr = c"log.defmt";
/// The file for the emulator's standard error.
const COMPLAINT_FILE: &CStr = c"complaint.txt";

/// How time passes for an emulated board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// It is the host's time. This is fast, but instructions are not counted.
    Host,
    /// Each instruction takes a fixed time, so that counts are equal in every run.
    Instructions,
}

/// Waits for an emulator to end, and ends it when it takes too long.
fn wait(child: &mut Child, board: &Board) -> Result<ExitStatus> {
    if let Some(status) = child.wait_timeout(LONGEST_RUN)? {
        return Ok(status);
    }
    child.kill()?;
    child.wait()?;
    bail!("{} is not done after {LONGEST_RUN:?}", board.name)
}

/// Runs the program that compares a board's kernels with the reference.
///
/// # Errors
/// Fails with what the program says when a kernel differs, and when it cannot be run.
pub fn run_suite(board: &Board, program: &Path) -> Result<()> {
    let emulation = board.emulation()?;
    let mut output = tempfile::tempfile().context("cannot make a temporary file")?;
    let mut child = Command::new(emulation.program)
        .args(emulation.arguments)
        .args(NO_DISPLAY)
        .args(["-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(program)
        .stdin(Stdio::null())
        .stdout(output.try_clone()?)
        .stderr(output.try_clone()?)
        .spawn()
        .with_context(|| format!("cannot run {}", emulation.program))?;
    let status = wait(&mut child, board)?;
    let mut said = String::new();
    output.rewind()?;
    output.read_to_string(&mut said)?;
    ensure!(status.success(), "{}: {}", board.name, said.trim());
    Ok(())
}

/// The arguments of the emulator for a board that is given a request, without those of its serial port.
pub(crate) fn arguments(
    emulation: &Emulation,
    firmware: &Path,
    request: &Request,
) -> Vec<OsString> {
    let mut semihosting = "enable=on,target=native,arg=vgstereo".to_owned();
    for word in request.to_string().split(' ') {
        semihosting += ",arg=";
        semihosting += word;
    }
    let ours = ["-semihosting-config", &semihosting, "-kernel"];
    let all = emulation.arguments.iter().chain(&NO_DISPLAY).chain(&ours);
    let all = all.map(OsString::from).chain([firmware.into()]);
    all.collect()
}

/// Writes the files that a board reads: the lines of these frames, and their calibration if they have one.
///
/// # Errors
/// Fails when one cannot be written.
pub(crate) fn write_inputs(folder: &Path, frames: &[Pair]) -> Result<()> {
    let write = |name: &CStr, bytes: &[u8]| {
        let path = folder.join(&*name.to_string_lossy());
        fs::write(path, bytes).context("cannot write a temporary file")
    };
    let mut lines = Vec::new();
    for pair in frames {
        lines.extend(pair.lines()?);
    }
    write(LINES_FILE, &lines)?;
    let calibration = frames.iter().find_map(|pair| pair.rectification.as_ref());
    calibration.map_or(Ok(()), |bytes| write(CALIBRATION_FILE, bytes))
}

/// Runs a board's firmware on a pair and returns all whole frames with the board's report.
///
/// # Errors
/// Fails with one line that says what the emulator or the board complains of.
pub fn run(
    board: &Board,
    firmware: &Path,
    pair: &Pair,
    request: &Request,
    clock: Clock,
) -> Result<(Frames, Report)> {
    let (frames, report, _) = run_logged(board, firmware, pair, request, clock)?;
    Ok((frames, report))
}

/// Runs a board's firmware on a pair and returns all whole frames, the board's report and the
/// lines of its log.
///
/// # Errors
/// Fails with one line that says what the emulator or the board complains of.
pub fn run_logged(
    board: &Board,
    firmware: &Path,
    pair: &Pair,
    request: &Request,
    clock: Clock,
) -> Result<(Frames, Report, Vec<String>)> {
    let emulation = board.emulation()?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let path = |name: &CStr| folder.path().join(&*name.to_string_lossy());
    let read = |name: &CStr| {
        fs::read(path(name)).with_context(|| format!("{} has not written {name:?}", board.name))
    };
    write_inputs(folder.path(), slice::from_ref(pair))?;
    let create = |name: &CStr| {
        let file = File::create(path(name));
        file.context("cannot write a temporary file")
    };
    let mut command = Command::new(emulation.program);
    command
        .args(arguments(&emulation, firmware, request))
        .args(["-serial", "none"])
        // The board opens its files in this folder.
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .stdout(create(LOG_FILE)?)
        .stderr(create(COMPLAINT_FILE)?);
    if clock == Clock::Instructions {
        command.args(["-icount", &format!("shift={}", emulation.count_shift)]);
    }
    let child = command.spawn();
    let mut child = child.with_context(|| format!("cannot run {}", emulation.program))?;
    let status = wait(&mut child, board)?;
    if !status.success() {
        let complaint = read(COMPLAINT_FILE)?;
        let complaint = String::from_utf8_lossy(&complaint);
        bail!("{} ended with {status}: {complaint}", emulation.program);
    }

    let report = String::from_utf8(read(REPORT_FILE)?).context("the report is not text")?;
    if let Some(reason) = report.strip_prefix("error ") {
        bail!("{}: {}", board.name, reason.trim_end());
    }
    let report: Report = report.parse()?;
    let mut frames = Frames {
        disparities: read(DISPARITIES_FILE)?,
        confidences: read(CONFIDENCES_FILE)?,
        scans: match request.scan {
            Some(_) => read(SCANS_FILE)?,
            None => Vec::new(),
        },
    };
    // What follows the whole frames belongs to a frame that was aborted.
    let pixels = u64::from(report.statistics.frames)
        * u64::from(pair.left.width())
        * u64::from(pair.left.height());
    let pixels = usize::try_from(pixels)?;
    ensure!(
        frames.confidences.len() >= pixels && frames.disparities.len() >= 2 * pixels,
        "{} has written less than the frames it reports",
        board.name
    );
    frames.disparities.truncate(2 * pixels);
    frames.confidences.truncate(pixels);
    // Built for one preset, it logs nothing.
    let log = match board.alone {
        Some(_) => Vec::new(),
        None => log::lines(firmware, &read(LOG_FILE)?)?,
    };
    Ok((frames, report, log))
}
