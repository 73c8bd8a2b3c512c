//! Command-line options that several commands take.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use vgstereo_core::geometry::{Interpolation, RectifiedCamera, ScanConfig};
use vgstereo_core::{Method, Output, Parameters, Preset};

use crate::calibration::{Keep, Options, parse_unit, projections};
use crate::escapes::shown;
use crate::files::{TEXT_BYTES_MAX, read_file};
use crate::link::source::{Source, serial_ports};
use crate::parameters::{with_file, with_setting};

/// Options that replace parameters of a preset. A later field overrides an earlier one.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Parameters, instead of the preset's")]
pub struct Overrides {
    /// TOML file of parameters; those it leaves out stay the preset's. `vgstereo presets
    /// --toml NAME` prints one to start from.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Any parameter by its name in that file, such as `method.p1=12`; `none` leaves a stage
    /// out, such as `method.vote=none`; one that the preset leaves out is given whole, such as
    /// `method.speckle={size_min=8,step_q4=32,reach_y_px=2}`. May be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Synapses per neuron, |W|: a multiple of 16 from 16 to 1024.
    #[arg(long, value_name = "N")]
    pub synapses: Option<u16>,
    /// Standard deviation of the synapses' offsets, px: above 0, at most 10. Their reach
    /// becomes three times as much, rounded up.
    #[arg(long, value_name = "X")]
    pub sigma: Option<f32>,
    /// Seed of the synapses' offsets and of random ties.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

impl Overrides {
    /// Returns the parameters of `preset` after these options have replaced some of them.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn apply(&self, preset: Preset) -> Result<Parameters> {
        let mut parameters = preset.parameters();
        let mut options = Vec::new();
        if let Some(path) = &self.config {
            parameters = with_file(&parameters, path)?;
            options.push(format!("--config {}", shown(path)));
        }
        for setting in &self.set {
            parameters = with_setting(&parameters, setting)?;
            options.push(format!("--set {setting}"));
        }
        if let Some(synapses) = self.synapses {
            parameters.synapses = synapses;
            options.push(format!("--synapses {synapses}"));
        }
        if let Some(sigma_px) = self.sigma {
            parameters = parameters.with_sigma(sigma_px);
            options.push(format!("--sigma {sigma_px}"));
        }
        if let Some(seed) = self.seed {
            parameters = parameters.with_seed(seed);
        }
        // Together, as one alone may be out of its range until the next is replaced too.
        parameters.validate().with_context(|| options.join(", "))?;
        Ok(parameters)
    }
}

/// Options that say what rectified views show, and what the calibration files leave open.
#[derive(Debug, Clone, Default, PartialEq, Args)]
#[command(next_help_heading = "Calibration")]
pub struct RectifiedViews {
    /// Size of the rectified views, px [default: that of the raw views].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    view_size: Option<[u16; 2]>,
    /// What the rectified views show: `all` that the cameras see, only `valid` pixels, or the part
    /// X,Y,WxH of the views [default: as the files' own rectification, or else `valid`].
    #[arg(long, value_name = "KEEP", value_parser = parse_keep)]
    keep: Option<Keep>,
    /// File with the projections P1 and P2 that the rectified views are to have, in YAML, XML, JSON or
    /// TOML.
    #[arg(long, value_name = "FILE", conflicts_with = "keep")]
    projection: Option<PathBuf>,
    /// Unit of the files' translation: mm, cm, m, or millimetres as a number, such as the side of
    /// the board's squares [default: as the files state].
    #[arg(long, value_name = "UNIT", value_parser = parse_unit)]
    unit: Option<f64>,
    /// The cameras deliver a window of the picture that the files are of, from this column and
    /// line on.
    #[arg(long, value_name = "X,Y", value_parser = parse_corner)]
    cropped: Option<[u16; 2]>,
    /// The cameras join N by N pixels of the picture, or of its window, into one.
    #[arg(long, value_name = "N")]
    binned: Option<u16>,
    /// How levels between raw pixels are made. The cubic keeps edges sharper, and takes two lines more
    /// of each view and more time on a device.
    #[arg(long, value_enum, default_value_t)]
    interpolation: InterpolationName,
}

/// The names of [`Interpolation`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
#[expect(missing_docs, reason = "the values of an option")]
pub enum InterpolationName {
    #[default]
    Bilinear,
    Cubic,
}

impl From<InterpolationName> for Interpolation {
    fn from(name: InterpolationName) -> Self {
        match name {
            InterpolationName::Bilinear => Self::Bilinear,
            InterpolationName::Cubic => Self::Cubic,
        }
    }
}

impl RectifiedViews {
    /// The files that are read for these options.
    #[must_use]
    pub fn files(&self) -> Vec<&Path> {
        self.projection.iter().map(PathBuf::as_path).collect()
    }

    /// Returns the options of a rectification of raw views of this size, px; `None`: as the
    /// calibration files state.
    ///
    /// # Errors
    /// Fails with one line that names the file of projections and the reason.
    pub fn options(&self, size: Option<[u16; 2]>) -> Result<Options> {
        let projections = match &self.projection {
            Some(path) => {
                let name = shown(path);
                let bytes = read_file(path, TEXT_BYTES_MAX)?;
                let projections = projections(&name, &bytes)?;
                Some(projections.with_context(|| format!("{name}: there are no P1 and P2"))?)
            }
            None => None,
        };
        Ok(Options {
            size,
            view_size: self.view_size,
            keep: self.keep,
            projections,
            unit_mm: self.unit,
            cropped: self.cropped,
            binned: self.binned,
            interpolation: self.interpolation.into(),
        })
    }
}

/// Speed of a serial port unless another is given, bits per second.
pub const BAUD: u32 = 2_000_000;

/// Options that name the board whose link a command speaks, or recorded bytes of one.
#[derive(Debug, Clone, Args)]
pub struct SourceOptions {
    /// Serial port, HOST:PORT, or file of recorded bytes of the link.
    source: Option<String>,
    /// A board in this process, which looks at the built-in scene.
    #[arg(long, conflicts_with = "source")]
    demo: bool,
    /// Emulated board, which `cargo firmware live` builds and starts.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["source", "demo"])]
    board: Option<String>,
    /// Speed of a serial port, bits per second.
    #[arg(long, value_name = "N", default_value_t = BAUD)]
    baud: u32,
}

impl SourceOptions {
    /// Returns the source that is meant. `is_fast` says whether a recording is read as fast as can be,
    /// rather than at the pace of its packets.
    ///
    /// # Errors
    /// Fails with one line when none is named, which lists the serial ports that there are, or with one
    /// that names what is no source.
    pub fn source(&self, is_fast: bool) -> Result<Source> {
        if self.demo {
            return Ok(Source::Demo);
        }
        if let Some(name) = &self.board {
            return Ok(Source::Board(name.clone()));
        }
        let Some(name) = &self.source else {
            let ports = serial_ports();
            let found = if ports.is_empty() {
                "no serial port was found".to_owned()
            } else {
                format!("serial ports found: {}", ports.join(", "))
            };
            bail!("name a serial port, HOST:PORT or a file, or give --demo; {found}");
        };
        Source::parse(name, self.baud, is_fast)
    }
}

/// Options of a laser scan.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Laser scan")]
pub struct ScanOptions {
    /// Also write a virtual laser scan, the nearest range at each bearing: .yaml (fields of ROS's
    /// LaserScan, rad and m) or .png (plan view); needs the cameras' numbers as --depth does.
    #[arg(long, value_name = "FILE")]
    pub scan: Option<PathBuf>,
    /// Number of bearings of the scan, at equal angles over the view [default: 90, or one for each
    /// column].
    #[arg(long, value_name = "N")]
    scan_bearings: Option<u16>,
    /// Heights that count, relative to the camera, mm: LOW,HIGH.
    #[arg(
        long,
        value_name = "LOW,HIGH",
        default_value = "-300,300",
        value_parser = parse_heights,
        allow_hyphen_values = true
    )]
    scan_heights: [i16; 2],
    /// Pitch of the camera, degrees: the angle of its optical axis below the horizon. Ranges and heights
    /// are level [default: 0, or that of the built-in scene].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    scan_pitch: Option<f32>,
    /// Ranges beyond this do not count, mm.
    #[arg(long, value_name = "MM", default_value_t = 20_000)]
    scan_range: u16,
    /// Number of lines in which something must be seen at a bearing to count, 1 to 8.
    #[arg(long, value_name = "N", default_value_t = 3)]
    scan_lines: u8,
}

impl ScanOptions {
    /// Returns what a scan by these options looks at, in views of `width` columns from this camera, which
    /// is known to look down by `pitch_rad`, or not known.
    #[must_use]
    pub fn config(
        &self,
        camera: RectifiedCamera,
        width: u16,
        pitch_rad: Option<f32>,
    ) -> ScanConfig {
        let [low, high] = self.scan_heights;
        let stated_rad = self.scan_pitch.map(f32::to_radians);
        ScanConfig {
            camera,
            columns: 0..width,
            bearings: self.scan_bearings.unwrap_or(width.min(90)),
            pitch_rad: stated_rad.or(pitch_rad).unwrap_or_default(),
            heights_mm: low..=high,
            range_max_mm: self.scan_range,
            lines_min: self.scan_lines,
            confidence_min: 1,
        }
    }
}

/// Returns a name for parameters that started from `preset`: that of the preset that they are,
/// whatever their seed, or else that of `preset`, marked as changed.
#[must_use]
pub fn name_of(parameters: &Parameters, preset: Preset) -> String {
    let is_same = |other: &Preset| {
        let other = other.parameters();
        parameters.with_seed(other.seed) == other
    };
    // The given preset first, should two be alike.
    match std::iter::once(preset).chain(Preset::ALL).find(is_same) {
        Some(same) => same.name().to_owned(),
        None => format!("{preset}, changed"),
    }
}

/// Returns the preset that has this name.
///
/// # Errors
/// Fails with one line that lists the names of all presets.
pub fn parse_preset(name: &str) -> Result<Preset, String> {
    name.parse()
        .map_err(|error: vgstereo_core::config::UnknownPreset| error.to_string())
}

/// Returns the presets that an option names, or all that aggregate if it names none.
#[must_use]
pub fn aggregating_unless_named(named: &[Preset]) -> Vec<Preset> {
    if !named.is_empty() {
        return named.to_vec();
    }
    let aggregates = |preset: &Preset| matches!(preset.parameters().method, Method::Sgm(_));
    Preset::ALL.into_iter().filter(aggregates).collect()
}

/// Returns the threshold of bad pixels that a text states, px.
///
/// # Errors
/// Fails when it is not a number above 0, or more than 2047 px, the largest disparity of all.
pub fn parse_threshold(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(px) if px > 0.0 && px <= 2047.0 => Ok(px),
        _ => Err("it must be above 0 and at most 2047 px".to_owned()),
    }
}

/// Returns the output that the option `--sparse` asks for: sparse when it is set, otherwise
/// dense.
#[must_use]
pub fn output_of(sparse: bool) -> Output {
    if sparse {
        Output::Sparse
    } else {
        Output::Dense
    }
}

/// Returns the width and the height that a text states, px.
///
/// # Errors
/// Fails with one line that shows how a size is written.
pub fn parse_size(text: &str) -> Result<[u16; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| {
        let sides = [width.parse().ok()?, height.parse().ok()?];
        (sides.iter().all(|side| (1..=4096).contains(side))).then_some(sides)
    });
    sides.ok_or_else(|| "a size is WIDTHxHEIGHT from 1 to 4096 px, such as 640x480".to_owned())
}

fn parse_keep(text: &str) -> Result<Keep, String> {
    let crop = || {
        let mut parts = text.splitn(3, ',');
        let (x, y) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        let [width, height] = parse_size(parts.next()?).ok()?;
        Some(Keep::Crop([x, y, width, height]))
    };
    match text {
        "all" => Ok(Keep::All),
        "valid" => Ok(Keep::Valid),
        _ => crop().ok_or_else(|| {
            "it is all, valid, or X,Y,WIDTHxHEIGHT, such as 40,30,560x420".to_owned()
        }),
    }
}

fn parse_heights(text: &str) -> Result<[i16; 2], String> {
    let heights = text
        .split_once(',')
        .and_then(|(low, high)| Some([low.parse().ok()?, high.parse().ok()?]))
        .filter(|[low, high]| low <= high);
    heights.ok_or_else(|| "it is LOW,HIGH in mm, such as -200,150".to_owned())
}

/// Returns the image point that a text states, column and line, px.
///
/// # Errors
/// Fails with one line that shows how a point is written.
pub fn parse_point(text: &str) -> Result<[f64; 2], String> {
    let point = text
        .split_once(',')
        .and_then(|(x, y)| Some([x.parse().ok()?, y.parse().ok()?]));
    point.ok_or_else(|| "it is X,Y in px, such as 319.5,239.5".to_owned())
}

fn parse_corner(text: &str) -> Result<[u16; 2], String> {
    let corner = text
        .split_once(',')
        .and_then(|(x, y)| Some([x.parse().ok()?, y.parse().ok()?]));
    corner.ok_or_else(|| "it is X,Y, such as 160,120".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_named_for_what_they_are() {
        let micro = Preset::Micro.parameters();
        for preset in Preset::ALL {
            assert_eq!(name_of(&preset.parameters(), preset), preset.name());
            // A file of another preset's parameters replaces all of them.
            assert_eq!(name_of(&micro.with_seed(77), preset), "micro");
        }
        let changed = micro.with_sigma(2.0);
        assert_eq!(name_of(&changed, Preset::Micro), "micro, changed");
    }

    #[test]
    fn options_are_understood_or_refused() {
        assert_eq!(parse_size("640x480"), Ok([640, 480]));
        assert!(parse_size("640").is_err() && parse_size("0x480").is_err());
        assert_eq!(parse_keep("valid"), Ok(Keep::Valid));
        assert_eq!(
            parse_keep("40,30,560x420"),
            Ok(Keep::Crop([40, 30, 560, 420]))
        );
        assert!(parse_keep("most").is_err() && parse_keep("1,2,3").is_err());
        assert_eq!(parse_corner("16,0"), Ok([16, 0]));
        assert!(parse_corner("16").is_err() && parse_corner("-1,0").is_err());
        assert_eq!(parse_heights("-20,5"), Ok([-20, 5]));
        assert!(parse_heights("5,-20").is_err() && parse_heights("5").is_err());
    }
}
