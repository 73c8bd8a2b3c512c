//! The lesser of two numbers, with Zbb by its instruction, and otherwise by a branch over the one that moves a
//! register. The compiler would copy a register before and jump back from elsewhere.

/// Returns the lesser number. It takes the fewest instructions where `a` is not used any more, and is mostly the
/// lesser one.
#[inline(always)]
#[must_use]
pub(super) fn least(a: u32, b: u32) -> u32 {
    #[cfg(all(target_arch = "riscv32", not(target_feature = "zbb")))]
    {
        let mut least = a;
        // SAFETY: the instructions work on registers alone, and the branch ends behind them.
        unsafe {
            core::arch::asm!(
                "bgeu {b}, {least}, 2f",
                "mv {least}, {b}",
                "2:",
                least = inout(reg) least, b = in(reg) b,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        least
    }
    #[cfg(not(all(target_arch = "riscv32", not(target_feature = "zbb"))))]
    {
        a.min(b)
    }
}
