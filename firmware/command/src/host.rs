//! What the host makes of the same request.

use core::convert::Infallible;

use anyhow::{Result, anyhow};
use vgstereo_core::camera::LinePairSource;
use vgstereo_core::matcher::{DisparityLine, Matcher};
use vgstereo_emulated::Request;
use vgstereo_firmware::scripted::FaultyCamera;
use vgstereo_firmware::{DisparitySink, Fault, FrameInfo, Session, Statistics, session};
use vgstereo_sim::kernels::HostKernels;

use crate::pair::Pair;

/// Whole frames one after another, row-major, as a board's sink writes them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frames {
    /// Disparities, 1/16 px, two bytes each, little-endian.
    pub disparities: Vec<u8>,
    /// Their confidences.
    pub confidences: Vec<u8>,
}

impl Frames {
    /// The disparities, 1/16 px.
    #[must_use]
    pub fn disparities_q4(&self) -> Vec<i16> {
        let values = self.disparities.as_chunks().0.iter();
        values.map(|&bytes| i16::from_le_bytes(bytes)).collect()
    }
}

/// Collects all whole frames.
#[derive(Debug, Default)]
struct Collector {
    frames: Frames,
    /// Pixels of the whole ones.
    pixels: usize,
}

impl DisparitySink for Collector {
    type Error = Infallible;

    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Infallible> {
        Ok(())
    }

    fn line(&mut self, _: u32, line: &DisparityLine<'_>) -> Result<(), Infallible> {
        let bytes = line.disparities_q4.iter().flat_map(|d| d.to_le_bytes());
        self.frames.disparities.extend(bytes);
        self.frames.confidences.extend_from_slice(line.confidences);
        Ok(())
    }

    fn end_frame(&mut self, _: &FrameInfo) -> Result<(), Infallible> {
        self.pixels = self.frames.confidences.len();
        Ok(())
    }

    fn abort_frame(&mut self, _: u32, _: Fault) {
        self.frames.confidences.truncate(self.pixels);
        self.frames.disparities.truncate(2 * self.pixels);
    }
}

/// Matches a pair as a request asks, with the fastest kernels of this machine.
///
/// # Errors
/// When the request is not valid or its frames do not come whole.
pub fn run(pair: &Pair, request: &Request) -> Result<(Frames, Statistics)> {
    let config = request.config();
    let camera = FaultyCamera::new(pair.camera()?, &request.faults);
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; session::memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, HostKernels::fastest(), &mut memory)?;
    let mut session = Session::new(camera, matcher, Collector::default(), &mut lines)?;
    let mut frames = 0;
    let mut failures = 0;
    while frames < request.frames {
        match session.run_frame() {
            Ok(_) => frames += 1,
            // Each fault costs a frame at most.
            Err(_) if failures < request.faults.len() => failures += 1,
            Err(error) => return Err(anyhow!("{error}")),
        }
    }
    let statistics = session.statistics();
    let (_, _, collector) = session.into_parts();
    Ok((collector.frames, statistics))
}

/// Where two results differ first, if they do.
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
