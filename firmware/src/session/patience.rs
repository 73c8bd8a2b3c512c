//! Patience: for how many broken frames in a row a session still feeds its watchdog.

use super::event::Event;

/// Number of frames in a row that may begin and break before the watchdog is no longer fed by
/// their lines.
///
/// Where one frame in two breaks by chance, so many break in a row once in 2^16; where none comes
/// whole, it is half a minute at one frame in two seconds.
pub const PATIENCE_FRAMES: u32 = 16;

/// Decides from the events of a session when its watchdog is fed: by each line that is matched,
/// until [`PATIENCE_FRAMES`] frames in a row have begun and none has come whole; from then on by a
/// whole frame alone.
///
/// Lines count because a frame can take longer than a watchdog waits. They do not count for ever
/// because a camera that breaks each of its frames is as good as dead.
///
/// ```
/// use vgstereo_firmware::Event;
/// use vgstereo_firmware::session::{PATIENCE_FRAMES, Patience};
///
/// let mut patience = Patience::default();
/// for frame in 0..PATIENCE_FRAMES {
///     assert!(patience.feeds(&Event::Line { frame, line: 0 }));
///     assert!(patience.feeds(&Event::Line { frame, line: 1 }));
/// }
/// assert!(!patience.feeds(&Event::Line { frame: 16, line: 0 }));
/// assert!(patience.feeds(&Event::FrameDone { frame: 16 }));
/// assert!(patience.feeds(&Event::Line { frame: 17, line: 0 }));
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Patience {
    /// Number of frames begun since the last one that came whole; saturates.
    begun: u32,
}

impl Patience {
    /// Takes the event of a read and returns whether the watchdog is to be fed. A read whose lines
    /// the sink refused has no event, and does not feed.
    #[must_use]
    pub fn feeds(&mut self, event: &Event) -> bool {
        match event {
            Event::FrameDone { .. } => {
                self.begun = 0;
                return true;
            }
            Event::Line { line: 0, .. } | Event::Resync { .. } => {
                self.begun = self.begun.saturating_add(1);
            }
            Event::Line { .. } => {}
            Event::Skipped { .. } | Event::Fault(_) => return false,
        }
        self.begun <= PATIENCE_FRAMES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::ErrorKind;
    use crate::fault::Fault;

    fn line(frame: u32, line: u32) -> Event {
        Event::Line { frame, line }
    }

    /// Frames that break after `lines` lines: returns how many of `frames` fed the watchdog.
    fn fed_frames(begin: fn(u32) -> Event, lines: u32, frames: u32) -> u32 {
        let mut patience = Patience::default();
        let mut fed = 0;
        for frame in 0..frames {
            let feeds = patience.feeds(&begin(frame));
            for number in 1..lines {
                assert_eq!(patience.feeds(&line(frame, number)), feeds);
            }
            assert!(!patience.feeds(&Event::Fault(Fault::Camera(ErrorKind::ShortFrame))));
            fed += u32::from(feeds);
        }
        fed
    }

    #[test]
    fn frames_that_break_feed_until_patience_ends() {
        for lines in [1, 2, 50] {
            let first_line = |frame| line(frame, 0);
            assert_eq!(fed_frames(first_line, lines, 1000), PATIENCE_FRAMES);
            // The frame before broke without a word.
            let resync = |frame| Event::Resync { frame };
            assert_eq!(fed_frames(resync, lines, 1000), PATIENCE_FRAMES);
        }
    }

    #[test]
    fn a_whole_frame_restores_patience_and_lines_left_out_never_feed() {
        let mut patience = Patience::default();
        for frame in 0..10 * PATIENCE_FRAMES {
            // All but one of as many frames as patience lasts break.
            assert!(patience.feeds(&line(frame, 0)), "frame {frame}");
            assert!(!patience.feeds(&Event::Skipped { frame, line: 3 }));
            assert!(!patience.feeds(&Event::Fault(Fault::Sink)));
            if frame % PATIENCE_FRAMES == PATIENCE_FRAMES - 1 {
                assert!(patience.feeds(&Event::FrameDone { frame }));
            }
        }
    }
}
