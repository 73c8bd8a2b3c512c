//! Runs a board that is hardware in RTL: Verilator makes a program of it, with two sensors at the pins of
//! its camera ports and a host at its serial port.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use vgstereo_emulated::{Report, Request};
use vgstereo_firmware::camera::ErrorKind;
use vgstereo_firmware::scripted::{FaultKind, ScriptedFault};
use vgstereo_sim::files::write_files;

use crate::board::{Board, Processor, Simulation};
use crate::elf::{self, Image};
use crate::host::Frames;
use crate::pair::Pair;
use crate::received::{Received, SentFrame};
use crate::toolchain::{Simulator, lock, root};

/// The symbols of the places in the image for the request and for the rectification.
const REQUEST: &str = "request";
const CALIBRATION: &str = "calibration";
/// Where the processor has its code, with and without a stereo unit, and its data, and their lengths, bytes.
/// `rtl/soc.sv` has them too.
const CODE: (u64, u64) = (0, 208 << 10);
const PLAIN_CODE: (u64, u64) = (0, 256 << 10);
const DATA: (u64, u64) = (0x1000_0000, 96 << 10);
/// Cycles after which a run is taken for hung: for the start and the waits of a fault, and for each pixel and
/// disparity.
const LONGEST_START: u64 = 50_000_000;
const LONGEST_EACH: u64 = 2000;

/// The sensors' pace, and what goes wrong at their pins.
#[derive(Debug, Clone, Default)]
pub struct Scenario {
    /// Faults, `FRAME:LINE:KIND`, of the kinds of `sim/sensors.h`.
    pub faults: Vec<String>,
    /// Clocks of PCLK between two frames of sensors that do not wait for room; `None` for those that wait.
    pub free_running_gap: Option<u32>,
    /// When the left and the right sensor get their power, µs after the reset.
    pub powered_us: [u64; 2],
    /// Until when SDA of the left and of the right sensor is held low, likewise.
    pub sda_held_us: [u64; 2],
}

impl Scenario {
    /// Returns the sensors with these faults, each as it happens at pins.
    ///
    /// # Errors
    /// Fails with one line that names the kinds that there are.
    pub fn of(faults: &[ScriptedFault]) -> Result<Self> {
        let faults = faults.iter().map(|fault| {
            let kind = match fault.kind {
                FaultKind::DroppedLine => "lost-line",
                FaultKind::LostSync => "late-line-left",
                FaultKind::Truncated => "early-frame",
                FaultKind::Error(ErrorKind::Overrun) => "burst",
                FaultKind::Error(ErrorKind::ShortLine) => "short-line",
                FaultKind::Error(ErrorKind::Timeout) => "stopped-clock",
                _ => bail!(
                    "{fault}: the pins of the cameras have the faults dropped-line, lost-sync, truncated, overrun, \
                     short-line and timeout"
                ),
            };
            Ok(format!("{}:{}:{kind}", fault.frame, fault.line))
        });
        Ok(Self {
            faults: faults.collect::<Result<_>>()?,
            ..Self::default()
        })
    }
}

/// What came of a run.
#[derive(Debug, Clone)]
pub struct Ran {
    /// The whole frames.
    pub frames: Frames,
    /// The frames of which the board has sent the begin.
    pub sent: Vec<SentFrame>,
    /// The board's report. What it has for instructions are cycles.
    pub report: Report,
    /// Number of cycles from the reset to the end.
    pub cycles: u64,
    /// Number of frames that the sensors have begun.
    pub frames_begun: u64,
    /// Number of lines that the left and the right sensor have ended.
    pub lines: [u64; 2],
    /// The writes to the registers of the left and of the right sensor, in the order of time: the number of a register
    /// and its new value.
    pub sensor_writes: [Vec<[u8; 2]>; 2],
    /// The lines of the board's log. Its report is the end of it.
    pub log: Vec<String>,
}

/// Checks that a board's firmware is built for a request.
///
/// # Errors
/// Fails with one line that says what it is built for.
pub fn ensure_built_for(board: &Board, request: &Request) -> Result<()> {
    let simulation = simulation_of(board)?;
    ensure!(
        request.preset == simulation.preset
            && request.geometry.format.is_grey()
            && request.scan.is_none(),
        "the firmware of {} is built for {} in grey and without a scan",
        board.name,
        simulation.preset
    );
    Ok(())
}

/// Makes a program of a board and its surroundings, and returns its path.
///
/// # Errors
/// Fails with one line when a tool is missing or the RTL does not build.
pub fn build(board: &Board) -> Result<PathBuf> {
    let Simulation {
        processor,
        unit_lanes: lanes,
        ..
    } = simulation_of(board)?;
    let tools = tools(processor)?;
    let sources = root().join("firmware/boards").join(board.folder);
    let mut files = tools.processor.clone();
    files.extend(files_with(&sources.join("rtl"), "sv")?);
    files.extend(files_with(
        &sources.join("rtl").join(processor.name()),
        "sv",
    )?);
    files.extend(files_with(&sources.join("sim"), "cpp")?);
    let setting = format!("-GUNIT_LANES={lanes}");
    let name = format!("sim{lanes}-{}", processor.name());
    verilate(&tools, &name, "soc", &[&setting], &files)
}

/// Makes a program of a board's stereo unit alone, with a memory beside it, and returns its path.
///
/// # Errors
/// Fails with one line when a tool is missing or the RTL does not build.
pub fn build_unit(board: &Board) -> Result<PathBuf> {
    let simulation = simulation_of(board)?;
    let lanes = simulation.unit_lanes;
    let setting = format!("-GLANES={lanes}");
    let files = files_of_part(board, "", "unit")?;
    let tools = tools(simulation.processor)?;
    let name = format!("unit{lanes}");
    verilate(&tools, &name, "stereo_unit", &[&setting], &files)
}

/// Makes a program of VexRiscv's byte instructions alone, and returns its path. It reads instructions and writes
/// their results, as `sim/instructions/main.cpp` says.
///
/// # Errors
/// Fails with one line when a tool is missing or the RTL does not build.
pub fn build_instructions(board: &Board) -> Result<PathBuf> {
    let files = files_of_part(board, Processor::VexRiscv.name(), "instructions")?;
    let tools = tools(Processor::VexRiscv)?;
    verilate(&tools, "instructions", "byte_instructions", &[], &files)
}

/// Returns the files of a folder of a board's RTL but for the whole system and its processor, and of what is around a part
/// of it.
fn files_of_part(board: &Board, folder: &str, part: &str) -> Result<Vec<PathBuf>> {
    let sources = root().join("firmware/boards").join(board.folder);
    let mut files = files_with(&sources.join("rtl").join(folder), "sv")?;
    files.retain(|file| !file.ends_with("soc.sv") && !file.ends_with("processor.sv"));
    files.extend(files_with(&sources.join("sim").join(part), "cpp")?);
    Ok(files)
}

fn simulation_of(board: &Board) -> Result<Simulation> {
    board.simulation.context("the board is not simulated")
}

fn tools(processor: Processor) -> Result<Simulator> {
    Simulator::find(processor).context(
        "it cannot be simulated: cargo firmware setup tells how to install what is missing",
    )
}

/// Makes a program of a module in RTL and what is around it, in a folder of its own, and returns its path.
fn verilate(
    tools: &Simulator,
    name: &str,
    module: &str,
    settings: &[&str],
    files: &[PathBuf],
) -> Result<PathBuf> {
    let folder = Simulator::folder().join(name);
    let _lock = lock(&folder)?;
    let mut command = Command::new(&tools.verilator);
    command
        .args(["--cc", "--exe", "--build", "-O3", "--noassert"])
        .args(["--x-assign", "fast", "--x-initial", "fast"])
        // The processor's source is not ours to mend.
        .args(["-Wno-fatal", "-Wno-lint", "-Wno-style", "-Wno-BLKANDNBLK"])
        .args(["-CFLAGS", "-std=c++17", "-MAKEFLAGS", "OPT_FAST=-O2"])
        .args(settings)
        .args(["--top-module", module, "-o", "program", "--Mdir"])
        .arg(&folder)
        .args(files);
    let output = command.stdin(Stdio::null()).output();
    let output = output.with_context(|| format!("cannot run {}", tools.verilator.display()))?;
    ensure!(
        output.status.success(),
        "the RTL of {module} does not build: {}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    Ok(folder.join("program"))
}

/// Returns the files of a folder with this extension, in the order of their names.
fn files_with(folder: &Path, extension: &str) -> Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|found| found == extension));
    files.sort();
    Ok(files)
}

/// Writes what the board's memories hold and what its sensors see to a folder, and returns the arguments of the simulation's
/// program for them.
///
/// # Errors
/// Fails with one line when the firmware is not built for the request, or a file cannot be written.
pub(crate) fn inputs(
    board: &Board,
    firmware: &Path,
    pair: &Pair,
    request: &Request,
    scenario: &Scenario,
    folder: &Path,
) -> Result<Vec<OsString>> {
    ensure_built_for(board, request)?;
    let rectification = pair.rectification.as_deref();
    write_images(board, firmware, request, rectification, folder)?;
    write_views(pair, folder)?;
    let path = |name: &str| folder.join(name).into_os_string();
    let mut inputs: Vec<OsString> = Vec::new();
    for memory in ["code", "data"] {
        let mut input = OsString::from(format!("+{memory}="));
        input.push(path(&format!("{memory}.hex")));
        inputs.push(input);
    }
    for side in ["left", "right"] {
        inputs.extend([format!("--{side}").into(), path(&format!("{side}.pgm"))]);
    }
    for fault in &scenario.faults {
        inputs.extend(["--fault".into(), fault.into()]);
    }
    for (option, times_us) in [
        ("--powered", scenario.powered_us),
        ("--sda-held", scenario.sda_held_us),
    ] {
        for (side, us) in ["left", "right"].iter().zip(times_us) {
            inputs.extend([option.into(), format!("{side}:{us}").into()]);
        }
    }
    if let Some(clocks) = scenario.free_running_gap {
        inputs.extend(["--free-running".into(), clocks.to_string().into()]);
    }
    Ok(inputs)
}

/// Runs a board's firmware on a request while its sensors send a pair.
///
/// # Errors
/// Fails with one line when the firmware is not built for the request, when the program or the board complains, or
/// when what the board sent is damaged.
pub fn run(
    board: &Board,
    program: &Path,
    firmware: &Path,
    pair: &Pair,
    request: &Request,
    scenario: &Scenario,
) -> Result<Ran> {
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let inputs = inputs(board, firmware, pair, request, scenario, folder.path())?;
    let pixels = u64::from(pair.left.width()) * u64::from(pair.left.height());
    let frames = u64::from(request.frames) + scenario.faults.len() as u64 + 1;
    let longest =
        frames * (LONGEST_START + LONGEST_EACH * pixels * u64::from(request.disparities.count));
    let child = Command::new(program)
        .args(inputs)
        .args(["--cycles", &longest.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = child.with_context(|| format!("cannot run {}", program.display()))?;
    let serial = child
        .stdout
        .take()
        .context("the board has no serial port")?;
    let received = Received::until(serial, |received| report_of(received).is_some());
    // The end of its input ends the program, which writes what has happened at the pins in few lines.
    drop(child.stdin.take());
    let mut said = String::new();
    if let Some(mut stderr) = child.stderr.take() {
        stderr.read_to_string(&mut said)?;
    }
    let status = child.wait()?;
    let received = received?;
    ensure!(
        status.success(),
        "the simulation of {} ended with {status}: {}",
        board.name,
        said.lines().last().unwrap_or_default()
    );
    let report = report_of(&received).context("the board has sent no report")?;
    let report = report.map_err(|reason| anyhow::anyhow!("{}: {reason}", board.name))?;
    let told = |name: &str| {
        let mut lines = said.lines().filter_map(|line| line.split_once(' '));
        let found = lines.find(|line| line.0 == name);
        let found = found.map(|(_, value)| value);
        found.with_context(|| format!("the simulation does not tell {name}"))
    };
    let count = |name: &str| {
        let count = told(name)?.parse::<u64>();
        count.with_context(|| format!("the simulation tells no number for {name}"))
    };
    let writes = |name: &str| {
        let digits = told(name)?.as_bytes().as_chunks::<4>().0;
        let write = |digits: &[u8; 4]| {
            let write = std::str::from_utf8(digits).ok();
            let write = write.and_then(|digits| u16::from_str_radix(digits, 16).ok());
            write.map(u16::to_be_bytes)
        };
        let writes: Option<Vec<_>> = digits.iter().map(write).collect();
        writes.with_context(|| format!("the simulation tells no writes for {name}"))
    };
    let mut whole = Frames::default();
    for frame in received.frames.iter().filter(|frame| frame.is_whole) {
        whole.disparities.extend_from_slice(&frame.disparities);
        whole.confidences.extend_from_slice(&frame.confidences);
    }
    Ok(Ran {
        frames: whole,
        sent: received.frames,
        report,
        cycles: count("cycles")?,
        frames_begun: count("frames")?,
        lines: [count("left_lines")?, count("right_lines")?],
        sensor_writes: [writes("left_writes")?, writes("right_writes")?],
        log: received.log,
    })
}

/// Returns the board's report, or why it has none, when it has come.
fn report_of(received: &Received) -> Option<Result<Report, String>> {
    let last = received.log.last()?;
    if let Some(reason) = last.strip_prefix("error ") {
        return Some(Err(reason.to_owned()));
    }
    received.log.join("\n").parse().ok().map(Ok)
}

/// Writes what the memories of code and data hold, with the request and the rectification, if there is one, in their
/// places: `code.hex` and `data.hex`.
///
/// # Errors
/// Fails with one line when the firmware, the request or the rectification do not fit, or a file cannot be written.
pub fn write_images(
    board: &Board,
    firmware: &Path,
    request: &Request,
    rectification: Option<&[u8]>,
    folder: &Path,
) -> Result<()> {
    let code = match board.simulation {
        Some(Simulation { unit_lanes: 0, .. }) => PLAIN_CODE,
        _ => CODE,
    };
    let image = Image::read(firmware)?;
    let code = image.bytes(code.0, code.1)?;
    let mut data = image.bytes(DATA.0, DATA.1)?;
    // A zero ends the text.
    let text = format!("{request}\0");
    for (symbol, content) in [
        (REQUEST, text.as_bytes()),
        (CALIBRATION, rectification.unwrap_or_default()),
    ] {
        let (address, size) = elf::symbol(firmware, symbol)?;
        let start = usize::try_from(address - DATA.0)?;
        let place = data.get_mut(start..start + usize::try_from(size)?);
        let place = place.and_then(|place| place.get_mut(..content.len()));
        let place = place.with_context(|| {
            let length = content.len();
            format!("the {symbol} has {length} bytes, and its place in the image {size}")
        })?;
        place.copy_from_slice(content);
    }
    let mut files = Vec::new();
    for (name, bytes) in [("code.hex", code), ("data.hex", data)] {
        let mut lines = String::new();
        for word in bytes.as_chunks().0 {
            writeln!(lines, "{:08x}", u32::from_le_bytes(*word))?;
        }
        files.push((folder.join(name), lines.into_bytes()));
    }
    write_files(&files)
}

/// Writes what the sensors see.
fn write_views(pair: &Pair, folder: &Path) -> Result<()> {
    let width = pair.geometry()?.line_bytes();
    let lines = pair.lines()?;
    let header = format!("P5\n{width} {}\n255\n", pair.left.height()).into_bytes();
    let mut views = [header.clone(), header];
    for (index, line) in lines.chunks_exact(width).enumerate() {
        views[index % 2].extend_from_slice(line);
    }
    for (name, view) in ["left.pgm", "right.pgm"].into_iter().zip(views) {
        fs::write(folder.join(name), view).context("cannot write a temporary file")?;
    }
    Ok(())
}
