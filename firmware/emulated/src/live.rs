//! A live board: it matches the lines of a file for ever, and serves the link over its serial port.

use core::convert::Infallible;

use semihosting::fs::File;
use semihosting::sys::arm_compat::sys_elapsed;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::live::{Live, Next, NoStore, Setup};
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_link::{Selection, Streams};

use crate::camera::FileCamera;
use crate::request::{CameraRequest, Request};
use crate::run::Refusal;
use crate::serial::{SerialPort, Uart};

/// What is sent until the host asks for something else.
const SELECTION: Selection = Selection {
    streams: Streams::DISPARITIES.with(Streams::CONFIDENCES),
    every_frames: 1,
    region: None,
};

/// What a live board is built of, besides a request.
pub(crate) struct Parts<'m, U, K> {
    /// The board's name.
    pub(crate) name: &'static str,
    /// The port to the host.
    pub(crate) uart: U,
    /// The open [`LINES_FILE`](crate::LINES_FILE).
    pub(crate) file: File,
    /// The rectifier, if lines are not rectified.
    pub(crate) rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
    pub(crate) kernels: K,
    /// Memory of the matcher, which is built here: a second place for one would be stack.
    pub(crate) memory: &'m mut [u32],
    /// Memory of the session.
    pub(crate) lines: &'m mut [u32],
    /// Memory of [`Request::link_words`].
    pub(crate) link: &'m mut [u32],
}

/// Serves the request until the emulator is ended: it returns only a reason not to. Not inlined, so that
/// other requests do not take its stack.
#[inline(never)]
pub(crate) fn serve<U: Uart, K: Kernels>(
    request: &Request,
    board: Parts<'_, U, K>,
) -> Result<Infallible, Refusal> {
    let camera = FileCamera::new(board.file, request.geometry, now_us);
    let camera = FaultyCamera::new(camera, &request.faults);
    let setup = Setup {
        port: SerialPort::new(board.uart),
        device: board.name,
        firmware: env!("CARGO_PKG_VERSION"),
        preset: request.preset.name(),
        camera: request.camera.as_ref().and_then(CameraRequest::camera),
        calibration: board
            .rectifier
            .as_ref()
            .map(|rectifier| rectifier.rectification().bytes()),
        selection: SELECTION,
        is_started: true,
        clock: now_us,
        // The port has its own patience.
        gap_us: 0,
        store: NoStore,
        memory: board.link,
    };
    let matcher = Matcher::new(&request.config(), board.kernels, board.memory);
    let matcher = matcher.map_err(|_| Refusal("the matcher refuses the configuration"))?;
    let (rectifier, lines) = (board.rectifier, board.lines);
    let live = Live::new(camera, rectifier, matcher, lines, NoWatchdog, setup);
    let mut live = live.map_err(|_| Refusal("the session refuses the camera"))?;
    loop {
        match live.step() {
            // What becomes of each pair is told over the link.
            Next::Event(_) => {}
            Next::Calibrated => return Err(Refusal("no calibration can be stored")),
        }
    }
}

/// Time since the emulator has started, µs.
fn now_us() -> u64 {
    // The emulator counts nanoseconds.
    sys_elapsed().unwrap_or(0) / 1000
}
