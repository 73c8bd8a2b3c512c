//! Finds the panics that the pipeline could still reach in linked firmware.
//!
//! The linker keeps the relocations of the boards, which show every call, and their line
//! tables, which tell the source that a call was inlined from.

use std::collections::BTreeSet;
use std::path::Path;

use addr2line::Context as Lines;
use addr2line::gimli::{Dwarf, EndianSlice, LittleEndian};
use anyhow::{Result, ensure};
use object::{Object, ObjectSection, ObjectSymbol};

use crate::elf;

/// Parts of the paths of the pipeline's sources.
const PIPELINE: [&str; 2] = ["/core/src/", "/firmware/src/"];

/// Parts of the paths of the sources around the pipeline, which read the command line, hold the
/// files and write the report, and of the log and the drivers of chips. They may panic.
const AROUND: [&str; 5] = [
    "/defmt-",
    "/embassy-",
    "/firmware/src/scripted.rs",
    "/firmware/emulated/src/",
    "/firmware/boards/",
];

/// A part of the paths of Rust's own library, whose folders have names like ours.
const LIBRARY: &str = "/library/";

/// A part of the names of all panic functions.
const PANIC: &str = "panicking";

/// A call in the linked code.
struct Call {
    /// The name of the calling function.
    from: String,
    /// The name of the called function.
    to: String,
    /// The source lines that the call was inlined from, innermost first.
    lines: Vec<String>,
}

/// Returns the calls by which the pipeline reaches a panic function, each with its source
/// lines. A call belongs to the innermost of our own sources that it was inlined from. A call
/// in a function of another crate belongs to the callers of that function.
///
/// # Errors
/// Fails when the file cannot be read, or when it shows no call of a panic function at all:
/// around the pipeline there always are some.
pub fn of_pipeline(path: &Path) -> Result<Vec<String>> {
    let calls = calls(path)?;
    let is_of = |line: &str, sources: &[&str]| {
        !line.contains(LIBRARY) && sources.iter().any(|source| line.contains(source))
    };
    let mut found = BTreeSet::new();
    let mut panicking: BTreeSet<&str> = calls
        .iter()
        .map(|call| call.to.as_str())
        .filter(|name| name.contains(PANIC))
        .collect();
    // The code that reads the command line calls some.
    ensure!(
        !panicking.is_empty(),
        "{} shows no call of a panic function at all",
        path.display()
    );
    loop {
        let known = panicking.len();
        for call in &calls {
            if !panicking.contains(call.to.as_str()) {
                continue;
            }
            let mut lines = call.lines.iter();
            match lines.find(|line| is_of(line, &PIPELINE) || is_of(line, &AROUND)) {
                Some(line) if is_of(line, &AROUND) => {}
                Some(_) => {
                    found.insert(format!("{}: {}", call.to, call.lines.join(", ")));
                }
                None => {
                    panicking.insert(&call.from);
                }
            }
        }
        if panicking.len() == known {
            return Ok(found.into_iter().collect());
        }
    }
}

fn calls(path: &Path) -> Result<Vec<Call>> {
    let bytes = elf::read(path)?;
    let file = elf::parse(path, &bytes)?;
    // Sections are read unchanged: relocations were applied when the file was linked.
    let dwarf = Dwarf::load(|section| {
        let section = file.section_by_name(section.name());
        let bytes = section.map_or(Ok(&[][..]), |section| section.data())?;
        object::Result::Ok(EndianSlice::new(bytes, LittleEndian))
    })?;
    let lines = Lines::from_dwarf(dwarf)?;
    let functions = elf::functions(&file);
    let mut calls = Vec::new();
    for (at, target) in elf::calls(&file)? {
        let from = functions.range(..=at).next_back();
        let (Ok(to), Some((_, from))) = (target.name(), from) else {
            continue;
        };
        calls.push(Call {
            from: (*from).to_owned(),
            to: to.to_owned(),
            lines: source_lines(&lines, at)?,
        });
    }
    Ok(calls)
}

fn source_lines(lines: &Lines<EndianSlice<'_, LittleEndian>>, address: u64) -> Result<Vec<String>> {
    let mut frames = lines.find_frames(address).skip_all_loads()?;
    let mut found = Vec::new();
    while let Some(frame) = frames.next()? {
        if let Some(location) = frame.location {
            let line = location.line.unwrap_or(0);
            found.push(format!("{}:{line}", location.file.unwrap_or("?")));
        }
    }
    Ok(found)
}
