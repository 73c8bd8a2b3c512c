//! Reads the packets that a board sends over the link: its frames, and the lines of its log.

use std::io::{ErrorKind, Read};

use anyhow::{Context, Result, bail};
use vgstereo_link::{BoardMessage, Decoder, Region};

/// Bytes of the largest packet that a board sends.
const PACKET_BYTES_MAX: usize = 4096;
/// Bytes that are taken at once.
const CHUNK_BYTES: usize = 4096;

/// A frame of which the board has sent the begin.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SentFrame {
    /// The board's number of the frame.
    pub number: u32,
    /// The disparities that came, 1/16 px, little-endian.
    pub disparities: Vec<u8>,
    /// The confidences that came.
    pub confidences: Vec<u8>,
    /// Number of its pixels that have disparities.
    pub pixels: usize,
    /// Whether the board said that the frame is done, and all lines of it have come.
    pub is_whole: bool,
}

/// What a board has sent.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Received {
    /// The frames of which it has sent the begin.
    pub frames: Vec<SentFrame>,
    /// The lines of its log.
    pub log: Vec<String>,
}

impl Received {
    /// Takes these bytes apart. A packet that their end has cut off does not count.
    ///
    /// # Errors
    /// Fails with one line when what the board sent is damaged.
    pub fn of(bytes: &[u8]) -> Result<Self> {
        Self::until(bytes, |_| false)
    }

    /// Takes apart what a board sends, until this is enough, or it sends no more.
    ///
    /// # Errors
    /// Fails with one line when what the board sent is damaged, or cannot be read.
    pub fn until(mut board: impl Read, is_enough: impl Fn(&Self) -> bool) -> Result<Self> {
        let mut received = Self::default();
        let mut memory = vec![0; PACKET_BYTES_MAX];
        let mut decoder = Decoder::new(&mut memory);
        let mut chunk = vec![0; CHUNK_BYTES];
        while !is_enough(&received) {
            let count = match board.read(&mut chunk) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(error).context("what the board sends cannot be read"),
            };
            let mut rest = chunk.get(..count).unwrap_or_default();
            while let Some(packet) = decoder.next::<BoardMessage<'_>>(&mut rest) {
                let packet = packet.context("the board sent what is no packet")?;
                received.take(packet.message)?;
            }
        }
        Ok(received)
    }

    fn take(&mut self, message: BoardMessage<'_>) -> Result<()> {
        match (message, self.frames.last_mut()) {
            (BoardMessage::FrameBegun(begun), _) => {
                let Region {
                    width_px,
                    height_lines,
                    ..
                } = begun.region;
                self.frames.push(SentFrame {
                    number: begun.frame,
                    pixels: usize::from(width_px) * height_lines as usize,
                    ..SentFrame::default()
                });
            }
            (BoardMessage::Disparities(line), Some(frame)) => {
                let mut values_q4 = vec![0; line.values.count()];
                line.values.unpack(&mut values_q4)?;
                let bytes = values_q4.iter().flat_map(|q4| q4.to_le_bytes());
                frame.disparities.extend(bytes);
            }
            (BoardMessage::Confidences(line), Some(frame)) => {
                let start = frame.confidences.len();
                frame.confidences.resize(start + line.values.count(), 0);
                let place = frame.confidences.get_mut(start..).unwrap_or_default();
                line.values.unpack(place)?;
            }
            (BoardMessage::FrameDone { .. }, Some(frame)) => {
                frame.is_whole = frame.disparities.len() == 2 * frame.pixels;
            }
            (BoardMessage::Disparities(_) | BoardMessage::FrameDone { .. }, None) => {
                bail!("the board sent a line before a frame")
            }
            (BoardMessage::Log { text, .. }, _) => self.log.push(text.to_owned()),
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_link::board::FrameBegun;
    use vgstereo_link::{Encoder, Line, Reason, Values};

    #[test]
    fn frames_are_taken_apart() {
        let begun = |frame| {
            BoardMessage::FrameBegun(FrameBegun {
                frame,
                timestamp_us: 5,
                region: Region {
                    x_px: 0,
                    y_lines: 0,
                    width_px: 2,
                    height_lines: 1,
                },
            })
        };
        let aborted = BoardMessage::FrameAborted {
            frame: 3,
            reason: Reason::Other,
        };
        let line = BoardMessage::Disparities(Line {
            frame: 4,
            line: 0,
            column: 0,
            values: Values::Plain(&[1, 0x200]),
        });
        let done = BoardMessage::FrameDone { frame: 4 };
        let mut memory = [0; 512];
        let mut encoder = Encoder::new(&mut memory);
        let mut bytes = vec![0];
        for message in [begun(3), aborted, begun(4), line, done] {
            bytes.extend_from_slice(encoder.encode(0, &message).unwrap());
        }
        let mut expected = vec![
            SentFrame {
                number: 3,
                pixels: 2,
                ..SentFrame::default()
            },
            SentFrame {
                number: 4,
                pixels: 2,
                disparities: vec![1, 0, 0, 2],
                is_whole: true,
                ..SentFrame::default()
            },
        ];
        assert_eq!(Received::of(&bytes).unwrap().frames, expected);
        // The run ends amid the last packet.
        bytes.truncate(bytes.len() - 1);
        expected[1].is_whole = false;
        assert_eq!(Received::of(&bytes).unwrap().frames, expected);
        assert!(Received::of(&[3, 7, 0]).is_err());
    }
}
