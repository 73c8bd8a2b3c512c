//! What came of a board, in words: frames, packets, and what is missing.

use std::fmt;

use vgstereo_link::Counters;
use vgstereo_link::board::Statistics;

use super::attended::Attended;
use super::board::FrameCounts;

/// What came of a board. Its `Display` is one or several lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tally {
    /// What became of frames.
    pub frames: FrameCounts,
    /// What became of packets.
    pub packets: Counters,
    /// Whether lines of one more frame came than frames have ended.
    pub is_amid_frame: bool,
    /// What the board counted, as it told last.
    pub statistics: Option<Statistics>,
}

impl Tally {
    /// What has come so far.
    #[must_use]
    pub fn of(attended: &Attended<'_>) -> Self {
        Self {
            frames: attended.board.frames.clone(),
            packets: attended.client().counters(),
            is_amid_frame: attended.board.is_amid_frame(),
            statistics: attended.board.statistics,
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FrameCounts {
            whole,
            with_gaps,
            aborted,
            abort_reason,
            stray_lines,
            ..
        } = &self.frames;
        write!(
            f,
            "frames: {whole} whole, {with_gaps} with gaps, {aborted} aborted"
        )?;
        if let Some(reason) = abort_reason {
            write!(f, " (the last: {reason})")?;
        }
        if self.is_amid_frame {
            write!(f, ", and the beginning of another")?;
        }
        let Counters {
            messages,
            broken,
            too_long,
            unknown,
            stale,
            lost,
            restarts,
        } = self.packets;
        write!(
            f,
            "\npackets: {messages} taken, {lost} lost, {broken} broken"
        )?;
        for (count, what) in [
            (too_long, "too long"),
            (unknown, "of unknown kinds"),
            (stale, "repeated or late"),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        for (count, what) in [
            (restarts.into(), "restarts of the board"),
            (*stray_lines, "lines of no frame that had begun"),
        ] {
            if count > 0 {
                write!(f, "; {count} {what}")?;
            }
        }
        if let Some(statistics) = &self.statistics {
            let dropped = statistics.link.dropped;
            let frames = statistics.session.frames_dropped;
            if dropped > 0 || frames > 0 {
                write!(
                    f,
                    "\nthe board itself: {dropped} messages dropped as the line was full, {frames} frames dropped"
                )?;
            }
        }
        Ok(())
    }
}
