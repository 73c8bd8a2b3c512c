//! Faults of a camera: one that allocates nothing, and what each scripted fault must cost.

use vgstereo_firmware::Statistics;
use vgstereo_firmware::camera::{
    ErrorKind, ErrorType, Geometry, LinePair, LinePairSource, PixelFormat,
};
use vgstereo_firmware::scripted::{FaultKind, Rewind};

/// A camera of small grey frames, all alike, that allocates nothing.
#[derive(Debug, Clone)]
pub struct SmallCamera {
    height: u32,
    pairs: u64,
}

impl SmallCamera {
    /// Width of its lines, px.
    pub const WIDTH: u16 = 12;

    /// Returns a camera whose frames have `height` lines.
    #[must_use]
    pub fn new(height: u32) -> Self {
        Self { height, pairs: 0 }
    }
}

impl ErrorType for SmallCamera {
    type Error = ErrorKind;
}

impl LinePairSource for SmallCamera {
    fn geometry(&self) -> Geometry {
        Geometry {
            width: Self::WIDTH,
            height: self.height,
            format: PixelFormat::Grey8,
        }
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let height = u64::from(self.height);
        let (frame, line) = (self.pairs / height, (self.pairs % height) as u32);
        // Texture that is 2 px further left in the right view.
        let grey = |x: u32| ((x * 7 + line * 3) * (x + 5 * line + 11)) as u8;
        for (x, (left, right)) in (0..).zip(left.iter_mut().zip(right)) {
            (*left, *right) = (grey(x), grey(x + 2));
        }
        let timestamp_us = self.pairs;
        self.pairs += 1;
        Ok(LinePair {
            frame: frame as u32,
            line,
            timestamp_us,
            dropped: 0,
        })
    }
}

impl Rewind for SmallCamera {
    fn rewind(&mut self, pairs: u32) {
        self.pairs -= u64::from(pairs);
    }
}

/// Returns the counter of camera errors of kind `kind`.
pub fn error_counter(statistics: &mut Statistics, kind: ErrorKind) -> &mut u32 {
    match kind {
        ErrorKind::Overrun => &mut statistics.overruns,
        ErrorKind::SyncLost => &mut statistics.sync_losses,
        ErrorKind::ShortLine => &mut statistics.short_lines,
        ErrorKind::ShortFrame => &mut statistics.short_frames,
        ErrorKind::Timeout => &mut statistics.timeouts,
        ErrorKind::Bus => &mut statistics.bus_errors,
        _ => &mut statistics.other_errors,
    }
}

/// Returns whether a frame of `height` lines comes whole although it has a fault at `line`: only
/// what is delivered again after its last line does not break it.
#[must_use]
pub fn stays_whole(height: u32, line: u32, kind: FaultKind) -> bool {
    let is_repeat = matches!(kind, FaultKind::DuplicatedLine | FaultKind::DuplicatedFrame);
    is_repeat && line + 1 == height
}

/// Adds to the counters what one fault at `line` of a frame of `height` lines causes, if the frame
/// after it is complete.
pub fn count_fault(statistics: &mut Statistics, height: u32, line: u32, kind: FaultKind) {
    // Pairs matched before the fault is noticed; pairs that never reach the matcher.
    let (matched, dropped) = match kind {
        FaultKind::Error(_)
        | FaultKind::DroppedLine
        | FaultKind::LostSync
        | FaultKind::Truncated => (line, height - line),
        // The repeated pair and the rest of the frame are dropped.
        FaultKind::DuplicatedLine => (line + 1, height - line),
        FaultKind::DuplicatedFrame => (line + 1, (line + 1) + (height - 1 - line)),
    };
    match kind {
        FaultKind::Error(kind) => *error_counter(statistics, kind) += 1,
        FaultKind::LostSync => statistics.sync_losses += 1,
        _ => statistics.sequence_breaks += 1,
    }
    let whole = stays_whole(height, line, kind);
    statistics.lines += matched;
    statistics.lines_dropped += dropped;
    statistics.frames += u32::from(whole);
    statistics.frames_dropped += u32::from(!whole);
}

/// Adds to the counters what undisturbed `frames` of `height` lines cause.
pub fn count_whole_frames(statistics: &mut Statistics, height: u32, frames: u32) {
    statistics.frames += frames;
    statistics.lines += frames * height;
}
