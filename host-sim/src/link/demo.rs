//! A board in this process, which looks at the built-in scene.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_core::{Config, DisparityRange, Matcher, Preset};
use vgstereo_firmware::camera::{
    ErrorKind as CameraErrorKind, ErrorType, Geometry, Layout, LinePair, LinePairSource,
    PixelFormat,
};
use vgstereo_firmware::live::{self, LinkPort, Live, Next, RamStore, Setup};
use vgstereo_firmware::{NoWatchdog, session};
use vgstereo_kernels::NativeKernels;
use vgstereo_link::{Selection, Streams};

use crate::camera::SimulatedCamera;
use crate::render::{RenderOptions, rectified_camera, render, rendered_cameras};
use crate::scene::Scene;

/// Size of the views, px, and the largest disparity: those of the real boards.
const OPTIONS: (u32, u32, u16) = (320, 240, 47);
/// Time between frames.
const FRAME_PERIOD: Duration = Duration::from_millis(100);
/// Bytes of the largest calibration that it stores, until it ends.
const CALIBRATION_BYTES_MAX: usize = 1 << 17;
/// Words of 32 bits that it has for a rectifier.
const RECTIFIER_WORDS: usize = 1 << 15;
/// Bytes that may wait on either way.
const BYTES_MAX: usize = 1 << 20;
/// For how long a read waits for bytes.
const READ_WAIT: Duration = Duration::from_millis(20);

/// Bytes on their way in one direction.
#[derive(Debug, Default)]
struct Pipe {
    bytes: Mutex<VecDeque<u8>>,
    has_come: Condvar,
}

impl Pipe {
    /// Takes as many bytes as there is room for.
    fn put(&self, bytes: &[u8]) -> usize {
        let mut waiting = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let count = bytes.len().min(BYTES_MAX - waiting.len());
        waiting.extend(&bytes[..count]);
        self.has_come.notify_one();
        count
    }

    /// Gives what has come, after so long a wait if nothing has.
    fn get(&self, bytes: &mut [u8], wait: Duration) -> usize {
        let waiting = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let is_empty = |waiting: &mut VecDeque<u8>| waiting.is_empty();
        let waited = self.has_come.wait_timeout_while(waiting, wait, is_empty);
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        // The bytes may lie in two pieces, of which a read gives one.
        waiting.read(bytes).unwrap_or_default()
    }
}

/// The two directions between board and host.
#[derive(Debug, Default)]
struct Wire {
    to_host: Pipe,
    to_board: Pipe,
    is_cut: AtomicBool,
}

/// The host's end. The board ends when it is dropped.
#[derive(Debug)]
pub struct HostEnd(Arc<Wire>);

impl Read for HostEnd {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self.0.to_host.get(bytes, READ_WAIT) {
            0 if self.0.is_cut.load(Ordering::Relaxed) => Ok(0),
            0 => Err(ErrorKind::TimedOut.into()),
            count => Ok(count),
        }
    }
}

impl Write for HostEnd {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.0.to_board.put(bytes) {
            0 => Err(ErrorKind::TimedOut.into()),
            count => Ok(count),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for HostEnd {
    fn drop(&mut self) {
        self.0.is_cut.store(true, Ordering::Relaxed);
    }
}

/// The board's end.
struct BoardEnd(Arc<Wire>);

impl LinkPort for BoardEnd {
    fn send(&mut self, bytes: &[u8]) -> usize {
        self.0.to_host.put(bytes)
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        self.0.to_board.get(bytes, Duration::ZERO)
    }
}

/// A camera whose frames begin at their time.
struct Paced {
    camera: SimulatedCamera,
    due: Instant,
}

impl ErrorType for Paced {
    type Error = CameraErrorKind;
}

impl LinePairSource for Paced {
    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn read_pair(
        &mut self,
        left: &mut [u8],
        right: &mut [u8],
    ) -> Result<LinePair, CameraErrorKind> {
        let mut pair = self.camera.read_pair(left, right)?;
        if pair.line == 0 {
            let now = Instant::now();
            thread::sleep(self.due.saturating_duration_since(now));
            self.due = self.due.max(now) + FRAME_PERIOD;
        }
        pair.timestamp_us = clock();
        Ok(pair)
    }
}

/// The time since the first call, µs.
fn clock() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let elapsed = START.get_or_init(Instant::now).elapsed();
    u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX)
}

/// Starts the board, and returns the host's end of its link.
///
/// # Errors
/// Fails when the operating system gives no thread.
pub fn start() -> Result<HostEnd> {
    let wire = Arc::new(Wire::default());
    let board = Arc::clone(&wire);
    thread::Builder::new()
        .name("demo board".to_owned())
        .spawn(move || {
            if let Err(error) = run(&board) {
                crate::terminal::note(&format!("the board of the demo has ended: {error:#}"));
            }
            board.is_cut.store(true, Ordering::Relaxed);
        })
        .context("--demo")?;
    Ok(HostEnd(wire))
}

/// Runs the board until the wire is cut. With a calibration from the host it begins anew.
fn run(wire: &Arc<Wire>) -> Result<()> {
    let (width, height, d_max) = OPTIONS;
    let options = RenderOptions {
        width,
        height,
        d_max,
        ..RenderOptions::default()
    };
    let scene = render(&options);
    let mut calibration = None;
    while !wire.is_cut.load(Ordering::Relaxed) {
        calibration = serve(wire, &options, &scene, calibration.as_deref())?;
    }
    Ok(())
}

/// Runs the board with a calibration, or without, until the host has stored one, which is returned, or the
/// wire is cut.
fn serve(
    wire: &Arc<Wire>,
    options: &RenderOptions,
    scene: &Scene,
    calibration: Option<&[u8]>,
) -> Result<Option<Vec<u8>>> {
    let camera = SimulatedCamera::new(
        scene.left.clone(),
        scene.right.clone(),
        Layout::SideBySide,
        PixelFormat::Grey8,
    )?;
    let geometry = camera.geometry();
    let preset = Preset::Micro;
    let kernels = NativeKernels::fastest();
    let config = Config::new(
        preset.parameters(),
        geometry.width,
        DisparityRange::up_to(options.d_max),
    );
    let mut memory = vec![0; config.memory_words()];
    let matcher = Matcher::new(&config, kernels, &mut memory)?;
    let mut lines = vec![0; session::memory_words(&geometry)];
    let mut packets = vec![0; live::memory_words(&geometry, &config)];
    let mut rectifier_memory = vec![0; RECTIFIER_WORDS];
    let mut rectifier = match calibration {
        Some(bytes) => Some(Rectifier::new(
            Rectification::from_bytes(bytes)?,
            config.colour,
            kernels,
            &mut rectifier_memory,
        )?),
        None => None,
    };
    let mut staging = vec![0; CALIBRATION_BYTES_MAX];
    let mut store = RamStore::new(&mut staging, RECTIFIER_WORDS);
    let setup = Setup {
        port: BoardEnd(Arc::clone(wire)),
        device: "demo",
        firmware: env!("CARGO_PKG_VERSION"),
        preset: preset.name(),
        camera: rectified_camera(&rendered_cameras(options)),
        selection: Selection::whole(Streams::DISPARITIES),
        is_started: false,
        clock,
        gap_us: 0,
        keeps_line_offsets: false,
        store: &mut store,
        memory: &mut packets,
    };
    let camera = Paced {
        camera,
        due: Instant::now(),
    };
    let rectifier = rectifier.as_mut();
    let mut live = Live::new(camera, rectifier, matcher, &mut lines, NoWatchdog, setup)?;
    while !wire.is_cut.load(Ordering::Relaxed) {
        // Every event is told over the link.
        if live.step() == Next::Calibrated {
            break;
        }
    }
    drop(live);
    Ok(store.take().map(<[u8]>::to_vec))
}
