//! Measurement of the largest stack use: the free stack is painted, and what has lost its paint was
//! in use.

/// Pattern with which the free stack is painted.
const PAINT: u32 = 0xa5a5_5a5a;

/// Bytes below a local variable of the painting function that are left unpainted, because its own
/// frame may extend there.
const OWN_BYTES: usize = 256;

/// A stack that grows down from `top` to `bottom`.
#[derive(Debug, Clone, Copy)]
pub struct Stack {
    bottom: *mut u32,
    top: *mut u32,
}

impl Stack {
    /// Paints the free part of the stack.
    ///
    /// # Safety
    /// The memory from `bottom`, aligned to 4 bytes, to `top` is the stack on which the caller
    /// runs. Nothing else is stored there, and no interrupt uses it during the call.
    #[must_use]
    pub unsafe fn paint(bottom: *mut u32, top: *mut u32) -> Self {
        let here = 0_u32;
        let end = (&raw const here).addr().saturating_sub(OWN_BYTES);
        let mut at = bottom;
        while at.addr() < end {
            // SAFETY: the address is between the bottom and the used part of the stack.
            unsafe { at.write_volatile(PAINT) };
            at = at.wrapping_add(1);
        }
        Self { bottom, top }
    }

    /// Paints the free part of the main stack, whose bounds cortex-m-rt or riscv-rt defines.
    ///
    /// # Safety
    /// The caller runs on that stack, nothing else is stored there, and no interrupt uses it during the call.
    #[must_use]
    #[inline(always)]
    pub unsafe fn paint_main() -> Self {
        unsafe extern "C" {
            #[cfg_attr(target_arch = "riscv32", link_name = "__estack")]
            static mut _stack_end: u32;
            static mut _stack_start: u32;
        }
        // SAFETY: the linker defines the bounds; the rest, the caller promises.
        unsafe { Self::paint(&raw mut _stack_end, &raw mut _stack_start) }
    }

    /// Largest number of bytes in use at any time since the stack was painted.
    #[must_use]
    pub fn worst_bytes(&self) -> usize {
        let mut at = self.bottom;
        // SAFETY: the address is within the stack, as the caller of `paint` promised.
        while at < self.top && unsafe { at.read_volatile() } == PAINT {
            at = at.wrapping_add(1);
        }
        self.top.addr() - at.addr()
    }
}
