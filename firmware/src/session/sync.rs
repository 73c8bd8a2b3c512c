//! Synchronisation: which pairs of lines make up a whole frame, and how frames are counted.
//!
//! Here are the decisions of a session and nothing that carries them out: numbers of frames
//! and lines come in, an [`Action`] and the [`Changes`] of the counters go out. No number
//! and no order of calls makes any of it panic, and no number that is wrong counts for more
//! than [`MISSED_FRAMES_MAX`] frames.

/// Largest number of frames that are taken for missed when a frame's number leaps ahead. A
/// number further ahead is taken for wrong, or for that of a camera that counts anew, and tells
/// of no missed frame.
///
/// Eight seconds at 30 frames per second: when nothing was matched for longer, the watchdog of a
/// board has reset it. So hardly a gap that a board lives through is cut short, and a number in
/// which one bit is wrong adds at most this to a counter instead of up to 2^31.
pub const MISSED_FRAMES_MAX: u32 = 256;

/// Action that a pair of lines asks of the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Match the pair: it is the next line of the frame that is being read.
    Match,
    /// Begin the pair's frame and match the pair as its line 0.
    Begin,
    /// Leave the pair out: its frame is already dropped or did not begin with line 0.
    Skip,
    /// The pair is not the expected one, but the first of another frame. Abort the frame
    /// that is being read, then begin the pair's frame and match the pair as its line 0.
    Resync {
        /// Number of the frame to abort; `None` when no frame is being read.
        abort: Option<u32>,
    },
    /// The pair is not the expected one and begins no frame. Abort the frame that is being
    /// read and leave the pair out.
    Reject {
        /// Number of the frame to abort; `None` when no frame is being read.
        abort: Option<u32>,
    },
}

/// Additions to the counters of a session, from one call.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Changes {
    /// Number of frames that are done: 0 or 1.
    pub frames: u32,
    /// Number of frames that are dropped, including those that were missed before them.
    pub frames_dropped: u32,
    /// Number of pairs of lines that are matched: 0 or 1.
    pub lines: u32,
    /// Number of pairs of lines that the camera lost, as far as its numbers leave room for them,
    /// or that are left out; saturates.
    pub lines_dropped: u32,
    /// Number of pairs of lines that came in place of the expected one: 0 or 1.
    pub sequence_breaks: u32,
}

impl Changes {
    /// Returns the sum of both changes. Each count saturates.
    #[must_use]
    fn and(self, other: Self) -> Self {
        Self {
            frames: self.frames.saturating_add(other.frames),
            frames_dropped: self.frames_dropped.saturating_add(other.frames_dropped),
            lines: self.lines.saturating_add(other.lines),
            lines_dropped: self.lines_dropped.saturating_add(other.lines_dropped),
            sequence_breaks: self.sequence_breaks.saturating_add(other.sequence_breaks),
        }
    }
}

/// Pair of lines, or answer, that the state machine waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Line 0 of any frame but the one done or dropped last. Other pairs are left out without
    /// a fault.
    Searching,
    /// Line 0 of the frame after the one that ended last.
    Between,
    /// The report whether `frame`, whose line 0 was delivered, has begun.
    Beginning { frame: u32 },
    /// Line `next_line` of `frame`; if that is the height, the report whether the frame has
    /// ended.
    Reading { frame: u32, next_line: u32 },
}

/// Number of the first frame that is neither done nor dropped; `None` before the first pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct NextFrame(Option<u32>);

impl NextFrame {
    /// Returns whether `frame` is the one done or dropped last, so that its pairs, line 0
    /// included, are of no use.
    fn is_past(self, frame: u32) -> bool {
        self.0 == Some(frame.wrapping_add(1))
    }

    /// Moves on to `frame` and returns how many frames were missed before it.
    fn go_to(&mut self, frame: u32) -> u32 {
        let missed = self.0.map_or(0, |next| missed_frames(next, frame));
        self.0 = Some(frame);
        missed
    }
}

/// Returns how many frames were missed when `next` was due and `frame` came. A number that goes
/// back, as when the camera is restarted, or leaps further than [`MISSED_FRAMES_MAX`], tells of
/// none.
fn missed_frames(next: u32, frame: u32) -> u32 {
    // Numbers wrap: one that has gone back is very far ahead.
    let ahead = frame.wrapping_sub(next);
    if ahead <= MISSED_FRAMES_MAX { ahead } else { 0 }
}

/// Place of a pair in the order of all pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    frame: u32,
    line: u32,
}

impl Place {
    /// Returns how many pairs lie between this place and a `later` one, in frames of `height`
    /// lines; 0 if that is not later. Lines below the frame count as its last. Saturates.
    fn pairs_until(self, later: Self, height: u32) -> u32 {
        let line = later.line.min(height);
        if later.frame == self.frame {
            return line.saturating_sub(self.line).saturating_sub(1);
        }
        let missed = missed_frames(self.frame.wrapping_add(1), later.frame);
        let rest = height.saturating_sub(self.line).saturating_sub(1);
        let missed_lines = missed.saturating_mul(height);
        missed_lines.saturating_add(rest).saturating_add(line)
    }
}

/// Decides for each pair of lines what is to be done with it.
///
/// Give it the numbers of every pair with [`pair`](Self::pair), do what that returns, and
/// report what came of it: [`begun`](Self::begun) when a frame has begun,
/// [`ended`](Self::ended) when a [whole](Self::is_whole) frame has ended, and
/// [`failed`](Self::failed) when one of these or the matching failed. `failed` also reports
/// an error of the camera. A begin that is not reported counts as failed; `begun` and `ended`
/// change nothing when no frame is to begin or to end.
///
/// Frame numbers wrap from `u32::MAX` to 0. When a number is ahead of the one before it by no
/// more than [`MISSED_FRAMES_MAX`] frames, those in between were missed; any other jump is taken
/// for a camera that counts anew, or for a number that is wrong. A wrong number loses its frame,
/// and `frames_dropped` counts that up to three times: the frame that breaks, the one that the
/// number tells of, and the rest of the frame that breaks.
///
/// ```
/// use vgstereo_firmware::session::sync::{Action, FrameSync};
///
/// let mut sync = FrameSync::new(2);
/// // The camera is amid frame 6 when it is first read.
/// assert_eq!(sync.pair(6, 1, 0).0, Action::Skip);
/// assert_eq!(sync.pair(7, 0, 0).0, Action::Begin);
/// assert_eq!(sync.begun().lines, 1);
/// // Line 1 of frame 7 is lost.
/// let (action, changes) = sync.pair(8, 0, 1);
/// assert_eq!(action, Action::Resync { abort: Some(7) });
/// assert_eq!((changes.frames_dropped, changes.lines_dropped), (1, 1));
/// let _ = sync.begun();
/// assert_eq!(sync.pair(8, 1, 0).0, Action::Match);
/// assert!(sync.is_whole());
/// assert_eq!(sync.ended().frames, 1);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameSync {
    /// Number of lines of a frame.
    height: u32,
    state: State,
    next_frame: NextFrame,
    /// Place of the pair that was delivered last; `None` before the first.
    last: Option<Place>,
}

impl FrameSync {
    /// Returns the state before the first pair, for frames of `height` lines; 0 is taken
    /// for 1.
    #[must_use]
    pub const fn new(height: u32) -> Self {
        Self {
            height,
            state: State::Searching,
            next_frame: NextFrame(None),
            last: None,
        }
    }

    /// Whether a frame has begun and neither ended nor failed.
    #[must_use]
    pub const fn is_reading(&self) -> bool {
        matches!(self.state, State::Reading { .. })
    }

    /// Takes the numbers of a pair that was delivered: its frame, its line, counted from 0,
    /// and how many pairs are known to be lost between the pair before and this one; more than
    /// lie between the two do not count.
    /// Returns what is to be done with it and what that changes.
    #[must_use]
    pub fn pair(&mut self, frame: u32, line: u32, dropped: u32) -> (Action, Changes) {
        let mut changes = Changes::default();
        if matches!(self.state, State::Beginning { .. }) {
            changes = self.failed().1;
        }
        let place = Place { frame, line };
        let last = self.last.replace(place);
        let room = last.map_or(0, |last| last.pairs_until(place, self.height));
        changes.lines_dropped = changes.lines_dropped.saturating_add(dropped.min(room));

        let expected = match self.state {
            State::Reading {
                frame: read,
                next_line,
            } => {
                if (frame, line) == (read, next_line) && line < self.height {
                    let next_line = next_line.saturating_add(1);
                    self.state = State::Reading { frame, next_line };
                    changes.lines = 1;
                    return (Action::Match, changes);
                }
                false
            }
            State::Between => line == 0 && self.next_frame == NextFrame(Some(frame)),
            State::Searching | State::Beginning { .. } => true,
        };
        let mut abort = None;
        if !expected {
            let (open, dropped) = self.failed();
            abort = open;
            changes = changes.and(dropped);
            changes.sequence_breaks = 1;
        }

        let is_past = self.next_frame.is_past(frame);
        let begins = line == 0 && !is_past;
        if begins {
            self.state = State::Beginning { frame };
        } else {
            changes.lines_dropped = changes.lines_dropped.saturating_add(1);
            if !is_past {
                changes = changes.and(self.drop_frame(frame));
            }
        }
        let action = match (expected, begins) {
            (true, true) => Action::Begin,
            (true, false) => Action::Skip,
            (false, true) => Action::Resync { abort },
            (false, false) => Action::Reject { abort },
        };
        (action, changes)
    }

    /// Takes the report that the frame of [`Action::Begin`] or [`Action::Resync`] has begun,
    /// so that its line 0 is matched. Returns what that changes.
    #[must_use]
    pub fn begun(&mut self) -> Changes {
        let State::Beginning { frame } = self.state else {
            return Changes::default();
        };
        let next_line = 1;
        self.state = State::Reading { frame, next_line };
        Changes {
            frames_dropped: self.next_frame.go_to(frame),
            lines: 1,
            ..Changes::default()
        }
    }

    /// Returns whether all lines of the frame that is being read have been matched, so that
    /// it can end.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        matches!(self.state, State::Reading { next_line, .. } if next_line >= self.height)
    }

    /// Takes the report that the whole frame has ended. Returns what that changes.
    #[must_use]
    pub fn ended(&mut self) -> Changes {
        match self.state {
            State::Reading { frame, .. } if self.is_whole() => {
                self.state = State::Between;
                self.next_frame = NextFrame(Some(frame.wrapping_add(1)));
                Changes {
                    frames: 1,
                    ..Changes::default()
                }
            }
            _ => Changes::default(),
        }
    }

    /// Takes the report that the camera, the matcher or the sink failed. Returns the number of
    /// the frame to abort, if one is being read, and what that changes.
    #[must_use]
    pub fn failed(&mut self) -> (Option<u32>, Changes) {
        let state = core::mem::replace(&mut self.state, State::Searching);
        match state {
            State::Reading { frame, .. } => (Some(frame), self.drop_frame(frame)),
            State::Beginning { frame } => {
                let lost_line = Changes {
                    lines_dropped: 1,
                    ..Changes::default()
                };
                (None, lost_line.and(self.drop_frame(frame)))
            }
            State::Searching | State::Between => (None, Changes::default()),
        }
    }

    /// Moves on past `frame`, which is dropped. Returns the counts of it and of the frames
    /// missed before it.
    fn drop_frame(&mut self, frame: u32) -> Changes {
        let missed = self.next_frame.go_to(frame);
        self.next_frame = NextFrame(Some(frame.wrapping_add(1)));
        Changes {
            frames_dropped: missed.saturating_add(1),
            ..Changes::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::format;
    use std::vec;
    use std::vec::Vec;

    /// What happens at one read of the camera.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Read {
        /// The camera reports an error.
        Error,
        /// A pair is delivered. The frame's number does not wrap here.
        Pair {
            frame: u64,
            line: u32,
            dropped: u32,
            fails: Fails,
        },
    }

    /// What fails of that which is to be done with a pair.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Fails {
        Nothing,
        /// The begin of the frame, if the pair begins one.
        Begin,
        /// Matching the pair, or the end of the frame with it.
        Line,
    }

    fn pair(frame: u64, line: u32) -> Read {
        Read::Pair {
            frame,
            line,
            dropped: 0,
            fails: Fails::Nothing,
        }
    }

    /// What came of a log of reads.
    #[derive(Debug, Default, PartialEq)]
    struct Outcome {
        /// One for each pair.
        actions: Vec<Action>,
        begun: Vec<u32>,
        done: Vec<u32>,
        aborted: Vec<u32>,
        frames_dropped: u64,
        lines: u64,
        lines_dropped: u64,
        sequence_breaks: u64,
    }

    impl Outcome {
        fn count(&mut self, changes: Changes) {
            self.frames_dropped += u64::from(changes.frames_dropped);
            self.lines += u64::from(changes.lines);
            self.lines_dropped += u64::from(changes.lines_dropped);
            self.sequence_breaks += u64::from(changes.sequence_breaks);
        }

        /// Number of frames begun and neither ended nor aborted.
        fn open(&self) -> usize {
            self.begun.len() - self.done.len() - self.aborted.len()
        }
    }

    /// Does as a session does.
    fn outcome(height: u32, log: &[Read]) -> Outcome {
        let mut sync = FrameSync::new(height);
        let mut outcome = Outcome::default();
        let fail = |sync: &mut FrameSync, outcome: &mut Outcome| {
            let (abort, changes) = sync.failed();
            assert_eq!((changes.frames, changes.lines), (0, 0));
            outcome.aborted.extend(abort);
            outcome.count(changes);
        };
        for read in log {
            let Read::Pair {
                frame,
                line,
                dropped,
                fails,
            } = *read
            else {
                fail(&mut sync, &mut outcome);
                continue;
            };
            let (action, changes) = sync.pair(frame as u32, line, dropped);
            assert_eq!(changes.frames, 0);
            outcome.actions.push(action);
            outcome.count(changes);
            if let Action::Resync { abort } | Action::Reject { abort } = action {
                outcome.aborted.extend(abort);
            }
            match action {
                Action::Skip | Action::Reject { .. } => continue,
                Action::Match => {}
                Action::Begin | Action::Resync { .. } => {
                    assert_eq!(outcome.open(), 0, "a frame begins within another: {log:?}");
                    assert!(!sync.is_whole());
                    if fails == Fails::Begin {
                        fail(&mut sync, &mut outcome);
                        continue;
                    }
                    outcome.begun.push(frame as u32);
                    outcome.count(sync.begun());
                }
            }
            if fails == Fails::Line {
                fail(&mut sync, &mut outcome);
            } else if sync.is_whole() {
                let changes = sync.ended();
                assert_eq!(changes.frames, 1);
                outcome.done.push(frame as u32);
                outcome.count(changes);
            }
        }
        outcome
    }

    /// Frame and line of the pair before the read `at`, errors left out.
    fn place_before(log: &[Read], at: usize) -> Option<(u64, u32)> {
        log[..at].iter().rev().find_map(|read| match read {
            Read::Pair { frame, line, .. } => Some((*frame, *line)),
            Read::Error => None,
        })
    }

    /// The frame of the pair before the read `at`, errors left out.
    fn pair_before(log: &[Read], at: usize) -> Option<u64> {
        place_before(log, at).map(|(frame, _)| frame)
    }

    /// Whether numbers that go from one frame to a later one tell of the frames in between.
    fn is_ahead(before: u64, frame: u64) -> bool {
        before <= frame && frame - before <= u64::from(MISSED_FRAMES_MAX) + 1
    }

    /// Of the pairs that the camera says it lost before the read `at`, those for which its
    /// numbers have room. A frame that is not ahead is taken for the one after.
    fn lost_before(height: u32, log: &[Read], at: usize) -> u64 {
        let Read::Pair {
            frame,
            line,
            dropped,
            ..
        } = log[at]
        else {
            return 0;
        };
        let Some((before, line_before)) = place_before(log, at) else {
            return 0;
        };
        let frames = if is_ahead(before, frame) {
            frame - before
        } else {
            1
        };
        let place = u64::from(height) * frames + u64::from(line.min(height));
        let room = place.saturating_sub(u64::from(line_before) + 1);
        u64::from(dropped).min(room)
    }

    /// Whether the read `at` brings line 0 of a frame of which the pair before is no part.
    fn begins(log: &[Read], at: usize) -> bool {
        matches!(log[at], Read::Pair { frame, line: 0, .. }
            if pair_before(log, at) != Some(frame))
    }

    /// Whether the pair of the read `at` is matched: it begins a frame or follows a matched one.
    fn is_matched(height: u32, log: &[Read], at: usize) -> bool {
        let Read::Pair {
            frame, line, fails, ..
        } = log[at]
        else {
            return false;
        };
        if line == 0 {
            begins(log, at) && fails != Fails::Begin
        } else {
            expected(height, log, at) == Some((frame, line))
        }
    }

    /// The pair that is expected at the read `at`, if one is: that after a matched one.
    fn expected(height: u32, log: &[Read], at: usize) -> Option<(u64, u32)> {
        let before = at.checked_sub(1)?;
        let Read::Pair {
            frame, line, fails, ..
        } = log[before]
        else {
            return None;
        };
        if fails == Fails::Line || !is_matched(height, log, before) {
            None
        } else if line + 1 < height {
            Some((frame, line + 1))
        } else {
            Some((frame + 1, 0))
        }
    }

    /// What must come of a log. It keeps no state: each read is judged by those before it,
    /// and frames are counted by the distances of their numbers.
    fn oracle(height: u32, log: &[Read]) -> Outcome {
        let mut outcome = Outcome::default();
        let mut seen = 0;
        for at in 0..=log.len() {
            let expected = expected(height, log, at);
            let open = expected.filter(|(_, line)| *line > 0);
            let open = open.map(|(frame, _)| frame as u32);
            let Some(read) = log.get(at) else {
                let settled = outcome.done.len() + usize::from(open.is_some());
                outcome.frames_dropped = seen - settled as u64;
                break;
            };
            let Read::Pair {
                frame, line, fails, ..
            } = *read
            else {
                outcome.aborted.extend(open);
                continue;
            };
            let number = frame as u32;
            seen += match pair_before(log, at) {
                Some(before) if is_ahead(before, frame) => frame - before,
                _ => 1,
            };
            let is_expected = expected.is_none_or(|expected| expected == (frame, line));
            let abort = open.filter(|_| !is_expected);
            outcome.aborted.extend(abort);
            outcome.sequence_breaks += u64::from(!is_expected);
            outcome.actions.push(match (begins(log, at), is_expected) {
                (false, _) if expected == Some((frame, line)) => Action::Match,
                (true, true) => Action::Begin,
                (true, false) => Action::Resync { abort },
                (false, true) => Action::Skip,
                (false, false) => Action::Reject { abort },
            });
            let matched = is_matched(height, log, at);
            outcome.lines += u64::from(matched);
            outcome.lines_dropped += lost_before(height, log, at) + u64::from(!matched);
            if matched {
                if line == 0 {
                    outcome.begun.push(number);
                }
                if fails != Fails::Line && line + 1 >= height {
                    outcome.done.push(number);
                }
                // The begin of a frame that fails at once shows in no later expectation.
                if fails == Fails::Line {
                    outcome.aborted.push(number);
                }
            }
        }
        outcome
    }

    /// Judges a log by the oracle and by what holds of every log.
    fn check(height: u32, log: &[Read]) {
        let outcome = outcome(height, log);
        assert_eq!(outcome, oracle(height, log), "height {height}: {log:?}");

        let reads = log.iter().enumerate().map(|(at, read)| match read {
            Read::Error => 0,
            Read::Pair { .. } => 1 + lost_before(height, log, at),
        });
        assert_eq!(outcome.lines + outcome.lines_dropped, reads.sum());

        let mut closed = [&outcome.done[..], &outcome.aborted].concat();
        closed.sort_unstable();
        let mut begun = outcome.begun.clone();
        if outcome.open() == 1 {
            begun.pop();
        }
        begun.sort_unstable();
        assert_eq!(closed, begun, "each frame begun ends or is aborted once");

        // While numbers neither go back nor leap, each counts once.
        let frames = log.iter().filter_map(|read| match read {
            Read::Error => None,
            Read::Pair { frame, .. } => Some(*frame),
        });
        let frames: Vec<u64> = frames.collect();
        if frames.is_sorted_by(|&before, &frame| is_ahead(before, frame))
            && let (Some(first), Some(last)) = (frames.first(), frames.last())
        {
            let counted = outcome.done.len() + outcome.open();
            let counted = counted as u64 + outcome.frames_dropped;
            assert_eq!(counted, last - first + 1);
        }
    }

    /// Just before numbers wrap.
    const FIRST: u64 = (1 << 33) - 2;

    #[test]
    fn all_short_logs_come_out_as_the_oracle_says() {
        for (height, reads) in [(1, 5), (2, 5), (3, 5)] {
            let mut alphabet = vec![Read::Error];
            for frame in FIRST..FIRST + 3 {
                let lines = if height == 1 { 2 } else { height };
                alphabet.extend((0..lines).map(|line| pair(frame, line)));
            }
            for (line, fails) in [
                (0, Fails::Begin),
                (0, Fails::Line),
                (height - 1, Fails::Line),
            ] {
                alphabet.push(Read::Pair {
                    frame: FIRST + 1,
                    line,
                    dropped: 3,
                    fails,
                });
            }
            for index in 0..alphabet.len().pow(reads) {
                let digits = (0..reads).map(|digit| index / alphabet.len().pow(digit));
                let log: Vec<Read> = digits.map(|at| alphabet[at % alphabet.len()]).collect();
                check(height, &log);
            }
        }
    }

    /// A camera that goes wrong at each pair with a chance of one in `rarity`.
    fn random_log(generator: &mut Pcg32, height: u32, rarity: u32, first: u64) -> Vec<Read> {
        let mut below = |limit: u32| generator.next_u32() % limit;
        let (mut frame, mut line, mut dropped) = (first, 0, 0);
        let mut log = Vec::new();
        for _ in 0..200 {
            let wrong = if below(rarity) == 0 { below(9) } else { 9 };
            let fails = match wrong {
                0 => Fails::Begin,
                1 => Fails::Line,
                _ => Fails::Nothing,
            };
            let read = Read::Pair {
                frame,
                line,
                dropped,
                fails,
            };
            match wrong {
                2 => log.push(Read::Error),
                // Lost with no error to tell of it.
                3 => {}
                // Delivered twice.
                4 => log.extend([read, pair(frame, line)]),
                // Delivered after the one before it in time.
                5 => log.insert(log.len().saturating_sub(1), read),
                // The rest of the frame and some more are lost.
                6 => (frame, line) = (frame + u64::from(below(4)), height - 1),
                // The camera counts anew.
                7 => (frame, line) = (first - u64::from(below(9)), height - 1),
                // Nothing of very many frames came.
                8 => frame += 1 << below(20),
                _ => log.push(read),
            }
            dropped = match wrong {
                2 | 3 => dropped + 1,
                6..=8 => below(3),
                _ => 0,
            };
            line += 1;
            if line >= height {
                (frame, line) = (frame + 1, 0);
            }
        }
        log
    }

    #[test]
    fn random_faults_come_out_as_the_oracle_says() {
        for seed in 0..400 {
            std::println!("seed {seed}");
            let mut generator = Pcg32::seed_from_u64(seed);
            let height = 1 + generator.next_u32() % 6;
            let rarity = [1, 2, 5, 20][generator.next_u32() as usize % 4];
            let first = FIRST - u64::from(generator.next_u32() % 64);
            check(height, &random_log(&mut generator, height, rarity, first));
        }
    }

    #[test]
    fn frames_are_missed_as_far_ahead_as_is_stated() {
        for start in [0, 1, 1 << 31, u32::MAX] {
            for (step, dropped) in [
                (0, 0),
                (1, 1),
                (2, 2),
                (MISSED_FRAMES_MAX + 1, MISSED_FRAMES_MAX + 1),
                // From here on the camera counts anew.
                (MISSED_FRAMES_MAX + 2, 1),
                (1 << 31, 1),
                (u32::MAX, 1),
            ] {
                let mut sync = FrameSync::new(4);
                assert_eq!(sync.pair(start, 3, 0).1.frames_dropped, 1);
                let (action, changes) = sync.pair(start.wrapping_add(step), 3, 0);
                assert_eq!(action, Action::Skip);
                assert_eq!(changes.frames_dropped, dropped, "{start} + {step}");
            }
        }
    }

    /// Whole frames with one wrong bit in one number of one pair.
    #[test]
    fn a_wrong_bit_counts_no_more_than_is_stated() {
        let height = 6;
        for first in [0, 1000, u32::MAX - 1] {
            for (bit, line) in (0..32).flat_map(|bit| (0..height).map(move |line| (bit, line))) {
                let flipped = 1 << bit;
                for (frame_bit, line_bit, dropped) in
                    [(flipped, 0, 0), (0, flipped, 0), (0, 0, flipped)]
                {
                    let mut sync = FrameSync::new(height);
                    let mut sum = Changes::default();
                    for pair in 0..5 * height {
                        let frame = first.wrapping_add(pair / height);
                        let is_wrong = pair == 2 * height + line;
                        let wrong = |bit: u32| if is_wrong { bit } else { 0 };
                        let (frame, number) =
                            (frame ^ wrong(frame_bit), (pair % height) ^ wrong(line_bit));
                        sum = sum.and(sync.pair(frame, number, wrong(dropped)).1);
                        sum = sum.and(sync.begun()).and(sync.ended());
                    }
                    let what = format!("{first} {bit} {line} {frame_bit} {line_bit}");
                    assert_eq!(sum.lines + sum.lines_dropped, 5 * height, "{what}");
                    if dropped > 0 {
                        assert_eq!((sum.frames, sum.frames_dropped), (5, 0), "{what}");
                        continue;
                    }
                    // A last line with the number of the next frame takes that along.
                    let takes_next = line == height - 1 && frame_bit == 1;
                    let is_next = (first.wrapping_add(2)) & 1 == 0;
                    let whole = 4 - u32::from(takes_next && is_next);
                    assert_eq!(sum.frames, whole, "{what}");
                    // A number that is near counts what lies between, a far one two more.
                    let missed = if frame_bit <= MISSED_FRAMES_MAX {
                        frame_bit
                    } else {
                        0
                    };
                    assert!(
                        (1..=3 + missed).contains(&sum.frames_dropped),
                        "{what}: {sum:?}"
                    );
                    assert!((1..=3).contains(&sum.sequence_breaks), "{what}: {sum:?}");
                }
            }
        }
    }

    #[test]
    fn a_line_below_the_frame_is_never_matched() {
        for height in [0, 1, 2, u32::MAX] {
            let mut sync = FrameSync::new(height);
            assert_eq!(sync.pair(5, 0, 0).0, Action::Begin);
            let _ = sync.begun();
            if height == 2 {
                assert_eq!(sync.pair(5, 1, 0).0, Action::Match);
            }
            assert_eq!(sync.is_whole(), height <= 2, "{height}");
            // The end of the frame was not told.
            let line = if height == u32::MAX {
                height
            } else {
                height.max(1)
            };
            let (action, _) = sync.pair(5, line, 0);
            assert_eq!(action, Action::Reject { abort: Some(5) }, "{height}");
        }
    }

    #[test]
    fn a_begin_without_an_answer_has_failed() {
        let mut sync = FrameSync::new(2);
        assert_eq!(sync.pair(5, 0, 0), (Action::Begin, Changes::default()));
        // Line 0 of frame 5, and line 1, for which alone there is room.
        let changes = Changes {
            frames_dropped: 1,
            lines_dropped: 2,
            ..Changes::default()
        };
        assert_eq!(sync.pair(6, 0, u32::MAX), (Action::Begin, changes));
    }

    #[test]
    fn answers_out_of_turn_change_nothing() {
        let mut sync = FrameSync::new(2);
        let begin = |sync: &mut FrameSync| {
            assert_eq!(sync.pair(5, 0, 0).0, Action::Begin);
            let before = sync.clone();
            assert_eq!(sync.ended(), Changes::default());
            assert_eq!(*sync, before);
            assert_eq!(sync.begun().lines, 1);
        };
        let nothing = |sync: &mut FrameSync| {
            let before = sync.clone();
            assert_eq!(sync.begun(), Changes::default());
            assert_eq!(sync.ended(), Changes::default());
            assert_eq!(*sync, before);
        };
        nothing(&mut sync);
        begin(&mut sync);
        nothing(&mut sync);
        assert_eq!(sync.pair(5, 1, 0).0, Action::Match);
        assert_eq!(sync.begun(), Changes::default());
        assert_eq!(sync.ended().frames, 1);
        nothing(&mut sync);
    }

    #[test]
    fn no_numbers_and_no_order_of_calls_break_it() {
        let numbers = [0, 1, 2, 3, 1 << 31, u32::MAX - 2, u32::MAX - 1, u32::MAX];
        for seed in 0..400 {
            std::println!("seed {seed}");
            let mut generator = Pcg32::seed_from_u64(seed);
            let mut number = || match generator.next_u32() {
                random if random & 15 == 0 => random,
                random => numbers[(random >> 8) as usize % numbers.len()],
            };
            let mut sync = FrameSync::new(number());
            let (mut begun, mut done, mut aborted) = (0, 0, 0);
            let (mut delivered, mut counted, mut lost) = (0, 0, 0);
            for _ in 0..500 {
                let before = sync.clone();
                let changes = match number() % 6 {
                    0 => sync.begun(),
                    1 => sync.ended(),
                    2 => {
                        let (abort, changes) = sync.failed();
                        aborted += u32::from(abort.is_some());
                        changes
                    }
                    _ => {
                        // Two more would be counted for one begin and one pair.
                        let dropped = number().min(u32::MAX - 2);
                        lost += u64::from(dropped);
                        delivered += 1;
                        let (frame, line) = match before.state {
                            State::Reading { frame, next_line } if number() < 4 => {
                                (frame, next_line)
                            }
                            _ => (number(), number() & number()),
                        };
                        let (action, changes) = sync.pair(frame, line, dropped);
                        if let Action::Resync { abort } | Action::Reject { abort } = action {
                            aborted += u32::from(abort.is_some());
                            assert_eq!(changes.sequence_breaks, 1);
                        }
                        assert_eq!(changes.lines == 1, action == Action::Match);
                        changes
                    }
                };
                let is_begun = matches!(before.state, State::Beginning { .. })
                    && matches!(sync.state, State::Reading { .. });
                begun += u32::from(is_begun);
                done += changes.frames;
                counted += u64::from(changes.lines) + u64::from(changes.lines_dropped);
                let open = u32::from(matches!(sync.state, State::Reading { .. }));
                assert_eq!(begun, done + aborted + open);
                let waiting = u64::from(matches!(sync.state, State::Beginning { .. }));
                let counted = counted + waiting;
                assert!((delivered..=delivered + lost).contains(&counted));
            }
        }
    }
}
