//! Copies of rows that may differ in length.

/// Copies the elements that both have room for, the first to the first.
#[inline]
pub(crate) fn copy_common<T: Copy>(to: &mut [T], from: &[T]) {
    let common = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..common), from.get(..common)) {
        to.copy_from_slice(from);
    }
}
