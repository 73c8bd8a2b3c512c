//! The calibration slot: a sector of flash for the rectification of the board's cameras, which is
//! written there by the debug probe, apart from the program.

use vgstereo_core::Kernels;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_firmware::calibration::Fit;

use crate::rig::Rig;

/// Bytes of the slot: a sector of flash.
pub const SLOT_BYTES: usize = 128 * 1024;

/// Bytes of the rectifier's memory: the lines that are kept of two views of 320 columns, with room for
/// strongly distorted lenses.
pub const RECTIFIER_BYTES: usize = 20 * 1024;

/// Returns the bytes of the slot, which the linker script has named.
#[must_use]
pub fn slot() -> &'static [u8] {
    unsafe extern "C" {
        static _calibration: [u8; SLOT_BYTES];
    }
    // SAFETY: the linker places the symbol at a part of flash of that size, which the program does
    // not write.
    unsafe { &_calibration }
}

/// Copies the calibration in the slot into `memory` of [`SLOT_BYTES`], so that the slot can be written while
/// it is in use. A slot without one is left to [`rectifier`] to tell.
#[must_use]
pub fn copied(slot: &'static [u8], memory: &'static mut [u8]) -> &'static [u8] {
    let Ok(rectification) = Rectification::from_prefix(slot) else {
        return slot;
    };
    let bytes = rectification.bytes();
    let copy = &mut memory[..bytes.len()];
    copy.copy_from_slice(bytes);
    copy
}

/// Builds the rectifier of what is in the slot, for lines of `rig` and a matcher of `width` columns.
/// Logs what it found. Without a rectification that suits, lines are taken as they come.
pub fn rectifier<K: Kernels>(
    slot: &'static [u8],
    rig: &Rig,
    width: u16,
    kernels: K,
    memory: &'static mut [u32],
) -> Option<Rectifier<'static, 'static, K>> {
    if slot.starts_with(&[0xff; 4]) {
        defmt::info!("no calibration: lines are taken as rectified ones");
        return None;
    }
    let rectification = match Rectification::from_prefix(slot) {
        Ok(rectification) => rectification,
        Err(error) => {
            defmt::error!("the calibration is not used: {}", error);
            return None;
        }
    };
    let fit = Fit {
        raw: rig.geometry,
        width,
        colour: !rig.geometry.format.is_grey(),
        rectifier_words: memory.len(),
    };
    if let Err(unfit) = fit.check(&rectification) {
        defmt::error!("the calibration is not used: {}", unfit);
        return None;
    }
    let kept = [
        rectification.left.kept_lines(),
        rectification.right.kept_lines(),
    ];
    // It fits, so that there is memory for it.
    let rectifier = Rectifier::new(rectification, fit.colour, kernels, memory).ok()?;
    defmt::info!("calibrated: {} and {} raw lines are kept", kept[0], kept[1]);
    Some(rectifier)
}
