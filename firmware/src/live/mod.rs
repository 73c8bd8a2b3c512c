//! A live session: what the camera sees goes to a host over the link, and the host's commands come back.
//!
//! A [`Live`] is a [`Session`] with the messages of `vgstereo-link` at its end, over a [`LinkPort`] that
//! never waits. What the port has no room for is left out and counted; the camera is never kept waiting
//! for it. Commands are carried out between frames, pieces of a calibration also between lines.

mod commands;
mod port;
mod sender;
mod sink;
mod store;

pub use port::LinkPort;
pub use store::{CalibrationStore, NoStore, RamStore, StoreError};

use core::convert::Infallible;
use core::fmt::Display;

use vgstereo_core::config::{Checks, ChecksError, Output};
use vgstereo_core::geometry::{Rectification, RectifiedCamera, Rectifier};
use vgstereo_core::rows::{Arena, OutOfMemory, words};
use vgstereo_core::{Config, Kernels, LineOffsets, Matcher};
use vgstereo_link::board::{Camera, Hello, LinkCounters, Outcome, SessionCounters, View};
use vgstereo_link::{
    HostMessage, Parameters, PixelFormat, Selection, Source, State, Streams, memory_bytes,
};

use crate::calibration::Fit;
use crate::camera::{self, ErrorKind, Geometry, LinePair, LinePairSource, OrTestPattern};
use crate::fault::Fault;
use crate::session::{Event, Pushed, Session, SessionError, Statistics};
use crate::watchdog::Watchdog;
use commands::{Receiver, Upload};
use sender::Sender;
use sink::LinkSink;

/// The largest piece of a calibration that is taken, bytes.
const PIECE_BYTES_MAX: u16 = 256;

/// Returns the number of 32-bit words of [`Setup::memory`] for a camera of this geometry and a matcher
/// of this configuration: two packets, one of each direction, and two lines.
#[must_use]
pub const fn memory_words(geometry: &Geometry, config: &Config) -> usize {
    words(sent_bytes(geometry, config), 1)
        + words(received_bytes(), 1)
        + words(config.width as usize, size_of::<u16>())
        + words(2 * config.width as usize, 1)
}

/// Bytes of the largest packet to the host, which is the room that a port should have.
#[must_use]
pub const fn sent_bytes(geometry: &Geometry, config: &Config) -> usize {
    let raw = memory_bytes(geometry.width, camera_format(geometry.format), Streams::RAW);
    let matched = Streams::RECTIFIED
        .with(Streams::DISPARITIES)
        .with(Streams::CONFIDENCES)
        .with(Streams::DEPTHS);
    let matched = memory_bytes(config.width, PixelFormat::Grey8, matched);
    if raw > matched { raw } else { matched }
}

/// Bytes of the largest packet from the host, which a port should be able to keep while a frame is
/// matched.
#[must_use]
pub const fn received_bytes() -> usize {
    memory_bytes(0, PixelFormat::Grey8, Streams::NONE)
}

/// What a live session has besides a camera and a matcher.
#[derive(Debug)]
pub struct Setup<'m, P, T = NoStore> {
    /// The port to the host.
    pub port: P,
    /// Name of the device. The three names together may have up to 256 bytes.
    pub device: &'m str,
    /// Version of the firmware.
    pub firmware: &'m str,
    /// Name of the preset.
    pub preset: &'m str,
    /// The camera that the disparities are seen with, if it is known; with a rectifier, its own.
    pub camera: Option<RectifiedCamera>,
    /// What is sent until the host asks for something else.
    pub selection: Selection,
    /// Whether frames are sent before the host asks for them.
    pub is_started: bool,
    /// The time, µs, from any origin.
    pub clock: fn() -> u64,
    /// For how long the port may be waited for after a frame, µs: with its last pair come several lines
    /// of disparities at once. Less than the camera's gap between frames, or 0 to never wait; where
    /// frames begin when they are asked for, any time.
    pub gap_us: u64,
    /// Whether each frame begins with the offsets of lines that the last whole one taught, of which the host is then
    /// told in the log: see [`Session::keep_line_offsets`].
    pub keeps_line_offsets: bool,
    /// Where a calibration from the host is kept.
    pub store: T,
    /// Memory of [`memory_words`].
    pub memory: &'m mut [u32],
}

/// Whether a live session goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub enum Next {
    /// The pair, or its error, was dealt with: this has become of it.
    Event(Event),
    /// The host has stored another calibration, and knows. The session is to be ended, and another one
    /// built with it.
    Calibrated,
}

/// A source of lines that may have a test pattern in its place.
pub trait TestPatternSource {
    /// Delivers the pattern from the next frame on, or no longer; returns whether it can.
    fn show_pattern(&mut self, is_pattern: bool) -> bool;
}

impl<C: LinePairSource> TestPatternSource for OrTestPattern<C> {
    fn show_pattern(&mut self, is_pattern: bool) -> bool {
        self.show_pattern(is_pattern);
        true
    }
}

impl TestPatternSource for Pushed {
    fn show_pattern(&mut self, is_pattern: bool) -> bool {
        !is_pattern
    }
}

/// A session that sends what the host has selected, and carries out its commands between frames.
#[derive(Debug)]
pub struct Live<'m, C, K, P, W, T = NoStore> {
    session: Served<'m, C, K, P, W>,
    receiver: Receiver<'m>,
    upload: Upload<T>,
    /// A command that waits for the end of the frame, and its number.
    deferred: Option<(u32, HostMessage<'static>)>,
    /// The offsets of lines that the host was told last; `None` if it is not told of any.
    told: Option<LineOffsets>,
}

impl<'m, C, K, P, W, T> Live<'m, OrTestPattern<C>, K, P, W, T>
where
    C: LinePairSource,
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    T: CalibrationStore,
{
    /// A live session that reads `camera`. `lines` are [`session::memory_words`](crate::session::memory_words); for the rest, see
    /// [`Session::rectifying`].
    ///
    /// # Errors
    /// [`SessionError`] when camera, rectifier, matcher and memory do not suit each other.
    pub fn new(
        camera: C,
        rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
        matcher: Matcher<'m, K>,
        lines: &'m mut [u32],
        watchdog: W,
        setup: Setup<'m, P, T>,
    ) -> Result<Self, SessionError> {
        let geometry = camera.geometry();
        let camera = OrTestPattern::new(camera, setup.clock);
        let keeps = setup.keeps_line_offsets;
        let parts = parts(&geometry, rectifier.as_deref(), &matcher, setup)?;
        let session = Session::rectifying(camera, rectifier, matcher, parts.sink, lines, watchdog)?;
        Ok(Self::over(session, parts.receiver, parts.upload, keeps))
    }

    /// Reads the camera once and deals with what comes, as [`Session::step`] does, then takes commands if
    /// no frame is being read.
    pub fn step(&mut self) -> Next {
        let event = self.session.step();
        self.after(event)
    }
}

impl<'m, K, P, W, T> Live<'m, Pushed, K, P, W, T>
where
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    T: CalibrationStore,
{
    /// A live session that is given its pairs of lines, of this geometry: see [`Session::pushed`]. It has
    /// no test pattern.
    ///
    /// # Errors
    /// [`SessionError`] when geometry, rectifier, matcher and memory do not suit each other.
    pub fn pushed(
        geometry: Geometry,
        rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
        matcher: Matcher<'m, K>,
        watchdog: W,
        setup: Setup<'m, P, T>,
    ) -> Result<Self, SessionError> {
        let keeps = setup.keeps_line_offsets;
        let parts = parts(&geometry, rectifier.as_deref(), &matcher, setup)?;
        let session = Session::pushed(geometry, rectifier, matcher, parts.sink, watchdog)?;
        Ok(Self::over(session, parts.receiver, parts.upload, keeps))
    }
}

impl<'m, C, K, P, W, T> Live<'m, C, K, P, W, T>
where
    C: TestPatternSource,
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    T: CalibrationStore,
{
    fn over(
        mut session: Served<'m, C, K, P, W>,
        receiver: Receiver<'m>,
        upload: Upload<T>,
        keeps_line_offsets: bool,
    ) -> Self {
        session.keep_line_offsets(keeps_line_offsets);
        let told = keeps_line_offsets.then_some(session.matcher().line_offsets());
        Self {
            session,
            receiver,
            upload,
            deferred: None,
            told,
        }
    }

    /// Deals with a pair of lines that the camera has delivered, as [`Session::take_pair`] does.
    pub fn take_pair(&mut self, pair: &LinePair, left: &[u8], right: &[u8]) -> Next {
        let event = self.session.take_pair(pair, left, right);
        self.after(event)
    }

    /// Deals with an error of the camera, as [`Session::take_error`] does.
    pub fn take_error(&mut self, kind: ErrorKind) -> Next {
        let event = self.session.take_error(kind);
        self.after(Ok(event))
    }

    /// Sends what waits for the port, and takes commands. The other calls do this as well: it is for times
    /// in which no pair comes.
    pub fn serve(&mut self) -> Option<Next> {
        self.take_commands();
        let sender = &mut self.session.sink_mut().sender;
        sender.settle();
        // The host is to know before the session ends.
        let is_told = sender.owed.answer.is_none();
        (self.upload.is_stored && is_told).then_some(Next::Calibrated)
    }

    /// Tells the host this in the log, as soon as the port has room, unless something else is told before that. It is for
    /// what the board itself has to say, between two steps.
    pub fn tell(&mut self, what: &dyn Display) {
        self.session.sink_mut().sender.note(what);
    }

    /// What the session has counted since it began, or since the host has set the counters to 0.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.session.statistics()
    }

    /// What the end of the link has counted, likewise.
    #[must_use]
    pub fn link_counters(&self) -> LinkCounters {
        self.session.sink().sender.counters
    }

    /// Ends the session and returns its matcher, port and store.
    #[must_use]
    pub fn into_parts(self) -> (Matcher<'m, K>, P, T) {
        let (_, matcher, sink) = self.session.into_parts();
        (matcher, sink.sender.into_port(), self.upload.store)
    }

    fn after(&mut self, event: Result<Event, Infallible>) -> Next {
        let Ok(event) = event;
        let counters = session_counters(self.session.statistics());
        let sender = &mut self.session.sink_mut().sender;
        sender.session = counters;
        match event {
            Event::FrameDone { .. } => self.report_frame(),
            Event::Fault(fault) => _ = sender.report(Some(&fault)),
            Event::Resync { .. } => _ = sender.report(Some(&Fault::Sequence)),
            Event::Line { .. } | Event::Skipped { .. } => {}
        }
        self.serve().unwrap_or(Next::Event(event))
    }

    /// Tells the host of the frame that has ended, and how its lines lie, if that has changed and is to be told.
    fn report_frame(&mut self) {
        let matcher = self.session.matcher();
        let (offsets, reference) = (matcher.line_offsets(), matcher.config().reference);
        let is_news = self.told.is_some_and(|told| told != offsets);
        let sender = &mut self.session.sink_mut().sender;
        let told = offsets.told(sender.hello.matched.height_lines, reference);
        if sender.report(is_news.then_some(&told as &dyn Display)) && is_news {
            self.told = Some(offsets);
        }
    }

    /// Carries out commands, until none has come or an answer has to wait for the port. Amid a frame it is
    /// at most one piece of a calibration, of which there are many, and which bears on nothing else; any
    /// other command, and what comes after it, waits for the end of the frame.
    fn take_commands(&mut self) {
        let is_reading = self.session.is_reading();
        loop {
            let sender = &mut self.session.sink_mut().sender;
            count(
                &mut sender.counters.commands_refused,
                self.receiver.newly_refused(),
            );
            sender.settle();
            if sender.owed.answer.is_some() {
                return;
            }
            if let Some((sequence, command)) = self.deferred {
                if is_reading {
                    return;
                }
                self.deferred = None;
                let outcome = carry_out(&mut self.session, &mut self.upload, &command);
                self.answer(sequence, outcome);
                continue;
            }
            let sender = &mut self.session.sink_mut().sender;
            if !self.receiver.fill(sender.port_mut()) {
                return;
            }
            let Some(packet) = self.receiver.next() else {
                continue;
            };
            let sequence = packet.sequence;
            self.deferred = packet.message.detached().map(|command| (sequence, command));
            // Only a piece is not put off.
            if self.deferred.is_none() {
                let outcome = carry_out(&mut self.session, &mut self.upload, &packet.message);
                self.answer(sequence, outcome);
                if is_reading {
                    return;
                }
            }
        }
    }

    /// Answers a command, and counts it.
    fn answer(&mut self, sequence: u32, outcome: Outcome) {
        let sender = &mut self.session.sink_mut().sender;
        let counters = &mut sender.counters;
        let counter = match outcome {
            Outcome::Done => &mut counters.commands,
            _ => &mut counters.commands_refused,
        };
        count(counter, 1);
        sender.owed.answer = Some((sequence, outcome));
    }
}

/// Carries out a command.
fn carry_out<C, K, P, W, T>(
    session: &mut Served<'_, C, K, P, W>,
    upload: &mut Upload<T>,
    command: &HostMessage<'_>,
) -> Outcome
where
    C: TestPatternSource,
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    T: CalibrationStore,
{
    match *command {
        HostMessage::CalibrationPiece(piece) => upload.piece(&piece),
        HostMessage::CalibrationCommit { total_bytes, crc32 } => upload.commit(total_bytes, crc32),
        HostMessage::CalibrationDiscard => {
            upload.discard();
            Outcome::Done
        }
        HostMessage::Start => change(session, |state| state.is_started = true),
        HostMessage::Stop => change(session, |state| state.is_started = false),
        HostMessage::Select(selection) => select(session, selection),
        HostMessage::Source(source) => show(session, source),
        HostMessage::Parameters(parameters) => use_parameters(session, &parameters),
        HostMessage::ResetCounters => {
            session.reset_statistics();
            let sender = &mut session.sink_mut().sender;
            sender.session = SessionCounters::default();
            sender.counters = LinkCounters::default();
            Outcome::Done
        }
        HostMessage::SendHello => {
            session.sink_mut().sender.introduce();
            Outcome::Done
        }
    }
}

fn count(counter: &mut u32, times: u32) {
    *counter = counter.saturating_add(times);
}

/// The session behind a live one.
type Served<'m, C, K, P, W> = Session<'m, C, K, LinkSink<'m, P>, W>;

/// Changes the state, of which the host is told.
fn change<C, K: Kernels, P: LinkPort, W: Watchdog>(
    session: &mut Served<'_, C, K, P, W>,
    change: impl FnOnce(&mut State),
) -> Outcome {
    let sender = &mut session.sink_mut().sender;
    change(&mut sender.state);
    sender.owed.state = true;
    Outcome::Done
}

fn select<C, K: Kernels, P: LinkPort, W: Watchdog>(
    session: &mut Served<'_, C, K, P, W>,
    selection: Selection,
) -> Outcome {
    let has_pixels = selection
        .region
        .is_none_or(|region| region.width_px > 0 && region.height_lines > 0);
    let supported = session.sink().sender.hello.streams;
    if !supported.contains(selection.streams) {
        return Outcome::Unsupported;
    }
    if selection.every_frames == 0 || !has_pixels {
        return Outcome::OutOfBounds;
    }
    change(session, |state| state.selection = selection)
}

fn show<C: TestPatternSource, K: Kernels, P: LinkPort, W: Watchdog>(
    session: &mut Served<'_, C, K, P, W>,
    source: Source,
) -> Outcome {
    let is_pattern = source == Source::TestPattern;
    if !session.camera_mut().show_pattern(is_pattern) {
        return Outcome::Unsupported;
    }
    if session.sink().sender.state.source != source {
        // What was learned is of the other source's views.
        session.set_line_offsets(if is_pattern {
            LineOffsets::NONE
        } else {
            session.matcher().config().line_offsets
        });
    }
    change(session, |state| state.source = source)
}

fn use_parameters<C, K: Kernels, P: LinkPort, W: Watchdog>(
    session: &mut Served<'_, C, K, P, W>,
    parameters: &Parameters,
) -> Outcome {
    let asked = Parameters {
        confidence_min: None,
        ..*parameters
    };
    if asked != Parameters::default() {
        let Some(own) = session.matcher().config().checks() else {
            return Outcome::Unsupported;
        };
        match session.set_checks(&with(own, parameters)) {
            Ok(()) => {}
            Err(ChecksError::SpeckleSize) => return Outcome::OutOfBounds,
            Err(_) => return Outcome::Unsupported,
        }
    }
    let now = session.matcher().config().checks();
    change(session, |state| {
        let confidence_min = parameters.confidence_min;
        let confidence_min = confidence_min.or(state.parameters.confidence_min);
        state.parameters = stated(now, confidence_min);
    })
}

/// The checks with those parameters that are given.
fn with(own: Checks, parameters: &Parameters) -> Checks {
    let speckle = own.speckle.map(|mut speckle| {
        speckle.size_min = parameters.speckle_size_min.unwrap_or(speckle.size_min);
        speckle.step_q4 = parameters.speckle_step_q4.unwrap_or(speckle.step_q4);
        speckle
    });
    Checks {
        left_right_tolerance_px: parameters
            .left_right_tolerance_px
            .unwrap_or(own.left_right_tolerance_px),
        margin: parameters.margin.unwrap_or(own.margin),
        texture_min: parameters.texture_min.unwrap_or(own.texture_min),
        speckle,
        output: match parameters.dense {
            Some(true) => Output::Dense,
            Some(false) => Output::Sparse,
            None => own.output,
        },
    }
}

/// The parameters as the host is told.
fn stated(checks: Option<Checks>, confidence_min: Option<u8>) -> Parameters {
    let speckle = checks.and_then(|checks| checks.speckle);
    Parameters {
        margin: checks.map(|checks| checks.margin),
        left_right_tolerance_px: checks.map(|checks| checks.left_right_tolerance_px),
        texture_min: checks.map(|checks| checks.texture_min),
        speckle_size_min: speckle.map(|speckle| speckle.size_min),
        speckle_step_q4: speckle.map(|speckle| speckle.step_q4),
        confidence_min: Some(confidence_min.unwrap_or(0)),
        dense: checks.map(|checks| checks.output == Output::Dense),
    }
}

/// What a live session is built over.
struct Parts<'m, P, T> {
    sink: LinkSink<'m, P>,
    receiver: Receiver<'m>,
    upload: Upload<T>,
}

fn parts<'m, K: Kernels, P: LinkPort, T: CalibrationStore>(
    geometry: &Geometry,
    rectifier: Option<&Rectifier<'_, '_, K>>,
    matcher: &Matcher<'_, K>,
    setup: Setup<'m, P, T>,
) -> Result<Parts<'m, P, T>, OutOfMemory> {
    let config = matcher.config();
    let rectification = rectifier.map(Rectifier::rectification);
    let camera = match rectification {
        Some(rectification) => rectification.camera(config.reference),
        None => setup.camera,
    };
    let depths = match camera {
        Some(_) => Streams::DEPTHS,
        None => Streams::NONE,
    };
    let rectified = match rectification {
        Some(_) => Streams::RECTIFIED,
        None => Streams::NONE,
    };
    let streams = Streams::RAW
        .with(Streams::DISPARITIES)
        .with(Streams::CONFIDENCES)
        .with(depths)
        .with(rectified);
    let height_lines = rectification.map_or(geometry.height, |r| r.height.into());
    let hello = Hello {
        device: setup.device,
        firmware: setup.firmware,
        raw: View {
            width_px: geometry.width,
            height_lines: geometry.height,
            format: camera_format(geometry.format),
        },
        matched: View {
            width_px: config.width,
            height_lines,
            format: if config.colour {
                PixelFormat::Rgb888
            } else {
                PixelFormat::Grey8
            },
        },
        preset: setup.preset,
        disparity_min_px: config.disparities.minimum_px,
        disparity_count: config.disparities.count,
        latency_lines: config.parameters.latency_lines(),
        streams,
        calibration_crc32: rectification.map(Rectification::crc32),
        rectifies: rectification.is_some(),
        piece_bytes_max: if setup.store.capacity_bytes() > 0 {
            PIECE_BYTES_MAX
        } else {
            0
        },
    };
    let camera_message = camera.map(|camera| {
        let [principal_x_q8, principal_y_q8] = camera.principal_q8();
        Camera {
            focal_q8: camera.focal_q8(),
            principal_x_q8,
            principal_y_q8,
            depth_q8: camera.depth().numerator_q8(),
            offset_q8: camera.depth().offset_q8(),
        }
    });
    let state = State {
        is_started: setup.is_started,
        selection: setup.selection,
        source: Source::Camera,
        parameters: stated(config.checks(), None),
    };
    let width = usize::from(config.width);
    let mut arena = Arena::new(setup.memory);
    let packet = arena.take(sent_bytes(geometry, config))?;
    let (clock, gap_us) = (setup.clock, setup.gap_us);
    let sender = Sender::new(
        setup.port,
        packet,
        clock,
        gap_us,
        hello,
        camera_message,
        state,
    );
    let receiver = Receiver::new(arena.take(received_bytes())?);
    let last_line = geometry.height.saturating_sub(1);
    let (values, levels) = (arena.take(width)?, arena.take(2 * width)?);
    let depth = camera.map(|camera| camera.depth());
    let fit = Fit {
        raw: *geometry,
        width: config.width,
        colour: config.colour,
        rectifier_words: setup.store.rectifier_words(),
    };
    Ok(Parts {
        sink: LinkSink::new(sender, depth, last_line, values, levels),
        receiver,
        upload: Upload::new(setup.store, fit),
    })
}

/// A camera's format, as the link names it. Formats that the link does not have are taken for grey.
const fn camera_format(format: camera::PixelFormat) -> PixelFormat {
    match format {
        camera::PixelFormat::Rgb888 => PixelFormat::Rgb888,
        camera::PixelFormat::Rgb565 => PixelFormat::Rgb565,
        camera::PixelFormat::Yuv422 => PixelFormat::Yuv422,
        _ => PixelFormat::Grey8,
    }
}

fn session_counters(statistics: Statistics) -> SessionCounters {
    SessionCounters {
        frames: statistics.frames,
        frames_dropped: statistics.frames_dropped,
        lines: statistics.lines,
        lines_dropped: statistics.lines_dropped,
        sequence_breaks: statistics.sequence_breaks,
        overruns: statistics.overruns,
        sync_losses: statistics.sync_losses,
        short_lines: statistics.short_lines,
        short_frames: statistics.short_frames,
        timeouts: statistics.timeouts,
        bus_errors: statistics.bus_errors,
        other_errors: statistics.other_errors,
        sink_errors: statistics.sink_errors,
    }
}

#[cfg(test)]
mod tests;
