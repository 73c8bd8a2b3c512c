//! The link between a stereo camera and its host: messages, packed lines, framing.
//!
//! A board has an [`Encoder`] of [`BoardMessage`]s and a [`Decoder`] of [`HostMessage`]s; a host has
//! the reverse. Both work in lent memory, allocate nothing, and take any bytes: what is damaged is
//! counted and left out. The bytes are described in `docs/link.md`.
//!
//! ```
//! use vgstereo_link::{BoardMessage, Decoder, Encoder, Line, PixelFormat, Streams, Values};
//!
//! const MEMORY_BYTES: usize =
//!     vgstereo_link::memory_bytes(4, PixelFormat::Grey8, Streams::DISPARITIES);
//!
//! // The board sends a line of disparities in 1/16 px.
//! let mut memory = [0; MEMORY_BYTES];
//! let mut encoder = Encoder::new(&mut memory);
//! let values = Values::Plain(&[160, 163, i16::MIN, 161]);
//! let line = Line { frame: 7, line: 0, column: 0, values };
//! let bytes = encoder.encode(1_000, &BoardMessage::Disparities(line))?;
//!
//! // The host has received these bytes.
//! let mut memory = [0; MEMORY_BYTES];
//! let mut decoder = Decoder::new(&mut memory);
//! let mut rest = bytes;
//! while let Some(received) = decoder.next::<BoardMessage>(&mut rest) {
//!     let Ok(packet) = received else { continue };
//!     if let BoardMessage::Disparities(line) = packet.message {
//!         let mut disparities_q4 = [0; 4];
//!         line.values.unpack(&mut disparities_q4)?;
//!         assert_eq!(disparities_q4, [160, 163, i16::MIN, 161]);
//!     }
//! }
//! assert_eq!(decoder.counters().messages, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod assembler;
pub mod board;
pub mod decoder;
pub mod encoder;
pub mod host;
pub mod message;
pub mod pack;
pub mod packet;
pub mod settings;

pub use assembler::FrameAssembler;
pub use board::{BoardMessage, Reason};
pub use decoder::{Counters, Decoder, Packet, Refusal};
pub use encoder::{EncodeError, Encoder, memory_bytes};
pub use host::HostMessage;
pub use message::{Line, Message, PixelFormat, Region, Streams};
pub use pack::{Malformed, Packed, Sample, Values};
pub use packet::{DELIMITER, VERSION};
pub use settings::{Parameters, Selection, Source, State};
