//! From calibration files to the rectification of a pair.

use anyhow::{Context, Result, anyhow, ensure};

use super::check::checked;
use super::maps::Maps;
use super::read::read;
use super::rectified::{Keep, RectifiedPair};
use super::stereo::StereoCalibration;

/// What the files leave open.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Width and height of the raw views, px; `None`: as the files state.
    pub size: Option<[u16; 2]>,
    /// Width and height of the rectified views, px; `None`: those of the raw views.
    pub view_size: Option<[u16; 2]>,
    /// The part of the scene to keep; `None`: as the files' own rectification has it, or else
    /// [`Keep::Valid`].
    pub keep: Option<Keep>,
    /// Projections of the left and the right rectified view, 3 by 4 and row-major, instead of those that
    /// would be chosen.
    pub projections: Option<[[f64; 12]; 2]>,
    /// Millimetres in the unit of the files' translation; `None`: as the format has it.
    pub unit_mm: Option<f64>,
    /// Pixels that the camera joins in each direction, against the files.
    pub binned: Option<u16>,
}

/// A pair that can be rectified.
#[derive(Debug, Clone)]
pub struct Rectified {
    /// The calibration with its warnings.
    pub calibration: StereoCalibration,
    /// The geometry of the rectified views.
    pub pair: RectifiedPair,
    /// The maps for the core.
    pub maps: Maps,
    /// Whether the rectification is the files' own.
    pub is_stored: bool,
}

/// Makes the rectification of a pair from the names and the contents of its calibration files.
///
/// # Errors
/// Fails with one line that names the file or option and the reason.
pub fn rectify(files: &[(String, Vec<u8>)], options: &Options) -> Result<Rectified> {
    let mut calibration = read(files)?;
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let names = names.join(", ");
    if let Some(factor) = options.binned {
        calibration = calibration.binned(factor).context("--binned")?;
    }
    if let Some(unit_mm) = options.unit_mm {
        calibration.unit_mm = Some(unit_mm);
    }
    let (mut calibration, raw_size) =
        checked(calibration, options.size).with_context(|| names.clone())?;
    let size = options.view_size.unwrap_or(raw_size);
    let stored = match RectifiedPair::from_stored(&calibration, raw_size) {
        Ok(stored) => stored,
        Err(reason) => {
            calibration.warnings.push(format!(
                "the rectification in the files is not used, it contradicts R and T or itself: {reason}"
            ));
            None
        }
    };
    let crop = match options.keep {
        Some(Keep::Crop(crop)) => Some(crop),
        _ => None,
    };
    ensure!(
        crop.is_none() || options.view_size.is_none(),
        "--view-size: the part that --keep gives has a size already"
    );
    let uses_stored = matches!(options.keep, None | Some(Keep::Crop(_))) && size == raw_size;
    let (mut pair, is_stored) = match (stored, options.projections) {
        (Some(stored), None) if uses_stored => (stored, true),
        (_, projections) => {
            let all = options.keep == Some(Keep::All);
            let computed = RectifiedPair::compute(&calibration, raw_size, size, all)
                .with_context(|| names.clone())?;
            match projections {
                Some(projections) => {
                    let given = RectifiedPair::from_projections(
                        &calibration,
                        computed.rotations,
                        projections,
                        size,
                    )?;
                    let baseline = computed.baseline;
                    (
                        RectifiedPair {
                            raw_size,
                            baseline,
                            ..given
                        },
                        false,
                    )
                }
                None => (computed, false),
            }
        }
    };
    if let Some(crop) = crop {
        pair = pair.cropped(crop).context("--keep")?;
    }
    let maps = Maps::new(&pair, calibration.unit_mm).map_err(|reason| {
        // What was warned of may well be the cause.
        let warnings = calibration.warnings.iter();
        let warnings: String = warnings.map(|warning| format!("; {warning}")).collect();
        anyhow!("{names}: {reason:#}{warnings}")
    })?;
    if let Some(share) = maps.valid.iter().copied().reduce(f64::min)
        && share < 0.5
    {
        calibration.warnings.push(format!(
            "{:.0} % of a rectified view are seen by its camera: are the calibration and --keep right?",
            share * 100.0
        ));
    }
    Ok(Rectified {
        calibration,
        pair,
        maps,
        is_stored,
    })
}
