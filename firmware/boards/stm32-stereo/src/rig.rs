//! The rig: what a board's cameras send, and in what time.

use vgstereo_firmware::camera::{Geometry, Layout};

/// Lines of a sensor's frame, including the gap.
pub const FRAME_LINES: u16 = 260;

/// Size, order and timing of the lines that a board's cameras send.
#[derive(Debug, Clone, Copy)]
pub struct Rig {
    /// Geometry of the lines.
    pub geometry: Geometry,
    /// Layout of the two views' pixels on the camera port. A raw line is a pair.
    pub layout: Layout,
    /// Period of a line, to which the sensors are slowed down, us.
    pub line_us: u32,
}

impl Rig {
    /// Returns the words of a raw line, which holds a line of each view: the port packs four bytes
    /// into a word.
    ///
    /// # Panics
    /// If the layout sends the views in lines of their own.
    #[must_use]
    pub const fn raw_words(&self) -> usize {
        assert!(
            self.layout.lines_per_pair() == 1,
            "a raw line must be a pair"
        );
        let bytes = self
            .layout
            .raw_bytes(self.geometry.format, self.geometry.width);
        bytes.div_ceil(4)
    }

    /// Returns the longest wait for a line or for the end of a frame, us: a frame with its gap and
    /// its exposure, and a quarter more.
    #[must_use]
    pub const fn frame_us(&self) -> u32 {
        FRAME_LINES as u32 * 5 / 4 * self.line_us
    }

    /// Returns the time-out for the watchdog, us. A fault may take as long: the wait for a missing
    /// line, for the end of its frame, and for line 0 of the next frame.
    #[must_use]
    pub const fn watchdog_us(&self) -> u32 {
        3 * self.frame_us()
    }
}
