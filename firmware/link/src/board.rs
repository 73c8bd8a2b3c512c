//! Messages from the board to the host.

use serde::{Deserialize, Serialize};

use crate::message::{
    Body, Line, Message, PixelFormat, ReadError, Region, Streams, WriteError, byte_enum, fields,
    only_fields, values,
};
use crate::pack::Values;
use crate::settings::State;

/// A message from the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoardMessage<'a> {
    /// Introduction of the board, the first message after its start: sequence numbers may begin anew with it.
    Hello(Hello<'a>),
    /// A frame begins.
    FrameBegun(FrameBegun),
    /// All lines of a frame were sent, but for those that [`LinkCounters`] has as dropped.
    FrameDone {
        /// Number of the frame.
        frame: u32,
    },
    /// The frame ends here, incomplete.
    FrameAborted {
        /// Number of the frame.
        frame: u32,
        /// Why.
        reason: Reason,
    },
    /// Disparities of the reference view, 1/16 px; `i16::MIN` for pixels without one.
    Disparities(Line<'a, i16>),
    /// Confidences: 1 to 255 for a disparity that was found, 0 for one that was filled in or is not
    /// known.
    Confidences(Line<'a, u8>),
    /// Depths, mm; 0 for pixels without one.
    Depths(Line<'a, u16>),
    /// A line of points.
    Points(PointLine<'a>),
    /// The laser scan of a frame.
    Scan(Scan<'a>),
    /// A pair of lines as the camera delivered it.
    RawPair(LinePair<'a>),
    /// A pair of rectified lines.
    RectifiedPair(LinePair<'a>),
    /// Counters of the board's session and of its end of the link.
    Statistics(Statistics),
    /// A line of a log.
    Log {
        /// How much it matters.
        level: Level,
        /// The text, without an end of line.
        text: &'a str,
    },
    /// Result of a command of the host.
    Answer {
        /// Sequence number of the host's packet.
        sequence: u32,
        /// Result of the command.
        outcome: Outcome,
    },
    /// The camera that disparities are seen with. It follows the hello if the board knows it.
    Camera(Camera),
    /// What the board sends and the parameters that it uses. It follows the hello, and the answer to
    /// each command that changed one of them.
    State(State),
}

/// Introduction of a board: its names, the lines that it takes and matches, and what it can send.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello<'a> {
    /// Name of the device.
    pub device: &'a str,
    /// Version of its firmware.
    pub firmware: &'a str,
    /// The lines that the camera delivers.
    pub raw: View,
    /// The lines that are matched.
    pub matched: View,
    /// Name of the preset; empty if there is none.
    pub preset: &'a str,
    /// Smallest disparity that is searched, px.
    pub disparity_min_px: i16,
    /// Number of disparities that are searched.
    pub disparity_count: u16,
    /// Number of lines after which that of the disparities comes.
    pub latency_lines: u32,
    /// The streams that the board can send.
    pub streams: Streams,
    /// The CRC-32 that the calibration in use ends with; `None` without one.
    pub calibration_crc32: Option<u32>,
    /// Whether the board rectifies.
    pub rectifies: bool,
    /// Largest number of bytes in a piece of [`Calibration`](crate::host::CalibrationPiece); 0 if none
    /// can be stored.
    pub piece_bytes_max: u16,
}

/// Size and format of the lines of one view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct View {
    /// Number of columns, px.
    pub width_px: u16,
    /// Number of lines of a frame.
    pub height_lines: u32,
    /// Format of the pixels.
    pub format: PixelFormat,
}

/// The beginning of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameBegun {
    /// Number of the frame, as the camera counts; wraps.
    pub frame: u32,
    /// The camera's timestamp of line 0, µs.
    pub timestamp_us: u64,
    /// The part of the reference view that has disparities.
    pub region: Region,
}

/// The camera of a rectified pair whose pixels have the disparities: a pinhole with square pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Camera {
    /// Focal length, 1/256 px.
    pub focal_q8: u32,
    /// Column of the principal point, 1/256 px.
    pub principal_x_q8: i32,
    /// Line of the principal point, 1/256 px.
    pub principal_y_q8: i32,
    /// The product of focal length and baseline, 1/256 px mm. Divided by a disparity, with the offset
    /// below added, it is the depth.
    pub depth_q8: u32,
    /// What is added to a disparity, 1/256 px: the column of the right camera's principal point less
    /// that of the left one's.
    pub offset_q8: i32,
}

byte_enum! {
    /// Why a frame was aborted.
    Reason, else Other, {
        /// Any other reason, or one that this version does not know.
        Other = 0,
        /// Pixels or lines came faster than they were taken.
        CameraOverrun = 1,
        /// The camera lost track of lines or views.
        CameraSyncLost = 2,
        /// A line ended early.
        CameraShortLine = 3,
        /// A frame ended early.
        CameraShortFrame = 4,
        /// The camera sent nothing in the time allowed.
        CameraTimeout = 5,
        /// The camera's interface or bus reported an error.
        CameraBus = 6,
        /// Any other error of the camera.
        CameraOther = 7,
        /// The camera delivered another line than the next.
        Sequence = 8,
        /// The rectifier refused a pair of lines.
        Rectifier = 9,
        /// The matcher refused a pair of lines.
        Matcher = 10,
        /// What takes the disparities failed.
        Sink = 11,
        /// The host stopped the board or changed what it sends.
        Stopped = 12,
    }
}

/// A line of points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PointLine<'a> {
    /// Number of the frame.
    pub frame: u32,
    /// Number of the line in the frame, from 0.
    pub line: u32,
    /// Column of the frame that the first point belongs to.
    pub column: u16,
    /// Six bytes a point: right and down, signed, and forward, unsigned, mm, little-endian. Forward is
    /// 0 for pixels without one.
    pub points: &'a [[u8; 6]],
}

/// A laser scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scan<'a> {
    /// Number of the frame.
    pub frame: u32,
    /// The camera's timestamp of line 0, µs.
    pub timestamp_us: u64,
    /// The first bearing, the rightmost, rad.
    pub bearing_min_rad: f32,
    /// The angle between bearings, rad.
    pub bearing_step_rad: f32,
    /// Ranges beyond this did not count, mm.
    pub range_max_mm: u16,
    /// The range at each bearing, mm, from right to left; 0 where nothing was seen.
    pub ranges_mm: Values<'a, u16>,
}

/// A pair of lines of the two views. Both have as many bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinePair<'a> {
    /// Number of the frame.
    pub frame: u32,
    /// Number of the line in the frame, from 0.
    pub line: u32,
    /// Format of the pixels.
    pub format: PixelFormat,
    /// Bytes of the left view.
    pub left: &'a [u8],
    /// Bytes of the right view.
    pub right: &'a [u8],
}

impl<'a> LinePair<'a> {
    fn write(&self, body: &mut Body<'_>) -> Result<(), WriteError> {
        if self.left.len() != self.right.len() {
            return Err(WriteError::Line);
        }
        body.fields(&(self.frame, self.line, self.format))?;
        body.bytes(self.left)?;
        body.bytes(self.right)
    }

    fn read(body: &'a [u8]) -> Result<Self, ReadError> {
        let ((frame, line, format), rest) = fields(body)?;
        if !rest.len().is_multiple_of(2) {
            return Err(ReadError::Malformed);
        }
        let halves = rest.split_at_checked(rest.len() / 2);
        let (left, right) = halves.ok_or(ReadError::Malformed)?;
        Ok(Self {
            frame,
            line,
            format,
            left,
            right,
        })
    }
}

/// Counters of a board since its start or the last reset by the host. Counters saturate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Statistics {
    /// Counters of the session.
    pub session: SessionCounters,
    /// Counters of the link.
    pub link: LinkCounters,
}

/// Counters of the session from the camera to the disparities.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SessionCounters {
    /// Frames whose disparities were taken from the first to the last.
    pub frames: u32,
    /// Frames that were dropped.
    pub frames_dropped: u32,
    /// Pairs of lines given to the matcher.
    pub lines: u32,
    /// Pairs of lines lost or left out.
    pub lines_dropped: u32,
    /// Times that another pair of lines came than the next.
    pub sequence_breaks: u32,
    /// Camera errors: overruns.
    pub overruns: u32,
    /// Camera errors: losses of synchronisation.
    pub sync_losses: u32,
    /// Camera errors: short lines.
    pub short_lines: u32,
    /// Camera errors: short frames.
    pub short_frames: u32,
    /// Camera errors: time-outs.
    pub timeouts: u32,
    /// Camera errors: interface or bus.
    pub bus_errors: u32,
    /// Camera errors of every other kind.
    pub other_errors: u32,
    /// Errors of what takes the disparities.
    pub sink_errors: u32,
}

/// Counters of the board's end of the link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkCounters {
    /// Packets sent.
    pub packets: u32,
    /// Messages that were dropped because the line to the host was full.
    pub dropped: u32,
    /// Frames that were left out because the host asked for every n-th.
    pub frames_decimated: u32,
    /// Commands carried out.
    pub commands: u32,
    /// Commands that came damaged, were unknown or were refused.
    pub commands_refused: u32,
}

byte_enum! {
    /// How much a line of a log matters.
    Level, else Trace, {
        /// An error.
        Error = 0,
        /// A warning.
        Warning = 1,
        /// Information.
        Information = 2,
        /// For whoever looks for a fault.
        Debug = 3,
        /// Everything, and levels that this version does not know.
        Trace = 4,
    }
}

byte_enum! {
    /// Result of a command of the host.
    Outcome, else Refused, {
        /// It was carried out.
        Done = 0,
        /// It was refused, or what became of it is unknown to this version.
        Refused = 1,
        /// This board cannot do it.
        Unsupported = 2,
        /// A value is out of its bounds. Nothing has changed.
        OutOfBounds = 3,
        /// The calibration is incomplete, its checksum is wrong, or it does not suit the board.
        Calibration = 4,
        /// It could not be stored.
        Storage = 5,
    }
}

impl<'a> Message<'a> for BoardMessage<'a> {
    fn kind(&self) -> u8 {
        match self {
            Self::Hello(_) => 1,
            Self::FrameBegun(_) => 2,
            Self::FrameDone { .. } => 3,
            Self::FrameAborted { .. } => 4,
            Self::Disparities(_) => 5,
            Self::Confidences(_) => 6,
            Self::Depths(_) => 7,
            Self::Points(_) => 8,
            Self::Scan(_) => 9,
            Self::RawPair(_) => 10,
            Self::RectifiedPair(_) => 11,
            Self::Statistics(_) => 12,
            Self::Log { .. } => 13,
            Self::Answer { .. } => 14,
            Self::Camera(_) => 15,
            Self::State(_) => 16,
        }
    }

    fn write(&self, body: &mut Body<'_>) -> Result<(), WriteError> {
        match self {
            Self::Hello(hello) => body.fields(hello),
            Self::FrameBegun(begun) => body.fields(begun),
            Self::FrameDone { frame } => body.fields(frame),
            Self::FrameAborted { frame, reason } => body.fields(&(frame, reason)),
            Self::Disparities(line) => line.write(body),
            Self::Confidences(line) => line.write(body),
            Self::Depths(line) => line.write(body),
            Self::Points(line) => {
                body.fields(&(line.frame, line.line, line.column))?;
                body.bytes(line.points.as_flattened())
            }
            Self::Scan(scan) => {
                body.fields(&(
                    scan.frame,
                    scan.timestamp_us,
                    scan.bearing_min_rad,
                    scan.bearing_step_rad,
                    scan.range_max_mm,
                ))?;
                body.values(&scan.ranges_mm)
            }
            Self::RawPair(pair) | Self::RectifiedPair(pair) => pair.write(body),
            Self::Statistics(statistics) => body.fields(statistics),
            Self::Log { level, text } => body.fields(&(level, text)),
            Self::Answer { sequence, outcome } => body.fields(&(sequence, outcome)),
            Self::Camera(camera) => body.fields(camera),
            Self::State(state) => body.fields(state),
        }
    }

    fn read(kind: u8, body: &'a [u8]) -> Result<Self, ReadError> {
        Ok(match kind {
            1 => Self::Hello(only_fields(body)?),
            2 => Self::FrameBegun(only_fields(body)?),
            3 => Self::FrameDone {
                frame: only_fields(body)?,
            },
            4 => {
                let (frame, reason) = only_fields(body)?;
                Self::FrameAborted { frame, reason }
            }
            5 => Self::Disparities(Line::read(body)?),
            6 => Self::Confidences(Line::read(body)?),
            7 => Self::Depths(Line::read(body)?),
            8 => {
                let ((frame, line, column), rest) = fields(body)?;
                let (points, []) = rest.as_chunks() else {
                    return Err(ReadError::Malformed);
                };
                Self::Points(PointLine {
                    frame,
                    line,
                    column,
                    points,
                })
            }
            9 => {
                let (head, rest) = fields(body)?;
                let (frame, timestamp_us, bearing_min_rad, bearing_step_rad, range_max_mm) = head;
                Self::Scan(Scan {
                    frame,
                    timestamp_us,
                    bearing_min_rad,
                    bearing_step_rad,
                    range_max_mm,
                    ranges_mm: values(rest)?,
                })
            }
            10 => Self::RawPair(LinePair::read(body)?),
            11 => Self::RectifiedPair(LinePair::read(body)?),
            12 => Self::Statistics(only_fields(body)?),
            13 => {
                let (level, text) = only_fields(body)?;
                Self::Log { level, text }
            }
            14 => {
                let (sequence, outcome) = only_fields(body)?;
                Self::Answer { sequence, outcome }
            }
            15 => Self::Camera(only_fields(body)?),
            16 => Self::State(only_fields(body)?),
            _ => return Err(ReadError::Unknown),
        })
    }
}
