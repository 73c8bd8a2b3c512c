//! The sending end: packets to a port that may be full, and the messages that must not be lost there.

use core::fmt::{Display, Write};

use heapless::String;
use vgstereo_link::board::{
    Camera, FrameBegun, Hello, Level, LinkCounters, Outcome, SessionCounters, Statistics,
};
use vgstereo_link::{BoardMessage, DELIMITER, Encoder, Reason, State};

use super::port::LinkPort;

/// Time between two messages of statistics or of a log at least, µs.
const REPORT_PERIOD_US: u64 = 250_000;

/// Bytes of a line of the log; a longer one is cut.
const LOG_BYTES: usize = 96;

/// A line of the log.
type Text = String<LOG_BYTES>;

/// How a frame has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Done,
    Aborted(Reason),
}

/// Messages that wait until the port has room, each of which replaces an older one of its kind.
#[derive(Debug, Default)]
pub(super) struct Owed {
    pub(super) hello: bool,
    pub(super) answer: Option<(u32, Outcome)>,
    pub(super) state: bool,
    pub(super) begun: Option<FrameBegun>,
    pub(super) end: Option<(u32, End)>,
    statistics: bool,
    warning: Option<Text>,
    note: Option<Text>,
    camera: bool,
}

/// Makes packets and hands them to the port. A packet is sent whole or not at all, and one after the
/// other: while the port has not taken one to its end, lines are left out and counted.
#[derive(Debug)]
pub(super) struct Sender<'m, P> {
    port: P,
    encoder: Encoder<'m>,
    clock: fn() -> u64,
    /// Number of bytes of the packet under way that the port has taken.
    taken: usize,
    /// Whether the delimiter before the first packet was sent.
    has_begun: bool,
    /// Longest time to wait for the port in the gap after a frame, µs.
    gap_us: u64,
    /// Until when the port may be waited for.
    waits_until_us: u64,
    reported_us: Option<u64>,
    pub(super) owed: Owed,
    pub(super) hello: Hello<'m>,
    pub(super) camera: Option<Camera>,
    pub(super) state: State,
    pub(super) session: SessionCounters,
    pub(super) counters: LinkCounters,
}

impl<'m, P: LinkPort> Sender<'m, P> {
    pub(super) fn new(
        port: P,
        memory: &'m mut [u8],
        clock: fn() -> u64,
        gap_us: u64,
        hello: Hello<'m>,
        camera: Option<Camera>,
        state: State,
    ) -> Self {
        let mut sender = Self {
            port,
            encoder: Encoder::new(memory),
            clock,
            taken: 0,
            has_begun: false,
            gap_us,
            waits_until_us: 0,
            reported_us: None,
            owed: Owed::default(),
            hello,
            camera,
            state,
            session: SessionCounters::default(),
            counters: LinkCounters::default(),
        };
        sender.introduce();
        sender
    }

    pub(super) fn port_mut(&mut self) -> &mut P {
        &mut self.port
    }

    pub(super) fn into_port(self) -> P {
        self.port
    }

    pub(super) fn now_us(&self) -> u64 {
        (self.clock)()
    }

    /// Hello, camera and state are to be sent.
    pub(super) fn introduce(&mut self) {
        self.owed.hello = true;
        self.owed.camera = self.camera.is_some();
        self.owed.state = true;
    }

    /// Counters are to be sent, and this warning, unless others were a short time ago; returns whether they are.
    pub(super) fn report(&mut self, warning: Option<&dyn Display>) -> bool {
        let now_us = self.now_us();
        let is_early = self
            .reported_us
            .is_some_and(|reported_us| now_us.saturating_sub(reported_us) < REPORT_PERIOD_US);
        if is_early {
            return false;
        }
        self.reported_us = Some(now_us);
        self.owed.statistics = true;
        self.owed.warning = warning.map(cut);
        true
    }

    /// This is to be in the log, in place of what is still owed of it.
    pub(super) fn note(&mut self, what: &dyn Display) {
        self.owed.note = Some(cut(what));
    }

    /// The camera has sent the last pair of a frame: from now on the port may be waited for, as long as
    /// the gap is.
    pub(super) fn begin_gap(&mut self) {
        self.waits_until_us = self.now_us().saturating_add(self.gap_us);
    }

    /// The camera sends a frame: the port is not waited for.
    pub(super) fn end_gap(&mut self) {
        self.waits_until_us = 0;
    }

    /// Gives the port what it takes of the packet under way; returns whether it has all of it.
    pub(super) fn pump(&mut self) -> bool {
        if !self.has_begun {
            self.has_begun = self.port.send(&[DELIMITER]) > 0;
            if !self.has_begun {
                return false;
            }
        }
        let rest = self.encoder.packet().get(self.taken..).unwrap_or_default();
        if rest.is_empty() {
            return true;
        }
        let length = rest.len();
        let taken = self.port.send(rest).min(length);
        self.taken += taken;
        taken == length
    }

    /// Waits for the port in the gap between frames; elsewhere it looks once.
    fn is_free(&mut self) -> bool {
        while !self.pump() {
            if self.waits_until_us == 0 || self.now_us() >= self.waits_until_us {
                return false;
            }
        }
        true
    }

    /// Sends a message if the port has taken the one before.
    fn try_send(&mut self, message: &BoardMessage<'_>) -> bool {
        if !self.is_free() {
            return false;
        }
        self.taken = 0;
        let now_us = self.now_us();
        if self.encoder.encode(now_us, message).is_err() {
            // The memory is too small for it, now and later.
            self.counters.dropped = self.counters.dropped.saturating_add(1);
            return true;
        }
        self.counters.packets = self.counters.packets.saturating_add(1);
        self.pump();
        true
    }

    /// Sends what is owed, as far as the port has room; returns whether all of it was sent.
    pub(super) fn settle(&mut self) -> bool {
        self.pump();
        if self.owed.hello {
            let hello = BoardMessage::Hello(self.hello);
            self.owed.hello = !self.try_send(&hello);
        }
        if let Some(camera) = self.camera.filter(|_| self.owed.camera && !self.owed.hello) {
            self.owed.camera = !self.try_send(&BoardMessage::Camera(camera));
        }
        if let Some((sequence, outcome)) = self.owed.answer
            && self.try_send(&BoardMessage::Answer { sequence, outcome })
        {
            self.owed.answer = None;
        }
        if self.owed.state && self.owed.answer.is_none() {
            self.owed.state = !self.try_send(&BoardMessage::State(self.state));
        }
        if let Some((frame, end)) = self.owed.end {
            let message = match end {
                End::Done => BoardMessage::FrameDone { frame },
                End::Aborted(reason) => BoardMessage::FrameAborted { frame, reason },
            };
            if self.try_send(&message) {
                self.owed.end = None;
            }
        }
        if self.owed.statistics {
            let statistics = BoardMessage::Statistics(Statistics {
                session: self.session,
                link: self.counters,
            });
            self.owed.statistics = !self.try_send(&statistics);
        }
        let (note, warning) = (self.owed.note.take(), self.owed.warning.take());
        self.owed.note = self.log(note);
        self.owed.warning = self.log(warning);
        if self.owed.end.is_none()
            && let Some(begun) = self.owed.begun
            && self.try_send(&BoardMessage::FrameBegun(begun))
        {
            self.owed.begun = None;
        }
        // Answers and reports may wait; the lines of a frame may not come before its beginning.
        self.owed.begun.is_none() && self.owed.end.is_none()
    }

    /// Sends a line of the log, if there is one; returns it if it has to wait.
    fn log(&mut self, line: Option<Text>) -> Option<Text> {
        let level = Level::Warning;
        let text = line.as_deref()?;
        let is_sent = self.try_send(&BoardMessage::Log { level, text });
        line.filter(|_| !is_sent)
    }

    /// Sends a line, or counts it as dropped where the port is full.
    pub(super) fn send_line(&mut self, message: &BoardMessage<'_>) {
        if !(self.settle() && self.try_send(message)) {
            self.counters.dropped = self.counters.dropped.saturating_add(1);
        }
    }
}

/// The text of this, as much of it as a line of the log has room for.
fn cut(what: &dyn Display) -> Text {
    let mut text = Text::new();
    let _ = write!(text, "{what}");
    text
}
