//! `cargo firmware size`: bytes of flash and RAM that the linked firmware takes.

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use vgstereo_sim::tables::table;

use super::selection::{Alone, Selection};
use crate::build::build;
use crate::elf::Sizes;
use crate::stack::deepest_bytes;
use crate::toolchain::ensure_complete;

/// The arguments of `size`.
#[derive(Debug, Args)]
pub struct Size {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: Selection,
}

#[derive(Debug, Serialize)]
struct Row {
    board: String,
    flash_bytes: u64,
    statics_bytes: u64,
    lent_bytes: usize,
    /// `None` where the compiler does not state the stack frames of functions.
    deepest_stack_bytes: Option<u64>,
}

#[derive(Debug, Serialize)]
struct Rows {
    boards: Vec<Row>,
}

impl Size {
    /// Builds the firmware of each board, measures it and returns a table or JSON.
    ///
    /// # Errors
    /// Fails with one line that says what is missing or does not build.
    pub fn run(self) -> Result<String> {
        let selected = self.alone.of(self.selection.boards())?;
        ensure_complete(&selected)?;
        let mut boards = Vec::new();
        for board in selected {
            let firmware = build(&board)?;
            let sizes = Sizes::read(&firmware)?;
            boards.push(Row {
                board: board.full_name(),
                flash_bytes: sizes.flash_bytes,
                statics_bytes: sizes.statics_bytes,
                lent_bytes: sizes.lent_bytes,
                deepest_stack_bytes: deepest_bytes(&firmware)?,
            });
        }
        if self.json {
            return Ok(format!("{}\n", serde_json::to_string(&Rows { boards })?));
        }
        let header = [
            "board",
            "flash",
            "statics",
            "lent to the matcher",
            "deepest stack",
        ];
        let mut table = table(&header, 1);
        for row in boards {
            table.add_row([
                row.board,
                row.flash_bytes.to_string(),
                row.statics_bytes.to_string(),
                row.lent_bytes.to_string(),
                row.deepest_stack_bytes
                    .map_or_else(|| "not stated".into(), |b| b.to_string()),
            ]);
        }
        Ok(format!(
            "{table}\nbytes; of emulated boards flash holds every preset, or the one that is named, and the emulator's files and \
             reports\n\
            deepest stack: the compiler's frames along the deepest chain of calls, those by pointers left out, and \
            the deepest handler of an interrupt\n"
        ))
    }
}
