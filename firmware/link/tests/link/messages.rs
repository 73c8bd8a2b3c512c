//! Messages of any content through an encoder and a decoder.

use proptest::prelude::*;
use vgstereo_link::board::{
    Camera, FrameBegun, Hello, Level, LinePair, LinkCounters, Outcome, PointLine, Scan,
    SessionCounters, Statistics, View,
};
use vgstereo_link::host::CalibrationPiece;
use vgstereo_link::{
    BoardMessage, Counters, DELIMITER, Decoder, EncodeError, Encoder, HostMessage, Line, Message,
    Parameters, PixelFormat, Reason, Region, Selection, Source, State, Streams, Values,
    memory_bytes, packet,
};

/// Content for every kind of message.
#[derive(Debug, Clone)]
pub(crate) struct Content {
    numbers: [u32; 13],
    time_us: u64,
    angles: [f32; 2],
    small: [u8; 4],
    text: String,
    other_text: String,
    disparities_q4: Vec<i16>,
    bytes: Vec<u8>,
    flag: bool,
}

prop_compose! {
    pub(crate) fn content()(
        numbers in any::<[u32; 13]>(),
        time_us in any::<u64>(),
        angles in [-9.0_f32..9.0, -9.0_f32..9.0],
        small in any::<[u8; 4]>(),
        text in "\\PC{0,20}",
        other_text in "\\PC{0,20}",
        disparities_q4 in prop::collection::vec(prop_oneof![Just(i16::MIN), 90_i16..130, any::<i16>()], 0..60),
        bytes in prop::collection::vec(any::<u8>(), 0..70),
        flag in any::<bool>(),
    ) -> Content {
        Content { numbers, time_us, angles, small, text, other_text, disparities_q4, bytes, flag }
    }
}

const FORMATS: [PixelFormat; 4] = [
    PixelFormat::Grey8,
    PixelFormat::Rgb888,
    PixelFormat::Rgb565,
    PixelFormat::Yuv422,
];

/// Lines of the widths that messages need.
pub(crate) struct Owned {
    content: Content,
    depths_mm: Vec<u16>,
}

impl Owned {
    pub(crate) fn new(content: Content) -> Self {
        let depths_mm = content
            .disparities_q4
            .iter()
            .map(|d| d.cast_unsigned())
            .collect();
        Self { content, depths_mm }
    }

    /// One message of every kind from the board.
    pub(crate) fn board(&self) -> Vec<BoardMessage<'_>> {
        let Content {
            numbers: n,
            time_us,
            angles,
            small,
            text,
            other_text,
            disparities_q4,
            bytes,
            flag,
        } = &self.content;
        let format = FORMATS[usize::from(small[0] % 4)];
        let (left, right) = bytes.split_at(bytes.len() / 2);
        let right = &right[..left.len()];
        let view = |width: u32| View {
            width_px: width as u16,
            height_lines: n[3],
            format,
        };
        let pair = LinePair {
            frame: n[0],
            line: n[1],
            format,
            left,
            right,
        };
        vec![
            BoardMessage::Hello(Hello {
                device: text,
                firmware: other_text,
                raw: view(n[0]),
                matched: view(n[1]),
                preset: "micro",
                disparity_min_px: n[2] as i16,
                disparity_count: n[3] as u16,
                latency_lines: n[4],
                streams: Streams::from_bits(n[5] as u16),
                calibration_crc32: flag.then_some(n[6]),
                rectifies: *flag,
                piece_bytes_max: n[7] as u16,
            }),
            BoardMessage::FrameBegun(FrameBegun {
                frame: n[0],
                timestamp_us: *time_us,
                region: region(n),
            }),
            BoardMessage::FrameDone { frame: n[0] },
            BoardMessage::FrameAborted {
                frame: n[0],
                reason: Reason::from(small[1] % 13),
            },
            BoardMessage::Disparities(line(n, disparities_q4)),
            BoardMessage::Confidences(line(n, bytes)),
            BoardMessage::Depths(line(n, &self.depths_mm)),
            BoardMessage::Points(PointLine {
                frame: n[0],
                line: n[1],
                column: n[2] as u16,
                points: bytes.as_chunks().0,
            }),
            BoardMessage::Scan(Scan {
                frame: n[0],
                timestamp_us: *time_us,
                bearing_min_rad: angles[0],
                bearing_step_rad: angles[1],
                range_max_mm: n[1] as u16,
                ranges_mm: Values::Plain(&self.depths_mm),
            }),
            BoardMessage::RawPair(pair),
            BoardMessage::RectifiedPair(pair),
            BoardMessage::Statistics(Statistics {
                session: SessionCounters {
                    frames: n[0],
                    frames_dropped: n[1],
                    lines: n[2],
                    lines_dropped: n[3],
                    sequence_breaks: n[4],
                    overruns: n[5],
                    sync_losses: n[6],
                    short_lines: n[7],
                    short_frames: n[8],
                    timeouts: n[9],
                    bus_errors: n[10],
                    other_errors: n[11],
                    sink_errors: n[12],
                },
                link: LinkCounters {
                    packets: n[4],
                    dropped: n[3],
                    frames_decimated: n[2],
                    commands: n[1],
                    commands_refused: n[0],
                },
            }),
            BoardMessage::Log {
                level: Level::from(small[2] % 5),
                text,
            },
            BoardMessage::Answer {
                sequence: n[0],
                outcome: Outcome::from(small[3] % 6),
            },
            BoardMessage::Camera(Camera {
                focal_q8: n[0],
                principal_x_q8: n[1].cast_signed(),
                principal_y_q8: n[2].cast_signed(),
                depth_q8: n[3],
                offset_q8: n[4].cast_signed(),
            }),
            BoardMessage::State(State {
                is_started: *flag,
                selection: selection(n, *flag),
                source: Source::from(small[1] % 2),
                parameters: parameters(n, small, *flag),
            }),
        ]
    }

    /// One message of every kind from the host.
    pub(crate) fn host(&self) -> Vec<HostMessage<'_>> {
        let Content {
            numbers: n,
            small,
            bytes,
            flag,
            ..
        } = &self.content;
        vec![
            HostMessage::Start,
            HostMessage::Stop,
            HostMessage::Select(selection(n, *flag)),
            HostMessage::CalibrationPiece(CalibrationPiece {
                total_bytes: n[0],
                crc32: n[1],
                offset_bytes: n[2],
                bytes,
            }),
            HostMessage::CalibrationCommit {
                total_bytes: n[0],
                crc32: n[1],
            },
            HostMessage::CalibrationDiscard,
            HostMessage::Parameters(parameters(n, small, *flag)),
            HostMessage::ResetCounters,
            HostMessage::SendHello,
            HostMessage::Source(Source::from(small[0] % 2)),
        ]
    }
}

fn selection(n: &[u32; 13], flag: bool) -> Selection {
    Selection {
        streams: Streams::from_bits(n[0] as u16),
        every_frames: n[1] as u16,
        region: flag.then_some(region(n)),
    }
}

fn parameters(n: &[u32; 13], small: &[u8; 4], flag: bool) -> Parameters {
    Parameters {
        margin: flag.then_some(n[0] as i16),
        left_right_tolerance_px: (!flag).then_some(small[0]),
        texture_min: flag.then_some(n[1] as u16),
        speckle_size_min: (!flag).then_some(small[1]),
        speckle_step_q4: flag.then_some(small[2]),
        confidence_min: (!flag).then_some(small[3]),
        dense: (!n[2].is_multiple_of(3)).then_some(flag),
    }
}

fn region(n: &[u32; 13]) -> Region {
    Region {
        x_px: n[8] as u16,
        y_lines: n[9],
        width_px: n[10] as u16,
        height_lines: n[11],
    }
}

fn line<'a, T>(n: &[u32; 13], values: &'a [T]) -> Line<'a, T> {
    Line {
        frame: n[0],
        line: n[1],
        column: n[2] as u16,
        values: Values::Plain(values),
    }
}

/// The bytes of a body: what a message is, packed or not.
pub(crate) fn encoded<'a, M: Message<'a>>(message: &M) -> Vec<u8> {
    let mut memory = [0; 2000];
    Encoder::new(&mut memory)
        .encode(5, message)
        .unwrap()
        .to_vec()
}

/// Panics unless two messages are equal, where a line is packed in one of them.
pub(crate) fn assert_same(received: &BoardMessage<'_>, sent: &BoardMessage<'_>) {
    fn assert_values<T: vgstereo_link::Sample>(received: &Values<'_, T>, sent: &Values<'_, T>) {
        assert_eq!(received.count(), sent.count());
        let mut values = [
            vec![T::default(); sent.count()],
            vec![T::NONE; sent.count()],
        ];
        received.unpack(&mut values[0]).unwrap();
        sent.unpack(&mut values[1]).unwrap();
        assert_eq!(values[0], values[1]);
    }
    fn assert_lines<T: vgstereo_link::Sample>(received: &Line<'_, T>, sent: &Line<'_, T>) {
        let place = |line: &Line<'_, T>| (line.frame, line.line, line.column);
        assert_eq!(place(received), place(sent));
        assert_values(&received.values, &sent.values);
    }
    match (received, sent) {
        (BoardMessage::Disparities(received), BoardMessage::Disparities(sent)) => {
            assert_lines(received, sent);
        }
        (BoardMessage::Confidences(received), BoardMessage::Confidences(sent)) => {
            assert_lines(received, sent);
        }
        (BoardMessage::Depths(received), BoardMessage::Depths(sent)) => {
            assert_lines(received, sent);
        }
        (BoardMessage::Scan(received), BoardMessage::Scan(sent)) => {
            assert_values(&received.ranges_mm, &sent.ranges_mm);
            let ranges_mm = sent.ranges_mm;
            assert_eq!(
                Scan {
                    ranges_mm,
                    ..*received
                },
                *sent
            );
        }
        _ => assert_eq!(received, sent),
    }
}

proptest! {
    #[test]
    fn every_message_survives_in_pieces_of_any_length(
        content in content(),
        piece in 1..60_usize,
        time_us in any::<u64>(),
    ) {
        let owned = Owned::new(content);
        let (board, host) = (owned.board(), owned.host());
        let mut memory = [0; 2000];
        let mut encoder = Encoder::new(&mut memory);
        let mut stream = vec![DELIMITER];
        let mut send = |bytes: Result<&[u8], EncodeError>| {
            let bytes = bytes.unwrap();
            let (last, rest) = bytes.split_last().unwrap();
            assert!(*last == DELIMITER && !rest.contains(&DELIMITER));
            stream.extend_from_slice(bytes);
        };
        for message in &board {
            send(encoder.encode(time_us, message));
        }
        for message in &host {
            send(encoder.encode(time_us, message));
        }

        // Both directions in one stream: each knows nothing of the other's kinds.
        let mut memory = [0; 2000];
        let mut decoder = Decoder::new(&mut memory);
        let mut received = 0;
        for mut rest in stream.chunks(piece) {
            while let Some(packet) = decoder.next::<BoardMessage<'_>>(&mut rest) {
                let Ok(packet) = packet else { continue };
                prop_assert_eq!(packet.sequence as usize, received);
                prop_assert_eq!(packet.timestamp_us, time_us);
                assert_same(&packet.message, &board[received]);
                // As it was received it can be sent on.
                prop_assert_eq!(encoded(&packet.message), encoded(&board[received]));
                received += 1;
            }
        }
        let counters = Counters {
            messages: board.len() as u32,
            unknown: host.len() as u32,
            ..Counters::default()
        };
        prop_assert_eq!(decoder.counters(), counters);

        let mut memory = [0; 2000];
        let mut decoder = Decoder::new(&mut memory);
        let mut received = 0;
        for mut rest in stream.chunks(piece) {
            while let Some(packet) = decoder.next::<HostMessage<'_>>(&mut rest) {
                let Ok(packet) = packet else { continue };
                prop_assert_eq!(packet.message, host[received]);
                received += 1;
            }
        }
        let counters = Counters {
            messages: host.len() as u32,
            unknown: board.len() as u32,
            ..Counters::default()
        };
        prop_assert_eq!(decoder.counters(), counters);
    }

    #[test]
    fn framing_and_checksum_are_those_of_other_implementations(content in content()) {
        for message in Owned::new(content).board() {
            let bytes = encoded(&message);
            let plain = unframed(&bytes).unwrap();
            let (packet, stored) = plain.split_last_chunk().unwrap();
            prop_assert_eq!(u32::from_le_bytes(*stored), slow_crc32(packet));
            prop_assert_eq!(&packet[..4], &[packet::VERSION, message.kind(), 0, 5]);
        }
    }

    #[test]
    fn too_little_memory_writes_no_packet_and_uses_no_number(content in content()) {
        let owned = Owned::new(content);
        for message in owned.board() {
            let mut sizes = (0..300).filter(|bytes| {
                let mut memory = vec![0; *bytes];
                let mut encoder = Encoder::new(&mut memory);
                match encoder.encode(5, &message) {
                    Ok(bytes) => {
                        assert_eq!(bytes, encoded(&message));
                        assert_eq!(encoder.sequence(), 1);
                        true
                    }
                    Err(error) => {
                        assert_eq!(error, EncodeError::Memory);
                        assert_eq!(encoder.sequence(), 0);
                        false
                    }
                }
            });
            let smallest = sizes.next().unwrap();
            prop_assert_eq!(sizes.count(), 299 - smallest);
        }
    }
}

#[test]
fn long_runs_with_and_without_zeros_are_framed() {
    let mut memory = vec![0; 3000];
    let mut received = vec![0; 3000];
    for length in (230..270).chain(490..530).chain([1000]) {
        for zero_at in [0, 3, 240, 253, 254, 255, 400, length - 1, length] {
            let bytes: Vec<u8> = (0..length).map(|at| u8::from(at != zero_at)).collect();
            let message = BoardMessage::RawPair(LinePair {
                frame: 1,
                line: 1,
                format: PixelFormat::Grey8,
                left: &bytes,
                right: &bytes,
            });
            let mut encoder = Encoder::new(&mut memory);
            let packet = encoder.encode(5, &message).unwrap();
            let plain = unframed(packet).unwrap();
            assert!(packet.len() <= plain.len() + plain.len() / 254 + 2);
            let (content, stored) = plain.split_last_chunk().unwrap();
            assert_eq!(u32::from_le_bytes(*stored), slow_crc32(content));
            assert!(content.ends_with(&[&bytes[..], &bytes].concat()));
            let mut rest = packet;
            let mut decoder = Decoder::new(&mut received);
            let packet = decoder.next::<BoardMessage<'_>>(&mut rest);
            assert_eq!(packet.unwrap().unwrap().message, message);
        }
    }
}

/// Framing taken off as COBS defines it.
pub(crate) fn unframed(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut rest = bytes.strip_suffix(&[0])?;
    let mut plain = Vec::new();
    while let Some((code, after)) = rest.split_first() {
        let (run, after) = after.split_at_checked(usize::from(*code) - 1)?;
        plain.extend_from_slice(run);
        if *code != 255 && !after.is_empty() {
            plain.push(0);
        }
        rest = after;
    }
    Some(plain)
}

/// CRC-32 bit by bit.
pub(crate) fn slow_crc32(bytes: &[u8]) -> u32 {
    let mut register = !0_u32;
    for byte in bytes {
        register ^= u32::from(*byte);
        for _ in 0..8 {
            register = (register >> 1) ^ ((register & 1) * 0xedb8_8320);
        }
    }
    !register
}

#[test]
fn memory_of_a_width_has_room_for_every_line_of_its_streams() {
    let n = [u32::MAX; 13];
    for width in [1_u16, 2, 3, 100, 127, 160, 640, 1280, 10_000, u16::MAX] {
        // What cannot be packed, and so takes the most.
        let random = (0..width).map(|x| x.wrapping_mul(40_503).rotate_left(5) | 1);
        let random: Vec<u16> = random.collect();
        let disparities: Vec<i16> = random.iter().map(|value| value.cast_signed()).collect();
        let confidences: Vec<u8> = random.iter().map(|value| *value as u8).collect();
        for format in FORMATS {
            let bytes = vec![0; format.line_bytes(width)];
            let pair = LinePair {
                frame: u32::MAX,
                line: u32::MAX,
                format,
                left: &bytes,
                right: &bytes,
            };
            for (stream, message) in [
                (Streams::RAW, BoardMessage::RawPair(pair)),
                (Streams::RECTIFIED, BoardMessage::RectifiedPair(pair)),
                (
                    Streams::DISPARITIES,
                    BoardMessage::Disparities(line(&n, &disparities)),
                ),
                (
                    Streams::CONFIDENCES,
                    BoardMessage::Confidences(line(&n, &confidences)),
                ),
                (Streams::DEPTHS, BoardMessage::Depths(line(&n, &random))),
                (
                    Streams::POINTS,
                    BoardMessage::Points(PointLine {
                        frame: u32::MAX,
                        line: u32::MAX,
                        column: u16::MAX,
                        points: &vec![[255; 6]; width.into()],
                    }),
                ),
                (
                    Streams::SCANS,
                    BoardMessage::Scan(Scan {
                        frame: u32::MAX,
                        timestamp_us: u64::MAX,
                        bearing_min_rad: 1.0,
                        bearing_step_rad: 1.0,
                        range_max_mm: u16::MAX,
                        ranges_mm: Values::Plain(&random),
                    }),
                ),
            ] {
                let mut memory = vec![0; memory_bytes(width, format, stream)];
                let mut encoder = Encoder::new(&mut memory);
                assert!(encoder.encode(u64::MAX, &message).is_ok(), "{stream:?}");
            }
        }
    }
}

#[test]
fn lines_that_no_message_can_carry_are_refused() {
    let mut memory = vec![0; 200_000];
    let mut encoder = Encoder::new(&mut memory);
    let long = line(&[0; 13], &[0_u8; 65_536]);
    let refused = encoder.encode(0, &BoardMessage::Confidences(long));
    assert_eq!(refused, Err(EncodeError::Line));
    let pair = LinePair {
        frame: 0,
        line: 0,
        format: PixelFormat::Grey8,
        left: &[1, 2],
        right: &[1],
    };
    let refused = encoder.encode(0, &BoardMessage::RawPair(pair));
    assert_eq!(refused, Err(EncodeError::Line));
    assert_eq!(encoder.sequence(), 0);
}
