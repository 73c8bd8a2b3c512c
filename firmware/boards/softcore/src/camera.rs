//! The camera trait over the two camera ports (`rtl/dvp_pair.sv`).

use vgstereo_firmware::camera::{ErrorKind, ErrorType, Geometry, LinePair, LinePairSource};

use crate::clock::{CLOCK_MHZ, now_us, span_us};
use crate::news::Log;
use crate::registers::{
    CAMERA_CONTROL, CAMERA_CYCLES, CAMERA_ENDED, CAMERA_LEVEL, CAMERA_LIMIT, CAMERA_PIXELS,
    CAMERA_PLACE, CAMERA_ROOM, CAMERA_STATUS, LineBytes,
};
use crate::sensors::Sensors;

// Bits of the status.
const READY: u32 = 1 << 0;
const OVERRUN: u32 = 1 << 1;
const WITHOUT_PARTNER: u32 = 1 << 2;
const SKEWED: u32 = 1 << 3;
// Of the control.
const RELEASE: u32 = 1 << 0;
const RESTART: u32 = 1 << 1;

/// The longest wait for a pair, µs: about the time of three frames.
const LONGEST_WAIT_US: u32 = 100_000;

/// Cycles in which a sensor sends a pixel at the least: two bytes, at half the system's clock. Lines that belong together
/// end within half a line.
const LEAST_PIXEL_CYCLES: u32 = 4;

/// Place of a pair among all that the sensors have sent.
#[derive(Clone, Copy)]
struct Place {
    frame: u32,
    line: u32,
}

impl Place {
    /// Number of pairs between this place and a later one, in frames of `height` lines; saturates.
    fn pairs_until(self, later: Self, height: u32) -> u32 {
        if later.frame == self.frame {
            return later.line.saturating_sub(self.line).saturating_sub(1);
        }
        let missed = later.frame.wrapping_sub(self.frame).saturating_sub(1);
        let rest = height.saturating_sub(self.line).saturating_sub(1);
        let missed_lines = missed.saturating_mul(height);
        missed_lines.saturating_add(rest).saturating_add(later.line)
    }
}

/// Time at which the oldest pair's left line ended, µs.
fn ended_us() -> u64 {
    let ago = CAMERA_CYCLES.read().wrapping_sub(CAMERA_ENDED.read());
    now_us().saturating_sub((ago / CLOCK_MHZ).into())
}

/// Two sensors in step, whose lines are not rectified. Pairs wait in the port's ring, in whose room a
/// whole frame may be: a line that finds none there is lost, with the rest of its frame. A frame is
/// taken if all of it finds room when it begins, or, if it is larger than the ring, when that is empty; one that
/// is not counts as lost for want of room. An error of the sensors' step costs what waits as well.
///
/// Sensors that are not set up are, before a pair is read: at the start, and when no pair came or the step was lost, and
/// they do not say that they still are.
pub(crate) struct Dvp<'l> {
    sensors: Sensors<'l>,
    geometry: Geometry,
    /// The number of the frame that came last; the port's has 16 bits.
    frame: u32,
    /// Whether what is wrong with the oldest pair, or with those before it, was told already.
    is_told: bool,
    /// The pair that came last, whole or not; none after a restart.
    last: Option<Place>,
    /// The pair that was delivered last.
    delivered: Option<Place>,
}

impl<'l> Dvp<'l> {
    /// The ports, for lines of grey pixels. None if the lines are longer than the port's, or no window of the sensors
    /// has this size.
    pub(crate) fn start(geometry: Geometry, log: &'l dyn Log) -> Option<Self> {
        let room = CAMERA_ROOM.read();
        let (lines, line_bytes) = (room >> 16, room & 0xffff);
        if geometry.line_bytes() > line_bytes as usize || !geometry.format.is_grey() {
            return None;
        }
        CAMERA_LEVEL.write(lines.saturating_sub(geometry.height));
        CAMERA_LIMIT.write(u32::from(geometry.width) / 2 * LEAST_PIXEL_CYCLES);
        Some(Self {
            sensors: Sensors::new(&geometry, log)?,
            geometry,
            frame: u32::MAX,
            is_told: false,
            last: None,
            delivered: None,
        })
    }

    /// Waits for a pair, or for what the port has to tell, and returns its status; `None` if the wait that has begun at
    /// this time ends without.
    fn wait(&self, begun_us: u32) -> Option<u32> {
        while span_us().wrapping_sub(begun_us) <= LONGEST_WAIT_US {
            let status = CAMERA_STATUS.read();
            if status & (READY | WITHOUT_PARTNER) != 0 {
                return Some(status);
            }
        }
        None
    }

    /// Begins anew after an error that may come of a sensor that is not set up any more.
    fn lost(&mut self, kind: ErrorKind) -> ErrorKind {
        self.restart();
        self.sensors.check();
        kind
    }

    /// Forgets all lines, and waits for a frame that both sensors begin at one time.
    fn restart(&mut self) {
        CAMERA_CONTROL.write(RESTART);
        self.is_told = false;
        self.last = None;
    }

    /// The place of the oldest pair.
    fn place(&mut self) -> Place {
        let place = CAMERA_PLACE.read();
        let ahead = (place >> 16).wrapping_sub(self.frame) & 0xffff;
        self.frame = self.frame.wrapping_add(ahead);
        Place {
            frame: self.frame,
            line: place & 0xffff,
        }
    }

    /// Why a pair that has come is of no use, if there is a reason that was not told.
    fn fault(&mut self, status: u32, place: Place) -> Option<ErrorKind> {
        if self.is_told {
            return None;
        }
        if status & OVERRUN != 0 {
            return Some(ErrorKind::Overrun);
        }
        let last = self.last?;
        let was_short = place.frame != last.frame && last.line + 1 < self.geometry.height;
        was_short.then_some(ErrorKind::ShortFrame)
    }
}

impl ErrorType for Dvp<'_> {
    type Error = ErrorKind;
}

impl LinePairSource for Dvp<'_> {
    fn geometry(&self) -> Geometry {
        self.geometry
    }

    // Not inlined, so that what is measured is the same in every session.
    #[inline(never)]
    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let Geometry { width, height, .. } = self.geometry;
        if left.len() != usize::from(width) || right.len() != usize::from(width) {
            return Err(ErrorKind::Other);
        }
        if self.sensors.make_ready()? {
            self.restart();
        }
        let begun_us = span_us();
        loop {
            let Some(status) = self.wait(begun_us) else {
                return Err(self.lost(ErrorKind::Timeout));
            };
            if status & WITHOUT_PARTNER != 0 {
                return Err(self.lost(ErrorKind::SyncLost));
            }
            let place = self.place();
            if let Some(kind) = self.fault(status, place) {
                self.is_told = true;
                return Err(kind);
            }
            if place.line >= height {
                // No line, or those of a frame of which neither sensor has told the beginning: the first is told, and
                // none is of use.
                CAMERA_CONTROL.write(RELEASE);
                self.last = Some(place);
                self.is_told = false;
                if place.line == height {
                    return Err(ErrorKind::SyncLost);
                }
                continue;
            }
            let pixels = CAMERA_PIXELS.read();
            let (left_pixels, right_pixels) = (pixels & 0xffff, pixels >> 16);
            let width = u32::from(width);
            let is_short = left_pixels < width || right_pixels < width;
            let is_long = left_pixels > width || right_pixels > width;
            if is_long || (status & SKEWED != 0 && !is_short) {
                // Two lines in one, or lines that do not belong together: from here on the numbers
                // are wrong. Of a short line the end says nothing.
                return Err(self.lost(ErrorKind::SyncLost));
            }
            self.last = Some(place);
            self.is_told = false;
            if is_short {
                CAMERA_CONTROL.write(RELEASE);
                return Err(ErrorKind::ShortLine);
            }
            LineBytes::Left.copy(left);
            LineBytes::Right.copy(right);
            let timestamp_us = ended_us();
            CAMERA_CONTROL.write(RELEASE);
            let last = self.delivered.replace(place);
            return Ok(LinePair {
                frame: place.frame,
                line: place.line,
                timestamp_us,
                dropped: last.map_or(0, |last| last.pairs_until(place, height)),
            });
        }
    }
}
