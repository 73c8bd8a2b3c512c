//! Masks: the pixels at which a result is measured.

use anyhow::{Result, bail};

use super::values::Values;
use crate::scene::Mask;

/// A mask as it is stored, with its size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredMask {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// The pixels that count.
    pub pixels: Mask,
}

impl StoredMask {
    /// Reads a mask in memory, a PNG; `name` is for messages. Pixels count that have the largest value
    /// of the file's depth: 255, or 65,535 of 16 bits. If no value is larger than 1, pixels of 1
    /// count; and in 16 bits, if none is larger than 255, pixels of 255.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason: the file cannot be read, or no pixel counts.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self> {
        let stored = Values::from_bytes(bytes, name)?;
        let largest = stored.values.iter().copied().max().unwrap_or(0);
        let counting = match (largest, stored.wide) {
            (1, _) | (255, _) | (u16::MAX, true) => largest,
            (0, _) => bail!("{name}: no pixel of the mask counts, all are 0"),
            (_, wide) => bail!(
                "{name}: no pixel of the mask counts: the largest value is {largest}, and {} counts, \
                 or 1 in a mask of 0 and 1",
                if wide { u16::MAX } else { u8::MAX.into() }
            ),
        };
        let pixels: Vec<bool> = stored.values.iter().map(|&v| v == counting).collect();
        Ok(Self {
            width: stored.width,
            height: stored.height,
            pixels: pixels.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::values::tests::png;
    use super::*;
    use ::png::{BitDepth, ColorType};

    #[test]
    fn the_largest_value_counts() {
        let read = |depth, packed: &[u8]| {
            let bytes = png((4, 1), ColorType::Grayscale, depth, packed);
            StoredMask::from_bytes(&bytes, "nonocc.png").map(|mask| mask.pixels.to_vec())
        };
        let first = vec![true, false, false, false];
        assert_eq!(read(BitDepth::Eight, &[255, 128, 1, 0]).unwrap(), first);
        assert_eq!(read(BitDepth::Eight, &[1, 0, 0, 0]).unwrap(), first);
        assert_eq!(read(BitDepth::One, &[0b1000_0000]).unwrap(), first);
        let wide = |values: [u16; 4]| values.map(u16::to_be_bytes).concat();
        let sixteen = |values| read(BitDepth::Sixteen, &wide(values));
        assert_eq!(sixteen([65_535, 255, 128, 1]).unwrap(), first);
        assert_eq!(sixteen([255, 128, 1, 0]).unwrap(), first);
        assert_eq!(sixteen([1, 0, 0, 0]).unwrap(), first);
        for refused in [
            read(BitDepth::Eight, &[0; 4]),
            read(BitDepth::Eight, &[128, 128, 0, 2]),
            sixteen([256, 255, 1, 0]),
        ] {
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("nonocc.png: no pixel"), "{error}");
        }
        assert!(StoredMask::from_bytes(&[0xff, 0xd8, 0xff], "all.png").is_err());
    }
}
