//! Faults at the wires of the camera.

use anyhow::{Result, bail};

/// Kind of a fault at a line of the geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The next lines come with no pause.
    Overrun,
    /// The line lacks pixels.
    ShortLine,
    /// The frame ends before the line.
    ShortFrame,
    /// The line and all that follows do not come, and the frame does not end.
    Timeout,
}

/// Reads `FRAME:LINE:KIND`, with the names that the firmware's scripts have.
pub fn parse(text: &str) -> Result<(usize, (usize, Kind))> {
    let parts: Vec<&str> = text.split(':').collect();
    let [frame, line, kind] = parts[..] else {
        bail!("{text}: a fault is FRAME:LINE:KIND");
    };
    let kind = match kind {
        "overrun" => Kind::Overrun,
        "short-line" => Kind::ShortLine,
        "short-frame" => Kind::ShortFrame,
        "timeout" => Kind::Timeout,
        _ => bail!("{text}: the wires have the faults overrun, short-line, short-frame, timeout"),
    };
    Ok((frame.parse()?, (line.parse()?, kind)))
}
