//! A board in memory, and the host that listens to it.

use std::cell::Cell;
use std::collections::VecDeque;
use std::string::String;
use std::vec;
use std::vec::Vec;

use super::*;
use crate::scripted::{FaultKind, FaultyCamera, Rewind, ScriptedFault};
use crate::watchdog::NoWatchdog;
use vgstereo_core::{DisparityRange, Portable, Preset};
use vgstereo_link::{BoardMessage, Decoder, Encoder, Reason, Region};

const GEOMETRY: Geometry = Geometry {
    width: 48,
    height: 24,
    format: camera::PixelFormat::Grey8,
};

std::thread_local! {
    /// The time of the test's board, µs: it goes on by one with each look.
    static NOW_US: Cell<u64> = const { Cell::new(0) };
}

fn clock() -> u64 {
    NOW_US.with(|now| {
        now.set(now.get() + 1);
        now.get()
    })
}

fn pass(us: u64) {
    NOW_US.with(|now| now.set(now.get() + us));
}

/// A port with a buffer of so many bytes, of which so many leave at each look.
struct Port {
    room: usize,
    rate: usize,
    waiting: VecDeque<u8>,
    sent: Vec<u8>,
    incoming: VecDeque<u8>,
}

impl Port {
    fn new(room: usize, rate: usize) -> Self {
        Self {
            room,
            rate,
            waiting: VecDeque::new(),
            sent: vec![],
            incoming: VecDeque::new(),
        }
    }
}

impl LinkPort for Port {
    fn send(&mut self, bytes: &[u8]) -> usize {
        let leaving = self.rate.min(self.waiting.len());
        self.sent.extend(self.waiting.drain(..leaving));
        let taken = bytes.len().min(self.room - self.waiting.len());
        self.waiting.extend(&bytes[..taken]);
        taken
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        let count = bytes.len().min(self.incoming.len());
        for (byte, came) in bytes.iter_mut().zip(self.incoming.drain(..count)) {
            *byte = came;
        }
        count
    }
}

/// A message, owned, as far as the tests look at it.
#[derive(Debug, Clone, PartialEq)]
enum Got {
    Hello(Streams, u16),
    Camera,
    State(State),
    Begun(u32, Region),
    Disparities(u32, u32, u16, Vec<i16>),
    Confidences(u32, u32, Vec<u8>),
    Depths(u32, u32, Vec<u16>),
    Raw(u32, u32, Vec<u8>, Vec<u8>),
    Done(u32),
    Aborted(u32, Reason),
    Statistics(SessionCounters, LinkCounters),
    Log(String),
    Answer(u32, Outcome),
}

fn owned(message: &BoardMessage<'_>) -> Got {
    fn values<T: vgstereo_link::Sample>(line: &vgstereo_link::Line<'_, T>) -> Vec<T> {
        let mut values = vec![T::default(); line.values.count()];
        line.values.unpack(&mut values).unwrap();
        values
    }
    match message {
        BoardMessage::Hello(hello) => Got::Hello(hello.streams, hello.piece_bytes_max),
        BoardMessage::Camera(_) => Got::Camera,
        BoardMessage::State(state) => Got::State(*state),
        BoardMessage::FrameBegun(begun) => Got::Begun(begun.frame, begun.region),
        BoardMessage::Disparities(line) => {
            Got::Disparities(line.frame, line.line, line.column, values(line))
        }
        BoardMessage::Confidences(line) => Got::Confidences(line.frame, line.line, values(line)),
        BoardMessage::Depths(line) => Got::Depths(line.frame, line.line, values(line)),
        BoardMessage::RawPair(pair) => Got::Raw(
            pair.frame,
            pair.line,
            pair.left.to_vec(),
            pair.right.to_vec(),
        ),
        BoardMessage::FrameDone { frame } => Got::Done(*frame),
        BoardMessage::FrameAborted { frame, reason } => Got::Aborted(*frame, *reason),
        BoardMessage::Statistics(statistics) => {
            Got::Statistics(statistics.session, statistics.link)
        }
        BoardMessage::Log { text, .. } => Got::Log((*text).into()),
        BoardMessage::Answer { sequence, outcome } => Got::Answer(*sequence, *outcome),
        other => panic!("{other:?} was not asked for"),
    }
}

/// All messages of these bytes, none of which may be damaged or lost.
fn messages(bytes: &[u8]) -> Vec<Got> {
    let mut memory = [0; 2000];
    let mut decoder = Decoder::new(&mut memory);
    let (mut rest, mut got) = (bytes, vec![]);
    while let Some(packet) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        got.push(owned(&packet.unwrap().message));
    }
    assert_eq!(decoder.counters().lost, 0);
    got
}

/// A camera whose frames all show one noise, 4 px apart.
struct Noise {
    frame: u32,
    line: u32,
}

fn noise(view: usize, line: u32) -> Vec<u8> {
    let shift = [0, 4][view];
    let level = |x: u32| (((x / 2 * 7919 + line / 2 * 104_729) * 31) >> 3) as u8;
    (0..48).map(|x| level(x + shift)).collect()
}

impl camera::ErrorType for Noise {
    type Error = ErrorKind;
}

impl LinePairSource for Noise {
    fn geometry(&self) -> Geometry {
        GEOMETRY
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        left.copy_from_slice(&noise(0, self.line));
        right.copy_from_slice(&noise(1, self.line));
        let pair = LinePair {
            frame: self.frame,
            line: self.line,
            timestamp_us: u64::from(self.frame) * 1000,
            dropped: 0,
        };
        self.line += 1;
        if self.line == GEOMETRY.height {
            (self.frame, self.line) = (self.frame + 1, 0);
        }
        Ok(pair)
    }
}

impl Rewind for Noise {
    fn rewind(&mut self, _: u32) {}
}

fn config() -> Config {
    Config::new(Preset::Lite.parameters(), 48, DisparityRange::up_to(15))
}

type Board<'m, T = NoStore> = Live<
    'm,
    OrTestPattern<FaultyCamera<Noise, &'m [ScriptedFault]>>,
    Portable,
    &'m mut Port,
    NoWatchdog,
    T,
>;

/// What the test's boards have in common. Their camera has 100 px and 50 mm.
fn setup<'m, T>(
    port: &'m mut Port,
    store: T,
    gap_us: u64,
    memory: &'m mut [u32],
) -> Setup<'m, &'m mut Port, T> {
    let depth = vgstereo_core::geometry::Depth::new(100 * 50 * 256, 0);
    Setup {
        port,
        device: "test",
        firmware: "0",
        preset: "lite",
        camera: depth
            .and_then(|depth| RectifiedCamera::new(depth, 100 * 256, [24 * 256, 12 * 256])),
        selection: Selection::whole(Streams::DISPARITIES),
        is_started: true,
        clock,
        gap_us,
        keeps_line_offsets: false,
        store,
        memory,
    }
}

/// Runs `body` with a board.
fn with_board<T: CalibrationStore>(
    faults: &[ScriptedFault],
    port: &mut Port,
    store: T,
    gap_us: u64,
    body: impl FnOnce(&mut Board<'_, T>),
) {
    let config = config();
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; crate::session::memory_words(&GEOMETRY)];
    let mut link = vec![0; memory_words(&GEOMETRY, &config)];
    let camera = FaultyCamera::new(Noise { frame: 0, line: 0 }, faults);
    let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let setup = setup(port, store, gap_us, &mut link);
    let live = Live::new(camera, None, matcher, &mut lines, NoWatchdog, setup);
    body(&mut live.unwrap());
}

/// Steps until so many more frames are done.
fn frames<T: CalibrationStore>(board: &mut Board<'_, T>, count: u32) {
    let mut done = 0;
    for _ in 0..1000 {
        if let Next::Event(Event::FrameDone { .. }) = board.step() {
            done += 1;
            if done == count {
                return;
            }
        }
    }
    panic!("{done} frames of {count} came");
}

fn port<'b, T: CalibrationStore>(board: &'b mut Board<'_, T>) -> &'b mut Port {
    board.session.sink_mut().sender.port_mut()
}

/// What was sent since this was last asked, of which nothing may be damaged.
fn taken<T: CalibrationStore>(board: &mut Board<'_, T>) -> Vec<Got> {
    messages(&core::mem::take(&mut port(board).sent))
}

/// The host's end.
struct Host {
    memory: [u8; 500],
    sequence: u32,
}

impl Host {
    fn send<T: CalibrationStore>(&mut self, board: &mut Board<'_, T>, message: &HostMessage<'_>) {
        let mut encoder = Encoder::new(&mut self.memory);
        for _ in 0..self.sequence {
            encoder.encode(0, &HostMessage::SendHello).unwrap();
        }
        self.sequence += 1;
        let bytes = encoder.encode(0, message).unwrap().to_vec();
        port(board).incoming.extend(bytes);
    }
}

fn host() -> Host {
    Host {
        memory: [0; 500],
        sequence: 0,
    }
}

fn open() -> Port {
    Port::new(100_000, 100_000)
}

fn select(streams: Streams) -> HostMessage<'static> {
    HostMessage::Select(Selection::whole(streams))
}

/// The disparities of a frame, by a matcher alone.
fn expected() -> Vec<(u32, Vec<i16>, Vec<u8>)> {
    let config = config();
    let mut memory = vec![0; config.memory_words()];
    let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let mut lines = vec![];
    let mut keep = |line: vgstereo_core::DisparityLine<'_>| {
        lines.push((
            line.line,
            line.disparities_q4.to_vec(),
            line.confidences.to_vec(),
        ));
    };
    for y in 0..GEOMETRY.height {
        if let Some(line) = matcher.push(&noise(0, y)[..], &noise(1, y)[..]).unwrap() {
            keep(line);
        }
    }
    while let Some(line) = matcher.finish() {
        keep(line);
    }
    lines
}

#[test]
fn a_board_introduces_itself_and_sends_whole_frames() {
    let mut port = open();
    with_board(&[], &mut port, NoStore, 0, |board| frames(board, 2));
    port.send(&[]);
    assert_eq!(port.sent[0], 0, "the first byte ends what came before");
    let got = messages(&port.sent);
    assert!(matches!(got[0], Got::Hello(_, 0)));
    assert_eq!(got[1], Got::Camera);
    assert!(matches!(got[2], Got::State(state) if state.is_started));
    let frame = |number| {
        let region = Region {
            x_px: 0,
            y_lines: 0,
            width_px: 48,
            height_lines: 24,
        };
        let lines = expected().into_iter();
        let lines = lines.map(move |(line, q4, _)| Got::Disparities(number, line, 0, q4));
        let mut all = vec![Got::Begun(number, region)];
        all.extend(lines);
        all.push(Got::Done(number));
        all
    };
    let frames: Vec<Got> = got
        .iter()
        .filter(|got| {
            matches!(
                got,
                Got::Begun(..) | Got::Disparities(..) | Got::Done(_) | Got::Aborted(..)
            )
        })
        .cloned()
        .collect();
    assert_eq!(frames, [frame(0), frame(1)].concat());
    let statistics = got.iter().rfind(|got| matches!(got, Got::Statistics(..)));
    let Some(Got::Statistics(session, link)) = statistics else {
        panic!("no statistics");
    };
    assert_eq!((session.frames, session.lines), (1, 24));
    assert_eq!(link.dropped, 0);
}

#[test]
fn each_stream_has_what_the_camera_and_the_matcher_gave() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let streams = Streams::RAW
            .with(Streams::CONFIDENCES)
            .with(Streams::DEPTHS);
        host().send(board, &select(streams));
        frames(board, 1);
        taken(board);
        frames(board, 1);
        let got = taken(board);
        for (line, q4, confidences) in expected() {
            assert!(got.contains(&Got::Confidences(1, line, confidences)));
            // 100 px times 50 mm over the disparity.
            let depth = |&q4: &i16| match q4 {
                i16::MIN | ..=0 => 0,
                _ => ((100.0 * 50.0 * 16.0) / f64::from(q4)).round() as u16,
            };
            let depths = q4.iter().map(depth).collect();
            assert!(got.contains(&Got::Depths(1, line, depths)), "{line}");
        }
        for line in 0..24 {
            let raw = Got::Raw(1, line, noise(0, line), noise(1, line));
            assert!(got.contains(&raw));
        }
        assert!(!got.iter().any(|got| matches!(got, Got::Disparities(..))));
    });
}

#[test]
fn what_is_not_asked_for_is_not_computed() {
    use crate::sink::Needs;
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let mut host = host();
        for (streams, needs) in [
            (Streams::RAW, Needs::NONE),
            (Streams::DEPTHS, Needs::DISPARITIES),
            (Streams::NONE, Needs::NONE),
        ] {
            host.send(board, &select(streams));
            frames(board, 1);
            // Amid the next frame.
            let _ = board.step();
            assert_eq!(
                crate::DisparitySink::needs(board.session.sink()),
                needs,
                "{streams:?}"
            );
            frames(board, 1);
        }
    });
}

#[test]
fn a_stopped_board_sends_no_frames_and_still_answers() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let mut host = host();
        host.send(board, &HostMessage::Stop);
        frames(board, 1);
        taken(board);
        frames(board, 3);
        let got = taken(board);
        let is_frame =
            |got: &Got| matches!(got, Got::Begun(..) | Got::Disparities(..) | Got::Done(_));
        assert!(!got.iter().any(is_frame), "{got:?}");
        host.send(board, &HostMessage::Start);
        frames(board, 1);
        assert!(taken(board).contains(&Got::Answer(1, Outcome::Done)));
        frames(board, 1);
        assert!(taken(board).iter().any(is_frame));
    });
}

#[test]
fn every_nth_frame_is_sent_and_the_others_are_counted() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        host().send(
            board,
            &HostMessage::Select(Selection {
                streams: Streams::RAW,
                every_frames: 3,
                region: None,
            }),
        );
        frames(board, 1);
        taken(board);
        frames(board, 9);
        let got = taken(board);
        let begun: Vec<u32> = got
            .iter()
            .filter_map(|got| match got {
                Got::Begun(frame, _) => Some(*frame),
                _ => None,
            })
            .collect();
        assert_eq!(begun.len(), 3);
        assert!(begun.windows(2).all(|pair| pair[1] == pair[0] + 3));
        assert_eq!(board.link_counters().frames_decimated, 6);
    });
}

#[test]
fn a_region_is_cut_out_of_each_line() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let region = Region {
            x_px: 10,
            y_lines: 5,
            width_px: 7,
            height_lines: 3,
        };
        host().send(
            board,
            &HostMessage::Select(Selection {
                streams: Streams::DISPARITIES.with(Streams::RAW),
                every_frames: 1,
                region: Some(region),
            }),
        );
        frames(board, 1);
        taken(board);
        frames(board, 1);
        let got = taken(board);
        assert!(got.contains(&Got::Begun(1, region)));
        for (line, q4, _) in expected() {
            let part = Got::Disparities(1, line, 10, q4[10..17].to_vec());
            assert_eq!(got.contains(&part), (5..8).contains(&line), "{line}");
        }
        let lines = got.iter().filter(|got| matches!(got, Got::Disparities(..)));
        assert_eq!(lines.count(), 3);
        let lines = got.iter().filter(|got| matches!(got, Got::Raw(..)));
        assert_eq!(lines.count(), 3);
    });
}

#[test]
fn a_slow_port_loses_lines_that_are_counted_and_nothing_else() {
    for (room, rate) in [(40, 1), (200, 5), (90, 5), (1000, 8)] {
        let mut slow = Port::new(room, rate);
        let mut counted = 0;
        with_board(&[], &mut slow, NoStore, 0, |board| {
            for _ in 0..6 {
                frames(board, 1);
                // Now and then the port has time.
                for _ in 0..2000 {
                    let _ = board.serve();
                }
            }
            counted = board.link_counters().dropped;
        });
        while !slow.waiting.is_empty() {
            slow.send(&[]);
        }
        let got = messages(&slow.sent);
        let lines = got.iter().filter(|got| matches!(got, Got::Disparities(..)));
        let begun = got.iter().filter(|got| matches!(got, Got::Begun(..)));
        let done = got.iter().filter(|got| matches!(got, Got::Done(_)));
        assert_eq!(begun.count(), done.count(), "{room} {rate}");
        assert_eq!(
            lines.clone().count() as u32 + counted,
            6 * 24,
            "{room} {rate}"
        );
        assert!(counted > 0, "{room} {rate}");
        // What came is right.
        let expected = expected();
        for line in lines {
            let Got::Disparities(_, line, 0, q4) = line else {
                panic!("{line:?}");
            };
            assert_eq!(*q4, expected[*line as usize].1);
        }
    }
}

#[test]
fn the_lines_that_come_with_the_last_pair_wait_for_the_port_in_the_gap() {
    for (gap_us, is_whole) in [(0, false), (1_000_000, true)] {
        let mut port = Port::new(60, 4);
        with_board(&[], &mut port, NoStore, gap_us, |board| {
            for _ in 0..24 {
                let _ = board.step();
                // The port has time between lines, but not when the last ones come at once.
                for _ in 0..60 {
                    let _ = board.serve();
                }
            }
            assert_eq!(board.link_counters().dropped == 0, is_whole);
        });
    }
}

#[test]
fn a_port_that_takes_nothing_stalls_nothing() {
    let mut dead = Port::new(0, 0);
    with_board(&[], &mut dead, NoStore, 100, |board| {
        frames(board, 3);
        assert_eq!(board.statistics().frames, 3);
        assert_eq!(board.link_counters().dropped, 3 * 24);
    });
    assert!(dead.sent.is_empty());
}

#[test]
fn faults_are_told_with_their_reason() {
    let faults = [ScriptedFault {
        frame: 1,
        line: 9,
        kind: FaultKind::Error(ErrorKind::Timeout),
    }];
    with_board(&faults, &mut open(), NoStore, 0, |board| {
        frames(board, 1);
        pass(1_000_000);
        frames(board, 1);
        port(board).send(&[]);
        let got = taken(board);
        assert!(got.contains(&Got::Aborted(1, Reason::CameraTimeout)));
        let fault = std::string::ToString::to_string(&Fault::Camera(ErrorKind::Timeout));
        assert!(got.contains(&Got::Log(fault)), "{got:?}");
        let counted =
            |got: &Got| matches!(got, Got::Statistics(session, _) if session.timeouts == 1);
        assert!(got.iter().any(counted));
    });
}

/// A line that the board adds to the log waits until the port has room, and the next one replaces it meanwhile. Warnings of
/// faults of the camera neither delay nor replace it.
#[test]
fn what_the_board_tells_comes_beside_the_faults() {
    let faults = [1, 2].map(|frame| ScriptedFault {
        frame,
        line: 9,
        kind: FaultKind::Error(ErrorKind::Bus),
    });
    let mut port_of_nothing = Port::new(0, 0);
    with_board(&faults, &mut port_of_nothing, NoStore, 0, |board| {
        board.tell(&"replaced");
        frames(board, 1);
        board.tell(&"left sensor");
        frames(board, 1);
        *port(board) = open();
        frames(board, 1);
        board.tell(&"right sensor");
        frames(board, 1);
        port(board).send(&[]);
        let mut log = taken(board);
        log.retain(|got| matches!(got, Got::Log(text) if text.ends_with("sensor")));
        let told = ["left sensor", "right sensor"].map(|text| Got::Log(text.into()));
        assert_eq!(log, told);
    });
}

#[test]
fn commands_are_answered_by_their_numbers_and_bounds() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let mut host = host();
        let parameters = |change: &dyn Fn(&mut Parameters)| {
            let mut parameters = Parameters::default();
            change(&mut parameters);
            HostMessage::Parameters(parameters)
        };
        let empty = Region {
            x_px: 3,
            y_lines: 3,
            width_px: 0,
            height_lines: 1,
        };
        let cases = [
            (HostMessage::SendHello, Outcome::Done),
            (select(Streams::SCANS), Outcome::Unsupported),
            (select(Streams::RECTIFIED), Outcome::Unsupported),
            (
                HostMessage::Select(Selection {
                    streams: Streams::RAW,
                    every_frames: 0,
                    region: None,
                }),
                Outcome::OutOfBounds,
            ),
            (
                HostMessage::Select(Selection {
                    streams: Streams::RAW,
                    every_frames: 1,
                    region: Some(empty),
                }),
                Outcome::OutOfBounds,
            ),
            (
                parameters(&|parameters| parameters.speckle_size_min = Some(255)),
                Outcome::OutOfBounds,
            ),
            (
                parameters(&|parameters| parameters.margin = Some(99)),
                Outcome::Done,
            ),
            (HostMessage::CalibrationDiscard, Outcome::Done),
            (
                HostMessage::CalibrationCommit {
                    total_bytes: 0,
                    crc32: 0,
                },
                Outcome::Unsupported,
            ),
            (HostMessage::Source(Source::TestPattern), Outcome::Done),
        ];
        for (message, _) in &cases {
            host.send(board, message);
        }
        frames(board, 2);
        let got = taken(board);
        let answers: Vec<&Got> = got
            .iter()
            .filter(|got| matches!(got, Got::Answer(..)))
            .collect();
        let expected: Vec<Got> = (0..)
            .zip(&cases)
            .map(|(sequence, (_, outcome))| Got::Answer(sequence, *outcome))
            .collect();
        assert_eq!(answers, expected.iter().collect::<Vec<_>>());
        let states = got.iter().rev().find_map(|got| match got {
            Got::State(state) => Some(*state),
            _ => None,
        });
        let state = states.unwrap();
        assert_eq!(state.parameters.margin, Some(99));
        assert_eq!(state.source, Source::TestPattern);
        assert_eq!(state.selection.streams, Streams::DISPARITIES);
        assert_eq!(board.link_counters().commands_refused, 6);
        assert_eq!(board.link_counters().commands, 4);
    });
}

#[test]
fn a_test_pattern_has_the_disparities_that_it_states() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        host().send(board, &HostMessage::Source(Source::TestPattern));
        frames(board, 1);
        taken(board);
        frames(board, 1);
        let got = taken(board);
        let mut right = 0;
        for got in &got {
            if let Got::Disparities(_, line, _, q4) = got {
                let px = camera::TestPattern::disparity_px(&GEOMETRY, *line) as i16;
                right += q4[16..]
                    .iter()
                    .filter(|&&q4| (q4 - 16 * px).abs() < 16)
                    .count();
            }
        }
        assert!(right > 24 * 32 * 8 / 10, "{right} of {}", 24 * 32);
    });
}

#[test]
fn other_parameters_change_what_is_sent_from_the_next_frame_on() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        let parameters = Parameters {
            confidence_min: Some(1),
            ..Parameters::default()
        };
        host().send(board, &HostMessage::Parameters(parameters));
        frames(board, 1);
        taken(board);
        frames(board, 1);
        let got = taken(board);
        for (line, mut q4, confidences) in expected() {
            for (q4, &confidence) in q4.iter_mut().zip(&confidences) {
                if confidence == 0 {
                    *q4 = vgstereo_core::INVALID;
                }
            }
            assert!(got.contains(&Got::Disparities(1, line, 0, q4)), "{line}");
        }
    });
}

#[test]
fn damaged_commands_are_counted_and_the_next_is_taken() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        port(board).incoming.extend([7, 7, 7, 7, 0, 1, 2, 0]);
        host().send(board, &HostMessage::Stop);
        frames(board, 1);
        assert!(taken(board).contains(&Got::Answer(0, Outcome::Done)));
        let counters = board.link_counters();
        assert_eq!((counters.commands, counters.commands_refused), (1, 2));
    });
}

#[test]
fn counters_are_reset() {
    with_board(&[], &mut open(), NoStore, 0, |board| {
        frames(board, 2);
        host().send(board, &HostMessage::ResetCounters);
        frames(board, 1);
        assert_eq!(board.statistics(), Statistics::default());
        frames(board, 1);
        assert_eq!(board.statistics().frames, 1);
    });
}

/// A pushed session sends the same bytes as one that reads the same camera.
#[test]
fn both_doors_lead_to_the_same_bytes() {
    let faults = [
        (0, 7, FaultKind::Error(ErrorKind::Overrun)),
        (1, 3, FaultKind::DroppedLine),
        (2, 11, FaultKind::DuplicatedLine),
        (4, 0, FaultKind::LostSync),
    ]
    .map(|(frame, line, kind)| ScriptedFault { frame, line, kind });
    let mut pulled = open();
    NOW_US.with(|now| now.set(0));
    with_board(&faults, &mut pulled, NoStore, 0, |board| {
        for _ in 0..180 {
            let _ = board.step();
        }
    });
    let config = config();
    let mut memory = vec![0; config.memory_words()];
    let mut link = vec![0; memory_words(&GEOMETRY, &config)];
    let mut pushed = open();
    NOW_US.with(|now| now.set(0));
    {
        let setup = setup(&mut pushed, NoStore, 0, &mut link);
        let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        let live = Live::pushed(GEOMETRY, None, matcher, NoWatchdog, setup);
        let mut live = live.unwrap();
        let mut camera = FaultyCamera::new(Noise { frame: 0, line: 0 }, &faults);
        let (mut left, mut right) = ([0; 48], [0; 48]);
        for _ in 0..180 {
            let _ = match camera.read_pair(&mut left, &mut right) {
                Ok(pair) => live.take_pair(&pair, &left, &right),
                Err(error) => live.take_error(camera::Error::kind(&error)),
            };
        }
        // Lines of another length are no pair.
        let pair = LinePair {
            frame: 9,
            line: 0,
            timestamp_us: 0,
            dropped: 0,
        };
        let Next::Event(event) = live.take_pair(&pair, &left[1..], &right) else {
            panic!("no calibration came");
        };
        assert_eq!(event, Event::Fault(Fault::Camera(ErrorKind::ShortLine)));
    }
    assert!(pushed.sent.starts_with(&pulled.sent));
    assert!(pulled.sent.len() > 1000);
}

#[test]
fn a_calibration_is_kept_when_all_of_it_has_come() {
    // What a rectification is, the tests of the core know; here, that no other bytes are kept.
    let mut memory = vec![0; 4000];
    with_board(
        &[],
        &mut open(),
        RamStore::new(&mut memory, 1000),
        0,
        |board| {
            let mut host = host();
            let bytes: Vec<u8> = (0..600_u32).map(|at| (at % 251) as u8).collect();
            let crc32 = 7;
            let piece = |range: core::ops::Range<usize>| {
                HostMessage::CalibrationPiece(vgstereo_link::host::CalibrationPiece {
                    total_bytes: 600,
                    crc32,
                    offset_bytes: range.start as u32,
                    bytes: &bytes[range],
                })
            };
            let commit = HostMessage::CalibrationCommit {
                total_bytes: 600,
                crc32,
            };
            let cases = [
                (piece(0..256), Outcome::Done),
                // One is missing.
                (piece(512..600), Outcome::Calibration),
                (commit, Outcome::Calibration),
                (piece(0..256), Outcome::Done),
                (piece(256..512), Outcome::Done),
                (piece(512..600), Outcome::Done),
                // All have come, but they are no rectification.
                (commit, Outcome::Calibration),
                (commit, Outcome::Calibration),
            ];
            for (message, _) in &cases {
                host.send(board, message);
            }
            frames(board, 2);
            let answers: Vec<Got> = taken(board)
                .into_iter()
                .filter(|got| matches!(got, Got::Answer(..)))
                .collect();
            let expected: Vec<Got> = (0..)
                .zip(&cases)
                .map(|(sequence, (_, outcome))| Got::Answer(sequence, *outcome))
                .collect();
            assert_eq!(answers, expected);
            assert!(!board.upload.is_stored);
            assert_eq!(board.upload.store.take(), None);
        },
    );
}

#[test]
fn pieces_of_a_calibration_are_taken_amid_a_frame_and_what_changes_it_after() {
    let mut memory = vec![0; 4000];
    let store = RamStore::new(&mut memory, 1000);
    with_board(&[], &mut open(), store, 0, |board| {
        let mut host = host();
        let bytes = [7; 100];
        let piece = |offset_bytes: u32| {
            HostMessage::CalibrationPiece(vgstereo_link::host::CalibrationPiece {
                total_bytes: 200,
                crc32: 1,
                offset_bytes,
                bytes: &bytes,
            })
        };
        for _ in 0..5 {
            let _ = board.step();
        }
        // More than a line takes at once.
        for message in [piece(0), piece(100), HostMessage::ResetCounters, piece(0)] {
            host.send(board, &message);
        }
        // What is left in the port leaves with what follows.
        frames(board, 2);
        let got = taken(board);
        let order: Vec<&Got> = got
            .iter()
            .filter(|got| matches!(got, Got::Answer(..) | Got::Done(0)))
            .collect();
        let done = Outcome::Done;
        let expected = [
            Got::Answer(0, done),
            Got::Answer(1, done),
            Got::Done(0),
            Got::Answer(2, done),
            Got::Answer(3, done),
        ];
        assert_eq!(order, expected.iter().collect::<Vec<_>>());
    });
}
