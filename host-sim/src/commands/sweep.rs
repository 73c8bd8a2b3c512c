//! `vgstereo sweep`: measures bad pixels over the number of synapses and sigma, as in Figures 3
//! to 6 of the paper.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use clap::Args;
use plotters::prelude::*;
use rayon::prelude::*;
use serde::Serialize;
use vgstereo_core::{Output, Preset};

use crate::arguments::{Overrides, parse_preset, parse_threshold};
use crate::dataset::{ensure_distinct, find_scenes, scene_files};
use crate::escapes::{shown, shown_name};
use crate::files::{ensure_distinct_outputs, ensure_ending, write_files};
use crate::prepared::Prepared;
use crate::tables::{percent, table};
use crate::terminal::progress_bar;

/// The arguments of `vgstereo sweep`.
#[derive(Debug, Args)]
#[command(
    after_help = "The lists default to the paper's grid. Frames are matched in parallel, one per processor.\n\n\
    Example: vgstereo sweep middlebury teddy --synapses 16,64,256 --plot sweep.svg"
)]
pub struct Sweep {
    /// Folder of scenes, as for `eval`.
    dir: PathBuf,
    /// Scenes, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Preset whose parameters are varied.
    #[arg(long, value_name = "P", default_value_t = Preset::PaperRaw, value_parser = parse_preset)]
    preset: Preset,
    /// Numbers of synapses, separated by commas.
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "16,32,64,128,256,512,1024"
    )]
    synapses: Vec<u16>,
    /// Standard deviations of the offsets, px, separated by commas.
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "1,2,4,6,8,10"
    )]
    sigma: Vec<f32>,
    /// Seed of the synapses' offsets and of random ties [default: the preset's].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_threshold)]
    threshold: f32,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Plot the averages as SVG: one panel per scene, one curve per number of synapses.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

/// The JSON that `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    points: Vec<Point>,
}

/// The bad pixels of one scene with one number of synapses and one sigma, percent. A figure is
/// `None` when the scene does not have its mask.
#[derive(Debug, Clone, Serialize)]
struct Point {
    scene: String,
    synapses: u16,
    /// The standard deviation of the synapses' offsets, px.
    sigma: f32,
    nonocc: Option<f64>,
    all: Option<f64>,
    disc: Option<f64>,
    average: Option<f64>,
}

impl Sweep {
    /// Measures every point, writes the plot if it is wanted, and returns a table or JSON.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        if let Some(path) = &self.plot {
            ensure_ending(path, "svg")?;
        }
        ensure_distinct("number of synapses", &self.synapses)?;
        ensure_distinct("sigma", &self.sigma)?;
        let folders = find_scenes(&self.dir, &self.scenes)?;
        let inputs = scene_files(&folders)?;
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        let outputs: Vec<&Path> = self.plot.iter().map(PathBuf::as_path).collect();
        ensure_distinct_outputs(&inputs, &outputs).context("--plot")?;
        let scenes: Vec<Prepared> = folders
            .iter()
            .map(|folder| Prepared::load(folder, false))
            .collect::<Result<_>>()?;
        let grid: Vec<(&Prepared, u16, f32)> = scenes
            .iter()
            .flat_map(|scene| {
                let pairs = self
                    .synapses
                    .iter()
                    .flat_map(|&n| self.sigma.iter().map(move |&s| (n, s)));
                pairs.map(move |(synapses, sigma)| (scene, synapses, sigma))
            })
            .collect();
        let bar = progress_bar(grid.len() as u64, "matching");
        let points: Vec<Point> = grid
            .par_iter()
            .map(|&(scene, synapses, sigma)| {
                let point = self.point(scene, synapses, sigma);
                bar.inc(1);
                point
            })
            .collect::<Result<_>>()?;
        bar.finish_and_clear();
        if let Some(path) = &self.plot {
            let svg = plot(&points, &scenes).map_err(|e| anyhow!("cannot plot: {e}"))?;
            write_files(&[(path, svg.into_bytes())])?;
        }
        if self.json {
            return Ok(serde_json::to_string(&Report { points })? + "\n");
        }
        let mut text = self.results_table(&points, &scenes);
        if let Some(path) = &self.plot {
            text += &format!("wrote {}\n", shown(path));
        }
        Ok(text)
    }

    /// Matches and measures a scene with one number of synapses and one sigma.
    fn point(&self, scene: &Prepared, synapses: u16, sigma: f32) -> Result<Point> {
        let overrides = Overrides {
            synapses: Some(synapses),
            sigma: Some(sigma),
            seed: self.seed,
            ..Overrides::default()
        };
        let matched = scene.matched(overrides.apply(self.preset)?, Output::Dense, 1)?;
        let bad = scene.measure(&matched, self.threshold, false)?;
        Ok(Point {
            scene: scene.scene.name.clone(),
            synapses,
            sigma,
            nonocc: bad.nonocc,
            all: bad.all,
            disc: bad.disc,
            average: bad.average(),
        })
    }

    /// Returns a table with one row per scene and number of synapses, and one column per sigma.
    fn results_table(&self, points: &[Point], scenes: &[Prepared]) -> String {
        let sigmas: Vec<String> = self.sigma.iter().map(|s| format!("sigma {s}")).collect();
        let mut header = vec!["scene", "synapses"];
        header.extend(sigmas.iter().map(String::as_str));
        let mut table = table(&header, 1);
        let mut rows = points.chunks(self.sigma.len());
        for scene in scenes {
            for (synapses, row) in self.synapses.iter().zip(&mut rows) {
                let mut cells = vec![shown_name(&scene.scene.name), synapses.to_string()];
                cells.extend(row.iter().map(|point| percent(point.average)));
                table.add_row(cells);
            }
        }
        format!(
            "{table}\n{}: average over the masks of the bad pixels in percent, further than {} px\n",
            self.preset, self.threshold
        )
    }
}

/// Returns a plot of the averages over sigma as the text of an SVG file.
fn plot(points: &[Point], scenes: &[Prepared]) -> Result<String, Box<dyn std::error::Error>> {
    const PANEL: (u32, u32) = (460, 340);
    let columns = scenes.len().clamp(1, 2);
    let rows = scenes.len().div_ceil(columns).max(1);
    let size = (PANEL.0 * columns as u32, PANEL.1 * rows as u32);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        for (panel, scene) in root.split_evenly((rows, columns)).iter().zip(scenes) {
            let own: Vec<&Point> = points
                .iter()
                .filter(|point| point.scene == scene.scene.name)
                .collect();
            let errors = || own.iter().filter_map(|point| point.average);
            let sigmas = || own.iter().map(|point| f64::from(point.sigma));
            let low = errors().fold(f64::INFINITY, f64::min).min(100.0);
            let high = errors().fold(0.0, f64::max).max(low + 1.0);
            // Room for the legend beside the curves.
            let widest = sigmas().fold(1.0, f64::max);
            let mut chart = ChartBuilder::on(panel)
                .caption(shown_name(&scene.scene.name), ("sans-serif", 18))
                .margin(8)
                .x_label_area_size(36)
                .y_label_area_size(44)
                .build_cartesian_2d(0.0..widest * 1.3, (low - 1.0).max(0.0)..high + 1.0)?;
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(BLACK.mix(0.12))
                .x_desc("sigma, px")
                .y_desc("bad pixels, %")
                .draw()?;
            let mut counts: Vec<u16> = own.iter().map(|point| point.synapses).collect();
            counts.dedup();
            for (index, &synapses) in counts.iter().enumerate() {
                let position = index as f64 / (counts.len() - 1).max(1) as f64;
                let colour = colorous::VIRIDIS.eval_continuous(position * 0.9);
                let colour = RGBColor(colour.r, colour.g, colour.b);
                let mut curve: Vec<(f64, f64)> = own
                    .iter()
                    .filter(|point| point.synapses == synapses)
                    .filter_map(|point| Some((f64::from(point.sigma), point.average?)))
                    .collect();
                curve.sort_by(|a, b| a.0.total_cmp(&b.0));
                chart
                    .draw_series(LineSeries::new(curve, colour.stroke_width(2)).point_size(3))?
                    .label(format!("|W| = {synapses}"))
                    .legend(move |(x, y)| {
                        PathElement::new([(x, y), (x + 14, y)], colour.stroke_width(2))
                    });
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.8))
                .border_style(BLACK.mix(0.3))
                .draw()?;
        }
        root.present()?;
    }
    Ok(svg)
}
