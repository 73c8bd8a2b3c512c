//! Neighbourhoods of 3 x 3 elements, for filters of a row.

/// Splits three rows, each with one element more than `width` at both ends, into the nine runs of
/// `width` elements of a 3 x 3 filter: columns from the left, and rows from the top within each.
/// Returns `None` if a row is too short.
#[inline(always)]
pub(crate) fn neighbours<T>(rows: [&[T]; 3], width: usize) -> Option<[[&[T]; 3]; 3]> {
    let mut columns = [[&[][..]; 3]; 3];
    for (column, from) in columns.iter_mut().zip(0..) {
        for (run, row) in column.iter_mut().zip(rows) {
            *run = row.get(from..from + width)?;
        }
    }
    Some(columns)
}
