//! `vgstereo record`: keeps what a board sends.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use indicatif::HumanBytes;
use vgstereo_core::geometry::RectifiedCamera;
use vgstereo_link::{BoardMessage, HostMessage, Packet, Selection, Streams};

use crate::arguments::SourceOptions;
use crate::cameras::SeenWith;
use crate::escapes::shown;
use crate::files::ensure_distinct_outputs;
use crate::link::attended::{Attended, Observer};
use crate::link::board::{Board, Frame};
use crate::link::client::Memory;
use crate::link::exporter::Exporter;
use crate::link::recording::Recorder;
use crate::link::source::Source;
use crate::link::tally::Tally;
use crate::terminal::{Interrupts, note, spinner};

/// Time between two changes of what the terminal shows.
const SHOWN_EVERY: Duration = Duration::from_millis(100);

/// The arguments of `vgstereo record`.
#[derive(Debug, Args)]
#[command(
    allow_missing_positional = true,
    after_help = "The recording has the bytes of the link as they came, damaged ones too, with the times at which they \
    came. It ends at --frames, at --seconds, or with Ctrl-C, and what has come is in the file even if the process is \
    killed.\n\n\
    A board's disparities:  vgstereo record /dev/ttyACM0 walk.mcap\n\
    Pairs for a minute:     vgstereo record /dev/ttyACM0 pairs.mcap --streams raw --seconds 60\n\
    No board at all:        vgstereo record --demo demo.mcap --frames 20\n\
    For Foxglove as well:   vgstereo record /dev/ttyACM0 walk.mcap --mcap foxglove.mcap\n\
    See it again:           vgstereo view walk.mcap"
)]
pub struct Record {
    #[command(flatten)]
    source: SourceOptions,
    /// Recording to write, a new file.
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// What the board is to send: raw, rectified, disparities, confidences, depths, points, scans, or all
    /// that it can [default: disparities,confidences].
    #[arg(long, value_name = "STREAM", value_delimiter = ',', value_parser = parse_stream)]
    streams: Vec<Streams>,
    /// End after so many frames that have these streams. What the board was sending before is kept, too.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// End after so many seconds.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Also write images, depths, clouds, scans and the log as messages of Foxglove's schemas to this new
    /// file, for Foxglove and the tools of ROS 2. `replay --mcap` makes one of a recording, later.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    #[command(flatten)]
    seen_with: SeenWith,
}

/// All streams that there may be.
const ALL: Streams = Streams::from_bits(u16::MAX);

fn parse_stream(name: &str) -> Result<Streams, String> {
    if name == "all" {
        return Ok(ALL);
    }
    let named = Streams::NAMED.iter().find(|(one, _)| *one == name);
    let streams = named.map(|(_, streams)| *streams);
    streams.ok_or_else(|| format!("there are {} and all", names(ALL)))
}

/// The names of streams, in a row.
fn names(streams: Streams) -> String {
    let named = Streams::NAMED.iter();
    let names: Vec<&str> = named
        .filter(|(_, one)| streams.contains(*one))
        .map(|(name, _)| *name)
        .collect();
    names.join(", ")
}

/// Keeps what comes.
#[derive(Debug)]
struct Keeper<'p> {
    recording: (&'p Path, Recorder<File>),
    exported: Option<(&'p Path, Exporter<File>)>,
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", shown(path))
}

impl<'p> Keeper<'p> {
    /// Makes the files.
    fn create(
        recording: &'p Path,
        exported: Option<&'p Path>,
        calibrated: Option<RectifiedCamera>,
    ) -> Result<Self> {
        let recorder = Recorder::create(recording)?;
        let exporter = exported.map(|path| {
            let file = File::create_new(path).with_context(|| cannot_write(path))?;
            let exporter = Exporter::new(file, calibrated).with_context(|| cannot_write(path))?;
            anyhow::Ok((path, exporter))
        });
        let exported = exporter.transpose();
        if exported.is_err() {
            remove(recording);
        }
        Ok(Self {
            recording: (recording, recorder),
            exported: exported?,
        })
    }

    /// Ends the files and returns a line for each.
    fn finish(self, elapsed: Duration) -> Result<String> {
        let (path, recorder) = self.recording;
        let mut text = format!(
            "wrote {}: {:.1} s, {} of the link in {} records\n",
            shown(path),
            elapsed.as_secs_f64(),
            HumanBytes(recorder.bytes()),
            recorder.records()
        );
        recorder.finish().with_context(|| cannot_write(path))?;
        if let Some((path, exporter)) = self.exported {
            let told = exporter.finish().with_context(|| cannot_write(path))?;
            text += &format!("wrote {}: {told}\n", shown(path));
        }
        Ok(text)
    }

    /// Removes the files.
    fn discard(self) {
        let paths = [
            Some(self.recording.0),
            self.exported.as_ref().map(|(path, _)| *path),
        ];
        // They are closed first, which not every system can do without.
        drop(self);
        paths.into_iter().flatten().for_each(remove);
    }
}

/// Removes a file that was made in vain.
fn remove(path: &Path) {
    // What cannot be removed stays, and the reason for removing it is told.
    let _ = std::fs::remove_file(path);
}

impl Observer for Keeper<'_> {
    fn bytes(&mut self, arrived_ns: Option<u64>, bytes: &[u8]) -> Result<()> {
        let (path, recorder) = &mut self.recording;
        // A board has a time of arrival.
        let pushed = recorder.push(arrived_ns.unwrap_or_default(), bytes);
        pushed.with_context(|| cannot_write(path))
    }

    fn packet(&mut self, arrived_ns: Option<u64>, packet: &Packet<BoardMessage<'_>>) -> Result<()> {
        match &mut self.exported {
            Some((path, exporter)) => exporter
                .packet(arrived_ns, packet)
                .with_context(|| cannot_write(path)),
            None => Ok(()),
        }
    }

    fn frame(&mut self, arrived_ns: Option<u64>, frame: &Frame, board: &Board) -> Result<()> {
        match &mut self.exported {
            Some((path, exporter)) => exporter
                .frame(arrived_ns, frame, board)
                .with_context(|| cannot_write(path)),
            None => Ok(()),
        }
    }
}

impl Record {
    /// Records until it is enough, and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that names the option, source or file and the reason. What was recorded
    /// until then is kept.
    pub fn run(self) -> Result<String> {
        let source = self.source.source(true)?;
        if let Source::File { path, .. } = &source {
            bail!(
                "{}: a file is no board: vgstereo replay has what is done with one",
                shown(path)
            );
        }
        let limit = match self.seconds {
            Some(seconds) => {
                Some(Duration::try_from_secs_f64(seconds).ok().with_context(|| {
                    format!("--seconds {seconds}: it must be 0 or above, and not too long to state")
                })?)
            }
            None => None,
        };
        let calibrated = self.seen_with.camera()?;
        let mut outputs = vec![self.recording.as_path()];
        outputs.extend(self.mcap.as_deref());
        let inputs: Vec<&Path> = self.seen_with.files().collect();
        ensure!(
            self.mcap.is_some() || inputs.is_empty(),
            "--calibration is for --mcap"
        );
        ensure_distinct_outputs(&inputs, &outputs).context("--mcap")?;
        // Refused before the board is asked for anything.
        for path in outputs {
            let name = shown(path);
            ensure!(
                !path.exists(),
                "{name} is there already, and no recording is written over"
            );
        }
        let interrupts = Interrupts::heeded();
        let mut keeper = Keeper::create(&self.recording, self.mcap.as_deref(), calibrated)?;
        let mut memory = Memory::default();
        let begun = Instant::now();
        let mut has_begun = false;
        let recorded = self.record(
            &source,
            &mut memory,
            &mut keeper,
            &mut has_begun,
            limit,
            &interrupts,
        );
        match recorded {
            Ok(tally) => Ok(format!("{}{tally}\n", keeper.finish(begun.elapsed())?)),
            // Nothing but answers was recorded.
            Err(error) if !has_begun => {
                keeper.discard();
                Err(error)
            }
            Err(error) => {
                match keeper.finish(begun.elapsed()) {
                    Ok(text) => note(text.trim_end()),
                    Err(unfinished) => note(&format!("{unfinished:#}")),
                }
                Err(error)
            }
        }
    }

    /// Asks the board, and keeps what comes.
    fn record<'m>(
        &self,
        source: &Source,
        memory: &'m mut Memory,
        keeper: &'m mut Keeper<'_>,
        has_begun: &mut bool,
        limit: Option<Duration>,
        interrupts: &Interrupts,
    ) -> Result<Tally> {
        let mut board = Attended::observed(source, memory, Some(keeper))?;
        let streams = self.streams(&board)?;
        let was_started = board.board.state.is_some_and(|state| state.is_started);
        let selection = HostMessage::Select(Selection::whole(streams));
        board.command("--streams", &selection)?;
        // Those that came before the answer have other streams.
        board.drop_frames();
        board.command("start", &HostMessage::Start)?;
        *has_begun = true;
        let bar = spinner();
        let begun = Instant::now();
        let mut shown_at = begun;
        let mut frames = 0;
        while !interrupts.have_come()
            && self.frames.is_none_or(|most| frames < most)
            && limit.is_none_or(|limit| begun.elapsed() < limit)
        {
            frames += u64::from(board.poll()?.is_some());
            if shown_at.elapsed() > SHOWN_EVERY {
                shown_at = Instant::now();
                let packets = board.client().counters();
                bar.set_message(format!(
                    "{:.1} s, {frames} frames, {} packets lost; Ctrl-C ends it",
                    begun.elapsed().as_secs_f64(),
                    packets.lost
                ));
                bar.tick();
            }
        }
        bar.finish_and_clear();
        let tally = Tally::of(&board);
        if !was_started {
            // Whether it comes to it no longer matters.
            let _ = board.send(&HostMessage::Stop);
        }
        Ok(tally)
    }

    /// The streams to ask for.
    fn streams(&self, board: &Attended<'_>) -> Result<Streams> {
        let hello = board.board.hello.as_ref();
        let offered = hello.map_or(Streams::NONE, |hello| hello.streams);
        let wanted = self.streams.iter().copied().reduce(Streams::with);
        let wanted = wanted.unwrap_or(Streams::DISPARITIES.with(Streams::CONFIDENCES));
        if wanted == ALL {
            return Ok(offered);
        }
        let missing = Streams::from_bits(wanted.bits() & !offered.bits());
        ensure!(
            missing == Streams::NONE,
            "--streams: the board cannot send {}, but {}",
            names(missing),
            names(offered)
        );
        Ok(wanted)
    }
}
