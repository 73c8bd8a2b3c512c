//! Messages from the host to the board.

use crate::message::{Body, Message, ReadError, WriteError, fields, only_fields};
use crate::settings::{Parameters, Selection, Source};

/// A command to the board, which it answers with
/// [`BoardMessage::Answer`](crate::BoardMessage::Answer).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostMessage<'a> {
    /// Send frames from the next on.
    Start,
    /// Send no more frames.
    Stop,
    /// Send this from the next frame on.
    Select(Selection),
    /// A piece of a calibration. The first has the offset 0, and each begins where the one before
    /// ended.
    CalibrationPiece(CalibrationPiece<'a>),
    /// Check and store the calibration whose pieces have come; it is used from the next start on.
    CalibrationCommit {
        /// Bytes of the calibration.
        total_bytes: u32,
        /// As of its pieces.
        crc32: u32,
    },
    /// Forget the pieces that have come.
    CalibrationDiscard,
    /// Use these parameters from the next frame on.
    Parameters(Parameters),
    /// Set all counters to 0.
    ResetCounters,
    /// Send a hello. The first command of a host, with which its sequence numbers may begin anew.
    SendHello,
    /// Take lines from this source from the next frame on.
    Source(Source),
}

/// A piece of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CalibrationPiece<'a> {
    /// Bytes of the whole calibration.
    pub total_bytes: u32,
    /// The CRC-32 that the whole calibration ends with, of all bytes before it.
    pub crc32: u32,
    /// Place of the piece in it.
    pub offset_bytes: u32,
    /// The bytes of the piece.
    pub bytes: &'a [u8],
}

impl HostMessage<'_> {
    /// The command without the lifetime of bytes that only a piece of a calibration borrows: `None` for
    /// that.
    #[must_use]
    pub fn detached(self) -> Option<HostMessage<'static>> {
        Some(match self {
            Self::Start => HostMessage::Start,
            Self::Stop => HostMessage::Stop,
            Self::Select(selection) => HostMessage::Select(selection),
            Self::CalibrationPiece(_) => return None,
            Self::CalibrationCommit { total_bytes, crc32 } => {
                HostMessage::CalibrationCommit { total_bytes, crc32 }
            }
            Self::CalibrationDiscard => HostMessage::CalibrationDiscard,
            Self::Parameters(parameters) => HostMessage::Parameters(parameters),
            Self::ResetCounters => HostMessage::ResetCounters,
            Self::SendHello => HostMessage::SendHello,
            Self::Source(source) => HostMessage::Source(source),
        })
    }
}

impl<'a> Message<'a> for HostMessage<'a> {
    fn kind(&self) -> u8 {
        match self {
            Self::Start => 65,
            Self::Stop => 66,
            Self::Select(_) => 67,
            Self::CalibrationPiece(_) => 68,
            Self::CalibrationCommit { .. } => 69,
            Self::CalibrationDiscard => 70,
            Self::Parameters(_) => 71,
            Self::ResetCounters => 72,
            Self::SendHello => 73,
            Self::Source(_) => 74,
        }
    }

    fn write(&self, body: &mut Body<'_>) -> Result<(), WriteError> {
        match self {
            Self::Start
            | Self::Stop
            | Self::CalibrationDiscard
            | Self::ResetCounters
            | Self::SendHello => Ok(()),
            Self::Select(selection) => body.fields(selection),
            Self::CalibrationPiece(piece) => {
                body.fields(&(piece.total_bytes, piece.crc32, piece.offset_bytes))?;
                body.bytes(piece.bytes)
            }
            Self::CalibrationCommit { total_bytes, crc32 } => body.fields(&(total_bytes, crc32)),
            Self::Parameters(parameters) => body.fields(parameters),
            Self::Source(source) => body.fields(source),
        }
    }

    fn read(kind: u8, body: &'a [u8]) -> Result<Self, ReadError> {
        Ok(match kind {
            65 => only_fields(body).map(|()| Self::Start)?,
            66 => only_fields(body).map(|()| Self::Stop)?,
            67 => Self::Select(only_fields(body)?),
            68 => {
                let ((total_bytes, crc32, offset_bytes), bytes) = fields(body)?;
                Self::CalibrationPiece(CalibrationPiece {
                    total_bytes,
                    crc32,
                    offset_bytes,
                    bytes,
                })
            }
            69 => {
                let (total_bytes, crc32) = only_fields(body)?;
                Self::CalibrationCommit { total_bytes, crc32 }
            }
            70 => only_fields(body).map(|()| Self::CalibrationDiscard)?,
            71 => Self::Parameters(only_fields(body)?),
            72 => only_fields(body).map(|()| Self::ResetCounters)?,
            73 => only_fields(body).map(|()| Self::SendHello)?,
            74 => Self::Source(only_fields(body)?),
            _ => return Err(ReadError::Unknown),
        })
    }
}
