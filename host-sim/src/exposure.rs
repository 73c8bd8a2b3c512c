//! A difference in exposure between the right camera and the left.

use clap::Args;
use image::RgbImage;

/// How grey levels of the right view follow from those of the left view: the level times the
/// gain, plus the offset. Both may change from line to line.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
pub struct Exposure {
    /// Gain of the right camera relative to the left, above 0; halfway down where it grows.
    #[arg(long, value_name = "X", default_value_t = 1.1)]
    pub gain: f32,
    /// How much the gain grows from the first line to the last.
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub gain_gradient: f32,
    /// Black level of the right camera relative to the left, grey levels; halfway down where
    /// it grows.
    #[arg(
        long,
        value_name = "X",
        default_value_t = 4.0,
        allow_negative_numbers = true
    )]
    pub offset: f32,
    /// How much the black level grows from the first line to the last, grey levels.
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub offset_gradient: f32,
}

impl Exposure {
    /// The exposure with which both cameras have equal grey levels.
    pub const EQUAL: Self = Self {
        gain: 1.0,
        gain_gradient: 0.0,
        offset: 0.0,
        offset_gradient: 0.0,
    };

    /// Returns whether all numbers are finite and the gain is above 0 on every line.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let numbers = [
            self.gain,
            self.gain_gradient,
            self.offset,
            self.offset_gradient,
        ];
        numbers.iter().all(|number| number.is_finite())
            && self.gain - self.gain_gradient.abs() / 2.0 > 0.0
    }

    /// Returns the gain, and the offset in grey levels, of line `line` of a view of `lines` lines.
    #[must_use]
    pub fn of_line(&self, line: u32, lines: u32) -> (f64, f64) {
        let from_middle = f64::from(line) / f64::from(lines.max(2) - 1) - 0.5;
        let at = |middle: f32, growth: f32| f64::from(middle) + f64::from(growth) * from_middle;
        (
            at(self.gain, self.gain_gradient),
            at(self.offset, self.offset_gradient),
        )
    }

    /// Changes a view from the exposure of the left camera to that of the right camera. Levels
    /// are clamped to 0 to 255.
    pub fn apply(&self, view: &mut RgbImage) {
        let lines = view.height();
        for (y, row) in view.rows_mut().enumerate() {
            // Images have at most 2^32 lines.
            let (gain, offset) = self.of_line(y as u32, lines);
            for level in row.flat_map(|pixel| &mut pixel.0) {
                // The cast saturates.
                *level = (f64::from(*level) * gain + offset).round() as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn levels_follow_gain_and_offset_from_line_to_line() {
        let exposure = Exposure {
            gain: 1.0,
            gain_gradient: 1.0,
            offset: 10.0,
            offset_gradient: -20.0,
        };
        let mut view = RgbImage::from_pixel(1, 3, Rgb([0, 100, 200]));
        exposure.apply(&mut view);
        let lines: Vec<[u8; 3]> = view.pixels().map(|pixel| pixel.0).collect();
        assert_eq!(lines, [[20, 70, 120], [10, 110, 210], [0, 150, 255]]);
        let before = view.clone();
        Exposure::EQUAL.apply(&mut view);
        assert_eq!(view, before);
    }
}
