//! `vgstereo capture`: pairs of pictures from a board, as its cameras see them.

mod folder;
mod shutter;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use indicatif::ProgressBar;
use vgstereo_link::{HostMessage, Selection, State, Streams};

use self::folder::PairFolder;
use self::shutter::Shutter;
use crate::arguments::SourceOptions;
use crate::chessboard::{Chessboard, Sight};
use crate::link::attended::Attended;
use crate::link::client::Memory;
use crate::link::pixels::{Pixels, unpacked};
use crate::terminal::{note, spinner};
use crate::view::focus::focus;

/// For how long a whole frame is waited for.
const PATIENCE: Duration = Duration::from_secs(30);

/// For how long a board's state is waited for after its hello.
const STATE_WAIT: Duration = Duration::from_secs(2);

/// The arguments of `vgstereo capture`.
#[derive(Debug, Args)]
#[command(
    allow_missing_positional = true,
    after_help = "At a terminal, Enter takes the next pair, and q and Enter end. Elsewhere, --every or --count is needed, \
    and without --every each frame is taken.\n\n\
    Pairs are left_01.png and right_01.png, and so on after those that are there already. \
    tools/calibrate.py calibrates the cameras by them.\n\n\
    A serial port:     vgstereo capture /dev/ttyACM0 pictures --corners 9x6\n\
    Hands at a board:  vgstereo capture /dev/ttyACM0 pictures --corners 9x6 --seen-only --every 3 --count 20\n\
    A board over TCP:  vgstereo capture 192.168.7.2:7000 pictures\n\
    No board at all:   vgstereo capture --demo pictures --count 3"
)]
pub struct Capture {
    #[command(flatten)]
    source: SourceOptions,
    /// Folder for the pictures.
    #[arg(required = true)]
    folder: PathBuf,
    /// Take a pair every so many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    every: Option<Duration>,
    /// End after so many pairs.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    count: Option<u32>,
    /// Tell whether a board of squares with so many inner corners across and down, where four squares
    /// meet, is seen whole in both views: 9x6 has 10 by 7 squares.
    #[arg(long, value_name = "CxR", value_parser = parse_corners)]
    corners: Option<[usize; 2]>,
    /// Take only pairs in which the board of --corners is seen whole in both views.
    #[arg(long, requires = "corners")]
    seen_only: bool,
}

/// How sharp a pair of views is, and how much of the board of squares either shows.
struct Looked {
    /// How much of the board either view shows; `None` if none is looked for.
    sights: Option<[Sight; 2]>,
    sharpness: [f64; 2],
}

/// A command that is typed at the terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Key {
    Take,
    End,
}

impl Capture {
    /// Takes the pairs and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that names the source, option or file and the reason. The pairs that were
    /// written before are whole.
    pub fn run(self) -> Result<String> {
        let keys = std::io::stdin().is_terminal().then(keys).transpose()?;
        ensure!(
            keys.is_some() || self.every.is_some() || self.count.is_some(),
            "standard input is no terminal, at which a key takes a pair: give --every or --count"
        );
        let source = self.source.source(true)?;
        let chessboard = self.corners.map(Chessboard::new).transpose()?;
        let mut memory = Memory::default();
        let mut attended = Attended::open(&source, &mut memory)?;
        let mut folder = PairFolder::open(&self.folder)?;
        let before = self.ask_for_raw_views(&mut attended)?;
        let bar = spinner();
        if keys.is_some() {
            bar.suspend(|| note("Enter takes a pair, q and Enter end"));
        }
        let taken = self.take(&mut attended, &mut folder, chessboard.as_ref(), keys, &bar);
        bar.finish_and_clear();
        let taken = taken.with_context(|| folder.told());
        if let Some(before) = before {
            restore(&mut attended, &before);
        }
        let whole = taken?;
        let mut text = format!("{}\n", folder.told());
        if let (Some([columns, rows]), Some(_)) = (self.corners, folder.last()) {
            text += &format!(
                "a board of {columns}x{rows} corners is seen whole in both views of {whole}\n"
            );
        }
        Ok(text)
    }

    /// Takes pairs until there are enough or the terminal ends it; returns in how many the board is seen
    /// whole in both views.
    fn take(
        &self,
        attended: &mut Attended<'_>,
        folder: &mut PairFolder,
        chessboard: Option<&Chessboard>,
        keys: Option<Receiver<Key>>,
        bar: &ProgressBar,
    ) -> Result<u32> {
        let begun = Instant::now();
        let is_recording = attended.client().is_recording();
        let mut shutter = Shutter::new(self.every, keys.is_some());
        let (mut heard, mut whole) = (Instant::now(), 0);
        while self.count.is_none_or(|count| folder.written() < count) {
            match keys.as_ref().map(Receiver::try_recv) {
                Some(Ok(Key::Take)) => shutter.press(),
                Some(Ok(Key::End) | Err(TryRecvError::Disconnected)) => break,
                Some(Err(TryRecvError::Empty)) | None => {}
            }
            let Some(frame) = attended.poll()? else {
                if attended.has_ended() {
                    break;
                }
                ensure!(heard.elapsed() < PATIENCE, "{}", silence(attended));
                continue;
            };
            let Some(pictures) = frame.raw.as_ref().filter(|_| frame.is_whole()) else {
                continue;
            };
            heard = Instant::now();
            let views = unpacked(pictures);
            let looked = Looked::at(&views, chessboard);
            bar.set_message(looked.told());
            bar.tick();
            // Of a recording, the time at which the frame was seen.
            let now = if is_recording {
                Duration::from_micros(frame.begun.timestamp_us)
            } else {
                begun.elapsed()
            };
            let Some(cause) = shutter.opens(now) else {
                continue;
            };
            if self.seen_only && !looked.is_seen() {
                if cause == shutter::Cause::Key {
                    bar.suspend(|| note(&format!("not taken: {}", looked.told())));
                    shutter.close(now);
                }
                continue;
            }
            let name = folder.write(&views)?;
            shutter.close(now);
            whole += u32::from(looked.is_seen());
            bar.suspend(|| note(&format!("{name}: {}", looked.told())));
        }
        Ok(whole)
    }

    /// Asks a board for raw views alone, and returns its state before, if it has told one. A recording has
    /// what it has.
    fn ask_for_raw_views(&self, attended: &mut Attended<'_>) -> Result<Option<State>> {
        if attended.client().is_recording() {
            return Ok(None);
        }
        let hello = attended.board.hello.as_ref();
        ensure!(
            hello.is_some_and(|hello| hello.streams.contains(Streams::RAW)),
            "{}: the board sends no raw views",
            attended.name()
        );
        // It follows the hello, but may come in a later read.
        let asked = Instant::now();
        while attended.board.state.is_none() && asked.elapsed() < STATE_WAIT {
            attended.poll()?;
        }
        let before = attended.board.state;
        // A frame under way may be of other streams.
        attended.command("stop", &HostMessage::Stop)?;
        let selection = Selection::whole(Streams::RAW);
        attended.command("select raw views", &HostMessage::Select(selection))?;
        attended.command("start", &HostMessage::Start)?;
        attended.drop_frames();
        Ok(before)
    }
}

/// Leaves a board as it was found. What it does not take any more is lost with it.
fn restore(attended: &mut Attended<'_>, before: &State) {
    let start = if before.is_started {
        HostMessage::Start
    } else {
        HostMessage::Stop
    };
    let messages = [HostMessage::Select(before.selection), start];
    for message in messages {
        if attended.command("restore", &message).is_err() {
            return;
        }
    }
}

/// Why nothing was taken for a long time.
fn silence(attended: &Attended<'_>) -> String {
    let frames = &attended.board.frames;
    let seconds = PATIENCE.as_secs();
    let mut text = format!(
        "{}: no whole frame has come in {seconds} s",
        attended.name()
    );
    if frames.with_gaps > 0 {
        text += &format!(
            "; {} had gaps: the link may be too slow for raw views",
            frames.with_gaps
        );
    }
    if let Some(reason) = frames.abort_reason {
        text += &format!("; {} were aborted: {reason}", frames.aborted);
    }
    text
}

impl Looked {
    fn at(views: &[Pixels; 2], chessboard: Option<&Chessboard>) -> Self {
        let each = views.each_ref().map(|view| &view.grey);
        Self {
            sights: chessboard.map(|board| each.map(|grey| board.sight(&grey.values, grey.width))),
            sharpness: each.map(|grey| focus(&grey.values, grey.width)),
        }
    }

    /// Whether a board is looked for and seen whole in both views.
    fn is_seen(&self) -> bool {
        self.sights == Some([Sight::Whole; 2])
    }

    fn told(&self) -> String {
        let [left, right] = self.sharpness;
        let sharpness = format!("sharpness {left:.0} and {right:.0}");
        match self.sights {
            None => sharpness,
            Some([Sight::Whole, Sight::Whole]) => {
                format!("the board is seen whole in both views; {sharpness}")
            }
            Some([left, right]) => format!(
                "left view: {}; right view: {}; {sharpness}",
                sight_told(left),
                sight_told(right)
            ),
        }
    }
}

fn sight_told(sight: Sight) -> String {
    match sight {
        Sight::Whole => "the board is whole".to_owned(),
        Sight::Part(count) => format!("{count} corners of a board"),
        Sight::Larger([columns, rows]) => {
            format!("a board of {columns}x{rows} corners: count corners, not squares")
        }
        Sight::Nothing => "no board".to_owned(),
    }
}

/// What is typed at the terminal, line by line.
fn keys() -> Result<Receiver<Key>> {
    let (sender, receiver) = channel();
    thread::Builder::new()
        .name("keys".to_owned())
        .spawn(move || {
            for line in std::io::stdin().lines().map_while(Result::ok) {
                let key = match line.trim() {
                    "q" | "Q" => Key::End,
                    _ => Key::Take,
                };
                if sender.send(key).is_err() {
                    return;
                }
            }
        })
        .context("standard input")?;
    Ok(receiver)
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|&seconds| seconds > 0.0);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "it is a number of seconds above 0, such as 2.5".to_owned())
}

fn parse_corners(text: &str) -> Result<[usize; 2], String> {
    let corners = text.split_once('x').and_then(|(across, down)| {
        let sides: [usize; 2] = [across.parse().ok()?, down.parse().ok()?];
        sides
            .iter()
            .all(|side| (3..=99).contains(side))
            .then_some(sides)
    });
    corners.ok_or_else(|| {
        "it is the corners between squares, across and down, such as 9x6 for 10x7 squares; at least 3x3"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_understood_or_refused() {
        assert_eq!(parse_seconds("2.5"), Ok(Duration::from_millis(2500)));
        for wrong in ["0", "-1", "nan", "inf", "1e300", "soon", ""] {
            assert!(parse_seconds(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_corners("9x6"), Ok([9, 6]));
        for wrong in ["9", "2x6", "9x100", "9x", "-9x6"] {
            assert!(parse_corners(wrong).is_err(), "{wrong}");
        }
    }
}
