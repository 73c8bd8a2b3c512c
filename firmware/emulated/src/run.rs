//! Run of a board: parses the request, matches its frames and writes the report.

use core::convert::Infallible;

use defmt_semihosting as _;
use semihosting::fs::File;
use semihosting::sys::arm_compat::sys_elapsed;
use vgstereo_core::geometry::{LaserScan, Rectifier};
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::sink::{BothSinks, ScanningSink};
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_firmware::{DisparitySink, Session, Statistics};

use crate::board::{Board, of_command_line, report};
use crate::camera::{self, FileCamera};
use crate::live::{self, Device};
use crate::memories::Memories;
use crate::memory;
use crate::meter::{Counter, Meter, Metered};
use crate::rectifier::rectifier;
use crate::report::Report;
use crate::request::{Refusal, Request};
use crate::serial::{SerialPort, Uart};
use crate::sink::{FileSink, PacketSink, ScanFile};
use crate::task::Task;
use crate::{CALIBRATION_FILE, CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE, SCANS_FILE};

/// Serves the request on the command line, writes the report, and ends the emulation. A board that is
/// live serves the link instead, and never ends.
pub fn run<C: Counter, U: Uart, K: Kernels>(board: Board<C, U, K>) -> ! {
    report(board.stack, || serve(board))
}

/// Not inlined, so that what is only there before frames are matched does not take stack then.
#[inline(never)]
fn serve<C: Counter, U: Uart, K: Kernels>(board: Board<C, U, K>) -> Result<Report, Refusal> {
    if !memory::is_moved_rightly(board.memory) {
        return Err(Refusal("the functions that copy and fill memory are wrong"));
    }
    let request = read_request().ok_or(Refusal("the command line is not a request"))?;
    let memories = Memories::new(&request, board.memory)?;
    let meter = Meter::new(board.counter);
    let kernels = Metered::new(board.kernels, &meter);
    if request.is_live {
        let live = with_link(&request, board.name, board.uart, kernels, memories);
        return live.map(|never| match never {});
    }
    with_files(&request, &meter, kernels, memories)
}

/// Serves the link, until the emulator is ended.
fn with_link<U: Uart, K: Kernels>(
    request: &Request,
    name: &'static str,
    uart: U,
    kernels: K,
    memories: Memories,
) -> Result<Infallible, Refusal> {
    // Opened once: whoever has started the board may have removed it by then.
    let file = File::open(LINES_FILE).map_err(|_| Refusal("a file cannot be opened"))?;
    let camera = FileCamera::new(&file, request.geometry, now_us);
    let mut camera = FaultyCamera::new(camera, &request.faults);
    let device = Device {
        name,
        kernels,
        matcher,
        read_calibration,
        port: SerialPort::new(uart),
        watchdog: NoWatchdog,
        clock: now_us,
    };
    live::serve(request, device, &mut camera, memories, || None::<&str>)
}

/// Time since the emulator has started, µs.
fn now_us() -> u64 {
    // The emulator counts nanoseconds.
    sys_elapsed().unwrap_or(0) / 1000
}

/// Matches the frames of the request between files. Not inlined: neither this nor the link takes the
/// other's stack.
#[inline(never)]
fn with_files<C: Counter, K: Kernels>(
    request: &Request,
    meter: &Meter<C>,
    kernels: K,
    memories: Memories,
) -> Result<Report, Refusal> {
    let matcher = matcher(request, kernels, memories.matcher);
    let mut rectifier = rectifier(request, memories.calibration, kernels, read_calibration)?;
    let file_error = |_| Refusal("a file cannot be opened");
    let file = File::open(LINES_FILE).map_err(file_error)?;
    // No file has a time in it.
    let camera = FileCamera::new(&file, request.geometry, || 0);
    let camera = FaultyCamera::new(camera, &request.faults);
    let sink = FileSink::new(
        File::create(DISPARITIES_FILE).map_err(file_error)?,
        File::create(CONFIDENCES_FILE).map_err(file_error)?,
    );
    let camera = Metered::new(camera, meter);
    // What a scan takes of lines is not files' time.
    let sink = Metered::new(sink, meter);
    let sink = BothSinks::new(sink, PacketSink::new(memories.rest, request.width(), meter));
    let sink = BothSinks::new(sink, scanner(request, memories.scan)?);
    let mut session = session(camera, rectifier.as_mut(), matcher, sink, memories.lines);
    // Used where it is: moved out, it would take the stack twice.
    let session = match &mut session {
        Ok(session) => session,
        Err(refusal) => return Err(*refusal),
    };

    let task = Task {
        frames: request.frames,
        faults: request.faults.len() as u32,
        height: request.geometry.height,
    };
    let matched = task.run(session, meter, log_frame);
    matched.map_err(|_| Refusal("the sink failed"))?;
    Ok(Report {
        statistics: session.statistics(),
        instructions: meter.instructions(),
        working_bytes: request.working_bytes() as u32,
        stack_bytes: 0,
    })
}

/// Builds the session, with the matcher if it was built. Not inlined, so that its stack, through which the matcher is
/// moved, is free again while frames are matched.
#[inline(never)]
fn session<'m, C: LinePairSource, K: Kernels, S: DisparitySink>(
    camera: C,
    rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
    matcher: Result<Matcher<'m, K>, Refusal>,
    sink: S,
    lines: &'m mut [u32],
) -> Result<Session<'m, C, K, S>, Refusal> {
    let session = Session::rectifying(camera, rectifier, matcher?, sink, lines, NoWatchdog);
    session.map_err(|_| Refusal("the session refuses the camera"))
}

/// Builds the matcher. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn matcher<'m, K: Kernels>(
    request: &Request,
    kernels: K,
    memory: &'m mut [u32],
) -> Result<Matcher<'m, K>, Refusal> {
    let matcher = Matcher::new(&request.config(), kernels, memory);
    matcher.map_err(|_| Refusal("the matcher refuses the configuration"))
}

/// Reads the file of the rectification, which has as many bytes.
fn read_calibration(bytes: &mut [u8]) -> Result<(), Refusal> {
    let file = File::open(CALIBRATION_FILE).map_err(|_| Refusal("there is no rectification"))?;
    camera::read_exactly(&file, bytes).map_err(|_| Refusal("the rectification cannot be read"))
}

/// Builds the sink of the scans, if the request has one. Not inlined, so that its stack is free again
/// while frames are matched.
#[inline(never)]
fn scanner(
    request: &Request,
    memory: &'static mut [u32],
) -> Result<Option<ScanningSink<'static, ScanFile>>, Refusal> {
    let Some(stated) = request.scan else {
        return Ok(None);
    };
    let config = stated.config(request.width());
    let config = config.ok_or(Refusal("there is no camera for the scan"))?;
    let scan = LaserScan::new(&config, memory);
    let scan = scan.map_err(|_| Refusal("the scan cannot be made as configured"))?;
    let file = File::create(SCANS_FILE).map_err(|_| Refusal("a file cannot be opened"))?;
    Ok(Some(ScanningSink::new(scan, ScanFile::new(file))))
}

/// Logs each number by itself: the logger asserts, and formatting the whole statistics would be
/// counted among the pipeline's assertions.
fn log_frame(frame: u32, statistics: Statistics) {
    defmt::info!(
        "frame {=u32}: {=u32} lines so far, {=u32} dropped; {=u32} frames dropped",
        frame,
        statistics.lines,
        statistics.lines_dropped,
        statistics.frames_dropped
    );
}

/// Reads the command line. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn read_request() -> Option<Request> {
    of_command_line(|words| words.parse().ok())
}
