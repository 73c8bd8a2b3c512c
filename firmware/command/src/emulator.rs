//! A board in its emulator: files in, files and a report out.

use std::ffi::CStr;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use vgstereo_emulated::{
    CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE, REPORT_FILE, Report, Request,
};
use wait_timeout::ChildExt;

use crate::board::Board;
use crate::host::Frames;
use crate::log;
use crate::pair::Pair;

/// An emulator that runs longer hangs.
const LONGEST_RUN: Duration = Duration::from_secs(600);

/// What the board logs: the emulator's standard output.
const LOG_FILE: &CStr = c"log.defmt";
/// What the emulator complains of.
const COMPLAINT_FILE: &CStr = c"complaint.txt";

/// How an emulator keeps time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// The host's: fast, but instructions are not counted.
    Host,
    /// An instruction takes a fixed time: counts are the same in every run.
    Instructions,
}

/// Runs a board's firmware on a pair, without its log.
///
/// # Errors
/// As [`run_logged`].
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

/// Runs a board's firmware on a pair; gives the lines of its log too.
///
/// # Errors
/// One line that says what the emulator or the board complains of.
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
    fs::write(path(LINES_FILE), pair.lines()?).context("cannot write a temporary file")?;

    let mut semihosting = "enable=on,target=native,arg=vgstereo".to_owned();
    for word in request.to_string().split(' ') {
        semihosting += ",arg=";
        semihosting += word;
    }
    let create = |name: &CStr| {
        let file = File::create(path(name));
        file.context("cannot write a temporary file")
    };
    let mut command = Command::new(emulation.program);
    command
        .args(emulation.arguments)
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", &semihosting, "-kernel"])
        .arg(firmware)
        // The board's files are opened here.
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .stdout(create(LOG_FILE)?)
        .stderr(create(COMPLAINT_FILE)?);
    if clock == Clock::Instructions {
        command.args(["-icount", &format!("shift={}", emulation.count_shift)]);
    }
    let child = command.spawn();
    let mut child = child.with_context(|| format!("cannot run {}", emulation.program))?;
    let Some(status) = child.wait_timeout(LONGEST_RUN)? else {
        child.kill()?;
        child.wait()?;
        bail!("{} is not done after {LONGEST_RUN:?}", board.name);
    };
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
    };
    // What is after the whole frames is of one that was aborted.
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
    let log = log::lines(firmware, &read(LOG_FILE)?)?;
    Ok((frames, report, log))
}
