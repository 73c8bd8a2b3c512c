//! Runs of a board's requests on the host, and the comparison of the two results.

use anyhow::{Context, Result, anyhow};
use vgstereo_core::Matcher;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_emulated::Request;
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::{NoWatchdog, Session, Statistics, session};
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::sink::{DisparityFrame, FrameCollector};

use crate::pair::Pair;

/// The bytes of whole frames, one frame after another, row-major, as a board's sink writes
/// them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frames {
    /// The disparity of each pixel, 1/16 px, in two bytes, little-endian.
    pub disparities: Vec<u8>,
    /// The confidence of each disparity, 0 to 255, in one byte.
    pub confidences: Vec<u8>,
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

/// Matches a pair as a request asks, with the fastest kernels of this machine, and returns all
/// whole frames with the counters of the session.
///
/// # Errors
/// Fails when the request is not valid, or when more frames fail than the request has faults.
pub fn run(pair: &Pair, request: &Request) -> Result<(Frames, Statistics)> {
    let config = request.config();
    let camera = FaultyCamera::new(pair.camera()?, &request.faults);
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; session::memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, NativeKernels::fastest(), &mut memory)?;
    let sink = FrameCollector::new();
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
    let mut frames = Frames::default();
    let mut whole = 0;
    let mut failures = 0;
    while whole < request.frames {
        match session.run_frame() {
            Ok(_) => {
                let frame = session.sink_mut().take_frame();
                frames.push(&frame.context("the session finished a frame")?);
                whole += 1;
            }
            // Each fault costs one frame at most.
            Err(_) if failures < request.faults.len() => failures += 1,
            Err(error) => return Err(anyhow!("{error}")),
        }
    }
    Ok((frames, session.statistics()))
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
        };
        assert_eq!(first_difference(&frames, &frames, 4), None);
        let mut other = frames.clone();
        other.confidences[5] = 2;
        let text = first_difference(&frames, &other, 4).unwrap();
        assert_eq!(text, "the confidences differ from line 1, column 1 on");
        other.disparities.truncate(22);
        let text = first_difference(&other, &frames, 4).unwrap();
        assert_eq!(text, "the disparities differ from line 2, column 3 on");
    }
}
