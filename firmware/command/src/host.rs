//! Runs of a board's requests on the host, and the comparison of the two results.

use anyhow::{Context, Result, anyhow};
use vgstereo_core::Matcher;
use vgstereo_core::geometry::{LaserScan, Rectification, Rectifier, Scan};
use vgstereo_emulated::Request;
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::sink::{BothSinks, ScanSink, ScanningSink};
use vgstereo_firmware::{FrameInfo, NoWatchdog, Session, Statistics, session};
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::sink::{DisparityFrame, FrameCollector, UnexpectedLine};

use crate::pair::Pair;

/// The bytes of whole frames, one frame after another, row-major, as a board's sink writes
/// them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frames {
    /// The disparity of each pixel, 1/16 px, in two bytes, little-endian.
    pub disparities: Vec<u8>,
    /// The confidence of each disparity, 0 to 255, in one byte.
    pub confidences: Vec<u8>,
    /// The scan of each frame, if the request has one: the first bearing and the step between
    /// bearings, rad, as `f32`, and the ranges, mm, as `u16`, little-endian.
    pub scans: Vec<u8>,
}

impl Frames {
    /// Returns the disparity of each pixel, 1/16 px.
    #[must_use]
    pub fn disparities_q4(&self) -> Vec<i16> {
        let values = self.disparities.as_chunks().0.iter();
        values.map(|&bytes| i16::from_le_bytes(bytes)).collect()
    }

    /// Appends a whole frame.
    fn push(&mut self, frame: &DisparityFrame) {
        let bytes = frame.disparities_q4.iter().flat_map(|d| d.to_le_bytes());
        self.disparities.extend(bytes);
        self.confidences.extend_from_slice(&frame.confidences);
    }
}

/// Keeps the bytes of scans.
struct Scans(Vec<u8>);

impl ScanSink for Scans {
    type Error = UnexpectedLine;

    fn scan(&mut self, _: &FrameInfo, scan: &Scan<'_>) -> Result<(), UnexpectedLine> {
        for angle_rad in [scan.bearing_min_rad, scan.bearing_step_rad] {
            self.0.extend(angle_rad.to_le_bytes());
        }
        self.0
            .extend(scan.ranges_mm.iter().flat_map(|mm| mm.to_le_bytes()));
        Ok(())
    }
}

/// Matches a pair as a request asks, with the fastest kernels of this machine, and returns all
/// whole frames with the counters of the session.
///
/// # Errors
/// Fails when the request is not valid, or when more frames fail than the request has faults.
pub fn run(pair: &Pair, request: &Request) -> Result<(Frames, Statistics)> {
    run_session(pair, request, false)
}

/// Matches a pair as [`run`] does, in a session that begins each frame with the offsets of lines that the one before it
/// taught, as those of the real boards do.
///
/// # Errors
/// Fails as [`run`] does.
pub fn run_keeping_line_offsets(pair: &Pair, request: &Request) -> Result<(Frames, Statistics)> {
    run_session(pair, request, true)
}

fn run_session(
    pair: &Pair,
    request: &Request,
    keeps_line_offsets: bool,
) -> Result<(Frames, Statistics)> {
    let config = request.config();
    let camera = FaultyCamera::new(pair.camera()?, &request.faults);
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; session::memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, NativeKernels::fastest(), &mut memory)?;
    let mut scan_memory = vec![0; request.scan.map_or(0, |scan| scan.words())];
    let mut scans = Scans(Vec::new());
    let scanner = match request.scan {
        Some(scan) => {
            let config = scan
                .config(config.width)
                .context("there is no such camera")?;
            let scan = LaserScan::new(&config, &mut scan_memory)?;
            Some(ScanningSink::new(scan, &mut scans))
        }
        None => None,
    };
    let sink = BothSinks::new(FrameCollector::new(), scanner);
    let mut strip = Vec::new();
    let mut rectifier = match &pair.rectification {
        Some(bytes) => {
            let rectification = Rectification::from_bytes(bytes)?;
            strip.resize(Rectifier::words(&rectification, config.colour), 0);
            let kernels = NativeKernels::fastest();
            Some(Rectifier::new(
                rectification,
                config.colour,
                kernels,
                &mut strip,
            )?)
        }
        None => None,
    };
    let rectifier = rectifier.as_mut();
    let mut session =
        Session::rectifying(camera, rectifier, matcher, sink, &mut lines, NoWatchdog)?;
    session.keep_line_offsets(keeps_line_offsets);
    let mut frames = Frames::default();
    let mut whole = 0;
    let mut failures = 0;
    while whole < request.frames {
        match session.run_frame() {
            Ok(_) => {
                let frame = session.sink_mut().first.take_frame();
                frames.push(&frame.context("the session finished a frame")?);
                whole += 1;
            }
            // Each fault costs one frame at most.
            Err(_) if failures < request.faults.len() => failures += 1,
            Err(error) => return Err(anyhow!("{error}")),
        }
    }
    let statistics = session.statistics();
    drop(session);
    frames.scans = scans.0;
    Ok((frames, statistics))
}

/// Returns a text that names the first pixel in which two results differ; `None` if they are
/// equal. `width` is that of each frame, px.
#[must_use]
pub fn first_difference(board: &Frames, host: &Frames, width: u32) -> Option<String> {
    let pixel = |bytes_each: usize, board: &[u8], host: &[u8]| {
        let common = board.iter().zip(host).position(|(a, b)| a != b);
        let length = (board.len() != host.len()).then_some(board.len().min(host.len()));
        common.or(length).map(|byte| byte / bytes_each)
    };
    let disparity = pixel(2, &board.disparities, &host.disparities);
    let confidence = pixel(1, &board.confidences, &host.confidences);
    let (what, at) = match (disparity, confidence) {
        (Some(at), _) => ("disparities", at),
        (None, Some(at)) => ("confidences", at),
        (None, None) if board.scans != host.scans => return Some("the scans differ".to_owned()),
        (None, None) => return None,
    };
    let width = width.max(1) as usize;
    Some(format!(
        "the {what} differ from line {}, column {} on",
        at / width,
        at % width
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::Preset;
    use vgstereo_firmware::scripted::{FaultKind, ScriptedFault};

    /// An aborted frame leaves nothing behind, and the frames after it are collected.
    #[test]
    fn all_whole_frames_are_collected() {
        let pair = Pair::rendered(64, 40, 16);
        let run = |frames, faults: &[ScriptedFault]| {
            let request = pair.request(Preset::Lite, frames, faults).unwrap();
            super::run(&pair, &request).unwrap()
        };
        let (one, _) = run(1, &[]);
        assert_eq!(one.confidences.len(), 64 * 40);
        assert_eq!(one.disparities_q4().len(), 64 * 40);
        let fault = ScriptedFault {
            frame: 1,
            line: 30,
            kind: FaultKind::Truncated,
        };
        let (three, statistics) = run(3, &[fault]);
        assert_eq!((statistics.frames, statistics.frames_dropped), (3, 1));
        assert_eq!(three.disparities, one.disparities.repeat(3));
        assert_eq!(three.confidences, one.confidences.repeat(3));
    }

    #[test]
    fn differences_are_found_where_they_are() {
        let frames = Frames {
            disparities: vec![0; 24],
            confidences: vec![1; 12],
            scans: vec![2; 12],
        };
        assert_eq!(first_difference(&frames, &frames, 4), None);
        let mut other = frames.clone();
        other.scans[9] = 3;
        let text = first_difference(&frames, &other, 4).unwrap();
        assert_eq!(text, "the scans differ");
        other.confidences[5] = 2;
        let text = first_difference(&frames, &other, 4).unwrap();
        assert_eq!(text, "the confidences differ from line 1, column 1 on");
        other.disparities.truncate(22);
        let text = first_difference(&other, &frames, 4).unwrap();
        assert_eq!(text, "the disparities differ from line 2, column 3 on");
    }
}
