//! The ranking of presets among published results on Middlebury v2.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use serde::Serialize;

use super::report::PresetReport;
use crate::escapes::shown;
use crate::metrics::mean;
use crate::prepared::Prepared;
use crate::published::{METHODS, SCENES, THRESHOLD_PX};
use crate::tables::{percent, table};

/// A preset or a published method with its bad pixels on the scenes of Middlebury v2, percent.
#[derive(Debug, Serialize)]
pub(super) struct Ranked {
    method: String,
    /// Whether the figures were published rather than measured in this run.
    published: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<&'static str>,
    average: f64,
    scenes: Vec<RankedScene>,
}

#[derive(Debug, Serialize)]
struct RankedScene {
    scene: &'static str,
    nonocc: f64,
    all: f64,
    disc: f64,
    average: f64,
}

impl RankedScene {
    fn new(scene: &'static str, [nonocc, all, disc]: [f64; 3]) -> Self {
        Self {
            scene,
            nonocc,
            all,
            disc,
            average: (nonocc + all + disc) / 3.0,
        }
    }
}

/// Refuses a threshold other than that of the published figures, and a list of folders that
/// lacks one of their scenes.
///
/// # Errors
/// Fails with one line that names the difference.
pub(super) fn ensure_comparable(threshold_px: f32, folders: &[PathBuf]) -> Result<()> {
    ensure!(
        threshold_px == THRESHOLD_PX,
        "--compare: the published figures are for a threshold of {THRESHOLD_PX} px, not {threshold_px}"
    );
    for scene in SCENES {
        ensure!(
            folders.iter().any(|folder| folder.ends_with(scene)),
            "--compare: the published figures are for {}; {scene} is not among the scenes",
            SCENES.join(", ")
        );
    }
    Ok(())
}

/// Refuses a scene of Middlebury v2 that does not have the mask of each published figure.
///
/// # Errors
/// Fails with one line that names the folder of the scene.
pub(super) fn ensure_has_masks(folder: &Path, scene: &Prepared) -> Result<()> {
    let is_of_v2 = SCENES.iter().any(|scene| folder.ends_with(scene));
    ensure!(
        !is_of_v2 || scene.has_all_masks(),
        "--compare needs nonocc.png, all.png and disc.png: {} has not all of them",
        shown(folder)
    );
    Ok(())
}

/// Returns the published methods and those presets that were measured on all scenes of
/// Middlebury v2, the smallest average first.
pub(super) fn rank(presets: &[PresetReport]) -> Vec<Ranked> {
    let measured = presets.iter().filter_map(|preset| {
        let scenes = SCENES.iter().map(|&name| {
            let scene = preset.scenes.iter().find(|scene| scene.scene == name)?;
            Some(RankedScene::new(
                name,
                [scene.nonocc?, scene.all?, scene.disc?],
            ))
        });
        let scenes = scenes.collect::<Option<Vec<_>>>()?;
        Some(Ranked {
            method: preset.preset.clone(),
            published: false,
            source: None,
            average: mean(scenes.iter().map(|scene| scene.average))?,
            scenes,
        })
    });
    let published = METHODS.iter().map(|method| Ranked {
        method: method.method.to_owned(),
        published: true,
        source: Some(method.source),
        average: method.average,
        scenes: SCENES
            .iter()
            .zip(method.bad_percent)
            .map(|(&name, masks)| RankedScene::new(name, masks))
            .collect(),
    });
    let mut ranked: Vec<Ranked> = measured.chain(published).collect();
    ranked.sort_by(|a, b| a.average.total_cmp(&b.average));
    ranked
}

/// Returns the table of a ranking, and a line below it that explains the figures.
pub(super) fn ranking_table(ranking: &[Ranked]) -> String {
    let mut header = vec!["method", "source"];
    header.extend(SCENES);
    header.push("average");
    let mut table = table(&header, 2);
    for method in ranking {
        let mut row = vec![
            method.method.clone(),
            method.source.unwrap_or("measured here").to_owned(),
        ];
        let averages = method.scenes.iter().map(|scene| scene.average);
        row.extend(
            averages
                .chain([method.average])
                .map(|value| percent(Some(value))),
        );
        table.add_row(row);
    }
    format!(
        "\n{table}\naverages over nonocc, all and disc; those with a source are published figures\n"
    )
}
