//! `vgstereo match`: matches a pair of images, rectified before or by a calibration, and writes maps
//! of disparity and depth, points and scans.

use std::fmt::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use image::ImageFormat;
use vgstereo_core::geometry::{LaserScan, Rectification};
use vgstereo_core::{Config, DisparityRange, Preset, Reference};
use vgstereo_kernels::NativeKernels;

use crate::arguments::{Overrides, ScanOptions, name_of, output_of, parse_preset};
use crate::cameras::CameraOptions;
use crate::depth_files::DepthFormat;
use crate::disparity_files::{DisparityFormat, grey_png};
use crate::escapes::shown;
use crate::files::{encode, ensure_distinct_outputs, ensure_ending, make_folder, write_files};
use crate::frame::match_frame;
use crate::images::{bits_note, parse_bits};
use crate::pair_check::hints;
use crate::pair_files::PairArguments;
use crate::pictures::colour_disparities;
use crate::point_files::PointFormat;
use crate::rectify::rectified;
use crate::scan_files::ScanFormat;
use crate::tables::{kib, milliseconds};
use crate::terminal::{Said, write_output};
use crate::views::Views;

/// The largest disparity that is searched when `--d-max` is not given, px.
const DEFAULT_D_MAX: u16 = 63;

/// The arguments of `vgstereo match`.
#[derive(Debug, Args)]
#[command(
    after_help = "Left column x matches right column x - d. The map is of the reference view.\n\n\
    A rectified pair:    vgstereo match left.png right.png --out disparity.png --d-max 59 --colour colour.png\n\
    Two cameras as are:  vgstereo match left.png right.png --calibration intrinsics.yml extrinsics.yml \\\n\
    \x20                    --unit mm --out disparity.png --depth depth.png\n\
    A cloud of points:   vgstereo match left.png right.png --focal 700 --baseline 60 \\\n\
    \x20                    --out disparity.png --points cloud.ply\n\
    Both in one image:   vgstereo match both.png --side-by-side --out disparity.png\n\
    \x20                    vgstereo match both.png --top-bottom --out disparity.png"
)]
pub struct Match {
    #[command(flatten)]
    images: PairArguments,
    /// Disparity map to write: .png or .pgm (value = disparity x scale, 0 = none), .pfm (px,
    /// infinity = none), or - for a PFM on standard output.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Largest disparity to search, px, smaller than the width [default: 63, or what the
    /// width allows].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    d_max: Option<i16>,
    /// Smallest disparity to search, px; may be negative.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        allow_negative_numbers = true
    )]
    min_disparity: i16,
    /// Preset; `vgstereo presets` lists them.
    #[arg(long, value_name = "P", default_value_t = Preset::Balanced, value_parser = parse_preset)]
    preset: Preset,
    /// The view that gets the disparities.
    #[arg(long, value_enum, default_value_t = View::Left)]
    reference: View,
    /// Steps per px in a .png or .pgm, which states them too. Below 256, values have 8 bits where the
    /// range fits them, else 16 [default: 256 in 16 bits, as KITTI has, or the largest power of two
    /// that fits].
    #[arg(long, value_name = "S")]
    scale: Option<f32>,
    /// Also write the map in colours, as PNG.
    #[arg(long, alias = "color", value_name = "FILE")]
    colour: Option<PathBuf>,
    /// Also write the depth along the optical axis: .png (mm, 16 bits, 0 = none) or .pfm (m, NaN = none);
    /// needs --calibration, or --focal and --baseline.
    #[arg(long, value_name = "FILE")]
    depth: Option<PathBuf>,
    /// Also write the cloud of points that the reference view shows: .ply or .pcd, binary, in
    /// metres, x right, y down, z forward, up to 32 m to the sides and 65 m away. Each pixel has a
    /// point, row by row, NaN = none, with its colour and confidence; needs the cameras' numbers as
    /// --depth does.
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// Also write the confidence of each disparity, as PNG: 1 to 255, 0 where it was filled in or there
    /// is none.
    #[arg(long, value_name = "FILE")]
    confidence: Option<PathBuf>,
    /// Also write the rectified views into this folder, as left.png and right.png.
    #[arg(long, value_name = "DIR", requires = "calibration")]
    rectified: Option<PathBuf>,
    /// Match the grey of colour images.
    #[arg(long)]
    grey: bool,
    /// Bits that images of 16 bits use, 8 to 16, such as 12 for a camera of 12 bits [default: as many as
    /// the largest level of the pair has].
    #[arg(long, value_name = "N", value_parser = parse_bits)]
    bits: Option<u8>,
    /// Leave out disparities that were filled in rather than found.
    #[arg(long)]
    sparse: bool,
    /// Do not look for what may be wrong with the pair: views exchanged, lines off, a search range
    /// that is too small.
    #[arg(long)]
    no_check: bool,
    /// Threads; the map does not depend on their number. The SGM presets take at
    /// most 2.
    #[arg(long, value_name = "N", default_value = "1")]
    threads: NonZeroUsize,
    #[command(flatten)]
    scan: ScanOptions,
    #[command(flatten)]
    cameras: CameraOptions,
    #[command(flatten)]
    overrides: Overrides,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum View {
    Left,
    Right,
}

impl From<View> for Reference {
    fn from(view: View) -> Self {
        match view {
            View::Left => Self::Left,
            View::Right => Self::Right,
        }
    }
}

impl Match {
    /// Matches the pair, writes the disparity map and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason. Nothing is written
    /// then.
    pub fn run(self) -> Result<Said> {
        for path in self.colour.iter().chain(&self.confidence) {
            ensure_ending(path, "png")?;
        }
        let standard = Path::new("-");
        let mut inputs = self.images.paths();
        inputs.extend(self.overrides.config.as_deref());
        inputs.extend(self.cameras.files());
        let pictures = self.rectified.iter();
        let pictures =
            pictures.flat_map(|folder| ["left.png", "right.png"].map(|n| folder.join(n)));
        let pictures: Vec<PathBuf> = pictures.collect();
        let mut outputs = vec![self.out.as_path()];
        let others = [
            &self.colour,
            &self.depth,
            &self.points,
            &self.confidence,
            &self.scan.scan,
        ];
        outputs.extend(
            others
                .into_iter()
                .flatten()
                .chain(&pictures)
                .map(PathBuf::as_path),
        );
        // `-` is standard input or output.
        for paths in [&mut inputs, &mut outputs] {
            paths.retain(|path| *path != standard);
        }
        ensure_distinct_outputs(&inputs, &outputs)
            .context("--out, --colour, --depth, --points, --confidence, --scan, --rectified")?;
        // What can be refused is, before anything is decoded.
        let pair = self.images.open()?;
        let size = pair.dimensions()?;
        let cameras = self.cameras.read(Some(size))?;
        let rectification = cameras.rectification.as_deref();
        let rectification = rectification.map(Rectification::from_bytes).transpose()?;
        let (width, height) = match &rectification {
            Some(r) => (u32::from(r.width), u32::from(r.height)),
            None => size,
        };
        let width = u16::try_from(width)?;
        let depth = match &self.depth {
            Some(path) => {
                let format = DepthFormat::choose(path)?;
                let depth =
                    self.cameras
                        .depth("--depth", rectification.as_ref(), &cameras.warnings)?;
                Some((path, format, depth))
            }
            None => None,
        };
        let camera = |option| {
            let size = [width.into(), height];
            let (reference, warnings) = (self.reference.into(), &cameras.warnings);
            self.cameras
                .camera(option, rectification.as_ref(), warnings, size, reference)
        };
        let points = match &self.points {
            Some(path) => Some((path, PointFormat::choose(path)?, camera("--points")?)),
            None => None,
        };
        let mut scan_memory = Vec::new();
        let mut scan = match &self.scan.scan {
            Some(path) => {
                let format = ScanFormat::choose(path)?;
                let camera = camera("--scan")?;
                let config = self.scan.config(camera, width, None);
                scan_memory.resize(LaserScan::words(config.bearings, config.lines_min), 0);
                let scan = LaserScan::new(&config, &mut scan_memory).context("--scan")?;
                Some((path, format, camera.depth(), scan))
            }
            None => None,
        };
        let disparities = self.disparities(width)?;
        let format = DisparityFormat::choose(&self.out, self.scale, disparities)?;
        let parameters = self.overrides.apply(self.preset)?;
        let config = Config {
            reference: self.reference.into(),
            output: output_of(self.sparse),
            ..Config::new(parameters, width, disparities)
        };
        config.validate()?;
        let images = pair.decode(self.bits)?;
        drop(pair);
        let mut views = Views::new(images.left, images.right, self.grey)?;
        if let Some(rectification) = &rectification {
            views = rectified(&views, rectification)?;
        }
        let config = Config {
            colour: views.has_colour(),
            ..config
        };
        let matched = match_frame(
            &config,
            &views,
            NativeKernels::fastest(),
            self.threads.get(),
        )?;
        let map = &matched.disparities_q4;
        let encoded = format.encode(map, width.into())?;
        let to_stdout = self.out == standard;
        let mut files = Vec::new();
        if let Some(path) = self.colour.as_deref() {
            let picture = colour_disparities(map, width.into(), disparities);
            files.push((path, encode(&picture.into(), ImageFormat::Png)?));
        }
        if let Some((path, format, depth)) = &depth {
            files.push((path.as_path(), format.encode(map, width, depth)?));
        }
        if let Some((path, format, camera)) = &points {
            let reference = usize::from(config.reference == Reference::Right);
            let colours = views.picture(reference)?;
            let bytes = format.encode(matched.lines(width), &colours, camera)?;
            files.push((path.as_path(), bytes));
        }
        if let Some(path) = self.confidence.as_deref() {
            let meaning = "1 to 255, 0 = filled in or none".to_owned();
            let size = [width.into(), height];
            let png = grey_png(&matched.confidences, size, false, "Confidence", meaning)?;
            files.push((path, png));
        }
        if let Some((path, format, depth, scan)) = &mut scan {
            matched.lines(width).for_each(|line| scan.push(&line));
            files.push((
                path.as_path(),
                format.encode(&scan.finish(), depth, disparities)?,
            ));
        }
        for (view, path) in pictures.iter().enumerate() {
            let picture = views.picture(view)?;
            files.push((path, encode(&picture.into(), ImageFormat::Png)?));
        }
        if let Some(folder) = &self.rectified {
            make_folder(folder)?;
        }
        if to_stdout {
            write_files(&files)?;
            write_output(&encoded)?;
        } else {
            files.insert(0, (self.out.as_path(), encoded));
            write_files(&files)?;
        }
        let mut text = format!(
            "{}: {}x{} px, disparities {} to {}, {} ms, {} KiB of working memory, {} lines of latency\n",
            name_of(&parameters, self.preset),
            width,
            height,
            disparities.range_px().start,
            disparities.range_px().end - 1,
            milliseconds(matched.time),
            kib(matched.working_bytes),
            matched.latency_lines
        );
        if let Some(bits) = images.bits {
            writeln!(text, "{}", bits_note(bits))?;
        }
        if let Some(rectification) = &rectification {
            text += &cameras.told(rectification);
        }
        let found = matched.confidences.iter().filter(|&&c| c > 0).count();
        let percent = found * 100 / matched.confidences.len().max(1);
        let rest = if self.sparse {
            "left out"
        } else {
            "filled in where it can be"
        };
        writeln!(text, "found {percent} % of the pixels; the rest is {rest}")?;
        if !self.no_check {
            for hint in hints(&views, disparities)? {
                writeln!(text, "hint: {hint}")?;
            }
        }
        writeln!(text, "wrote {}: {}", shown(&self.out), format.meaning())?;
        if let Some((path, format, _)) = &depth {
            writeln!(text, "wrote {}: {}", shown(path), format.meaning())?;
        }
        if let Some((path, format, _)) = &points {
            writeln!(text, "wrote {}: {}", shown(path), format.meaning())?;
        }
        let others = [&self.colour, &self.confidence, &self.scan.scan];
        let others = others.into_iter().flatten();
        for path in others.chain(&pictures) {
            writeln!(text, "wrote {}", shown(path))?;
        }
        Ok(if to_stdout {
            Said::Aside(text)
        } else {
            Said::Output(text)
        })
    }

    /// Returns the disparities to search in lines of `width` px.
    fn disparities(&self, width: u16) -> Result<DisparityRange> {
        let widest = i32::from(width) - 1;
        let d_max = match self.d_max {
            Some(d_max) => i32::from(d_max),
            None => i32::from(DEFAULT_D_MAX)
                .min(widest)
                .max(self.min_disparity.into()),
        };
        ensure!(
            d_max <= widest,
            "--d-max {d_max} is not smaller than the width of {width} px"
        );
        let minimum = i32::from(self.min_disparity);
        ensure!(
            minimum <= d_max,
            "--min-disparity {minimum} is larger than the largest disparity, {d_max}"
        );
        let range = DisparityRange {
            minimum_px: self.min_disparity,
            count: u16::try_from(d_max - minimum + 1)?,
        };
        ensure!(
            range.fits(width),
            "disparities from {minimum} to {d_max} do not fit a width of {width} px (2047 px at most)"
        );
        Ok(range)
    }
}
