//! The pairs of a recording, some at a time: no more are in memory than threads match, and one besides.

use std::collections::HashSet;
use std::path::{Path, PathBuf, absolute};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use anyhow::{Context, Result, ensure};

use super::options::Options;
use super::plan::{Kind, Plan};
use super::rows::{Figures, Row, Source, said};
use super::targets::{OPTIONS, Targets};
use crate::escapes::shown;
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
        written: HashSet::new(),
        count: 0,
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
    let source = Source::Recording {
        left_out: reading.frames.left_out(),
        damage: reading.frames.damage().map(ToString::to_string),
    };
    said(options, &rows, source)
}

/// A frame with a pair of views.
struct Read {
    index: usize,
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
    written: HashSet<PathBuf>,
    count: usize,
}

impl Reading<'_> {
    /// The next frame that has a pair.
    fn next(&mut self) -> Result<Option<Read>> {
        let Some((name, pair)) = self.frames.next_of(|frame, _| pair(frame))? else {
            return Ok(None);
        };
        let context = format!("{}: frame {name}", shown(self.path));
        let job = pair.and_then(|pair| self.job(&name, pair).context(context));
        let index = self.count;
        self.count += 1;
        Ok(Some(Read { index, name, job }))
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
            let is_new = self
                .written
                .insert(absolute(path).unwrap_or_else(|_| path.to_owned()));
            ensure!(is_new, "two frames would write {}", shown(path));
        }
        Ok(())
    }
}

/// Matches all pairs, each thread one at a time, and returns their rows in the order of the recording.
fn matched(reading: &mut Reading<'_>, first: Read) -> Result<Vec<Row>> {
    let options = reading.options;
    let bar = spinner();
    let rows = Mutex::new(Vec::new());
    let done = |index: usize, row: Row| {
        bar.suspend(|| row.tell());
        let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
        rows.push((index, row));
        bar.set_message(format!("matching: {} frames", rows.len()));
        bar.tick();
    };
    // Without room: a pair is taken when a thread is free.
    let (jobs, taken) = sync_channel(0);
    let taken = Arc::new(Mutex::new(taken));
    thread::scope(|scope| {
        for _ in 0..options.threads.get() {
            let (taken, done) = (Arc::clone(&taken), &done);
            scope.spawn(move || {
                while let Some((index, name, job)) = next_job(&taken) {
                    let figures = Figures::of(options, &job.plan, &job.targets, job.images);
                    done(index, Row::new(name, Vec::new(), figures));
                }
            });
        }
        // Without a thread that takes them, no job waits for ever.
        drop(taken);
        feed(reading, first, jobs, &done)
    })?;
    bar.finish_and_clear();
    let mut rows = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
    rows.sort_by_key(|(index, _)| *index);
    Ok(rows.into_iter().map(|(_, row)| row).collect())
}

type Numbered = (usize, String, Job);

/// Reads frames and gives their pairs to the threads, to the end of the recording.
fn feed(
    reading: &mut Reading<'_>,
    first: Read,
    jobs: SyncSender<Numbered>,
    done: &dyn Fn(usize, Row),
) -> Result<()> {
    let mut next = Some(first);
    while let Some(Read { index, name, job }) = next {
        match job {
            // They take jobs until there are none.
            Ok(job) => jobs.send((index, name, job))?,
            Err(error) => done(index, Row::new(name, Vec::new(), Err(error))),
        }
        next = reading.next()?;
    }
    Ok(())
}

fn next_job(jobs: &Mutex<Receiver<Numbered>>) -> Option<Numbered> {
    let jobs = jobs.lock().unwrap_or_else(PoisonError::into_inner);
    jobs.recv().ok()
}
