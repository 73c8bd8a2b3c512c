//! The session: one camera, one matcher, one sink, and what to do when a frame breaks.
//!
//! Pairs must come numbered 0, 1, 2, ... to the last line of the frame. Whatever else
//! comes - an error, a gap, a pair twice, another frame - drops the frame: the matcher
//! forgets it, the sink is told, and the session searches for line 0 of a frame it has
//! not seen. That frame's disparities do not depend on what went before.

mod error;
mod event;
pub mod sync;

pub use error::{RunError, SessionError};
pub use event::Event;

use vgstereo_core::camera::{Error, ErrorKind, Geometry, LinePair, LinePairSource};
use vgstereo_core::config::Region;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matcher::Matcher;
use vgstereo_core::memory::{Arena, words};

use crate::fault::Fault;
use crate::sink::{DisparitySink, FrameInfo};
use crate::watchdog::{NoWatchdog, Watchdog};

/// [`Session::run_frame`] gives up after this many frames' worth of reads: the rest of
/// the frame that the camera is in, two broken frames and a whole one.
pub const ATTEMPT_FRAMES: u32 = 4;

/// Words of 32 bits that [`Session::new`] takes, besides the matcher's own: two lines as
/// the camera delivers them, each rounded up to words.
#[must_use]
pub const fn memory_words(geometry: &Geometry) -> usize {
    2 * words(geometry.line_bytes(), 1)
}

/// What a session has seen since it began. All counters saturate.
///
/// `lines + lines_dropped` is the number of pairs that the camera delivered or knows to
/// have lost between deliveries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Statistics {
    /// Frames whose disparities are all at the sink.
    pub frames: u32,
    /// Frames that are not, from the frame of the first pair delivered: begun and
    /// dropped, or missed as the numbers tell. A frame of which nothing came is counted
    /// when a later one is seen.
    pub frames_dropped: u32,
    /// Pairs given to the matcher, those of dropped frames too.
    pub lines: u32,
    /// Pairs lost by the camera ([`LinePair::dropped`]) or delivered and left out.
    pub lines_dropped: u32,
    /// Times that another pair than the next one came, with no error to tell of it.
    pub sequence_breaks: u32,
    /// Errors of kind [`ErrorKind::Overrun`].
    pub overruns: u32,
    /// Errors of kind [`ErrorKind::SyncLost`].
    pub sync_losses: u32,
    /// Errors of kind [`ErrorKind::ShortLine`].
    pub short_lines: u32,
    /// Errors of kind [`ErrorKind::ShortFrame`].
    pub short_frames: u32,
    /// Errors of kind [`ErrorKind::Timeout`].
    pub timeouts: u32,
    /// Errors of kind [`ErrorKind::Bus`].
    pub bus_errors: u32,
    /// Errors of any other kind.
    pub other_errors: u32,
    /// Errors of the sink.
    pub sink_errors: u32,
}

impl Statistics {
    /// Errors of the camera of kind `kind`; a kind without a counter shares that of
    /// [`ErrorKind::Other`].
    #[must_use]
    pub fn errors(mut self, kind: ErrorKind) -> u32 {
        *self.counter(kind)
    }

    fn counter(&mut self, kind: ErrorKind) -> &mut u32 {
        match kind {
            ErrorKind::Overrun => &mut self.overruns,
            ErrorKind::SyncLost => &mut self.sync_losses,
            ErrorKind::ShortLine => &mut self.short_lines,
            ErrorKind::ShortFrame => &mut self.short_frames,
            ErrorKind::Timeout => &mut self.timeouts,
            ErrorKind::Bus => &mut self.bus_errors,
            _ => &mut self.other_errors,
        }
    }
}

fn count(counter: &mut u32, times: u32) {
    *counter = counter.saturating_add(times);
}

/// What the session expects next.
#[derive(Debug, Clone, Copy)]
enum State {
    /// Line 0 of whatever frame; other lines are no fault.
    Searching,
    /// Line 0 of the frame after the one finished last.
    Between,
    /// Line `next_line` of the frame.
    Reading { info: FrameInfo, next_line: u32 },
}

/// The first frame that is neither finished nor counted as dropped.
#[derive(Debug, Clone, Copy)]
struct NextFrame(Option<u32>);

impl NextFrame {
    /// Whether `frame` is finished or dropped: its lines, line 0 too, are of no use.
    fn is_past(self, frame: u32) -> bool {
        self.0.is_some_and(|next| frame == next.wrapping_sub(1))
    }

    /// Whether `frame` follows the one before without a gap.
    fn is(self, frame: u32) -> bool {
        self.0.is_none_or(|next| frame == next)
    }

    /// Goes on to `frame`; returns how many were missed. A number from before, as after a
    /// restart of the camera, misses none.
    fn go_to(&mut self, frame: u32) -> u32 {
        let missed = self.0.map_or(0, |next| frame.wrapping_sub(next));
        self.0 = Some(frame);
        if missed <= u32::MAX / 2 { missed } else { 0 }
    }
}

/// Connects a camera to a matcher and a sink, and feeds a watchdog as long as that goes on.
///
/// Nothing waits but the camera, whose every wait is bounded, and the sink.
#[derive(Debug)]
pub struct Session<'m, C, K, S, W = NoWatchdog> {
    camera: C,
    matcher: Matcher<'m, K>,
    sink: S,
    watchdog: W,
    geometry: Geometry,
    left: &'m mut [u8],
    right: &'m mut [u8],
    state: State,
    next_frame: NextFrame,
    statistics: Statistics,
}

impl<'m, C: LinePairSource, K: Kernels, S: DisparitySink> Session<'m, C, K, S> {
    /// Begins a session, in at least [`memory_words`] of lent memory. What the matcher
    /// had of a frame is forgotten. Pass `&mut camera` or `&mut sink` to keep them.
    ///
    /// # Errors
    /// [`SessionError`] when the camera's geometry does not suit the matcher or the
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

impl<'m, C: LinePairSource, K: Kernels, S: DisparitySink, W: Watchdog> Session<'m, C, K, S, W> {
    /// The same as [`Session::new`] with a watchdog, which runs already or is started
    /// before the first step; pass `&mut watchdog` to keep it. [`Watchdog`] tells when it is
    /// fed.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn with_watchdog(
        camera: C,
        mut matcher: Matcher<'m, K>,
        sink: S,
        memory: &'m mut [u32],
        watchdog: W,
    ) -> Result<Self, SessionError> {
        let geometry = camera.geometry();
        let config = matcher.config();
        if geometry.width != config.width {
            return Err(SessionError::Width {
                camera_px: geometry.width,
                matcher_px: config.width,
            });
        }
        if geometry.format != config.format {
            return Err(SessionError::Format {
                camera: geometry.format,
                matcher: config.format,
            });
        }
        if geometry.height <= config.region.y {
            return Err(SessionError::Height {
                camera_lines: geometry.height,
                first_line: config.region.y,
            });
        }
        let mut arena = Arena::new(memory);
        let line_bytes = geometry.line_bytes();
        matcher.reset();
        Ok(Self {
            camera,
            matcher,
            sink,
            watchdog,
            geometry,
            left: arena.take(line_bytes)?,
            right: arena.take(line_bytes)?,
            state: State::Searching,
            next_frame: NextFrame(None),
            statistics: Statistics::default(),
        })
    }

    /// What was seen so far.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &C {
        &self.camera
    }

    /// The sink.
    #[must_use]
    pub fn sink(&self) -> &S {
        &self.sink
    }

    /// The sink, to take from it what it has collected.
    #[must_use]
    pub fn sink_mut(&mut self) -> &mut S {
        &mut self.sink
    }

    /// Ends the session. A frame that is being read is neither ended nor aborted.
    #[must_use]
    pub fn into_parts(self) -> (C, Matcher<'m, K>, S) {
        (self.camera, self.matcher, self.sink)
    }

    /// Reads the camera once and deals with what comes. The last pair of a frame also
    /// gives the [`latency_lines`] lines still to come, within the gap between frames.
    ///
    /// [`latency_lines`]: vgstereo_core::config::Parameters::latency_lines
    ///
    /// # Errors
    /// The sink's error; the frame is dropped and the session goes on with the next.
    pub fn step(&mut self) -> Result<Event, S::Error> {
        let event = match self.camera.read_pair(self.left, self.right) {
            Ok(pair) => self.take_pair(&pair)?,
            Err(error) => {
                let kind = error.kind();
                count(self.statistics.counter(kind), 1);
                self.lose(Fault::Camera(kind))
            }
        };
        match event {
            Event::Line { .. } | Event::FrameDone { .. } | Event::Resync { .. } => {
                self.watchdog.feed();
            }
            Event::Skipped { .. } | Event::Fault(_) => {}
        }
        Ok(event)
    }

    /// Steps until a frame is done; returns its number. At most [`ATTEMPT_FRAMES`] times
    /// the frame's height steps.
    ///
    /// # Errors
    /// [`RunError`] when no frame came whole in that many steps or the sink failed. The
    /// session can go on.
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

    fn take_pair(&mut self, pair: &LinePair) -> Result<Event, S::Error> {
        count(&mut self.statistics.lines_dropped, pair.dropped);
        let is_next = match self.state {
            State::Reading { info, next_line } => {
                if pair.frame == info.frame && pair.line == next_line {
                    return self.match_pair(info, pair.line);
                }
                false
            }
            State::Between => pair.line == 0 && self.next_frame.is(pair.frame),
            State::Searching => true,
        };
        if !is_next {
            count(&mut self.statistics.sequence_breaks, 1);
            self.lose(Fault::Sequence);
        }

        let is_past = self.next_frame.is_past(pair.frame);
        if pair.line != 0 || is_past {
            count(&mut self.statistics.lines_dropped, 1);
            if !is_past {
                self.drop_frame(pair.frame);
            }
            return Ok(if is_next {
                Event::Skipped {
                    frame: pair.frame,
                    line: pair.line,
                }
            } else {
                Event::Fault(Fault::Sequence)
            });
        }

        let info = self.begin_frame(pair)?;
        let event = self.match_pair(info, 0)?;
        Ok(match event {
            Event::Line { frame, .. } if !is_next => Event::Resync { frame },
            _ => event,
        })
    }

    fn begin_frame(&mut self, pair: &LinePair) -> Result<FrameInfo, S::Error> {
        let region = self.matcher.config().region;
        let info = FrameInfo {
            frame: pair.frame,
            timestamp_us: pair.timestamp_us,
            region: Region {
                height: region
                    .height
                    .min(self.geometry.height.saturating_sub(region.y)),
                ..region
            },
        };
        if let Err(error) = self.sink.begin_frame(&info) {
            count(&mut self.statistics.sink_errors, 1);
            count(&mut self.statistics.lines_dropped, 1);
            self.drop_frame(pair.frame);
            self.state = State::Searching;
            return Err(error);
        }
        let missed = self.next_frame.go_to(pair.frame);
        count(&mut self.statistics.frames_dropped, missed);
        Ok(info)
    }

    /// Matches the pair in the line buffers: line `line` of the frame, the next one.
    fn match_pair(&mut self, info: FrameInfo, line: u32) -> Result<Event, S::Error> {
        let next_line = line.saturating_add(1);
        self.state = State::Reading { info, next_line };
        count(&mut self.statistics.lines, 1);
        let given = match self.matcher.push(self.left, self.right) {
            Ok(Some(disparities)) => self.sink.line(info.frame, &disparities),
            Ok(None) => Ok(()),
            Err(error) => return Ok(self.lose(Fault::Matcher(error))),
        };
        if next_line < self.geometry.height {
            return match given {
                Ok(()) => Ok(Event::Line {
                    frame: info.frame,
                    line,
                }),
                Err(error) => Err(self.lose_to_sink(error)),
            };
        }
        match given.and_then(|()| self.flush(&info)) {
            Ok(()) => {
                count(&mut self.statistics.frames, 1);
                self.state = State::Between;
                self.next_frame = NextFrame(Some(info.frame.wrapping_add(1)));
                Ok(Event::FrameDone { frame: info.frame })
            }
            Err(error) => Err(self.lose_to_sink(error)),
        }
    }

    /// Gives the lines still to come and ends the frame.
    fn flush(&mut self, info: &FrameInfo) -> Result<(), S::Error> {
        while let Some(disparities) = self.matcher.finish() {
            self.sink.line(info.frame, &disparities)?;
        }
        self.sink.end_frame(info)
    }

    fn lose_to_sink(&mut self, error: S::Error) -> S::Error {
        count(&mut self.statistics.sink_errors, 1);
        self.lose(Fault::Sink);
        error
    }

    /// Drops the frame that is being read, if any, and searches for the next.
    fn lose(&mut self, fault: Fault) -> Event {
        if let State::Reading { info, .. } = self.state {
            self.matcher.reset();
            self.sink.abort_frame(info.frame, fault);
            self.drop_frame(info.frame);
        }
        self.state = State::Searching;
        Event::Fault(fault)
    }

    /// Counts `frame` as dropped, and those missed before it.
    fn drop_frame(&mut self, frame: u32) {
        let missed = self.next_frame.go_to(frame);
        count(
            &mut self.statistics.frames_dropped,
            missed.saturating_add(1),
        );
        self.next_frame = NextFrame(Some(frame.wrapping_add(1)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::camera::PixelFormat;

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
    fn frames_missed_are_told_by_their_numbers() {
        let mut next = NextFrame(None);
        assert!(next.is(9) && !next.is_past(8));
        assert_eq!(next.go_to(9), 0);
        assert!(next.is(9) && next.is_past(8));
        assert_eq!(next.go_to(12), 3);
    }

    #[test]
    fn frame_numbers_wrap() {
        let mut next = NextFrame(Some(u32::MAX));
        assert_eq!(next.go_to(1), 2);
        next = NextFrame(Some(0));
        assert!(next.is_past(u32::MAX));
        // The camera began again from 0.
        next = NextFrame(Some(5));
        assert_eq!(next.go_to(0), 0);
        assert!(next.is(0));
    }

    #[test]
    fn counters_saturate_and_unknown_kinds_share_one() {
        let mut statistics = Statistics::default();
        for _ in 0..2 {
            count(statistics.counter(ErrorKind::Other), u32::MAX - 1);
        }
        assert_eq!(statistics.errors(ErrorKind::Other), u32::MAX);
        assert_eq!(statistics.other_errors, u32::MAX);
        assert_eq!(statistics.errors(ErrorKind::Bus), 0);
    }
}
