//! The worst stack, by painting: what is written over was in use.

/// What is not in use is painted with.
const PAINT: u32 = 0xa5a5_5a5a;

/// Bytes below the painting function's caller that are left alone: its own frame.
const OWN_BYTES: usize = 256;

/// A stack that grows down from `top` to `bottom`.
#[derive(Debug, Clone, Copy)]
pub struct Stack {
    bottom: *mut u32,
    top: *mut u32,
}

impl Stack {
    /// Paints what is free of the stack.
    ///
    /// # Safety
    /// From `bottom`, aligned to 4 bytes, to `top` is the stack that the caller runs on,
    /// nothing else lives there, and no interrupt uses it meanwhile.
    #[must_use]
    pub unsafe fn paint(bottom: *mut u32, top: *mut u32) -> Self {
        let here = 0_u32;
        let end = (&raw const here).addr().saturating_sub(OWN_BYTES);
        let mut at = bottom;
        while at.addr() < end {
            // SAFETY: between the bottom and what is in use, as the caller promises.
            unsafe { at.write_volatile(PAINT) };
            at = at.wrapping_add(1);
        }
        Self { bottom, top }
    }

    /// Most bytes in use at a time since it was painted.
    #[must_use]
    pub fn worst_bytes(&self) -> usize {
        let mut at = self.bottom;
        // SAFETY: within the stack, as whoever painted it promised.
        while at < self.top && unsafe { at.read_volatile() } == PAINT {
            at = at.wrapping_add(1);
        }
        self.top.addr() - at.addr()
    }
}
