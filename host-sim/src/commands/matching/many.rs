//! Many pairs, some at a time.

use std::collections::{HashMap, HashSet};
use std::fmt::Write;
use std::path::{Path, PathBuf, absolute};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, ensure};
use serde::Serialize;

use super::options::Options;
use super::plan::Plan;
use super::targets::{OPTIONS, PLACE, Targets};
use crate::arguments::name_of;
use crate::escapes::{shown, shown_name};
use crate::files::{ensure_distinct_outputs, make_folder, write_files};
use crate::images::bits_note;
use crate::pair_check::hints;
use crate::pair_lists::{Found, NamedPair};
use crate::tables::{milliseconds, table};
use crate::terminal::{Said, note, progress_bar, write_output};

/// Most pairs that an error names.
const NAMED_MAX: usize = 3;

/// What became of a pair.
#[derive(Debug, Clone, Serialize)]
struct Row {
    name: String,
    images: Vec<String>,
    #[serde(flatten)]
    figures: Option<Figures>,
    /// Why it was not matched.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// The figures of a pair that was matched.
#[derive(Debug, Clone, Serialize)]
struct Figures {
    width: u32,
    height: u32,
    seconds: f64,
    /// Pixels whose disparities were found.
    found_percent: usize,
    /// What may be wrong with the pair.
    hints: Vec<String>,
    #[serde(skip)]
    bits: Option<u8>,
}

/// The JSON of all pairs.
#[derive(Debug, Serialize)]
struct Report<'a> {
    preset: String,
    pairs: &'a [Row],
    /// Images without a partner.
    alone: Vec<String>,
}

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
    let rows = batch.matched();
    let text = if options.json {
        let report = Report {
            preset: name_of(&options.overrides.apply(options.preset)?, options.preset),
            pairs: &rows,
            alone: found.alone.iter().map(|path| shown(path)).collect(),
        };
        serde_json::to_string(&report)? + "\n"
    } else {
        told(&rows)?
    };
    let failed: Vec<String> = rows
        .iter()
        .filter_map(|row| {
            Some(format!(
                "{}: {}",
                shown_name(&row.name),
                row.error.as_ref()?
            ))
        })
        .collect();
    if failed.is_empty() {
        return Ok(text.into());
    }
    write_output(crate::escapes::printable(&text).as_bytes())?;
    let more = match failed.len().saturating_sub(NAMED_MAX) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let named = failed[..failed.len().min(NAMED_MAX)].join("; ");
    Err(anyhow!(
        "{} of {} pairs were not matched: {named}{more}",
        failed.len(),
        rows.len()
    ))
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
        for (option, path) in given.given() {
            ensure!(
                path.to_string_lossy().contains(PLACE),
                "{option} {}: of many pairs, {PLACE} in it stands for the name of each",
                shown(path)
            );
        }
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
        for (_, path) in given.given() {
            let folder = path.parent().filter(|folder| *folder != Path::new(""));
            if let Some(folder) = folder.filter(|folder| !folder.to_string_lossy().contains(PLACE))
            {
                make_folder(folder)?;
            }
        }
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
        let mut outputs = HashSet::new();
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
                let is_new = outputs.insert(absolute(path).unwrap_or_else(|_| path.to_owned()));
                ensure!(is_new, "two pairs would write {}", shown(path));
            }
        }
        Ok(())
    }

    /// Matches all pairs, each thread one at a time, so that no more than as many are in memory.
    fn matched(&self) -> Vec<Row> {
        let threads = self.options.threads.get().min(self.pairs.len());
        let bar = progress_bar(self.pairs.len() as u64, "matching");
        let next = AtomicUsize::new(0);
        let rows: Vec<Mutex<Option<Row>>> = self.pairs.iter().map(|_| Mutex::default()).collect();
        thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(place) = rows.get(index) else { return };
                        let row = self.row(index);
                        if let Some(error) = &row.error {
                            let name = shown_name(&row.name);
                            bar.suspend(|| note(&format!("{name} is not matched: {error}")));
                        }
                        *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(row);
                        bar.inc(1);
                    }
                });
            }
        });
        bar.finish_and_clear();
        let rows = rows.into_iter();
        rows.filter_map(|row| row.into_inner().unwrap_or_else(PoisonError::into_inner))
            .collect()
    }

    fn row(&self, index: usize) -> Row {
        let (named, targets) = &self.pairs[index];
        let (figures, error) = match self.match_one(named, targets) {
            Ok(figures) => (Some(figures), None),
            Err(error) => (None, Some(format!("{error:#}"))),
        };
        Row {
            name: named.name.clone(),
            images: named.pair.paths().into_iter().map(shown).collect(),
            figures,
            error,
        }
    }

    fn match_one(&self, named: &NamedPair, targets: &Targets) -> Result<Figures> {
        let files = named.pair.open()?;
        let plan = self.plan(files.dimensions()?)?;
        let images = files.decode(self.options.bits)?;
        drop(files);
        let bits = images.bits;
        let done = plan.run(self.options, targets, images, 1)?;
        let hints = if self.options.no_check {
            Vec::new()
        } else {
            hints(&done.views, plan.disparities())?
        };
        for (path, _) in &done.files {
            if let Some(folder) = path.parent().filter(|folder| *folder != Path::new("")) {
                make_folder(folder)?;
            }
        }
        write_files(&done.files)?;
        let [width, height] = plan.size();
        Ok(Figures {
            width,
            height,
            seconds: done.matched.time.as_secs_f64(),
            found_percent: done.found_percent(),
            hints: hints.iter().map(ToString::to_string).collect(),
            bits,
        })
    }

    /// The plan for images of this size, px.
    fn plan(&self, size: (u32, u32)) -> Result<Arc<Plan>> {
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(plan) = plans.get(&size) {
            return Ok(Arc::clone(plan));
        }
        let plan = Plan::new(self.options, &Targets::of(self.options), size)?;
        Ok(Arc::clone(plans.entry(size).or_insert(Arc::new(plan))))
    }
}

/// The table of all pairs, their mean, and what is to be said of some.
fn told(rows: &[Row]) -> Result<String> {
    let mut table = table(&["pair", "size, px", "ms", "found, %"], 2);
    let time = |seconds| milliseconds(Duration::from_secs_f64(seconds));
    let mut notes = String::new();
    for row in rows {
        let name = shown_name(&row.name);
        let Some(figures) = &row.figures else {
            table.add_row([&name, "not matched", "-", "-"]);
            continue;
        };
        let size = format!("{}x{}", figures.width, figures.height);
        let found = figures.found_percent.to_string();
        table.add_row([&name, &size, &time(figures.seconds), &found]);
        if let Some(bits) = figures.bits {
            writeln!(notes, "{name}: {}", bits_note(bits))?;
        }
        for hint in &figures.hints {
            writeln!(notes, "hint: {name}: {hint}")?;
        }
    }
    let matched: Vec<&Figures> = rows.iter().filter_map(|row| row.figures.as_ref()).collect();
    if !matched.is_empty() {
        let count = matched.len() as f64;
        let seconds: f64 = matched.iter().map(|figures| figures.seconds).sum();
        let found: usize = matched.iter().map(|figures| figures.found_percent).sum();
        let pairs = format!("{} of {} pairs", matched.len(), rows.len());
        table.add_row([
            "mean",
            &pairs,
            &time(seconds / count),
            &format!("{:.1}", found as f64 / count),
        ]);
    }
    Ok(format!("{table}\n{notes}"))
}
