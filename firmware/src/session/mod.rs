//! The session: one camera, a rectifier if its views are not rectified, one matcher, one sink, and
//! what to do when a frame breaks.
//!
//! Pairs of lines must come numbered 0, 1, 2, ... to the last line of the frame. Anything
//! else - an error, a gap, a pair that comes twice, a pair of another frame - drops the
//! frame: the matcher forgets it, the sink is told, and the session searches for line 0 of
//! a frame that it has not seen. The disparities of that frame do not depend on what came
//! before. [`sync`] decides which pair is which; the session carries that out.

mod error;
mod event;
mod patience;
mod statistics;
pub mod sync;

pub use error::{RunError, SessionError};
pub use event::Event;
pub use patience::{PATIENCE_FRAMES, Patience};
pub use statistics::Statistics;

use core::mem;

use crate::camera::{Error, ErrorKind, Geometry, LinePair, LinePairSource, RawLine};
use vgstereo_core::config::{Checks, ChecksError};
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::rows::{Arena, words};
use vgstereo_core::{Kernels, Line, LineOffsets, Matcher, Region};

use crate::fault::Fault;
use crate::sink::{DisparitySink, FrameInfo, Needs};
use crate::watchdog::{NoWatchdog, Watchdog};
use sync::{Action, FrameSync};

/// Number of frames' worth of reads after which [`Session::run_frame`] gives up: the rest
/// of the frame that the camera is in, two broken frames and a whole one.
pub const ATTEMPT_FRAMES: u32 = 4;

/// Returns the number of 32-bit words that [`Session::new`] takes besides the matcher's
/// own: two lines as the camera delivers them, each rounded up to whole words.
#[must_use]
pub const fn memory_words(geometry: &Geometry) -> usize {
    2 * words(geometry.line_bytes(), 1)
}

/// Connects a camera to a matcher and a sink, and feeds a watchdog as long as lines are
/// matched and frames come whole ([`Patience`]).
///
/// Pairs of lines come in by one of two doors, which deal with them in the same way. With
/// [`step`](Self::step) the session reads the camera, a [`LinePairSource`]. With
/// [`take_pair`](Self::take_pair) and [`take_error`](Self::take_error) it is given what an interrupt
/// or a task has received: [`pushed`](Session::pushed) makes such a session, without a camera.
///
/// A session waits only where the camera does, whose every wait is bounded, and where the
/// sink does.
#[derive(Debug)]
pub struct Session<'m, C, K, S, W = NoWatchdog> {
    camera: C,
    rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
    matcher: Matcher<'m, K>,
    sink: S,
    watchdog: W,
    geometry: Geometry,
    left: &'m mut [u8],
    right: &'m mut [u8],
    sync: FrameSync,
    patience: Patience,
    /// Whether frames begin with what the last whole one taught.
    keeps_line_offsets: bool,
    /// What the sink asks of the frame that was begun last.
    needs: Needs,
    /// The frame that was begun last; its end is told with it.
    info: FrameInfo,
    statistics: Statistics,
}

impl<'m, C: LinePairSource, K: Kernels, S: DisparitySink> Session<'m, C, K, S> {
    /// Returns a session without a watchdog. It takes at least [`memory_words`] of lent
    /// memory. The matcher forgets the frame that it may be in. Pass `&mut camera` or
    /// `&mut sink` to use them again after the session.
    ///
    /// # Errors
    /// [`SessionError`] when the camera's geometry does not suit the matcher or the lent
    /// memory is too small.
    pub fn new(
        camera: C,
        matcher: Matcher<'m, K>,
        sink: S,
        memory: &'m mut [u32],
    ) -> Result<Self, SessionError> {
        Self::with_watchdog(camera, matcher, sink, memory, NoWatchdog)
    }
}

/// In place of the camera of a session that is given its pairs of lines.
#[derive(Debug, Clone, Copy)]
pub struct Pushed;

impl<'m, K: Kernels, S: DisparitySink, W: Watchdog> Session<'m, Pushed, K, S, W> {
    /// Returns a session that does not read a camera, but is given the pairs of lines of one with this
    /// geometry, with [`take_pair`](Session::take_pair). It takes no memory of its own. For the rest, see
    /// [`Session::rectifying`].
    ///
    /// # Errors
    /// [`SessionError`] when the rectification does not suit the geometry or the matcher, or the
    /// geometry does not suit the matcher.
    pub fn pushed(
        geometry: Geometry,
        rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
        matcher: Matcher<'m, K>,
        sink: S,
        watchdog: W,
    ) -> Result<Self, SessionError> {
        let lines = [&mut [][..], &mut []];
        Self::over(Pushed, geometry, rectifier, matcher, sink, lines, watchdog)
    }
}

impl<'m, C: LinePairSource, K: Kernels, S: DisparitySink, W: Watchdog> Session<'m, C, K, S, W> {
    /// Returns a session as [`Session::new`] does, with a watchdog, which runs already or is
    /// started before the first step. [`Watchdog`] tells when it is fed. Pass
    /// `&mut watchdog` to use it again after the session.
    ///
    /// # Errors
    /// [`SessionError`] when the camera's geometry does not suit the matcher or the lent
    /// memory is too small.
    pub fn with_watchdog(
        camera: C,
        matcher: Matcher<'m, K>,
        sink: S,
        memory: &'m mut [u32],
        watchdog: W,
    ) -> Result<Self, SessionError> {
        Self::rectifying(camera, None, matcher, sink, memory, watchdog)
    }

    /// Returns a session as [`Session::with_watchdog`] does whose camera is not rectified: its raw
    /// lines go through `rectifier`, if there is one, and the matcher gets the rectified ones. It is
    /// lent, so that a session is not larger where there is none. A raw pair may complete none, one
    /// or several lines of disparities; all of a frame have come with its last pair.
    ///
    /// # Errors
    /// [`SessionError`] when the rectification does not suit the camera or the matcher, when the
    /// camera's geometry does not suit the matcher, or the lent memory is too small.
    pub fn rectifying(
        camera: C,
        rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
        matcher: Matcher<'m, K>,
        sink: S,
        memory: &'m mut [u32],
        watchdog: W,
    ) -> Result<Self, SessionError> {
        let geometry = camera.geometry();
        let mut arena = Arena::new(memory);
        let lines = [
            arena.take(geometry.line_bytes())?,
            arena.take(geometry.line_bytes())?,
        ];
        Self::over(camera, geometry, rectifier, matcher, sink, lines, watchdog)
    }

    /// Reads the camera once, deals with what comes and returns what became of it. The last
    /// pair of a frame also brings the [`latency_lines`] lines of disparities still to come,
    /// within the gap between frames.
    ///
    /// [`latency_lines`]: vgstereo_core::config::Parameters::latency_lines
    ///
    /// # Errors
    /// The error of the sink. The frame is dropped; the next call goes on with a later one.
    pub fn step(&mut self) -> Result<Event, S::Error> {
        let (left, right) = (mem::take(&mut self.left), mem::take(&mut self.right));
        let event = match self.camera.read_pair(left, right) {
            Ok(pair) => self.take_pair(&pair, left, right),
            Err(error) => Ok(self.take_error(error.kind())),
        };
        (self.left, self.right) = (left, right);
        event
    }

    /// Steps until a frame is done and returns the camera's number of that frame. Takes at
    /// most [`ATTEMPT_FRAMES`] times as many steps as a frame has lines.
    ///
    /// # Errors
    /// [`RunError`] when no frame came whole in that many steps or the sink failed. The
    /// session can be used again.
    pub fn run_frame(&mut self) -> Result<u32, RunError<S::Error>> {
        let reads = self.geometry.height.saturating_mul(ATTEMPT_FRAMES);
        let mut last_fault = None;
        for _ in 0..reads {
            match self.step().map_err(RunError::Sink)? {
                Event::FrameDone { frame } => return Ok(frame),
                Event::Fault(fault) => last_fault = Some(fault),
                Event::Resync { .. } => last_fault = Some(Fault::Sequence),
                Event::Line { .. } | Event::Skipped { .. } => {}
            }
        }
        Err(RunError::Attempts { reads, last_fault })
    }
}

impl<'m, C, K: Kernels, S: DisparitySink, W: Watchdog> Session<'m, C, K, S, W> {
    fn over(
        camera: C,
        geometry: Geometry,
        mut rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
        mut matcher: Matcher<'m, K>,
        sink: S,
        [left, right]: [&'m mut [u8]; 2],
        watchdog: W,
    ) -> Result<Self, SessionError> {
        let config = matcher.config();
        let mut height = geometry.height;
        match &rectifier {
            Some(_) if !K::SCOPE.rectification => return Err(SessionError::Scope),
            Some(rectifier) => {
                let rectification = rectifier.rectification();
                let raw_px = [rectification.raw_width, rectification.raw_height];
                let camera_px = [geometry.width.into(), geometry.height];
                let (rectified_px, matcher_px) = (rectification.width, config.width);
                if camera_px != raw_px.map(u32::from) || rectified_px != matcher_px {
                    return Err(SessionError::Rectification {
                        camera_px,
                        raw_px,
                        rectified_px,
                        matcher_px,
                    });
                }
                height = rectification.height.into();
            }
            None if geometry.width != config.width => {
                return Err(SessionError::Width {
                    camera_px: geometry.width,
                    matcher_px: config.width,
                });
            }
            None => {}
        }
        if config.colour && geometry.format.is_grey() {
            return Err(SessionError::Colour {
                camera: geometry.format,
            });
        }
        let region = config.region;
        if height <= region.y {
            return Err(SessionError::Height {
                camera_lines: height,
                first_line: region.y,
            });
        }
        let region = Region {
            height: region.height.min(height.saturating_sub(region.y)),
            ..region
        };
        matcher.reset();
        if let Some(rectifier) = in_scope(&mut rectifier) {
            rectifier.reset();
        }
        Ok(Self {
            camera,
            rectifier,
            matcher,
            sink,
            watchdog,
            geometry,
            left,
            right,
            sync: FrameSync::new(geometry.height),
            patience: Patience::default(),
            keeps_line_offsets: false,
            needs: Needs::DISPARITIES,
            info: FrameInfo {
                frame: 0,
                timestamp_us: 0,
                region,
            },
            statistics: Statistics::default(),
        })
    }

    /// Returns what the session has counted since it began.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// Whether a frame has begun and not ended.
    #[must_use]
    pub fn is_reading(&self) -> bool {
        self.sync.is_reading()
    }

    /// Sets all counters to 0.
    pub fn reset_statistics(&mut self) {
        self.statistics = Statistics::default();
    }

    /// Returns the camera.
    #[must_use]
    pub fn camera(&self) -> &C {
        &self.camera
    }

    /// Returns the camera mutably, to change what it delivers from the next frame on.
    #[must_use]
    pub fn camera_mut(&mut self) -> &mut C {
        &mut self.camera
    }

    /// Returns the matcher.
    #[must_use]
    pub fn matcher(&self) -> &Matcher<'m, K> {
        &self.matcher
    }

    /// Takes other checks for the frames to come. The frame that is being read, if any, is dropped: call
    /// this between frames.
    ///
    /// # Errors
    /// [`ChecksError`] when the matcher refuses them; nothing has changed then.
    pub fn set_checks(&mut self, checks: &Checks) -> Result<(), ChecksError> {
        self.matcher.set_checks(checks)?;
        self.stop_frame();
        Ok(())
    }

    /// Lets each frame to come begin with the offsets of lines that the last whole one taught, or no longer: as at
    /// first, frames begin with the same offsets until others are set. For cameras that are fixed to each other:
    /// their first lines are then in place as well. [`Matcher::line_offsets`] tells what was learned.
    pub fn keep_line_offsets(&mut self, keeps: bool) {
        self.keeps_line_offsets = keeps;
    }

    /// Lets the frames to come begin with these offsets of lines. The frame that is being read, if any, is
    /// dropped: call this between frames.
    pub fn set_line_offsets(&mut self, offsets: LineOffsets) {
        self.matcher.set_line_offsets(offsets);
        self.stop_frame();
    }

    /// Drops the frame that is being read, if any, on the caller's behalf.
    fn stop_frame(&mut self) {
        let (abort, changes) = self.sync.failed();
        self.statistics.count(changes);
        self.abort(abort, Fault::Stopped);
    }

    /// Returns the sink.
    #[must_use]
    pub fn sink(&self) -> &S {
        &self.sink
    }

    /// Returns the sink mutably, for callers that take from it what it has collected.
    #[must_use]
    pub fn sink_mut(&mut self) -> &mut S {
        &mut self.sink
    }

    /// Ends the session and returns its parts. A frame that is being read is neither ended
    /// nor aborted at the sink.
    #[must_use]
    pub fn into_parts(self) -> (C, Matcher<'m, K>, S) {
        (self.camera, self.matcher, self.sink)
    }

    /// Deals with a pair of lines, each of [`Geometry::line_bytes`], and returns what became of it, as
    /// [`step`](Self::step) does. Lines of another length, which no camera may deliver, count as short
    /// ones.
    ///
    /// # Errors
    /// The error of the sink. The frame is dropped; the next call goes on with a later one.
    pub fn take_pair(
        &mut self,
        pair: &LinePair,
        left: &[u8],
        right: &[u8],
    ) -> Result<Event, S::Error> {
        let line_bytes = self.geometry.line_bytes();
        if left.len() != line_bytes || right.len() != line_bytes {
            return Ok(self.take_error(ErrorKind::ShortLine));
        }
        let event = self.deal_with(pair, [left, right])?;
        if self.patience.feeds(&event) {
            self.watchdog.feed();
        }
        Ok(event)
    }

    /// Counts an error of the camera and drops the frame that is being read, if any. Returns that as an
    /// event.
    pub fn take_error(&mut self, kind: ErrorKind) -> Event {
        self.statistics.count_camera_error(kind);
        self.fail(Fault::Camera(kind))
    }

    fn deal_with(&mut self, pair: &LinePair, lines: [&[u8]; 2]) -> Result<Event, S::Error> {
        let &LinePair { frame, line, .. } = pair;
        let (action, changes) = self.sync.pair(frame, line, pair.dropped);
        self.statistics.count(changes);
        match action {
            Action::Match => self.match_pair(pair, lines),
            Action::Begin => self.begin_frame(pair, lines),
            Action::Skip => Ok(Event::Skipped { frame, line }),
            Action::Resync { abort } => {
                self.abort(abort, Fault::Sequence);
                Ok(match self.begin_frame(pair, lines)? {
                    Event::Line { frame, .. } => Event::Resync { frame },
                    event => event,
                })
            }
            Action::Reject { abort } => {
                self.abort(abort, Fault::Sequence);
                Ok(Event::Fault(Fault::Sequence))
            }
        }
    }

    /// Begins the pair's frame and matches the pair as its line 0.
    fn begin_frame(&mut self, pair: &LinePair, lines: [&[u8]; 2]) -> Result<Event, S::Error> {
        self.info.frame = pair.frame;
        self.info.timestamp_us = pair.timestamp_us;
        if let Err(error) = self.sink.begin_frame(&self.info) {
            return Err(self.fail_with_sink(error));
        }
        self.needs = self.sink.needs();
        let changes = self.sync.begun();
        self.statistics.count(changes);
        self.match_pair(pair, lines)
    }

    /// Matches the pair, the next one of the frame that is being read, and ends the frame
    /// with its last.
    fn match_pair(&mut self, pair: &LinePair, lines: [&[u8]; 2]) -> Result<Event, S::Error> {
        let &LinePair { frame, line, .. } = pair;
        let (format, kernels, needs) = (self.geometry.format, self.matcher.kernels(), self.needs);
        let raw = lines.map(|bytes| RawLine::new(format, bytes, kernels));
        let (matcher, sink) = (&mut self.matcher, &mut self.sink);
        sink.raw_pair(pair, lines);
        let mut given = Ok(());
        match in_scope(&mut self.rectifier) {
            _ if !needs.rectified && !needs.disparities => {}
            None if needs.disparities => given = give(matcher, sink, frame, &raw[0], &raw[1]),
            None => {}
            Some(rectifier) => match rectifier.push(&raw[0], &raw[1]) {
                Ok(()) => {
                    while let Some([left, right]) = rectifier.next_pair() {
                        if needs.rectified {
                            sink.rectified_pair(frame, left.line().into(), [&left, &right]);
                        }
                        if needs.disparities {
                            given = give(matcher, sink, frame, &left, &right);
                        }
                        if given.is_err() {
                            break;
                        }
                    }
                }
                Err(error) => given = Err(Failure::Fault(Fault::Rectifier(error))),
            },
        }
        let is_whole = self.sync.is_whole();
        if given.is_ok() && is_whole {
            given = self.end_frame().map_err(Failure::Sink);
        }
        match given {
            Ok(()) => {}
            Err(Failure::Fault(fault)) => return Ok(self.fail(fault)),
            Err(Failure::Sink(error)) => return Err(self.fail_with_sink(error)),
        }
        if !is_whole {
            return Ok(Event::Line { frame, line });
        }
        let changes = self.sync.ended();
        self.statistics.count(changes);
        Ok(Event::FrameDone { frame })
    }

    /// Gives the sink the lines still to come and ends the frame there.
    fn end_frame(&mut self) -> Result<(), S::Error> {
        if self.needs.disparities {
            while let Some(disparities) = self.matcher.finish() {
                self.sink.line(self.info.frame, &disparities)?;
            }
            if self.keeps_line_offsets {
                self.matcher.set_line_offsets(self.matcher.line_offsets());
            }
        }
        if let Some(rectifier) = in_scope(&mut self.rectifier) {
            rectifier.reset();
        }
        self.sink.end_frame(&self.info)
    }

    fn fail_with_sink(&mut self, error: S::Error) -> S::Error {
        self.statistics.count_sink_error();
        self.fail(Fault::Sink);
        error
    }

    /// Drops the frame that is being read, if any.
    fn fail(&mut self, fault: Fault) -> Event {
        let (abort, changes) = self.sync.failed();
        self.statistics.count(changes);
        self.abort(abort, fault);
        Event::Fault(fault)
    }

    /// Tells matcher and sink that the frame `frame` ends incomplete, if there is one.
    fn abort(&mut self, frame: Option<u32>, fault: Fault) {
        if let Some(frame) = frame {
            self.matcher.reset();
            if let Some(rectifier) = in_scope(&mut self.rectifier) {
                rectifier.reset();
            }
            self.sink.abort_frame(frame, fault);
        }
    }
}

/// The rectifier, of which the compiler knows that there is none if it is not in scope.
fn in_scope<'a, 'm, K: Kernels>(
    rectifier: &'a mut Option<&'m mut Rectifier<'m, 'm, K>>,
) -> Option<&'a mut Rectifier<'m, 'm, K>> {
    if K::SCOPE.rectification {
        rectifier.as_deref_mut()
    } else {
        None
    }
}

/// Why a pair of lines did not reach the sink.
enum Failure<E> {
    Fault(Fault),
    Sink(E),
}

/// Gives the matcher a pair of lines, and the sink the line of disparities that this completes, if any.
fn give<K: Kernels, S: DisparitySink>(
    matcher: &mut Matcher<'_, K>,
    sink: &mut S,
    frame: u32,
    left: &impl Line,
    right: &impl Line,
) -> Result<(), Failure<S::Error>> {
    match matcher.push(left, right) {
        Ok(Some(disparities)) => sink.line(frame, &disparities).map_err(Failure::Sink),
        Ok(None) => Ok(()),
        Err(error) => Err(Failure::Fault(Fault::Matcher(error))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ErrorKind, ErrorType, PixelFormat};
    use std::cell::Cell;
    use std::vec;
    use std::vec::Vec;
    use vgstereo_core::{Config, DisparityLine, DisparityRange, Portable, Preset};

    const GEOMETRY: Geometry = Geometry {
        width: 12,
        height: 3,
        format: PixelFormat::Grey8,
    };

    /// Delivers the reads that it was given and then, for ever, reports that nothing comes.
    struct Camera {
        reads: vec::IntoIter<Result<LinePair, ErrorKind>>,
    }

    impl ErrorType for Camera {
        type Error = ErrorKind;
    }

    impl LinePairSource for Camera {
        fn geometry(&self) -> Geometry {
            GEOMETRY
        }

        fn read_pair(&mut self, _: &mut [u8], _: &mut [u8]) -> Result<LinePair, ErrorKind> {
            self.reads.next().unwrap_or(Err(ErrorKind::Timeout))
        }
    }

    fn camera(reads: Vec<Result<LinePair, ErrorKind>>) -> Camera {
        let reads = reads.into_iter();
        Camera { reads }
    }

    fn pair(frame: u32, line: u32) -> Result<LinePair, ErrorKind> {
        Ok(LinePair {
            frame,
            line,
            timestamp_us: 100 * u64::from(frame) + u64::from(line),
            dropped: 0,
        })
    }

    fn whole_frame(frame: u32) -> Vec<Result<LinePair, ErrorKind>> {
        (0..GEOMETRY.height).map(|line| pair(frame, line)).collect()
    }

    /// A call of the sink, with the number of the frame.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Call {
        Begin(u32),
        Line(u32, u32),
        End(u32),
        Abort(u32, Fault),
    }

    #[derive(Debug, PartialEq)]
    struct Refused;

    /// Notes each call and fails at `fails`.
    #[derive(Default)]
    struct Sink {
        calls: Vec<Call>,
        infos: Vec<FrameInfo>,
        fails: Option<Call>,
    }

    impl Sink {
        fn note(&mut self, call: Call) -> Result<(), Refused> {
            self.calls.push(call);
            if self.fails == Some(call) {
                Err(Refused)
            } else {
                Ok(())
            }
        }
    }

    impl DisparitySink for Sink {
        type Error = Refused;

        fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Refused> {
            self.infos.push(*info);
            self.note(Call::Begin(info.frame))
        }

        fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Refused> {
            self.note(Call::Line(frame, line.line))
        }

        fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Refused> {
            assert_eq!(self.infos.last(), Some(info));
            self.note(Call::End(info.frame))
        }

        fn abort_frame(&mut self, frame: u32, fault: Fault) {
            self.calls.push(Call::Abort(frame, fault));
        }
    }

    struct Meals<'a>(&'a Cell<u32>);

    impl Watchdog for Meals<'_> {
        fn feed(&mut self) {
            self.0.set(self.0.get() + 1);
        }
    }

    fn config() -> Config {
        let mut parameters = Preset::PaperRaw.parameters();
        parameters.synapses = 32;
        Config::new(parameters, GEOMETRY.width, DisparityRange::up_to(3))
    }

    /// Runs `body` with a session; returns how often the watchdog was fed.
    fn with_session(
        config: &Config,
        camera: Camera,
        sink: &mut Sink,
        body: impl FnOnce(&mut Session<'_, Camera, Portable, &mut Sink, Meals<'_>>),
    ) -> u32 {
        let mut memory = vec![0; config.memory_words()];
        let mut lines = vec![0; memory_words(&GEOMETRY)];
        let matcher = Matcher::new(config, Portable, &mut memory).unwrap();
        let meals = Cell::new(0);
        let watchdog = Meals(&meals);
        let session = Session::with_watchdog(camera, matcher, sink, &mut lines, watchdog);
        body(&mut session.unwrap());
        meals.get()
    }

    /// The events of all reads, the calls of the sink and the meals of the watchdog.
    fn run(
        reads: Vec<Result<LinePair, ErrorKind>>,
        fails: Option<Call>,
    ) -> (Vec<Result<Event, Refused>>, Vec<Call>, u32) {
        let count = reads.len();
        let mut sink = Sink {
            fails,
            ..Sink::default()
        };
        let mut events = Vec::new();
        let meals = with_session(&config(), camera(reads), &mut sink, |session| {
            events.extend((0..count).map(|_| session.step()));
        });
        (events, sink.calls, meals)
    }

    fn calls_of_whole(frame: u32) -> Vec<Call> {
        let lines = (0..GEOMETRY.height).map(|line| Call::Line(frame, line));
        let mut calls = vec![Call::Begin(frame)];
        calls.extend(lines);
        calls.push(Call::End(frame));
        calls
    }

    #[test]
    fn memory_of_the_line_buffers() {
        let words = |width, format| {
            memory_words(&Geometry {
                width,
                height: 480,
                format,
            })
        };
        assert_eq!(words(320, PixelFormat::Grey8) * 4, 2 * 320);
        assert_eq!(words(320, PixelFormat::Yuv422) * 4, 2 * 320 * 2);
        assert_eq!(words(320, PixelFormat::Rgb888) * 4, 2 * 320 * 3);
        // 3 x 33 bytes, rounded up to words.
        assert_eq!(words(33, PixelFormat::Rgb888) * 4, 2 * 100);
    }

    #[test]
    fn a_whole_frame_reaches_the_sink() {
        let (events, calls, meals) = run(whole_frame(4), None);
        let line = |line| Ok(Event::Line { frame: 4, line });
        let done = Ok(Event::FrameDone { frame: 4 });
        assert_eq!(events, [line(0), line(1), done]);
        assert_eq!(calls, calls_of_whole(4));
        assert_eq!(meals, 3);
    }

    #[test]
    fn a_broken_frame_is_aborted_and_the_next_whole_one_comes() {
        let sequence = Fault::Sequence;
        let bus = Fault::Camera(ErrorKind::Bus);
        for (broken, event, fault) in [
            (
                vec![pair(4, 0), pair(4, 2)],
                Event::Fault(sequence),
                sequence,
            ),
            (
                vec![pair(4, 0), Err(ErrorKind::Bus)],
                Event::Fault(bus),
                bus,
            ),
        ] {
            let mut reads = broken;
            reads.push(pair(4, 1));
            reads.extend(whole_frame(5));
            let (events, calls, meals) = run(reads, None);
            assert_eq!(events[1], Ok(event));
            assert_eq!(events[2], Ok(Event::Skipped { frame: 4, line: 1 }));
            assert_eq!(events[5], Ok(Event::FrameDone { frame: 5 }));
            let mut expected = vec![Call::Begin(4), Call::Abort(4, fault)];
            expected.extend(calls_of_whole(5));
            assert_eq!(calls, expected);
            assert_eq!(meals, 4);
        }
    }

    #[test]
    fn the_first_pair_of_a_later_frame_begins_that() {
        let mut reads = vec![pair(4, 0)];
        reads.extend(whole_frame(6));
        let (events, calls, meals) = run(reads, None);
        assert_eq!(events[1], Ok(Event::Resync { frame: 6 }));
        assert_eq!(events[3], Ok(Event::FrameDone { frame: 6 }));
        let mut expected = vec![Call::Begin(4), Call::Abort(4, Fault::Sequence)];
        expected.extend(calls_of_whole(6));
        assert_eq!(calls, expected);
        assert_eq!(meals, 4);
    }

    #[test]
    fn a_sink_that_fails_loses_the_frame() {
        for (fails, meals) in [
            (Call::Begin(4), 0),
            (Call::Line(4, 0), 2),
            (Call::Line(4, 2), 2),
            (Call::End(4), 2),
        ] {
            let mut sink = Sink {
                fails: Some(fails),
                ..Sink::default()
            };
            let mut reads = whole_frame(4);
            reads.extend(whole_frame(5));
            let fed = with_session(&config(), camera(reads), &mut sink, |session| {
                assert_eq!(session.run_frame(), Err(RunError::Sink(Refused)));
                assert_eq!(session.run_frame(), Ok(5));
                let statistics = session.statistics();
                assert_eq!(statistics.sink_errors, 1);
                assert_eq!((statistics.frames, statistics.frames_dropped), (1, 1));
            });
            assert_eq!(fed, meals + 3, "{fails:?}");
            let after = match fails {
                Call::Begin(_) => None,
                _ => Some(Call::Abort(4, Fault::Sink)),
            };
            let at = sink.calls.iter().position(|call| *call == fails).unwrap();
            let mut expected: Vec<Call> = after.into_iter().collect();
            expected.extend(calls_of_whole(5));
            assert_eq!(sink.calls[at + 1..], expected, "{fails:?}");
        }
    }

    #[test]
    fn a_run_gives_up_with_the_last_fault() {
        let timeout = Fault::Camera(ErrorKind::Timeout);
        for (reads, last_fault) in [
            (vec![], Some(timeout)),
            (vec![pair(4, 1); 12], None),
            (vec![Err(ErrorKind::Bus); 11], Some(timeout)),
        ] {
            let mut sink = Sink::default();
            with_session(&config(), camera(reads), &mut sink, |session| {
                let reads = 12;
                let gave_up = Err(RunError::Attempts { reads, last_fault });
                assert_eq!(session.run_frame(), gave_up);
            });
        }
        // Each frame breaks at its second line, and the next one begins at once.
        let reads = (0..12).map(|frame| pair(frame, 0)).collect();
        with_session(&config(), camera(reads), &mut Sink::default(), |session| {
            let last_fault = Some(Fault::Sequence);
            let gave_up = RunError::Attempts {
                reads: 12,
                last_fault,
            };
            assert_eq!(session.run_frame(), Err(gave_up));
            assert_eq!(session.statistics().sequence_breaks, 11);
        });
    }

    #[test]
    fn the_sink_is_told_the_time_and_the_region_within_the_frame() {
        for (y, height, expected) in [(0, u32::MAX, 3), (1, u32::MAX, 2), (1, 1, 1)] {
            let mut config = config();
            config.region.y = y;
            config.region.height = height;
            let mut sink = Sink::default();
            with_session(&config, camera(whole_frame(4)), &mut sink, |session| {
                assert_eq!(session.run_frame(), Ok(4));
                assert_eq!(session.sink().calls.len() as u32, 2 + expected);
            });
            let info = FrameInfo {
                frame: 4,
                timestamp_us: 400,
                region: Region {
                    height: expected,
                    ..config.region
                },
            };
            assert_eq!(sink.infos, [info]);
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refusal = |config: &Config, words: usize| {
            let mut memory = vec![0; config.memory_words()];
            let mut lines = vec![0; words];
            let matcher = Matcher::new(config, Portable, &mut memory).unwrap();
            Session::new(camera(vec![]), matcher, Sink::default(), &mut lines).err()
        };
        let words = memory_words(&GEOMETRY);
        assert_eq!(refusal(&config(), words), None);
        assert!(matches!(
            refusal(&config(), words - 1),
            Some(SessionError::Memory(_))
        ));
        let mut other = config();
        other.colour = true;
        let colour = SessionError::Colour {
            camera: GEOMETRY.format,
        };
        assert_eq!(refusal(&other, words), Some(colour));
        let mut other = config();
        other.width = 13;
        let width = SessionError::Width {
            camera_px: 12,
            matcher_px: 13,
        };
        assert_eq!(refusal(&other, words), Some(width));
        let mut other = config();
        other.region.y = 3;
        let height = SessionError::Height {
            camera_lines: 3,
            first_line: 3,
        };
        assert_eq!(refusal(&other, words), Some(height));
    }
}
