//! The memories of the part, as `memory.x` shares them out, and the caches.

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

/// Turns the caches on and gives the matcher's memory and that of the raw lines, which is
/// not cached.
///
/// # Panics
/// When it is called twice.
pub fn take() -> (&'static mut [u32], &'static mut [u32]) {
    let mut core = defmt::unwrap!(Peripherals::take());
    // Off after a reset; an access without the clock would be a bus fault.
    RCC.ahb2enr().modify(|enable| enable.set_sram1en(true));
    leave_sram1_uncached(&mut core.MPU);
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    // SAFETY: nobody else has them, as the core's peripherals are taken only once.
    unsafe {
        (
            initialised(MATCHER.get_ptr_len()),
            initialised(RAW_LINES.get_ptr_len()),
        )
    }
}

/// # Safety
/// These words are lent to nobody else.
unsafe fn initialised((start, words): (*mut u32, usize)) -> &'static mut [u32] {
    // SAFETY: the caller's promise; every word is written before the slice exists.
    unsafe {
        start.write_bytes(0, words);
        core::slice::from_raw_parts_mut(start, words)
    }
}

/// Makes all 128 KB of SRAM1 normal memory that is neither cached nor executed: the core
/// reads what DMA1 wrote.
fn leave_sram1_uncached(mpu: &mut MPU) {
    const BASE: u32 = 0x3000_0000;
    const EXECUTE_NEVER: u32 = 1 << 28;
    const FULL_ACCESS: u32 = 0b011 << 24;
    const NORMAL_NOT_CACHED: u32 = 0b001 << 19;
    const SHAREABLE: u32 = 1 << 18;
    /// `log2` of the bytes, less 1.
    const SIZE: u32 = 16 << 1;
    const ENABLE: u32 = 1;
    const DEFAULT_MAP_ELSEWHERE: u32 = 1 << 2;
    // SAFETY: no reference to SRAM1 exists yet, and the rest keeps the default map.
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
