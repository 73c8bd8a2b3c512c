//! A live board: it matches the lines of a file for ever, and serves the link over its serial port.

use core::convert::Infallible;

use heapless::Vec;
use semihosting::fs::File;
use semihosting::sys::arm_compat::sys_elapsed;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::camera::OrTestPattern;
use vgstereo_firmware::live::{Live, Next, NoStore, Setup};
use vgstereo_firmware::scripted::{FaultyCamera, ScriptedFault};
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_link::{Selection, Streams};

use crate::LINES_FILE;
use crate::camera::FileCamera;
use crate::request::{CameraRequest, MAX_FAULTS, Request};
use crate::run::{self, Memories, Refusal};
use crate::serial::{SerialPort, Uart};

/// Streams that a board sends from its start, until the host selects others.
const SELECTION: Selection = Selection::whole(Streams::DISPARITIES.with(Streams::CONFIDENCES));

/// A board's live session.
type BoardSession<'m, 'r, U, K> = Live<
    'm,
    OrTestPattern<FaultyCamera<FileCamera, &'r Vec<ScriptedFault, MAX_FAULTS>>>,
    K,
    SerialPort<U>,
    NoWatchdog,
>;

/// Serves the request until the emulator is ended: it returns only a reason not to. Not inlined: neither
/// this nor the files of other requests take the other's stack.
#[inline(never)]
pub(crate) fn serve<U: Uart, K: Kernels>(
    request: &Request,
    board: &str,
    uart: U,
    kernels: K,
    memories: Memories,
) -> Result<Infallible, Refusal> {
    let matcher = run::matcher(request, kernels, memories.matcher)?;
    let mut rectifier = run::rectifier(request, memories.calibration, kernels)?;
    let parts = (matcher, rectifier.as_mut());
    let link = (SerialPort::new(uart), memories.link);
    let mut built = session(request, board, parts, memories.lines, link);
    // By reference: a session is large, and each place that it is moved to takes stack.
    let live = match &mut built {
        Ok(live) => live,
        Err(refusal) => return Err(*refusal),
    };
    loop {
        match live.step() {
            // What becomes of each pair is told over the link.
            Next::Event(_) => {}
            Next::Calibrated => return Err(Refusal("no calibration can be stored")),
        }
    }
}

/// Builds the session. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn session<'m, 'r, U: Uart, K: Kernels>(
    request: &'r Request,
    board: &'m str,
    (matcher, rectifier): (Matcher<'m, K>, Option<&'m mut Rectifier<'m, 'm, K>>),
    lines: &'m mut [u32],
    (port, memory): (SerialPort<U>, &'m mut [u32]),
) -> Result<BoardSession<'m, 'r, U, K>, Refusal> {
    let file = File::open(LINES_FILE).map_err(|_| Refusal("a file cannot be opened"))?;
    let camera = FileCamera::new(file, request.geometry, now_us);
    let camera = FaultyCamera::new(camera, &request.faults);
    let setup = Setup {
        port,
        device: board,
        firmware: env!("CARGO_PKG_VERSION"),
        preset: request.preset.name(),
        camera: request.camera.as_ref().and_then(CameraRequest::camera),
        calibration: rectifier
            .as_ref()
            .map(|rectifier| rectifier.rectification().bytes()),
        selection: SELECTION,
        is_started: true,
        clock: now_us,
        // The port has its own patience.
        gap_us: 0,
        store: NoStore,
        memory,
    };
    let live = Live::new(camera, rectifier, matcher, lines, NoWatchdog, setup);
    live.map_err(|_| Refusal("the session refuses the camera"))
}

/// Time since the emulator has started, µs.
fn now_us() -> u64 {
    // The emulator counts nanoseconds.
    sys_elapsed().unwrap_or(0) / 1000
}
