//! Frames to match, by a board that then reports.

use vgstereo_core::Kernels;
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::session::ATTEMPT_FRAMES;
use vgstereo_firmware::{DisparitySink, Event, Session, Statistics, Watchdog};

use crate::meter::{Counter, Meter, Stage};

/// Whole frames to match.
#[derive(Debug, Clone, Copy)]
pub struct Task {
    /// Number of whole frames.
    pub frames: u32,
    /// Number of faults of the camera, of which each may break a frame.
    pub faults: u32,
    /// Height of a frame, lines.
    pub height: u32,
}

impl Task {
    /// Steps a session until all frames are done, or the camera has had [`ATTEMPT_FRAMES`] times the lines for them.
    /// `done` is called after each whole frame with its number.
    ///
    /// # Errors
    /// The first error of the sink.
    #[inline(always)]
    pub fn run<C: LinePairSource, K: Kernels, S: DisparitySink, W: Watchdog>(
        self,
        session: &mut Session<'_, C, K, S, W>,
        meter: &Meter<impl Counter>,
        mut done: impl FnMut(u32, Statistics),
    ) -> Result<(), S::Error> {
        let attempts = self.frames.saturating_add(self.faults);
        let reads = attempts
            .saturating_mul(ATTEMPT_FRAMES)
            .saturating_mul(self.height);
        let mut frames = 0;
        for _ in 0..reads {
            if frames == self.frames {
                break;
            }
            let event = meter.measure(Stage::ChecksAndRest, || session.step())?;
            if let Event::FrameDone { frame } = event {
                frames += 1;
                done(frame, session.statistics());
            }
        }
        Ok(())
    }
}
