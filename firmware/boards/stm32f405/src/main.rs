//! Firmware for the STM32F405, a Cortex-M4F with 128 KB of SRAM, emulated as `netduinoplus2`.
#![no_std]
#![no_main]

mod usart;

// Linked for its critical sections, which the log needs.
use cortex_m as _;
use cortex_m_rt::entry;
use static_cell::ConstStaticCell;
// Linked for the part's table of vectors.
use stm32_metapac as _;
use usart::Usart1;
use vgstereo_emulated::board::Board;
use vgstereo_emulated::meter::Counter;
use vgstereo_emulated::serve;
use vgstereo_emulated::stack::Stack;
use vgstereo_kernels::Armv7em;

/// Memory lent to session and matcher: 108 of 128 KB; the rest is mostly stack.
#[unsafe(export_name = "lent_memory")]
static MEMORY: ConstStaticCell<[u32; 108 * 1024 / 4]> = ConstStaticCell::new([0; 108 * 1024 / 4]);

/// TIM2, which has 32 bits. The emulator takes 1 ns per instruction, and the timer ticks every
/// nanosecond.
#[derive(Clone, Copy)]
struct Timer2;

impl Timer2 {
    const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    const EVENT: *mut u32 = 0x4000_0014 as *mut u32;
    const COUNT: *mut u32 = 0x4000_0024 as *mut u32;
    const PRESCALER: *mut u32 = 0x4000_0028 as *mut u32;
    const AUTO_RELOAD: *mut u32 = 0x4000_002c as *mut u32;

    fn start() -> Self {
        // SAFETY: these are registers of a timer that nothing else uses.
        unsafe {
            Self::PRESCALER.write_volatile(0);
            Self::AUTO_RELOAD.write_volatile(u32::MAX);
            // An update event loads prescaler and reload value; then the timer starts.
            Self::EVENT.write_volatile(1);
            Self::CONTROL.write_volatile(1);
        }
        Self
    }
}

impl Counter for Timer2 {
    const INSTRUCTIONS_PER_64_TICKS: u32 = 64;

    #[inline(always)]
    fn ticks(self) -> u32 {
        // SAFETY: this register may be read at any time.
        unsafe { Self::COUNT.read_volatile() }
    }
}

#[entry]
fn main() -> ! {
    // SAFETY: there is no heap, and no interrupt is enabled.
    let stack = unsafe { Stack::paint_main() };
    serve(Board {
        name: env!("CARGO_PKG_NAME"),
        counter: Timer2::start(),
        uart: Usart1::start(),
        kernels: Armv7em,
        memory: MEMORY.take(),
        stack,
    })
}
