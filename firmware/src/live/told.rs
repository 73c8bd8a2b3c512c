//! What the host is told of the offsets of lines.

use core::fmt;

use vgstereo_core::{LineOffsets, Reference};

/// Hundredths of a degree of the angle whose tangent is 1, for small angles.
const DEGREES_Q2: i64 = 5730;

/// Offsets of lines in frames of a number of lines, as a sentence. The unit is 1/100.
pub(super) struct Told {
    pub(super) offsets: LineOffsets,
    pub(super) lines: u32,
    pub(super) reference: Reference,
}

impl fmt::Display for Told {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hundredths = |q24: i32, unit: i64| {
            let value = (i64::from(q24) * unit) / i64::from(LineOffsets::LINE_Q24);
            (value < 0, Hundredths(value.unsigned_abs()))
        };
        let (is_higher, px) = hundredths(self.offsets.shift_at_q24(self.lines / 2), 100);
        let (rises, degrees) = hundredths(self.offsets.tilt_q24, DEGREES_Q2);
        let (is_smaller, percent) = hundredths(self.offsets.stretch_q24, 10_000);
        let view = match self.reference {
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
    }
}

struct Hundredths(u64);

impl fmt::Display for Hundredths {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:02}", self.0 / 100, self.0 % 100)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn offsets_are_told_in_the_middle_of_the_frame() {
        // Half a line low at the first line, a turn of 1/256 and one line more in 100.
        let told = Told {
            offsets: LineOffsets {
                shift_q24: 1 << 23,
                tilt_q24: -(1 << 16),
                stretch_q24: (1 << 24) / 100,
            },
            lines: 200,
            reference: Reference::Left,
        };
        assert_eq!(
            told.to_string(),
            "the right view lies 1.49 px too low, its lines rise by 0.22 degrees, 0.99 % too tall"
        );
        let far = LineOffsets {
            shift_q24: i32::MIN,
            tilt_q24: i32::MAX,
            stretch_q24: i32::MIN,
        };
        let told = Told {
            offsets: far,
            lines: u32::MAX,
            reference: Reference::Right,
        };
        assert!(
            told.to_string()
                .starts_with("the left view lies 128.00 px too high")
        );
    }
}
