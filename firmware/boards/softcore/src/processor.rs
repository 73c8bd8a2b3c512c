//! Set-up of the processor before it runs kernels: VexRiscv or CV32E40P, by the feature of the crate.

#[cfg(feature = "cv32e40p")]
pub(crate) use cv32e40p::start;
#[cfg(feature = "vexriscv")]
pub(crate) use vexriscv::start;

#[cfg(feature = "vexriscv")]
mod vexriscv {
    /// Makes the instructions of `rtl/vexriscv/byte_instructions.sv` legal, which the kernels use.
    pub(crate) fn start() {
        // SAFETY: besides, the register is the mask of external interrupts, of which there are none.
        unsafe { core::arch::asm!("csrw 0xbc0, {}", in(reg) 1_u32 << 31) };
    }
}

#[cfg(feature = "cv32e40p")]
mod cv32e40p {
    // The processor takes the address of its handler of exceptions for a multiple of 256, as the runtime's is not.
    core::arch::global_asm!(
        ".pushsection .trap.vector, \"ax\"",
        ".balign 256",
        ".global aligned_trap",
        "aligned_trap:",
        "j _start_trap",
        ".popsection",
    );

    /// Starts the counter of cycles, and sets the handler of exceptions.
    pub(crate) fn start() {
        // SAFETY: the registers are the mask of counters that stand, and the address of the handler, which goes on to that of
        // the runtime.
        unsafe {
            core::arch::asm!(
                "csrw mcountinhibit, zero",
                "la {handler}, aligned_trap",
                "csrw mtvec, {handler}",
                handler = out(reg) _,
            );
        }
    }
}
