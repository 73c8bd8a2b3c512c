//! What a board logs with defmt.

use std::path::Path;

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, Table};

/// The lines of a log, with their levels; the linked file has the texts.
///
/// # Errors
/// When the file has no texts or the log is none of its.
pub fn lines(firmware: &Path, log: &[u8]) -> Result<Vec<String>> {
    let name = firmware.display();
    let file = std::fs::read(firmware).with_context(|| format!("cannot read {name}"))?;
    let table = Table::parse(&file)?.with_context(|| format!("{name} does not log"))?;
    let mut decoder = table.new_stream_decoder();
    decoder.received(log);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let level = frame.level().map_or("", |level| level.as_str());
                lines.push(format!("{level} {}", frame.display_message()));
            }
            Err(DecodeError::UnexpectedEof) => return Ok(lines),
            Err(DecodeError::Malformed) => bail!("the log is not one of {name}"),
        }
    }
}
