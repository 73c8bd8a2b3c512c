//! Images of numbers: ground truth and masks, whose values must come as they were stored.

use std::io::Cursor;

use anyhow::{Context, Result, bail, ensure};
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};

use crate::images::{PIXELS_MAX, ensure_bounded};

/// The stored values of an image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Values {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) values: Vec<u16>,
    /// Whether values have 16 bits.
    pub(super) wide: bool,
}

impl Values {
    /// Reads a PNG in memory; `name` is for messages. Values are grey levels of 1 to 16 bits, the
    /// indices of a palette, or red, green and blue that are equal; alpha must be opaque.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason.
    pub(super) fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        Self::parse(bytes).with_context(|| format!("cannot read {name}"))
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        ensure!(
            bytes.starts_with(b"\x89PNG"),
            "values are stored in a PNG; a JPEG, for one, changes them"
        );
        let limits = Limits {
            bytes: 8 * PIXELS_MAX as usize,
        };
        let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
        // The image crate scales what has fewer than 8 bits, and looks up colours of a palette.
        decoder.set_transformations(Transformations::IDENTITY);
        let mut reader = decoder.read_info()?;
        let (width, height) = (reader.info().width, reader.info().height);
        ensure_bounded(width, height)?;
        let bytes = reader.output_buffer_size().context("it is too large")?;
        let mut raw = vec![0; bytes];
        let frame = reader.next_frame(&mut raw)?;
        let samples = samples(&raw, frame.line_size, frame.bit_depth);
        let channels = frame.color_type.samples();
        let line_samples = width as usize * channels;
        let mut values = Vec::with_capacity(width as usize * height as usize);
        let largest = if frame.bit_depth == BitDepth::Sixteen {
            u16::MAX
        } else {
            u8::MAX.into()
        };
        for pixel in samples
            .lines(line_samples)
            .flat_map(|line| line.chunks(channels))
        {
            let (value, opaque) = match (frame.color_type, pixel) {
                (ColorType::Grayscale | ColorType::Indexed, &[value]) => (value, true),
                (ColorType::GrayscaleAlpha, &[value, alpha]) => (value, alpha == largest),
                (ColorType::Rgb, &[red, green, blue]) if red == green && green == blue => {
                    (red, true)
                }
                (ColorType::Rgba, &[red, green, blue, alpha]) if red == green && green == blue => {
                    (red, alpha == largest)
                }
                _ => bail!("its red, green and blue differ, so that they are no single value"),
            };
            ensure!(opaque, "some of its pixels are transparent");
            values.push(value);
        }
        Ok(Self {
            width,
            height,
            values,
            wide: frame.bit_depth == BitDepth::Sixteen,
        })
    }
}

/// The samples of all lines of an image, each line padded to whole bytes in the file.
struct Samples {
    values: Vec<u16>,
    per_line: usize,
}

impl Samples {
    fn lines(&self, line_samples: usize) -> impl Iterator<Item = &[u16]> {
        let lines = self.values.chunks(self.per_line.max(1));
        lines.map(move |line| line.get(..line_samples).unwrap_or_default())
    }
}

/// Unpacks samples of 1 to 16 bits; `line_bytes` is the length of a line.
fn samples(raw: &[u8], line_bytes: usize, depth: BitDepth) -> Samples {
    let bits = depth as usize;
    let values = if depth == BitDepth::Sixteen {
        raw.as_chunks()
            .0
            .iter()
            .map(|&bytes| u16::from_be_bytes(bytes))
            .collect()
    } else {
        let per_byte = 8 / bits;
        let mask = ((1_u16 << bits) - 1) as u8;
        let unpacked = raw.iter().flat_map(|&byte| {
            (1..=per_byte).map(move |place| u16::from(byte >> (8 - bits * place) & mask))
        });
        unpacked.collect()
    };
    Samples {
        values,
        per_line: line_bytes * 8 / bits,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A PNG of these samples, packed as the file has them.
    pub(in crate::dataset) fn png(
        (width, height): (u32, u32),
        color: ColorType,
        depth: BitDepth,
        packed: &[u8],
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == ColorType::Indexed {
            // Colours that are not the indices.
            encoder.set_palette(
                (0..=255)
                    .flat_map(|i: u8| [255 - i, i / 2, 7])
                    .collect::<Vec<u8>>(),
            );
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(packed).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn values_come_as_they_were_stored() {
        use BitDepth::{Eight, Four, One, Sixteen, Two};
        use ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        let read = |color, depth, packed: &[u8]| {
            Values::from_bytes(&png((3, 2), color, depth, packed), "a.png").map(|read| read.values)
        };
        // Three samples to a line, which is padded to whole bytes.
        for color in [Grayscale, Indexed] {
            assert_eq!(
                read(color, One, &[0b101_00000, 0b011_00000]).unwrap(),
                [1, 0, 1, 0, 1, 1]
            );
            assert_eq!(
                read(color, Two, &[0b11_00_10_00, 0b01_10_11_00]).unwrap(),
                [3, 0, 2, 1, 2, 3]
            );
            assert_eq!(
                read(color, Four, &[0x1f, 0x20, 0x34, 0x50]).unwrap(),
                [1, 15, 2, 3, 4, 5]
            );
            assert_eq!(
                read(color, Eight, &[9, 8, 7, 6, 5, 255]).unwrap(),
                [9, 8, 7, 6, 5, 255]
            );
        }
        let wide = [0, 9, 1, 0, 2, 2, 255, 255, 0, 0, 3, 1];
        let expected = [9, 256, 514, 65_535, 0, 769];
        assert_eq!(read(Grayscale, Sixteen, &wide).unwrap(), expected);
        let thrice: Vec<u8> = wide.chunks(2).flat_map(|value| value.repeat(3)).collect();
        assert_eq!(read(Rgb, Sixteen, &thrice).unwrap(), expected);
        let opaque: Vec<u8> = (1..=6)
            .flat_map(|value| [value, value, value, 255])
            .collect();
        assert_eq!(read(Rgba, Eight, &opaque).unwrap(), [1, 2, 3, 4, 5, 6]);
        let refused =
            |color, depth, packed: &[u8]| format!("{:#}", read(color, depth, packed).unwrap_err());
        let mut unequal = thrice.clone();
        unequal[1] += 1;
        assert!(refused(Rgb, Sixteen, &unequal).contains("differ"));
        let hidden: Vec<u8> = (1..=6).flat_map(|value| [value, 200]).collect();
        assert!(refused(GrayscaleAlpha, Eight, &hidden).contains("transparent"));
    }

    #[test]
    fn what_is_no_png_is_refused() {
        for bytes in [
            &b"P5\n1 1\n255\n7"[..],
            &[0xff, 0xd8, 0xff, 0xe0],
            b"",
            b"\x89PNG\r\n\x1a\n",
        ] {
            let error = format!("{:#}", Values::from_bytes(bytes, "gt.png").unwrap_err());
            assert!(error.contains("gt.png"), "{error}");
        }
        let whole = png(
            (3, 2),
            ColorType::Grayscale,
            BitDepth::Eight,
            &[1, 2, 3, 4, 5, 6],
        );
        for length in 0..whole.len() - 12 {
            assert!(
                Values::from_bytes(&whole[..length], "cut").is_err(),
                "{length}"
            );
        }
    }
}
