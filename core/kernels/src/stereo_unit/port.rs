//! The way to the unit: its registers, and memory that it reads.

/// The way to a stereo unit.
pub trait Port: Copy {
    /// Reads the register at this offset from the unit's first.
    fn read(self, offset: usize) -> u32;

    /// Reads `count` registers, one after another, from the one at this offset on.
    #[inline(always)]
    fn read_words(self, offset: usize, count: usize) -> impl Iterator<Item = u32> {
        (0..count).map(move |index| self.read(offset + 4 * index))
    }

    /// Writes a register.
    fn write(self, offset: usize, value: u32);

    /// The address at which the unit reads these bytes: they are in its memory, as they are now.
    fn address(self, bytes: &[u8]) -> u32;
}
