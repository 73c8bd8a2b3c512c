//! The session under any faults of its camera and its sink, against a model that keeps no state.

use std::cell::{Cell, RefCell};

use arbitrary::{Arbitrary, Result, Unstructured};
use vgstereo_core::{Config, DisparityLine, DisparityRange, Matcher, Parameters, Portable, Preset};
use vgstereo_firmware::camera::{
    Error, ErrorKind, ErrorType, Geometry, LinePair, LinePairSource, PixelFormat, RawLine,
};
use vgstereo_firmware::scripted::{FaultKind, FaultyCamera, FaultyError, ScriptedFault};
use vgstereo_firmware::session::{PATIENCE_FRAMES, memory_words};
use vgstereo_firmware::sink::{DisparitySink, FrameInfo};
use vgstereo_firmware::{Event, Fault, Session, Statistics, Watchdog};

use crate::faults::{SmallCamera, error_counter};

/// Frames in which something may go wrong: fewer than a leap of numbers that tells of none.
const FAULTY_FRAMES: u32 = 24;
/// Frames after those, in which nothing does.
const CLEAN_FRAMES: u32 = 2;

/// What goes wrong in a run of the session.
#[derive(Debug, Clone)]
pub struct Case {
    /// Number of lines of a frame.
    pub height: u32,
    /// Faults of the camera.
    pub camera: Vec<ScriptedFault>,
    /// Frames and calls at which the sink fails, each time.
    pub sink: Vec<(u32, Call)>,
}

/// A call of the sink.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Call {
    /// The frame begins.
    Begin,
    /// A line comes.
    Line(u32),
    /// The frame ends.
    End,
}

impl<'a> Arbitrary<'a> for Case {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        let height = u.int_in_range(1..=6)?;
        let mut case = Self {
            height,
            camera: Vec::new(),
            sink: Vec::new(),
        };
        while !u.is_empty() && case.camera.len() + case.sink.len() < 120 {
            let frame = u.int_in_range(0..=FAULTY_FRAMES - 1)?;
            let line = u.int_in_range(0..=height - 1)?;
            if u.ratio(3, 4)? {
                let kind = *u.choose(&FaultKind::ALL)?;
                case.camera.push(ScriptedFault { frame, line, kind });
            } else {
                let call = *u.choose(&[Call::Begin, Call::Line(line), Call::End])?;
                case.sink.push((frame, call));
            }
        }
        Ok(case)
    }
}

/// Runs the case that the bytes stand for.
pub fn run(bytes: &[u8]) {
    if let Ok(case) = Case::arbitrary(&mut Unstructured::new(bytes)) {
        check(&case);
    }
}

/// Runs a session and judges its counters, its frames and its watchdog.
///
/// # Panics
/// If one is not as the model says.
pub fn check(case: &Case) {
    let config = Config::new(parameters(), SmallCamera::WIDTH, DisparityRange::up_to(3));
    let log = RefCell::new(Vec::new());
    let camera = Logged {
        camera: FaultyCamera::new(SmallCamera::new(case.height), case.camera.as_slice()),
        log: &log,
    };
    let sink = FailingSink {
        case,
        log: &log,
        undisturbed_q4: undisturbed(&config, case.height),
        open: None,
        disparities_q4: Vec::new(),
    };
    let mut memory = vec![u32::MAX; config.memory_words()];
    let mut lines = vec![u32::MAX; memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let meals = Cell::new(0);
    let mut session =
        Session::with_watchdog(camera, matcher, sink, &mut lines, Meals(&meals)).unwrap();
    let last_frame = FAULTY_FRAMES + CLEAN_FRAMES - 1;
    // Each line comes at most twice for itself and once for each repeat of its frame's lines above.
    let reads_max = (last_frame + 1) * case.height * (2 + case.height);
    for _ in 0..reads_max {
        if session.step() == Ok(Event::FrameDone { frame: last_frame }) {
            break;
        }
    }
    let mut expected = Model::of(case.height, &log.borrow());
    assert_eq!(session.statistics(), expected.statistics, "{case:?}");
    assert_eq!(meals.get(), expected.meals, "{case:?}");
    // Whatever happened, the second whole frame after it is delivered at the latest.
    assert_eq!(expected.done.pop(), Some(last_frame), "{case:?}");
}

/// The fastest preset, with a few lines of latency.
fn parameters() -> Parameters {
    let mut parameters = Preset::PaperRaw.parameters().with_sigma(0.6);
    parameters.synapses = 16;
    parameters
}

/// A frame of [`SmallCamera`] as the matcher alone computes it.
fn undisturbed(config: &Config, height: u32) -> Vec<i16> {
    let mut memory = vec![0; config.memory_words()];
    let mut matcher = Matcher::new(config, Portable, &mut memory).unwrap();
    let mut camera = SmallCamera::new(height);
    let mut lines = [[0; SmallCamera::WIDTH as usize]; 2];
    let mut frame = Vec::new();
    for _ in 0..height {
        let [left, right] = &mut lines;
        camera.read_pair(left, right).unwrap();
        let [left, right] = lines
            .each_ref()
            .map(|line| RawLine::new(PixelFormat::Grey8, line, Portable));
        if let Some(line) = matcher.push(&left, &right).unwrap() {
            frame.extend_from_slice(line.disparities_q4);
        }
    }
    while let Some(line) = matcher.finish() {
        frame.extend_from_slice(line.disparities_q4);
    }
    frame
}

/// What happened at one read of the camera.
#[derive(Debug, Clone, Copy)]
struct Read {
    camera: std::result::Result<LinePair, ErrorKind>,
    /// The call at which the sink failed after it.
    sink: Option<Call>,
}

/// A camera whose reads are logged.
struct Logged<'l, C> {
    camera: C,
    log: &'l RefCell<Vec<Read>>,
}

impl<C: LinePairSource> ErrorType for Logged<'_, C> {
    type Error = C::Error;
}

impl<C: LinePairSource<Error = FaultyError<ErrorKind>>> LinePairSource for Logged<'_, C> {
    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn read_pair(
        &mut self,
        left: &mut [u8],
        right: &mut [u8],
    ) -> std::result::Result<LinePair, C::Error> {
        let read = self.camera.read_pair(left, right);
        self.log.borrow_mut().push(Read {
            camera: read.map_err(|error| error.kind()),
            sink: None,
        });
        read
    }
}

/// A sink that fails when it is to, asserts that its calls come in order, and that whole frames are those
/// of a camera without faults.
struct FailingSink<'c, 'l> {
    case: &'c Case,
    log: &'l RefCell<Vec<Read>>,
    undisturbed_q4: Vec<i16>,
    /// The frame that has begun.
    open: Option<u32>,
    disparities_q4: Vec<i16>,
}

impl FailingSink<'_, '_> {
    fn answer(&self, frame: u32, call: Call) -> std::result::Result<(), Call> {
        if !self.case.sink.contains(&(frame, call)) {
            return Ok(());
        }
        if let Some(read) = self.log.borrow_mut().last_mut() {
            read.sink = Some(call);
        }
        Err(call)
    }
}

impl DisparitySink for FailingSink<'_, '_> {
    type Error = Call;

    fn begin_frame(&mut self, info: &FrameInfo) -> std::result::Result<(), Call> {
        assert_eq!(self.open, None);
        self.answer(info.frame, Call::Begin)?;
        self.open = Some(info.frame);
        self.disparities_q4.clear();
        Ok(())
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> std::result::Result<(), Call> {
        assert_eq!(self.open, Some(frame));
        self.answer(frame, Call::Line(line.line))?;
        self.disparities_q4.extend_from_slice(line.disparities_q4);
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> std::result::Result<(), Call> {
        assert_eq!(self.open, Some(info.frame));
        self.answer(info.frame, Call::End)?;
        assert!(
            self.disparities_q4 == self.undisturbed_q4,
            "a disturbed frame"
        );
        self.open = None;
        Ok(())
    }

    fn abort_frame(&mut self, frame: u32, _: Fault) {
        assert_eq!(self.open.take(), Some(frame));
    }
}

/// A watchdog that counts how often it is fed.
struct Meals<'a>(&'a Cell<u32>);

impl Watchdog for Meals<'_> {
    fn feed(&mut self) {
        self.0.set(self.0.get() + 1);
    }
}

/// What must come of a log. Each read is judged by those before it; frames are counted by their numbers.
#[derive(Debug, Default)]
struct Model {
    statistics: Statistics,
    meals: u32,
    /// Frames that were delivered.
    done: Vec<u32>,
}

impl Model {
    fn of(height: u32, log: &[Read]) -> Self {
        let mut model = Self::default();
        let mut begun = 0;
        for (at, read) in log.iter().enumerate() {
            model.statistics.sink_errors += u32::from(read.sink.is_some());
            let pair = match read.camera {
                Ok(pair) => pair,
                Err(kind) => {
                    *error_counter(&mut model.statistics, kind) += 1;
                    continue;
                }
            };
            let wanted = expected(height, log, at);
            let is_other = wanted.is_some_and(|wanted| wanted != (pair.frame, pair.line));
            model.statistics.sequence_breaks += u32::from(is_other);
            model.statistics.lines_dropped += pair.dropped;
            if !is_matched(height, log, at) {
                model.statistics.lines_dropped += 1;
                continue;
            }
            model.statistics.lines += 1;
            begun += u32::from(pair.line == 0);
            if read.sink.is_some() {
                continue;
            }
            if pair.line + 1 == height {
                model.done.push(pair.frame);
                begun = 0;
            }
            model.meals += u32::from(begun <= PATIENCE_FRAMES);
        }
        let mut frames = log.iter().filter_map(|read| Some(read.camera.ok()?.frame));
        // Each frame from the first of which a pair came to the last is done or dropped.
        let first = frames.next();
        let seen = first.map_or(0, |first| frames.next_back().unwrap_or(first) - first + 1);
        model.statistics.frames = model.done.len() as u32;
        model.statistics.frames_dropped = seen - model.statistics.frames;
        model
    }
}

/// Whether the pair of a read is matched: line 0 of a frame of which the pair before was no part, and any
/// other line after the one above it.
fn is_matched(height: u32, log: &[Read], at: usize) -> bool {
    let Ok(pair) = log[at].camera else {
        return false;
    };
    if pair.line > 0 {
        return expected(height, log, at) == Some((pair.frame, pair.line));
    }
    let mut before = log[..at].iter().rev().filter_map(|read| read.camera.ok());
    let is_new = before
        .next()
        .is_none_or(|before| before.frame != pair.frame);
    is_new && log[at].sink != Some(Call::Begin)
}

/// The frame and the line that are expected at a read, if the read before was matched and nothing failed.
fn expected(height: u32, log: &[Read], at: usize) -> Option<(u32, u32)> {
    let before = at.checked_sub(1)?;
    let pair = log[before].camera.ok()?;
    if log[before].sink.is_some() || !is_matched(height, log, before) {
        None
    } else if pair.line + 1 < height {
        Some((pair.frame, pair.line + 1))
    } else {
        Some((pair.frame + 1, 0))
    }
}
