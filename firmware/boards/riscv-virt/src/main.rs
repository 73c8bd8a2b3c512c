//! Firmware for RV32IMAC, as of a soft core, emulated as `virt`.
#![no_std]
#![no_main]

mod uart;

use riscv::register::minstret;
use riscv_rt::entry;
use static_cell::ConstStaticCell;
use uart::Ns16550a;
use vgstereo_emulated::board::Board;
use vgstereo_emulated::meter::Counter;
use vgstereo_emulated::serve;
use vgstereo_emulated::stack::Stack;
use vgstereo_kernels::Rv32;

/// Memory lent to session and matcher: 384 KB of 1 MB.
#[unsafe(export_name = "lent_memory")]
static MEMORY: ConstStaticCell<[u32; 384 * 1024 / 4]> = ConstStaticCell::new([0; 384 * 1024 / 4]);

/// The processor's counter of retired instructions.
#[derive(Clone, Copy)]
struct Retired;

impl Counter for Retired {
    const INSTRUCTIONS_PER_64_TICKS: u32 = 64;

    #[inline(always)]
    fn ticks(self) -> u32 {
        minstret::read() as u32
    }
}

#[entry]
fn main() -> ! {
    // SAFETY: it runs on the main stack, there is no heap, and no interrupt is enabled.
    let stack = unsafe { Stack::paint_main() };
    serve(Board {
        name: env!("CARGO_PKG_NAME"),
        counter: Retired,
        uart: Ns16550a::start(),
        kernels: Rv32,
        memory: MEMORY.take(),
        stack,
    })
}
