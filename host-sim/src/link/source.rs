//! Where the bytes of a board come from: a serial port, a TCP connection, a recording, or a board
//! that is started for it.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail, ensure};

use super::demo;
use super::recording::{Damage, Recording, is_mcap};
use crate::escapes::shown;

/// For how long [`Port::read`] waits for bytes. Commands wait no longer than this.
const READ_WAIT: Duration = Duration::from_millis(20);
/// For how long a port may take no bytes before it counts as lost.
const WRITE_WAIT: Duration = Duration::from_secs(1);
/// For how long a TCP connection may take to come about.
const CONNECT_WAIT: Duration = Duration::from_secs(5);
/// Pauses in a recording are not longer than this.
const PAUSE_MAX: Duration = Duration::from_secs(1);
/// Bytes that are read at once of a file that is played at its pace and has no times of arrival.
const PACED_BYTES: usize = 1 << 10;
/// For how long a started board may go on after its standard input has closed.
const END_WAIT: Duration = Duration::from_secs(2);

/// A source of a board's bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// A serial port.
    Serial {
        /// Its path or name.
        path: String,
        /// Bits per second.
        baud: u32,
    },
    /// A host and a port.
    Tcp(String),
    /// A recording, or bytes of the link without times of arrival.
    File {
        /// Path of the file.
        path: PathBuf,
        /// Whether it is read as fast as can be, rather than at the pace of its packets.
        is_fast: bool,
    },
    /// A board that `cargo firmware live` emulates.
    Board(String),
    /// A board in this process, before the built-in scene.
    Demo,
}

/// An open source.
#[derive(Debug)]
pub struct Port {
    input: Input,
    /// Tells when bytes come.
    clock: Clock,
    arrived_ns: Option<u64>,
    /// Whether it is a recording: it has an end, and takes no commands.
    pub is_recording: bool,
    /// The pace of a recording's packets.
    pub pace: Option<Pace>,
    /// The process of a board that was started for it.
    _board: Option<BoardProcess>,
}

/// What the bytes of a port come from.
#[derive(Debug)]
enum Input {
    /// A board, or bytes of the link in a file.
    Stream(Box<dyn Stream>),
    /// A recording.
    Recording(Box<Recording<BufReader<File>>>),
}

/// A clock of the time since 1970 that never goes back.
#[derive(Debug, Clone, Copy)]
struct Clock {
    begun: Instant,
    begun_ns: u64,
}

impl Clock {
    fn start() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            begun: Instant::now(),
            begun_ns: nanoseconds(since.unwrap_or_default()),
        }
    }

    fn now_ns(&self) -> u64 {
        self.begun_ns
            .saturating_add(nanoseconds(self.begun.elapsed()))
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Bytes in both directions.
pub trait Stream: Read + Write + Send + std::fmt::Debug {}

impl<T: Read + Write + Send + std::fmt::Debug> Stream for T {}

/// What has come of a read.
#[derive(Debug, PartialEq, Eq)]
pub enum Received {
    /// So many bytes.
    Bytes(usize),
    /// None yet.
    Nothing,
    /// There will be none any more: why.
    Ended(String),
}

impl Source {
    /// Returns the source that a name on the command line means: that of a file, of a serial port,
    /// or a host and a port.
    ///
    /// # Errors
    /// Fails with one line that names what it is not.
    pub fn parse(name: &str, baud: u32, is_fast: bool) -> Result<Self> {
        let path = PathBuf::from(name);
        if path.is_file() {
            return Ok(Self::File { path, is_fast });
        }
        ensure!(!path.is_dir(), "{} is a folder", shown(&path));
        if is_serial(name) {
            let path = name.to_owned();
            return Ok(Self::Serial { path, baud });
        }
        let port = name
            .rsplit_once(':')
            .and_then(|(_, port)| port.parse::<u16>().ok());
        ensure!(
            port.is_some(),
            "{}: there is no such file, and it is neither the path of a serial port nor HOST:PORT",
            shown(&path)
        );
        Ok(Self::Tcp(name.to_owned()))
    }

    /// Its name, for the page.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Serial { path, baud } => format!("{path}, {baud} Bd"),
            Self::Tcp(address) => address.clone(),
            Self::File { path, .. } => path.display().to_string(),
            Self::Board(name) => format!("emulated board {name}"),
            Self::Demo => "demo".to_owned(),
        }
    }

    /// Opens it.
    ///
    /// # Errors
    /// Fails with one line that names the source and the reason.
    pub fn open(&self) -> Result<Port> {
        let stream: Box<dyn Stream> = match self {
            Self::Serial { path, baud } => {
                let port = serialport::new(path, *baud).timeout(READ_WAIT).open();
                Box::new(SerialStream(port.with_context(|| path.clone())?))
            }
            Self::Tcp(address) => Box::new(connect(address)?),
            Self::File { path, is_fast } => {
                return Ok(Port {
                    is_recording: true,
                    pace: (!is_fast).then(Pace::default),
                    ..Port::of(Input::open(path).with_context(|| shown(path))?)
                });
            }
            Self::Board(name) => {
                let (board, address) = BoardProcess::start(name)?;
                let stream = Box::new(connect(&address)?);
                return Ok(Port {
                    _board: Some(board),
                    ..Port::of(Input::Stream(stream))
                });
            }
            Self::Demo => Box::new(demo::start()?),
        };
        Ok(Port::of(Input::Stream(stream)))
    }
}

impl Input {
    /// Opens a file of either kind.
    fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path)?;
        let mut head = Vec::new();
        (&mut file).take(8).read_to_end(&mut head)?;
        file.seek(SeekFrom::Start(0))?;
        if is_mcap(&head) {
            let recording = Recording::new(BufReader::new(file))?;
            return Ok(Self::Recording(Box::new(recording)));
        }
        Ok(Self::Stream(Box::new(file)))
    }
}

/// Whether a name is that of a serial port: a path below `/dev`, or one of Windows.
fn is_serial(name: &str) -> bool {
    let number = name.strip_prefix("COM").map(str::parse::<u8>);
    name.starts_with("/dev/") || name.starts_with(r"\\.\") || matches!(number, Some(Ok(_)))
}

fn connect(address: &str) -> Result<TcpStream> {
    let context = || address.to_owned();
    let mut failure = None;
    for address in address.to_socket_addrs().with_context(context)? {
        match TcpStream::connect_timeout(&address, CONNECT_WAIT) {
            Ok(stream) => {
                stream.set_nodelay(true).with_context(context)?;
                stream
                    .set_read_timeout(Some(READ_WAIT))
                    .with_context(context)?;
                stream
                    .set_write_timeout(Some(WRITE_WAIT))
                    .with_context(context)?;
                return Ok(stream);
            }
            Err(error) => failure = Some(error),
        }
    }
    match failure {
        Some(error) => Err(error).with_context(context),
        None => bail!("{address}: the host has no address"),
    }
}

/// A serial port, whose time-outs are too short to write by.
#[derive(Debug)]
struct SerialStream(Box<dyn serialport::SerialPort>);

impl Read for SerialStream {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Write for SerialStream {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let started = Instant::now();
        loop {
            match self.0.write(bytes) {
                Err(error)
                    if error.kind() == ErrorKind::TimedOut && started.elapsed() < WRITE_WAIT => {}
                written => return written,
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Port {
    fn of(input: Input) -> Self {
        Self {
            input,
            clock: Clock::start(),
            arrived_ns: None,
            is_recording: false,
            pace: None,
            _board: None,
        }
    }

    /// Reads what has come, and waits a moment if nothing has.
    pub fn read(&mut self, bytes: &mut [u8]) -> Received {
        let stream = match &mut self.input {
            Input::Stream(stream) => stream,
            Input::Recording(recording) => {
                return match recording.read(bytes) {
                    0 => Received::Ended("the recording has ended".to_owned()),
                    count => {
                        self.arrived_ns = recording.arrived_ns();
                        Received::Bytes(count)
                    }
                };
            }
        };
        let length = match &self.pace {
            Some(_) => bytes.len().min(PACED_BYTES),
            None => bytes.len(),
        };
        match stream.read(&mut bytes[..length]) {
            Ok(0) => Received::Ended("the other end has closed".to_owned()),
            Ok(count) => {
                self.arrived_ns = (!self.is_recording).then(|| self.clock.now_ns());
                Received::Bytes(count)
            }
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {
                    Received::Nothing
                }
                _ => Received::Ended(error.to_string()),
            },
        }
    }

    /// The time at which the bytes that were read last came, ns since 1970: now, or when they were
    /// recorded. `None` where it is not known, of bytes of the link in a file.
    #[must_use]
    pub fn arrived_ns(&self) -> Option<u64> {
        self.arrived_ns
    }

    /// Where a recording is no longer whole, once it was read up to there.
    #[must_use]
    pub fn damage(&self) -> Option<&Damage> {
        match &self.input {
            Input::Stream(_) => None,
            Input::Recording(recording) => recording.damage(),
        }
    }

    /// Sends bytes. To a recording, nothing is sent.
    ///
    /// # Errors
    /// Fails when they are not taken in time, or no longer can be.
    pub fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        match &mut self.input {
            Input::Stream(stream) if !self.is_recording => stream.write_all(bytes),
            _ => Ok(()),
        }
    }
}

/// The pace of recorded packets: each is due when as much time has passed as between the times at
/// which they were sent.
#[derive(Debug, Default)]
pub struct Pace {
    /// When a packet was due, and the time that it was sent at, µs.
    origin: Option<(Instant, u64)>,
    last_us: u64,
}

impl Pace {
    /// Returns for how long a packet that was sent at this time must wait at this moment. Times
    /// that run back, as after a restart of the board, and pauses of more than a second wait no
    /// longer.
    pub fn delay(&mut self, now: Instant, sent_us: u64) -> Duration {
        let pause = sent_us.checked_sub(self.last_us).map(Duration::from_micros);
        self.last_us = sent_us;
        match (self.origin, pause) {
            (Some((due, origin_us)), Some(pause)) if pause <= PAUSE_MAX => {
                let since = Duration::from_micros(sent_us.saturating_sub(origin_us));
                (due + since).saturating_duration_since(now)
            }
            _ => {
                self.origin = Some((now, sent_us));
                Duration::ZERO
            }
        }
    }
}

/// The process of an emulated board, which ends when this is dropped.
#[derive(Debug)]
struct BoardProcess(Child);

impl BoardProcess {
    /// Builds and starts a board, and returns the address of its link.
    fn start(name: &str) -> Result<(Self, String)> {
        let command = format!("cargo firmware live --board {name}");
        let child = Command::new("cargo")
            .args(["firmware", "live", "--board", name])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| command.clone())?;
        let mut process = Self(child);
        let output = process.0.stdout.take().with_context(|| command.clone())?;
        let mut lines = BufReader::new(output).lines().map_while(Result::ok);
        let address = lines.find_map(|line| line.strip_prefix("link ").map(str::to_owned));
        let Some(address) = address else {
            bail!("{command} ended before it told the address of its link");
        };
        // What else it says must not fill the pipe, which would stop it.
        thread::spawn(move || lines.for_each(drop));
        Ok((process, address.trim().to_owned()))
    }
}

impl Drop for BoardProcess {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let started = Instant::now();
        while started.elapsed() < END_WAIT {
            if !matches!(self.0.try_wait(), Ok(None)) {
                return;
            }
            thread::sleep(READ_WAIT);
        }
        // It may have ended in between.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The serial ports of this machine, a line each, for whoever has named none.
#[must_use]
pub fn serial_ports() -> Vec<String> {
    let ports = serialport::available_ports().unwrap_or_default();
    ports.into_iter().map(|port| port.port_name).collect()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn names_mean_files_ports_or_addresses() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording:7");
        std::fs::write(&path, [0]).unwrap();
        let parse = |name: &str| Source::parse(name, 9600, true);
        let name = path.to_str().unwrap();
        assert_eq!(
            parse(name).unwrap(),
            Source::File {
                path: path.clone(),
                is_fast: true
            }
        );
        let serial = |path: &str| Source::Serial {
            path: path.to_owned(),
            baud: 9600,
        };
        assert_eq!(parse("/dev/ttyACM7").unwrap(), serial("/dev/ttyACM7"));
        assert_eq!(parse("COM3").unwrap(), serial("COM3"));
        assert_eq!(
            parse("[::1]:7000").unwrap(),
            Source::Tcp("[::1]:7000".to_owned())
        );
        for wrong in [
            "nowhere.bin",
            "host",
            "host:port",
            "host:70000",
            folder.path().to_str().unwrap(),
        ] {
            let error = parse(wrong).unwrap_err().to_string();
            assert!(error.contains(wrong), "{error}");
        }
    }

    #[test]
    fn recorded_packets_are_due_as_they_were_sent() {
        let mut pace = Pace::default();
        let start = Instant::now();
        let ms = Duration::from_millis;
        assert_eq!(pace.delay(start, 5_000_000), ms(0));
        assert_eq!(pace.delay(start, 5_040_000), ms(40));
        assert_eq!(pace.delay(start + ms(40), 5_090_000), ms(50));
        // Late already: no wait, and no drift.
        assert_eq!(pace.delay(start + ms(200), 5_100_000), ms(0));
        assert_eq!(pace.delay(start + ms(200), 5_250_000), ms(50));
        // A restart and a long pause begin anew.
        assert_eq!(pace.delay(start + ms(300), 10), ms(0));
        assert_eq!(pace.delay(start + ms(300), 30_010), ms(30));
        assert_eq!(pace.delay(start + ms(400), 90_000_000), ms(0));
        assert_eq!(pace.delay(start + ms(400), 90_007_000), ms(7));
    }

    #[test]
    fn tcp_is_read_without_waiting_for_long_and_its_end_is_told() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let source = Source::Tcp(listener.local_addr().unwrap().to_string());
        let mut port = source.open().unwrap();
        let (mut board, _) = listener.accept().unwrap();
        let mut bytes = [0; 8];
        assert_eq!(port.read(&mut bytes), Received::Nothing);
        board.write_all(b"abc").unwrap();
        assert_eq!(port.read(&mut bytes), Received::Bytes(3));
        port.write(b"xy").unwrap();
        board.read_exact(&mut bytes[..2]).unwrap();
        assert_eq!(&bytes[..2], b"xy");
        drop(board);
        assert!(matches!(port.read(&mut bytes), Received::Ended(_)));
        drop(listener);
        let error = format!("{:#}", source.open().unwrap_err());
        assert!(error.starts_with(&source.name()), "{error}");
    }
}
