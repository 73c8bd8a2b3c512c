//! From messages to bytes.

use core::cell::Cell;
use core::fmt;

use crate::message::{Body, Message, PixelFormat, Streams, WriteError};
use crate::pack::packed_bytes_max;
use crate::packet::{CHECKSUM_BYTES, DELIMITER, VERSION, checksum, framing_bytes, packet_bytes};

/// Longest run of bytes that are not zero behind one code.
const RUN_BYTES_MAX: usize = 254;

/// Largest number of bytes of the fields of a line, a pair of lines or a scan before its values.
const LINE_FIELDS_BYTES: usize = 32;

/// Room for the messages that are no lines: with [`memory_bytes`], texts of a hello together, or that
/// of a log, may have up to 256 bytes, and so may a piece of a calibration.
const OTHER_BODY_BYTES: usize = 256 + 64;

/// Memory of an encoder or a decoder for lines of up to `width_px` columns, in `format` where pairs of
/// lines are sent, of the given streams; scans have at most as many bearings.
#[must_use]
pub const fn memory_bytes(width_px: u16, format: PixelFormat, streams: Streams) -> usize {
    let width = width_px as usize;
    let pair = 2 * format.line_bytes(width_px);
    let sizes = [
        (Streams::RAW, pair),
        (Streams::RECTIFIED, pair),
        (Streams::DISPARITIES, packed_bytes_max(width, 2)),
        (Streams::CONFIDENCES, packed_bytes_max(width, 1)),
        (Streams::DEPTHS, packed_bytes_max(width, 2)),
        (Streams::POINTS, 6 * width),
        (Streams::SCANS, packed_bytes_max(width, 2)),
    ];
    let mut body = OTHER_BODY_BYTES;
    let mut at = 0;
    while at < sizes.len() {
        let (stream, bytes) = sizes[at];
        let bytes = LINE_FIELDS_BYTES + bytes;
        if streams.contains(stream) && bytes > body {
            body = bytes;
        }
        at += 1;
    }
    packet_bytes(body)
}

/// Why a message was not encoded. Nothing of it is to be sent, and its sequence number goes to the
/// next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EncodeError {
    /// The lent memory is too small for the message: see [`memory_bytes`].
    Memory,
    /// A line has more than 65535 values, or the bytes of two views are not of one length.
    Line,
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Memory => "the memory of the encoder is too small for the message",
            Self::Line => "a line has too many values, or the lines of two views differ in length",
        })
    }
}

impl core::error::Error for EncodeError {}

impl From<WriteError> for EncodeError {
    fn from(error: WriteError) -> Self {
        match error {
            WriteError::Memory => Self::Memory,
            WriteError::Line => Self::Line,
        }
    }
}

/// Makes packets of messages, in lent memory. The first byte that is sent at all should be a
/// [`DELIMITER`], which ends what a receiver may have of before.
#[derive(Debug)]
pub struct Encoder<'m> {
    memory: &'m mut [u8],
    /// Bytes of the packet that was made last.
    length: usize,
    sequence: u32,
}

impl<'m> Encoder<'m> {
    /// An encoder whose first packet has the sequence number 0. `memory` is for one packet: see
    /// [`memory_bytes`], or [`packet_bytes`] for a body of a known length.
    #[must_use]
    pub fn new(memory: &'m mut [u8]) -> Self {
        Self {
            memory,
            length: 0,
            sequence: 0,
        }
    }

    /// The sequence number of the next packet.
    #[must_use]
    pub fn sequence(&self) -> u32 {
        self.sequence
    }

    /// The bytes of the packet that was made last, with the delimiter at their end; none before the first,
    /// or after a message that was not encoded.
    #[must_use]
    pub fn packet(&self) -> &[u8] {
        self.memory.get(..self.length).unwrap_or_default()
    }

    /// Returns the bytes to send for `message`, with the delimiter at their end. `timestamp_us` is the
    /// time of sending, µs, from any origin.
    ///
    /// # Errors
    /// [`EncodeError`] when the message does not fit the lent memory or is not one.
    pub fn encode<'a, M: Message<'a>>(
        &mut self,
        timestamp_us: u64,
        message: &M,
    ) -> Result<&[u8], EncodeError> {
        self.length = 0;
        // The packet is written behind the room that framing may need, and framed to the front.
        let start = framing_bytes(self.memory.len());
        let plain = self.memory.get_mut(start..).ok_or(EncodeError::Memory)?;
        let mut body = Body::new(plain);
        body.fields(&(VERSION, message.kind(), self.sequence, timestamp_us))?;
        message.write(&mut body)?;
        let length = body.length();
        let (packet, rest) = plain
            .split_at_mut_checked(length)
            .ok_or(EncodeError::Memory)?;
        let place = rest.first_chunk_mut::<CHECKSUM_BYTES>();
        *place.ok_or(EncodeError::Memory)? = checksum(packet).to_le_bytes();
        let end = start + length + CHECKSUM_BYTES;
        let framed = frame(self.memory, start, end).ok_or(EncodeError::Memory)?;
        self.sequence = self.sequence.wrapping_add(1);
        self.length = framed;
        Ok(self.packet())
    }
}

/// Frames the bytes from `start` to `end` to the front of the memory, and returns the number of bytes
/// with the delimiter. What is written stays behind what is read if `start` is at least
/// [`framing_bytes`].
///
/// The encoder of the crate `cobs` takes 25 instructions a byte, half of what a line takes in all.
fn frame(memory: &mut [u8], start: usize, end: usize) -> Option<usize> {
    let cells = Cell::from_mut(memory).as_slice_of_cells();
    let (mut from, mut to) = (start, 0);
    loop {
        let (code, place) = cells.get(to..)?.split_first()?;
        let rest = cells.get(from..end)?;
        let rest = rest.get(..RUN_BYTES_MAX).unwrap_or(rest);
        let place = place.get(..rest.len())?;
        let mut run = rest.len();
        let mut ends_with_zero = false;
        for (at, (byte, place)) in rest.iter().zip(place).enumerate() {
            let byte = byte.get();
            if byte == 0 {
                run = at;
                ends_with_zero = true;
                break;
            }
            place.set(byte);
        }
        code.set(run as u8 + 1);
        to += 1 + run;
        from += run + usize::from(ends_with_zero);
        // Behind a zero at the end stands an empty run.
        if from == end && !ends_with_zero {
            break;
        }
    }
    cells.get(to)?.set(DELIMITER);
    Some(to + 1)
}
