//! `vgstereo` without a command: the demo, in which the built-in scene goes through simulated
//! camera, session and matcher.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use clap::{Args, ValueEnum, value_parser};
use image::ImageFormat;
use vgstereo_core::geometry::{Interpolation, Rectification, Rectifier};
use vgstereo_core::{Config, DisparityRange, Matcher, Preset, STEPS_PER_PX};
use vgstereo_firmware::camera::{Layout, LinePairSource, PixelFormat};
use vgstereo_firmware::{NoWatchdog, Session, session};
use vgstereo_kernels::NativeKernels;

use super::board::{write_board, write_wall};
use crate::calibration::{Maps, RectifiedPair, StereoCalibration};
use crate::camera::SimulatedCamera;
use crate::dataset::save_scene;
use crate::escapes::shown;
use crate::exposure::Exposure;
use crate::files::{encode, make_folder, write_files};
use crate::line_offset::LineOffset;
use crate::metrics::BadPixels;
use crate::pictures::{colour_disparities, error_map};
use crate::rectify::rectified;
use crate::render::{RenderOptions, SIDE_MAX_PX, SIDE_MIN_PX, render, render_distorted};
use crate::scene::Scene;
use crate::sink::FrameCollector;
use crate::tables::{kib, milliseconds, percent, table};
use crate::terminal::write_output;
use crate::views::{picture_of, views_of};

/// The usual threshold of the benchmark, px: disparities further from the ground truth are bad.
const THRESHOLD_PX: f32 = 1.0;

/// The arguments of the demo.
#[derive(Debug, Args)]
#[command(next_help_heading = "The demo's scene and camera")]
pub struct Demo {
    /// Folder for the pictures.
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Width of the views, px.
    #[arg(long, value_name = "PX", default_value_t = RenderOptions::default().width)]
    width: u32,
    /// Height of the views, px.
    #[arg(long, value_name = "PX", default_value_t = RenderOptions::default().height)]
    height: u32,
    /// Largest disparity in the scene and in the search, px, at most half the width.
    #[arg(long, value_name = "N", default_value_t = RenderOptions::default().d_max)]
    d_max: u16,
    /// Contrast of the surfaces' textures, 0 to 1: at 1 whole, at 0 even paint under light and
    /// shadow.
    #[arg(long, value_name = "X", default_value_t = RenderOptions::default().texture)]
    texture: f32,
    /// Standard deviation of the sensors' noise, grey levels.
    #[arg(long, value_name = "X", default_value_t = RenderOptions::default().noise)]
    noise: f32,
    #[command(flatten)]
    exposure: Exposure,
    #[command(flatten)]
    line_offset: LineOffset,
    /// See the scene through two real cameras, with distorted lenses, turned and rolled against each other;
    /// their raw lines are rectified first. The truth stays exact.
    #[arg(long)]
    distort: bool,
    /// Folder to write the scene to as well, with its truth and masks as `eval` reads them; with
    /// --distort also the calibration, for `eval --calibrated`.
    #[arg(long, value_name = "DIR")]
    scene: Option<PathBuf>,
    /// Only write pictures to calibrate the cameras of --distort by: a board of 10 by 7 squares of 40 mm in
    /// many poses, and left.yaml and right.yaml with the true calibration, to this folder.
    #[arg(long, value_name = "DIR", conflicts_with = "scene")]
    board: Option<PathBuf>,
    /// Number of poses of the board, 1 to 99.
    #[arg(long, value_name = "N", default_value_t = 20, requires = "board",
        value_parser = value_parser!(u32).range(1..=99))]
    poses: u32,
    /// Only write pairs of a flat textured wall, MM mm before the left camera and square to it, for `wall`:
    /// left_01.png, right_01.png and so on, to the folder of --out.
    #[arg(long, value_name = "MM", conflicts_with_all = ["board", "scene", "distort"])]
    wall: Option<f64>,
    /// Number of pairs of the wall, 1 to 99, which differ by the sensors' noise.
    #[arg(long, value_name = "N", default_value_t = 3, requires = "wall",
        value_parser = value_parser!(u32).range(1..=99))]
    frames: u32,
    /// How the two sensors share the wire.
    #[arg(long, value_enum, default_value_t = Wire::Separate)]
    layout: Wire,
    /// Pixel format on the wire.
    #[arg(long, value_enum, default_value_t = Pixels::Rgb888)]
    pixels: Pixels,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Wire {
    /// Each sensor has its own port.
    Separate,
    /// The left and the right line make one line of twice the width.
    SideBySide,
    /// The left line comes first, then the right line.
    LineMultiplexed,
    /// Left and right pixels alternate, the left one first.
    PixelMultiplexed,
}

impl From<Wire> for Layout {
    fn from(wire: Wire) -> Self {
        match wire {
            Wire::Separate => Self::Separate,
            Wire::SideBySide => Self::SideBySide,
            Wire::LineMultiplexed => Self::LineMultiplexed,
            Wire::PixelMultiplexed => Self::PixelMultiplexed { phase: 0 },
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Pixels {
    Grey8,
    Rgb888,
    Rgb565,
    Yuv422,
}

impl From<Pixels> for PixelFormat {
    fn from(pixels: Pixels) -> Self {
        match pixels {
            Pixels::Grey8 => Self::Grey8,
            Pixels::Rgb888 => Self::Rgb888,
            Pixels::Rgb565 => Self::Rgb565,
            Pixels::Yuv422 => Self::Yuv422,
        }
    }
}

/// The result of matching the scene with one preset.
struct Run {
    /// The disparity of each left pixel, 1/16 px, row-major.
    disparities_q4: Vec<i16>,
    time: Duration,
    /// The bytes of working memory of matcher and session.
    working_bytes: usize,
}

impl Demo {
    /// Renders the scene, matches it with every preset, writes the pictures and returns the
    /// table.
    ///
    /// # Errors
    /// Fails with one line that names the option or file and the reason.
    pub fn run(self) -> Result<String> {
        let sides = SIDE_MIN_PX..=SIDE_MAX_PX;
        ensure!(
            sides.contains(&self.width) && sides.contains(&self.height),
            "--width and --height must be from {SIDE_MIN_PX} to {SIDE_MAX_PX} px"
        );
        ensure!(
            self.d_max >= 1 && u32::from(self.d_max) <= self.width / 2,
            "--d-max must be from 1 to half the width, {}",
            self.width / 2
        );
        ensure!(
            self.noise.is_finite() && self.noise >= 0.0,
            "--noise must be a number from 0 on"
        );
        ensure!(
            (0.0..=1.0).contains(&self.texture),
            "--texture must be from 0 to 1"
        );
        ensure!(
            self.exposure.is_valid(),
            "--gain must be a number above 0 on every line, --gain-gradient, --offset and \
             --offset-gradient any numbers"
        );
        let options = RenderOptions {
            width: self.width,
            height: self.height,
            d_max: self.d_max,
            texture: self.texture,
            noise: self.noise,
            exposure: self.exposure,
            line_offset_px: self.line_offset.px,
            ..RenderOptions::default()
        };
        if let Some(folder) = &self.board {
            return write_board(folder, &options, self.poses);
        }
        if let Some(distance_mm) = self.wall {
            return write_wall(&self.out, &options, distance_mm, self.frames);
        }
        make_folder(&self.out)?;
        let (scene, calibration) = if self.distort {
            let (scene, calibration) = render_distorted(&options)?;
            (scene, Some(calibration))
        } else {
            (render(&options), None)
        };
        if let Some(folder) = &self.scene {
            save_scene(folder, &scene, calibration.as_ref())?;
        }
        let maps = match &calibration {
            Some(calibration) => Some(maps(calibration, &scene)?),
            None => None,
        };
        let rectification = maps
            .as_ref()
            .map(|maps| Rectification::from_bytes(&maps.bytes));
        let rectification = rectification.transpose()?;
        let truth = scene.truth.as_ref().context("the scene has its truth")?;
        let mut table = table(
            &[
                "preset",
                "nonocc",
                "all",
                "disc",
                "average",
                "KiB",
                "latency lines",
                "ms",
            ],
            1,
        );
        let mut last = Vec::new();
        for preset in Preset::ALL {
            let run = self.match_scene(&scene, rectification.as_ref(), preset)?;
            let bad = BadPixels::measure(&run.disparities_q4, truth, THRESHOLD_PX, false);
            table.add_row([
                preset.name().to_owned(),
                percent(bad.nonocc),
                percent(bad.all),
                percent(bad.disc),
                percent(bad.average()),
                kib(run.working_bytes),
                preset.parameters().latency_lines().to_string(),
                milliseconds(run.time),
            ]);
            last = run.disparities_q4;
        }
        let table_text = format!(
            "built-in scene, {}x{} px, disparities 0 to {}, fed line by line\n\n{table}\n\
             bad pixels in percent, further than {THRESHOLD_PX} px from the truth; KiB of working\n\
             memory, line buffers included, for any height; ms on one thread{}\n\n",
            self.width,
            self.height,
            scene.d_max,
            if cfg!(debug_assertions) {
                ",\nseveral times those of a build with --release"
            } else {
                ""
            }
        );
        let exact: Vec<i16> = truth
            .left_px
            .iter()
            // Disparities are in their range, so that they fit in 1/16 px.
            .map(|px| (px * f32::from(STEPS_PER_PX)).round() as i16)
            .collect();
        let range = DisparityRange::up_to(scene.d_max);
        let mut pictures = vec![
            ("left.png", scene.left.clone()),
            ("right.png", scene.right.clone()),
        ];
        if let Some(rectification) = &rectification {
            let views = views_of(scene.left.clone(), scene.right.clone(), false)?;
            let views = rectified(&views, rectification)?;
            pictures.push(("rectified_left.png", picture_of(&views, 0)?));
            pictures.push(("rectified_right.png", picture_of(&views, 1)?));
        }
        pictures.extend([
            ("truth.png", colour_disparities(&exact, self.width, range)),
            (
                "disparity.png",
                colour_disparities(&last, self.width, range),
            ),
            (
                "error.png",
                error_map(&last, self.width, truth, THRESHOLD_PX),
            ),
        ]);
        let mut files = Vec::new();
        for (name, picture) in pictures {
            let bytes = encode(&picture.into(), ImageFormat::Png)?;
            files.push((self.out.join(name), bytes));
        }
        // What was measured is told even if the pictures cannot be written.
        write_output(table_text.as_bytes())?;
        write_files(&files)?;
        let mut text = String::new();
        for (path, _) in &files {
            writeln!(text, "wrote {}", shown(path))?;
        }
        if let Some(folder) = &self.scene {
            writeln!(text, "wrote the scene to {}", shown(folder))?;
        }
        if let Some(preset) = Preset::ALL.last() {
            writeln!(
                text,
                "disparity.png and error.png are of the preset {preset}"
            )?;
        }
        Ok(text)
    }

    /// Matches one frame that the simulated camera sends through the session.
    fn match_scene(
        &self,
        scene: &Scene,
        rectification: Option<&Rectification<'_>>,
        preset: Preset,
    ) -> Result<Run> {
        let (left, right) = (scene.left.clone(), scene.right.clone());
        let mut camera = SimulatedCamera::new(left, right, self.layout.into(), self.pixels.into())?;
        let geometry = camera.geometry();
        let parameters = preset.parameters();
        let config = Config {
            colour: !geometry.format.is_grey(),
            ..Config::new(
                parameters,
                geometry.width,
                DisparityRange::up_to(scene.d_max),
            )
        };
        let mut matcher_memory = vec![0; config.memory_words()];
        let mut line_memory = vec![0; session::memory_words(&geometry)];
        let matcher = Matcher::new(&config, NativeKernels::fastest(), &mut matcher_memory)?;
        let words = rectification.map_or(0, |r| Rectifier::words(r, config.colour));
        let mut strip_memory = vec![0; words];
        let kernels = NativeKernels::fastest();
        let mut rectifier = match rectification {
            Some(r) => Some(Rectifier::new(
                *r,
                config.colour,
                kernels,
                &mut strip_memory,
            )?),
            None => None,
        };
        let rectifier = rectifier.as_mut();
        let mut sink = FrameCollector::new();
        let started = Instant::now();
        let lines = &mut line_memory;
        Session::rectifying(
            &mut camera,
            rectifier,
            matcher,
            &mut sink,
            lines,
            NoWatchdog,
        )?
        .run_frame()
        .map_err(|error| anyhow!("{error}"))?;
        let time = started.elapsed();
        let frame = sink.take_frame().context("the session finished a frame")?;
        Ok(Run {
            disparities_q4: frame.disparities_q4,
            time,
            working_bytes: (matcher_memory.len() + line_memory.len() + words) * size_of::<u32>(),
        })
    }
}

/// The maps that lead from the raw views of the scene to those of its truth.
fn maps(calibration: &StereoCalibration, scene: &Scene) -> Result<Maps> {
    let (width, height) = scene.left.dimensions();
    let size = [u16::try_from(width)?, u16::try_from(height)?];
    let pair = RectifiedPair::from_stored(calibration, size)?;
    let pair = pair.context("the calibration has its rectification")?;
    Maps::new(&pair, calibration.unit_mm, Interpolation::Bilinear)
}
