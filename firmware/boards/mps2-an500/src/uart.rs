//! UART 0 of the CMSDK, the port to the host.

use vgstereo_emulated::serial::Uart;

/// The port, which nothing else uses.
pub(crate) struct Uart0(());

impl Uart0 {
    const DATA: *mut u32 = 0x4000_4000 as *mut u32;
    const STATE: *mut u32 = 0x4000_4004 as *mut u32;
    const CONTROL: *mut u32 = 0x4000_4008 as *mut u32;
    const BAUD_DIVIDER: *mut u32 = 0x4000_4010 as *mut u32;

    // Bits of the state: the one byte of room to send is taken, or that to receive.
    const IS_FULL: u32 = 1 << 0;
    const RECEIVED: u32 = 1 << 1;
    /// Bits of the control register: transmitter and receiver are enabled.
    const ENABLED: u32 = 1 << 0 | 1 << 1;

    /// Enables the port. The emulator takes bytes at any rate.
    pub(crate) fn start() -> Self {
        // SAFETY: these are registers of a port that nothing else uses.
        unsafe {
            // The smallest divider that the port takes.
            Self::BAUD_DIVIDER.write_volatile(16);
            Self::CONTROL.write_volatile(Self::ENABLED);
        }
        Self(())
    }

    fn has(state: u32) -> bool {
        // SAFETY: this register may be read at any time.
        unsafe { Self::STATE.read_volatile() & state != 0 }
    }
}

impl Uart for Uart0 {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = !Self::has(Self::IS_FULL);
        if has_room {
            // SAFETY: the port is enabled, and its own.
            unsafe { Self::DATA.write_volatile(byte.into()) };
        }
        has_room
    }

    fn take(&mut self) -> Option<u8> {
        // SAFETY: the port is enabled, and its own.
        Self::has(Self::RECEIVED).then(|| unsafe { Self::DATA.read_volatile() } as u8)
    }
}
