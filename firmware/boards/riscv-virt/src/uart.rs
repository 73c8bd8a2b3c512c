//! The NS16550A, the port to the host.

use vgstereo_emulated::serial::Uart;

/// The port, which nothing else uses.
pub(crate) struct Ns16550a(());

impl Ns16550a {
    const DATA: *mut u8 = 0x1000_0000 as *mut u8;
    const FIFO_CONTROL: *mut u8 = 0x1000_0002 as *mut u8;
    const LINE_CONTROL: *mut u8 = 0x1000_0003 as *mut u8;
    const LINE_STATUS: *mut u8 = 0x1000_0005 as *mut u8;

    // Bits of the line's status.
    const RECEIVED: u8 = 1 << 0;
    const HAS_ROOM: u8 = 1 << 5;
    /// Setting of the FIFOs: on, and emptied.
    const FIFOS: u8 = 1 << 0 | 1 << 1 | 1 << 2;
    /// Setting of the line: eight bits, no parity.
    const EIGHT_BITS: u8 = 0b11;

    /// Sets the port up. The emulator takes bytes at any rate.
    pub(crate) fn start() -> Self {
        // SAFETY: these are registers of a port that nothing else uses.
        unsafe {
            Self::LINE_CONTROL.write_volatile(Self::EIGHT_BITS);
            Self::FIFO_CONTROL.write_volatile(Self::FIFOS);
        }
        Self(())
    }

    fn has(status: u8) -> bool {
        // SAFETY: this register may be read at any time.
        unsafe { Self::LINE_STATUS.read_volatile() & status != 0 }
    }
}

impl Uart for Ns16550a {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = Self::has(Self::HAS_ROOM);
        if has_room {
            // SAFETY: the port is set up, and its own.
            unsafe { Self::DATA.write_volatile(byte) };
        }
        has_room
    }

    fn take(&mut self) -> Option<u8> {
        // SAFETY: the port is set up, and its own.
        Self::has(Self::RECEIVED).then(|| unsafe { Self::DATA.read_volatile() })
    }
}
