//! The command `vgstereo`, in the process of a test.

use std::ffi::{OsStr, OsString};

use anyhow::Result;
use clap::Parser;
use vgstereo_sim::commands::CommandLine;

/// Runs `vgstereo` with these arguments.
///
/// # Errors
/// Fails as the command does, or when it does not take the arguments.
pub fn vgstereo<const N: usize>(arguments: [&dyn AsRef<OsStr>; N]) -> Result<()> {
    let words = arguments.into_iter().map(|word| word.as_ref().to_owned());
    let words = [OsString::from("vgstereo")].into_iter().chain(words);
    CommandLine::try_parse_from(words)?.run()?;
    Ok(())
}
