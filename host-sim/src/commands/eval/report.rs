//! The figures of presets on scenes: what the JSON holds and the table shows.

use serde::Serialize;

use crate::escapes::shown_name;
use crate::metrics::{BadPixels, ByConfidence, mean};
use crate::published::{PAPER, SCENES};
use crate::tables::{kib, percent, table};
use vgstereo_frame::Matched;

/// The figures of one preset on all scenes.
#[derive(Debug, Serialize)]
pub(super) struct PresetReport {
    /// The name of the preset.
    pub(super) preset: String,
    /// The mean of the scenes' averages, percent.
    pub(super) average: Option<f64>,
    /// The bad ones of the disparities found, percent, in each tenth of them over all scenes, from the least
    /// confident to the most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) tenths: Option<[f64; 10]>,
    /// The figures of each scene, in the order of the scenes.
    pub(super) scenes: Vec<SceneReport>,
}

/// The figures of one preset as they are gathered, scene by scene.
#[derive(Debug)]
pub(super) struct Gathered {
    pub(super) scenes: Vec<SceneReport>,
    /// The disparities found; none are counted unless that was asked for.
    pub(super) by_confidence: ByConfidence,
}

impl Gathered {
    /// Before any scene.
    pub(super) const NONE: Self = Self {
        scenes: Vec::new(),
        by_confidence: ByConfidence::NONE,
    };
}

/// The figures of one preset on one scene, or on one frame of a recording. Bad pixels are in percent; a
/// figure is `None` when the scene does not have its mask.
#[derive(Debug, Serialize)]
pub(super) struct SceneReport {
    /// The name of the scene or the number of the frame.
    pub(super) scene: String,
    /// The width of each view, px.
    pub(super) width: u32,
    /// The height of each view, px.
    pub(super) height: u32,
    /// The largest disparity searched, px.
    pub(super) d_max: u16,
    /// Bad pixels among those that both views show.
    pub(super) nonocc: Option<f64>,
    /// Bad pixels among all pixels to evaluate.
    pub(super) all: Option<f64>,
    /// Bad pixels among those near discontinuities.
    pub(super) disc: Option<f64>,
    /// The mean over the masks that the scene has.
    pub(super) average: Option<f64>,
    /// Pixels without a disparity, percent of the image.
    pub(super) invalid: f64,
    /// What matching took; `None` of what a board has matched.
    #[serde(flatten)]
    pub(super) cost: Option<Cost>,
}

/// What matching took.
#[derive(Debug, Serialize)]
pub(super) struct Cost {
    /// Time, s.
    pub(super) seconds: f64,
    /// Working memory of the matcher, bytes.
    pub(super) working_bytes: usize,
    /// Lines from a pair going in to its disparities coming out.
    pub(super) latency_lines: u32,
}

impl SceneReport {
    /// The figures of disparities of a scene of this name and size, px, of which `d_max` is the largest.
    pub(super) fn new(
        scene: &str,
        (width, height): (u32, u32),
        d_max: u16,
        bad: &BadPixels,
        cost: Option<Cost>,
    ) -> Self {
        Self {
            scene: scene.to_owned(),
            width,
            height,
            d_max,
            nonocc: bad.nonocc,
            all: bad.all,
            disc: bad.disc,
            average: bad.average(),
            invalid: bad.invalid,
            cost,
        }
    }
}

impl Cost {
    /// What matching a frame took.
    pub(super) fn of(matched: &Matched) -> Self {
        Self {
            seconds: matched.time.as_secs_f64(),
            working_bytes: matched.working_bytes,
            latency_lines: matched.latency_lines,
        }
    }
}

impl PresetReport {
    /// The figures of one preset; those by confidence if any were counted.
    pub(super) fn new(preset: &str, gathered: Gathered) -> Self {
        let scenes = gathered.scenes;
        Self {
            preset: preset.to_owned(),
            average: mean(scenes.iter().filter_map(|scene| scene.average)),
            tenths: gathered.by_confidence.tenths(),
            scenes,
        }
    }
}

/// Returns the table of all presets and scenes, and a line below it that explains the figures.
/// Rows of the paper's own figures follow for those scenes that it measured.
pub(super) fn results_table(presets: &[PresetReport], threshold_px: f32, sparse: bool) -> String {
    let mut table = table(
        &[
            "preset", "scene", "nonocc", "all", "disc", "average", "invalid", "ms", "KiB", "lines",
        ],
        2,
    );
    for preset in presets {
        for scene in &preset.scenes {
            let cost = scene.cost.as_ref();
            let of_cost = |shown: fn(&Cost) -> String| cost.map_or_else(|| "-".to_owned(), shown);
            table.add_row([
                preset.preset.clone(),
                shown_name(&scene.scene),
                percent(scene.nonocc),
                percent(scene.all),
                percent(scene.disc),
                percent(scene.average),
                percent(Some(scene.invalid)),
                of_cost(|cost| format!("{:.1}", cost.seconds * 1e3)),
                of_cost(|cost| kib(cost.working_bytes)),
                of_cost(|cost| cost.latency_lines.to_string()),
            ]);
        }
        table.add_row(average_row(&preset.preset, preset.average));
    }
    let measured = presets.first().map_or(&[][..], |preset| &preset.scenes);
    let published: Vec<_> = SCENES
        .iter()
        .zip(PAPER.bad_percent)
        .filter(|(name, _)| measured.iter().any(|scene| scene.scene == **name))
        .collect();
    for (name, masks) in &published {
        let mut row = vec!["published".to_owned(), (**name).to_owned()];
        row.extend(masks.iter().map(|&value| percent(Some(value))));
        row.push(percent(mean(masks.iter().copied())));
        table.add_row(row);
    }
    if published.len() == SCENES.len() {
        table.add_row(average_row("published", PAPER.mean()));
    }
    let among = if sparse {
        ", of the disparities found"
    } else {
        " or without a disparity"
    };
    let note = if published.is_empty() {
        ""
    } else {
        "; published: the paper's own figures"
    };
    format!(
        "{table}\nbad pixels in percent, further than {threshold_px} px from the truth{among}{note}\n"
    )
}

/// Returns the table of the bad disparities by confidence, with a line below it that explains the figures;
/// nothing if no preset has any.
pub(super) fn tenths_table(presets: &[PresetReport]) -> String {
    if presets.iter().all(|preset| preset.tenths.is_none()) {
        return String::new();
    }
    let header = ["preset", "1", "2", "3", "4", "5", "6", "7", "8", "9", "10"];
    let mut table = table(&header, 1);
    for preset in presets {
        let mut row = vec![preset.preset.clone()];
        let tenths = preset.tenths.into_iter().flatten();
        row.extend(tenths.map(|bad| percent(Some(bad))));
        table.add_row(row);
    }
    format!(
        "{table}\nbad pixels in percent of the disparities found, in each tenth of them from the least confident to the \
         most\n"
    )
}

/// Returns the row of an average over scenes, which has no figures per mask.
fn average_row(method: &str, average: Option<f64>) -> Vec<String> {
    let mut row = vec![method.to_owned(), "average".to_owned()];
    row.extend([String::new(), String::new(), String::new()]);
    row.push(percent(average));
    row
}
