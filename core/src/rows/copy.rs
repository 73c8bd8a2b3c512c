//! Copies between rows that may differ in length, and within a row to its ends.

use core::ops::Range;

/// Copies the elements that both have room for, the first to the first.
#[inline]
pub(crate) fn copy_common<T: Copy>(to: &mut [T], from: &[T]) {
    let common = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..common), from.get(..common)) {
        to.copy_from_slice(from);
    }
}

/// Repeats the first and the last element of the run `inside` of a row to the ends of the row. An
/// empty run, or one that leaves the row, changes nothing.
#[inline]
pub(crate) fn extend_run<T: Copy>(row: &mut [T], inside: Range<usize>) {
    let Some((before, rest)) = row.split_at_mut_checked(inside.start) else {
        return;
    };
    let Some((inside, after)) = rest.split_at_mut_checked(inside.len()) else {
        return;
    };
    if let (Some(&first), Some(&last)) = (inside.first(), inside.last()) {
        before.fill(first);
        after.fill(last);
    }
}
