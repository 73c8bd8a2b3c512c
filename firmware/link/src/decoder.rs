//! From bytes to messages.

use core::{fmt, mem};

use cobs::{DecodeResult, DecoderState};
use serde::Serialize;

use crate::message::{self, Message, ReadError};
use crate::packet::{CHECKSUM_BYTES, VERSION, checksum};

/// A packet that is at most so many numbers behind was repeated or overtaken; one that is further
/// behind tells that its sender has started again.
pub const REORDERED_MAX: u32 = 64;

/// Kinds of the board's hello and of the host's request for one, which end the numbers of before: they
/// are what each end says first.
const FIRST_KINDS: [u8; 2] = [1, 73];

/// A message with what the packet says about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Packet<M> {
    /// Sequence number of the packet.
    pub sequence: u32,
    /// Time at which it was sent, µs, by the sender's clock.
    pub timestamp_us: u64,
    /// The message.
    pub message: M,
}

/// Why a packet was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// It was damaged or cut: its framing, its checksum or its content is wrong.
    Broken,
    /// It is longer than the decoder's memory.
    TooLong,
    /// Its version or its kind is not known here.
    Unknown,
    /// It was repeated, or has come after a later one.
    Stale,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Broken => "a packet was damaged",
            Self::TooLong => "a packet was longer than the memory of the decoder",
            Self::Unknown => "a packet was of a version or a kind that is not known",
            Self::Stale => "a packet was repeated or came after a later one",
        })
    }
}

impl core::error::Error for Refusal {}

/// What a decoder has counted. Counters saturate. Each packet that has ended counts in one of the
/// first five.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Messages delivered.
    pub messages: u32,
    /// Packets refused as [`Refusal::Broken`]. When one is, its number is also missing, and counts as
    /// lost with the next packet that is whole.
    pub broken: u32,
    /// Packets refused as [`Refusal::TooLong`].
    pub too_long: u32,
    /// Packets refused as [`Refusal::Unknown`].
    pub unknown: u32,
    /// Packets refused as [`Refusal::Stale`].
    pub stale: u32,
    /// Sequence numbers that were missing when a later one came.
    pub lost: u32,
    /// Times that the sender has started again. What was lost then is not known.
    pub restarts: u32,
}

/// Makes messages of bytes, in lent memory.
#[derive(Debug)]
pub struct Decoder<'m> {
    memory: &'m mut [u8],
    framing: DecoderState,
    /// Bytes of the packet under way, those that do not fit the memory included.
    length: usize,
    /// The sequence number that is to come; `None` before the first packet.
    next_sequence: Option<u32>,
    /// Whether the packet that ends next may have begun before the decoder.
    is_joining: bool,
    counters: Counters,
}

/// Version, kind, sequence number and time of a whole packet, which every version has, and the place
/// of its body.
struct Head {
    version: u8,
    kind: u8,
    sequence: u32,
    timestamp_us: u64,
    body: core::ops::Range<usize>,
}

impl<'m> Decoder<'m> {
    /// A decoder that expects a packet. `memory` is for one packet, as of
    /// [`Encoder::new`](crate::Encoder::new).
    #[must_use]
    pub fn new(memory: &'m mut [u8]) -> Self {
        Self {
            memory,
            framing: DecoderState::Idle,
            length: 0,
            next_sequence: None,
            is_joining: false,
            counters: Counters::default(),
        }
    }

    /// A decoder for a sender that is under way, otherwise as [`Decoder::new`]: bytes before the first
    /// end of a packet that are not a whole packet are left out, and count as nothing.
    #[must_use]
    pub fn joining(memory: &'m mut [u8]) -> Self {
        Self {
            is_joining: true,
            ..Self::new(memory)
        }
    }

    /// What was counted since the decoder was made, or [`Decoder::reset_counters`].
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Sets all counters to 0.
    pub fn reset_counters(&mut self) {
        self.counters = Counters::default();
    }

    /// Takes bytes from the front of `input` until a packet ends, and returns its message or why it
    /// is left out; `None` when all bytes are taken and no packet has ended. What follows a packet
    /// stays in `input`: call again until `None` comes, then with the bytes received next.
    ///
    /// `M` is the kind of messages that come: [`BoardMessage`](crate::BoardMessage) at the host,
    /// [`HostMessage`](crate::HostMessage) at the board.
    pub fn next<'d, M: Message<'d>>(
        &'d mut self,
        input: &mut &[u8],
    ) -> Option<Result<Packet<M>, Refusal>> {
        let head = loop {
            let whole = self.take_packet(input)?;
            let head = whole.and_then(|length| self.head(length));
            let may_be_cut = mem::take(&mut self.is_joining);
            if !may_be_cut || !matches!(head, Err(Refusal::Broken)) {
                break head;
            }
        };
        let received = head
            .and_then(|head| self.track(&head).map(|()| head))
            .and_then(|head| {
                if head.version != VERSION {
                    return Err(Refusal::Unknown);
                }
                let body = self.memory.get(head.body).unwrap_or_default();
                let message = M::read(head.kind, body).map_err(|error| match error {
                    ReadError::Unknown => Refusal::Unknown,
                    ReadError::Malformed => Refusal::Broken,
                })?;
                Ok(Packet {
                    sequence: head.sequence,
                    timestamp_us: head.timestamp_us,
                    message,
                })
            });
        let counters = &mut self.counters;
        let counter = match &received {
            Ok(_) => &mut counters.messages,
            Err(Refusal::Broken) => &mut counters.broken,
            Err(Refusal::TooLong) => &mut counters.too_long,
            Err(Refusal::Unknown) => &mut counters.unknown,
            Err(Refusal::Stale) => &mut counters.stale,
        };
        *counter = counter.saturating_add(1);
        Some(received)
    }

    /// Takes bytes until a packet ends, and returns its length without framing.
    fn take_packet(&mut self, input: &mut &[u8]) -> Option<Result<usize, Refusal>> {
        while let Some((&byte, rest)) = input.split_first() {
            *input = rest;
            let ended = match self.framing.feed(byte) {
                Ok(DecodeResult::NoData | DecodeResult::DataStart) => continue,
                Ok(DecodeResult::DataContinue(byte)) => {
                    if let Some(place) = self.memory.get_mut(self.length) {
                        *place = byte;
                    }
                    self.length = self.length.saturating_add(1);
                    continue;
                }
                Ok(DecodeResult::DataComplete) => Ok(self.length),
                Err(_) => Err(Refusal::Broken),
            };
            let is_too_long = self.length > self.memory.len();
            self.length = 0;
            return Some(if is_too_long {
                Err(Refusal::TooLong)
            } else {
                ended
            });
        }
        None
    }

    /// Checks the packet of this length at the front of the memory, and reads what surrounds its
    /// body.
    fn head(&self, length: usize) -> Result<Head, Refusal> {
        let packet = self.memory.get(..length).ok_or(Refusal::TooLong)?;
        let parts = packet.split_last_chunk::<CHECKSUM_BYTES>();
        let (content, stored) = parts.ok_or(Refusal::Broken)?;
        if checksum(content) != u32::from_le_bytes(*stored) {
            return Err(Refusal::Broken);
        }
        let [version, kind, rest @ ..] = content else {
            return Err(Refusal::Broken);
        };
        let head = message::fields::<(u32, u64)>(rest).map_err(|_| Refusal::Broken)?;
        let ((sequence, timestamp_us), body) = head;
        Ok(Head {
            version: *version,
            kind: *kind,
            sequence,
            timestamp_us,
            body: content.len() - body.len()..content.len(),
        })
    }

    /// Follows the sequence numbers.
    fn track(&mut self, head: &Head) -> Result<(), Refusal> {
        if let Some(next) = self.next_sequence {
            let ahead = head.sequence.wrapping_sub(next);
            let behind = next.wrapping_sub(head.sequence);
            let is_first = FIRST_KINDS.contains(&head.kind) && head.sequence == 0;
            let counters = &mut self.counters;
            if ahead <= u32::MAX / 2 {
                counters.lost = counters.lost.saturating_add(ahead);
            } else if behind > REORDERED_MAX || is_first {
                counters.restarts = counters.restarts.saturating_add(1);
            } else {
                return Err(Refusal::Stale);
            }
        }
        self.next_sequence = Some(head.sequence.wrapping_add(1));
        Ok(())
    }
}
