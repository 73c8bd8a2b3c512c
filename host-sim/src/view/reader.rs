//! The thread that reads a board, commands it, and publishes what it tells.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use vgstereo_core::geometry::RectifiedCamera;
use vgstereo_link::{HostMessage, Parameters, Selection, Streams};

use super::hub::Hub;
use super::request::{Command, Show};
use super::snapshot;
use super::status::{CameraStatus, CommandStatus, PacketCounts, SourceKind, SourceStatus, Status};
use crate::link::board::{Board, Change, Frame, outcome_name};
use crate::link::client::{Client, Memory};
use crate::link::source::{Port, Received, Source};

/// Time between two messages of status at least, but for those that tell of a lost source.
const STATUS_PERIOD: Duration = Duration::from_millis(100);
/// For how long a board may take to answer a command.
const ANSWER_WAIT: Duration = Duration::from_secs(2);
/// Time between two attempts to open a lost source.
const RETRY_PERIOD: Duration = Duration::from_secs(1);
/// Commands whose outcome is kept.
const COMMANDS_KEPT: usize = 12;
/// What any board is assumed to send until it has introduced itself.
const USUAL_STREAMS: Streams = Streams::RAW
    .with(Streams::DISPARITIES)
    .with(Streams::CONFIDENCES);

/// Reads a board.
#[derive(Debug)]
pub struct Reader {
    hub: Arc<Hub>,
    requests: Receiver<Command>,
    board: Board,
    /// The camera of `--calibration`.
    calibrated: Option<RectifiedCamera>,
    source: SourceStatus,
    commands: VecDeque<Sent>,
    /// Whether the board is to send frames.
    is_started: bool,
    /// What is shown, and the last frame, which is shown anew when that changes.
    shown: Show,
    last: Option<Box<Frame>>,
    packets: PacketCounts,
    asked: Streams,
    published: Option<Instant>,
    is_changed: bool,
}

/// A command, and when it was sent.
#[derive(Debug)]
struct Sent {
    status: CommandStatus,
    at: Instant,
}

/// A connection to a board.
struct Connection<'m> {
    client: Client<'m>,
    /// What was asked of the board.
    selected: Option<Streams>,
    /// When the board was last asked for its hello, and whether more than once.
    greeted: Instant,
    is_late: bool,
    /// Why it is of no use any more.
    failure: Option<String>,
}

/// Why a source has ended.
struct End {
    reason: String,
    /// Of a recording, where it is no longer whole.
    damage: Option<String>,
}

impl End {
    fn for_reason(reason: String) -> Self {
        Self {
            reason,
            damage: None,
        }
    }
}

impl Reader {
    /// A reader that publishes to this hub and takes commands from this end of it. `calibrated` is
    /// the camera that disparities are seen with, where the board tells none.
    #[must_use]
    pub fn new(
        source: &Source,
        hub: Arc<Hub>,
        requests: Receiver<Command>,
        calibrated: Option<RectifiedCamera>,
    ) -> Self {
        Self {
            hub,
            requests,
            board: Board::default(),
            calibrated,
            source: SourceStatus {
                name: source.name(),
                kind: SourceKind::Connected,
                reason: None,
            },
            commands: VecDeque::new(),
            is_started: true,
            shown: Show::default(),
            last: None,
            packets: PacketCounts::default(),
            asked: Streams::NONE,
            published: None,
            is_changed: true,
        }
    }

    /// Reads `port`, which is `source`, and opens it again when it is lost, until no one is left
    /// who could look.
    pub fn run(mut self, source: &Source, port: Port) {
        let mut port = Some(port);
        loop {
            if let Some(open) = port.take() {
                self.tell(SourceKind::Connected, None);
                let is_recording = open.is_recording;
                let end = self.serve(open);
                if is_recording {
                    self.tell(SourceKind::Ended, end.damage);
                } else {
                    self.board.disconnect();
                    self.tell(SourceKind::Lost, Some(end.reason));
                }
            }
            let tried = Instant::now();
            while tried.elapsed() < RETRY_PERIOD {
                match self.requests.recv_timeout(STATUS_PERIOD) {
                    Ok(command) => {
                        let why = match self.source.kind {
                            SourceKind::Ended => "a recording takes no commands",
                            _ => "not sent: there is no connection",
                        };
                        self.keep(command_name(&command), None, Some(why));
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
                self.follow_shown();
                self.publish();
            }
            if self.source.kind == SourceKind::Lost {
                match source.open() {
                    Ok(open) => port = Some(open),
                    Err(error) => self.tell(SourceKind::Lost, Some(format!("{error:#}"))),
                }
            }
        }
    }

    /// Tells what has become of the source.
    fn tell(&mut self, kind: SourceKind, reason: Option<String>) {
        self.source.kind = kind;
        self.source.reason = reason;
        self.is_changed = true;
        self.published = None;
        self.publish();
    }

    /// Reads an open source to its end, and returns why it has ended.
    fn serve(&mut self, port: Port) -> End {
        let mut memory = Memory::default();
        let client = match Client::new(port, &mut memory) {
            Ok(client) => client,
            Err(error) => return End::for_reason(error.to_string()),
        };
        let mut connection = Connection {
            client,
            selected: None,
            greeted: Instant::now(),
            is_late: false,
            failure: None,
        };
        self.packets = PacketCounts::default();
        self.send(&mut connection, "hello", &HostMessage::SendHello);
        self.set_up(&mut connection);
        loop {
            match connection.client.read() {
                Received::Bytes(count) => {
                    self.packets.bytes += count as u64;
                    self.take(&mut connection);
                    self.is_changed = true;
                }
                Received::Nothing => {}
                Received::Ended(reason) => {
                    let damage = connection.client.damage().map(ToString::to_string);
                    return End { reason, damage };
                }
            }
            self.packets.counters = connection.client.counters();
            while let Ok(command) = self.requests.try_recv() {
                if command == Command::ResetCounters {
                    connection.client.reset_counters();
                    self.packets = PacketCounts::default();
                    self.board.frames = Default::default();
                }
                self.command(&command, &mut connection);
            }
            self.follow_shown();
            self.select(&mut connection);
            if self.board.hello.is_none() && connection.greeted.elapsed() > ANSWER_WAIT {
                connection.greeted = Instant::now();
                connection.is_late = true;
                self.send(&mut connection, "hello", &HostMessage::SendHello);
            }
            self.expire();
            self.publish();
            if let Some(reason) = connection.failure.take() {
                return End::for_reason(reason);
            }
        }
    }

    /// Takes the packets of the bytes that were read.
    fn take(&mut self, connection: &mut Connection<'_>) {
        while let Some(received) = connection.client.next_packet() {
            let Ok(packet) = received else { continue };
            let (sequence, sent_us) = (packet.sequence, packet.timestamp_us);
            let change = self.board.take(&packet);
            if let Some(pace) = connection.client.pace() {
                let delay = pace.delay(Instant::now(), sent_us);
                if !delay.is_zero() {
                    self.publish();
                    thread::sleep(delay);
                }
            }
            match change {
                // A board that has just started knows nothing of what was asked before.
                Some(Change::Introduced) if sequence == 0 || connection.is_late => {
                    connection.is_late = false;
                    connection.selected = None;
                    self.set_up(connection);
                }
                None | Some(Change::Introduced) => {}
                Some(Change::Ended(frame)) => {
                    self.last = Some(frame);
                    self.publish_frame();
                }
                Some(Change::Answered { sequence, outcome }) => {
                    let sent = self.commands.iter_mut().map(|sent| &mut sent.status);
                    let mut sent = sent.filter(|status| status.sequence == Some(sequence));
                    if let Some(status) = sent.next() {
                        status.outcome = Some(outcome_name(outcome));
                    }
                }
            }
            self.packets.counters = connection.client.counters();
            self.is_changed = true;
        }
    }

    /// Asks for what is shown, and for frames if they are wanted.
    fn set_up(&mut self, connection: &mut Connection<'_>) {
        self.select(connection);
        if self.is_started {
            self.send(connection, "start", &HostMessage::Start);
        }
    }

    /// Asks the board for the streams that are shown, if it was not yet.
    fn select(&mut self, connection: &mut Connection<'_>) {
        let hello = self.board.hello.as_ref();
        let offered = hello.map_or(USUAL_STREAMS, |hello| hello.streams);
        let streams = self.shown.streams(offered, self.camera().is_some());
        if connection.selected == Some(streams) {
            return;
        }
        connection.selected = Some(streams);
        self.asked = streams;
        let selection = Selection::whole(streams);
        let name = format!("select {streams:?}");
        self.send(connection, &name, &HostMessage::Select(selection));
    }

    fn command(&mut self, command: &Command, connection: &mut Connection<'_>) {
        let message = match *command {
            Command::Start => HostMessage::Start,
            Command::Stop => HostMessage::Stop,
            Command::ResetCounters => HostMessage::ResetCounters,
            Command::TestPattern(is_on) => HostMessage::Source(if is_on {
                vgstereo_link::Source::TestPattern
            } else {
                vgstereo_link::Source::Camera
            }),
            Command::Parameters(parameters) => HostMessage::Parameters(parameters),
        };
        match command {
            Command::Start => self.is_started = true,
            Command::Stop => self.is_started = false,
            _ => {}
        }
        self.send(connection, &command_name(command), &message);
    }

    /// Sends a command, and keeps it until it is answered.
    fn send(&mut self, connection: &mut Connection<'_>, name: &str, message: &HostMessage<'_>) {
        match connection.client.send(message) {
            // To a recording: only what someone has asked for is worth a word.
            Ok(None) => {}
            Ok(sequence) => self.keep(name.to_owned(), sequence, None),
            Err(error) => {
                connection.failure = Some(error.to_string());
                self.keep(name.to_owned(), None, Some("not sent"));
            }
        }
    }

    fn keep(&mut self, name: String, sequence: Option<u32>, outcome: Option<&'static str>) {
        if self.commands.len() == COMMANDS_KEPT {
            self.commands.pop_front();
        }
        self.commands.push_back(Sent {
            status: CommandStatus {
                sequence,
                name,
                outcome,
            },
            at: Instant::now(),
        });
        self.is_changed = true;
    }

    /// Gives commands up that were not answered in time.
    fn expire(&mut self) {
        for sent in &mut self.commands {
            if sent.status.outcome.is_none() && sent.at.elapsed() > ANSWER_WAIT {
                sent.status.outcome = Some("no answer");
                self.is_changed = true;
            }
        }
    }

    /// The camera that disparities are seen with: the board's or that of the calibration.
    fn camera(&self) -> Option<RectifiedCamera> {
        self.board.rectified_camera().or(self.calibrated)
    }

    /// Shows the last frame anew when something else of it is shown.
    fn follow_shown(&mut self) {
        let shown = self.hub.shown();
        if shown != self.shown {
            self.shown = shown;
            self.publish_frame();
        }
    }

    fn publish_frame(&self) {
        if let Some(frame) = &self.last
            && self.shown != Show::default()
        {
            let camera = self.camera();
            self.hub
                .publish_frame(snapshot::encode(frame, camera.as_ref(), &self.shown));
        }
    }

    /// Publishes the status if it has changed, and not more often than it can be read.
    fn publish(&mut self) {
        let is_early = self
            .published
            .is_some_and(|at| at.elapsed() < STATUS_PERIOD);
        if !self.is_changed || is_early {
            return;
        }
        let camera = self.camera();
        let is_from_board = self.board.rectified_camera().is_some();
        let status = Status {
            source: &self.source,
            board: self.board.hello.as_ref().map(|hello| &hello.fields),
            camera: camera.map(|camera| CameraStatus::new(&camera, is_from_board)),
            state: self.board.state.as_ref(),
            statistics: self.board.statistics.as_ref(),
            packets: self.packets,
            frames: &self.board.frames,
            streams: self.asked.bits(),
            commands: self
                .commands
                .iter()
                .map(|sent| sent.status.clone())
                .collect(),
            log: self.board.log.iter().collect(),
        };
        if let Ok(json) = serde_json::to_string(&status) {
            self.hub.publish_status(json);
        }
        self.published = Some(Instant::now());
        self.is_changed = false;
    }
}

/// A command as the page tells it.
fn command_name(command: &Command) -> String {
    match command {
        Command::Start => "start".to_owned(),
        Command::Stop => "stop".to_owned(),
        Command::ResetCounters => "reset counters".to_owned(),
        Command::TestPattern(true) => "test pattern".to_owned(),
        Command::TestPattern(false) => "camera".to_owned(),
        Command::Parameters(parameters) => parameters_name(parameters),
    }
}

/// The parameters that are set, as the page tells them.
fn parameters_name(parameters: &Parameters) -> String {
    let fields = serde_json::to_value(parameters).unwrap_or_default();
    let fields = fields.as_object().into_iter().flatten();
    let set = fields.filter(|(_, value)| !value.is_null());
    let set: Vec<String> = set.map(|(name, value)| format!("{name} {value}")).collect();
    set.join(", ")
}
