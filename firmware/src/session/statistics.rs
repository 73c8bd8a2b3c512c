//! Statistics: what a session has counted.

use crate::camera::ErrorKind;

use super::sync::Changes;

/// Counters of a session since it began. All counters saturate.
///
/// `lines + lines_dropped` is the number of pairs of lines that the camera has delivered
/// or knows to have lost between deliveries, as far as its numbers have room for them.
///
/// A wrong number from the camera does not spoil a counter: [`sync`](super::sync) bounds what
/// it may add.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Statistics {
    /// Number of frames whose disparities the sink has taken from the first to the last.
    pub frames: u32,
    /// Number of frames that were dropped: begun and not finished, or missed altogether as
    /// the camera's frame numbers tell, up to
    /// [`MISSED_FRAMES_MAX`](super::sync::MISSED_FRAMES_MAX) at a time. Counting starts with the frame of the first pair
    /// delivered. A frame of which no pair was delivered is counted when a pair of a later
    /// one is.
    pub frames_dropped: u32,
    /// Number of pairs of lines given to the matcher, including those of frames that were
    /// dropped later.
    pub lines: u32,
    /// Number of pairs of lines that the camera lost
    /// ([`LinePair::dropped`](crate::camera::LinePair::dropped)) or that were
    /// delivered and left out.
    pub lines_dropped: u32,
    /// Number of times that the camera delivered another pair of lines than the expected
    /// one without having reported an error.
    pub sequence_breaks: u32,
    /// Number of camera errors of kind [`ErrorKind::Overrun`].
    pub overruns: u32,
    /// Number of camera errors of kind [`ErrorKind::SyncLost`].
    pub sync_losses: u32,
    /// Number of camera errors of kind [`ErrorKind::ShortLine`].
    pub short_lines: u32,
    /// Number of camera errors of kind [`ErrorKind::ShortFrame`].
    pub short_frames: u32,
    /// Number of camera errors of kind [`ErrorKind::Timeout`].
    pub timeouts: u32,
    /// Number of camera errors of kind [`ErrorKind::Bus`].
    pub bus_errors: u32,
    /// Number of camera errors of every other kind.
    pub other_errors: u32,
    /// Number of errors that the sink returned.
    pub sink_errors: u32,
}

impl Statistics {
    /// Returns how many camera errors of kind `kind` were counted. Kinds without a counter
    /// of their own share that of [`ErrorKind::Other`].
    #[must_use]
    pub fn errors(mut self, kind: ErrorKind) -> u32 {
        *self.counter(kind)
    }

    /// Counts a camera error of kind `kind`.
    pub(super) fn count_camera_error(&mut self, kind: ErrorKind) {
        add(self.counter(kind), 1);
    }

    /// Counts an error of the sink.
    pub(super) fn count_sink_error(&mut self) {
        add(&mut self.sink_errors, 1);
    }

    /// Adds what a step of synchronisation changes.
    pub(super) fn count(&mut self, changes: Changes) {
        add(&mut self.frames, changes.frames);
        add(&mut self.frames_dropped, changes.frames_dropped);
        add(&mut self.lines, changes.lines);
        add(&mut self.lines_dropped, changes.lines_dropped);
        add(&mut self.sequence_breaks, changes.sequence_breaks);
    }

    fn counter(&mut self, kind: ErrorKind) -> &mut u32 {
        match kind {
            ErrorKind::Overrun => &mut self.overruns,
            ErrorKind::SyncLost => &mut self.sync_losses,
            ErrorKind::ShortLine => &mut self.short_lines,
            ErrorKind::ShortFrame => &mut self.short_frames,
            ErrorKind::Timeout => &mut self.timeouts,
            ErrorKind::Bus => &mut self.bus_errors,
            _ => &mut self.other_errors,
        }
    }
}

fn add(counter: &mut u32, times: u32) {
    *counter = counter.saturating_add(times);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_camera_error_has_its_counter() {
        let kinds = [
            ErrorKind::Overrun,
            ErrorKind::SyncLost,
            ErrorKind::ShortLine,
            ErrorKind::ShortFrame,
            ErrorKind::Timeout,
            ErrorKind::Bus,
            ErrorKind::Other,
        ];
        let mut statistics = Statistics::default();
        for (times, kind) in (1..).zip(kinds) {
            (0..times).for_each(|_| statistics.count_camera_error(kind));
        }
        let expected = Statistics {
            overruns: 1,
            sync_losses: 2,
            short_lines: 3,
            short_frames: 4,
            timeouts: 5,
            bus_errors: 6,
            other_errors: 7,
            ..Statistics::default()
        };
        assert_eq!(statistics, expected);
        for (times, kind) in (1..).zip(kinds) {
            assert_eq!(statistics.errors(kind), times, "{kind:?}");
        }
    }

    #[test]
    fn changes_and_sink_errors_are_added_and_saturate() {
        let changes = Changes {
            frames: 1,
            frames_dropped: 2,
            lines: 3,
            lines_dropped: u32::MAX - 1,
            sequence_breaks: 5,
        };
        let mut statistics = Statistics::default();
        for _ in 0..2 {
            statistics.count(changes);
            statistics.count_sink_error();
        }
        let expected = Statistics {
            frames: 2,
            frames_dropped: 4,
            lines: 6,
            lines_dropped: u32::MAX,
            sequence_breaks: 10,
            sink_errors: 2,
            ..Statistics::default()
        };
        assert_eq!(statistics, expected);
    }
}
