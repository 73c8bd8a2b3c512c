//! Settings that both sensors of a pair share.

/// How a sensor is to be set up. The bounds of each setting are the sensor's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SensorSettings {
    /// Part of the pixels that is read.
    pub window: Window,
    /// Clock that is fed to the sensor, Hz.
    pub clock_hz: u32,
    /// Period of a line that is read, us; the sensor rounds it up to whole pixel clocks.
    pub line_us: u32,
    /// Lines of a frame, with the gap to the next one.
    pub frame_lines: u16,
    /// Time of exposure, us; rounded down to the steps of the sensor. It ends within its frame, so
    /// that frames do not get longer.
    pub exposure_us: u32,
    /// Gain, in 1/16, from 16 on; rounded down to the steps of the sensor.
    pub gain_q4: u16,
    /// What starts a frame.
    pub sync: FrameSync,
    /// Pattern that is sent instead of the picture.
    pub test_pattern: TestPattern,
}

/// A window of a sensor, in pixels before they are binned, counted from the first one that it can
/// read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// First column.
    pub left_px: u16,
    /// First row.
    pub top_px: u16,
    /// Columns, of which a line has as many, divided by [`Binning::factor`].
    pub width_px: u16,
    /// Rows, of which a frame has as many, divided by [`Binning::factor`].
    pub height_px: u16,
    /// How many pixels make one.
    pub binning: Binning,
}

/// How many pixels a sensor joins to one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Binning {
    /// Each is one.
    None,
    /// Two by two.
    Two,
    /// Four by four.
    Four,
}

impl Binning {
    /// Pixels of the window per pixel that is sent, in each direction.
    #[must_use]
    pub const fn factor(self) -> u16 {
        match self {
            Self::None => 1,
            Self::Two => 2,
            Self::Four => 4,
        }
    }
}

/// What starts a sensor's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameSync {
    /// The sensor itself, one after the other. Two such sensors are not in step, unless one leads
    /// the other as its [`FrameSync::Slave`].
    FreeRunning,
    /// An edge at the sensor's trigger pin, for each frame.
    Triggered,
    /// Signals from outside, or from a free-running sensor, for exposure, frame and each line.
    Slave,
}

/// A pattern that a sensor sends instead of the picture, to check wires and capture. Each sensor
/// has some of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TestPattern {
    /// The picture.
    Off,
    /// Vertical bars of eight colours.
    ColourBars,
    /// The same bars, fading to grey.
    FadingBars,
    /// A one that walks through the bits of the pixels.
    WalkingOnes,
    /// Levels of grey that change along a line.
    VerticalShades,
    /// Levels of grey that change from line to line.
    HorizontalShades,
    /// Levels of grey that change along both.
    DiagonalShades,
}
