//! Lent working memory: one block of words that stages carve their rows from.
//!
//! The matcher owns no buffers. A board lends a static, the host a `Vec`; every stage
//! states with a `const fn` how many words it takes and takes exactly those.

use core::fmt;

use bytemuck::Pod;

/// The lent memory has fewer words than the configuration needs; nothing was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfMemory;

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the lent memory is smaller than the configuration needs")
    }
}

impl core::error::Error for OutOfMemory {}

/// Words of 32 bits that hold `count` elements of `bytes_each` bytes.
#[must_use]
pub const fn words(count: usize, bytes_each: usize) -> usize {
    (count * bytes_each).div_ceil(size_of::<u32>())
}

/// Hands out slices of a lent block, front to back, each starting on a word.
#[derive(Debug)]
pub struct Arena<'m> {
    free: &'m mut [u32],
}

impl<'m> Arena<'m> {
    /// Wraps a lent block.
    pub fn new(block: &'m mut [u32]) -> Self {
        Self { free: block }
    }

    /// Words not yet handed out.
    #[must_use]
    pub fn free_words(&self) -> usize {
        self.free.len()
    }

    /// Hands out `count` zeroed elements of a type aligned to at most 4 bytes.
    ///
    /// # Errors
    /// [`OutOfMemory`] when fewer than [`words`]`(count, size_of::<T>())` words are
    /// left, or when `T` needs a stricter alignment than a word's.
    pub fn take<T: Pod>(&mut self, count: usize) -> Result<&'m mut [T], OutOfMemory> {
        let needed = words(count, size_of::<T>());
        if align_of::<T>() > align_of::<u32>() || needed > self.free.len() {
            return Err(OutOfMemory);
        }
        let (taken, free) = core::mem::take(&mut self.free).split_at_mut(needed);
        self.free = free;
        taken.fill(0);
        // The tail of the last word may be too short for one more `T`: cast the bytes that count.
        let bytes: &'m mut [u8] = bytemuck::cast_slice_mut(taken);
        let bytes = bytes.get_mut(..count * size_of::<T>()).ok_or(OutOfMemory)?;
        bytemuck::try_cast_slice_mut(bytes).map_err(|_| OutOfMemory)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_exactly_the_stated_words_and_refuses_more() {
        let mut block = [u32::MAX; 8];
        let mut arena = Arena::new(&mut block);
        let bytes = arena.take::<u8>(5).unwrap();
        assert_eq!(bytes, &[0; 5]);
        assert_eq!(arena.free_words(), 8 - words(5, 1));
        assert_eq!(arena.take::<i16>(13).unwrap_err(), OutOfMemory);
        assert_eq!(arena.free_words(), 6, "a refused request takes nothing");
        assert_eq!(arena.take::<i16>(12).unwrap().len(), 12);
        assert_eq!(arena.free_words(), 0);
    }

    #[test]
    fn refuses_types_stricter_than_a_word() {
        let mut block = [0; 8];
        assert_eq!(
            Arena::new(&mut block).take::<u64>(1).unwrap_err(),
            OutOfMemory
        );
    }
}
