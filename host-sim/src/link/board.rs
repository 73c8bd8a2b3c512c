//! What is known of a board from the messages that have come: itself, its counters, and its frames.

use std::collections::VecDeque;

use serde::Serialize;
use serde_json::Value;
use vgstereo_core::geometry::{Depth, RectifiedCamera};
use vgstereo_link::board::{Camera, FrameBegun, Hello, Level, LinePair, Outcome, Statistics, View};
use vgstereo_link::{
    BoardMessage, Line, Packet, PixelFormat, Reason, Region, Sample, State, Streams,
};

use super::plane::Plane;

/// Lines of the log that are kept.
const LOG_LINES: usize = 50;
/// Characters of a text of the board that are kept.
const TEXT_CHARACTERS: usize = 256;

/// What a board has told.
#[derive(Debug, Default)]
pub struct Board {
    /// Its introduction.
    pub hello: Option<Introduction>,
    /// The camera that disparities are seen with.
    pub camera: Option<Camera>,
    /// What it sends, and its parameters.
    pub state: Option<State>,
    /// Its counters.
    pub statistics: Option<Statistics>,
    /// The newest lines of its log, the oldest first.
    pub log: VecDeque<LogLine>,
    /// What became of its frames.
    pub frames: FrameCounts,
    open: Option<Frame>,
}

/// The introduction of a board, of which more than its text is needed.
#[derive(Debug, Clone, PartialEq)]
pub struct Introduction {
    /// All fields, as the page gets them.
    pub fields: Value,
    /// The lines of the camera.
    pub raw: View,
    /// The lines that are matched.
    pub matched: View,
    /// The streams that can be sent.
    pub streams: Streams,
    /// Bytes of the largest piece of a calibration; 0 if none can be stored.
    pub piece_bytes_max: u16,
}

/// A line of the board's log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LogLine {
    /// How many lines came before it.
    pub number: u64,
    /// How much it matters.
    pub level: &'static str,
    /// Its text.
    pub text: String,
}

/// How many frames ended in which way.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct FrameCounts {
    /// All lines came.
    pub whole: u64,
    /// Lines are missing.
    pub with_gaps: u64,
    /// The board aborted them.
    pub aborted: u64,
    /// Why the board aborted the last of those.
    pub abort_reason: Option<&'static str>,
    /// Whether the last frame of all was aborted.
    pub is_last_aborted: bool,
    /// Lines that are of no frame, or do not fit theirs.
    pub stray_lines: u64,
}

/// A frame: what of it has come.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number, time and region.
    pub begun: FrameBegun,
    /// Times at which the board sent its beginning and its end, µs.
    pub sent_us: [u64; 2],
    /// The pair of views from the camera.
    pub raw: Option<Pictures>,
    /// The rectified pair of views.
    pub rectified: Option<Pictures>,
    /// Disparities, 1/16 px.
    pub disparities: Option<Plane<i16>>,
    /// Confidences.
    pub confidences: Option<Plane<u8>>,
    /// Depths, mm.
    pub depths: Option<Plane<u16>>,
    /// The scan.
    pub scan: Option<Scan>,
}

/// Two views.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pictures {
    /// Format of the pixels.
    pub format: PixelFormat,
    /// Bytes of the left and the right view; their width is in bytes.
    pub views: [Plane<u8>; 2],
}

/// A laser scan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scan {
    /// The first bearing, the rightmost, rad.
    pub bearing_min_rad: f32,
    /// The angle between bearings, rad.
    pub bearing_step_rad: f32,
    /// Ranges beyond this did not count, mm.
    pub range_max_mm: u16,
    /// The range at each bearing, mm, from right to left; 0 where nothing was seen.
    pub ranges_mm: Vec<u16>,
}

/// What a message has changed, beyond the fields of [`Board`].
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// The board has introduced itself.
    Introduced,
    /// A frame has ended. Lines may be missing.
    Ended(Box<Frame>),
    /// A command was answered.
    Answered {
        /// Sequence number of the command.
        sequence: u32,
        /// The outcome.
        outcome: Outcome,
    },
}

impl Board {
    /// Takes a message and returns what follows from it. A frame whose end was lost ends when the
    /// next begins.
    pub fn take(&mut self, packet: &Packet<BoardMessage<'_>>) -> Option<Change> {
        let sent_us = packet.timestamp_us;
        match &packet.message {
            BoardMessage::Hello(hello) => {
                self.hello = Some(Introduction::new(hello));
                return Some(Change::Introduced);
            }
            BoardMessage::FrameBegun(begun) => {
                let before = self.open.replace(Frame::new(*begun, sent_us));
                let before = before.filter(Frame::has_lines)?;
                return Some(self.ended(before));
            }
            BoardMessage::FrameDone { frame } => {
                let mut open = self.open.take_if(|open| open.begun.frame == *frame)?;
                open.sent_us[1] = sent_us;
                return Some(self.ended(open));
            }
            BoardMessage::FrameAborted { frame, reason } => {
                self.open.take_if(|open| open.begun.frame == *frame);
                self.frames.aborted += 1;
                self.frames.abort_reason = Some(reason_name(*reason));
                self.frames.is_last_aborted = true;
            }
            BoardMessage::Disparities(line) => self.line(line.frame, |frame| {
                put(&mut frame.disparities, &frame.begun.region, line)
            }),
            BoardMessage::Confidences(line) => self.line(line.frame, |frame| {
                put(&mut frame.confidences, &frame.begun.region, line)
            }),
            BoardMessage::Depths(line) => self.line(line.frame, |frame| {
                put(&mut frame.depths, &frame.begun.region, line)
            }),
            BoardMessage::Points(line) => self.line(line.frame, |frame| {
                let plane = made(&mut frame.depths, &frame.begun.region, 0);
                let Some(plane) = plane else { return false };
                let count = line.points.len();
                plane.put(line.line, line.column.into(), count, |place| {
                    for (depth_mm, point) in place.iter_mut().zip(line.points) {
                        let [.., low, high] = *point;
                        *depth_mm = u16::from_le_bytes([low, high]);
                    }
                    true
                })
            }),
            BoardMessage::Scan(scan) => {
                let mut ranges_mm = vec![0; scan.ranges_mm.count()];
                let is_whole = scan.ranges_mm.unpack(&mut ranges_mm).is_ok();
                self.line(scan.frame, |frame| {
                    frame.scan = is_whole.then_some(Scan {
                        bearing_min_rad: scan.bearing_min_rad,
                        bearing_step_rad: scan.bearing_step_rad,
                        range_max_mm: scan.range_max_mm,
                        ranges_mm,
                    });
                    is_whole
                });
            }
            BoardMessage::RawPair(pair) => {
                let view = self.hello.as_ref().map(|hello| hello.raw);
                self.line(pair.frame, |frame| {
                    let height = height_of(view, &frame.begun.region);
                    put_pair(&mut frame.raw, height, pair)
                });
            }
            BoardMessage::RectifiedPair(pair) => {
                let view = self.hello.as_ref().map(|hello| hello.matched);
                self.line(pair.frame, |frame| {
                    let height = height_of(view, &frame.begun.region);
                    put_pair(&mut frame.rectified, height, pair)
                });
            }
            BoardMessage::Statistics(statistics) => self.statistics = Some(*statistics),
            BoardMessage::Log { level, text } => {
                let number = self.log.back().map_or(0, |line| line.number + 1);
                if self.log.len() == LOG_LINES {
                    self.log.pop_front();
                }
                self.log.push_back(LogLine {
                    number,
                    level: level_name(*level),
                    text: text.chars().take(TEXT_CHARACTERS).collect(),
                });
            }
            BoardMessage::Answer { sequence, outcome } => {
                return Some(Change::Answered {
                    sequence: *sequence,
                    outcome: *outcome,
                });
            }
            BoardMessage::Camera(camera) => self.camera = Some(*camera),
            BoardMessage::State(state) => self.state = Some(*state),
        }
        None
    }

    /// Forgets what holds for a connection alone, so that nothing old is taken for what a board
    /// tells now. Counts and log stay.
    pub fn disconnect(&mut self) {
        self.hello = None;
        self.camera = None;
        self.state = None;
        self.statistics = None;
        self.open = None;
    }

    /// The camera as the core takes it, if the board has told one that can be.
    #[must_use]
    pub fn rectified_camera(&self) -> Option<RectifiedCamera> {
        let camera = self.camera?;
        let depth = Depth::new(camera.depth_q8, camera.offset_q8)?;
        let principal_q8 = [camera.principal_x_q8, camera.principal_y_q8];
        RectifiedCamera::new(depth, camera.focal_q8, principal_q8)
    }

    /// Whether lines of a frame have come whose end has not.
    #[must_use]
    pub fn is_amid_frame(&self) -> bool {
        self.open.as_ref().is_some_and(Frame::has_lines)
    }

    /// Gives the frame under way, if it is this one, a line, and counts lines that it does not
    /// take.
    fn line(&mut self, number: u32, take: impl FnOnce(&mut Frame) -> bool) {
        let open = self.open.as_mut();
        let is_taken = open
            .filter(|open| open.begun.frame == number)
            .is_some_and(take);
        self.frames.stray_lines += u64::from(!is_taken);
    }

    fn ended(&mut self, frame: Frame) -> Change {
        if frame.is_whole() {
            self.frames.whole += 1;
        } else {
            self.frames.with_gaps += 1;
        }
        self.frames.is_last_aborted = false;
        Change::Ended(Box::new(frame))
    }
}

impl Introduction {
    fn new(hello: &Hello<'_>) -> Self {
        let mut fields = serde_json::to_value(hello).unwrap_or_default();
        for (_, field) in fields.as_object_mut().into_iter().flatten() {
            if let Value::String(text) = field {
                *text = text.chars().take(TEXT_CHARACTERS).collect();
            }
        }
        Self {
            fields,
            raw: hello.raw,
            matched: hello.matched,
            streams: hello.streams,
            piece_bytes_max: hello.piece_bytes_max,
        }
    }
}

impl Frame {
    fn new(begun: FrameBegun, sent_us: u64) -> Self {
        Self {
            begun,
            sent_us: [sent_us; 2],
            raw: None,
            rectified: None,
            disparities: None,
            confidences: None,
            depths: None,
            scan: None,
        }
    }

    fn has_lines(&self) -> bool {
        self.raw.is_some()
            || self.rectified.is_some()
            || self.disparities.is_some()
            || self.confidences.is_some()
            || self.depths.is_some()
            || self.scan.is_some()
    }

    /// Whether no line is missing in what has come.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        let pictures = self.raw.iter().chain(&self.rectified);
        pictures
            .flat_map(|pictures| &pictures.views)
            .all(|view| view.missing().is_empty())
            && self
                .disparities
                .as_ref()
                .is_none_or(|plane| plane.missing().is_empty())
            && self
                .confidences
                .as_ref()
                .is_none_or(|plane| plane.missing().is_empty())
            && self
                .depths
                .as_ref()
                .is_none_or(|plane| plane.missing().is_empty())
    }
}

/// The plane of a region, which is made when its first line comes; `None` where none can be.
fn made<'p, T: Copy>(
    plane: &'p mut Option<Plane<T>>,
    region: &Region,
    none: T,
) -> Option<&'p mut Plane<T>> {
    if plane.is_none() {
        let size = [region.width_px.into(), region.height_lines];
        *plane = Plane::new([region.x_px.into(), region.y_lines], size, none);
    }
    plane.as_mut()
}

fn put<T: Sample>(plane: &mut Option<Plane<T>>, region: &Region, line: &Line<'_, T>) -> bool {
    made(plane, region, T::NONE).is_some_and(|plane| {
        let count = line.values.count();
        plane.put(line.line, line.column.into(), count, |place| {
            line.values.unpack(place).is_ok()
        })
    })
}

/// The number of lines of a picture: as the board introduced them, or else those down to the end of
/// the region.
fn height_of(view: Option<View>, region: &Region) -> u32 {
    view.map_or_else(
        || region.y_lines.saturating_add(region.height_lines),
        |view| view.height_lines,
    )
}

fn put_pair(pictures: &mut Option<Pictures>, height_lines: u32, pair: &LinePair<'_>) -> bool {
    if pictures.is_none() {
        let size = [
            u32::try_from(pair.left.len()).unwrap_or(u32::MAX),
            height_lines,
        ];
        *pictures = Plane::new([0, 0], size, 0).map(|view| Pictures {
            format: pair.format,
            views: [view.clone(), view],
        });
    }
    let Some(pictures) = pictures
        .as_mut()
        .filter(|pictures| pictures.format == pair.format)
    else {
        return false;
    };
    let lines = pictures.views.iter_mut().zip([pair.left, pair.right]);
    lines.fold(true, |are_taken, (view, bytes)| {
        // A line that ends early is none.
        let is_taken = bytes.len() == view.width
            && view.put(pair.line, 0, bytes.len(), |place| {
                place.copy_from_slice(bytes);
                true
            });
        are_taken && is_taken
    })
}

/// Why a frame was aborted, in words.
#[must_use]
pub fn reason_name(reason: Reason) -> &'static str {
    match reason {
        Reason::Other => "of no known reason",
        Reason::CameraOverrun => "the camera was faster than the board",
        Reason::CameraSyncLost => "the camera lost track of its lines",
        Reason::CameraShortLine => "a line ended early",
        Reason::CameraShortFrame => "the frame ended early",
        Reason::CameraTimeout => "the camera sent nothing in time",
        Reason::CameraBus => "the camera's bus failed",
        Reason::CameraOther => "the camera failed",
        Reason::Sequence => "a line was lost",
        Reason::Rectifier => "the rectifier refused a line",
        Reason::Matcher => "the matcher refused a line",
        Reason::Sink => "the disparities were not taken",
        Reason::Stopped => "the host stopped it or changed what is sent",
    }
}

fn level_name(level: Level) -> &'static str {
    match level {
        Level::Error => "error",
        Level::Warning => "warning",
        Level::Information => "information",
        Level::Debug => "debug",
        Level::Trace => "trace",
    }
}

/// The outcome of a command, in words.
#[must_use]
pub fn outcome_name(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Done => "done",
        Outcome::Refused => "refused",
        Outcome::Unsupported => "this board cannot do it",
        Outcome::OutOfBounds => "out of bounds",
        Outcome::Calibration => "the calibration is unfit",
        Outcome::Storage => "it could not be stored",
    }
}

#[cfg(test)]
mod tests {
    use vgstereo_link::board::View;
    use vgstereo_link::{Decoder, Encoder, Values};

    use super::*;

    const REGION: Region = Region {
        x_px: 2,
        y_lines: 1,
        width_px: 4,
        height_lines: 3,
    };

    fn begun(frame: u32) -> BoardMessage<'static> {
        BoardMessage::FrameBegun(FrameBegun {
            frame,
            timestamp_us: 50,
            region: REGION,
        })
    }

    fn disparities(frame: u32, line: u32, values: &[i16]) -> BoardMessage<'_> {
        BoardMessage::Disparities(Line {
            frame,
            line,
            column: REGION.x_px,
            values: Values::Plain(values),
        })
    }

    fn hello() -> BoardMessage<'static> {
        let view = View {
            width_px: 6,
            height_lines: 4,
            format: PixelFormat::Grey8,
        };
        BoardMessage::Hello(Hello {
            device: "device",
            firmware: "1",
            raw: view,
            matched: view,
            preset: "lite",
            disparity_min_px: 0,
            disparity_count: 48,
            latency_lines: 7,
            streams: Streams::RAW.with(Streams::DISPARITIES),
            calibration_crc32: None,
            rectifies: false,
            piece_bytes_max: 0,
        })
    }

    /// The bytes of these messages, a packet each.
    fn packets(messages: &[BoardMessage<'_>]) -> Vec<Vec<u8>> {
        let mut memory = vec![0; 4096];
        let mut encoder = Encoder::new(&mut memory);
        let encode = |(at, message): (usize, &BoardMessage<'_>)| {
            encoder.encode(1000 * at as u64, message).unwrap().to_vec()
        };
        messages.iter().enumerate().map(encode).collect()
    }

    /// Gives a board these packets, and returns what has ended.
    fn take(board: &mut Board, packets: &[Vec<u8>]) -> Vec<Frame> {
        let mut memory = vec![0; 4096];
        let mut decoder = Decoder::new(&mut memory);
        let mut ended = vec![];
        for bytes in packets {
            let mut rest = &bytes[..];
            while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
                let Ok(packet) = received else { continue };
                if let Some(Change::Ended(frame)) = board.take(&packet) {
                    ended.push(*frame);
                }
            }
        }
        ended
    }

    const LINES: [[i16; 4]; 3] = [[16, 17, i16::MIN, 18], [0; 4], [-5, 700, 0, 1]];

    fn frame(number: u32) -> Vec<BoardMessage<'static>> {
        let lines = (0..).zip(&LINES);
        let lines = lines.map(|(at, values)| disparities(number, REGION.y_lines + at, values));
        let ends = [begun(number), BoardMessage::FrameDone { frame: number }];
        let [begun, done] = ends;
        [begun].into_iter().chain(lines).chain([done]).collect()
    }

    #[test]
    fn a_frame_has_the_values_that_were_sent() {
        let mut board = Board::default();
        let ended = take(&mut board, &packets(&frame(7)));
        let [frame] = &ended[..] else {
            panic!("{ended:?}")
        };
        let plane = frame.disparities.as_ref().unwrap();
        assert_eq!(plane.values, LINES.as_flattened());
        assert_eq!([plane.x, plane.y], [2, 1]);
        assert!(frame.is_whole());
        assert_eq!(frame.sent_us, [0, 4000]);
        assert_eq!((board.frames.whole, board.frames.with_gaps), (1, 0));
    }

    #[test]
    fn a_damaged_line_is_missing_and_the_next_frame_is_whole() {
        let mut board = Board::default();
        let mut sent = packets(&[frame(7), frame(8)].concat());
        sent[2][5] ^= 4;
        let ended = take(&mut board, &sent);
        let [first, second] = &ended[..] else {
            panic!("{ended:?}")
        };
        let plane = first.disparities.as_ref().unwrap();
        assert_eq!(plane.missing(), [[1, 1]]);
        assert_eq!(plane.values[4..8], [i16::MIN; 4]);
        assert!(!first.is_whole() && second.is_whole());
        assert_eq!((board.frames.whole, board.frames.with_gaps), (1, 1));
    }

    #[test]
    fn a_lost_end_ends_with_the_next_frame_and_lines_of_other_frames_are_not_taken() {
        let mut board = Board::default();
        let mut sent = packets(&[frame(7), frame(8)].concat());
        // The end of the first is lost, and so is the beginning of the second.
        sent.drain(4..6);
        assert_eq!(take(&mut board, &sent), []);
        assert_eq!(board.frames.stray_lines, 3);
        let ended = take(&mut board, &packets(&frame(9)));
        let numbers: Vec<u32> = ended.iter().map(|frame| frame.begun.frame).collect();
        assert_eq!(numbers, [7, 9]);
    }

    #[test]
    fn an_aborted_frame_is_counted_with_its_reason_and_never_shown() {
        let mut board = Board::default();
        let mut messages = frame(7);
        messages[4] = BoardMessage::FrameAborted {
            frame: 7,
            reason: Reason::CameraTimeout,
        };
        assert_eq!(take(&mut board, &packets(&messages)), []);
        let FrameCounts {
            aborted,
            abort_reason,
            is_last_aborted,
            ..
        } = board.frames;
        assert_eq!((aborted, is_last_aborted), (1, true));
        assert_eq!(abort_reason, Some("the camera sent nothing in time"));
        assert_eq!(take(&mut board, &packets(&frame(8))).len(), 1);
        assert!(!board.frames.is_last_aborted);
    }

    #[test]
    fn nothing_of_a_board_before_is_taken_for_the_next_one() {
        let mut board = Board::default();
        let camera = Camera {
            focal_q8: 300 << 8,
            principal_x_q8: 3 << 8,
            principal_y_q8: 2 << 8,
            depth_q8: (300 * 60) << 8,
            offset_q8: 0,
        };
        let unfinished = [hello(), BoardMessage::Camera(camera), begun(7)];
        take(&mut board, &packets(&unfinished));
        assert!(board.hello.is_some() && board.rectified_camera().is_some());
        board.disconnect();
        assert!(board.hello.is_none() && board.rectified_camera().is_none());
        assert_eq!(take(&mut board, &packets(&frame(7)[1..])), []);
    }

    #[test]
    fn views_have_the_size_that_the_board_stated_and_short_lines_are_missing() {
        let mut board = Board::default();
        let pair = |line, left, right| {
            BoardMessage::RawPair(LinePair {
                frame: 7,
                line,
                format: PixelFormat::Grey8,
                left,
                right,
            })
        };
        let messages = [
            hello(),
            begun(7),
            pair(0, b"abcdef", b"ghijkl"),
            pair(2, b"abc", b"ghi"),
            pair(3, b"mnopqr", b"stuvwx"),
            BoardMessage::FrameDone { frame: 7 },
        ];
        let ended = take(&mut board, &packets(&messages));
        let raw = ended[0].raw.as_ref().unwrap();
        let [left, right] = &raw.views;
        assert_eq!(left.values, b"abcdef\0\0\0\0\0\0\0\0\0\0\0\0mnopqr");
        assert_eq!(right.values[18..], *b"stuvwx");
        assert_eq!(left.missing(), [[1, 2]]);
        assert_eq!(board.frames.stray_lines, 1);
    }

    #[test]
    fn what_a_board_says_takes_bounded_memory() {
        let mut board = Board::default();
        let text = "é".repeat(1000);
        let log = BoardMessage::Log {
            level: Level::Warning,
            text: &text,
        };
        take(&mut board, &packets(&vec![log; 300]));
        assert_eq!(board.log.len(), LOG_LINES);
        assert!(
            board
                .log
                .iter()
                .all(|line| line.text.chars().count() == TEXT_CHARACTERS)
        );
        assert_eq!(board.log.back().unwrap().number, 299);
        let vast = FrameBegun {
            frame: 1,
            timestamp_us: 0,
            region: Region {
                width_px: u16::MAX,
                height_lines: u32::MAX,
                ..REGION
            },
        };
        let line = disparities(1, 1, &LINES[0]);
        take(
            &mut board,
            &packets(&[BoardMessage::FrameBegun(vast), line]),
        );
        assert_eq!(board.frames.stray_lines, 1);
    }
}
