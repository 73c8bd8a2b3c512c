//! Unpacking: converts the bytes of a line, as a camera stores them, to rows of grey or of one
//! channel.

/// Largest number of channels of a pixel: red, green and blue.
pub const MAX_CHANNELS: usize = 3;

/// Format in which a line of one view is stored, pixel after pixel without gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PixelFormat {
    /// One byte per pixel, 0 black to 255 white.
    Grey8,
    /// Three bytes per pixel: red, green, blue.
    Rgb888,
    /// Two bytes per pixel, the high byte first, as OmniVision sensors send it: 5 bits of
    /// red, 6 of green, 5 of blue, from the most significant bit.
    Rgb565,
    /// Two bytes per pixel, `Y0 U Y1 V` (YUYV): a luma byte, then U of even or V of odd
    /// pixels. Luma is full range, 0 to 255; a line of odd width ends after a U.
    Yuv422,
}

impl PixelFormat {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Grey8, Self::Rgb888, Self::Rgb565, Self::Yuv422];

    /// Bytes per pixel.
    #[must_use]
    pub const fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Grey8 => 1,
            Self::Rgb565 | Self::Yuv422 => 2,
            Self::Rgb888 => 3,
        }
    }

    /// Bytes of a line of `width` pixels of one view.
    #[must_use]
    pub const fn line_bytes(self, width: u16) -> usize {
        width as usize * self.bytes_per_pixel()
    }

    /// Whether the format is grey, so that [`luma_row`] only copies a line.
    #[must_use]
    pub const fn is_grey(self) -> bool {
        matches!(self, Self::Grey8)
    }
}

/// Converts a line to grey: BT.601 luma, `(77 R + 150 G + 29 B + 128) >> 8` of 8-bit components, so
/// that `R = G = B = v` gives `v`. Components of 5 and 6 bits are widened to 8 bits by repeating
/// their high bits; `Y` is copied.
///
/// If `line` and `grey` have different lengths, the common pixels are converted.
#[inline(always)]
pub fn luma_row(format: PixelFormat, line: &[u8], grey: &mut [u8]) {
    match format {
        PixelFormat::Grey8 => {
            for (grey, &value) in grey.iter_mut().zip(line) {
                *grey = value;
            }
        }
        PixelFormat::Rgb888 => {
            for (grey, &[red, green, blue]) in grey.iter_mut().zip(line.as_chunks().0) {
                *grey = luma_bt601(red, green, blue);
            }
        }
        PixelFormat::Rgb565 => {
            for (grey, &pixel) in grey.iter_mut().zip(line.as_chunks().0) {
                let [red, green, blue] = widen_rgb565(pixel);
                *grey = luma_bt601(red, green, blue);
            }
        }
        PixelFormat::Yuv422 => {
            for (grey, &[luma, _chroma]) in grey.iter_mut().zip(line.as_chunks().0) {
                *grey = luma;
            }
        }
    }
}

/// Extracts one channel of a line, 8 bits per pixel: 0 is red, 1 green, 2 blue. For a grey line,
/// all three are the grey levels. YUV is converted with BT.601's full-range coefficients in 1/64.
/// Any other channel is 0.
///
/// If `line` and `row` have different lengths, the common pixels are converted.
#[inline(always)]
pub fn channel_row(format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
    // Branches once per line rather than once per pixel.
    match channel {
        0 => pick_row(format, line, row, |[red, _, _]| red),
        1 => pick_row(format, line, row, |[_, green, _]| green),
        2 => pick_row(format, line, row, |[_, _, blue]| blue),
        _ => row.fill(0),
    }
}

/// Writes the result of `pick` for the red, green and blue of each pixel.
#[inline(always)]
fn pick_row(format: PixelFormat, line: &[u8], row: &mut [u8], pick: impl Fn([u8; 3]) -> u8) {
    match format {
        PixelFormat::Grey8 => {
            for (level, &grey) in row.iter_mut().zip(line) {
                *level = grey;
            }
        }
        PixelFormat::Rgb888 => {
            for (level, &pixel) in row.iter_mut().zip(line.as_chunks().0) {
                *level = pick(pixel);
            }
        }
        PixelFormat::Rgb565 => {
            for (level, &pixel) in row.iter_mut().zip(line.as_chunks().0) {
                *level = pick(widen_rgb565(pixel));
            }
        }
        PixelFormat::Yuv422 => {
            let chromas = line.as_chunks::<4>().0.iter().map(|&[_, u, _, v]| [u, v]);
            let mut chromas = chromas.flat_map(|chroma| [chroma; 2]);
            let mut chroma = [128_u8; 2];
            for (level, &[luma, _]) in row.iter_mut().zip(line.as_chunks().0) {
                // A line of odd width ends without a V: its last pixel takes the one before.
                chroma = chromas.next().unwrap_or(chroma);
                let [u, v] = chroma.map(|c| i32::from(c) - 128);
                let shift =
                    |offset: i32| (i32::from(luma) + ((offset + 32) >> 6)).clamp(0, 255) as u8;
                *level = pick([shift(90 * v), shift(-22 * u - 46 * v), shift(113 * u)]);
            }
        }
    }
}

/// 5, 6 and 5 bits to 8, by repeating the high bits.
#[inline]
fn widen_rgb565([high, low]: [u8; 2]) -> [u8; 3] {
    let red = high & 0xf8;
    let green = (high << 5) | ((low >> 3) & 0x1c);
    let blue = low << 3;
    [red | red >> 5, green | green >> 6, blue | blue >> 5]
}

/// 0.299, 0.587 and 0.114 in 1/256; they sum to 256.
#[inline]
fn luma_bt601(red: u8, green: u8, blue: u8) -> u8 {
    let sum = 77 * u16::from(red) + 150 * u16::from(green) + 29 * u16::from(blue);
    // At most 256 * 255 + 128, which a u16 holds, and its high byte is the luma.
    let [luma, _fraction] = (sum + 128).to_be_bytes();
    luma
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(red: u8, green: u8, blue: u8) -> f64 {
        0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)
    }

    fn luma_of(format: PixelFormat, pixel: &[u8]) -> u8 {
        let mut grey = [0];
        luma_row(format, pixel, &mut grey);
        grey[0]
    }

    #[test]
    fn rgb888_is_bt601_within_rounding() {
        for red in 0..=255u8 {
            for green in (0..=255u8).step_by(3) {
                for blue in (0..=255u8).step_by(5) {
                    let luma = f64::from(luma_of(PixelFormat::Rgb888, &[red, green, blue]));
                    // Half a step of rounding; red's weight, rounded, is 0.0018 too high.
                    let error = (luma - reference(red, green, blue)).abs();
                    assert!(error <= 0.5 + 0.46, "{red} {green} {blue}: {error}");
                }
            }
            assert_eq!(luma_of(PixelFormat::Rgb888, &[red; 3]), red);
        }
    }

    #[test]
    fn rgb565_widens_every_value_and_is_big_endian() {
        for value in 0..=u16::MAX {
            let (red, green, blue) = (value >> 11, (value >> 5) & 63, value & 31);
            let widen = |component: u16, bits: u32| {
                u8::try_from(match bits {
                    5 => (component << 3) | (component >> 2),
                    _ => (component << 2) | (component >> 4),
                })
                .unwrap()
            };
            let rgb = [widen(red, 5), widen(green, 6), widen(blue, 5)];
            // Repeating the high bits is scaling to 255, but for a step.
            let scaled = [(red, 31.0), (green, 63.0), (blue, 31.0)]
                .map(|(component, largest)| f64::from(component) * 255.0 / largest);
            assert!((0..3).all(|i| (f64::from(rgb[i]) - scaled[i]).abs() < 1.0));
            assert_eq!(
                luma_of(PixelFormat::Rgb565, &value.to_be_bytes()),
                luma_of(PixelFormat::Rgb888, &rgb),
                "{value:#06x}"
            );
        }
    }

    #[test]
    fn yuv422_takes_every_other_byte_and_grey8_every_byte() {
        let mut grey = [0; 3];
        luma_row(PixelFormat::Yuv422, &[10, 200, 20, 100, 30, 201], &mut grey);
        assert_eq!(grey, [10, 20, 30]);
        luma_row(PixelFormat::Grey8, &[1, 2, 3], &mut grey);
        assert_eq!(grey, [1, 2, 3]);
    }

    #[test]
    fn of_different_lengths_the_common_pixels_are_converted() {
        for format in PixelFormat::ALL {
            let mut grey = [7; 4];
            luma_row(
                format,
                &std::vec![255; 2 * format.bytes_per_pixel()],
                &mut grey,
            );
            assert_eq!(grey, [255, 255, 7, 7], "{format:?}");
            luma_row(format, &[0; 64], &mut grey[..1]);
            assert_eq!(grey, [0, 255, 7, 7], "{format:?}");
        }
    }

    #[test]
    fn line_bytes_of_the_widest_line() {
        assert_eq!(PixelFormat::Grey8.line_bytes(65535), 65535);
        assert_eq!(PixelFormat::Rgb565.line_bytes(3), 6);
        assert_eq!(PixelFormat::Yuv422.line_bytes(3), 6);
        assert_eq!(PixelFormat::Rgb888.line_bytes(65535), 3 * 65535);
    }

    #[test]
    fn a_yuv_line_one_pixel_wide_has_no_colour() {
        let mut row = [1];
        for channel in 0..3 {
            channel_row(PixelFormat::Yuv422, &[77, 200], channel, &mut row);
            assert_eq!(row, [77]);
        }
    }

    #[test]
    fn an_odd_yuv_line_ends_with_the_chroma_before() {
        // Red 2 pixels wide, then a third pixel with a U alone.
        let line = [100, 128, 100, 192, 50, 0];
        let mut rows = [[1; 3]; 4];
        for (channel, row) in rows.iter_mut().enumerate() {
            channel_row(PixelFormat::Yuv422, &line, channel, row);
        }
        // V is 64 above the middle: red 90, green -46, blue 0; there is no fourth channel.
        assert_eq!(rows, [[190, 190, 140], [54, 54, 4], [100, 100, 50], [0; 3]]);
    }
}
