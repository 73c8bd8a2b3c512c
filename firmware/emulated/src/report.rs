//! Report of a board's run.

use core::fmt;
use core::str::FromStr;

use vgstereo_firmware::Statistics;

use crate::meter::{PerStage, Stage};

/// Counters of the session, and costs of the run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Report {
    /// Counters of the session.
    pub statistics: Statistics,
    /// Instructions of each stage; meaningless unless the emulator counts instructions.
    pub instructions: PerStage<u64>,
    /// Bytes of the lent memory that matcher and session use.
    pub working_bytes: u32,
    /// Largest number of bytes of stack in use at any time.
    pub stack_bytes: u32,
}

impl Report {
    /// Returns the session's counters with their names.
    pub fn counters(&self) -> impl Iterator<Item = (&'static str, u32)> {
        let mut statistics = self.statistics;
        COUNTERS
            .into_iter()
            .map(move |(name, counter)| (name, *counter(&mut statistics)))
    }
}

impl Report {
    /// Calls `write` with the name and the value of each number.
    ///
    /// # Errors
    /// The first error of `write`.
    pub fn each<E>(&self, mut write: impl FnMut(&str, u64) -> Result<(), E>) -> Result<(), E> {
        for (name, count) in self.counters() {
            write(name, count.into())?;
        }
        for (stage, instructions) in Stage::ALL.into_iter().zip(self.instructions) {
            write(stage.name(), instructions)?;
        }
        write(WORKING_BYTES, self.working_bytes.into())?;
        write(STACK_BYTES, self.stack_bytes.into())
    }
}

type Counter = fn(&mut Statistics) -> &mut u32;

/// Names of the session's counters, and access to each.
const COUNTERS: [(&str, Counter); 13] = [
    ("frames", |s| &mut s.frames),
    ("frames_dropped", |s| &mut s.frames_dropped),
    ("lines", |s| &mut s.lines),
    ("lines_dropped", |s| &mut s.lines_dropped),
    ("sequence_breaks", |s| &mut s.sequence_breaks),
    ("overruns", |s| &mut s.overruns),
    ("sync_losses", |s| &mut s.sync_losses),
    ("short_lines", |s| &mut s.short_lines),
    ("short_frames", |s| &mut s.short_frames),
    ("timeouts", |s| &mut s.timeouts),
    ("bus_errors", |s| &mut s.bus_errors),
    ("other_errors", |s| &mut s.other_errors),
    ("sink_errors", |s| &mut s.sink_errors),
];

const WORKING_BYTES: &str = "working_bytes";
const STACK_BYTES: &str = "stack_bytes";

/// Writes one line `NAME VALUE` per number.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.each(|name, number| writeln!(f, "{name} {number}"))
    }
}

/// Error of parsing a text that is not a complete report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotAReport;

impl fmt::Display for NotAReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the board's report is not complete")
    }
}

impl core::error::Error for NotAReport {}

impl FromStr for Report {
    type Err = NotAReport;

    fn from_str(text: &str) -> Result<Self, NotAReport> {
        fn value<T: FromStr>(text: &str, name: &str) -> Result<T, NotAReport> {
            let mut lines = text.lines().filter_map(|line| line.split_once(' '));
            let line = lines.find(|line| line.0 == name).ok_or(NotAReport)?;
            line.1.parse().map_err(|_| NotAReport)
        }
        let mut report = Self::default();
        for (name, counter) in COUNTERS {
            *counter(&mut report.statistics) = value(text, name)?;
        }
        for (stage, instructions) in Stage::ALL.into_iter().zip(&mut report.instructions) {
            *instructions = value(text, stage.name())?;
        }
        report.working_bytes = value(text, WORKING_BYTES)?;
        report.stack_bytes = value(text, STACK_BYTES)?;
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::string::ToString;

    #[test]
    fn reports_are_read_as_they_are_written() {
        let mut report = Report::default();
        for (index, (_, counter)) in (1..).zip(COUNTERS) {
            *counter(&mut report.statistics) = index;
        }
        report.instructions = core::array::from_fn(|stage| u64::MAX - stage as u64);
        report.working_bytes = 1000;
        report.stack_bytes = 2000;
        let text = report.to_string();
        assert_eq!(text.parse(), Ok(report));
        let (short, _) = text.trim_end().rsplit_once('\n').unwrap();
        assert_eq!(short.parse::<Report>(), Err(NotAReport));
    }

    #[test]
    fn no_counter_of_the_session_is_left_out() {
        let fields = format!("{:?}", Statistics::default());
        assert_eq!(fields.matches(": 0").count(), COUNTERS.len());
        for (name, _) in COUNTERS {
            assert!(fields.contains(&format!(" {name}: 0")), "{name}");
        }
    }
}
