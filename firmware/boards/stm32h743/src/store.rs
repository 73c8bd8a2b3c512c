//! The calibration slot in flash as the store of calibrations from the host.

use embassy_stm32::flash::{Blocking, Flash, WRITE_SIZE};
use stm32_stereo::calibration::{RECTIFIER_BYTES, SLOT_BYTES, slot};
use stm32_stereo::watchdog::Iwdg;
use vgstereo_firmware::live::{CalibrationStore, StoreError};

/// Place of the slot in flash, as of `memory.x`: the last sector of the second bank. Code, which is in the
/// first bank, goes on while it is erased and written.
const OFFSET: u32 = 0x001e_0000;

/// Value of bytes that are erased.
const ERASED: u8 = 0xff;

/// The slot, with memory for a calibration on its way.
pub struct FlashStore {
    flash: Flash<'static, Blocking>,
    staging: &'static mut [u8],
    staged_bytes: usize,
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
            staging,
            staged_bytes: 0,
            watchdog,
        }
    }

    fn write_slot(&mut self) -> Option<()> {
        let words = self.staged_bytes.next_multiple_of(WRITE_SIZE);
        self.staging.get_mut(self.staged_bytes..words)?.fill(ERASED);
        let bytes = self.staging.get(..words)?;
        let flash = &mut self.flash;
        let end = OFFSET + SLOT_BYTES as u32;
        let written = self.watchdog.stretched(|| {
            flash.blocking_erase(OFFSET, end)?;
            flash.blocking_write(OFFSET, bytes)
        });
        written.ok()?;
        // Not cached, so that this is what is in flash.
        slot().starts_with(bytes).then_some(())
    }
}

impl CalibrationStore for FlashStore {
    fn capacity_bytes(&self) -> usize {
        self.staging.len()
    }

    fn rectifier_words(&self) -> usize {
        RECTIFIER_BYTES / size_of::<u32>()
    }

    fn begin(&mut self, total_bytes: usize) -> Result<(), StoreError> {
        if total_bytes > self.staging.len() {
            return Err(StoreError::Size);
        }
        self.staged_bytes = 0;
        Ok(())
    }

    fn write(&mut self, offset_bytes: usize, piece: &[u8]) -> Result<(), StoreError> {
        let end = offset_bytes.saturating_add(piece.len());
        let place = self.staging.get_mut(offset_bytes..end);
        place.ok_or(StoreError::Size)?.copy_from_slice(piece);
        self.staged_bytes = end;
        Ok(())
    }

    fn staged(&self) -> &[u8] {
        self.staging.get(..self.staged_bytes).unwrap_or_default()
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.write_slot().ok_or(StoreError::Write)
    }
}
