//! A vertical shift of the right view, with which epipolar lines are not scanlines any more.

use clap::Args;
use image::RgbImage;

/// The largest shift, up or down, px.
pub const LINE_OFFSET_MAX_PX: f32 = 8.0;

/// The option `--line-offset`.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
pub struct LineOffset {
    /// By how much the right camera's lines lie too low, px. The SGM presets make up for
    /// as much as `method.line_offset_max_lines` says.
    #[arg(
        id = "line_offset",
        long = "line-offset",
        value_name = "PX",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        value_parser = parse_line_offset
    )]
    pub px: f32,
}

/// Returns the shift that a text states, px.
///
/// # Errors
/// Fails with one line that states the range.
fn parse_line_offset(text: &str) -> Result<f32, String> {
    let offset_px = text.parse().ok();
    let is_small = |px: &f32| px.abs() <= LINE_OFFSET_MAX_PX;
    offset_px
        .filter(is_small)
        .ok_or_else(|| format!("it must be from -{LINE_OFFSET_MAX_PX} to {LINE_OFFSET_MAX_PX} px"))
}

/// Returns a view that is shifted down by `offset_px`, or up if that is negative: line `y` moves
/// to `y + offset_px`. Between lines, levels are interpolated by a cubic through four of them
/// (Catmull and Rom 1974). Beyond the border, the line at the border is repeated.
#[must_use]
pub fn lowered(view: &RgbImage, offset_px: f32) -> RgbImage {
    let whole = offset_px.ceil();
    // The fraction of a line by which whole lines would move the view too far, 0 to 1.
    let t = whole - offset_px;
    let weights = [
        ((2.0 - t) * t - 1.0) * t / 2.0,
        ((3.0 * t - 5.0) * t * t + 2.0) / 2.0,
        ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0,
        (t - 1.0) * t * t / 2.0,
    ];
    let last = i64::from(view.height()) - 1;
    RgbImage::from_fn(view.width(), view.height(), |x, y| {
        let level = |channel: usize| {
            let lines = (-1..=2).zip(weights);
            let sum: f32 = lines
                .map(|(dy, weight)| {
                    // Offsets are small whole numbers, and heights fit.
                    let line = (i64::from(y) - whole as i64 + dy).clamp(0, last) as u32;
                    weight * f32::from(view.get_pixel(x, line)[channel])
                })
                .sum();
            // The cast saturates.
            sum.round() as u8
        };
        image::Rgb([level(0), level(1), level(2)])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels that grow by 10 a line.
    fn ramp() -> RgbImage {
        RgbImage::from_fn(2, 20, |_, y| image::Rgb([10 * y as u8; 3]))
    }

    #[test]
    fn a_ramp_is_lowered_by_fractions_of_a_line() {
        for offset_px in [-2.0, -0.7, -0.5, 0.0, 0.3, 1.0, 1.6] {
            let moved = lowered(&ramp(), offset_px);
            for y in 4..16 {
                let expected = 10.0 * (y as f32 - offset_px);
                let found = f32::from(moved.get_pixel(1, y)[2]);
                assert!((found - expected).abs() <= 0.51, "{offset_px}: {found}");
            }
        }
    }

    #[test]
    fn whole_lines_are_copied_and_the_border_is_repeated() {
        let moved = lowered(&ramp(), 2.0);
        let lines: Vec<u8> = moved.rows().map(|mut row| row.next().unwrap()[0]).collect();
        assert_eq!(lines[..5], [0, 0, 0, 10, 20]);
        assert_eq!(lowered(&ramp(), 0.0), ramp());
    }
}
