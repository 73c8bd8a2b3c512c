//! `vgstereo ablate`: how accuracy, time and memory change when a preset lacks one of its stages.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use vgstereo_core::config::Voters;
use vgstereo_core::kernel::SubpixelStep;
use vgstereo_core::{Method, Output, Parameters, Preset, SgmParameters};

use crate::arguments::{parse_preset, parse_threshold};
use crate::dataset::find_scenes;
use crate::metrics::mean;
use crate::prepared::Prepared;
use crate::tables::{difference, kib, percent, table};
use crate::terminal::progress_bar;

/// The number of times that each scene is matched. The time of the fastest one is taken.
const REPEATS: usize = 3;

/// The arguments of `vgstereo ablate`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example: vgstereo ablate middlebury tsukuba venus teddy cones --preset balanced"
)]
pub struct Ablate {
    /// Folder of scenes, as for `eval`.
    dir: PathBuf,
    /// Scenes, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Preset whose stages are left out in turn: one that aggregates.
    #[arg(long, value_name = "P", default_value_t = Preset::Balanced, value_parser = parse_preset)]
    preset: Preset,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_threshold)]
    threshold: f32,
}

/// The name of a stage, and a function that leaves it out and returns whether it was there.
type Removal = (&'static str, fn(&mut SgmParameters) -> bool);

/// The stages in the order in which data pass them.
const REMOVALS: [Removal; 18] = [
    ("colour", |a| std::mem::replace(&mut a.colour, false)),
    ("smoothing", |a| std::mem::take(&mut a.smoothing_step) > 0),
    ("masks", |a| {
        std::mem::replace(&mut a.kept_cells_q8, 256) < 256
    }),
    ("truncation by evidence", |a| {
        std::mem::take(&mut a.evidence_q8) > 0
    }),
    ("difference of levels", |a| {
        std::mem::take(&mut a.difference_weight_q4) > 0
    }),
    ("alignment of lines", |a| {
        std::mem::take(&mut a.line_offset_max_lines) > 0
    }),
    ("brightness of lines", |a| {
        std::mem::take(&mut a.line_gain_max_q8) > 0
    }),
    ("adaptation to noise", |a| {
        std::mem::replace(&mut a.usual_difference_max, u8::MAX) < u8::MAX
    }),
    ("P2 adapted to edges", |a| {
        std::mem::take(&mut a.p2_adaptation_q4) > 0
    }),
    ("aggregation", |a| {
        // Without penalties, the cost of every path is that of its pixel alone.
        (a.p1, a.p2, a.p2_floor) = (0, 0, 0);
        true
    }),
    ("finer sub-pixel step", |a| {
        let parabola = SubpixelStep::PARABOLA;
        std::mem::replace(&mut a.subpixel, parabola) != parabola
    }),
    ("left-right check", |a| {
        std::mem::replace(&mut a.left_right_tolerance_px, u8::MAX) < u8::MAX
    }),
    ("ambiguity test", |a| {
        std::mem::replace(&mut a.margin, i16::MIN) > 0
    }),
    ("doubt of rivals", |a| a.rivals.take().is_some()),
    ("speckle removal", |a| a.speckle.take().is_some()),
    ("votes of every line", |a| {
        let voters = a.vote.as_mut().map(|vote| &mut vote.voters);
        voters.is_some_and(|voters| {
            std::mem::replace(voters, Voters::OtherLines) == Voters::EveryLine
        })
    }),
    ("vote", |a| a.vote.take().is_some()),
    ("weighted median", |a| a.weighted_median.take().is_some()),
];

impl Ablate {
    /// Measures the whole preset, and the preset without each of its stages, and returns a table.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        let parameters = self.preset.parameters();
        let Method::Sgm(whole) = parameters.method else {
            anyhow::bail!("--preset {}: it has no stages to leave out", self.preset);
        };
        let mut variants = vec![("nothing", parameters)];
        for (name, remove) in REMOVALS {
            let mut aggregation = whole;
            if remove(&mut aggregation) {
                let method = Method::Sgm(aggregation);
                variants.push((
                    name,
                    Parameters {
                        method,
                        ..parameters
                    },
                ));
            }
        }
        let scenes: Vec<Prepared> = find_scenes(&self.dir, &self.scenes)?
            .iter()
            .map(|folder| Prepared::load(folder, false))
            .collect::<Result<_>>()?;
        let bar = progress_bar((variants.len() * scenes.len()) as u64, "matching");
        let mut table = table(
            &["left out", "average", "change", "time", "KiB", "lines"],
            1,
        );
        let mut base: Option<(Option<f64>, f64)> = None;
        for (name, parameters) in variants {
            let mut averages = Vec::new();
            let (mut seconds, mut bytes) = (0.0, 0);
            for scene in &scenes {
                let mut fastest = f64::INFINITY;
                let mut matched = None;
                for _ in 0..REPEATS {
                    let run = scene.matched(parameters, Output::Dense, 1)?;
                    fastest = fastest.min(run.time.as_secs_f64());
                    matched = Some(run);
                }
                if let Some(matched) = matched {
                    averages.extend(scene.measure(&matched, self.threshold, false)?.average());
                    bytes = bytes.max(matched.working_bytes);
                }
                seconds += fastest;
                bar.inc(1);
            }
            let average = mean(averages.iter().copied());
            let (whole_average, whole_seconds) = *base.get_or_insert((average, seconds));
            let change = average.zip(whole_average).map(|(part, whole)| part - whole);
            table.add_row([
                name.to_owned(),
                percent(average),
                difference(change),
                format!("{:.2}", seconds / whole_seconds),
                kib(bytes),
                parameters.latency_lines().to_string(),
            ]);
        }
        bar.finish_and_clear();
        Ok(format!(
            "{table}\n{}: average of the bad pixels in percent, further than {} px; time relative to the whole;\n\
             KiB of the widest scene\n",
            self.preset, self.threshold
        ))
    }
}
