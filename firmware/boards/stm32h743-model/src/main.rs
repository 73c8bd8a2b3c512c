//! The board stm32h743 as a program: runs the ELF that is flashed on a model of the chip, with two
//! sensors at its camera port, and writes what it sends and what happened.
//!
//!     stm32h743-model ELF VIEWS WIDTH FOLDER [--frames N] [--until-ms N] [--serial files|stdio]
//!         [--calibration FILE] [--fault FRAME:LINE:KIND]... [--trouble WHAT:FROM_MS:TO_MS]...
//!
//! VIEWS holds the frame that the sensors send for ever: for each line WIDTH bytes of the left view
//! and WIDTH of the right one. FOLDER gets `serial.bin`, `log.defmt` and `report.json`. The run ends
//! when the sensors have ended N frames and the board has had time to send the last, or at a time. With
//! `--serial stdio`, standard input and output are the serial port, and the run also ends with standard
//! input, without files.

mod board;
mod fault;
mod port;
mod sensor;
mod stuck_bus;
mod trouble;
mod watchdog;

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context, Result, anyhow, bail, ensure};
use rigless::emulator::{Driver, Host, Start, Stop, run};
use rigless::image::Image;
use rigless::session::Session;
use rigless::time::VirtualNanos;
use serde::Serialize;

use board::{Listener, Nucleo};
use port::Port;
use sensor::Shared;
use trouble::Troubles;

/// How often the run is looked at, ns.
const STEP_NS: u64 = 5_000_000;
/// Time for the last lines to leave by the serial port, ns.
const DRAIN_NS: u64 = 100_000_000;
const MS: u64 = 1_000_000;

/// Where the firmware looks for the rectification of its cameras: the last sector of flash.
const CALIBRATION_SLOT: u64 = 0x081e_0000;

/// The arguments of the command line.
struct Arguments {
    elf: PathBuf,
    views: PathBuf,
    width: usize,
    folder: PathBuf,
    frames: usize,
    until_ns: u64,
    faults: BTreeMap<usize, (usize, fault::Kind)>,
    troubles: Troubles,
    calibration: Option<PathBuf>,
    serial: Listener,
}

impl Arguments {
    fn parse(mut given: impl Iterator<Item = String>) -> Result<Self> {
        let mut next = |what: &str| given.next().with_context(|| format!("{what} is missing"));
        let mut arguments = Self {
            elf: next("ELF")?.into(),
            views: next("VIEWS")?.into(),
            width: next("WIDTH")?.parse().context("WIDTH")?,
            folder: next("FOLDER")?.into(),
            frames: usize::MAX,
            until_ns: u64::MAX,
            faults: BTreeMap::new(),
            troubles: Troubles::default(),
            calibration: None,
            serial: Listener::keeping(),
        };
        let mut troubles = vec![];
        while let Ok(option) = next("") {
            let value = next(&option)?;
            match option.as_str() {
                "--frames" => arguments.frames = value.parse().context("--frames")?,
                "--until-ms" => {
                    arguments.until_ns = value.parse::<u64>().context("--until-ms")? * MS;
                }
                "--fault" => {
                    let (frame, fault) = fault::parse(&value)?;
                    arguments.faults.insert(frame, fault);
                }
                "--trouble" => troubles.push(value),
                "--calibration" => arguments.calibration = Some(value.into()),
                "--serial" => {
                    arguments.serial = match value.as_str() {
                        "files" => Listener::keeping(),
                        "stdio" => Listener::passing(),
                        _ => bail!("--serial is files or stdio"),
                    };
                }
                _ => bail!("{option} is no option"),
            }
        }
        arguments.troubles = Troubles::parse(&troubles)?;
        Ok(arguments)
    }
}

/// The report of a run, written as JSON.
#[derive(Debug, Serialize)]
struct Report {
    /// Time on the board at the end, and instructions, idle ones left out.
    time_ms: u64,
    instructions: u64,
    /// Frames that the sensors began and ended, and when they became valid.
    frames_begun: usize,
    frames_ended: usize,
    begun_ms: Vec<u64>,
    /// How often each sensor was armed.
    armed: [u32; 2],
    /// Words that the port's FIFO had no room for.
    port_overruns: u32,
    /// How often the watchdog was fed, and the longest time between two meals.
    meals: u32,
    longest_hunger_ms: u64,
    /// Restarts of the board.
    resets: Vec<String>,
    /// Accesses that the chip has no register for, or refused: no clock, no way for DMA.
    refused: Vec<String>,
    /// Other remarks of the chip's models, and registers that no model has.
    told: Vec<String>,
    unmodelled: Vec<String>,
}

/// Runs until enough frames came, or the time is over.
struct Watcher {
    frames: usize,
    until_ns: u64,
    end_ns: Option<u64>,
}

impl Driver<Nucleo> for Watcher {
    fn on_stop(
        &mut self,
        session: &mut Session<Nucleo>,
        stop: Stop,
        _: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        let now = stop.at.0;
        if self.end_ns.is_none() && session.board().chip.port.ended >= self.frames {
            self.end_ns = Some(now + DRAIN_NS);
        }
        let end_ns = self.end_ns.unwrap_or(u64::MAX).min(self.until_ns);
        (now < end_ns).then_some(VirtualNanos(now + STEP_NS))
    }
}

/// Takes the log from the emulator's probe until that closes.
fn take_log(listener: &TcpListener) -> Result<thread::JoinHandle<Vec<u8>>> {
    let address = listener.local_addr()?;
    Ok(thread::spawn(move || {
        let mut log = vec![];
        if let Ok(mut stream) = TcpStream::connect(address) {
            // What came until an error is the log.
            let _ = stream.read_to_end(&mut log);
        }
        log
    }))
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

fn main() -> Result<()> {
    let arguments = Arguments::parse(std::env::args().skip(1))?;
    let views = read(&arguments.views)?;
    let line_bytes = 2 * arguments.width;
    ensure!(
        line_bytes > 0 && !views.is_empty() && views.len().is_multiple_of(line_bytes),
        "{} holds no whole lines of {line_bytes} bytes",
        arguments.views.display()
    );
    let troubles = arguments.troubles;
    let sensors = [0, 1].map(|side| Shared::new(side, troubles.clone()));
    let port = Port::new(
        &views,
        arguments.width,
        sensors.clone(),
        arguments.faults,
        troubles.clone(),
    );
    let board = Nucleo::new(port, &sensors, troubles, arguments.serial)?;
    let mut images = vec![Image::read(&arguments.elf, None).map_err(|error| anyhow!("{error}"))?];
    if let Some(path) = &arguments.calibration {
        let slot = Image::read(path, Some(CALIBRATION_SLOT));
        images.push(slot.map_err(|error| anyhow!("{error}"))?);
    }
    let probe = TcpListener::bind("127.0.0.1:0")?;
    let log = take_log(&probe)?;
    let mut start = Start::new(&images);
    start.rtt = Some(&probe);
    let session = Session::new(Box::new(board), 0, VirtualNanos(STEP_NS));
    let session = session.map_err(|error| anyhow!("{error}"))?;
    let watcher = Watcher {
        frames: arguments.frames,
        until_ns: arguments.until_ns,
        end_ns: None,
    };
    let finished = run(session, &start, watcher).map_err(|error| anyhow!("{error}"))?;
    let session = finished.session;
    let refused = session.refused().iter();
    let unmodelled = session
        .unimplemented()
        .values()
        .map(|gap| format!("{gap:?}"));
    let board = session.board();
    let report = Report {
        time_ms: finished.stop.map_or(0, |stop| stop.at.0 / MS),
        instructions: finished.stop.map_or(0, |stop| stop.instruction_count),
        frames_begun: board.chip.port.begun,
        frames_ended: board.chip.port.ended,
        begun_ms: board.chip.port.begun_ns.iter().map(|ns| ns / MS).collect(),
        armed: sensors.each_ref().map(|sensor| sensor.look().armed),
        port_overruns: board.chip.port.overruns,
        meals: board.chip.watchdog.meals,
        longest_hunger_ms: board.chip.watchdog.longest_ns / MS,
        resets: session
            .resets()
            .iter()
            .map(|reset| format!("{reset:?}"))
            .collect(),
        refused: refused
            .map(|(address, fault)| format!("{address:#x}: {fault}"))
            .chain(session.unmapped().iter().map(|gap| format!("{gap}")))
            .chain(
                session
                    .unrouted()
                    .iter()
                    .map(|gap| format!("unrouted {gap:?}")),
            )
            .collect(),
        told: session
            .told()
            .map(|told| format!("{}.{}: {}", told.instance, told.register, told.reason))
            .collect(),
        unmodelled: unmodelled.collect(),
    };
    let write = |name: &str, bytes: &[u8]| {
        let path = arguments.folder.join(name);
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    };
    write("serial.bin", &board.serial.bytes())?;
    write("report.json", &serde_json::to_vec_pretty(&report)?)?;
    drop(session);
    drop(probe);
    let log = log.join().map_err(|_| anyhow!("the log was lost"))?;
    write("log.defmt", &log)
}
