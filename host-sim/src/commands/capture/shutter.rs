//! When a pair is taken.

use std::time::Duration;

/// Decides which frames are taken: at a key, at equal times, or each.
#[derive(Debug)]
pub(super) struct Shutter {
    every: Option<Duration>,
    /// Whether keys take pairs.
    has_keys: bool,
    pressed: Option<Pressed>,
    /// When the next pair is due; `None` before the first frame.
    due: Option<Duration>,
}

/// A key, and whether the frame that was under way then has gone by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pressed {
    Now,
    Before,
}

/// Why a frame is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cause {
    Key,
    Time,
}

impl Shutter {
    pub(super) fn new(every: Option<Duration>, has_keys: bool) -> Self {
        Self {
            every,
            has_keys,
            pressed: None,
            due: None,
        }
    }

    /// A key was pressed.
    pub(super) fn press(&mut self) {
        self.pressed = Some(Pressed::Now);
    }

    /// Whether the frame that has ended at this time is to be taken, and why. It stays so until
    /// [`Shutter::close`].
    pub(super) fn opens(&mut self, now: Duration) -> Option<Cause> {
        match self.pressed {
            // This one was under way when the key was pressed.
            Some(Pressed::Now) => self.pressed = Some(Pressed::Before),
            Some(Pressed::Before) => return Some(Cause::Key),
            None => {}
        }
        let Some(every) = self.every else {
            return (!self.has_keys).then_some(Cause::Time);
        };
        // A board that has restarted, whose time is told by a recording, begins anew.
        let due = self.due.filter(|&due| due <= now.saturating_add(every));
        let due = *self.due.insert(due.unwrap_or(now.saturating_add(every)));
        (now >= due).then_some(Cause::Time)
    }

    /// The frame was taken, or is not to be.
    pub(super) fn close(&mut self, now: Duration) {
        self.pressed = None;
        self.due = self.every.map(|every| now.saturating_add(every));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    /// The times of the frames that are taken, of one every 100 ms.
    fn taken(shutter: &mut Shutter, frames: std::ops::Range<u64>) -> Vec<u64> {
        frames
            .map(|frame| 100 * frame)
            .filter(|&time| {
                let is_open = shutter.opens(ms(time)).is_some();
                if is_open {
                    shutter.close(ms(time));
                }
                is_open
            })
            .collect()
    }

    #[test]
    fn without_keys_and_times_each_frame_is_taken() {
        assert_eq!(taken(&mut Shutter::new(None, false), 0..3), [0, 100, 200]);
    }

    #[test]
    fn a_key_takes_the_frame_that_begins_after_it() {
        let mut shutter = Shutter::new(None, true);
        assert!(taken(&mut shutter, 0..5).is_empty());
        shutter.press();
        assert_eq!(taken(&mut shutter, 5..9), [600]);
    }

    #[test]
    fn times_take_the_first_frame_at_or_after_them() {
        let mut shutter = Shutter::new(Some(ms(250)), true);
        assert_eq!(taken(&mut shutter, 0..10), [300, 600, 900]);
        shutter.press();
        // The next is due as long after that of the key.
        assert_eq!(taken(&mut shutter, 10..16), [1100, 1400]);
        // What is not taken stays due.
        assert_eq!(shutter.opens(ms(2000)), Some(Cause::Time));
        assert_eq!(shutter.opens(ms(2100)), Some(Cause::Time));
        // The time of a board that has restarted.
        assert_eq!(taken(&mut shutter, 0..5), [300]);
    }
}
