//! The session: one camera, one matcher, one sink, and what to do when a frame breaks.
//!
//! Pairs of lines must come numbered 0, 1, 2, ... to the last line of the frame. Anything
//! else - an error, a gap, a pair that comes twice, a pair of another frame - drops the
//! frame: the matcher forgets it, the sink is told, and the session searches for line 0 of
//! a frame that it has not seen. The disparities of that frame do not depend on what came
//! before. [`sync`] decides which pair is which; the session carries that out.

mod error;
mod event;
mod statistics;
pub mod sync;

pub use error::{RunError, SessionError};
pub use event::Event;
pub use statistics::Statistics;

use vgstereo_core::camera::{Error, Geometry, LinePair, LinePairSource};
use vgstereo_core::config::Region;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matcher::Matcher;
use vgstereo_core::memory::{Arena, words};

use crate::fault::Fault;
use crate::sink::{DisparitySink, FrameInfo};
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
/// matched.
///
/// A session waits only where the camera does, whose every wait is bounded, and where the
/// sink does.
#[derive(Debug)]
pub struct Session<'m, C, K, S, W = NoWatchdog> {
    camera: C,
    matcher: Matcher<'m, K>,
    sink: S,
    watchdog: W,
    geometry: Geometry,
    left: &'m mut [u8],
    right: &'m mut [u8],
    sync: FrameSync,
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
        let region = config.region;
        if geometry.height <= region.y {
            return Err(SessionError::Height {
                camera_lines: geometry.height,
                first_line: region.y,
            });
        }
        let region = Region {
            height: region.height.min(geometry.height.saturating_sub(region.y)),
            ..region
        };
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
            sync: FrameSync::new(geometry.height),
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

    /// Returns the camera.
    #[must_use]
    pub fn camera(&self) -> &C {
        &self.camera
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

    /// Reads the camera once, deals with what comes and returns what became of it. The last
    /// pair of a frame also brings the [`latency_lines`] lines of disparities still to come,
    /// within the gap between frames.
    ///
    /// [`latency_lines`]: vgstereo_core::config::Parameters::latency_lines
    ///
    /// # Errors
    /// The error of the sink. The frame is dropped; the next call goes on with a later one.
    pub fn step(&mut self) -> Result<Event, S::Error> {
        let event = match self.camera.read_pair(self.left, self.right) {
            Ok(pair) => self.take_pair(&pair)?,
            Err(error) => {
                let kind = error.kind();
                self.statistics.count_camera_error(kind);
                self.fail(Fault::Camera(kind))
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

    /// Deals with the pair in the line buffers.
    fn take_pair(&mut self, pair: &LinePair) -> Result<Event, S::Error> {
        let &LinePair { frame, line, .. } = pair;
        let (action, changes) = self.sync.pair(frame, line, pair.dropped);
        self.statistics.count(changes);
        match action {
            Action::Match => self.match_pair(pair),
            Action::Begin => self.begin_frame(pair),
            Action::Skip => Ok(Event::Skipped { frame, line }),
            Action::Resync { abort } => {
                self.abort(abort, Fault::Sequence);
                Ok(match self.begin_frame(pair)? {
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
    fn begin_frame(&mut self, pair: &LinePair) -> Result<Event, S::Error> {
        self.info.frame = pair.frame;
        self.info.timestamp_us = pair.timestamp_us;
        if let Err(error) = self.sink.begin_frame(&self.info) {
            return Err(self.fail_with_sink(error));
        }
        let changes = self.sync.begun();
        self.statistics.count(changes);
        self.match_pair(pair)
    }

    /// Matches the pair, the next one of the frame that is being read, and ends the frame
    /// with its last.
    fn match_pair(&mut self, pair: &LinePair) -> Result<Event, S::Error> {
        let &LinePair { frame, line, .. } = pair;
        let given = match self.matcher.push(self.left, self.right) {
            Ok(Some(disparities)) => self.sink.line(frame, &disparities),
            Ok(None) => Ok(()),
            Err(error) => return Ok(self.fail(Fault::Matcher(error))),
        };
        let is_whole = self.sync.is_whole();
        let given = given.and_then(|()| if is_whole { self.end_frame() } else { Ok(()) });
        if let Err(error) = given {
            return Err(self.fail_with_sink(error));
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
        while let Some(disparities) = self.matcher.finish() {
            self.sink.line(self.info.frame, &disparities)?;
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
            self.sink.abort_frame(frame, fault);
        }
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
}
