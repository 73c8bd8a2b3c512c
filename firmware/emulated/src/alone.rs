//! A run of a board that is built for one preset: session and matcher between files, and nothing beside them.

use semihosting::fs::File;
use vgstereo_core::{
    Config, DisparityRange, Kernels, Matcher, Only, Preset, Scope, Scoped, presets,
};
use vgstereo_firmware::camera::{Geometry, LinePairSource, PixelFormat};
use vgstereo_firmware::session::memory_words;
use vgstereo_firmware::watchdog::NoWatchdog;
use vgstereo_firmware::{DisparitySink, Session};

use crate::board::{Board, of_command_line, report};
use crate::camera::FileCamera;
use crate::meter::{Counter, Meter, Metered};
use crate::report::Report;
use crate::request::{ALONE_DISPARITIES, Refusal};
use crate::sink::FileSink;
use crate::task::Task;
use crate::{CONFIDENCES_FILE, DISPARITIES_FILE, LINES_FILE};

/// The preset that the board is built for.
const PRESET: Preset = if cfg!(feature = "lite") {
    Preset::Lite
} else {
    Preset::Micro
};

/// What the board is built for: [`PRESET`], with [`ALONE_DISPARITIES`] and lines of grey that are rectified.
#[derive(Debug, Clone, Copy)]
struct Built;

impl Scoped for Built {
    const SCOPE: Scope = Scope {
        drawn: match PRESET {
            Preset::Lite => presets::Lite::SCOPE.drawn,
            _ => presets::Micro::SCOPE.drawn,
        },
        ..config(1).scope()
    };
}

/// The configuration for lines of this width.
const fn config(width: u16) -> Config {
    let disparities = DisparityRange::up_to(ALONE_DISPARITIES - 1);
    Config::new(PRESET.parameters(), width, disparities)
}

/// Frames to match.
struct Frames {
    width: u32,
    height: u32,
    count: u32,
}

impl Frames {
    /// Reads the words of a [`Request`](crate::Request); `None` if it asks for something else than the board
    /// is built for.
    fn read(words: &str) -> Option<Self> {
        let mut frames = Self {
            width: 0,
            height: 0,
            count: 0,
        };
        for word in words.split(' ') {
            let (key, text) = word.split_once('=')?;
            let number = || text.parse::<u32>().ok();
            match key {
                "width" => frames.width = number()?,
                "height" => frames.height = number()?,
                "frames" => frames.count = number()?,
                "disparities" if number()? == ALONE_DISPARITIES.into() => {}
                "preset" if text == PRESET.name() => {}
                "pixels" if text == "grey8" => {}
                "minimum" if text == "0" => {}
                _ => return None,
            }
        }
        Some(frames)
    }

    fn geometry(&self) -> Option<Geometry> {
        Some(Geometry {
            width: self.width.try_into().ok()?,
            height: self.height,
            format: PixelFormat::Grey8,
        })
    }
}

/// Serves the request on the command line if it is one that the board is built for, writes the report, and ends the
/// emulation.
pub fn run<C: Counter, U, K: Kernels>(board: Board<C, U, K>) -> ! {
    report(board.stack, || serve(board))
}

/// Not inlined, so that what is only there before frames are matched does not take stack then.
#[inline(never)]
fn serve<C: Counter, U, K: Kernels>(board: Board<C, U, K>) -> Result<Report, Refusal> {
    let frames = of_command_line(Frames::read);
    let frames = frames.ok_or(Refusal("the board is not built for this request"))?;
    let geometry = frames.geometry().ok_or(Refusal("the lines are too wide"))?;
    let config = config(geometry.width);
    let words = memory_words(&geometry);
    let working_bytes = (words + config.memory_words()) * size_of::<u32>();
    let meter = Meter::new(board.counter);
    let kernels = Metered::new(Only::<K, Built>::new(board.kernels), &meter);
    let (lines, memory) = board
        .memory
        .split_at_mut_checked(words)
        .ok_or(Refusal("the lines do not fit the lent memory"))?;
    let file_error = |_| Refusal("a file cannot be opened");
    let file = File::open(LINES_FILE).map_err(file_error)?;
    // No file has a time in it.
    let camera = Metered::new(FileCamera::new(&file, geometry, || 0), &meter);
    let sink = FileSink::new(
        File::create(DISPARITIES_FILE).map_err(file_error)?,
        File::create(CONFIDENCES_FILE).map_err(file_error)?,
    );
    let sink = Metered::new(sink, &meter);
    let mut session = session(&config, kernels, memory, camera, sink, lines);
    // Used where it is: moved out, it would take the stack twice.
    let session = match &mut session {
        Ok(session) => session,
        Err(refusal) => return Err(*refusal),
    };

    let task = Task {
        frames: frames.count,
        faults: 0,
        height: frames.height,
    };
    let matched = task.run(session, &meter, |_, _| {});
    matched.map_err(|_| Refusal("the sink failed"))?;
    Ok(Report {
        statistics: session.statistics(),
        instructions: meter.instructions(),
        working_bytes: working_bytes as u32,
        stack_bytes: 0,
    })
}

/// Builds the session. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn session<'m, C: LinePairSource, K: Kernels, S: DisparitySink>(
    config: &Config,
    kernels: K,
    memory: &'m mut [u32],
    camera: C,
    sink: S,
    lines: &'m mut [u32],
) -> Result<Session<'m, C, K, S>, Refusal> {
    let matcher = Matcher::new(config, kernels, memory);
    let matcher = matcher.map_err(|_| Refusal("the matcher refuses the configuration"))?;
    let session = Session::with_watchdog(camera, matcher, sink, lines, NoWatchdog);
    session.map_err(|_| Refusal("the session refuses the camera"))
}

/// Ends the emulation, which then has no report.
#[cfg(not(feature = "complete"))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    semihosting::process::exit(1)
}
