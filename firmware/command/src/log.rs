//! Decodes what a board logs with defmt.

use std::path::Path;

use anyhow::{Context, Result, bail};
use defmt_decoder::{DecodeError, Table};

/// What stands in the place of a line that a reset of the board broke off.
const BROKEN: &str = "(broken off)";

/// Returns the lines of a log, each with its level. The log holds only numbers; the texts are
/// in the linked file.
///
/// # Errors
/// Fails when the linked file has no texts, or when the log is not one of this firmware.
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
            Err(DecodeError::Malformed) if table.encoding().can_recover() => {
                lines.push(BROKEN.to_owned());
            }
            Err(DecodeError::Malformed) => bail!("the log is not one of {name}"),
        }
    }
}
