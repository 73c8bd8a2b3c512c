//! Set-up of the chip's memories, placed as in `memory.x`, and of its caches.

use cortex_m::asm::{dsb, isb};
use cortex_m::peripheral::{MPU, Peripherals};
use embassy_stm32::pac::RCC;
use grounded::uninit::GroundedArrayCell;

use crate::CONFIG;
use crate::capture::RAW_WORDS;

/// Words of both raw lines.
const RAW_LINES_WORDS: usize = 2 * RAW_WORDS;

#[unsafe(export_name = "lent_memory")]
#[unsafe(link_section = ".axisram")]
static MATCHER: GroundedArrayCell<u32, { CONFIG.memory_words() }> = GroundedArrayCell::uninit();
#[unsafe(link_section = ".sram1")]
static RAW_LINES: GroundedArrayCell<u32, RAW_LINES_WORDS> = GroundedArrayCell::uninit();

/// Enables the caches. Returns the matcher's memory, and that of the raw lines, which is not
/// cached.
///
/// # Panics
/// If it is called more than once.
pub fn take() -> (&'static mut [u32], &'static mut [u32]) {
    let mut core = defmt::unwrap!(Peripherals::take());
    // SRAM1 is off after a reset, and an access without its clock would be a bus fault.
    RCC.ahb2enr().modify(|enable| enable.set_sram1en(true));
    leave_sram1_uncached(&mut core.MPU);
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    // SAFETY: there is no other reference, because the core's peripherals can be taken only once.
    unsafe {
        (
            initialised(MATCHER.get_ptr_len()),
            initialised(RAW_LINES.get_ptr_len()),
        )
    }
}

/// Clears `words` words from `start` on and returns them as a slice.
///
/// # Safety
/// The words are writable, and there is no other reference to them.
unsafe fn initialised((start, words): (*mut u32, usize)) -> &'static mut [u32] {
    // SAFETY: the caller promises it, and every word is written before the slice exists.
    unsafe {
        start.write_bytes(0, words);
        core::slice::from_raw_parts_mut(start, words)
    }
}

/// Configures all 128 KB of SRAM1 as normal memory that is neither cached nor executable, so that
/// the core reads what DMA1 has written.
fn leave_sram1_uncached(mpu: &mut MPU) {
    const BASE: u32 = 0x3000_0000;
    const EXECUTE_NEVER: u32 = 1 << 28;
    const FULL_ACCESS: u32 = 0b011 << 24;
    const NORMAL_NOT_CACHED: u32 = 0b001 << 19;
    const SHAREABLE: u32 = 1 << 18;
    /// Size field of 128 KB: the binary logarithm of the bytes, less 1.
    const SIZE: u32 = 16 << 1;
    const ENABLE: u32 = 1;
    const DEFAULT_MAP_ELSEWHERE: u32 = 1 << 2;
    // SAFETY: there is no reference to SRAM1 yet, and the default map stays for all other memory.
    unsafe {
        mpu.rnr.write(0);
        mpu.rbar.write(BASE);
        mpu.rasr
            .write(EXECUTE_NEVER | FULL_ACCESS | NORMAL_NOT_CACHED | SHAREABLE | SIZE | ENABLE);
        mpu.ctrl.write(DEFAULT_MAP_ELSEWHERE | ENABLE);
    }
    dsb();
    isb();
}
