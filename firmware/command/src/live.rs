//! Boards that run until they are ended, with their serial port at a TCP port of this machine.

use std::ffi::OsString;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow};
use tempfile::TempDir;
use vgstereo_emulated::{REPORT_FILE, Request};

use crate::board::Board;
use crate::bridge::{Bridge, Damage, Event};
use crate::emulator;
use crate::model;
use crate::pair::Pair;
use crate::simulation::{self, Scenario};

/// The longest time from the start of a board to its first byte.
const LONGEST_START: Duration = Duration::from_secs(300);

/// The service of a board's link: its address, and damage on purpose.
#[derive(Debug, Clone)]
pub struct Link {
    /// The address to listen at; with port 0 a port that is free.
    pub address: SocketAddr,
    /// Damage that is done to the bytes on the way to hosts.
    pub damage: Damage,
}

impl Link {
    /// A link at a free port of this machine.
    #[must_use]
    pub fn local(damage: Damage) -> Self {
        Self {
            address: ([127, 0, 0, 1], 0).into(),
            damage,
        }
    }
}

/// A board that runs. It is ended with this value, and where the system has a way to do so
/// (Linux: `setpriv`, of util-linux), also when the thread that has started it ends in whatever way.
#[derive(Debug)]
pub struct LiveBoard {
    name: &'static str,
    child: Child,
    bridge: Bridge,
    complaint: File,
}

impl LiveBoard {
    /// Starts the firmware of an emulated board with a request for the link. Its camera sends these
    /// frames in turn. Returns when the board has begun to speak.
    ///
    /// # Errors
    /// Fails with one line that says what the emulator or the board complains of, or that the address
    /// cannot be listened at.
    pub fn emulated(
        board: &Board,
        firmware: &Path,
        frames: &[Pair],
        request: &Request,
        link: Link,
    ) -> Result<Self> {
        let emulation = board.emulation()?;
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        emulator::write_inputs(folder.path(), frames)?;
        let mut arguments = emulator::arguments(&emulation, firmware, request);
        let link_port = [
            "-chardev",
            "stdio,id=link,signal=off",
            "-serial",
            "chardev:link",
        ];
        arguments.extend(link_port.map(OsString::from));
        let program = emulation.program.as_ref();
        Self::start(board.name, program, &arguments, folder, link)
    }

    /// Starts a real board's firmware on its model, of which `program` is the path. Its sensors send the
    /// pair for ever. Returns when the board has begun to speak.
    ///
    /// # Errors
    /// Fails with one line when the pair is not of the size for which the firmware is built, when the model
    /// complains, or when the address cannot be listened at.
    pub fn modelled(
        board: &Board,
        program: &Path,
        firmware: &Path,
        pair: &Pair,
        link: Link,
    ) -> Result<Self> {
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let mut arguments = model::inputs(firmware, pair, folder.path())?;
        arguments.extend(["--serial", "stdio"].map(OsString::from));
        Self::start(board.name, program, &arguments, folder, link)
    }

    /// Starts the firmware of a board in RTL with a request for the link, of which `program` is the simulation. Its sensors
    /// send the pair for ever. Returns when the board has begun to speak.
    ///
    /// # Errors
    /// Fails with one line when the firmware is not built for the request, when the simulation complains, or when the
    /// address cannot be listened at.
    pub fn simulated(
        board: &Board,
        program: &Path,
        firmware: &Path,
        pair: &Pair,
        request: &Request,
        scenario: &Scenario,
        link: Link,
    ) -> Result<Self> {
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let inputs = simulation::inputs(board, firmware, pair, request, scenario, folder.path())?;
        Self::start(board.name, program, &inputs, folder, link)
    }

    /// Starts a program in the folder of its files, with the board's serial port at its standard input and output, and waits
    /// until the board has begun to speak.
    fn start(
        name: &'static str,
        program: &Path,
        arguments: &[OsString],
        folder: TempDir,
        link: Link,
    ) -> Result<Self> {
        let complaint = tempfile::tempfile().context("cannot make a temporary file")?;
        let spawn = |mut command: Command| {
            let stderr = complaint.try_clone()?;
            command
                .args(arguments)
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(stderr)
                .spawn()
        };
        let mut tied = Command::new("setpriv");
        tied.args(["--pdeathsig", "KILL"]).arg(program);
        let spawned = match spawn(tied) {
            Err(error) if error.kind() == ErrorKind::NotFound => spawn(Command::new(program)),
            spawned => spawned,
        };
        let mut child = spawned.with_context(|| format!("cannot run {}", program.display()))?;
        let ends = child.stdout.take().zip(child.stdin.take());
        let bridge = ends
            .context("the board has no serial port")
            .and_then(|(from, to)| Bridge::open(link.address, from, to, link.damage));
        match bridge {
            Ok(bridge) => Self {
                name,
                child,
                bridge,
                complaint,
            }
            .began(folder),
            Err(error) => {
                end(&mut child);
                Err(error)
            }
        }
    }

    /// Waits until the board has spoken, by when it has opened all files in the folder.
    fn began(mut self, folder: TempDir) -> Result<Self> {
        match self.bridge.next_event(LONGEST_START) {
            Some(Event::Spoke) => Ok(self),
            Some(Event::Ended) => {
                let report = folder.path().join(&*REPORT_FILE.to_string_lossy());
                let report = std::fs::read_to_string(report).unwrap_or_default();
                Err(match report.strip_prefix("error ") {
                    Some(reason) => anyhow!("{}: {}", self.name, reason.trim_end()),
                    None => self.failure(),
                })
            }
            None => Err(anyhow!("{} says nothing for {LONGEST_START:?}", self.name)),
        }
    }

    /// Where its link is served.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.bridge.address()
    }

    /// Waits for this long.
    ///
    /// # Errors
    /// Fails with one line when the board ends within that time, which it does not by itself.
    pub fn wait(&mut self, time: Duration) -> Result<()> {
        match self.bridge.next_event(time) {
            Some(Event::Ended) => Err(self.failure()),
            Some(Event::Spoke) | None => Ok(()),
        }
    }

    /// Why the board has ended.
    fn failure(&mut self) -> Error {
        let name = self.name;
        let status = match self.child.wait() {
            Ok(status) => status,
            Err(error) => return anyhow!("{name} has ended: {error}"),
        };
        let mut complaint = String::new();
        let read = self.complaint.seek(SeekFrom::Start(0));
        let read = read.and_then(|_| self.complaint.read_to_string(&mut complaint));
        match (read, complaint.trim_end()) {
            (Ok(_), complaint @ "") | (Err(_), complaint) => {
                anyhow!("{name} has ended with {status}{complaint}")
            }
            (Ok(_), complaint) => anyhow!("{name} has ended with {status}: {complaint}"),
        }
    }
}

impl Drop for LiveBoard {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

/// Ends a process, and waits until it has.
fn end(child: &mut Child) {
    // Both fail for one that has ended already, which is what is wanted.
    let _ = child.kill();
    let _ = child.wait();
}
