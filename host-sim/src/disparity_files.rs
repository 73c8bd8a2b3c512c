//! Files of disparity maps: PNG and PGM with a scale, PFM with floating-point pixels.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use image::{DynamicImage, ImageBuffer, ImageFormat};
use vgstereo_core::{DisparityRange, INVALID, STEPS_PER_PX};

use crate::files::encode;

/// A file format for disparity maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DisparityFormat {
    /// Grey levels of 8 or 16 bits, as KITTI stores them: disparity x scale, rounded. The
    /// value 0 stands for no disparity, so a known disparity is stored as 1 at least.
    Scaled {
        /// The image format: PNG, or PGM as a form of PNM.
        container: ImageFormat,
        /// Steps per px of disparity.
        scale: f32,
        /// Whether levels have 16 bits rather than 8.
        wide: bool,
    },
    /// A portable float map, as Middlebury stores them: disparities in px, little-endian, lines
    /// from the bottom up. Infinity stands for no disparity.
    Pfm,
}

impl DisparityFormat {
    /// Returns the format for a file name that ends in `.png`, `.pgm` or `.pfm`.
    ///
    /// Without a scale, it takes the largest whole one with which the range fits 8 bits. Levels
    /// have 16 bits when the range needs them or the scale is 256 or more.
    ///
    /// # Errors
    /// Fails when the file name ends differently or the range does not fit the format.
    pub fn choose(path: &Path, scale: Option<f32>, range: DisparityRange) -> Result<Self> {
        let extension = path.extension().and_then(|extension| extension.to_str());
        let container = match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("png") => ImageFormat::Png,
            Some("pgm") => ImageFormat::Pnm,
            Some("pfm") => {
                ensure!(
                    scale.is_none(),
                    "{}: a .pfm file holds pixels as they are: leave --scale out",
                    path.display()
                );
                return Ok(Self::Pfm);
            }
            _ => bail!(
                "{}: the name must end in .png, .pgm or .pfm",
                path.display()
            ),
        };
        let range_px = range.range_px();
        ensure!(
            range_px.start >= 0,
            "{}: only a .pfm file can hold negative disparities",
            path.display()
        );
        let largest_px = (range_px.end - 1).max(1) as f32;
        let scale = scale.unwrap_or_else(|| (255.0 / largest_px).floor().max(1.0));
        ensure!(
            scale > 0.0 && largest_px * scale <= 65535.0,
            "{}: with --scale {scale} a disparity of {largest_px} px does not fit 16 bits",
            path.display()
        );
        Ok(Self::Scaled {
            container,
            scale,
            wide: scale >= 256.0 || largest_px * scale > 255.0,
        })
    }

    /// Returns the bytes of a file with these disparities, which are in 1/16 px, row-major, in
    /// lines of `width` px.
    ///
    /// # Errors
    /// Fails when the disparities are not whole lines.
    pub fn encode(self, disparities_q4: &[i16], width: u32) -> Result<Vec<u8>> {
        let height = u32::try_from(disparities_q4.len() / width.max(1) as usize)?;
        match self {
            Self::Pfm => Ok(pfm(disparities_q4, width, height)),
            Self::Scaled {
                container,
                scale,
                wide,
            } => {
                let values = disparities_q4.iter().map(|&d| scaled(d, scale));
                let image = if wide {
                    ImageBuffer::from_raw(width, height, values.collect())
                        .map(DynamicImage::ImageLuma16)
                } else {
                    let narrow = |value: u16| u8::try_from(value).unwrap_or(u8::MAX);
                    ImageBuffer::from_raw(width, height, values.map(narrow).collect())
                        .map(DynamicImage::ImageLuma8)
                };
                let image = image.context("the disparities do not fill the image")?;
                encode(&image, container)
            }
        }
    }
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

fn pfm(disparities_q4: &[i16], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    for line in disparities_q4.chunks(width.max(1) as usize).rev() {
        for &disparity_q4 in line {
            let px = if disparity_q4 == INVALID {
                f32::INFINITY
            } else {
                f32::from(disparity_q4) / f32::from(STEPS_PER_PX)
            };
            bytes.extend(px.to_le_bytes());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: DisparityRange = DisparityRange::up_to(59);

    fn choose(name: &str, scale: Option<f32>) -> Result<DisparityFormat> {
        DisparityFormat::choose(Path::new(name), scale, RANGE)
    }

    #[test]
    fn the_name_and_the_range_choose_the_format() {
        let png = |scale, wide| DisparityFormat::Scaled {
            container: ImageFormat::Png,
            scale,
            wide,
        };
        assert_eq!(choose("a.png", None).unwrap(), png(4.0, false));
        assert_eq!(choose("a.PNG", Some(1.0)).unwrap(), png(1.0, false));
        assert_eq!(choose("a.png", Some(256.0)).unwrap(), png(256.0, true));
        assert_eq!(choose("a.pfm", None).unwrap(), DisparityFormat::Pfm);
        assert!(choose("a.tif", None).is_err());
        assert!(choose("a", None).is_err());
        assert!(choose("a.png", Some(-1.0)).is_err());
        assert!(choose("a.png", Some(2000.0)).is_err());
        assert!(choose("a.pfm", Some(4.0)).is_err());
        let verged = DisparityRange {
            minimum_px: -5,
            count: 20,
        };
        assert!(DisparityFormat::choose(Path::new("a.pgm"), None, verged).is_err());
    }

    #[test]
    fn none_is_zero_and_a_known_disparity_is_not() {
        assert_eq!(scaled(INVALID, 256.0), 0);
        assert_eq!(scaled(0, 256.0), 1);
        assert_eq!(scaled(24, 256.0), 384);
        assert_eq!(scaled(24, 4.0), 6);
    }

    #[test]
    fn files_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let map = [INVALID, 0, 16, 40, 59 * 16, 8];
        for (name, expected) in [
            ("a.png", [0, 1, 4, 10, 236, 2]),
            ("a.pgm", [0, 1, 4, 10, 236, 2]),
        ] {
            let path = folder.path().join(name);
            let bytes = choose(name, None).unwrap().encode(&map, 3).unwrap();
            std::fs::write(&path, bytes).unwrap();
            let image = image::open(&path).unwrap();
            assert_eq!((image.width(), image.height()), (3, 2));
            assert_eq!(image.into_luma8().into_raw(), expected);
        }
        for name in ["b.png", "b.pgm"] {
            let path = folder.path().join(name);
            let format = choose(name, Some(256.0)).unwrap();
            std::fs::write(&path, format.encode(&map, 3).unwrap()).unwrap();
            let DynamicImage::ImageLuma16(image) = image::open(&path).unwrap() else {
                panic!("{name} has 16 bits");
            };
            assert_eq!(image.into_raw(), [0, 1, 256, 640, 59 * 256, 128]);
        }
        let bytes = DisparityFormat::Pfm.encode(&map, 3).unwrap();
        let (header, pixels) = bytes.split_at(b"Pf\n3 2\n-1.0\n".len());
        assert_eq!(header, b"Pf\n3 2\n-1.0\n");
        let pixels: Vec<f32> = pixels
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(pixels, [2.5, 59.0, 0.5, f32::INFINITY, 0.0, 1.0]);
    }
}
