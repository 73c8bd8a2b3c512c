//! Tables as the commands print them, and how their numbers are written.

use std::time::Duration;

use comfy_table::{CellAlignment, Table, presets};

/// Returns an empty table with this header. The first `texts` columns hold text and are
/// aligned to the left, the others hold numbers and are aligned to the right.
#[must_use]
pub fn table(header: &[&str], texts: usize) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN).set_header(header);
    for column in table.column_iter_mut().skip(texts) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// Returns a percentage with two decimals, or a dash when there is none.
#[must_use]
pub fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

/// Returns a difference of percentages with its sign and two decimals, or a dash when there is none.
#[must_use]
pub fn difference(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:+.2}"))
}

/// Returns a time in milliseconds with one decimal.
#[must_use]
pub fn milliseconds(time: Duration) -> String {
    format!("{:.1}", time.as_secs_f64() * 1e3)
}

/// Returns a number of bytes in KiB with one decimal.
#[must_use]
pub fn kib(bytes: usize) -> String {
    format!("{:.1}", bytes as f64 / 1024.0)
}
