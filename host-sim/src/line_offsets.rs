//! Offsets of lines as people give and read them: by how much one view lies too low in the middle of the
//! picture, by what angle its lines are turned, and how much taller it is.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;
use vgstereo_core::LineOffsets;

use crate::line_offset::LINE_OFFSET_MAX_PX;

/// The largest angle, degrees.
const TURN_MAX_DEGREES: f64 = 10.0;
/// The largest difference in height, percent.
const STRETCH_MAX_PERCENT: f64 = 10.0;

/// By how much the view that is not the reference lies too low.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ViewOffsets {
    /// In the middle of the picture, px.
    pub lower_px: f64,
    /// Angle by which its lines fall to the right, degrees.
    pub turned_degrees: f64,
    /// By how much it is taller than the reference view, percent.
    pub taller_percent: f64,
}

impl ViewOffsets {
    /// The offsets of frames of `height` lines.
    #[must_use]
    pub fn of(offsets: LineOffsets, height: u32) -> Self {
        let lines = |q24: i32| f64::from(q24) / f64::from(LineOffsets::LINE_Q24);
        let stretch = lines(offsets.stretch_q24);
        Self {
            lower_px: lines(offsets.shift_q24) + stretch * f64::from(height) / 2.0,
            turned_degrees: lines(offsets.tilt_q24).atan().to_degrees(),
            taller_percent: 100.0 * stretch,
        }
    }

    /// The offsets for a matcher of frames of `height` lines.
    #[must_use]
    pub fn in_lines(self, height: u32) -> LineOffsets {
        // The casts saturate, and what is within the bounds is far from that for heights below 2000 lines.
        let q24 = |lines: f64| (lines * f64::from(LineOffsets::LINE_Q24)).round() as i32;
        let stretch = self.taller_percent / 100.0;
        LineOffsets {
            shift_q24: q24(self.lower_px - stretch * f64::from(height) / 2.0),
            tilt_q24: q24(self.turned_degrees.to_radians().tan()),
            stretch_q24: q24(stretch),
        }
    }
}

impl fmt::Display for ViewOffsets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.2},{:.3},{:.2}",
            self.lower_px, self.turned_degrees, self.taller_percent
        )
    }
}

impl FromStr for ViewOffsets {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(str::parse).collect();
        let numbers = numbers.ok().and_then(|numbers| numbers.try_into().ok());
        let bounds = [
            f64::from(LINE_OFFSET_MAX_PX),
            TURN_MAX_DEGREES,
            STRETCH_MAX_PERCENT,
        ];
        let is_within = |numbers: &[f64; 3]| {
            let mut pairs = numbers.iter().zip(bounds);
            pairs.all(|(number, bound)| number.abs() <= bound)
        };
        let Some([lower_px, turned_degrees, taller_percent]) = numbers.filter(is_within) else {
            let [px, degrees, percent] = bounds;
            return Err(format!(
                "it must be three numbers such as 0.5,-0.2,0: up to {px} px, {degrees} degrees and {percent} %"
            ));
        };
        Ok(Self {
            lower_px,
            turned_degrees,
            taller_percent,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_in_lines_are_those_that_were_given() {
        let given: ViewOffsets = "0.5,-0.25,1.5".parse().unwrap();
        let lines = given.in_lines(200);
        // In the middle of line 100, 160 columns from the middle: by the tangent of the angle.
        let at = |column: f64, line: u32| {
            let tilt = f64::from(lines.tilt_q24) * column;
            (f64::from(lines.shift_at_q24(line)) + tilt) / f64::from(LineOffsets::LINE_Q24)
        };
        assert!((at(0.0, 100) - 0.5).abs() < 1e-4);
        assert!((at(160.0, 100) - (0.5 - 160.0 * 0.004_363_35)).abs() < 1e-4);
        assert!((at(0.0, 200) - 2.0).abs() < 1e-4);
        assert_eq!(ViewOffsets::of(lines, 200).to_string(), "0.50,-0.250,1.50");
    }

    #[test]
    fn what_is_no_offset_is_refused() {
        for text in [
            "", "1", "1,2", "1,2,3,4", "9,0,0", "0,11,0", "0,0,-11", "nan,0,0", "x,0,0",
        ] {
            assert!(text.parse::<ViewOffsets>().is_err(), "{text}");
        }
    }
}
