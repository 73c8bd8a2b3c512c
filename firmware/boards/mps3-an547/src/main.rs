//! Firmware for the Arm MPS3 with image AN547, a Cortex-M55, emulated as `mps3-an547`.
#![no_std]
#![no_main]

// Linked for its critical sections, which the log needs.
use cortex_m as _;
use cortex_m_rt::entry;
use static_cell::ConstStaticCell;
use vgstereo_emulated::board::Board;
use vgstereo_emulated::cmsdk::CmsdkUart;
use vgstereo_emulated::meter::Counter;
use vgstereo_emulated::serve;
use vgstereo_emulated::stack::Stack;
use vgstereo_kernels::Helium;

/// Memory lent to session and matcher: 768 KB of 1 MB.
#[unsafe(export_name = "lent_memory")]
static MEMORY: ConstStaticCell<[u32; 768 * 1024 / 4]> = ConstStaticCell::new([0; 768 * 1024 / 4]);

/// The system counter of the subsystem, of 64 bits. At 32 MHz it ticks every 31.25 ns, and the
/// emulator takes 16 ns per instruction. SysTick has the same clock and 24 bits, too few for a line
/// of a large preset.
#[derive(Clone, Copy)]
struct SystemCounter;

impl SystemCounter {
    const CONTROL: *mut u32 = 0x5810_0000 as *mut u32;
    const VALUE_LOW: *mut u32 = 0x5810_0008 as *mut u32;

    fn start() -> Self {
        // SAFETY: this is a register of a counter that nothing else uses.
        unsafe { Self::CONTROL.write_volatile(1) };
        Self
    }
}

impl Counter for SystemCounter {
    const INSTRUCTIONS_PER_64_TICKS: u32 = 125;

    #[inline(always)]
    fn ticks(self) -> u32 {
        // SAFETY: this register may be read at any time.
        unsafe { Self::VALUE_LOW.read_volatile() }
    }
}

#[entry]
fn main() -> ! {
    // SAFETY: there is no heap, and no interrupt is enabled.
    let stack = unsafe { Stack::paint_main() };
    serve(Board {
        name: env!("CARGO_PKG_NAME"),
        counter: SystemCounter::start(),
        // SAFETY: this is UART 0, which nothing else uses.
        uart: unsafe { CmsdkUart::start(0x5930_3000) },
        kernels: Helium,
        memory: MEMORY.take(),
        stack,
    })
}
