//! Registers of the peripherals, at the addresses that `rtl/soc.sv` gives them.

/// A register of 32 bits.
#[derive(Clone, Copy)]
pub(crate) struct Register(usize);

impl Register {
    /// # Safety
    /// The register is there, and reading or writing it does nothing to memory.
    pub(crate) const unsafe fn at(address: usize) -> Self {
        Self(address)
    }

    fn pointer(self) -> *mut u32 {
        core::ptr::with_exposed_provenance_mut(self.0)
    }

    pub(crate) fn read(self) -> u32 {
        // SAFETY: as whoever made it has promised.
        unsafe { self.pointer().read_volatile() }
    }

    pub(crate) fn write(self, value: u32) {
        // SAFETY: as whoever made it has promised.
        unsafe { self.pointer().write_volatile(value) };
    }
}

macro_rules! registers {
    ($($(#[$doc:meta])* $name:ident = $address:literal;)*) => {
        $(
            $(#[$doc])*
            // SAFETY: the address is that of `rtl/soc.sv` and of the peripheral's own file.
            pub(crate) const $name: Register = unsafe { Register::at($address) };
        )*
    };
}

registers! {
    UART_DATA = 0x8000_0000;
    UART_STATUS = 0x8000_0004;
    TIME_LOW_US = 0x8100_0000;
    TIME_HIGH_US = 0x8100_0004;
    WATCHDOG_US = 0x8100_0008;
    WATCHDOG_RESETS = 0x8100_000c;
    CAMERA_STATUS = 0x8200_0000;
    CAMERA_PLACE = 0x8200_0004;
    CAMERA_PIXELS = 0x8200_0008;
    CAMERA_ENDED = 0x8200_000c;
    CAMERA_CONTROL = 0x8200_0014;
    CAMERA_LEVEL = 0x8200_0018;
    CAMERA_LIMIT = 0x8200_001c;
    CAMERA_ROOM = 0x8200_0028;
    CAMERA_CYCLES = 0x8200_002c;
    LEDS = 0x8300_0000;
    I2C_BYTE = 0x8500_0000;
    SENSORS_RESET = 0x8500_0004;
}

/// The bytes of a view's line: its first word.
#[derive(Clone, Copy)]
#[repr(usize)]
pub(crate) enum LineBytes {
    Left = 0x8200_4000,
    Right = 0x8200_6000,
}

impl LineBytes {
    /// Copies the line, whose length is that of `bytes` and at most that of the port's lines.
    #[inline(always)]
    pub(crate) fn copy(self, bytes: &mut [u8]) {
        let mut at: *const u32 = core::ptr::with_exposed_provenance(self as usize);
        let (words, rest) = bytes.as_chunks_mut();
        let mut next = || {
            // SAFETY: the port has a register for each word of a line; what is beyond reads as others.
            let word = unsafe { at.read_volatile() };
            at = at.wrapping_add(1);
            word.to_le_bytes()
        };
        words.fill_with(&mut next);
        if !rest.is_empty() {
            rest.iter_mut()
                .zip(next())
                .for_each(|(to, byte)| *to = byte);
        }
    }
}
