//! Portable float maps: one floating-point number per pixel, as Middlebury stores disparities.
//!
//! After a header of text, `Pf`, width and height, and a scale whose sign tells the order of the
//! bytes, come the pixels, lines from the bottom up.

use anyhow::{Context, Result, bail, ensure};

use crate::images::{PIXELS_MAX, SIDE_MAX_PX};

/// A map of numbers, row-major from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Pfm {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// The numbers of the pixels.
    pub values: Vec<f32>,
}

impl Pfm {
    /// Reads a file in memory; `name` is for messages. The magnitude of the scale is ignored, as
    /// Middlebury's own programs do.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason: the header is none of a grey map, the map is
    /// empty or too large, or there are too few or too many bytes.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        Self::parse(bytes).with_context(|| format!("cannot read {name}"))
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let mut rest = bytes;
        let mut word = || -> Result<&str> {
            let start = rest.iter().position(|byte| !byte.is_ascii_whitespace());
            let from_start = rest.get(start.unwrap_or(rest.len())..).unwrap_or_default();
            let length = from_start.iter().position(u8::is_ascii_whitespace);
            // One white-space character ends each word, the last one too.
            let (word, after) = from_start
                .split_at_checked(length.context("the header breaks off")?)
                .context("the header breaks off")?;
            rest = &after[1..];
            ensure!(word.len() <= 32, "it is not a portable float map");
            std::str::from_utf8(word).context("it is not a portable float map")
        };
        match word()? {
            "Pf" => {}
            "PF" => bail!("it is a float map in colour, not of one number per pixel"),
            _ => bail!("it is not a portable float map"),
        }
        let mut side = || -> Result<u32> {
            let px: u32 = word()?.parse().context("its size is not a number")?;
            ensure!(
                (1..=SIDE_MAX_PX).contains(&px),
                "its sides are not from 1 to {SIDE_MAX_PX} px"
            );
            Ok(px)
        };
        let (width, height) = (side()?, side()?);
        let pixels = u64::from(width) * u64::from(height);
        ensure!(pixels <= PIXELS_MAX, "it has more than {PIXELS_MAX} pixels");
        let scale: f32 = word()?.parse().context("its scale is not a number")?;
        ensure!(
            scale.is_finite() && scale != 0.0,
            "its scale, {scale}, does not tell the order of its bytes"
        );
        ensure!(
            rest.len() as u64 == 4 * pixels,
            "it has {} bytes of pixels, and {width}x{height} of them take {}",
            rest.len(),
            4 * pixels
        );
        let number = |bytes: &[u8; 4]| {
            if scale < 0.0 {
                f32::from_le_bytes(*bytes)
            } else {
                f32::from_be_bytes(*bytes)
            }
        };
        let lines = rest.as_chunks().0.chunks(width as usize).rev();
        Ok(Self {
            width,
            height,
            values: lines.flatten().map(number).collect(),
        })
    }

    /// Returns the bytes of a file with this map, in little-endian order.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = format!("Pf\n{} {}\n-1.0\n", self.width, self.height).into_bytes();
        for line in self.values.chunks(self.width.max(1) as usize).rev() {
            bytes.extend(line.iter().flat_map(|value| value.to_le_bytes()));
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_either_order_are_read_from_the_bottom_up() {
        let pixels = [1.0_f32, -2.5, f32::INFINITY, 4.0, 0.0, 6.5];
        for (scale, big) in [("-1.0", false), ("1.0", true), ("-0.003922", false)] {
            let mut bytes = format!("Pf\n3  2 \n{scale}\n").into_bytes();
            for value in pixels {
                bytes.extend(if big {
                    value.to_be_bytes()
                } else {
                    value.to_le_bytes()
                });
            }
            let map = Pfm::from_bytes(&bytes, "a.pfm").unwrap();
            assert_eq!((map.width, map.height), (3, 2));
            assert_eq!(map.values, [4.0, 0.0, 6.5, 1.0, -2.5, f32::INFINITY]);
            assert_eq!(Pfm::from_bytes(&map.to_bytes(), "b.pfm").unwrap(), map);
            for length in 0..bytes.len() {
                assert!(Pfm::from_bytes(&bytes[..length], "cut").is_err());
            }
            bytes.push(0);
            assert!(Pfm::from_bytes(&bytes, "long").is_err());
        }
    }

    #[test]
    fn what_is_no_map_is_refused_by_its_reason() {
        for (bytes, word) in [
            ("P5\n1 1\n-1\n1234", "not a portable float map"),
            ("PF\n1 1\n-1\n123412341234", "colour"),
            ("Pf\n0 1\n-1\n", "from 1 to"),
            ("Pf\n-1 1\n-1\n1234", "size"),
            ("Pf\n70000 1\n-1\n1234", "from 1 to"),
            ("Pf\n60000 60000\n-1\n1234", "pixels"),
            ("Pf\n1 1\n0\n1234", "order"),
            ("Pf\n1 1\nnan\n1234", "order"),
            ("Pf\n1 1\nx\n1234", "scale"),
            ("Pf 1 1", "breaks off"),
        ] {
            let error = format!(
                "{:#}",
                Pfm::from_bytes(bytes.as_bytes(), "a.pfm").unwrap_err()
            );
            assert!(
                error.contains(word) && error.contains("a.pfm"),
                "{bytes:?}: {error}"
            );
        }
    }
}
