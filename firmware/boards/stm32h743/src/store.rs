//! The calibration slot in flash as the store of calibrations from the host.

use embassy_stm32::flash::{Blocking, Error, Flash, WRITE_SIZE};
use stm32_stereo::calibration::{RECTIFIER_BYTES, SLOT_BYTES, slot};
use stm32_stereo::watchdog::Iwdg;
use vgstereo_firmware::live::{CalibrationStore, RamStore, StoreError};

/// Place of the slot in flash, as of `memory.x`: the last sector of the second bank. Code, which is in the
/// first bank, goes on while it is erased and written.
const OFFSET: u32 = 0x001e_0000;

/// Value of bytes that are erased.
const ERASED: u8 = 0xff;

/// The slot, with memory for a calibration on its way.
pub struct FlashStore {
    flash: Flash<'static, Blocking>,
    staging: RamStore<'static>,
    watchdog: Iwdg,
}

impl FlashStore {
    /// The slot, of which nobody may hold a reference. `staging` has [`SLOT_BYTES`].
    pub fn new(
        flash: Flash<'static, Blocking>,
        staging: &'static mut [u8],
        watchdog: Iwdg,
    ) -> Self {
        Self {
            flash,
            staging: RamStore::new(staging, RECTIFIER_BYTES / size_of::<u32>()),
            watchdog,
        }
    }

    /// Erases the slot, and writes these bytes to it.
    fn write_slot(flash: &mut Flash<'static, Blocking>, bytes: &[u8]) -> Result<(), Error> {
        flash.blocking_erase(OFFSET, OFFSET + SLOT_BYTES as u32)?;
        let (words, rest) = bytes.as_chunks::<WRITE_SIZE>();
        flash.blocking_write(OFFSET, words.as_flattened())?;
        if rest.is_empty() {
            return Ok(());
        }
        let mut last = [ERASED; WRITE_SIZE];
        last[..rest.len()].copy_from_slice(rest);
        flash.blocking_write(OFFSET + (bytes.len() - rest.len()) as u32, &last)
    }
}

impl CalibrationStore for FlashStore {
    fn capacity_bytes(&self) -> usize {
        self.staging.capacity_bytes()
    }

    fn rectifier_words(&self) -> usize {
        self.staging.rectifier_words()
    }

    fn begin(&mut self, total_bytes: usize) -> Result<(), StoreError> {
        self.staging.begin(total_bytes)
    }

    fn write(&mut self, offset_bytes: usize, piece: &[u8]) -> Result<(), StoreError> {
        self.staging.write(offset_bytes, piece)
    }

    fn staged(&self) -> &[u8] {
        self.staging.staged()
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        let (flash, bytes) = (&mut self.flash, self.staging.staged());
        let written = self.watchdog.stretched(|| Self::write_slot(flash, bytes));
        // The slot is not cached, so that this is what is in flash.
        if written.is_ok() && slot().starts_with(bytes) {
            Ok(())
        } else {
            Err(StoreError::Write)
        }
    }
}
