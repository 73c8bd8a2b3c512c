//! Set-up of the chip's memories, placed as in `memory.x`, and of its caches.

use cortex_m::asm::{dsb, isb};
use cortex_m::peripheral::{MPU, Peripherals};
use embassy_stm32::pac::RCC;
use grounded::uninit::GroundedArrayCell;
use stm32_stereo::calibration::{self, RECTIFIER_BYTES, SLOT_BYTES};

use crate::{CONFIG, RIG};

/// Words of both raw lines.
const RAW_LINES_WORDS: usize = 2 * RIG.raw_words();

#[unsafe(export_name = "lent_memory")]
#[unsafe(link_section = ".axisram")]
static MATCHER: GroundedArrayCell<u32, { CONFIG.memory_words() }> = GroundedArrayCell::uninit();
#[unsafe(link_section = ".axisram")]
static RECTIFIER: GroundedArrayCell<u32, { RECTIFIER_BYTES / 4 }> = GroundedArrayCell::uninit();
/// The calibration in use, and one on its way from the host.
#[unsafe(link_section = ".axisram")]
static CALIBRATIONS: [GroundedArrayCell<u8, SLOT_BYTES>; 2] =
    [const { GroundedArrayCell::uninit() }; 2];
#[unsafe(link_section = ".sram1")]
static RAW_LINES: GroundedArrayCell<u32, RAW_LINES_WORDS> = GroundedArrayCell::uninit();

/// The memories that are handed out.
pub struct Memories {
    pub matcher: &'static mut [u32],
    pub rectifier: &'static mut [u32],
    pub calibrations: [&'static mut [u8]; 2],
    /// Not cached.
    pub raw_lines: &'static mut [u32],
}

/// Enables the caches and returns the memories.
///
/// # Panics
/// If it is called more than once.
pub fn take() -> Memories {
    let mut core = defmt::unwrap!(Peripherals::take());
    // SRAM1 is off after a reset, and an access without its clock would be a bus fault.
    RCC.ahb2enr().modify(|enable| enable.set_sram1en(true));
    protect(&mut core.MPU);
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    // SAFETY: there is no other reference, because the core's peripherals can be taken only once.
    unsafe {
        Memories {
            matcher: initialised(MATCHER.get_ptr_len()),
            rectifier: initialised(RECTIFIER.get_ptr_len()),
            calibrations: CALIBRATIONS
                .each_ref()
                .map(|cell| initialised(cell.get_ptr_len())),
            raw_lines: initialised(RAW_LINES.get_ptr_len()),
        }
    }
}

/// Clears `count` numbers from `start` on and returns them as a slice.
///
/// # Safety
/// They are writable, may be 0, and there is no other reference to them.
unsafe fn initialised<T>((start, count): (*mut T, usize)) -> &'static mut [T] {
    // SAFETY: the caller promises it, and all are written before the slice exists.
    unsafe {
        start.write_bytes(0, count);
        core::slice::from_raw_parts_mut(start, count)
    }
}

/// Sets up the protection of memory:
///
/// - Flash is read and executed, never written; the RAMs that are used are not executed.
/// - The calibration slot is written and not executed, and read past the cache, which does not see it
///   change.
/// - All 128 KB of SRAM1 are not cached either, so that the core reads what DMA1 has written.
/// - Of the DTCM nobody may touch the 4 KB above the statics. A stack that grows too deep faults
///   there, and the watchdog restarts the board, before it overwrites statics.
fn protect(mpu: &mut MPU) {
    const FLASH: u32 = 0x0800_0000;
    const DTCM: u32 = 0x2000_0000;
    const AXI_SRAM: u32 = 0x2400_0000;
    const SRAM1: u32 = 0x3000_0000;
    const EXECUTE_NEVER: u32 = 1 << 28;
    const FULL_ACCESS: u32 = 0b011 << 24;
    const READ_ONLY: u32 = 0b110 << 24;
    const NO_ACCESS: u32 = 0;
    // Flash and RAM are cached as the default map has it.
    const WRITTEN_THROUGH: u32 = 0b000_010 << 16;
    const WRITTEN_BACK: u32 = 0b001_011 << 16;
    const NOT_CACHED: u32 = 0b001_000 << 16;
    const SHAREABLE: u32 = 1 << 18;
    const REGION_ENABLE: u32 = 1;
    /// Size field of a region: the binary logarithm of its bytes, less 1.
    const fn size(bytes: u32) -> u32 {
        (bytes.ilog2() - 1) << 1
    }
    const RAM: u32 = EXECUTE_NEVER | FULL_ACCESS;
    const GUARD_BYTES: u32 = 4096;
    const ENABLE: u32 = 1;
    const DEFAULT_MAP_ELSEWHERE: u32 = 1 << 2;
    unsafe extern "C" {
        /// The end of the statics, from `link.x`.
        static __sheap: u32;
    }
    let statics_end = (&raw const __sheap).addr() as u32;
    let slot_start = calibration::slot().as_ptr().addr() as u32;
    // Where regions overlap, the last one holds.
    let regions = [
        (FLASH, READ_ONLY | WRITTEN_THROUGH | size(2 << 20)),
        (slot_start, RAM | NOT_CACHED | size(SLOT_BYTES as u32)),
        (DTCM, RAM | WRITTEN_BACK | size(128 << 10)),
        (AXI_SRAM, RAM | WRITTEN_BACK | size(512 << 10)),
        (SRAM1, RAM | NOT_CACHED | SHAREABLE | size(128 << 10)),
        (
            statics_end.next_multiple_of(GUARD_BYTES),
            EXECUTE_NEVER | NO_ACCESS | NOT_CACHED | size(GUARD_BYTES),
        ),
    ];
    // SAFETY: code is in flash and read only, there is no reference to SRAM1 yet, the stack is far
    // above the guard, and the default map stays for all other memory.
    unsafe {
        for (number, (base, attributes)) in (0..).zip(regions) {
            mpu.rnr.write(number);
            mpu.rbar.write(base);
            mpu.rasr.write(attributes | REGION_ENABLE);
        }
        mpu.ctrl.write(DEFAULT_MAP_ELSEWHERE | ENABLE);
    }
    dsb();
    isb();
}
