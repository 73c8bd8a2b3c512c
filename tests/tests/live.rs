//! Emulated boards, and the board in RTL, that serve the link over their serial ports, each with one run: what they send is
//! what the host computes, they do what the host asks, hosts come and go, and damage is counted and passes.
//!
//! A board is tested if its compiler and emulator are installed (`cargo firmware setup`); otherwise its
//! test is listed as ignored. So are those of the board in RTL, of the model of a chip, and of a board that differs from
//! another in compiler flags alone: `-- --include-ignored` runs them as well.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::slice;
use std::time::{Duration, Instant};

use image::imageops::flip_vertical;
use libtest_mimic::{Arguments, Failed, Trial};
use vgstereo_boards::board::Board;
use vgstereo_boards::bridge::Damage;
use vgstereo_boards::build::build;
use vgstereo_boards::host::{self, Frames};
use vgstereo_boards::live::{Link, LiveBoard};
use vgstereo_boards::model;
use vgstereo_boards::pair::Pair;
use vgstereo_boards::simulation::{self, Scenario};
use vgstereo_boards::toolchain;
use vgstereo_core::geometry::Rectification;
use vgstereo_core::{INVALID, Preset};
use vgstereo_link::board::Outcome;
use vgstereo_link::host::CalibrationPiece;
use vgstereo_link::{
    BoardMessage, Counters, Decoder, Encoder, HostMessage, Parameters, PixelFormat, Region,
    Selection, Streams,
};
use vgstereo_sim::link::attended::Attended;
use vgstereo_sim::link::board;
use vgstereo_sim::link::client::Memory;
use vgstereo_sim::link::source::Source;
use vgstereo_sim::link::upload::upload;
use vgstereo_tests::failed;

const WIDTH: usize = 64;
const HEIGHT: usize = 40;

/// Longest time that anything may take.
const LONG: Duration = Duration::from_secs(120);
/// Longest time that an answer of a real board on its model may take.
const VERY_LONG: Duration = Duration::from_secs(600);

/// Bytes that are left out and changed of those that are sent to hosts: the first one, as if the host had come amid a
/// packet, and two amid the first frames.
const CUT: u64 = 1;
const DROPPED: u64 = 3_000;
const FLIPPED: u64 = 9_000;

/// All streams that a calibrated board makes of a frame.
const ALL_MATCHED: Streams = Streams::RECTIFIED
    .with(Streams::DISPARITIES)
    .with(Streams::CONFIDENCES)
    .with(Streams::DEPTHS);

const DISPARITIES: Selection = Selection::whole(Streams::DISPARITIES.with(Streams::CONFIDENCES));

fn main() {
    let mut trials = Vec::new();
    for board in Board::emulated() {
        let absent = toolchain::ensure_complete(&[board]).is_err() || board.is_variant();
        let name = format!("{}::link", board.name);
        let trial = Trial::test(name, move || serves_the_link(&board));
        trials.push(trial.with_ignored_flag(absent));
        let name = format!("{}::calibration", board.name);
        let trial = Trial::test(name, move || takes_a_calibration(&board).map_err(failed));
        trials.push(trial.with_ignored_flag(absent));
    }
    // What follows takes minutes, and is ignored unless it is asked for.
    for board in Board::simulated() {
        let name = format!("{}::calibration", board.name);
        let trial = Trial::test(name, move || takes_commands_in_rtl(&board).map_err(failed));
        trials.push(trial.with_ignored_flag(true));
    }
    for board in Board::modelled() {
        let name = format!("{}::calibration", board.name);
        let trial = Trial::test(name, move || {
            keeps_a_calibration_in_flash(&board).map_err(failed)
        });
        trials.push(trial.with_ignored_flag(true));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Two different frames, which the camera sends in turn, and what the host makes of each.
struct Scene {
    pairs: [Pair; 2],
    expected: [Frames; 2],
}

impl Scene {
    fn new() -> anyhow::Result<Self> {
        let pair = Pair::rendered(WIDTH as u32, HEIGHT as u32, 16);
        let turned = Pair {
            left: flip_vertical(&pair.left),
            right: flip_vertical(&pair.right),
            ..pair.clone()
        };
        let pairs = [pair, turned];
        let matched = |pair: &Pair| {
            let (frames, _) = host::run(pair, &pair.request(Preset::Lite, 1, &[])?)?;
            anyhow::Ok(frames)
        };
        let expected = [matched(&pairs[0])?, matched(&pairs[1])?];
        assert_ne!(expected[0], expected[1]);
        Ok(Self { pairs, expected })
    }

    /// Asserts that the lines that came are the host's, and returns how many there are of each stream.
    fn check(&self, frame: &Frame) -> [usize; 3] {
        let parity = frame.number as usize % 2;
        let expected = &self.expected[parity];
        let raw = self.pairs[parity].lines().unwrap();
        for (line, values_q4) in &frame.disparities_q4 {
            let expected_q4 = &expected.disparities_q4()[line * WIDTH..][..WIDTH];
            assert_eq!(values_q4, expected_q4, "{} {line}", frame.number);
        }
        for (line, values) in &frame.confidences {
            let expected = &expected.confidences[line * WIDTH..][..WIDTH];
            assert_eq!(values, expected, "{} {line}", frame.number);
        }
        for (line, bytes) in &frame.raw {
            let expected = &raw[line * 2 * WIDTH..][..2 * WIDTH];
            assert_eq!(bytes, expected, "{} {line}", frame.number);
        }
        [
            frame.disparities_q4.len(),
            frame.confidences.len(),
            frame.raw.len(),
        ]
    }
}

/// What came of a frame: numbers of lines, and their values.
#[derive(Debug, Default)]
struct Frame {
    number: u32,
    timestamp_us: u64,
    disparities_q4: Vec<(usize, Vec<i16>)>,
    confidences: Vec<(usize, Vec<u8>)>,
    raw: Vec<(usize, Vec<u8>)>,
    is_done: bool,
}

impl Frame {
    fn push(&mut self, message: &BoardMessage<'_>) {
        match message {
            BoardMessage::Disparities(line) if line.frame == self.number => {
                let mut values = vec![0; line.values.count()];
                line.values.unpack(&mut values).unwrap();
                self.disparities_q4.push((line.line as usize, values));
            }
            BoardMessage::Confidences(line) if line.frame == self.number => {
                let mut values = vec![0; line.values.count()];
                line.values.unpack(&mut values).unwrap();
                self.confidences.push((line.line as usize, values));
            }
            BoardMessage::RawPair(pair) if pair.frame == self.number => {
                let bytes = [pair.left, pair.right].concat();
                self.raw.push((pair.line as usize, bytes));
            }
            BoardMessage::FrameDone { frame } => self.is_done |= *frame == self.number,
            _ => {}
        }
    }
}

/// A host.
struct Client {
    stream: TcpStream,
    decoder: Decoder<'static>,
    encoder: Encoder<'static>,
    received: Vec<u8>,
    /// Number of bytes that have come.
    count: u64,
}

impl Client {
    fn connect(address: SocketAddr) -> std::io::Result<Self> {
        let mut stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(LONG))?;
        // Ends what a host before may have begun.
        stream.write_all(&[vgstereo_link::DELIMITER])?;
        Ok(Self {
            stream,
            decoder: Decoder::joining(Vec::leak(vec![0; 4096])),
            encoder: Encoder::new(Vec::leak(vec![0; 1024])),
            received: vec![],
            count: 0,
        })
    }

    /// Reads messages until `wanted` has found what it looks for.
    fn until<T>(&mut self, mut wanted: impl FnMut(&BoardMessage<'_>) -> Option<T>) -> T {
        let begun = Instant::now();
        loop {
            let mut input = &self.received[..];
            let packet = self.decoder.next::<BoardMessage<'_>>(&mut input);
            let found = packet.map(|packet| packet.ok().and_then(|got| wanted(&got.message)));
            self.received = input.to_vec();
            match found {
                Some(Some(found)) => return found,
                Some(None) => continue,
                None => {}
            }
            assert!(begun.elapsed() < LONG, "what is waited for does not come");
            let mut bytes = [0; 4096];
            let length = self.stream.read(&mut bytes).unwrap();
            assert!(length > 0, "the board has hung up");
            self.received.extend_from_slice(&bytes[..length]);
            self.count += length as u64;
        }
    }

    /// Sends a command and returns its sequence number.
    fn send(&mut self, command: &HostMessage<'_>) -> u32 {
        let sequence = self.encoder.sequence();
        let bytes = self.encoder.encode(0, command).unwrap();
        self.stream.write_all(bytes).unwrap();
        sequence
    }

    /// Sends a command, and gives what comes before its answer to `seen`.
    fn command_seeing(
        &mut self,
        command: &HostMessage<'_>,
        mut seen: impl FnMut(&BoardMessage<'_>),
    ) -> Outcome {
        let sent = self.send(command);
        self.until(|message| match message {
            BoardMessage::Answer { sequence, outcome } if *sequence == sent => Some(*outcome),
            message => {
                seen(message);
                None
            }
        })
    }

    fn command(&mut self, command: &HostMessage<'_>) {
        let outcome = self.command_seeing(command, |_| {});
        assert_eq!(outcome, Outcome::Done, "{command:?}");
    }

    /// The next frame that begins.
    fn frame(&mut self) -> Frame {
        let mut frame: Option<Frame> = None;
        self.until(|message| {
            if let BoardMessage::FrameBegun(begun) = message {
                let ended = frame.replace(Frame {
                    number: begun.frame,
                    timestamp_us: begun.timestamp_us,
                    ..Frame::default()
                });
                // The end of the one before was damaged.
                if ended.is_some() {
                    return ended;
                }
            }
            let under_way = frame.as_mut()?;
            under_way.push(message);
            if under_way.is_done {
                frame.take()
            } else {
                None
            }
        })
    }

    fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// The shortest time of three from the beginning of a frame to that of the next, µs.
    fn period_us(&mut self) -> u64 {
        let begun_us: Vec<u64> = (0..4).map(|_| self.frame().timestamp_us).collect();
        let periods = begun_us.windows(2).map(|pair| pair[1] - pair[0]);
        periods.min().unwrap()
    }
}

fn serves_the_link(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let scene = Scene::new().map_err(failed)?;
    let request = scene.pairs[0].live_request(Preset::Lite, &[]);
    let link = Link::local(Damage {
        dropped: vec![CUT, DROPPED],
        flipped: vec![FLIPPED],
    });
    let request = request.map_err(failed)?;
    let live = LiveBoard::emulated(board, &firmware, &scene.pairs, &request, link);
    let live = live.map_err(failed)?;

    let mut first = Client::connect(live.address())?;
    damage_is_counted_and_passes(&mut first, &scene);
    introduces_itself(&mut first, board);
    // Frames of both kinds come whole, in turn, each later than the one before.
    let [one, two] = [first.frame(), first.frame()];
    assert_eq!(two.number, one.number + 1);
    assert!(two.timestamp_us > one.timestamp_us);
    for frame in [one, two] {
        assert_eq!(scene.check(&frame), [HEIGHT, HEIGHT, 0]);
    }
    sends_raw_lines_without_matching(&mut first, &scene);
    stops_and_starts(&mut first);
    first.command(&HostMessage::Select(DISPARITIES));
    // A hello; raw lines, and a pixel of each kind; stop, 3 hellos, start; and the one above.
    let undamaged = first.counters();
    let statistics = first.until(|message| match message {
        BoardMessage::Statistics(statistics) if statistics.link.commands >= 10 => Some(*statistics),
        _ => None,
    });
    assert_eq!(statistics.link.commands, 10);
    assert_eq!(statistics.link.commands_refused, 0);
    assert_eq!(statistics.link.dropped, 0, "the port has room");
    assert!(statistics.session.frames > 8);
    assert_eq!(statistics.session.frames_dropped, 0);
    drop(first);

    // Another host comes, which knows nothing of the first.
    let mut second = Client::connect(live.address())?;
    introduces_itself(&mut second, board);
    assert_eq!(scene.check(&second.frame()), [HEIGHT, HEIGHT, 0]);
    assert_eq!(undamaged.restarts, 0);
    Ok(())
}

/// Both damaged places are noticed, no line is wrong, and the frames after them are whole.
fn damage_is_counted_and_passes(client: &mut Client, scene: &Scene) {
    let mut missing = 0;
    while client.count <= FLIPPED + 4096 {
        let lines = scene.check(&client.frame());
        missing += 2 * HEIGHT - lines[0] - lines[1];
    }
    let damaged = client.counters();
    // A byte that ends a packet takes the next one with it, and one that becomes such an end makes two
    // of one.
    assert!((2..=3).contains(&damaged.broken), "{damaged:?}");
    assert!((2..=4).contains(&damaged.lost), "{damaged:?}");
    assert!(missing <= 4, "{missing}");
    assert_eq!(scene.check(&client.frame()), [HEIGHT, HEIGHT, 0]);
    let after = client.counters();
    assert_eq!(
        (after.broken, after.lost),
        (damaged.broken, damaged.lost),
        "no more than that"
    );
}

fn introduces_itself(client: &mut Client, board: &Board) {
    let (mut has_come, mut has_camera) = (false, false);
    let outcome = client.command_seeing(&HostMessage::SendHello, |message| match message {
        BoardMessage::Hello(hello) => {
            has_come = true;
            assert_eq!(hello.device, board.folder);
            assert_eq!(hello.preset, "lite");
            let size = (hello.raw.width_px, hello.raw.height_lines);
            assert_eq!(size, (WIDTH as u16, HEIGHT as u32));
            assert_eq!(hello.raw.format, PixelFormat::Grey8);
            assert_eq!((hello.disparity_min_px, hello.disparity_count), (0, 16));
            assert!(
                hello
                    .streams
                    .contains(DISPARITIES.streams.with(Streams::DEPTHS))
            );
            assert!(!hello.rectifies);
        }
        BoardMessage::Camera(camera) => has_camera = camera.focal_q8 > 0 && camera.depth_q8 > 0,
        _ => {}
    });
    assert_eq!(outcome, Outcome::Done);
    assert!(has_come && has_camera);
}

fn sends_raw_lines_without_matching(client: &mut Client, scene: &Scene) {
    let raw = Selection {
        streams: Streams::RAW,
        ..DISPARITIES
    };
    client.command(&HostMessage::Select(raw));
    assert_eq!(scene.check(&client.frame()), [0, 0, HEIGHT]);
    // With one pixel to send, what takes time is the rest.
    let pixel = Some(Region {
        x_px: 0,
        y_lines: 0,
        width_px: 1,
        height_lines: 1,
    });
    let one = |selection: Selection| Selection {
        region: pixel,
        ..selection
    };
    client.command(&HostMessage::Select(one(DISPARITIES)));
    let matched_us = client.period_us();
    client.command(&HostMessage::Select(one(raw)));
    let raw_us = client.period_us();
    println!("a frame takes {matched_us} us, without matching {raw_us} us");
    assert!(raw_us < matched_us / 2, "{raw_us} us, {matched_us} us");
}

fn stops_and_starts(client: &mut Client) {
    client.command(&HostMessage::Stop);
    for _ in 0..3 {
        let outcome = client.command_seeing(&HostMessage::SendHello, |message| {
            let is_of_frame = matches!(
                message,
                BoardMessage::FrameBegun(_) | BoardMessage::RawPair(_)
            );
            assert!(!is_of_frame, "{message:?}");
        });
        assert_eq!(outcome, Outcome::Done);
    }
    client.command(&HostMessage::Start);
    assert!(client.frame().is_done);
}

/// Sends a calibration in pieces of so many bytes, and the number that it should end with.
fn send_calibration(
    board: &mut Attended<'_>,
    calibration: &[u8],
    piece_bytes: usize,
    crc32: u32,
) -> anyhow::Result<()> {
    let total_bytes = u32::try_from(calibration.len())?;
    for (number, bytes) in calibration.chunks(piece_bytes).enumerate() {
        let piece = CalibrationPiece {
            total_bytes,
            crc32,
            offset_bytes: u32::try_from(number * piece_bytes)?,
            bytes,
        };
        board.command("piece", &HostMessage::CalibrationPiece(piece))?;
    }
    board.command(
        "commit",
        &HostMessage::CalibrationCommit { total_bytes, crc32 },
    )
}

/// A board that sees what two crooked cameras see gets their calibration over the link, and then sends what
/// the host makes of them with it; then another one, in the same way.
fn takes_a_calibration(board: &Board) -> anyhow::Result<()> {
    let pair = Pair::crooked(WIDTH as u16, HEIGHT as u16, 16, true)?;
    let uncalibrated = uncalibrated(&pair);
    let mut live = started(board, &uncalibrated)?;
    let calibrated = calibrates(&pair, &live.address().to_string());
    // Whatever was missed: the board's own reason is the better one.
    live.wait(Duration::ZERO)?;
    calibrated?;
    drop(live);

    // With the calibration from its start, as of `cargo firmware live --calibration`.
    let live = started(board, &pair)?;
    let source = Source::Tcp(live.address().to_string());
    let mut memory = Memory::default();
    let mut host = Attended::connect(&source, &mut memory, LONG)?;
    let crc32 = crc32_of(pair.rectification.as_deref().unwrap());
    assert_eq!(hello(&host, "calibration_crc32"), Some(crc32.into()));
    sends_what_the_host_computes(&mut host, &pair, ALL_MATCHED)?;
    leaves_out_what_is_not_sure(&mut host, &pair)
}

/// A board in RTL introduces itself, gets a calibration through the pins of its serial port, uses it, and takes settings.
fn takes_commands_in_rtl(board: &Board) -> anyhow::Result<()> {
    // A frame takes millions of cycles.
    let pair = Pair::crooked(48, 24, 8, true)?;
    let live = started(board, &uncalibrated(&pair))?;
    let source = Source::Tcp(live.address().to_string());
    let mut memory = Memory::default();
    let mut host = Attended::connect(&source, &mut memory, LONG)?;
    let fields = &host.board.hello.as_ref().unwrap().fields;
    assert_eq!(fields["device"], board.folder);
    assert_eq!(hello(&host, "calibration_crc32"), None);
    let bytes = pair.rectification.as_deref().unwrap();
    let refused = send_calibration(&mut host, &bytes[..200], 100, crc32_of(bytes));
    assert!(refused.is_err(), "it is cut off");
    is_used_once_sent(&mut host, &pair, ALL_MATCHED)?;
    leaves_out_what_is_not_sure(&mut host, &pair)
}

/// The pair, of whose cameras nothing is known.
fn uncalibrated(pair: &Pair) -> Pair {
    Pair {
        rectification: None,
        camera: None,
        ..pair.clone()
    }
}

/// Starts a board that is emulated or simulated and sees this pair.
fn started(board: &Board, pair: &Pair) -> anyhow::Result<LiveBoard> {
    let firmware = build(board)?;
    let request = pair.live_request(Preset::Lite, &[])?;
    let link = Link::local(Damage::default());
    if board.simulation.is_none() {
        return LiveBoard::emulated(board, &firmware, slice::from_ref(pair), &request, link);
    }
    let (program, scenario) = (simulation::build(board)?, Scenario::default());
    LiveBoard::simulated(board, &program, &firmware, pair, &request, &scenario, link)
}

/// A board of which the host asks it leaves out the disparities of less confidence.
fn leaves_out_what_is_not_sure(host: &mut Attended<'_>, pair: &Pair) -> anyhow::Result<()> {
    const CONFIDENCE_MIN: u8 = 60;
    let parameters = Parameters {
        confidence_min: Some(CONFIDENCE_MIN),
        ..Parameters::default()
    };
    host.command("parameters", &HostMessage::Parameters(parameters))?;
    host.drop_frames();
    let frame = host.frame()?.unwrap();
    let (expected, _) = host::run(pair, &pair.request(Preset::Lite, 1, &[])?)?;
    let all = expected
        .disparities_q4()
        .into_iter()
        .zip(expected.confidences);
    let sure: Vec<i16> = all
        .map(|(q4, confidence)| {
            if confidence < CONFIDENCE_MIN {
                INVALID
            } else {
                q4
            }
        })
        .collect();
    assert!(sure.iter().any(|&q4| q4 != INVALID));
    assert!(frame.disparities.as_ref().unwrap().values == sure);
    Ok(())
}

/// Calibrates the board at this address, which sees this pair.
fn calibrates(pair: &Pair, address: &str) -> anyhow::Result<()> {
    let source = Source::Tcp(address.to_owned());
    let mut memory = Memory::default();
    let mut host = Attended::connect(&source, &mut memory, LONG)?;
    assert_eq!(hello(&host, "calibration_crc32"), None);
    let piece_bytes = hello(&host, "piece_bytes_max").unwrap() as usize;

    // Damaged, or for other cameras: refused, and the board goes on as it was.
    let bytes = pair.rectification.as_deref().unwrap();
    let (width, height) = pair.left.dimensions();
    let [width, height] = [width, height].map(|px| px as u16);
    let disparities = pair.disparities.count;
    let other = Pair::crooked(width, height + 1, disparities, true)?;
    let other = other.rectification.unwrap();
    let mut damaged = bytes.to_vec();
    damaged[100] ^= 1;
    for wrong in [&other, &damaged] {
        let refused = send_calibration(&mut host, wrong, piece_bytes, crc32_of(wrong));
        let refused = refused.unwrap_err().to_string();
        assert!(
            refused.ends_with("commit: the calibration is unfit"),
            "{refused}"
        );
    }
    let refused = send_calibration(&mut host, bytes, piece_bytes, crc32_of(bytes) ^ 1);
    assert!(refused.is_err(), "the number at its end is another");
    host.command("hello", &HostMessage::SendHello)?;
    assert_eq!(hello(&host, "calibration_crc32"), None);

    // The same views by another calibration.
    let second = Pair::crooked(width, height, disparities, false)?;
    for pair in [pair, &second] {
        is_used_once_sent(&mut host, pair, ALL_MATCHED)?;
    }
    Ok(())
}

/// Sends the calibration of a pair to a board that sees it, which then sends what the host makes of it.
/// What is asked for besides disparities is compared as well.
fn is_used_once_sent(host: &mut Attended<'_>, pair: &Pair, streams: Streams) -> anyhow::Result<()> {
    begins_anew_with(host, pair)?;
    sends_what_the_host_computes(host, pair, streams)
}

/// Sends the calibration of a pair to a board, and waits until the board has begun anew with it.
fn begins_anew_with(host: &mut Attended<'_>, pair: &Pair) -> anyhow::Result<()> {
    let rectification = Rectification::from_bytes(pair.rectification.as_deref().unwrap())?;
    upload(host, &rectification, |_| {})?;
    // It may have sent the first lines of a frame before that.
    while hello(host, "calibration_crc32") != Some(rectification.crc32().into()) {
        host.frame()?;
    }
    Ok(())
}

/// The next frame of a board that sees a pair and has its calibration is what the host makes of it.
fn sends_what_the_host_computes(
    host: &mut Attended<'_>,
    pair: &Pair,
    streams: Streams,
) -> anyhow::Result<()> {
    let frame = next_frame(host, streams)?;
    let (expected, _) = host::run(pair, &pair.request(Preset::Lite, 1, &[])?)?;
    assert!(frame.disparities.as_ref().unwrap().values == expected.disparities_q4());
    if streams.contains(Streams::CONFIDENCES) {
        let confidences = frame.confidences.as_ref().unwrap();
        assert!(confidences.values == expected.confidences);
    }
    if streams.contains(Streams::DEPTHS) {
        let depth = pair.camera.unwrap().0.depth();
        let disparities_q4 = expected.disparities_q4();
        let depths_mm = disparities_q4.iter().map(|&q4| depth.mm(q4));
        let depths = frame.depths.as_ref().unwrap();
        assert!(depths.values.iter().copied().eq(depths_mm));
    }
    assert_eq!(
        frame.rectified.is_some(),
        streams.contains(Streams::RECTIFIED)
    );
    Ok(())
}

/// Asks for disparities and these streams, and returns the next frame, which is whole.
fn next_frame(host: &mut Attended<'_>, streams: Streams) -> anyhow::Result<board::Frame> {
    let selection = HostMessage::Select(Selection::whole(streams.with(Streams::DISPARITIES)));
    host.command("select", &selection)?;
    host.drop_frames();
    let frame = host.frame()?.unwrap();
    assert!(frame.is_whole());
    Ok(*frame)
}

/// A number of the board's hello.
fn hello(host: &Attended<'_>, field: &str) -> Option<u64> {
    host.board.hello.as_ref()?.fields[field].as_u64()
}

/// The number that a calibration ends with.
fn crc32_of(calibration: &[u8]) -> u32 {
    u32::from_le_bytes(*calibration.last_chunk().unwrap())
}

/// A real board on the model of its chip keeps a calibration in flash, and starts anew with it.
fn keeps_a_calibration_in_flash(board: &Board) -> anyhow::Result<()> {
    let built_for = board.model.unwrap();
    let (width, height) = built_for.size;
    let disparities = built_for.disparities;
    let pair = Pair::crooked(width.try_into()?, height.try_into()?, disparities, true)?;
    let uncalibrated = Pair {
        rectification: None,
        ..pair.clone()
    };
    let (program, firmware) = (model::build(board)?, build(board)?);
    let link = Link::local(Damage::default());
    let live = LiveBoard::modelled(board, &program, &firmware, &uncalibrated, link)?;
    let source = Source::Tcp(live.address().to_string());
    let mut memory = Memory::default();
    let mut host = Attended::connect(&source, &mut memory, VERY_LONG)?;
    assert_eq!(hello(&host, "calibration_crc32"), None);
    begins_anew_with(&mut host, &pair)?;
    // The serial port has room for disparities alone. The board keeps the offsets of lines from frame to frame.
    let frame = next_frame(&mut host, Streams::NONE)?;
    let frames = frame.begun.frame + 1;
    let request = pair.request(built_for.preset, frames, &[])?;
    let (expected, _) = host::run_keeping_line_offsets(&pair, &request)?;
    let expected_q4 = expected.disparities_q4();
    let last_q4 = expected_q4.chunks((width * height) as usize).next_back();
    assert!(frame.disparities.unwrap().values == last_q4.unwrap());
    Ok(())
}
