//! Run of a board: parses the request, matches its frames and writes the report.

use defmt_semihosting as _;
use semihosting::fs::File;
use vgstereo_core::geometry::{LaserScan, Rectifier};
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::session;
use vgstereo_firmware::sink::{BothSinks, ScanningSink};
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_firmware::{DisparitySink, Session, Statistics};

use crate::board::{Board, of_command_line, report};
use crate::camera::{self, FileCamera};
use crate::live;
use crate::memory;
use crate::meter::{Counter, Meter, Metered};
use crate::rectifier::rectifier;
use crate::report::Report;
use crate::request::{Refusal, Request};
use crate::serial::Uart;
use crate::sink::{FileSink, PacketSink, ScanFile};
use crate::task::Task;
use crate::{CALIBRATION_FILE, CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE, SCANS_FILE};

/// Serves the request on the command line, writes the report, and ends the emulation. A board that is
/// live serves the link instead, and never ends.
pub fn run<C: Counter, U: Uart, K: Kernels>(board: Board<C, U, K>) -> ! {
    report(board.stack, || serve(board))
}

/// Parts of the lent memory, each as large as the request needs it.
pub(crate) struct Memories {
    /// The session's lines.
    pub(crate) lines: &'static mut [u32],
    /// The rectification, and the rectifier behind it. If the board is live, all that the rest leaves, for
    /// a calibration from the host.
    pub(crate) calibration: &'static mut [u32],
    scan: &'static mut [u32],
    /// The link, if the board is live.
    pub(crate) link: &'static mut [u32],
    pub(crate) matcher: &'static mut [u32],
    /// The packets of the link, whose cost is measured where they have room beside the rest.
    packet: &'static mut [u32],
}

impl Memories {
    fn new(request: &Request, memory: &'static mut [u32]) -> Result<Self, Refusal> {
        let (lines, memory) = memory
            .split_at_mut_checked(session::memory_words(&request.geometry))
            .ok_or(Refusal("the lines do not fit the lent memory"))?;
        let scan_words = request.scan.map_or(0, |scan| scan.words());
        let (scan, memory) = memory
            .split_at_mut_checked(scan_words)
            .ok_or(Refusal("the scan does not fit the lent memory"))?;
        let (link, memory) = memory
            .split_at_mut_checked(request.link_words())
            .ok_or(Refusal("the link does not fit the lent memory"))?;
        let matcher_words = request.config().memory_words();
        let (matcher, memory) = memory.split_at_mut(matcher_words.min(memory.len()));
        let [rectification_words, rectifier_words] = request.calibration_words();
        let calibration_words = match request.is_live {
            true => memory.len(),
            false => rectification_words + rectifier_words,
        };
        let (calibration, packet) = memory
            .split_at_mut_checked(calibration_words)
            .ok_or(Refusal("the calibration does not fit the lent memory"))?;
        Ok(Self {
            lines,
            calibration,
            scan,
            link,
            matcher,
            packet,
        })
    }
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
        let live = live::serve(&request, board.name, board.uart, kernels, memories);
        return live.map(|never| match never {});
    }
    with_files(&request, &meter, kernels, memories)
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
    let sink = BothSinks::new(
        sink,
        PacketSink::new(memories.packet, request.width(), meter),
    );
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
pub(crate) fn matcher<'m, K: Kernels>(
    request: &Request,
    kernels: K,
    memory: &'m mut [u32],
) -> Result<Matcher<'m, K>, Refusal> {
    let matcher = Matcher::new(&request.config(), kernels, memory);
    matcher.map_err(|_| Refusal("the matcher refuses the configuration"))
}

/// Reads the file of the rectification, which has as many bytes.
pub(crate) fn read_calibration(bytes: &mut [u8]) -> Result<(), Refusal> {
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
