//! Files of disparity maps: PNG and PGM with a scale, which they state, and PFM with floating-point
//! pixels.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use vgstereo_core::{DisparityRange, INVALID, STEPS_PER_PX};

use crate::escapes::shown;
use crate::pfm::Pfm;

/// A file format for disparity maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DisparityFormat {
    /// Grey levels of 8 or 16 bits, as KITTI stores them: disparity x scale, rounded. The
    /// value 0 stands for no disparity, so a known disparity is stored as 1 at least.
    Scaled {
        /// The image format.
        container: Container,
        /// Steps per px of disparity.
        scale: f32,
        /// Whether levels have 16 bits rather than 8.
        wide: bool,
    },
    /// A portable float map, as Middlebury stores them: disparities in px, little-endian, lines
    /// from the bottom up. Infinity stands for no disparity.
    Pfm,
}

/// An image format of grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Container {
    /// PNG; a text chunk, `Disparity`, states the scale.
    Png,
    /// A portable grey map, of kind P5; a comment states the scale.
    Pgm,
}

/// Smallest scale, steps per px: the disparities of a map of 2047 px still have levels apart.
const SCALE_MIN: f32 = 1.0 / 64.0;
/// Scale of 16 bits unless the range is too long for it.
const SCALE_WIDE: f32 = 256.0;

impl DisparityFormat {
    /// Returns the format for a file name that ends in `.png`, `.pgm` or `.pfm`; `-`, which stands for
    /// standard output, is a PFM.
    ///
    /// Without a scale, levels have 16 bits and 256 steps per px, or the largest power of two
    /// with which the range fits: steps of 1/16 px are never rounded. With a scale, they have
    /// 8 bits where the range fits them and the scale is below 256.
    ///
    /// # Errors
    /// Fails when the file name ends differently or the range does not fit the format.
    pub fn choose(path: &Path, scale: Option<f32>, range: DisparityRange) -> Result<Self> {
        let extension = path.extension().and_then(|extension| extension.to_str());
        let container = match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("png") => Container::Png,
            Some("pgm") => Container::Pgm,
            Some("pfm") => return Self::pfm_without(scale, path),
            None if path == Path::new("-") => return Self::pfm_without(scale, path),
            _ => bail!("{}: the name must end in .png, .pgm or .pfm", shown(path)),
        };
        let range_px = range.range_px();
        ensure!(
            range_px.start >= 0,
            "{}: only a .pfm file can hold negative disparities",
            shown(path)
        );
        let largest_px = (range_px.end - 1).max(1) as f32;
        let most = f32::from(u16::MAX) / largest_px;
        let Some(scale) = scale else {
            // Disparities are below 2048 px, so that 16 steps always fit.
            let mut powers = (0..4).map(|halvings| SCALE_WIDE / (1 << halvings) as f32);
            return Ok(Self::Scaled {
                container,
                scale: powers.find(|&scale| scale <= most).unwrap_or(16.0),
                wide: true,
            });
        };
        ensure!(
            (SCALE_MIN..=most).contains(&scale),
            "{}: --scale {scale} is not from {SCALE_MIN} to {most}, with which {largest_px} px still fit 16 bits",
            shown(path)
        );
        Ok(Self::Scaled {
            container,
            scale,
            wide: scale >= SCALE_WIDE || largest_px * scale > 255.0,
        })
    }

    fn pfm_without(scale: Option<f32>, path: &Path) -> Result<Self> {
        ensure!(
            scale.is_none(),
            "{}: a PFM holds pixels as they are: leave --scale out",
            shown(path)
        );
        Ok(Self::Pfm)
    }

    /// Returns how the values of a file are to be read, in one phrase.
    #[must_use]
    pub fn meaning(self) -> String {
        match self {
            Self::Scaled { scale, .. } => format!("px = value / {scale}, 0 = none"),
            Self::Pfm => "px, infinity = none".to_owned(),
        }
    }

    /// Returns the bytes of a file with these disparities, which are in 1/16 px, row-major, in
    /// lines of `width` px.
    ///
    /// # Errors
    /// Fails when the disparities are not whole lines.
    pub fn encode(self, disparities_q4: &[i16], width: u32) -> Result<Vec<u8>> {
        let height = disparities_q4.len() / width.max(1) as usize;
        ensure!(
            height * width as usize == disparities_q4.len(),
            "the disparities do not fill the image"
        );
        let height = u32::try_from(height)?;
        let Self::Scaled {
            container,
            scale,
            wide,
        } = self
        else {
            let px = |&disparity_q4: &i16| match disparity_q4 {
                INVALID => f32::INFINITY,
                known => f32::from(known) / f32::from(STEPS_PER_PX),
            };
            let values = disparities_q4.iter().map(px).collect();
            let map = Pfm {
                width,
                height,
                values,
            };
            return Ok(map.to_bytes());
        };
        let values = disparities_q4.iter().map(|&d| scaled(d, scale));
        let bytes: Vec<u8> = if wide {
            // Both formats store the upper byte first.
            values.flat_map(u16::to_be_bytes).collect()
        } else {
            let narrow = |value: u16| u8::try_from(value).unwrap_or(u8::MAX);
            values.map(narrow).collect()
        };
        match container {
            Container::Png => grey_png(&bytes, [width, height], wide, "Disparity", self.meaning()),
            Container::Pgm => {
                let largest = if wide { u16::MAX } else { u8::MAX.into() };
                let header = format!("P5\n# {}\n{width} {height}\n{largest}\n", self.meaning());
                Ok([header.into_bytes(), bytes].concat())
            }
        }
    }
}

/// Returns the bytes of a grey PNG with a text of this name that says what its values mean. They
/// have 16 bits if they are `wide`, the upper byte first.
///
/// # Errors
/// Fails when there are more or fewer than the size needs.
pub fn grey_png(
    levels: &[u8],
    [width, height]: [u32; 2],
    wide: bool,
    name: &str,
    meaning: String,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(if wide {
        png::BitDepth::Sixteen
    } else {
        png::BitDepth::Eight
    });
    // With little compression: more would take longer than matching does.
    encoder.set_compression(png::Compression::Fast);
    encoder.add_text_chunk(name.to_owned(), meaning)?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(levels)?;
    writer.finish()?;
    Ok(bytes)
}

/// Returns the level that stands for a disparity; 0 for [`INVALID`].
fn scaled(disparity_q4: i16, scale: f32) -> u16 {
    if disparity_q4 == INVALID {
        return 0;
    }
    let value = f32::from(disparity_q4) / f32::from(STEPS_PER_PX) * scale;
    // A saturating cast of a value that is at least 1.
    value.round().max(1.0) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::DynamicImage;

    const RANGE: DisparityRange = DisparityRange::up_to(59);

    fn choose(name: &str, scale: Option<f32>) -> Result<DisparityFormat> {
        DisparityFormat::choose(Path::new(name), scale, RANGE)
    }

    #[test]
    fn the_name_and_the_range_choose_the_format() {
        let png = |scale, wide| DisparityFormat::Scaled {
            container: Container::Png,
            scale,
            wide,
        };
        assert_eq!(choose("a.png", None).unwrap(), png(256.0, true));
        assert_eq!(choose("a.PNG", Some(1.0)).unwrap(), png(1.0, false));
        assert_eq!(choose("a.png", Some(4.0)).unwrap(), png(4.0, false));
        assert_eq!(choose("a.png", Some(256.0)).unwrap(), png(256.0, true));
        assert_eq!(choose("a.pfm", None).unwrap(), DisparityFormat::Pfm);
        assert_eq!(choose("-", None).unwrap(), DisparityFormat::Pfm);
        assert!(choose("a.tif", None).is_err());
        assert!(choose("a", None).is_err());
        assert!(choose("a.pfm", Some(4.0)).is_err());
        for scale in [0.0, -1.0, 1e-45, 2000.0, f32::INFINITY, f32::NAN] {
            let error = choose("a.png", Some(scale)).unwrap_err().to_string();
            assert!(error.contains("0.015625 to 1110.7"), "{scale}: {error}");
        }
        let verged = DisparityRange {
            minimum_px: -5,
            count: 20,
        };
        assert!(DisparityFormat::choose(Path::new("a.pgm"), None, verged).is_err());
    }

    #[test]
    fn sixteen_bits_hold_every_sixteenth() {
        for d_max in [0, 15, 255, 256, 511, 512, 2046] {
            let range = DisparityRange::up_to(d_max);
            let format = DisparityFormat::choose(Path::new("a.png"), None, range).unwrap();
            let DisparityFormat::Scaled { scale, wide, .. } = format else {
                panic!("a PNG has a scale");
            };
            assert!(wide && scale % 16.0 == 0.0, "{d_max}: {scale}");
            // From 1/16 px on, as 0 is none.
            for disparity_q4 in 1..=(d_max * 16).cast_signed() {
                let level = f32::from(scaled(disparity_q4, scale));
                assert_eq!(level / scale * 16.0, f32::from(disparity_q4));
            }
        }
    }

    #[test]
    fn none_is_zero_and_a_known_disparity_is_not() {
        assert_eq!(scaled(INVALID, 256.0), 0);
        assert_eq!(scaled(0, 256.0), 1);
        assert_eq!(scaled(24, 256.0), 384);
        assert_eq!(scaled(24, 4.0), 6);
    }

    const MAP: [i16; 6] = [INVALID, 0, 16, 40, 59 * 16, 8];

    #[test]
    fn files_read_back_by_another_reader() {
        for name in ["a.png", "a.pgm"] {
            let bytes = choose(name, Some(4.0)).unwrap().encode(&MAP, 3).unwrap();
            let image = image::load_from_memory(&bytes).unwrap();
            assert_eq!((image.width(), image.height()), (3, 2));
            assert_eq!(image.into_luma8().into_raw(), [0, 1, 4, 10, 236, 2]);
            let bytes = choose(name, None).unwrap().encode(&MAP, 3).unwrap();
            let DynamicImage::ImageLuma16(image) = image::load_from_memory(&bytes).unwrap() else {
                panic!("{name} has 16 bits");
            };
            assert_eq!(image.into_raw(), [0, 1, 256, 640, 59 * 256, 128]);
        }
        let bytes = DisparityFormat::Pfm.encode(&MAP, 3).unwrap();
        let (header, pixels) = bytes.split_at(b"Pf\n3 2\n-1.0\n".len());
        assert_eq!(header, b"Pf\n3 2\n-1.0\n");
        let pixels: Vec<f32> = pixels
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(pixels, [2.5, 59.0, 0.5, f32::INFINITY, 0.0, 1.0]);
        assert!(DisparityFormat::Pfm.encode(&MAP, 4).is_err());
    }

    #[test]
    fn files_state_their_scale() {
        let bytes = choose("a.png", Some(2.5)).unwrap().encode(&MAP, 3).unwrap();
        let reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        let texts = &reader.info().uncompressed_latin1_text;
        let text = texts
            .iter()
            .find(|text| text.keyword == "Disparity")
            .unwrap();
        assert_eq!(text.text, "px = value / 2.5, 0 = none");
        let bytes = choose("a.pgm", None).unwrap().encode(&MAP, 3).unwrap();
        let header = b"P5\n# px = value / 256, 0 = none\n3 2\n65535\n";
        assert_eq!(&bytes[..header.len()], header);
        assert_eq!(bytes.len(), header.len() + 12);
    }
}
