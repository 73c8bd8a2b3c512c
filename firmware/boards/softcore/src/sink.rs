//! The sink of a run: lines of disparities and confidences as packets of the link.

use core::cell::RefCell;
use core::convert::Infallible;
use core::fmt::{self, Write};

use vgstereo_core::DisparityLine;
use vgstereo_emulated::meter::{Meter, Stage};
use vgstereo_emulated::serial::Uart;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo};
use vgstereo_link::board::{FrameBegun, Level};
use vgstereo_link::{
    BoardMessage, DELIMITER, Encoder, Line, PixelFormat, Region, Streams, Values, memory_bytes,
};

use crate::clock::{Cycles, now_us};
use crate::news::{Log, News};
use crate::uart::SerialPort;

/// Columns of the longest line.
const WIDTH_MAX: u16 = 160;

/// Bytes of the largest packet.
pub(crate) const PACKET_BYTES: usize = memory_bytes(
    WIDTH_MAX,
    PixelFormat::Grey8,
    Streams::DISPARITIES.with(Streams::CONFIDENCES),
);

/// Sends whole lines, and waits for the port: nothing is left out. It is lent to all that has something to send.
pub(crate) struct Sender<'m> {
    link: RefCell<(SerialPort, Encoder<'m>)>,
    meter: &'m Meter<Cycles>,
}

impl<'m> Sender<'m> {
    pub(crate) fn new(
        mut port: SerialPort,
        memory: &'m mut [u8],
        meter: &'m Meter<Cycles>,
    ) -> Self {
        // What a host may have received before is no part of the first packet.
        put(&mut port, DELIMITER);
        Self {
            link: RefCell::new((port, Encoder::new(memory))),
            meter,
        }
    }

    #[inline(never)]
    fn send(&self, message: &BoardMessage<'_>) {
        // Nothing sends while something is sent.
        let Ok(mut link) = self.link.try_borrow_mut() else {
            return;
        };
        let (port, encoder) = &mut *link;
        let meter = self.meter;
        let packet = meter.measure(Stage::Link, || encoder.encode(now_us(), message));
        // Lines that a port delivers fit the memory.
        let Ok(packet) = packet else { return };
        meter.measure(Stage::Files, || {
            packet.iter().for_each(|&byte| put(port, byte));
        });
    }

    /// Sends a text, each line of it by itself.
    pub(crate) fn text(&self) -> impl Write {
        Text {
            sender: self,
            line: [0; 64],
            length: 0,
        }
    }
}

impl Log for Sender<'_> {
    fn tell(&self, news: News) {
        // The line is long enough for each.
        let _ = writeln!(self.text(), "{news}");
    }
}

/// Sends a byte, and waits for room. The port has no way to stop.
fn put(port: &mut impl Uart, byte: u8) {
    while !port.put(byte) {}
}

/// A text on its way, line by line.
struct Text<'s, 'm> {
    sender: &'s Sender<'m>,
    line: [u8; 64],
    length: usize,
}

impl Write for Text<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            if byte != b'\n' {
                *self.line.get_mut(self.length).ok_or(fmt::Error)? = byte;
                self.length += 1;
                continue;
            }
            let line = self.line.get(..self.length).ok_or(fmt::Error)?;
            let text = core::str::from_utf8(line).map_err(|_| fmt::Error)?;
            self.sender.send(&BoardMessage::Log {
                level: Level::Information,
                text,
            });
            self.length = 0;
        }
        Ok(())
    }
}

impl DisparitySink for &Sender<'_> {
    type Error = Infallible;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Infallible> {
        let region = info.region;
        self.send(&BoardMessage::FrameBegun(FrameBegun {
            frame: info.frame,
            timestamp_us: info.timestamp_us,
            region: Region {
                x_px: region.x,
                y_lines: region.y,
                width_px: region.width,
                height_lines: region.height,
            },
        }));
        Ok(())
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Infallible> {
        self.send(&BoardMessage::Disparities(Line {
            frame,
            line: line.line,
            column: line.column,
            values: Values::Plain(line.disparities_q4),
        }));
        self.send(&BoardMessage::Confidences(Line {
            frame,
            line: line.line,
            column: line.column,
            values: Values::Plain(line.confidences),
        }));
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Infallible> {
        let frame = info.frame;
        self.send(&BoardMessage::FrameDone { frame });
        Ok(())
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        let reason = fault.into();
        self.send(&BoardMessage::FrameAborted { frame, reason });
    }
}
