//! The spread of the averages over several seeds: mean, standard deviation, smallest and largest.

use serde::Serialize;

use super::report::PresetReport;
use crate::escapes::shown_name;
use crate::metrics::mean;
use crate::tables::{percent, table};

/// The JSON that `--json` prints for several seeds.
#[derive(Debug, Serialize)]
pub(super) struct SpreadReport {
    seeds: Vec<u64>,
    presets: Vec<PresetSpread>,
}

/// The spread of one preset: of its average over the scenes, and of each scene.
#[derive(Debug, Serialize)]
struct PresetSpread {
    preset: String,
    average: Spread,
    scenes: Vec<SceneSpread>,
}

#[derive(Debug, Serialize)]
struct SceneSpread {
    scene: String,
    #[serde(flatten)]
    spread: Spread,
}

/// The spread of an average over the masks, percent of bad pixels.
#[derive(Debug, Serialize)]
struct Spread {
    mean: Option<f64>,
    /// Standard deviation of all seeds, as estimated from these; `None` of a single one.
    deviation: Option<f64>,
    smallest: Option<f64>,
    largest: Option<f64>,
}

impl Spread {
    /// Gathers the averages of all seeds.
    fn new(averages: impl Iterator<Item = Option<f64>>) -> Self {
        let averages: Vec<f64> = averages.flatten().collect();
        let centre = mean(averages.iter().copied());
        let deviation = centre.filter(|_| averages.len() > 1).map(|centre| {
            let squares = averages.iter().map(|average| (average - centre).powi(2));
            (squares.sum::<f64>() / (averages.len() - 1) as f64).sqrt()
        });
        Self {
            mean: centre,
            deviation,
            smallest: averages.iter().copied().reduce(f64::min),
            largest: averages.iter().copied().reduce(f64::max),
        }
    }
}

impl SpreadReport {
    /// Gathers the reports of several seeds. All must have the same presets and scenes, in
    /// the same order.
    pub(super) fn new(seeds: Vec<u64>, by_seed: &[Vec<PresetReport>]) -> Self {
        let first = by_seed.first().map_or(&[][..], Vec::as_slice);
        let presets = first.iter().enumerate().map(|(index, preset)| {
            let presets: Vec<&PresetReport> = by_seed
                .iter()
                .filter_map(|presets| presets.get(index))
                .collect();
            let scenes = preset.scenes.iter().enumerate().map(|(place, scene)| {
                let scenes = presets.iter().filter_map(|preset| preset.scenes.get(place));
                SceneSpread {
                    scene: scene.scene.clone(),
                    spread: Spread::new(scenes.map(|scene| scene.average)),
                }
            });
            PresetSpread {
                preset: preset.preset.clone(),
                average: Spread::new(presets.iter().map(|preset| preset.average)),
                scenes: scenes.collect(),
            }
        });
        Self {
            seeds,
            presets: presets.collect(),
        }
    }

    /// Returns the table of all presets and scenes, and a line below it that explains the
    /// figures.
    pub(super) fn table(&self, threshold_px: f32) -> String {
        let header = [
            "preset",
            "scene",
            "mean",
            "deviation",
            "smallest",
            "largest",
        ];
        let mut table = table(&header, 2);
        for preset in &self.presets {
            let scenes = preset.scenes.iter().map(|s| (s.scene.as_str(), &s.spread));
            for (name, spread) in scenes.chain([("average", &preset.average)]) {
                table.add_row([
                    preset.preset.clone(),
                    shown_name(name),
                    percent(spread.mean),
                    percent(spread.deviation),
                    percent(spread.smallest),
                    percent(spread.largest),
                ]);
            }
        }
        format!(
            "{table}\naverage over the masks of the bad pixels in percent, further than {threshold_px} px; {} seeds\n",
            self.seeds.len()
        )
    }
}
