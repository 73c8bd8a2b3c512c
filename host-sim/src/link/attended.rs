//! A board that is asked for something and waited for.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use vgstereo_link::board::Outcome;
use vgstereo_link::{BoardMessage, HostMessage, Packet};

use super::board::{Board, Change, Frame, outcome_name};
use super::client::{Client, Memory};
use super::source::{Received, Source};

/// For how long an answer is waited for, unless another time is given. A board takes
/// commands between frames, of which a slow one has one in some seconds.
const PATIENCE: Duration = Duration::from_secs(30);
/// For how long a hello is waited for before it is asked for once more: what a board has heard while
/// it started may be lost.
const HELLO_WAIT: Duration = Duration::from_secs(2);

/// Learns of all that a board sends, as it comes.
pub trait Observer: std::fmt::Debug + Send {
    /// Bytes have come, at this time, ns since 1970; `None` where it is not known.
    ///
    /// # Errors
    /// Fails where they cannot be dealt with.
    fn bytes(&mut self, _arrived_ns: Option<u64>, _bytes: &[u8]) -> Result<()> {
        Ok(())
    }

    /// A packet is whole. The board is as it was before.
    ///
    /// # Errors
    /// Fails where it cannot be dealt with.
    fn packet(
        &mut self,
        _arrived_ns: Option<u64>,
        _packet: &Packet<BoardMessage<'_>>,
    ) -> Result<()> {
        Ok(())
    }

    /// A frame has ended, of which lines may be missing.
    ///
    /// # Errors
    /// Fails where it cannot be dealt with.
    fn frame(&mut self, _arrived_ns: Option<u64>, _frame: &Frame, _board: &Board) -> Result<()> {
        Ok(())
    }
}

/// A board with all that it has told. Frames that come while an answer is waited for are kept.
#[derive(Debug)]
pub struct Attended<'m> {
    client: Client<'m>,
    name: String,
    /// What the board has told.
    pub board: Board,
    patience: Duration,
    frames: VecDeque<Box<Frame>>,
    /// The command that is waited for, and what became of it.
    awaited: Option<u32>,
    outcome: Option<Outcome>,
    end: Option<String>,
    observer: Option<&'m mut dyn Observer>,
}

impl<'m> Attended<'m> {
    /// Opens a source. A board is asked for its hello, and waited for until it has introduced itself;
    /// of a recording nothing is read yet.
    ///
    /// # Errors
    /// Fails with one line that names the source and the reason.
    pub fn open(source: &Source, memory: &'m mut Memory) -> Result<Self> {
        Self::connect(source, memory, PATIENCE)
    }

    /// Opens a source as [`Attended::open`] does, but waits so long for each answer.
    ///
    /// # Errors
    /// As [`Attended::open`].
    pub fn connect(source: &Source, memory: &'m mut Memory, patience: Duration) -> Result<Self> {
        Self::start(source, memory, patience, None)
    }

    /// Opens a source as [`Attended::open`] does. The observer learns of all that comes, from the first
    /// byte on.
    ///
    /// # Errors
    /// Fails with one line that names the source and the reason, or as the observer does.
    pub fn observed(
        source: &Source,
        memory: &'m mut Memory,
        observer: Option<&'m mut dyn Observer>,
    ) -> Result<Self> {
        Self::start(source, memory, PATIENCE, observer)
    }

    fn start(
        source: &Source,
        memory: &'m mut Memory,
        patience: Duration,
        observer: Option<&'m mut dyn Observer>,
    ) -> Result<Self> {
        let name = source.name();
        let client = Client::new(source.open()?, memory).with_context(|| name.clone())?;
        let mut attended = Self {
            client,
            name,
            board: Board::default(),
            patience,
            frames: VecDeque::new(),
            awaited: None,
            outcome: None,
            end: None,
            observer,
        };
        if !attended.client.is_recording() {
            attended.greet()?;
        }
        Ok(attended)
    }

    /// The connection.
    #[must_use]
    pub fn client(&self) -> &Client<'m> {
        &self.client
    }

    /// The name of the source.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The next frame that has ended, of which lines may be missing; `None` when a recording is at its
    /// end.
    ///
    /// # Errors
    /// Fails when the board is lost.
    pub fn frame(&mut self) -> Result<Option<Box<Frame>>> {
        loop {
            if let Some(frame) = self.poll()? {
                return Ok(Some(frame));
            }
            if self.has_ended() {
                return Ok(None);
            }
        }
    }

    /// Reads once, and returns the oldest frame that has ended and was not taken, if there is one by then.
    ///
    /// # Errors
    /// Fails when the board is lost.
    pub fn poll(&mut self) -> Result<Option<Box<Frame>>> {
        if self.frames.is_empty() {
            self.read()?;
        }
        Ok(self.frames.pop_front())
    }

    /// Whether it is a recording of which all was read, and all frames were taken.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.end.is_some() && self.frames.is_empty()
    }

    /// Forgets the frames that have come and were not taken.
    pub fn drop_frames(&mut self) {
        self.frames.clear();
    }

    /// Sends a command and does not wait. To a recording, nothing is sent.
    ///
    /// # Errors
    /// Fails when the port does not take it in time.
    pub fn send(&mut self, message: &HostMessage<'_>) -> std::io::Result<()> {
        self.client.send(message).map(|_| ())
    }

    /// Sends a command and waits until the board has carried it out. `what` names it in errors.
    ///
    /// # Errors
    /// Fails with one line when the board refuses it, does not answer in time, or is lost, or when it is
    /// a recording.
    pub fn command(&mut self, what: &str, message: &HostMessage<'_>) -> Result<()> {
        let sent = self.client.send(message);
        let sent = sent.with_context(|| format!("{}: {what}", self.name))?;
        let sequence = sent.with_context(|| format!("{} takes no commands", self.name))?;
        (self.awaited, self.outcome) = (Some(sequence), None);
        let asked = Instant::now();
        while asked.elapsed() < self.patience {
            if let Some(outcome) = self.outcome.take() {
                let (name, words) = (&self.name, outcome_name(outcome));
                ensure!(outcome == Outcome::Done, "{name}: {what}: {words}");
                return Ok(());
            }
            self.read()?;
        }
        bail!(
            "{}: {what}: no answer in {} s",
            self.name,
            self.patience.as_secs()
        )
    }

    fn greet(&mut self) -> Result<()> {
        let begun = Instant::now();
        let mut asked: Option<Instant> = None;
        while self.board.hello.is_none() {
            if asked.is_none_or(|asked| asked.elapsed() > HELLO_WAIT) {
                let sent = self.client.send(&HostMessage::SendHello);
                sent.with_context(|| self.name.clone())?;
                asked = Some(Instant::now());
            }
            ensure!(
                begun.elapsed() < self.patience,
                "{}: nothing that speaks the link has answered in {} s",
                self.name,
                self.patience.as_secs()
            );
            self.read()?;
        }
        Ok(())
    }

    /// Reads once, and takes the packets that have come.
    fn read(&mut self) -> Result<()> {
        match self.client.read() {
            Received::Bytes(_) => {}
            Received::Nothing => return Ok(()),
            Received::Ended(reason) => {
                ensure!(self.client.is_recording(), "{}: {reason}", self.name);
                self.end = Some(reason);
                return Ok(());
            }
        }
        let arrived_ns = self.client.arrived_ns();
        if let Some(observer) = &mut self.observer {
            observer.bytes(arrived_ns, self.client.bytes())?;
        }
        while let Some(received) = self.client.next_packet() {
            let Ok(packet) = received else { continue };
            if let Some(observer) = &mut self.observer {
                observer.packet(arrived_ns, &packet)?;
            }
            match self.board.take(&packet) {
                Some(Change::Ended(frame)) => {
                    if let Some(observer) = &mut self.observer {
                        observer.frame(arrived_ns, &frame, &self.board)?;
                    }
                    self.frames.push_back(frame);
                }
                Some(Change::Answered { sequence, outcome }) if self.awaited == Some(sequence) => {
                    (self.awaited, self.outcome) = (None, Some(outcome));
                }
                Some(Change::Answered { .. } | Change::Introduced) | None => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use vgstereo_link::{Selection, Streams};

    use super::*;

    #[test]
    fn a_board_is_asked_and_its_frames_are_those_that_were_asked_for() {
        let mut memory = Memory::default();
        let mut board = Attended::open(&Source::Demo, &mut memory).unwrap();
        let hello = board.board.hello.as_ref().unwrap();
        let width = usize::from(hello.raw.width_px);
        let height = hello.raw.height_lines as usize;
        for (what, message) in [
            ("stop", HostMessage::Stop),
            (
                "select",
                HostMessage::Select(Selection::whole(Streams::RAW)),
            ),
            ("start", HostMessage::Start),
        ] {
            board.command(what, &message).unwrap();
        }
        // One may have begun before.
        board.drop_frames();
        let frame = board.frame().unwrap().unwrap();
        let views = &frame.raw.as_ref().unwrap().views;
        assert!(frame.is_whole() && frame.disparities.is_none());
        assert_eq!((views[0].width, views[0].height()), (width, height));
    }

    #[test]
    fn a_command_that_is_refused_is_an_error_that_says_why() {
        let mut memory = Memory::default();
        let mut board = Attended::open(&Source::Demo, &mut memory).unwrap();
        let none = Selection {
            every_frames: 0,
            ..Selection::whole(Streams::RAW)
        };
        let error = board
            .command("select", &HostMessage::Select(none))
            .unwrap_err();
        assert_eq!(error.to_string(), "demo: select: out of bounds");
    }

    #[test]
    fn a_recording_ends_and_takes_no_commands() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.bin");
        std::fs::write(&path, [0; 3]).unwrap();
        let source = Source::File {
            path: path.clone(),
            is_fast: true,
        };
        let mut memory = Memory::default();
        let mut recording = Attended::open(&source, &mut memory).unwrap();
        assert_eq!(recording.frame().unwrap(), None);
        let error = recording.command("start", &HostMessage::Start).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("{} takes no commands", path.display())
        );
    }
}
