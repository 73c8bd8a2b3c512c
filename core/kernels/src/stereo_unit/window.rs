//! Windows of the unit: its results, word by word.

use super::port::Port;

/// Pixels of a row that the unit takes at a time, wherever the first lies in its word.
pub(super) const PIECE_PX: usize = 252;

/// A window, at this offset from the unit's first register.
#[derive(Debug, Clone, Copy)]
#[repr(usize)]
pub(super) enum Window {
    /// Margin, best disparity and step of each pixel.
    Pixels = 0x1000,
    /// The best of each position of the other view.
    Others = 0x1400,
    /// Cells, levels or medians.
    Results = 0x1800,
}

impl Window {
    /// Place of the first of some bytes in its word of memory.
    pub(super) fn place(bytes: &[u8]) -> u32 {
        (bytes.as_ptr().addr() & 3) as u32
    }

    /// The first `count` words.
    #[inline(always)]
    pub(super) fn words(self, port: impl Port, count: usize) -> impl Iterator<Item = u32> {
        port.read_words(self as usize, count)
    }

    /// Copies `count` words, and fills the rest with ones.
    pub(super) fn copy_words(self, port: impl Port, to: &mut [u32], count: usize) {
        let (to, rest) = to.split_at_mut(count.min(to.len()));
        let words = self.words(port, to.len());
        for (to, word) in to.iter_mut().zip(words) {
            *to = word;
        }
        rest.fill(u32::MAX);
    }

    /// Copies bytes whose first lies at [`Window::place`] in the first word.
    pub(super) fn copy_bytes(self, port: impl Port, place: u32, to: &mut [u8]) {
        let (head, words, tail) = bytemuck::pod_align_to_mut::<u8, u32>(to);
        let mut at = self as usize;
        if !head.is_empty() {
            copy_part(port.read(at) >> (8 * place), head);
            at += 4;
        }
        let count = words.len();
        for (to, word) in words.iter_mut().zip(port.read_words(at, count)) {
            *to = word.to_le();
        }
        if !tail.is_empty() {
            copy_part(port.read(at + 4 * count), tail);
        }
    }
}

/// Copies the lowest bytes of a word.
fn copy_part(word: u32, to: &mut [u8]) {
    for (to, byte) in to.iter_mut().zip(word.to_le_bytes()) {
        *to = byte;
    }
}
