//! Firmware for the Arm MPS2 with image AN500, a Cortex-M7, emulated as `mps2-an500`.
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
use vgstereo_kernels::Armv7em;

unsafe extern "C" {
    fn DefaultHandler();
}

/// The rest of the table of vectors: the part's 32 interrupts, none of which is enabled.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(export_name = "__INTERRUPTS")]
static INTERRUPTS: [unsafe extern "C" fn(); 32] = [DefaultHandler; 32];

/// Memory lent to session and matcher: 384 KB of 1 MB.
#[unsafe(export_name = "lent_memory")]
static MEMORY: ConstStaticCell<[u32; 384 * 1024 / 4]> = ConstStaticCell::new([0; 384 * 1024 / 4]);

/// CMSDK timer 0, which counts down. At 25 MHz it ticks every 40 ns, and the emulator takes 64 ns
/// per instruction.
#[derive(Clone, Copy)]
struct Timer0;

impl Timer0 {
    const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    const VALUE: *mut u32 = 0x4000_0004 as *mut u32;
    const RELOAD: *mut u32 = 0x4000_0008 as *mut u32;

    fn start() -> Self {
        // SAFETY: these are registers of a timer that nothing else uses.
        unsafe {
            Self::RELOAD.write_volatile(u32::MAX);
            Self::VALUE.write_volatile(u32::MAX);
            Self::CONTROL.write_volatile(1);
        }
        Self
    }
}

impl Counter for Timer0 {
    const INSTRUCTIONS_PER_64_TICKS: u32 = 40;

    #[inline(always)]
    fn ticks(self) -> u32 {
        // SAFETY: this register may be read at any time.
        !unsafe { Self::VALUE.read_volatile() }
    }
}

#[entry]
fn main() -> ! {
    // SAFETY: there is no heap, and no interrupt is enabled.
    let stack = unsafe { Stack::paint_main() };
    serve(Board {
        name: env!("CARGO_PKG_NAME"),
        counter: Timer0::start(),
        // SAFETY: this is UART 0, which nothing else uses.
        uart: unsafe { CmsdkUart::start(0x4000_4000) },
        kernels: Armv7em,
        memory: MEMORY.take(),
        stack,
    })
}
