//! `vgstereo calibration`: makes the rectification of a pair of cameras from its calibration files, for a
//! device, to which it can send it.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use vgstereo_core::geometry::{Rectification, Rectifier};

use crate::arguments::{BAUD, RectifiedViews, parse_size};
use crate::calibration::{ERROR_MAX_PX, Rectified, rectify};
use crate::cameras::Cameras;
use crate::escapes::{shown, shown_name};
use crate::files::{ensure_distinct_outputs, read_all, write_files};
use crate::link::attended::Attended;
use crate::link::client::Memory;
use crate::link::source::Source;
use crate::link::upload::upload;
use crate::tables::kib;
use crate::terminal::progress_bar;

/// The arguments of `vgstereo calibration`.
#[derive(Debug, Args)]
#[command(
    after_help = "The files are those of OpenCV (YAML, XML or JSON; one file, or intrinsics and\n\
    extrinsics) or NumPy (.npy, one for each matrix, or an .npz), of ROS (camera_info of the\n\
    left and the right camera), Kalibr (camchain), EuRoC (sensor.yaml of both) or BoofCV\n\
    (YAML). tools/calibrate.py makes one from pictures of a board.\n\n\
    Matrices of OpenCV and NumPy have the usual names: M1 K1 cameraMatrix1 camera_matrix_left\n\
    mtxL, D1 dist1 distCoeffs1, R, T, R1 R2 P1 P2. The entry fisheye_model: 1 makes fisheye\n\
    lenses of four coefficients, and translation_unit: mm states the unit.\n\n\
    A rectification that was made before is read as well, to be sent.\n\n\
    A file for a device:  vgstereo calibration intrinsics.yml extrinsics.yml --size 640x480 --unit cm --out cal.vgr\n\
    To a board:           vgstereo calibration calibration.yml --send /dev/ttyACM0"
)]
pub struct Calibration {
    /// Calibration files of one pair of cameras; of two files of a camera each, the left one first.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Size of the raw views, px [default: as the files state].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u16; 2]>,
    #[command(flatten)]
    views: RectifiedViews,
    /// Rectification to write, for a device.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The same as a Rust source, `pub static CALIBRATION`.
    #[arg(long, value_name = "FILE")]
    rust: Option<PathBuf>,
    /// Send the rectification to a board, at a serial port or HOST:PORT, which stores it.
    #[arg(long, value_name = "SOURCE")]
    send: Option<String>,
    /// Speed of the serial port, bits per second.
    #[arg(long, value_name = "N", default_value_t = BAUD, requires = "send")]
    baud: u32,
}

impl Calibration {
    /// Makes the rectification, writes it, sends it and returns the text to print.
    ///
    /// # Errors
    /// Fails with one line that names the file, option or board and the reason. Nothing is written then,
    /// unless the board fails: files are written before.
    pub fn run(self) -> Result<String> {
        let inputs: Vec<&Path> = self.files.iter().map(PathBuf::as_path).collect();
        let inputs = [inputs, self.views.files()].concat();
        let outputs = self.out.iter().chain(&self.rust);
        let outputs: Vec<&Path> = outputs.map(PathBuf::as_path).collect();
        ensure_distinct_outputs(&inputs, &outputs).context("--out, --rust")?;
        let source = self.send.as_deref();
        let source = source
            .map(|name| Source::parse(name, self.baud, true))
            .transpose()
            .context("--send")?;
        let (bytes, mut text) = self.made()?;
        let mut written: Vec<(&Path, Vec<u8>)> = Vec::new();
        if let Some(path) = &self.out {
            written.push((path, bytes.clone()));
        }
        if let Some(path) = &self.rust {
            written.push((path, rust_source(&bytes).into_bytes()));
        }
        write_files(&written)?;
        for (path, _) in &written {
            writeln!(text, "wrote {}", shown(path))?;
        }
        if let Some(source) = source {
            send(&source, &Rectification::from_bytes(&bytes)?).context("--send")?;
            writeln!(
                text,
                "{} has stored the calibration, {} bytes",
                shown_name(&source.name()),
                bytes.len()
            )?;
        }
        Ok(text)
    }

    /// The bytes of the rectification, made of the files or read, and what is to be said of it.
    fn made(&self) -> Result<(Vec<u8>, String)> {
        let files = read_all(&self.files)?;
        match files.as_slice() {
            [(_, bytes)] if bytes.starts_with(b"VGRF") && self.size.is_none() => {
                let cameras = Cameras::read(&self.files, &self.views, None)?;
                let text = cameras.told(&Rectification::from_bytes(bytes)?);
                Ok((bytes.clone(), text))
            }
            files => {
                let made = rectify(files, &self.views.options(self.size)?)?;
                let text = summary(&made)?;
                Ok((made.maps.bytes, text))
            }
        }
    }
}

/// Sends a rectification to a board.
fn send(source: &Source, rectification: &Rectification<'_>) -> Result<()> {
    let mut memory = Memory::default();
    let mut board = Attended::open(source, &mut memory)?;
    let bar = progress_bar(rectification.bytes().len() as u64, "bytes sent");
    let sent = upload(&mut board, rectification, |bytes| {
        bar.set_position(bytes as u64)
    });
    bar.finish_and_clear();
    sent
}

/// What was understood, and what it costs.
fn summary(made: &Rectified) -> Result<String> {
    let (calibration, pair, maps) = (&made.calibration, &made.pair, &made.maps);
    let mut text = String::new();
    for (camera, side) in calibration.cameras.iter().zip(["left", "right"]) {
        writeln!(
            text,
            "{side} camera: {}, focal length {:.1} x {:.1} px, principal point {:.1}, {:.1}",
            camera.lens,
            camera.focal_px.x,
            camera.focal_px.y,
            camera.principal_px.x,
            camera.principal_px.y
        )?;
    }
    let baseline = match calibration.unit_mm {
        Some(unit_mm) => format!("baseline {:.1} mm", pair.baseline * unit_mm),
        None => format!(
            "baseline {:.4} in an unknown unit: there is no depth without --unit",
            pair.baseline
        ),
    };
    let turn = glam::DQuat::from_mat3(&calibration.rotation).to_scaled_axis();
    writeln!(
        text,
        "{} calibration: {baseline}; the cameras are turned by {:.2} deg against each other",
        calibration.format,
        turn.length().to_degrees()
    )?;
    let [width, height] = pair.size;
    let [raw_width, raw_height] = pair.raw_size;
    let [across, down] = pair.field_of_view_deg();
    writeln!(
        text,
        "rectified: {width}x{height} from {raw_width}x{raw_height} px, {}; focal length {:.1} px, \
         principal points {:.1} and {:.1}, {:.1}",
        if made.is_stored {
            "as the files have it"
        } else {
            "by rotation and translation"
        },
        pair.focal_px,
        pair.principal_px[0].x,
        pair.principal_px[1].x,
        pair.principal_px[0].y
    )?;
    writeln!(
        text,
        "field of view {across:.1} x {down:.1} deg; seen by the left camera {:.1} %, by the right one {:.1} %",
        maps.valid[0] * 100.0,
        maps.valid[1] * 100.0
    )?;
    let rectification = maps.rectification()?;
    let kib_of = |colour| kib(4 * Rectifier::words(&rectification, colour));
    writeln!(
        text,
        "maps: {} KiB, a knot every {} px, largest error {:.3} px",
        kib(maps.bytes.len()),
        maps.step_px,
        maps.error_px
    )?;
    writeln!(
        text,
        "raw lines to keep: {} left, {} right; {} KiB in grey, {} KiB with colour",
        rectification.left.kept_lines(),
        rectification.right.kept_lines(),
        kib_of(false),
        kib_of(true)
    )?;
    for warning in &calibration.warnings {
        writeln!(text, "warning: {warning}")?;
    }
    if maps.error_px > ERROR_MAX_PX {
        writeln!(
            text,
            "warning: maps of the smallest step are off by more than {ERROR_MAX_PX} px: the lens bends \
             more than they follow; keep a smaller part"
        )?;
    }
    Ok(text)
}

/// A Rust source with these bytes.
fn rust_source(bytes: &[u8]) -> String {
    let mut source = format!(
        "//! The rectification of a pair of cameras, for `vgstereo_core::geometry::Rectification::from_bytes`.\n\n\
         /// Written by `vgstereo calibration`.\n\
         pub static CALIBRATION: [u8; {}] = [\n",
        bytes.len()
    );
    for line in bytes.chunks(20) {
        let numbers: Vec<String> = line.iter().map(u8::to_string).collect();
        source.push_str(&format!("    {},\n", numbers.join(", ")));
    }
    source.push_str("];\n");
    source
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_rust_source_compiles_to_the_bytes() {
        let bytes: Vec<u8> = (0..=255).collect();
        let source = rust_source(&bytes);
        let check = "\nfn main() { for (at, byte) in CALIBRATION.iter().enumerate() { \
                     assert_eq!(at, usize::from(*byte)); } assert_eq!(CALIBRATION.len(), 256); }\n";
        let folder = tempfile::tempdir().unwrap();
        let (file, program) = (folder.path().join("cal.rs"), folder.path().join("cal"));
        fs::write(&file, source + check).unwrap();
        let run = |command: &mut std::process::Command| command.status().unwrap().success();
        // Cargo, which runs this test, comes with it.
        assert!(run(std::process::Command::new("rustc")
            .args(["--edition", "2024", "-D", "warnings", "-o"])
            .args([&program, &file])));
        assert!(run(&mut std::process::Command::new(&program)));
    }
}
