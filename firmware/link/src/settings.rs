//! What the host sets and the board tells: what is sent, from which source, with which parameters.

use serde::{Deserialize, Serialize};

use crate::message::{Region, Streams, byte_enum};

/// What the board is to send.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Selection {
    /// The streams.
    pub streams: Streams,
    /// Every how many frames one is sent, at least 1.
    pub every_frames: u16,
    /// The part of the frame to send, in which whole frames are matched nevertheless; `None` for all.
    pub region: Option<Region>,
}

impl Selection {
    /// These streams of all frames, whole.
    #[must_use]
    pub const fn whole(streams: Streams) -> Self {
        Self {
            streams,
            every_frames: 1,
            region: None,
        }
    }
}

/// Parameters that neither memory nor latency depend on. `None` leaves one as it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parameters {
    /// Uniqueness: smallest margin between the sums of the best and the second best disparity.
    pub margin: Option<i16>,
    /// Largest difference between the disparities of the two views, px.
    pub left_right_tolerance_px: Option<u8>,
    /// Smallest texture of a pixel that is not in doubt, levels.
    pub texture_min: Option<u16>,
    /// Regions of fewer pixels are rejected. Without effect if the preset has no speckle removal.
    pub speckle_size_min: Option<u8>,
    /// Largest difference between neighbours of one region, 1/16 px.
    pub speckle_step_q4: Option<u8>,
    /// Smallest confidence of a disparity that is sent; those below become none. 0 sends all.
    pub confidence_min: Option<u8>,
    /// Whether disparities that were not found are filled in.
    pub dense: Option<bool>,
}

/// What a board sends, and the parameters that it uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    /// Whether frames are sent.
    pub is_started: bool,
    /// What is sent of them.
    pub selection: Selection,
    /// Where the lines come from.
    pub source: Source,
    /// The parameters; `None` for those that the board's method does not have.
    pub parameters: Parameters,
}

byte_enum! {
    /// Where a board takes its lines from.
    Source, else Camera, {
        /// The camera, or a source that this version does not know.
        Camera = 0,
        /// A pattern that the board makes itself, whose disparities are known.
        TestPattern = 1,
    }
}
