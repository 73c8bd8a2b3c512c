//! Run of a board: parses the request, matches its frames and writes the report.

use core::fmt::{self, Write};
use core::mem::MaybeUninit;

use defmt_semihosting as _;
use semihosting::fs::File;
use semihosting::process;
use semihosting::sys::arm_compat::sys_get_cmdline_uninit;
use vgstereo_core::geometry::{LaserScan, Rectification, Rectifier};
use vgstereo_core::rows::Arena;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::session::{self, ATTEMPT_FRAMES};
use vgstereo_firmware::sink::{BothSinks, ScanningSink};
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_firmware::{Event, Session, Statistics};

use crate::camera::{self, FileCamera};
use crate::live::{self, Parts};
use crate::meter::{Counter, Meter, Metered, Stage};
use crate::report::Report;
use crate::request::{Calibration, Request};
use crate::serial::Uart;
use crate::sink::{self, FileSink, PacketSink, ScanFile};
use crate::stack::Stack;
use crate::{
    CALIBRATION_FILE, CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE, REPORT_FILE, SCANS_FILE,
};

/// Largest length of the command line, bytes.
const COMMAND_LINE_BYTES: usize = 1024;

/// What a board brings.
#[derive(Debug)]
pub struct Board<C, U, K> {
    /// The board's name.
    pub name: &'static str,
    /// Counts instructions.
    pub counter: C,
    /// The port to the host.
    pub uart: U,
    /// The kernels of the processor.
    pub kernels: K,
    /// Memory for session and matcher.
    pub memory: &'static mut [u32],
    /// The stack, painted.
    pub stack: Stack,
}

/// Serves the request on the command line, writes the report, and ends the emulation. A board that is
/// live serves the link instead, and never ends.
pub fn run<C: Counter, U: Uart, K: Kernels>(board: Board<C, U, K>) -> ! {
    let stack = board.stack;
    let Ok(file) = File::create(REPORT_FILE) else {
        process::exit(1);
    };
    let mut text = Text(file);
    let written = match serve(board) {
        Ok(report) => write!(
            text,
            "{}",
            Report {
                stack_bytes: stack.worst_bytes() as u32,
                ..report
            }
        ),
        Err(Refusal(reason)) => writeln!(text, "error {reason}"),
    };
    process::exit(written.is_err().into())
}

/// Reason for which a request is not served.
pub(crate) struct Refusal(pub(crate) &'static str);

fn serve<C: Counter, U: Uart, K: Kernels>(board: Board<C, U, K>) -> Result<Report, Refusal> {
    let (kernels, memory) = (board.kernels, board.memory);
    let request = read_request().ok_or(Refusal("the command line is not a request"))?;
    let geometry = request.geometry;
    let config = request.config();
    let meter = Meter::new(board.counter);
    let line_words = session::memory_words(&geometry);
    let (lines, memory) = memory
        .split_at_mut_checked(line_words)
        .ok_or(Refusal("the lines do not fit the lent memory"))?;
    let [rectification_words, rectifier_words] = request.calibration_words();
    let (calibration, memory) = memory
        .split_at_mut_checked(rectification_words + rectifier_words)
        .ok_or(Refusal("the calibration does not fit the lent memory"))?;
    let scan_words = request.scan.map_or(0, |scan| scan.words());
    let (scan, memory) = memory
        .split_at_mut_checked(scan_words)
        .ok_or(Refusal("the scan does not fit the lent memory"))?;
    let (link, memory) = memory
        .split_at_mut_checked(request.link_words())
        .ok_or(Refusal("the link does not fit the lent memory"))?;
    // The packets of the link, whose cost is measured where they have room beside the rest.
    let matcher_words = config.memory_words();
    let (memory, packet) = memory.split_at_mut(matcher_words.min(memory.len()));
    let kernels = Metered::new(kernels, &meter);
    let mut rectifier = match request.calibration {
        Some(stated) => Some(rectifier(stated, &request, calibration, kernels)?),
        None => None,
    };
    let rectifier = rectifier.as_mut();

    let file_error = |_| Refusal("a file cannot be opened");
    let file = File::open(LINES_FILE).map_err(file_error)?;
    if request.is_live {
        let board = Parts {
            name: board.name,
            uart: board.uart,
            file,
            rectifier,
            kernels,
            memory,
            lines,
            link,
        };
        return live::serve(&request, board).map(|never| match never {});
    }
    let matcher = Matcher::new(&config, kernels, memory);
    let matcher = matcher.map_err(|_| Refusal("the matcher refuses the configuration"))?;
    // No file has a time in it.
    let camera = FileCamera::new(file, geometry, || 0);
    let camera = FaultyCamera::new(camera, &request.faults);
    let sink = FileSink::new(
        File::create(DISPARITIES_FILE).map_err(file_error)?,
        File::create(CONFIDENCES_FILE).map_err(file_error)?,
    );
    let camera = Metered::new(camera, &meter);
    // What a scan takes of lines is not files' time.
    let sink = Metered::new(sink, &meter);
    let sink = BothSinks::new(sink, PacketSink::new(packet, config.width, &meter));
    let sink = BothSinks::new(sink, scanner(&request, scan)?);
    let session = Session::rectifying(camera, rectifier, matcher, sink, lines, NoWatchdog);
    let mut session = session.map_err(|_| Refusal("the session refuses the camera"))?;

    let reads = request.frames.saturating_add(request.faults.len() as u32);
    let reads = reads.saturating_mul(ATTEMPT_FRAMES * geometry.height);
    let mut frames = 0;
    for _ in 0..reads {
        if frames == request.frames {
            break;
        }
        let event = meter.measure(Stage::ChecksAndRest, || session.step());
        if let Event::FrameDone { frame } = event.map_err(|_| Refusal("the sink failed"))? {
            frames += 1;
            log_frame(frame, session.statistics());
        }
    }
    Ok(Report {
        statistics: session.statistics(),
        instructions: meter.instructions(),
        working_bytes: request.working_bytes() as u32,
        stack_bytes: 0,
    })
}

/// Reads the rectification into `memory`, and builds the rectifier behind it. Not inlined, so that its
/// stack is free again while frames are matched.
#[inline(never)]
fn rectifier<K: Kernels>(
    stated: Calibration,
    request: &Request,
    memory: &'static mut [u32],
    kernels: K,
) -> Result<Rectifier<'static, 'static, K>, Refusal> {
    let [words, _] = request.calibration_words();
    let (bytes, memory) = memory
        .split_at_mut_checked(words)
        .ok_or(Refusal("the rectification does not fit the lent memory"))?;
    let bytes: &'static mut [u8] = Arena::new(bytes)
        .take(stated.bytes as usize)
        .map_err(|_| Refusal("the rectification does not fit the lent memory"))?;
    let unreadable = Refusal("the rectification cannot be read");
    let file = File::open(CALIBRATION_FILE).map_err(|_| Refusal("there is no rectification"))?;
    camera::read_exactly(&file, bytes).map_err(|_| unreadable)?;
    let rectification =
        Rectification::from_bytes(bytes).map_err(|_| Refusal("the rectification is not valid"))?;
    let colour = request.config().colour;
    Rectifier::new(rectification, colour, kernels, memory)
        .map_err(|_| Refusal("the rectifier does not fit the lent memory"))
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
    let mut buffer = [MaybeUninit::uninit(); COMMAND_LINE_BYTES];
    let words = sys_get_cmdline_uninit(&mut buffer).ok()?;
    let words = core::str::from_utf8(words).ok()?;
    // The first word is the program's name.
    let (_, words) = words.split_once(' ')?;
    words.parse().ok()
}

/// A file to which formatted text can be written.
struct Text(File);

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        sink::write(&mut self.0, text.as_bytes()).map_err(|_| fmt::Error)
    }
}
