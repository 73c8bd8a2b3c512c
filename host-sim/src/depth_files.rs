//! Depth maps as files.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use vgstereo_core::INVALID;
use vgstereo_core::geometry::Depth;

use crate::disparity_files::grey_png;
use crate::escapes::shown;
use crate::pfm::Pfm;

/// How depths are stored in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthFormat {
    /// A PNG of 16 bits: millimetres, 0 where there is none, as ROS's `16UC1` (REP 118).
    Png,
    /// A PFM: metres, NaN where there is none, as ROS's `32FC1`.
    Pfm,
}

impl DepthFormat {
    /// Chooses the format by the ending of a file's name.
    ///
    /// # Errors
    /// Fails with one line that names the file when it is neither `.png` nor `.pfm`.
    pub fn choose(path: &Path) -> Result<Self> {
        match path.extension().map(|ending| ending.to_ascii_lowercase()) {
            Some(ending) if ending == "png" => Ok(Self::Png),
            Some(ending) if ending == "pfm" => Ok(Self::Pfm),
            _ => bail!(
                "{}: the name of a depth map ends in .png (mm) or .pfm (m)",
                shown(path)
            ),
        }
    }

    /// Returns how the values of a file are to be read, in one phrase.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Png => "mm, 0 = none",
            Self::Pfm => "m, NaN = none",
        }
    }

    /// Returns the bytes of a file with the depths of these disparities, which are in 1/16 px,
    /// row-major, in lines of `width` px. A PNG has what [`Depth::mm`] gives; a PFM the quotient as
    /// it is, however large.
    ///
    /// # Errors
    /// Fails when the disparities are not whole lines.
    pub fn encode(self, disparities_q4: &[i16], width: u16, depth: &Depth) -> Result<Vec<u8>> {
        let columns = usize::from(width).max(1);
        ensure!(
            disparities_q4.len().is_multiple_of(columns),
            "the disparities do not fill the image"
        );
        let height = u32::try_from(disparities_q4.len() / columns)?;
        match self {
            Self::Png => {
                let depths = disparities_q4.iter().map(|&d| depth.mm(d));
                let bytes: Vec<u8> = depths.flat_map(u16::to_be_bytes).collect();
                let size = [width.into(), height];
                grey_png(&bytes, size, true, "Depth", self.meaning().to_owned())
            }
            Self::Pfm => {
                let values = disparities_q4.iter().map(|&d| metres(depth, d)).collect();
                let map = Pfm {
                    width: width.into(),
                    height,
                    values,
                };
                Ok(map.to_bytes())
            }
        }
    }
}

/// The depth of a disparity in 1/16 px, m; NaN where there is none.
fn metres(depth: &Depth, disparity_q4: i16) -> f32 {
    let denominator = f64::from(disparity_q4) * 16.0 + f64::from(depth.offset_q8());
    if disparity_q4 == INVALID || denominator <= 0.0 {
        return f32::NAN;
    }
    (f64::from(depth.numerator_q8()) / denominator / 1000.0) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_the_depths_of_the_quotient() {
        // 400 px and 50 mm: 20 m at 1 px; the right principal point lies 2 px further right.
        let depth = Depth::new(400 * 50 * 256, 2 * 256).unwrap();
        let map = [INVALID, 0, 8 * 16, 2 * 16, -2 * 16, -32 + 1];
        let png = DepthFormat::Png.encode(&map, 3, &depth).unwrap();
        let image = image::load_from_memory(&png).unwrap().into_luma16();
        assert_eq!(image.dimensions(), (3, 2));
        // The last is 1/16 px: 320 m are too far for the PNG.
        assert_eq!(image.into_raw(), [0, 10_000, 2_000, 5_000, 0, 0]);
        let pfm = DepthFormat::Pfm.encode(&map, 3, &depth).unwrap();
        let pfm = Pfm::from_bytes(&pfm, "depth.pfm").unwrap();
        let expected = [f32::NAN, 10.0, 2.0, 5.0, f32::NAN, 320.0];
        for (found, expected) in pfm.values.iter().zip(expected) {
            assert!(found.to_bits() == expected.to_bits() || (found - expected).abs() < 1e-5);
        }
        assert!(DepthFormat::Pfm.encode(&map, 4, &depth).is_err());
        assert!(DepthFormat::choose(Path::new("a.PNG")).is_ok());
        let error = DepthFormat::choose(Path::new("a.tif")).unwrap_err();
        assert!(error.to_string().contains("a.tif"));
    }
}
