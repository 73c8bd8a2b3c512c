//! Rectifications: where each pixel of two rectified views lies in the raw ones.

use core::fmt;
use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc};

use super::camera::RectifiedCamera;
use super::depth::Depth;
use crate::disparity::Reference;
use crate::kernel::{Interpolation, cell_positions, sixteenth_shift};

/// The first bytes of a rectification.
const MAGIC: [u8; 4] = *b"VGRF";
/// The version of the format that this program reads.
const VERSION: u16 = 1;
/// Bytes before the maps.
const HEADER_BYTES: usize = 40;
/// Bytes of the checksum at the end.
const CHECKSUM_BYTES: usize = 4;
/// Largest width and height of raw and rectified views, px.
const SIDE_MAX_PX: u16 = 4096;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The bytes do not hold a rectification that can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RectificationError {
    /// They do not begin as a rectification does.
    Format,
    /// They are of a version that this program does not read.
    Version(u16),
    /// Their number is not that of a rectification of these sizes.
    Length,
    /// They were changed: the checksum differs.
    Checksum,
    /// A width, a height or a step between knots is out of its range.
    Size,
    /// It asks for an interpolation that this program does not have.
    Interpolation,
    /// Numbers of the cameras are out of their range.
    Camera,
    /// Columns of a line that are stated to be valid lie outside the line.
    Interval,
    /// A stated number of lines to keep is not what the maps need.
    Lines,
}

impl fmt::Display for RectificationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Format => f.write_str("this is not a rectification"),
            Self::Version(version) => write!(
                f,
                "the rectification is of version {version}, and version {VERSION} is read here"
            ),
            Self::Length => f.write_str("the rectification has too few or too many bytes"),
            Self::Checksum => f.write_str("the rectification is damaged: its checksum differs"),
            Self::Size => write!(
                f,
                "the rectification has a size that is not from 1 to {SIDE_MAX_PX} px, or a step \
                 between knots that is not 4 to 64 px"
            ),
            Self::Interpolation => {
                f.write_str("the rectification asks for an unknown interpolation")
            }
            Self::Camera => f.write_str("the rectification has no usable focal length"),
            Self::Interval => f.write_str("the rectification states columns outside a line"),
            Self::Lines => f.write_str("the rectification states other lines than its maps need"),
        }
    }
}

impl core::error::Error for RectificationError {}

/// Where each pixel of a left and a right rectified view lies in the raw view of its camera.
///
/// It is made by a program on a host and read here from bytes, in flash or elsewhere, which stay
/// borrowed. All numbers are little-endian:
///
/// | offset | bytes | content |
/// |---:|---:|---|
/// | 0 | 4 | `VGRF` |
/// | 4 | 2 | version, 1 |
/// | 6 | 1 | binary logarithm of the pixels between knots, 2 to 6 |
/// | 7 | 1 | [interpolation](Interpolation): 0 bilinear, 1 cubic |
/// | 8 | 4 | width and height of the raw views, px |
/// | 12 | 4 | width and height of the rectified views, px |
/// | 16 | 4 | lines to keep of the left and of the right raw view |
/// | 20 | 4 | `256 f B`, with the rectified focal length in px and the baseline in mm; 0 if that is not known |
/// | 24 | 4 | 256 times the column of the right principal point less the left one's, px, signed |
/// | 28 | 12 | 256 times the focal length and the left principal point, column and line, px; signed |
/// | 40 | | the left view's map, then the right one's: its knots, row-major, then its intervals |
/// | | 4 | CRC-32 of all that comes before |
///
/// There are `ceil(width / step) + 1` by `ceil(height / step) + 1` knots, at every `step`-th pixel
/// of the rectified view and beyond its last. A knot is the displacement from the rectified to the
/// raw pixel, columns and lines, two signed numbers of 16 bits in 1/64 px; between knots it is
/// interpolated bilinearly. An interval is the first column of a line that the camera saw and the
/// first after it that it did not, two numbers of 16 bits.
#[derive(Debug, Clone, Copy)]
pub struct Rectification<'a> {
    /// Width of the raw views, px.
    pub raw_width: u16,
    /// Height of the raw views, px.
    pub raw_height: u16,
    /// Width of the rectified views, px.
    pub width: u16,
    /// Height of the rectified views, px.
    pub height: u16,
    /// The map of the left view.
    pub left: ViewMap<'a>,
    /// The map of the right view.
    pub right: ViewMap<'a>,
    /// Depth from the disparities of the rectified left view; `None` if the baseline is not known.
    pub depth: Option<Depth>,
    /// How levels between raw pixels are made.
    pub interpolation: Interpolation,
    /// Focal length of the rectified cameras, 1/256 px.
    pub focal_q8: u32,
    /// Principal point of the left rectified camera: column and line, 1/256 px.
    pub principal_q8: [i32; 2],
    bytes: &'a [u8],
}

/// Where each pixel of a rectified view lies in the raw view.
#[derive(Debug, Clone, Copy)]
pub struct ViewMap<'a> {
    knots: &'a [u8],
    intervals: &'a [u8],
    /// Number of knots in a row.
    columns: usize,
    step_shift: u32,
    interpolation: Interpolation,
    /// Number of raw lines that have to be kept.
    pub(super) kept_lines: u16,
}

impl<'a> Rectification<'a> {
    /// Reads a rectification.
    ///
    /// # Errors
    /// [`RectificationError`] when the bytes do not hold one, are damaged, or contradict each other.
    pub const fn from_bytes(bytes: &'a [u8]) -> Result<Self, RectificationError> {
        let read = match Self::with_stated_lines(bytes) {
            Ok(read) => read,
            Err(error) => return Err(error),
        };
        let [left, right] = read.needed_lines();
        if left != read.left.kept_lines || right != read.right.kept_lines {
            return Err(RectificationError::Lines);
        }
        Ok(read)
    }

    /// Reads the rectification that `bytes` begin with, whatever follows: for a part of a device's flash that
    /// is larger.
    ///
    /// # Errors
    /// As [`Rectification::from_bytes`].
    pub const fn from_prefix(bytes: &'a [u8]) -> Result<Self, RectificationError> {
        let Some(header) = bytes.first_chunk::<HEADER_BYTES>() else {
            return Err(RectificationError::Format);
        };
        if u32_at(header, 0) != u32::from_le_bytes(MAGIC) {
            return Err(RectificationError::Format);
        }
        let step_shift = (u16_at(header, 6) & 0xff) as u32;
        let (width, height) = (u16_at(header, 12), u16_at(header, 14));
        let Some(content) = content_bytes(width, height, step_shift) else {
            return Err(RectificationError::Size);
        };
        match bytes.split_at_checked(content + CHECKSUM_BYTES) {
            Some((rectification, _)) => Self::from_bytes(rectification),
            None => Err(RectificationError::Length),
        }
    }

    /// Number of lines that have to be kept of each raw view, for the program that writes the bytes:
    /// as [`Rectification::needed_lines`], whatever numbers the bytes state.
    ///
    /// # Errors
    /// As [`Rectification::from_bytes`], but for those numbers.
    #[doc(hidden)]
    pub const fn needed_lines_of(bytes: &'a [u8]) -> Result<[u16; 2], RectificationError> {
        match Self::with_stated_lines(bytes) {
            Ok(read) => Ok(read.needed_lines()),
            Err(error) => Err(error),
        }
    }

    /// Reads all but that it believes the stated numbers of lines to keep.
    const fn with_stated_lines(bytes: &'a [u8]) -> Result<Self, RectificationError> {
        let Some((content, stated)) = bytes.split_last_chunk::<CHECKSUM_BYTES>() else {
            return Err(RectificationError::Format);
        };
        let Some(header) = content.first_chunk::<HEADER_BYTES>() else {
            return Err(RectificationError::Format);
        };
        if u32_at(header, 0) != u32::from_le_bytes(MAGIC) {
            return Err(RectificationError::Format);
        }
        let version = u16_at(header, 4);
        if version != VERSION {
            return Err(RectificationError::Version(version));
        }
        if CHECKSUM.checksum(content) != u32::from_le_bytes(*stated) {
            return Err(RectificationError::Checksum);
        }
        let step_shift = (u16_at(header, 6) & 0xff) as u32;
        let (raw_width, raw_height) = (u16_at(header, 8), u16_at(header, 10));
        let (width, height) = (u16_at(header, 12), u16_at(header, 14));
        let content_bytes = content_bytes(width, height, step_shift);
        let (Some(content_bytes), true, true) =
            (content_bytes, is_side(raw_width), is_side(raw_height))
        else {
            return Err(RectificationError::Size);
        };
        let interpolation = match u16_at(header, 6) >> 8 {
            0 => Interpolation::Bilinear,
            1 => Interpolation::Cubic,
            _ => return Err(RectificationError::Interpolation),
        };
        let step = 1 << step_shift;
        let columns = (width as usize).div_ceil(step) + 1;
        let rows = (height as usize).div_ceil(step) + 1;
        let knot_bytes = 4 * columns * rows;
        let interval_bytes = 4 * height as usize;
        if content.len() != content_bytes {
            return Err(RectificationError::Length);
        }
        let (_, maps) = content.split_at(HEADER_BYTES);
        // Not `split_at`, which panics where the compiler does not see that the lengths suit.
        let Some((left, right)) = maps.split_at_checked(knot_bytes + interval_bytes) else {
            return Err(RectificationError::Length);
        };
        let (Some((left, left_intervals)), Some((right, right_intervals))) = (
            left.split_at_checked(knot_bytes),
            right.split_at_checked(knot_bytes),
        ) else {
            return Err(RectificationError::Length);
        };
        let left = ViewMap {
            knots: left,
            intervals: left_intervals,
            columns,
            step_shift,
            interpolation,
            kept_lines: u16_at(header, 16),
        };
        let right = ViewMap {
            knots: right,
            intervals: right_intervals,
            kept_lines: u16_at(header, 18),
            ..left
        };
        if !left.has_intervals_within(width) || !right.has_intervals_within(width) {
            return Err(RectificationError::Interval);
        }
        let numerator_q8 = u32_at(header, 20);
        let offset_q8 = u32_at(header, 24).cast_signed();
        let depth = Depth::new(numerator_q8, offset_q8);
        let focal_q8 = u32_at(header, 28);
        if (numerator_q8 > 0 && depth.is_none()) || focal_q8 == 0 || focal_q8 > i32::MAX as u32 {
            return Err(RectificationError::Camera);
        }
        Ok(Self {
            raw_width,
            raw_height,
            width,
            height,
            left,
            right,
            depth,
            interpolation,
            focal_q8,
            principal_q8: [
                u32_at(header, 32).cast_signed(),
                u32_at(header, 36).cast_signed(),
            ],
            bytes,
        })
    }

    /// The CRC-32 that ends its bytes, of all before it: what tells it from others. That of all bytes is
    /// the same for each.
    #[must_use]
    pub const fn crc32(&self) -> u32 {
        match self.bytes.last_chunk::<CHECKSUM_BYTES>() {
            Some(stated) => u32::from_le_bytes(*stated),
            // It was read, so that there are bytes.
            None => 0,
        }
    }

    /// The bytes that it was read from, all of which belong to it.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Number of lines that have to be kept of each raw view, so that no line of the rectified views
    /// needs one that is gone: the largest, over all of them, of
    /// `ready(y) - lowest(y) + 1`. A rectified pair `y` is ready when the last raw line has come that it
    /// or a pair above it needs from either camera, and `lowest(y)` is the first raw line that it or
    /// a pair below it needs. Both cameras deliver a line of the same number together.
    #[must_use]
    pub const fn needed_lines(&self) -> [u16; 2] {
        let mut ready = 0;
        let mut needed = [1, 1];
        let mut y = 0;
        while y < self.height {
            let spans = [
                self.left.raw_lines(y, self.raw_height),
                self.right.raw_lines(y, self.raw_height),
            ];
            let [left, right] = spans;
            if let Some((_, last)) = left
                && last > ready
            {
                ready = last;
            }
            if let Some((_, last)) = right
                && last > ready
            {
                ready = last;
            }
            if let Some((first, _)) = left
                && ready - first + 1 > needed[0]
            {
                needed[0] = ready - first + 1;
            }
            if let Some((first, _)) = right
                && ready - first + 1 > needed[1]
            {
                needed[1] = ready - first + 1;
            }
            y += 1;
        }
        needed
    }

    /// The camera of a rectified view, for points and scans; `None` if the baseline is not known or a
    /// number is out of its range.
    #[must_use]
    pub const fn camera(&self, reference: Reference) -> Option<RectifiedCamera> {
        let Some(depth) = self.depth else {
            return None;
        };
        let [column_q8, line_q8] = self.principal_q8;
        let column_q8 = match reference {
            Reference::Left => column_q8,
            Reference::Right => column_q8.saturating_add(depth.offset_q8()),
        };
        RectifiedCamera::new(depth, self.focal_q8, [column_q8, line_q8])
    }

    /// Number of raw lines, from the top, with which the rectified pair `y` is complete.
    pub(super) fn lines_until(&self, y: u16) -> u16 {
        let last = |map: &ViewMap<'_>| {
            map.raw_lines(y, self.raw_height)
                .map_or(0, |(_, last)| last)
        };
        last(&self.left).max(last(&self.right)) + 1
    }
}

impl<'a> ViewMap<'a> {
    /// Number of raw lines that have to be kept.
    #[must_use]
    pub const fn kept_lines(&self) -> u16 {
        self.kept_lines
    }

    /// Number of knots in a row of the map.
    #[must_use]
    pub const fn knots_per_row(&self) -> usize {
        self.columns
    }

    /// Binary logarithm of the pixels between knots.
    #[must_use]
    pub const fn step_shift(&self) -> u32 {
        self.step_shift
    }

    /// How levels between raw pixels are made.
    #[must_use]
    pub const fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// The columns of line `y` of the rectified view that the camera saw; empty if there are none.
    #[must_use]
    pub const fn valid_columns(&self, y: u16) -> Range<u16> {
        let at = 4 * y as usize;
        u16_at(self.intervals, at)..u16_at(self.intervals, at + 2)
    }

    /// The position of knot `column` of line `y`, column and line in the raw view, in the unit of
    /// [`ResampleRow::knots`](crate::kernel::ResampleRow::knots).
    #[must_use]
    pub const fn knot(&self, column: usize, y: u16) -> [i32; 2] {
        let (shift, step) = (self.step_shift, 1 << self.step_shift);
        let row = y as usize >> shift;
        let below = y as i32 & (step - 1);
        let at = 4 * (row * self.columns + column);
        let next = at + 4 * self.columns;
        let dx = i16_at(self.knots, at) * (step - below) + i16_at(self.knots, next) * below;
        let dy = i16_at(self.knots, at + 2) * (step - below) + i16_at(self.knots, next + 2) * below;
        let unit = 64 << shift;
        [((column as i32) << shift) * unit + dx, y as i32 * unit + dy]
    }

    /// The first and the last raw line that the valid columns of line `y` are interpolated from;
    /// `None` if no column is valid. Lines outside the raw view are replaced by the nearest inside.
    #[must_use]
    pub const fn raw_lines(&self, y: u16, raw_height: u16) -> Option<(u16, u16)> {
        let Range { start, end } = self.valid_columns(y);
        if start >= end {
            return None;
        }
        let (shift, last_column) = (self.step_shift, end as usize - 1);
        let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
        let mut x = start as usize;
        // Between knots the line rises or falls evenly: its extremes are at the first and the last
        // pixel of each step.
        while x <= last_column {
            let cell = x >> shift;
            let cell_end = ((cell + 1) << shift) - 1;
            let cell_last = if cell_end < last_column {
                cell_end
            } else {
                last_column
            };
            let knots = [self.knot(cell, y), self.knot(cell + 1, y)];
            let [_, (first_position, step)] = cell_positions(&knots, shift);
            let place = (1 << shift) - 1;
            let bits = sixteenth_shift(shift) + 4;
            let from = (first_position + step * (x & place) as i32) >> bits;
            let to = (first_position + step * (cell_last & place) as i32) >> bits;
            let (low, high) = if from < to { (from, to) } else { (to, from) };
            if low < lowest {
                lowest = low;
            }
            if high > highest {
                highest = high;
            }
            x = cell_last + 1;
        }
        let last_line = raw_height as i32 - 1;
        // Levels are mixed with those of lines above and below.
        let (above, below) = self.interpolation.reach();
        Some((
            clamped(lowest - above, last_line),
            clamped(highest + below, last_line),
        ))
    }

    const fn has_intervals_within(&self, width: u16) -> bool {
        let mut at = 0;
        while at < self.intervals.len() {
            let (start, end) = (u16_at(self.intervals, at), u16_at(self.intervals, at + 2));
            if start > end || end > width {
                return false;
            }
            at += 4;
        }
        true
    }
}

/// Bytes of a rectification before its checksum, for views of this size, px, and this binary logarithm of
/// the pixels between knots; `None` if one of them is out of its range.
const fn content_bytes(width: u16, height: u16, step_shift: u32) -> Option<usize> {
    if !is_side(width) || !is_side(height) || step_shift < 2 || step_shift > 6 {
        return None;
    }
    let (width, height) = (width as usize, height as usize);
    let knots = (width.div_ceil(1 << step_shift) + 1) * (height.div_ceil(1 << step_shift) + 1);
    Some(HEADER_BYTES + 2 * 4 * (knots + height))
}

const fn is_side(px: u16) -> bool {
    px > 0 && px <= SIDE_MAX_PX
}

/// A line clamped to those of a view, the last of which is `last`.
const fn clamped(line: i32, last: i32) -> u16 {
    let line = if line < 0 {
        0
    } else if line > last {
        last
    } else {
        line
    };
    // Views have at most `SIDE_MAX_PX` lines.
    line as u16
}

/// The little-endian number at an offset; 0 beyond the bytes.
const fn u16_at(bytes: &[u8], offset: usize) -> u16 {
    match bytes.split_at_checked(offset) {
        Some((_, rest)) => match rest.first_chunk() {
            Some(bytes) => u16::from_le_bytes(*bytes),
            None => 0,
        },
        None => 0,
    }
}

/// [`u16_at`] with a sign.
const fn i16_at(bytes: &[u8], offset: usize) -> i32 {
    u16_at(bytes, offset).cast_signed() as i32
}

/// [`u16_at`] for four bytes.
const fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    u16_at(bytes, offset) as u32 | (u16_at(bytes, offset + 2) as u32) << 16
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::vec::Vec;

    /// A rectification as a program on a host would store it.
    #[derive(Debug, Clone)]
    pub(in crate::geometry) struct Stored {
        pub(in crate::geometry) step_shift: u8,
        pub(in crate::geometry) interpolation: Interpolation,
        pub(in crate::geometry) raw: [u16; 2],
        pub(in crate::geometry) size: [u16; 2],
        pub(in crate::geometry) kept_lines: [u16; 2],
        pub(in crate::geometry) numbers: [i32; 5],
        pub(in crate::geometry) maps: [StoredMap; 2],
    }

    /// Knots of a view, column and line, 1/64 px, and its intervals.
    type StoredMap = (Vec<[i16; 2]>, Vec<[u16; 2]>);

    impl Stored {
        /// Cameras that are turned against each other: `displacement` gives where a rectified
        /// pixel of a view, 0 or 1, lies from there, px. All pixels are valid that lie in the raw view.
        pub(in crate::geometry) fn new(
            step_shift: u8,
            raw: [u16; 2],
            size: [u16; 2],
            displacement: impl Fn(usize, f64, f64) -> [f64; 2],
        ) -> Self {
            let step = 1 << step_shift;
            let knots_along = |px: u16| usize::from(px).div_ceil(step) + 1;
            let map = |view: usize| {
                let columns = knots_along(size[0]);
                let places = (0..columns * knots_along(size[1]))
                    .map(|knot| (knot % columns * step, knot / columns * step));
                let knots = places
                    .map(|(x, y)| {
                        displacement(view, x as f64, y as f64).map(|px| (px * 64.0).round() as i16)
                    })
                    .collect();
                let intervals = (0..size[1])
                    .map(|y| {
                        let is_inside = |x: &u16| {
                            let [dx, dy] = displacement(view, f64::from(*x), f64::from(y));
                            let at = [f64::from(*x) + dx, f64::from(y) + dy];
                            let inside =
                                |at: f64, side: u16| at >= 0.0 && at <= f64::from(side - 1);
                            inside(at[0], raw[0]) && inside(at[1], raw[1])
                        };
                        let first = (0..size[0]).find(is_inside).unwrap_or(0);
                        let end = (first..size[0]).find(|x| !is_inside(x)).unwrap_or(size[0]);
                        [first, end]
                    })
                    .collect();
                (knots, intervals)
            };
            let mut stored = Self {
                step_shift,
                interpolation: Interpolation::Bilinear,
                raw,
                size,
                kept_lines: [1, 1],
                numbers: [256 * 300 * 60, -512, 300 << 8, 31 << 8, -7],
                maps: [map(0), map(1)],
            };
            stored.kept_lines = stored.needed_lines();
            stored
        }

        /// Lines to keep, from the raw lines that each rectified line reads.
        pub(in crate::geometry) fn needed_lines(&self) -> [u16; 2] {
            let mut other = self.clone();
            other.kept_lines = [u16::MAX; 2];
            // Whatever is stated, the maps can be read.
            let bytes = other.bytes();
            let columns = usize::from(self.size[0]).div_ceil(1 << self.step_shift) + 1;
            let map_bytes = |view: usize| 4 * (self.maps[view].0.len() + self.maps[view].1.len());
            let maps: Vec<ViewMap<'_>> = [0, 1]
                .map(|view| {
                    let at = HEADER_BYTES + view * map_bytes(0);
                    let map = &bytes[at..at + map_bytes(view)];
                    let (knots, intervals) = map.split_at(4 * self.maps[view].0.len());
                    ViewMap {
                        knots,
                        intervals,
                        columns,
                        step_shift: self.step_shift.into(),
                        interpolation: self.interpolation,
                        kept_lines: 0,
                    }
                })
                .to_vec();
            let reads: Vec<[Option<(u16, u16)>; 2]> = (0..self.size[1])
                .map(|y| [0, 1].map(|view: usize| maps[view].raw_lines(y, self.raw[1])))
                .collect();
            [0, 1].map(|view: usize| {
                let mut needed = 1;
                for y in 0..reads.len() {
                    let above = reads[..=y].iter().flatten().flatten();
                    let ready = above.map(|&(_, last)| last).max();
                    let below = reads[y..].iter().filter_map(|views| views[view]);
                    let lowest = below.map(|(first, _)| first).min();
                    if let (Some(ready), Some(lowest)) = (ready, lowest) {
                        needed = needed.max((ready + 1).saturating_sub(lowest));
                    }
                }
                needed
            })
        }

        pub(in crate::geometry) fn bytes(&self) -> Vec<u8> {
            let mut bytes = b"VGRF\x01\0".to_vec();
            bytes.extend([self.step_shift, self.interpolation as u8]);
            for number in [self.raw, self.size, self.kept_lines].concat() {
                bytes.extend(number.to_le_bytes());
            }
            for number in self.numbers {
                bytes.extend(number.to_le_bytes());
            }
            for (knots, intervals) in &self.maps {
                bytes.extend(knots.iter().flatten().flat_map(|n| n.to_le_bytes()));
                bytes.extend(intervals.iter().flatten().flat_map(|n| n.to_le_bytes()));
            }
            let checksum = CHECKSUM.checksum(&bytes);
            bytes.extend(checksum.to_le_bytes());
            bytes
        }
    }

    /// A rotation about the centre and a pitch, for the left view; the right one hangs lower.
    pub(in crate::geometry) fn crooked(view: usize, x: f64, y: f64) -> [f64; 2] {
        let roll = [0.05, -0.03][view];
        [
            roll * (y - 20.0) + 1.3,
            -roll * (x - 30.0) + [0.4, 5.2][view],
        ]
    }

    fn stored() -> Stored {
        Stored::new(3, [64, 48], [61, 43], crooked)
    }

    #[test]
    fn what_is_stored_is_read() {
        let stored = stored();
        let bytes = stored.bytes();
        let read = Rectification::from_bytes(&bytes).unwrap();
        assert_eq!([read.raw_width, read.raw_height], stored.raw);
        assert_eq!([read.width, read.height], stored.size);
        assert_eq!(
            [read.left, read.right].map(|map| map.kept_lines()),
            stored.kept_lines
        );
        assert_eq!(read.depth, Depth::new(256 * 300 * 60, -512));
        assert_eq!(
            (read.focal_q8, read.principal_q8),
            (300 << 8, [31 << 8, -7])
        );
        for (map, (knots, intervals)) in [read.left, read.right].iter().zip(&stored.maps) {
            for (y, &[start, end]) in (0..).zip(intervals) {
                assert_eq!(map.valid_columns(y), start..end);
            }
            // 9 by 7 knots; between them, the weighted mean.
            assert_eq!(map.knots_per_row(), 9);
            for (column, y) in [(0, 0), (8, 0), (3, 8), (2, 13), (8, 42)] {
                let (row, below) = (y / 8, i32::from(y as u8 % 8));
                let [upper, lower] = [row, row + 1].map(|row| knots[row * 9 + column]);
                let expected = [0, 1].map(|axis: usize| {
                    let place = [8 * column, y][axis] as i32;
                    let mixed =
                        i32::from(upper[axis]) * (8 - below) + i32::from(lower[axis]) * below;
                    place * 512 + mixed
                });
                assert_eq!(map.knot(column, y as u16), expected);
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused_by_its_reason() {
        let refused = |change: &dyn Fn(&mut Stored)| {
            let mut changed = stored();
            change(&mut changed);
            Rectification::from_bytes(&changed.bytes())
                .map(|_| ())
                .unwrap_err()
        };
        assert_eq!(refused(&|s| s.step_shift = 7), RectificationError::Size);
        assert_eq!(refused(&|s| s.step_shift = 1), RectificationError::Size);
        assert_eq!(refused(&|s| s.raw[1] = 0), RectificationError::Size);
        assert_eq!(refused(&|s| s.size[0] = 4097), RectificationError::Size);
        assert_eq!(refused(&|s| s.size[0] = 80), RectificationError::Length);
        assert_eq!(
            refused(&|s| s.maps[1].1[5] = [9, 8]),
            RectificationError::Interval
        );
        assert_eq!(
            refused(&|s| s.maps[0].1[42] = [9, 62]),
            RectificationError::Interval
        );
        assert_eq!(refused(&|s| s.numbers[2] = 0), RectificationError::Camera);
        assert_eq!(refused(&|s| s.numbers[2] = -1), RectificationError::Camera);
        assert_eq!(refused(&|s| s.numbers[0] = -1), RectificationError::Camera);
        for (view, less) in [(0, 1), (1, 1)] {
            let error = refused(&|s| s.kept_lines[view] -= less);
            assert_eq!(error, RectificationError::Lines);
        }
        assert_eq!(
            refused(&|s| s.kept_lines[0] += 1),
            RectificationError::Lines
        );
        // Without a baseline there is no depth, and no error.
        let mut without = stored();
        without.numbers[0] = 0;
        assert_eq!(
            Rectification::from_bytes(&without.bytes()).unwrap().depth,
            None
        );
    }

    #[test]
    fn bytes_behind_a_rectification_are_left_alone() {
        let bytes = stored().bytes();
        let padded = [&bytes[..], &[0xff; 500]].concat();
        assert!(Rectification::from_bytes(&padded).is_err());
        let read = Rectification::from_prefix(&padded).unwrap();
        assert_eq!(
            read.focal_q8,
            Rectification::from_bytes(&bytes).unwrap().focal_q8
        );
        assert!(Rectification::from_prefix(&bytes).is_ok());
        for length in 0..bytes.len() {
            assert!(Rectification::from_prefix(&bytes[..length]).is_err());
        }
        for at in 0..bytes.len() {
            let mut damaged = padded.clone();
            damaged[at] ^= 1 << (at % 8);
            assert!(Rectification::from_prefix(&damaged).is_err(), "byte {at}");
        }
        let erased = Rectification::from_prefix(&[0xff; 500]);
        assert_eq!(erased.unwrap_err(), RectificationError::Format);
    }

    #[test]
    fn damaged_bytes_are_refused() {
        let bytes = stored().bytes();
        for length in 0..bytes.len() {
            assert!(Rectification::from_bytes(&bytes[..length]).is_err());
        }
        for at in 0..bytes.len() {
            for bit in [0, 3, 7] {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                assert!(Rectification::from_bytes(&damaged).is_err(), "byte {at}");
            }
        }
        let mut newer = bytes.clone();
        newer[4] = 2;
        let error = Rectification::from_bytes(&newer).unwrap_err();
        assert_eq!(error, RectificationError::Version(2));
        let mut unknown = bytes.clone();
        unknown[7] = 2;
        let end = unknown.len() - CHECKSUM_BYTES;
        let checksum = CHECKSUM.checksum(&unknown[..end]);
        unknown[end..].copy_from_slice(&checksum.to_le_bytes());
        let error = Rectification::from_bytes(&unknown).unwrap_err();
        assert_eq!(error, RectificationError::Interpolation);
        assert_eq!(
            Rectification::from_bytes(&[b'V'; 100]).unwrap_err(),
            RectificationError::Format
        );
    }
}
