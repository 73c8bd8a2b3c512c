//! `vgstereo replay`: plays a recording to whatever reads a board, or takes its bytes out.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use indicatif::HumanBytes;
use vgstereo_link::{BoardMessage, Packet};

use crate::cameras::SeenWith;
use crate::escapes::shown;
use crate::files::{ensure_distinct_outputs, write_gradually};
use crate::link::attended::{Attended, Observer};
use crate::link::client::Memory;
use crate::link::exporter::Exporter;
use crate::link::source::{Pace, Source};
use crate::link::tally::Tally;
use crate::terminal::{Interrupts, Said, spinner, write_output};

/// For how long a host may take no bytes, or not close a connection that has ended.
const HOST_WAIT: Duration = Duration::from_secs(10);

/// The arguments of `vgstereo replay`.
#[derive(Debug, Args)]
#[command(
    after_help = "Without --out or --mcap, the recording is played to the first host that connects to --listen, once, and the \
    command ends with it. Commands of the host are not answered. A recording that is cut or damaged is played as far \
    as it is whole, and where that is stands at the end.\n\n\
    To a host:          vgstereo replay walk.mcap, and elsewhere: vgstereo view 127.0.0.1:7000\n\
    The plain bytes:    vgstereo replay walk.mcap --out walk.bin\n\
    For Foxglove:       vgstereo replay walk.mcap --mcap foxglove.mcap\n\
    To another program: vgstereo replay walk.mcap --out - | python3 tools/link_decoder.py /dev/stdin"
)]
pub struct Replay {
    /// Recording of `vgstereo record`, or plain bytes of the link.
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// Play as fast as it is taken, rather than at the pace at which the bytes came.
    #[arg(long)]
    fast: bool,
    /// Address on this machine at which a host finds the board; port 0 takes a free one.
    #[arg(
        long,
        value_name = "ADDRESS",
        default_value = "127.0.0.1:7000",
        conflicts_with_all = ["out", "mcap"]
    )]
    listen: SocketAddr,
    /// Write the bytes of the link as they came to this file, or - for standard output.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fast", "mcap"])]
    out: Option<PathBuf>,
    /// Write images, depths, clouds, scans and the log as messages of Foxglove's schemas to this file, for
    /// Foxglove and the tools of ROS 2.
    #[arg(long, value_name = "FILE", conflicts_with = "fast")]
    mcap: Option<PathBuf>,
    #[command(flatten)]
    seen_with: SeenWith,
}

/// Takes bytes as they were recorded.
struct Player<'w> {
    output: &'w mut (dyn Write + Send),
    pace: Option<Pace>,
    interrupts: Option<&'w Interrupts>,
    bytes: u64,
}

impl std::fmt::Debug for Player<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Player")
            .field("bytes", &self.bytes)
            .finish_non_exhaustive()
    }
}

impl Player<'_> {
    /// Waits until what came or was sent at this time is due.
    fn wait(&mut self, time_us: u64) {
        if let Some(pace) = &mut self.pace {
            thread::sleep(pace.delay(Instant::now(), time_us));
        }
    }
}

impl Observer for Player<'_> {
    fn bytes(&mut self, arrived_ns: Option<u64>, bytes: &[u8]) -> Result<()> {
        if let Some(arrived_ns) = arrived_ns {
            self.wait(arrived_ns / 1000);
        }
        let interrupts = self.interrupts;
        ensure!(
            !interrupts.is_some_and(Interrupts::have_come),
            "interrupted"
        );
        self.output.write_all(bytes)?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    fn packet(&mut self, arrived_ns: Option<u64>, packet: &Packet<BoardMessage<'_>>) -> Result<()> {
        // Where no times of arrival are known, those of sending serve.
        if arrived_ns.is_none() {
            self.wait(packet.timestamp_us);
        }
        Ok(())
    }
}

impl Replay {
    /// Plays the recording and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that names the option or file and the reason.
    pub fn run(self) -> Result<Said> {
        let name = shown(&self.recording);
        ensure!(self.recording.is_file(), "{name}: there is no such file");
        let mut inputs = vec![self.recording.as_path()];
        inputs.extend(self.seen_with.files());
        if let Some(path) = self.mcap.as_deref() {
            ensure_distinct_outputs(&inputs, &[path]).context("--mcap")?;
            return self.export(path).map(Into::into);
        }
        ensure!(inputs.len() == 1, "--calibration is for --mcap");
        match self.out.as_deref() {
            None => self.serve(),
            Some(path) if path == Path::new("-") => {
                let text = self.play(&mut std::io::stdout(), None, None)?;
                Ok(Said::Aside(text))
            }
            Some(path) => {
                ensure_distinct_outputs(&inputs, &[path]).context("--out")?;
                let interrupts = Interrupts::heeded();
                let text = write_gradually(path, |file| self.play(file, None, Some(&interrupts)))?;
                Ok(format!("wrote {}: {text}", shown(path)).into())
            }
        }
    }

    /// Makes messages of the recording and returns what to print.
    fn export(&self, path: &Path) -> Result<String> {
        let calibrated = self.seen_with.camera()?;
        let interrupts = Interrupts::heeded();
        write_gradually(path, |file| {
            let mut exporter = Exporter::new(file, calibrated)?;
            let mut memory = Memory::default();
            let text = {
                let observer: &mut dyn Observer = &mut exporter;
                let mut board = Attended::observed(&self.source(), &mut memory, Some(observer))?;
                let bar = spinner();
                while board.frame()?.is_some() {
                    ensure!(!interrupts.have_come(), "interrupted");
                    bar.set_message(Tally::of(&board).frames.whole.to_string() + " frames");
                    bar.tick();
                }
                bar.finish_and_clear();
                self.told(&board)
            };
            let told = exporter.finish()?;
            Ok(format!("wrote {}: {told}\n{text}", shown(path)))
        })
    }

    /// Plays the recording to the first host that connects.
    fn serve(&self) -> Result<Said> {
        let listener = listen(self.listen)?;
        // Refused before a host is waited for.
        self.source().open()?;
        write_output(format!("link {}\n", listener.local_addr()?).as_bytes())?;
        let (mut host, _) = listener.accept()?;
        host.set_nodelay(true)?;
        host.set_write_timeout(Some(HOST_WAIT))?;
        host.set_read_timeout(Some(HOST_WAIT))?;
        let has_ended = Arc::new(AtomicBool::new(false));
        let (heard, ended) = (host.try_clone()?, Arc::clone(&has_ended));
        let commands = thread::spawn(move || forget_commands(heard, &ended));
        let pace = (!self.fast).then(Pace::default);
        let played = self.play(&mut host, pace, None);
        if played.is_ok() {
            // The host reads to the end, and closes its own end in turn.
            host.shutdown(Shutdown::Write)?;
            has_ended.store(true, Ordering::Relaxed);
            let _ = commands.join();
        }
        Ok(played.context("the host is lost")?.into())
    }

    fn source(&self) -> Source {
        Source::File {
            path: self.recording.clone(),
            is_fast: self.fast || self.out.is_some() || self.mcap.is_some(),
        }
    }

    /// Plays the recording to `output`, and returns what it had.
    fn play(
        &self,
        output: &mut (dyn Write + Send),
        pace: Option<Pace>,
        interrupts: Option<&Interrupts>,
    ) -> Result<String> {
        let mut memory = Memory::default();
        let mut player = Player {
            output,
            pace,
            interrupts,
            bytes: 0,
        };
        let text = {
            let mut board = Attended::observed(&self.source(), &mut memory, Some(&mut player))?;
            while board.frame()?.is_some() {}
            self.told(&board)
        };
        Ok(format!("{} of the link\n{text}", HumanBytes(player.bytes)))
    }

    /// What the recording had, in words.
    fn told(&self, board: &Attended<'_>) -> String {
        let name = shown(&self.recording);
        let mut text = format!("{}\n", Tally::of(board));
        if let Some(damage) = board.client().damage() {
            text += &format!("{name} is damaged: {damage}\n");
        }
        text
    }
}

/// Opens the address at which the board is to be found.
fn listen(address: SocketAddr) -> Result<TcpListener> {
    ensure!(
        address.ip().is_loopback(),
        "--listen {address}: a recording is played to this machine alone: use 127.0.0.1 or [::1]"
    );
    TcpListener::bind(address).with_context(|| format!("--listen {address}"))
}

/// Takes what a host sends until it closes: what it has sent and no one took would end the connection
/// before its time. Once the recording has ended, a host that is silent is not waited for.
fn forget_commands(mut host: TcpStream, has_ended: &AtomicBool) {
    let mut bytes = [0; 1024];
    loop {
        match host.read(&mut bytes) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) => match error.kind() {
                ErrorKind::Interrupted => {}
                ErrorKind::TimedOut | ErrorKind::WouldBlock
                    if !has_ended.load(Ordering::Relaxed) => {}
                _ => return,
            },
        }
    }
}
