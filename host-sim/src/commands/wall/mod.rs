//! `vgstereo wall`: the figures of depth cameras, measured on a flat wall.

mod recorded;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use image::{ImageFormat, Rgb, RgbImage};
use vgstereo_core::geometry::{Rectification, RectifiedCamera};
use vgstereo_core::{Config, DisparityRange, Output, Parameters, Preset, Reference};
use vgstereo_kernels::NativeKernels;

use crate::arguments::{Overrides, name_of, parse_preset};
use crate::cameras::CameraOptions;
use crate::escapes::shown;
use crate::files::{encode, ensure_distinct_outputs, ensure_ending, write_files};
use crate::images::{ImageFile, ViewImages};
use crate::rectify::rectified;
use crate::tables::table;
use crate::terminal::progress_bar;
use crate::views::views_of;
use crate::wall::{Figures, Part, measure};
use vgstereo_frame::match_frame;

/// The arguments of `vgstereo wall`.
#[derive(Debug, Args)]
#[command(
    after_help = "Put the camera square before a flat wall with much texture, such as newspaper, at a distance that \
    you have measured from the left lens.\n\n\
    Fill rate: the pixels with a disparity. Z accuracy: the median of the points' distances less the true \
    one. RMS from the plane: the spatial noise; as a sub-pixel error, it is the same at every distance. \
    Temporal noise: the median over the pixels of the standard deviation from frame to frame; it takes several \
    pairs of the same view.\n\n\
    Pairs:        vgstereo wall left1.png right1.png left2.png right2.png --distance 1000 --focal 700 --baseline 60\n\
    A recording:  vgstereo wall walk.mcap --distance 1000\n\n\
    Of a recording, the disparities that the board found are judged, by the camera that it told; if it has none, its \
    pairs are matched here."
)]
pub struct Wall {
    /// Pairs of images of the wall: left, right, left, right, ...; or one recording of it.
    #[arg(required = true, value_name = "LEFT RIGHT")]
    images: Vec<PathBuf>,
    /// Frames of a recording that are judged, from the first on.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u16).range(1..))]
    frames: u16,
    /// True distance from the left camera to the wall, square to the wall, mm. Without it, the Z accuracy is
    /// left out.
    #[arg(long, value_name = "MM")]
    distance: Option<f64>,
    /// The middle part of the view that is judged, percent of its width and height.
    #[arg(long, value_name = "PERCENT", default_value_t = 40, value_parser = clap::value_parser!(u8).range(1..=100))]
    part: u8,
    /// Picture of each point's distance from the plane, as PNG: blue is nearer to the camera, red farther, black
    /// has no disparity.
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
    /// Largest disparity to search, px.
    #[arg(long, value_name = "N", default_value_t = 63)]
    d_max: u16,
    /// Preset; `vgstereo presets` lists them.
    #[arg(long, value_name = "P", default_value_t = Preset::Balanced, value_parser = parse_preset)]
    preset: Preset,
    #[command(flatten)]
    cameras: CameraOptions,
    #[command(flatten)]
    overrides: Overrides,
}

impl Wall {
    /// Matches the pairs and returns the figures as a table.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason. Nothing is written then.
    pub fn run(self) -> Result<String> {
        ensure!(
            self.distance.is_none_or(|mm| mm.is_finite() && mm > 0.0),
            "--distance must be above 0"
        );
        if let Some(path) = &self.residuals {
            ensure_ending(path, "png")?;
            let mut inputs: Vec<&Path> = self.images.iter().map(PathBuf::as_path).collect();
            inputs.extend(self.cameras.files());
            ensure_distinct_outputs(&inputs, &[path]).context("--residuals")?;
        }
        let judged = match &self.images[..] {
            [recording] => self.recorded(recording)?,
            _ => self.matched()?,
        };
        let Judged {
            what,
            frames,
            size: [width, height],
            camera,
            ..
        } = &judged;
        let (width, height) = (*width, *height);
        let part = Part::middle([width, height], f64::from(self.part) / 100.0);
        let figures = measure(frames, width, part, camera, self.distance)?;
        if let Some(path) = &self.residuals {
            let picture = residuals(&figures, part);
            write_files(&[(path, encode(&picture.into(), ImageFormat::Png)?)])?;
        }
        let mut text = format!(
            "{what} of {width}x{height} px, the middle {}x{} px\n{}\n",
            part.size[0],
            part.size[1],
            as_text(&figures)
        );
        if self.distance.is_none() {
            text += "Z accuracy is left out: --distance tells the true distance\n";
        }
        if figures.temporal_noise_mm.is_none() {
            text += "temporal noise is left out: it takes several pairs of the same view\n";
        }
        text += &judged.notes;
        if let Some(path) = &self.residuals {
            text += &format!("wrote {}\n", shown(path));
        }
        Ok(text)
    }

    /// Matches the pairs of images.
    fn matched(&self) -> Result<Judged> {
        ensure!(
            self.images.len().is_multiple_of(2),
            "{} images: a pair has a left and a right one",
            self.images.len()
        );
        let (pairs, _) = self.images.as_chunks::<2>();
        let parameters = self.overrides.apply(self.preset)?;
        let [first, _] = pairs.first().context("there is no pair")?;
        let raw_size = ImageFile::open(first)?.dimensions();
        let cameras = self.cameras.read(Some(raw_size))?;
        let rectification = cameras.rectification.as_deref();
        let rectification = rectification.map(Rectification::from_bytes).transpose()?;
        let (width, height) = match &rectification {
            Some(r) => (r.width, u32::from(r.height)),
            None => (u16::try_from(raw_size.0)?, raw_size.1),
        };
        let config = self.config(parameters, width, first)?;
        let camera = self.cameras.camera(
            "wall",
            rectification.as_ref(),
            &cameras.warnings,
            [width.into(), height],
            Reference::Left,
        )?;
        let bar = progress_bar(pairs.len() as u64, "pairs of the wall");
        let frames: Result<Vec<_>> = pairs
            .iter()
            .map(|pair| {
                let matched = matched(pair, raw_size, rectification.as_ref(), &config);
                bar.inc(1);
                matched.with_context(|| shown(&pair[0]).to_string())
            })
            .collect();
        bar.finish_and_clear();
        let frames = frames?;
        let pairs = match frames.len() {
            1 => "1 pair".to_owned(),
            count => format!("{count} pairs"),
        };
        Ok(Judged {
            what: format!("{}, {pairs}", name_of(&parameters, self.preset)),
            frames,
            size: [width.into(), height as usize],
            camera,
            notes: String::new(),
        })
    }

    /// What the search is configured by, in lines of `width` px of this file.
    fn config(&self, parameters: Parameters, width: u16, file: &Path) -> Result<Config> {
        let disparities = DisparityRange::up_to(self.d_max);
        ensure!(
            self.d_max < width && disparities.fits(width),
            "--d-max {} is not smaller than the width of {}, {width} px, or above 2047",
            self.d_max,
            shown(file)
        );
        let config = Config {
            output: Output::Sparse,
            ..Config::new(parameters, width, disparities)
        };
        config.validate()?;
        Ok(config)
    }
}

/// What is judged.
struct Judged {
    /// What it is, in words.
    what: String,
    /// Disparities of each frame, 1/16 px, row-major.
    frames: Vec<Vec<i16>>,
    /// Columns and lines, px.
    size: [usize; 2],
    /// The camera that they are seen with.
    camera: RectifiedCamera,
    /// What else there is to say, a line each.
    notes: String,
}

/// Matches a pair of images of this size, px, and returns its disparities, 1/16 px, row-major.
fn matched(
    [left, right]: &[PathBuf; 2],
    raw_size: (u32, u32),
    rectification: Option<&Rectification<'_>>,
    config: &Config,
) -> Result<Vec<i16>> {
    let (left, right) = (ImageFile::open(left)?, ImageFile::open(right)?);
    ensure!(
        left.dimensions() == raw_size,
        "the pair is not as large as the first"
    );
    let images = ViewImages::decode(&left, &right, None)?;
    let mut views = views_of(images.left, images.right, false)?;
    if let Some(rectification) = rectification {
        views = rectified(&views, rectification)?;
    }
    let config = Config {
        colour: views.has_colour(),
        ..*config
    };
    let matched = match_frame(&config, &views, NativeKernels::fastest(), 2)?;
    Ok(matched.disparities_q4)
}

fn as_text(figures: &Figures) -> String {
    let plane = &figures.plane;
    let relative = |mm: f64| format!("{:.2} % of the distance", 100.0 * mm / plane.distance_mm);
    let mut table = table(&["figure", "value", ""], 3);
    let mut row = |name: &str, value: String, also: String| {
        table.add_row([name.to_owned(), value, also]);
    };
    row(
        "distance of the plane",
        format!("{:.1} mm", plane.distance_mm),
        format!("{:.2} degrees from square", plane.tilt_degrees),
    );
    row(
        "fill rate",
        format!("{:.1} %", figures.fill_percent),
        String::new(),
    );
    if let Some(mm) = figures.z_accuracy_mm {
        row("Z accuracy", format!("{mm:+.1} mm"), relative(mm));
    }
    row(
        "RMS from the plane",
        format!("{:.2} mm", plane.rms_mm),
        relative(plane.rms_mm),
    );
    row(
        "sub-pixel RMS",
        format!("{:.3} px", plane.subpixel_rms_px),
        String::new(),
    );
    if let Some(mm) = figures.temporal_noise_mm {
        row("temporal noise", format!("{mm:.2} mm"), relative(mm));
    }
    table.to_string()
}

/// A picture of the residuals: three times their RMS is the end of the scale.
fn residuals(figures: &Figures, part: Part) -> RgbImage {
    let scale_mm = (3.0 * figures.plane.rms_mm).max(f64::MIN_POSITIVE);
    let [columns, lines] = part.size.map(|side| side as u32);
    RgbImage::from_fn(columns, lines, |x, y| {
        let at = y as usize * part.size[0] + x as usize;
        let Some(mm) = figures.residuals_mm.get(at).copied().flatten() else {
            return Rgb([0, 0, 0]);
        };
        let position = 0.5 - 0.5 * (mm / scale_mm).clamp(-1.0, 1.0);
        let colour = colorous::RED_BLUE.eval_continuous(position);
        Rgb([colour.r, colour.g, colour.b])
    })
}
