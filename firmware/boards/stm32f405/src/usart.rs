//! USART1, the port to the host. The emulator needs neither its clock nor its pins.

use vgstereo_emulated::serial::Uart;

/// The port, which nothing else uses.
pub(crate) struct Usart1(());

impl Usart1 {
    const STATUS: *mut u32 = 0x4001_1000 as *mut u32;
    const DATA: *mut u32 = 0x4001_1004 as *mut u32;
    const BAUD_RATE: *mut u32 = 0x4001_1008 as *mut u32;
    const CONTROL_1: *mut u32 = 0x4001_100c as *mut u32;

    // Bits of the status.
    const RECEIVED: u32 = 1 << 5;
    const HAS_ROOM: u32 = 1 << 7;
    /// Bits of the control register: the port, its transmitter and its receiver are enabled.
    const ENABLED: u32 = 1 << 13 | 1 << 3 | 1 << 2;

    /// Enables the port. The emulator takes bytes at any rate.
    pub(crate) fn start() -> Self {
        // SAFETY: these are registers of a port that nothing else uses.
        unsafe {
            Self::BAUD_RATE.write_volatile(16);
            Self::CONTROL_1.write_volatile(Self::ENABLED);
        }
        Self(())
    }

    fn has(status: u32) -> bool {
        // SAFETY: this register may be read at any time.
        unsafe { Self::STATUS.read_volatile() & status != 0 }
    }
}

impl Uart for Usart1 {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = Self::has(Self::HAS_ROOM);
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
