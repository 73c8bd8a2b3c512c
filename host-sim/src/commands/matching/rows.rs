//! What becomes of each of many pairs, as a table or as JSON.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use anyhow::{Result, anyhow};
use serde::Serialize;

use super::options::Options;
use super::plan::Plan;
use super::targets::Targets;
use crate::arguments::name_of;
use crate::escapes::{printable, shown_name};
use crate::files::{make_folder, write_files};
use crate::images::{ViewImages, bits_note};
use crate::line_offsets::ViewOffsets;
use crate::link::recorded::Lacking;
use crate::pair_check::hints;
use crate::tables::{milliseconds, table};
use crate::terminal::{Said, note, write_output};

/// Most pairs that an error names.
const NAMED_MAX: usize = 3;

/// What became of a pair.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Row {
    pub(super) name: String,
    /// The files of the images, of which a recording has none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<String>,
    #[serde(flatten)]
    figures: Option<Figures>,
    /// Why it was not matched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) error: Option<String>,
}

/// The figures of a pair that was matched.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Figures {
    width: u32,
    height: u32,
    seconds: f64,
    /// Pixels whose disparities were found.
    found_percent: usize,
    /// What may be wrong with the pair.
    hints: Vec<String>,
    /// How the lines of the other view were found to lie.
    #[serde(skip_serializing_if = "Option::is_none")]
    line_offsets: Option<ViewOffsets>,
    #[serde(skip)]
    bits: Option<u8>,
}

/// The JSON of all pairs.
#[derive(Debug, Serialize)]
struct Report<'a> {
    preset: String,
    pairs: &'a [Row],
    #[serde(flatten)]
    source: Source,
}

/// What the pairs are of.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(super) enum Source {
    /// Image files.
    Images {
        /// Those without a partner.
        alone: Vec<String>,
    },
    /// A recording.
    Recording(Lacking),
}

impl Source {
    /// The word for a pair.
    fn pair(&self) -> &'static str {
        match self {
            Self::Images { .. } => "pair",
            Self::Recording(_) => "frame",
        }
    }
}

impl Row {
    /// The row of the pair of this name and these files.
    pub(super) fn new(name: String, images: Vec<String>, matched: Result<Figures>) -> Self {
        let (figures, error) = match matched {
            Ok(figures) => (Some(figures), None),
            Err(error) => (None, Some(format!("{error:#}"))),
        };
        Self {
            name,
            images,
            figures,
            error,
        }
    }

    /// Tells on standard error that the pair was not matched, if so.
    pub(super) fn tell(&self) {
        if let Some(error) = &self.error {
            note(&format!(
                "{} is not matched: {error}",
                shown_name(&self.name)
            ));
        }
    }
}

impl Figures {
    /// Matches a pair and writes its files.
    ///
    /// # Errors
    /// Fails with one line that gives the reason.
    pub(super) fn of(
        options: &Options,
        plan: &Plan,
        targets: &Targets,
        images: ViewImages,
    ) -> Result<Self> {
        let bits = images.bits;
        let done = plan.run(options, targets, images, 1)?;
        let hints = if options.no_check {
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
        Ok(Self {
            width,
            height,
            seconds: done.matched.time.as_secs_f64(),
            found_percent: done.found_percent(),
            hints: hints.iter().map(ToString::to_string).collect(),
            line_offsets: plan.line_offsets_shown(&done.matched),
            bits,
        })
    }
}

/// What to print of all pairs.
///
/// # Errors
/// Fails, after the table was printed, with one line that names pairs that were not matched.
pub(super) fn said(options: &Options, rows: &[Row], source: Source) -> Result<Said> {
    let pair = source.pair();
    let text = if options.json {
        let report = Report {
            preset: name_of(&options.overrides.apply(options.preset)?, options.preset),
            pairs: rows,
            source,
        };
        serde_json::to_string(&report)? + "\n"
    } else {
        told(rows, pair)?
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
    write_output(printable(&text).as_bytes())?;
    let more = match failed.len().saturating_sub(NAMED_MAX) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let named = failed[..failed.len().min(NAMED_MAX)].join("; ");
    Err(anyhow!(
        "{} of {} {pair}s were not matched: {named}{more}",
        failed.len(),
        rows.len()
    ))
}

/// The table of all pairs, their mean, and what is to be said of some. `pair` is the word for one.
fn told(rows: &[Row], pair: &str) -> Result<String> {
    let mut table = table(&[pair, "size, px", "ms", "found, %"], 2);
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
        let pairs = format!("{} of {} {pair}s", matched.len(), rows.len());
        table.add_row([
            "mean",
            &pairs,
            &time(seconds / count),
            &format!("{:.1}", found as f64 / count),
        ]);
    }
    Ok(format!("{table}\n{notes}"))
}
