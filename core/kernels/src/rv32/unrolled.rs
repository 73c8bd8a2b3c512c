//! Loops without a loop.

/// Calls `body` with each index from 0 to `COUNT - 1`, at most 15, without a loop, so that every
/// index is a constant.
#[inline(always)]
pub(crate) fn unrolled<const COUNT: usize>(mut body: impl FnMut(usize)) {
    const { assert!(COUNT <= 16) };
    macro_rules! unroll {
        ($($index:literal)*) => { $(if $index < COUNT { body($index); })* };
    }
    unroll!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
}
