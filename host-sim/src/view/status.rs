//! What the page is told beside frames: the source, the board, all counters, and what became of
//! commands.

use serde::Serialize;
use serde_json::Value;
use vgstereo_core::geometry::RectifiedCamera;
use vgstereo_link::board::Statistics;
use vgstereo_link::{Counters, State};

use crate::link::board::{FrameCounts, LogLine};

/// What the page is told, as JSON.
#[derive(Debug, Serialize)]
pub struct Status<'a> {
    /// Where the bytes come from.
    pub source: &'a SourceStatus,
    /// The introduction of the board.
    pub board: Option<&'a Value>,
    /// The camera that disparities are seen with, if it is known.
    pub camera: Option<CameraStatus>,
    /// What the board sends, and its parameters.
    pub state: Option<&'a State>,
    /// The board's counters.
    pub statistics: Option<&'a Statistics>,
    /// The counters of this end of the link, of the connection that there is.
    pub packets: PacketCounts,
    /// What became of frames.
    pub frames: &'a FrameCounts,
    /// The streams that are asked of the board, as bits.
    pub streams: u16,
    /// The newest commands, the oldest first.
    pub commands: Vec<CommandStatus>,
    /// The newest lines of the board's log, the oldest first.
    pub log: Vec<&'a LogLine>,
}

/// Where the bytes come from, and whether they do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SourceStatus {
    /// Name of the source.
    pub name: String,
    /// Whether bytes can come, or have all come.
    pub kind: SourceKind,
    /// Why not, if they cannot; of a recording, where it is no longer whole.
    pub reason: Option<String>,
}

/// Whether bytes can come from a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// It is open.
    Connected,
    /// It was lost, and is tried again.
    Lost,
    /// It was a file, and has ended.
    Ended,
}

/// The camera that disparities are seen with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraStatus {
    /// Focal length, px.
    pub focal_px: f64,
    /// Principal point, column and line, px.
    pub principal_px: [f64; 2],
    /// Distance between the cameras, mm.
    pub baseline_mm: f64,
    /// Whether the board has told it; else it is that of `--calibration`.
    pub is_from_board: bool,
}

impl CameraStatus {
    /// The numbers of a camera.
    #[must_use]
    pub fn new(camera: &RectifiedCamera, is_from_board: bool) -> Self {
        let focal_q8 = f64::from(camera.focal_q8());
        Self {
            focal_px: focal_q8 / 256.0,
            principal_px: camera.principal_q8().map(|q8| f64::from(q8) / 256.0),
            baseline_mm: f64::from(camera.depth().numerator_q8()) / focal_q8,
            is_from_board,
        }
    }
}

/// The counters of a decoder, and how many bytes it was given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct PacketCounts {
    /// Bytes that have come.
    pub bytes: u64,
    /// What became of the packets in them.
    #[serde(flatten)]
    pub counters: Counters,
}

/// What became of a command.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CommandStatus {
    /// Its sequence number, if it was sent.
    pub sequence: Option<u32>,
    /// What it is.
    pub name: String,
    /// The board's answer, or why there is none; none yet.
    pub outcome: Option<&'static str>,
}
