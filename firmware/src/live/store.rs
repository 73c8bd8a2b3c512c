//! Where a calibration from the host is kept.

/// Why a calibration was not stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoreError {
    /// The board cannot store one.
    Unsupported,
    /// It is larger than the store.
    Size,
    /// It could not be written.
    Write,
}

/// A place for the bytes of a calibration that comes from the host piece by piece. What is in use is not
/// touched: the board takes the new one when [`Live`](super::Live) ends with it.
pub trait CalibrationStore {
    /// Bytes of the largest calibration; 0 if none can be stored.
    fn capacity_bytes(&self) -> usize;

    /// Words of 32 bits that the board has for a rectifier. A calibration whose rectifier takes more is
    /// refused.
    fn rectifier_words(&self) -> usize;

    /// Forgets what has come, and makes room for so many bytes.
    ///
    /// # Errors
    /// [`StoreError`] when there is no such room.
    fn begin(&mut self, total_bytes: usize) -> Result<(), StoreError>;

    /// Writes a piece; pieces follow each other without gaps.
    ///
    /// # Errors
    /// [`StoreError`] when it could not be written.
    fn write(&mut self, offset_bytes: usize, piece: &[u8]) -> Result<(), StoreError>;

    /// The bytes that have come.
    fn staged(&self) -> &[u8];

    /// Keeps what has come, which is a valid rectification that suits the board, as its calibration.
    ///
    /// # Errors
    /// [`StoreError`] when it could not be kept.
    fn commit(&mut self) -> Result<(), StoreError>;
}

/// For boards that store no calibration.
#[derive(Debug, Clone, Copy)]
pub struct NoStore;

impl CalibrationStore for NoStore {
    fn capacity_bytes(&self) -> usize {
        0
    }

    fn rectifier_words(&self) -> usize {
        0
    }

    fn begin(&mut self, _: usize) -> Result<(), StoreError> {
        Err(StoreError::Unsupported)
    }

    fn write(&mut self, _: usize, _: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::Unsupported)
    }

    fn staged(&self) -> &[u8] {
        &[]
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Unsupported)
    }
}

/// A store that is lent.
impl<T: CalibrationStore> CalibrationStore for &mut T {
    fn capacity_bytes(&self) -> usize {
        (**self).capacity_bytes()
    }

    fn rectifier_words(&self) -> usize {
        (**self).rectifier_words()
    }

    fn begin(&mut self, total_bytes: usize) -> Result<(), StoreError> {
        (**self).begin(total_bytes)
    }

    fn write(&mut self, offset_bytes: usize, piece: &[u8]) -> Result<(), StoreError> {
        (**self).write(offset_bytes, piece)
    }

    fn staged(&self) -> &[u8] {
        (**self).staged()
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        (**self).commit()
    }
}

/// A calibration in lent memory, lost with the supply.
#[derive(Debug)]
pub struct RamStore<'m> {
    bytes: &'m mut [u8],
    rectifier_words: usize,
    staged_bytes: usize,
    is_committed: bool,
}

impl<'m> RamStore<'m> {
    /// An empty store in this memory, of a board that has so many words for a rectifier.
    #[must_use]
    pub fn new(bytes: &'m mut [u8], rectifier_words: usize) -> Self {
        Self {
            bytes,
            rectifier_words,
            staged_bytes: 0,
            is_committed: false,
        }
    }

    /// The calibration that was kept; `None` if none was since the store was made or this was called.
    pub fn take(&mut self) -> Option<&[u8]> {
        core::mem::take(&mut self.is_committed)
            .then(|| self.bytes.get(..self.staged_bytes).unwrap_or_default())
    }
}

impl CalibrationStore for RamStore<'_> {
    fn capacity_bytes(&self) -> usize {
        self.bytes.len()
    }

    fn rectifier_words(&self) -> usize {
        self.rectifier_words
    }

    fn begin(&mut self, total_bytes: usize) -> Result<(), StoreError> {
        if total_bytes > self.bytes.len() {
            return Err(StoreError::Size);
        }
        self.staged_bytes = 0;
        self.is_committed = false;
        Ok(())
    }

    fn write(&mut self, offset_bytes: usize, piece: &[u8]) -> Result<(), StoreError> {
        let end = offset_bytes.saturating_add(piece.len());
        let place = self.bytes.get_mut(offset_bytes..end);
        // The compiler does not see that the lengths are equal, and `copy_from_slice` could panic.
        for (kept, byte) in place.ok_or(StoreError::Size)?.iter_mut().zip(piece) {
            *kept = *byte;
        }
        self.staged_bytes = end;
        Ok(())
    }

    fn staged(&self) -> &[u8] {
        self.bytes.get(..self.staged_bytes).unwrap_or_default()
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.is_committed = true;
        Ok(())
    }
}
