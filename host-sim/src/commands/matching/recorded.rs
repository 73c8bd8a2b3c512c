//! The pairs of a recording, read one at a time by the threads that match them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::batch;
use super::options::Options;
use super::plan::{Kind, Plan};
use super::rows::{Figures, Row, Source, said};
use super::targets::{OPTIONS, Targets, Written};
use crate::files::ensure_distinct_outputs;
use crate::images::ViewImages;
use crate::link::client::Memory;
use crate::link::recorded::{Frames, Pair, pair};
use crate::terminal::{Said, note, spinner};

/// What frames are matched by.
const NEEDED: &str = "a pair of views";

/// Matches the pairs of a recording, writes their files and returns the table.
///
/// # Errors
/// Fails with one line that names an option or a file before anything is written, or, after the table was
/// printed, the frames that were not matched.
pub(super) fn run(options: &Options, path: &Path) -> Result<Said> {
    ensure!(
        options.bits.is_none(),
        "--bits is for images, not for recordings"
    );
    let targets = Targets::of(options);
    targets.ensure_named()?;
    let mut memory = Memory::default();
    let mut reading = Reading {
        options,
        path,
        targets,
        frames: Frames::open(path, &mut memory)?,
        plan: None,
        written: Written::default(),
    };
    // What all frames have in common shows in the first one, before anything is written.
    let first = match reading.next()? {
        Some(Read {
            job: Err(error), ..
        }) => return Err(error),
        Some(first) => first,
        None => return Err(reading.frames.none(NEEDED)),
    };
    reading.targets.make_folders()?;
    let rows = matched(&mut reading, first)?;
    for lack in reading.frames.lacks(NEEDED) {
        note(&lack);
    }
    let source = Source::Recording(reading.frames.lacking());
    said(options, &rows, source)
}

/// A frame with a pair of views.
struct Read {
    name: String,
    job: Result<Job>,
}

/// A pair to match, and where its files go.
struct Job {
    plan: Arc<Plan>,
    targets: Targets,
    images: ViewImages,
}

/// The recording, as far as it was read.
struct Reading<'a> {
    options: &'a Options,
    path: &'a Path,
    targets: Targets,
    frames: Frames<'a>,
    /// The plan of the pair before.
    plan: Option<(Kind, Arc<Plan>)>,
    /// The files of the frames that were read.
    written: Written,
}

impl Reading<'_> {
    /// The next frame that has a pair.
    fn next(&mut self) -> Result<Option<Read>> {
        let Some((name, pair)) = self.frames.next_of(|frame, _| pair(frame))? else {
            return Ok(None);
        };
        let place = self.frames.place_of(&name);
        let job = pair.and_then(|pair| self.job(&name, pair).context(place));
        Ok(Some(Read { name, job }))
    }

    fn job(&mut self, name: &str, pair: Pair) -> Result<Job> {
        let is_calibrated = self.options.cameras.is_calibrated();
        self.frames
            .ensure_rectifiable(&pair, is_calibrated, "--calibration")?;
        let kind = Kind {
            size: pair.left.dimensions(),
            is_rectified: pair.is_rectified,
            camera: self.frames.camera(),
        };
        let plan = self.plan(kind)?;
        let targets = self.targets.named(name)?;
        self.ensure_keeps_files(&targets).context(OPTIONS)?;
        let images = ViewImages {
            left: pair.left,
            right: pair.right,
            bits: None,
        };
        Ok(Job {
            plan,
            targets,
            images,
        })
    }

    fn plan(&mut self, kind: Kind) -> Result<Arc<Plan>> {
        if let Some((_, plan)) = self.plan.as_ref().filter(|(before, _)| *before == kind) {
            return Ok(Arc::clone(plan));
        }
        let plan = Arc::new(Plan::new(self.options, &self.targets, kind)?);
        self.plan = Some((kind, Arc::clone(&plan)));
        Ok(plan)
    }

    /// Checks that no file of these targets is another one that is written, or that is read.
    fn ensure_keeps_files(&mut self, targets: &Targets) -> Result<()> {
        let files = targets.files();
        let outputs: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
        let mut inputs = vec![self.path];
        inputs.extend(self.options.other_inputs());
        ensure_distinct_outputs(&inputs, &outputs)?;
        for path in outputs {
            self.written.add(path, "frames")?;
        }
        Ok(())
    }
}

/// Matches all pairs.
fn matched(reading: &mut Reading<'_>, first: Read) -> Result<Vec<Row>> {
    let options = reading.options;
    let bar = spinner();
    let mut first = Some(first);
    let next = || match first.take() {
        Some(first) => Ok(Some(first)),
        None => reading.next(),
    };
    let row = |Read { name, job }| {
        let figures = job.and_then(|job| Figures::of(options, &job.plan, &job.targets, job.images));
        Row::new(name, Vec::new(), figures)
    };
    let done = |count| {
        bar.set_message(format!("matching: {count} frames"));
        bar.tick();
    };
    batch::rows(options.threads.get(), &bar, next, row, done)
}
