//! A board in its emulator: files in, files and a report out.

use std::ffi::CStr;
use std::fs::{self, File};
use std::io::Read;
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
use crate::pair::Pair;

/// An emulator that runs longer hangs.
const LONGEST_RUN: Duration = Duration::from_secs(600);

/// How an emulator keeps time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// The host's: fast, but instructions are not counted.
    Host,
    /// An instruction takes a fixed time: counts are the same in every run.
    Instructions,
}

/// Runs a board's firmware on a pair.
///
/// # Errors
/// One line that says what the emulator or the board complains of.
pub fn run(
    board: &Board,
    firmware: &Path,
    pair: &Pair,
    request: &Request,
    clock: Clock,
) -> Result<(Frames, Report)> {
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
    let log = path(c"emulator.log");
    let log_file = File::create(&log).context("cannot write a temporary file")?;
    let mut command = Command::new(emulation.program);
    command
        .args(emulation.arguments)
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", &semihosting, "-kernel"])
        .arg(firmware)
        // The board's files are opened here.
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log_file);
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
        let mut complaint = String::new();
        File::open(&log)?.read_to_string(&mut complaint)?;
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
    Ok((frames, report))
}
