//! Line offsets: by how much the lines of one view lie lower than those of the other, all over a frame.

use core::fmt;

use super::moved::{OFFSET_BITS, RowOffsets};
use crate::disparity::Reference;

/// Hundredths of a degree in a radian, which is as good for tangents of small angles.
const HUNDREDTHS_OF_A_DEGREE: i64 = 5730;

/// By how much the pixels of the view that is not the reference lie too low, 1/2^24 line, as a plane: `shift +
/// tilt (column - width / 2) + stretch line`, with `width / 2` rounded down.
///
/// A camera that is lowered shifts all lines, one that is turned about its optical axis tilts them by the tangent
/// of the angle, and one that sees everything larger stretches the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineOffsets {
    /// Offset in the middle of the first line.
    pub shift_q24: i32,
    /// Increment from column to column.
    pub tilt_q24: i32,
    /// Increment from line to line.
    pub stretch_q24: i32,
}

impl LineOffsets {
    /// One line, in the unit of the fields.
    pub const LINE_Q24: i32 = 1 << OFFSET_BITS;

    /// Every line is where it should be.
    pub const NONE: Self = Self {
        shift_q24: 0,
        tilt_q24: 0,
        stretch_q24: 0,
    };

    /// The offset in the middle of `line`, as far as 32 bits reach.
    #[must_use]
    pub fn shift_at_q24(self, line: u32) -> i32 {
        let stretch_q24 = i64::from(self.stretch_q24) * i64::from(line);
        saturated(i64::from(self.shift_q24) + stretch_q24)
    }

    /// A sentence that says how the view lies that is not the reference, in the middle of frames of `lines` lines.
    #[must_use]
    pub fn told(self, lines: u32, reference: Reference) -> impl fmt::Display {
        fmt::from_fn(move |f| {
            let hundredths = |q24: i32, unit: i64| {
                let value = (i64::from(q24) * unit) / i64::from(Self::LINE_Q24);
                (value < 0, Hundredths(value.unsigned_abs()))
            };
            let (is_higher, px) = hundredths(self.shift_at_q24(lines / 2), 100);
            let (rises, degrees) = hundredths(self.tilt_q24, HUNDREDTHS_OF_A_DEGREE);
            let (is_smaller, percent) = hundredths(self.stretch_q24, 10_000);
            let view = match reference {
                Reference::Left => "right",
                Reference::Right => "left",
            };
            let [low, fall, tall] = [
                if is_higher { "high" } else { "low" },
                if rises { "rise" } else { "fall" },
                if is_smaller { "small" } else { "tall" },
            ];
            write!(
                f,
                "the {view} view lies {px} px too {low}, its lines {fall} by {degrees} degrees, {percent} % too {tall}"
            )
        })
    }

    /// The largest offset of lines of `width` px of a frame of `lines` lines, in either direction.
    pub(crate) fn largest_q24(self, width: usize, lines: u32) -> u64 {
        let ends = [0, lines].map(|line| self.row(line).largest_q24(width));
        ends.into_iter().fold(0, u64::max)
    }

    /// The offsets where the columns are stored from the last to the first.
    pub(crate) fn mirrored(self, width: usize) -> Self {
        // If the number of columns is even, the middle position has the column before the middle one.
        let one_before = i64::from(width.is_multiple_of(2));
        let shift_q24 = i64::from(self.shift_q24) - one_before * i64::from(self.tilt_q24);
        Self {
            shift_q24: saturated(shift_q24),
            tilt_q24: self.tilt_q24.saturating_neg(),
            ..self
        }
    }

    /// By how much more these offsets are than others.
    pub(crate) fn less(self, other: Self) -> Self {
        Self {
            shift_q24: self.shift_q24.saturating_sub(other.shift_q24),
            tilt_q24: self.tilt_q24.saturating_sub(other.tilt_q24),
            stretch_q24: self.stretch_q24.saturating_sub(other.stretch_q24),
        }
    }

    /// The offsets of `line`.
    pub(crate) fn row(self, line: u32) -> RowOffsets {
        RowOffsets {
            shift_q24: self.shift_at_q24(line),
            tilt_q24: self.tilt_q24,
        }
    }
}

/// A number in hundredths, written with a point.
struct Hundredths(u64);

impl fmt::Display for Hundredths {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:02}", self.0 / 100, self.0 % 100)
    }
}

fn saturated(q24: i64) -> i32 {
    // Not `clamp`, which panics unless its bounds are in order.
    q24.min(i32::MAX.into()).max(i32::MIN.into()) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn offsets_are_told_in_the_middle_of_the_frame() {
        // Half a line low at the first line, a turn of 1/256 and one line more in 100.
        let offsets = LineOffsets {
            shift_q24: 1 << 23,
            tilt_q24: -(1 << 16),
            stretch_q24: (1 << 24) / 100,
        };
        assert_eq!(
            offsets.told(200, Reference::Left).to_string(),
            "the right view lies 1.49 px too low, its lines rise by 0.22 degrees, 0.99 % too tall"
        );
        let far = LineOffsets {
            shift_q24: i32::MIN,
            tilt_q24: i32::MAX,
            stretch_q24: i32::MIN,
        };
        let told = far.told(u32::MAX, Reference::Right).to_string();
        assert!(told.starts_with("the left view lies 128.00 px too high"));
    }

    #[test]
    fn mirrored_offsets_are_those_of_the_same_column() {
        let offsets = LineOffsets {
            shift_q24: 1_000_003,
            tilt_q24: -70_001,
            stretch_q24: 9_001,
        };
        for width in [1, 2, 7, 8, 641, 640] {
            let at = |offsets: LineOffsets, place: usize| {
                let row = offsets.row(11);
                let from_middle = place as i64 - (width / 2) as i64;
                i64::from(row.shift_q24) + i64::from(row.tilt_q24) * from_middle
            };
            let mirrored = offsets.mirrored(width);
            for column in 0..width {
                assert_eq!(at(mirrored, width - 1 - column), at(offsets, column));
            }
            assert_eq!(mirrored.mirrored(width), offsets);
        }
    }

    #[test]
    fn offsets_that_32_bits_do_not_reach_are_the_last_that_they_do() {
        let far = |stretch_q24| LineOffsets {
            stretch_q24,
            ..LineOffsets::NONE
        };
        assert_eq!(far(1 << 20).shift_at_q24(u32::MAX), i32::MAX);
        assert_eq!(far(-1 << 20).shift_at_q24(u32::MAX), i32::MIN);
        assert_eq!(far(-3).shift_at_q24(5), -15);
    }
}
