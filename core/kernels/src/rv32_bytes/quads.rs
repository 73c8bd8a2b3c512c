//! Four bytes of a row after the other, read as words at any address.

use bytemuck::pod_align_to;

use super::instructions::{join, left_of};

/// A row of bytes of which four can be read at a time.
#[derive(Clone, Copy)]
pub(super) struct Quads<'a> {
    /// The words of memory of which the row has all bytes. Each ends a quad.
    pub(super) words: &'a [u32],
    /// The bytes of the row before a word, at most three, with their number in the highest byte.
    pub(super) left: u32,
}

impl<'a> Quads<'a> {
    /// The row from its first byte on. Up to six of its last bytes are in no quad.
    #[inline(always)]
    pub(super) fn new(row: &'a [u8]) -> Self {
        let (first, words, _) = pod_align_to(row);
        let mut left = 0;
        for &byte in first.iter().rev() {
            left = left << 8 | u32::from(byte);
        }
        let left = left | (first.len() as u32) << 24;
        Self { words, left }
    }
}

/// The quads that these words end, the first byte of each in byte 0. `left` are the bytes before the words, and
/// afterwards those that are in no quad yet.
#[inline(always)]
pub(super) fn join_all<const COUNT: usize>(left: &mut u32, words: [u32; COUNT]) -> [u32; COUNT] {
    let mut before = [*left; COUNT];
    for (before, word) in before.iter_mut().skip(1).zip(words) {
        *before = left_of(*left, word);
    }
    if let Some(&last) = words.last() {
        *left = left_of(*left, last);
    }
    core::array::from_fn(|at| join(before[at], words[at]))
}
