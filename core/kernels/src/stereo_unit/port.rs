//! The way to the unit: its registers, and memory that it reads.

/// The way to a stereo unit.
pub trait Port: Copy {
    /// Reads the register at this offset from the unit's first.
    fn read(self, offset: usize) -> u32;

    /// Writes a register.
    fn write(self, offset: usize, value: u32);

    /// The address at which the unit reads these bytes: they are in its memory, as they are now.
    fn address(self, bytes: &[u8]) -> u32;
}
