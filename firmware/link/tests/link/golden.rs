//! The packets of docs/link.md, which the tests in `tests/tests/link.rs` give to the decoder in Python.

use std::fmt::Debug;
use std::fs;
use std::path::Path;

use vgstereo_link::board::{
    Camera, FrameBegun, Hello, Level, LinePair, LinkCounters, Outcome, PointLine, Scan,
    SessionCounters, Statistics, View,
};
use vgstereo_link::host::CalibrationPiece;
use vgstereo_link::{
    BoardMessage, Decoder, Encoder, HostMessage, Line, Message, Parameters, PixelFormat, Reason,
    Region, Selection, Source, State, Streams, Values,
};

const REGION: Region = Region {
    x_px: 0,
    y_lines: 0,
    width_px: 320,
    height_lines: 240,
};

pub(crate) fn hello() -> BoardMessage<'static> {
    let view = |format| View {
        width_px: 320,
        height_lines: 240,
        format,
    };
    BoardMessage::Hello(Hello {
        device: "stereo camera",
        firmware: "0.1.0",
        raw: view(PixelFormat::Yuv422),
        matched: view(PixelFormat::Grey8),
        preset: "lite",
        disparity_min_px: -2,
        disparity_count: 48,
        latency_lines: 7,
        streams: Streams::RAW.with(Streams::DISPARITIES).with(Streams::SCANS),
        calibration_crc32: Some(0xcbf4_3926),
        rectifies: true,
        piece_bytes_max: 256,
    })
}

fn line<T>(values: &[T]) -> Line<'_, T> {
    Line {
        frame: 41,
        line: 3,
        column: 0,
        values: Values::Plain(values),
    }
}

fn board() -> Vec<BoardMessage<'static>> {
    let session = SessionCounters {
        frames: 40,
        lines: 9600,
        timeouts: 1,
        ..SessionCounters::default()
    };
    let link = LinkCounters {
        packets: 300,
        dropped: 2,
        ..LinkCounters::default()
    };
    vec![
        hello(),
        BoardMessage::FrameBegun(FrameBegun {
            frame: 41,
            timestamp_us: 1_000_000,
            region: REGION,
        }),
        // One difference too wide for few bits, and gaps; then a whole group of gaps, and another
        // that is filled up.
        BoardMessage::Disparities(line(&[
            160,
            163,
            i16::MIN,
            161,
            i16::MIN,
            i16::MIN,
            i16::MIN,
            i16::MIN,
            -5,
            -5,
        ])),
        BoardMessage::Disparities(line(&[-20_000, 20_000, -20_000, 0])),
        BoardMessage::Confidences(line(&[200, 190, 0, 180])),
        BoardMessage::Depths(line(&[1500, 1502, 1502, 0])),
        BoardMessage::Points(PointLine {
            frame: 41,
            line: 3,
            column: 7,
            points: &[[0xfe, 0xff, 3, 0, 0, 4], [0; 6]],
        }),
        BoardMessage::Scan(Scan {
            frame: 41,
            timestamp_us: 1_000_000,
            bearing_min_rad: -0.5,
            bearing_step_rad: 0.25,
            range_max_mm: 4000,
            ranges_mm: Values::Plain(&[1000, 0, 0, 0, 1010]),
        }),
        BoardMessage::RawPair(LinePair {
            frame: 41,
            line: 3,
            format: PixelFormat::Rgb565,
            left: &[0xf8, 0, 0x07, 0xe0],
            right: &[0, 0x1f, 0xff, 0xff],
        }),
        BoardMessage::RectifiedPair(LinePair {
            frame: 41,
            line: 3,
            format: PixelFormat::Grey8,
            left: &[1, 2],
            right: &[3, 4],
        }),
        BoardMessage::FrameDone { frame: 41 },
        BoardMessage::FrameAborted {
            frame: 42,
            reason: Reason::CameraTimeout,
        },
        BoardMessage::Statistics(Statistics { session, link }),
        BoardMessage::Log {
            level: Level::Warning,
            text: "sensor late",
        },
        BoardMessage::Answer {
            sequence: 2,
            outcome: Outcome::OutOfBounds,
        },
        BoardMessage::Camera(Camera {
            focal_q8: 97_536,
            principal_x_q8: 40_832,
            principal_y_q8: -3,
            depth_q8: 5_266_944,
            offset_q8: 512,
        }),
        BoardMessage::State(State {
            is_started: true,
            selection: Selection {
                streams: Streams::RAW,
                every_frames: 1,
                region: None,
            },
            source: Source::TestPattern,
            parameters: Parameters {
                margin: Some(-24),
                dense: Some(false),
                ..Parameters::default()
            },
        }),
    ]
}

fn host() -> Vec<HostMessage<'static>> {
    vec![
        HostMessage::SendHello,
        HostMessage::Select(Selection {
            streams: Streams::DISPARITIES.with(Streams::CONFIDENCES),
            every_frames: 2,
            region: Some(Region { x_px: 16, ..REGION }),
        }),
        HostMessage::Parameters(Parameters {
            margin: Some(24),
            confidence_min: Some(10),
            ..Parameters::default()
        }),
        HostMessage::CalibrationPiece(CalibrationPiece {
            total_bytes: 9,
            crc32: 0xcbf4_3926,
            offset_bytes: 0,
            bytes: b"123456789",
        }),
        HostMessage::CalibrationCommit {
            total_bytes: 9,
            crc32: 0xcbf4_3926,
        },
        HostMessage::CalibrationDiscard,
        HostMessage::ResetCounters,
        HostMessage::Start,
        HostMessage::Stop,
        HostMessage::Source(Source::TestPattern),
    ]
}

/// The packets of a section of the document: its indented lines in hexadecimal.
fn packets(section: &str) -> Vec<Vec<u8>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/link.md");
    let text = fs::read_to_string(path).unwrap();
    let (_, text) = text.split_once(&format!("### {section}\n")).unwrap();
    let text = text.split("\n#").next().unwrap();
    let blocks = text.trim_start_matches('\n').split("\n\n");
    let blocks = blocks.filter(|block| block.starts_with("    "));
    let blocks = blocks.map(|block| {
        let hex = block
            .lines()
            .filter(|line| line.ends_with(" 00") || line.ends_with(" \\"));
        let words = hex.flat_map(|line| line.trim_end_matches('\\').split_whitespace());
        words
            .map(|word| u8::from_str_radix(word, 16).unwrap())
            .collect()
    });
    blocks.collect()
}

/// A packet as lines of the document.
fn hex(packet: &[u8]) -> String {
    let lines = packet.chunks(28).map(|bytes| {
        let bytes: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("    {}", bytes.join(" "))
    });
    lines.collect::<Vec<_>>().join(" \\\n")
}

/// The packets of these messages are those of a section of the document.
fn sent_as_documented<'a, M: Message<'a> + Debug>(messages: &[M], documented: &[Vec<u8>]) {
    let mut memory = [0; 500];
    let mut encoder = Encoder::new(&mut memory);
    for (message, number) in messages.iter().zip(0..) {
        let packet = encoder.encode(1000 * number, message).unwrap();
        let expected = documented.get(number as usize).map(Vec::as_slice);
        assert_eq!(Some(packet), expected, "{message:?} is\n{}", hex(packet));
    }
    assert_eq!(documented.len(), messages.len());
}

#[test]
fn the_board_sends_the_packets_of_the_document_and_the_host_understands_them() {
    let documented = packets("From the board, by number");
    let messages = board();
    sent_as_documented(&messages, &documented);

    let mut memory = [0; 500];
    let mut decoder = Decoder::new(&mut memory);
    for (packet, message) in documented.iter().zip(&messages) {
        let mut rest = &packet[..];
        let received = decoder.next::<BoardMessage<'_>>(&mut rest).unwrap();
        let received = received.unwrap().message;
        super::messages::assert_same(&received, message);
    }
}

#[test]
fn the_host_sends_the_packets_of_the_document_and_the_board_understands_them() {
    let documented = packets("To the board, by number");
    let messages = host();
    sent_as_documented(&messages, &documented);

    let mut memory = [0; 500];
    let mut decoder = Decoder::new(&mut memory);
    for (packet, message) in documented.iter().zip(&messages) {
        let mut rest = &packet[..];
        let received = decoder.next::<HostMessage<'_>>(&mut rest).unwrap();
        assert_eq!(received.unwrap().message, *message);
    }
}
