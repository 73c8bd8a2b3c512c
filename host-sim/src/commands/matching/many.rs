//! Many pairs, some at a time.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, ensure};

use super::batch;
use super::options::Options;
use super::plan::{Kind, Plan};
use super::rows::{Figures, Row, Source, said};
use super::targets::{OPTIONS, Targets, Written};
use crate::escapes::shown;
use crate::files::ensure_distinct_outputs;
use crate::pair_lists::{Found, NamedPair};
use crate::terminal::{Said, note, progress_bar};

/// Matches the pairs, writes their files and returns the table.
///
/// # Errors
/// Fails with one line that names an option or a file before anything is written, or, after the table was
/// printed, the pairs that were not matched.
pub(super) fn run(options: &Options, found: &Found) -> Result<Said> {
    let batch = Batch::new(options, &found.pairs)?;
    for image in &found.alone {
        note(&format!("{} has no partner", shown(image)));
    }
    let rows = batch.matched()?;
    let alone = found.alone.iter().map(|path| shown(path)).collect();
    said(options, &rows, Source::Images { alone })
}

/// Pairs that are to be matched, and where their files go.
struct Batch<'a> {
    options: &'a Options,
    pairs: Vec<(&'a NamedPair, Targets)>,
    /// The plan for images of each size.
    plans: Mutex<HashMap<(u32, u32), Arc<Plan>>>,
}

impl<'a> Batch<'a> {
    /// Checks where files go, and what can be checked of the options by the first pair that can be read.
    fn new(options: &'a Options, pairs: &'a [NamedPair]) -> Result<Self> {
        let given = Targets::of(options);
        given.ensure_named()?;
        let pairs: Result<Vec<_>> = pairs
            .iter()
            .map(|named| Ok((named, given.named(&named.name)?)))
            .collect();
        let batch = Self {
            options,
            pairs: pairs?,
            plans: Mutex::default(),
        };
        batch.ensure_keeps_files().context(OPTIONS)?;
        let mut pairs = batch.pairs.iter();
        let first = pairs.find_map(|(named, _)| named.pair.open().ok()?.dimensions().ok());
        if let Some(size) = first {
            batch.plan(size)?;
        }
        // What all pairs have in common is made before any is matched.
        given.make_folders()?;
        Ok(batch)
    }

    /// Checks that no file that is written is another one that is, or that is read.
    fn ensure_keeps_files(&self) -> Result<()> {
        let images = self.pairs.iter().flat_map(|(named, _)| named.pair.paths());
        let others = self.options.other_inputs();
        let inputs: HashSet<PathBuf> = images
            .chain(others.iter().copied())
            .filter_map(|path| path.canonicalize().ok())
            .collect();
        let mut written = Written::default();
        for (named, targets) in &self.pairs {
            let files = targets.files();
            let paths: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
            ensure_distinct_outputs(&named.pair.paths(), &paths)?;
            for path in paths {
                let replaced = path.canonicalize().is_ok_and(|path| inputs.contains(&path));
                ensure!(
                    !replaced,
                    "the output {} would replace an input",
                    shown(path)
                );
                written.add(path, "pairs")?;
            }
        }
        Ok(())
    }

    /// Matches all pairs.
    fn matched(&self) -> Result<Vec<Row>> {
        let threads = self.options.threads.get().min(self.pairs.len());
        let bar = progress_bar(self.pairs.len() as u64, "matching");
        let mut pairs = self.pairs.iter();
        let next = || Ok(pairs.next());
        let done = |count| bar.set_position(count as u64);
        batch::rows(threads, &bar, next, |pair| self.row(pair), done)
    }

    fn row(&self, (named, targets): &(&NamedPair, Targets)) -> Row {
        let images = named.pair.paths().into_iter().map(shown).collect();
        Row::new(named.name.clone(), images, self.match_one(named, targets))
    }

    fn match_one(&self, named: &NamedPair, targets: &Targets) -> Result<Figures> {
        let files = named.pair.open()?;
        let plan = self.plan(files.dimensions()?)?;
        let images = files.decode(self.options.bits)?;
        drop(files);
        Figures::of(self.options, &plan, targets, images)
    }

    /// The plan for images of this size, px.
    fn plan(&self, size: (u32, u32)) -> Result<Arc<Plan>> {
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(plan) = plans.get(&size) {
            return Ok(Arc::clone(plan));
        }
        let kind = Kind::of_images(size);
        let plan = Plan::new(self.options, &Targets::of(self.options), kind)?;
        Ok(Arc::clone(plans.entry(size).or_insert(Arc::new(plan))))
    }
}
