//! A live board: it matches the lines of a file for ever, and serves the link over its serial port.

use core::convert::Infallible;

use heapless::Vec;
use semihosting::fs::File;
use semihosting::sys::arm_compat::sys_elapsed;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::rows::Arena;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::camera::OrTestPattern;
use vgstereo_firmware::live::{Live, Next, RamStore, Setup};
use vgstereo_firmware::scripted::{FaultyCamera, ScriptedFault};
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_link::{Selection, Streams};

use crate::LINES_FILE;
use crate::camera::FileCamera;
use crate::rectifier::rectifier_of;
use crate::request::{CameraRequest, MAX_FAULTS, Refusal, Request};
use crate::run::{self, Memories};
use crate::serial::{SerialPort, Uart};

/// Streams that a board sends from its start, until the host selects others.
const SELECTION: Selection = Selection::whole(Streams::DISPARITIES.with(Streams::CONFIDENCES));

/// A board's live session.
type BoardSession<'m, 'r, 's, U, K> = Live<
    'm,
    OrTestPattern<FaultyCamera<FileCamera<'r>, &'r Vec<ScriptedFault, MAX_FAULTS>>>,
    K,
    &'m mut SerialPort<U>,
    NoWatchdog,
    &'m mut RamStore<'s>,
>;

/// Serves the request until the emulator is ended: it returns only a reason not to. With a calibration
/// from the host, the session begins anew. Not inlined: neither this nor the files of other requests
/// take the other's stack.
#[inline(never)]
pub(crate) fn serve<U: Uart, K: Kernels>(
    request: &Request,
    board: &str,
    uart: U,
    kernels: K,
    memories: Memories,
) -> Result<Infallible, Refusal> {
    let mut port = SerialPort::new(uart);
    let Memories {
        lines,
        link,
        matcher,
        calibration,
        ..
    } = memories;
    let mut calibration = Calibration::new(request, calibration)?;
    // Opened once: whoever has started the board may have removed it by then.
    let file = File::open(LINES_FILE).map_err(|_| Refusal("a file cannot be opened"))?;
    loop {
        let parts = Parts {
            file: &file,
            matcher: run::matcher(request, kernels, matcher)?,
            port: &mut port,
            lines,
            memory: link,
        };
        serve_calibrated(request, board, parts, &mut calibration, kernels)?;
    }
}

/// Camera file, matcher, port and memories, of which a session is built.
struct Parts<'m, 'r, U, K> {
    file: &'r File,
    matcher: Matcher<'m, K>,
    port: &'m mut SerialPort<U>,
    lines: &'m mut [u32],
    memory: &'m mut [u32],
}

/// Serves until the host has stored a calibration.
fn serve_calibrated<U: Uart, K: Kernels>(
    request: &Request,
    board: &str,
    parts: Parts<'_, '_, U, K>,
    calibration: &mut Calibration,
    kernels: K,
) -> Result<(), Refusal> {
    let Calibration {
        bytes,
        length,
        staging,
        rectifier,
    } = calibration;
    let mut store = RamStore::new(staging, rectifier.len());
    let mut rectifier = match bytes.get(..*length) {
        Some(bytes @ [_, ..]) => Some(rectifier_of(
            bytes,
            request.config().colour,
            rectifier,
            kernels,
        )?),
        _ => None,
    };
    let mut built = session(request, board, parts, rectifier.as_mut(), &mut store);
    // By reference: a session is large, and each place that it is moved to takes stack.
    let live = match &mut built {
        Ok(live) => live,
        Err(refusal) => return Err(*refusal),
    };
    // What becomes of each pair is told over the link.
    while live.step() != Next::Calibrated {}
    drop(built);
    let stored = store.take().map(<[u8]>::len);
    if let Some(stored) = stored {
        *length = stored;
        core::mem::swap(bytes, staging);
    }
    Ok(())
}

/// Memory of the calibration in use, of one on its way from the host, and of the rectifier.
struct Calibration {
    bytes: &'static mut [u8],
    /// Bytes of the calibration in use; 0 without one.
    length: usize,
    staging: &'static mut [u8],
    rectifier: &'static mut [u32],
}

impl Calibration {
    /// Shares the memory out, a third each if nothing else is asked for, and reads the calibration of the
    /// request, if it has one.
    fn new(request: &Request, memory: &'static mut [u32]) -> Result<Self, Refusal> {
        let [_, rectifier_words] = request.calibration_words();
        let words = memory.len();
        let rectifier_words = rectifier_words.max(words / 3);
        let refusal = Refusal("the calibration does not fit the lent memory");
        let (rectifier, rest) = memory
            .split_at_mut_checked(rectifier_words)
            .ok_or(refusal)?;
        let mut arena = Arena::new(rest);
        let bytes_each = (words - rectifier_words) / 2 * size_of::<u32>();
        let mut take = || arena.take(bytes_each).map_err(|_| refusal);
        let (bytes, staging): (&mut [u8], _) = (take()?, take()?);
        let length = request
            .calibration
            .map_or(0, |stated| stated.bytes as usize);
        if length > 0 {
            run::read_calibration(bytes.get_mut(..length).ok_or(refusal)?)?;
        }
        Ok(Self {
            bytes,
            length,
            staging,
            rectifier,
        })
    }
}

/// Builds the session. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn session<'m, 'r, 's, U: Uart, K: Kernels>(
    request: &'r Request,
    board: &'m str,
    parts: Parts<'m, 'r, U, K>,
    rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
    store: &'m mut RamStore<'s>,
) -> Result<BoardSession<'m, 'r, 's, U, K>, Refusal> {
    let camera = FileCamera::new(parts.file, request.geometry, now_us);
    let camera = FaultyCamera::new(camera, &request.faults);
    let setup = Setup {
        port: parts.port,
        device: board,
        firmware: env!("CARGO_PKG_VERSION"),
        preset: request.preset.name(),
        camera: request.camera.as_ref().and_then(CameraRequest::camera),
        selection: SELECTION,
        is_started: true,
        clock: now_us,
        // The port has its own patience.
        gap_us: 0,
        keeps_line_offsets: false,
        store,
        memory: parts.memory,
    };
    let Parts { matcher, lines, .. } = parts;
    let live = Live::new(camera, rectifier, matcher, lines, NoWatchdog, setup);
    live.map_err(|_| Refusal("the session refuses the camera"))
}

/// Time since the emulator has started, µs.
fn now_us() -> u64 {
    // The emulator counts nanoseconds.
    sys_elapsed().unwrap_or(0) / 1000
}
