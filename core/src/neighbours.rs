//! The neighbourhoods of 3 x 3 that filters of a row look at.

/// Of rows above, at and below a row, which have an element more at both ends: columns from
/// the left, rows from the top, each a run of `width` elements beside the row's own. `None`
/// where a row is too short.
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
