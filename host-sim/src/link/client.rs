//! A connection to a board: packets from it, commands to it.

use std::time::Instant;

use vgstereo_link::{
    BoardMessage, Counters, DELIMITER, Decoder, Encoder, HostMessage, Packet, PixelFormat, Refusal,
    Streams, memory_bytes,
};

use super::recording::Damage;
use super::source::{Pace, Port, Received};

/// Memory of the decoder: for pairs of lines as wide as there are.
const DECODER_BYTES: usize = memory_bytes(u16::MAX, PixelFormat::Rgb888, Streams::RAW);
/// Memory of the encoder.
const ENCODER_BYTES: usize = memory_bytes(0, PixelFormat::Grey8, Streams::NONE);
/// Bytes that are read at once.
const READ_BYTES: usize = 1 << 16;

/// Memory that a [`Client`] works in.
#[derive(Debug)]
pub struct Memory {
    decoder: Vec<u8>,
    encoder: Vec<u8>,
}

impl Default for Memory {
    fn default() -> Self {
        Self {
            decoder: vec![0; DECODER_BYTES],
            encoder: vec![0; ENCODER_BYTES],
        }
    }
}

/// A connection to a board over an open source.
#[derive(Debug)]
pub struct Client<'m> {
    port: Port,
    decoder: Decoder<'m>,
    encoder: Encoder<'m>,
    opened: Instant,
    buffer: Vec<u8>,
    /// Bytes of the buffer that were read last, and those of them that are decoded.
    length: usize,
    decoded: usize,
}

impl<'m> Client<'m> {
    /// A client of this board. It ends whatever packet another host has left unfinished; the first
    /// command should be for a hello.
    ///
    /// # Errors
    /// Fails when the port takes no bytes.
    pub fn new(port: Port, memory: &'m mut Memory) -> std::io::Result<Self> {
        let mut client = Self {
            port,
            decoder: Decoder::joining(&mut memory.decoder),
            encoder: Encoder::new(&mut memory.encoder),
            opened: Instant::now(),
            buffer: vec![0; READ_BYTES],
            length: 0,
            decoded: 0,
        };
        client.port.write(&[DELIMITER])?;
        Ok(client)
    }

    /// Whether the board is a recording: it has an end, and takes no commands.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        self.port.is_recording
    }

    /// The time at which the bytes that were read last came, ns since 1970; `None` where it is not known.
    #[must_use]
    pub fn arrived_ns(&self) -> Option<u64> {
        self.port.arrived_ns()
    }

    /// Where a recording is no longer whole, once it was read up to there.
    #[must_use]
    pub fn damage(&self) -> Option<&Damage> {
        self.port.damage()
    }

    /// The pace of the port, if it is a recording that is played at that.
    pub fn pace(&mut self) -> Option<&mut Pace> {
        self.port.pace.as_mut()
    }

    /// Reads what has come, and waits a moment if nothing has. [`Client::next_packet`] gives its packets,
    /// which are all to be taken before this is called again.
    pub fn read(&mut self) -> Received {
        (self.length, self.decoded) = (0, 0);
        let received = self.port.read(&mut self.buffer);
        if let Received::Bytes(count) = received {
            self.length = count;
        }
        received
    }

    /// The bytes that were read last.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    /// The next packet of the bytes that were read, or why it is left out, which is counted as well.
    pub fn next_packet(&mut self) -> Option<Result<Packet<BoardMessage<'_>>, Refusal>> {
        let mut rest = &self.buffer[self.decoded..self.length];
        let received = self.decoder.next(&mut rest);
        self.decoded = self.length - rest.len();
        received
    }

    /// What the decoder has counted.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// Sets the counters to 0.
    pub fn reset_counters(&mut self) {
        self.decoder.reset_counters();
    }

    /// Sends a command and returns its sequence number; `None` where none can be sent, to a recording.
    ///
    /// # Errors
    /// Fails when the message has too many bytes, or the port does not take them in time.
    pub fn send(&mut self, message: &HostMessage<'_>) -> std::io::Result<Option<u32>> {
        if self.port.is_recording {
            return Ok(None);
        }
        let sequence = self.encoder.sequence();
        let time_us = u64::try_from(self.opened.elapsed().as_micros()).unwrap_or(u64::MAX);
        let bytes = self.encoder.encode(time_us, message);
        let bytes = bytes.map_err(std::io::Error::other)?;
        self.port.write(bytes)?;
        Ok(Some(sequence))
    }
}
