//! The files that a match writes.

use std::collections::HashSet;
use std::path::{Path, PathBuf, absolute};

use anyhow::{Context, Result, ensure};

use super::options::Options;
use crate::escapes::shown;
use crate::files::make_folder;

/// The options that name them.
pub(super) const OPTIONS: &str =
    "--out, --colour, --depth, --points, --confidence, --scan, --rectified";

/// What stands for the name of a pair.
const PLACE: &str = "{}";

/// The files that are written of some pairs, of which no two are one.
#[derive(Debug, Default)]
pub(super) struct Written(HashSet<PathBuf>);

impl Written {
    /// Adds a file. `pairs` is the word for what writes them.
    ///
    /// # Errors
    /// Fails with one line that names the file when another pair writes it.
    pub(super) fn add(&mut self, path: &Path, pairs: &str) -> Result<()> {
        let is_new = self
            .0
            .insert(absolute(path).unwrap_or_else(|_| path.to_owned()));
        ensure!(is_new, "two {pairs} would write {}", shown(path));
        Ok(())
    }
}

/// The files that are written of a pair.
#[derive(Debug, Clone)]
pub(super) struct Targets {
    pub(super) out: PathBuf,
    pub(super) colour: Option<PathBuf>,
    pub(super) depth: Option<PathBuf>,
    pub(super) points: Option<PathBuf>,
    pub(super) confidence: Option<PathBuf>,
    pub(super) scan: Option<PathBuf>,
    /// A folder.
    pub(super) rectified: Option<PathBuf>,
}

impl Targets {
    /// Those that the options name.
    pub(super) fn of(options: &Options) -> Self {
        Self {
            out: options.out.clone(),
            colour: options.colour.clone(),
            depth: options.depth.clone(),
            points: options.points.clone(),
            confidence: options.confidence.clone(),
            scan: options.scan.scan.clone(),
            rectified: options.rectified.clone(),
        }
    }

    /// Those of the pair of this name, which stands in the place of each [`PLACE`].
    ///
    /// # Errors
    /// Fails with one line when a path is no text.
    pub(super) fn named(&self, name: &str) -> Result<Self> {
        let named = |path: &PathBuf| -> Result<PathBuf> {
            let text = path.to_str();
            let text =
                text.with_context(|| format!("{}: the name is no text in UTF-8", shown(path)))?;
            Ok(text.replace(PLACE, name).into())
        };
        let option = |path: &Option<PathBuf>| path.as_ref().map(named).transpose();
        Ok(Self {
            out: named(&self.out)?,
            colour: option(&self.colour)?,
            depth: option(&self.depth)?,
            points: option(&self.points)?,
            confidence: option(&self.confidence)?,
            scan: option(&self.scan)?,
            rectified: option(&self.rectified)?,
        })
    }

    /// The paths as they were given, each with its option.
    pub(super) fn given(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let others = [
            ("--colour", &self.colour),
            ("--depth", &self.depth),
            ("--points", &self.points),
            ("--confidence", &self.confidence),
            ("--scan", &self.scan),
            ("--rectified", &self.rectified),
        ];
        let others = others
            .into_iter()
            .filter_map(|(option, path)| Some((option, path.as_deref()?)));
        std::iter::once(("--out", self.out.as_path())).chain(others)
    }

    /// Checks that each path has a place for the names of pairs.
    ///
    /// # Errors
    /// Fails with one line that names the option.
    pub(super) fn ensure_named(&self) -> Result<()> {
        for (option, path) in self.given() {
            ensure!(
                path.to_string_lossy().contains(PLACE),
                "{option} {}: of many pairs, {PLACE} in it stands for the name of each",
                shown(path)
            );
        }
        Ok(())
    }

    /// Makes the folders that all pairs have in common.
    ///
    /// # Errors
    /// Fails with one line that names the folder and the reason.
    pub(super) fn make_folders(&self) -> Result<()> {
        for (_, path) in self.given() {
            let folder = path.parent().filter(|folder| *folder != Path::new(""));
            if let Some(folder) = folder.filter(|folder| !folder.to_string_lossy().contains(PLACE))
            {
                make_folder(folder)?;
            }
        }
        Ok(())
    }

    /// The pictures of the rectified views.
    pub(super) fn views(&self) -> Vec<PathBuf> {
        let folder = self.rectified.iter();
        folder
            .flat_map(|folder| ["left.png", "right.png"].map(|name| folder.join(name)))
            .collect()
    }

    /// All files.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let given = self.given().filter(|(option, _)| *option != "--rectified");
        let given = given.map(|(_, path)| path.to_owned());
        given.chain(self.views()).collect()
    }
}
