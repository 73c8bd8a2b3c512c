//! Sink over a serial port, or any other writer of bytes.
//!
//! Each call of the sink sends a [`Packet`], serialised with [postcard](https://docs.rs/postcard)
//! and encoded with COBS, so that it has no zero byte until the one that ends it. A receiver that
//! starts in the middle or misses a byte resumes after the next zero. A frame also begins with a
//! zero, because the packet before it may have been cut short.

use embedded_io::Write;
use serde::{Deserialize, Serialize};
use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::{Point, Scan};

use super::cobs::CobsPacket;
use super::{ConvertedLine, ConvertedSink, DisparitySink, FrameInfo, ScanSink};
use crate::fault::Fault;

/// A message to the receiver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Packet<'a> {
    /// A frame begins; its lines follow, from the top.
    FrameBegun {
        /// Number of the frame, as the camera counts.
        frame: u32,
        /// The camera's timestamp of line 0, µs.
        timestamp_us: u64,
        /// First column of the region, px.
        x: u16,
        /// First line of the region.
        y: u32,
        /// Number of columns.
        width: u16,
        /// Number of lines.
        height: u32,
    },
    /// One line of disparities.
    Line {
        /// Number of the frame.
        frame: u32,
        /// Number of the line in the frame, from 0.
        line: u32,
        /// Disparities, 1/16 px, each in two bytes, little-endian;
        /// [`INVALID`](vgstereo_core::disparity::INVALID) for pixels without one.
        disparities: &'a [u8],
    },
    /// The frame is complete.
    FrameDone {
        /// Number of the frame.
        frame: u32,
    },
    /// The frame ends here, incomplete.
    FrameAborted {
        /// Number of the frame.
        frame: u32,
    },
    /// One line of depths.
    Depths {
        /// Number of the frame.
        frame: u32,
        /// Number of the line in the frame, from 0.
        line: u32,
        /// Depths, mm, each in two bytes, little-endian; 0 for pixels without one.
        depths: &'a [u8],
    },
    /// One line of points.
    Points {
        /// Number of the frame.
        frame: u32,
        /// Number of the line in the frame, from 0.
        line: u32,
        /// Points: right, down and forward, mm, each in two bytes, little-endian, the first two
        /// signed; forward is 0 for pixels without one.
        points: &'a [u8],
    },
    /// The laser scan of a frame.
    Scan {
        /// Number of the frame.
        frame: u32,
        /// The camera's timestamp of line 0, µs.
        timestamp_us: u64,
        /// The first bearing, the rightmost, rad.
        bearing_min_rad: f32,
        /// The angle between bearings, rad.
        bearing_step_rad: f32,
        /// Ranges beyond this did not count, mm.
        range_max_mm: u16,
        /// Ranges, mm, each in two bytes, little-endian; 0 at bearings where nothing was seen.
        ranges: &'a [u8],
    },
}

/// Largest number of bytes that a packet takes on the wire, for lines or scans of `count` values:
/// disparities, depths or ranges of 2 bytes, or points of 6, which is `value_bytes`.
#[must_use]
pub const fn packet_bytes(count: u16, value_bytes: usize) -> usize {
    // One byte for the kind. The numbers of `FrameBegun` take at most 5, 10, 3, 5, 3 and 5 bytes;
    // those of the other kinds, with the length of what they carry, fewer.
    let bytes = 1 + 31 + value_bytes * count as usize;
    // COBS adds a byte per 254 bytes or part thereof, and the zero.
    bytes + bytes.div_ceil(254) + 1
}

/// Values are sent as they are in memory, which every target makes little-endian.
const _: () = assert!(cfg!(target_endian = "little"));

/// Error of sending a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SerialError<E> {
    /// The lent memory is smaller than [`packet_bytes`].
    Memory,
    /// The port takes no more bytes, or says that it took more than it was given.
    Closed,
    /// Error of the port.
    Port(E),
}

/// A sink of disparities, depths, points or scans that sends each call as a [`Packet`]. It waits until
/// the port has taken the bytes. Confidences are not sent.
#[derive(Debug)]
pub struct SerialSink<'m, W> {
    port: W,
    packet: &'m mut [u8],
}

impl<'m, W: Write> SerialSink<'m, W> {
    /// Creates a sink that writes to `port`. `packet` is memory for one packet, of
    /// [`packet_bytes`].
    #[must_use]
    pub fn new(port: W, packet: &'m mut [u8]) -> Self {
        Self { port, packet }
    }

    fn send(&mut self, packet: &Packet<'_>) -> Result<(), SerialError<W::Error>> {
        let memory = CobsPacket::new(self.packet);
        let bytes = postcard::serialize_with_flavor(packet, memory);
        write_all(&mut self.port, bytes.map_err(|_| SerialError::Memory)?)
    }
}

/// Writes all bytes. [`Write::write_all`] panics when the port takes none.
fn write_all<W: Write>(port: &mut W, mut bytes: &[u8]) -> Result<(), SerialError<W::Error>> {
    while !bytes.is_empty() {
        let taken = port.write(bytes).map_err(SerialError::Port)?;
        let rest = bytes.get(taken..).filter(|_| taken > 0);
        bytes = rest.ok_or(SerialError::Closed)?;
    }
    Ok(())
}

impl<W: Write> SerialSink<'_, W> {
    fn begin(&mut self, info: &FrameInfo) -> Result<(), SerialError<W::Error>> {
        write_all(&mut self.port, &[0])?;
        self.send(&Packet::FrameBegun {
            frame: info.frame,
            timestamp_us: info.timestamp_us,
            x: info.region.x,
            y: info.region.y,
            width: info.region.width,
            height: info.region.height,
        })
    }

    fn end(&mut self, info: &FrameInfo) -> Result<(), SerialError<W::Error>> {
        self.send(&Packet::FrameDone { frame: info.frame })
    }

    fn abort(&mut self, frame: u32) {
        // If sending fails, the receiver sees a frame without an end.
        let _ = self.send(&Packet::FrameAborted { frame });
    }
}

/// Implements the calls of a sink of lines but for `line`, which the body has.
macro_rules! sends_frames {
    ($sink:ty, $($line:tt)*) => {
        impl<W: Write> $sink for SerialSink<'_, W> {
            type Error = SerialError<W::Error>;

            fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
                self.begin(info)
            }

            $($line)*

            fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
                self.end(info)
            }

            fn abort_frame(&mut self, frame: u32, _: Fault) {
                self.abort(frame);
            }
        }
    };
}

sends_frames! { DisparitySink,
    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        self.send(&Packet::Line {
            frame,
            line: line.line,
            disparities: bytemuck::cast_slice(line.disparities_q4),
        })
    }
}

sends_frames! { ConvertedSink<u16>,
    fn line(&mut self, frame: u32, line: &ConvertedLine<'_, u16>) -> Result<(), Self::Error> {
        self.send(&Packet::Depths {
            frame,
            line: line.line,
            depths: bytemuck::cast_slice(line.values),
        })
    }
}

sends_frames! { ConvertedSink<Point>,
    fn line(&mut self, frame: u32, line: &ConvertedLine<'_, Point>) -> Result<(), Self::Error> {
        self.send(&Packet::Points {
            frame,
            line: line.line,
            points: bytemuck::cast_slice(line.values),
        })
    }
}

impl<W: Write> ScanSink for SerialSink<'_, W> {
    type Error = SerialError<W::Error>;

    fn scan(&mut self, info: &FrameInfo, scan: &Scan<'_>) -> Result<(), Self::Error> {
        write_all(&mut self.port, &[0])?;
        self.send(&Packet::Scan {
            frame: info.frame,
            timestamp_us: info.timestamp_us,
            bearing_min_rad: scan.bearing_min_rad,
            bearing_step_rad: scan.bearing_step_rad,
            range_max_mm: scan.range_max_mm,
            ranges: bytemuck::cast_slice(scan.ranges_mm),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;
    use vgstereo_core::{INVALID, Region};

    const INFO: FrameInfo = FrameInfo {
        frame: u32::MAX,
        timestamp_us: u64::MAX,
        region: Region {
            x: u16::MAX,
            y: u32::MAX,
            width: 300,
            height: u32::MAX,
        },
    };

    fn line(disparities_q4: &[i16]) -> DisparityLine<'_> {
        DisparityLine {
            line: u32::MAX,
            column: 0,
            disparities_q4,
            confidences: &[],
        }
    }

    /// Returns the bytes sent for a frame of one line, followed by an abort of that frame.
    fn sent(packet: &mut [u8], disparities_q4: &[i16]) -> Vec<u8> {
        let mut sink = SerialSink::new(Vec::new(), packet);
        DisparitySink::begin_frame(&mut sink, &INFO).unwrap();
        DisparitySink::line(&mut sink, INFO.frame, &line(disparities_q4)).unwrap();
        DisparitySink::end_frame(&mut sink, &INFO).unwrap();
        DisparitySink::abort_frame(&mut sink, INFO.frame, Fault::Sequence);
        sink.port
    }

    #[test]
    fn a_listener_gets_what_the_sink_was_given() {
        let disparities_q4: Vec<i16> = (0..300).map(|x| x * 109 - 16384).collect();
        let disparities: Vec<u8> = disparities_q4
            .iter()
            .flat_map(|d| d.to_le_bytes())
            .collect();
        let mut bytes = sent(&mut vec![0; packet_bytes(300, 2)], &disparities_q4);
        let packets = bytes.split_mut(|&byte| byte == 0);
        let mut packets = packets.filter(|packet| !packet.is_empty());
        let mut next = || postcard::from_bytes_cobs(packets.next().unwrap()).unwrap();
        let frame = INFO.frame;
        let begun: Packet<'_> = next();
        assert!(matches!(
            begun,
            Packet::FrameBegun {
                frame: u32::MAX,
                width: 300,
                ..
            }
        ));
        let line = Packet::Line {
            frame,
            line: u32::MAX,
            disparities: &disparities,
        };
        assert_eq!(next(), line);
        assert_eq!(next(), Packet::FrameDone { frame });
        assert_eq!(next(), Packet::FrameAborted { frame });
        assert!(packets.next().is_none());
    }

    /// The packet that `send` makes, without the zeros.
    fn packet_of(send: impl FnOnce(&mut SerialSink<'_, Vec<u8>>)) -> Vec<u8> {
        let mut packet = vec![0; packet_bytes(3, size_of::<Point>())];
        let mut sink = SerialSink::new(Vec::new(), &mut packet);
        send(&mut sink);
        sink.port
            .into_iter()
            .skip_while(|&byte| byte == 0)
            .collect()
    }

    #[test]
    fn depths_points_and_scans_are_sent_little_endian() {
        let mut bytes = packet_of(|sink| {
            let line = ConvertedLine {
                line: 4,
                column: 0,
                values: &[0x0102_u16, 0, 65_535],
                confidences: &[],
            };
            ConvertedSink::line(sink, 9, &line).unwrap();
        });
        let depths = Packet::Depths {
            frame: 9,
            line: 4,
            depths: &[2, 1, 0, 0, 255, 255],
        };
        assert_eq!(postcard::from_bytes_cobs(&mut bytes), Ok(depths));

        let mut bytes = packet_of(|sink| {
            let point = Point {
                x_mm: -2,
                y_mm: 3,
                z_mm: 0x0400,
            };
            let line = ConvertedLine {
                line: 5,
                column: 0,
                values: &[point, Point::NONE, point],
                confidences: &[],
            };
            ConvertedSink::line(sink, 9, &line).unwrap();
        });
        let point = [0xfe, 0xff, 3, 0, 0, 4];
        let points = Packet::Points {
            frame: 9,
            line: 5,
            points: &[point, [0; 6], point].concat(),
        };
        assert_eq!(postcard::from_bytes_cobs(&mut bytes), Ok(points));

        let mut bytes = packet_of(|sink| {
            let scan = Scan {
                ranges_mm: &[0x0102, 0],
                bearing_min_rad: -0.5,
                bearing_step_rad: 0.25,
                range_max_mm: 9,
            };
            sink.scan(&INFO, &scan).unwrap();
        });
        let scan = Packet::Scan {
            frame: u32::MAX,
            timestamp_us: u64::MAX,
            bearing_min_rad: -0.5,
            bearing_step_rad: 0.25,
            range_max_mm: 9,
            ranges: &[2, 1, 0, 0],
        };
        assert_eq!(postcard::from_bytes_cobs(&mut bytes), Ok(scan));
    }

    #[test]
    fn the_longest_packets_fit_and_no_others_are_cut() {
        for width in [1, 100, 126, 127, 300] {
            let disparities_q4 = vec![INVALID; usize::from(width)];
            let bytes = sent(&mut vec![0; packet_bytes(width, 2)], &disparities_q4);
            let longest = bytes.split(|&byte| byte == 0).map(<[u8]>::len).max();
            assert!(longest < Some(packet_bytes(width, 2)), "{width}");
        }
        let mut memory = [0; 100];
        let mut sink = SerialSink::new(Vec::new(), &mut memory);
        let too_long = DisparitySink::line(&mut sink, 0, &line(&[0; 50]));
        assert!(matches!(too_long, Err(SerialError::Memory)));
        assert!(sink.port.is_empty());
    }

    /// A port that takes so many bytes at a time.
    struct Port(Vec<u8>, usize);

    impl embedded_io::ErrorType for Port {
        type Error = core::convert::Infallible;
    }

    impl Write for Port {
        fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
            self.0.extend(bytes.iter().take(self.1));
            Ok(self.1)
        }

        fn flush(&mut self) -> Result<(), Self::Error> {
            Ok(())
        }
    }

    #[test]
    fn a_port_may_take_some_bytes_but_not_none_or_too_many() {
        let sent = |at_a_time| {
            let mut port = Port(Vec::new(), at_a_time);
            (write_all(&mut port, b"six by").is_ok(), port.0)
        };
        for at_a_time in [1, 2, 3, 6] {
            assert_eq!(sent(at_a_time), (true, b"six by".to_vec()));
        }
        assert!(!sent(0).0);
        assert!(!sent(7).0);
    }

    #[test]
    fn after_a_packet_that_was_cut_the_next_frame_is_read() {
        let mut bytes = sent(&mut vec![0; packet_bytes(4, 2)], &[1, 2, 3, 4]);
        bytes.truncate(bytes.len() - 3);
        bytes.extend(sent(&mut vec![0; packet_bytes(4, 2)], &[5, 6, 7, 8]));
        let begun = bytes
            .split_mut(|&byte| byte == 0)
            .filter(|packet| !packet.is_empty())
            .filter_map(|packet| postcard::from_bytes_cobs(packet).ok())
            .filter(|packet| matches!(packet, Packet::FrameBegun { .. }))
            .count();
        assert_eq!(begun, 2);
    }
}
