//! The serial port.

use vgstereo_emulated::serial::Uart;

use crate::registers::{UART_DATA, UART_STATUS};

/// The port, which nothing else uses.
pub(crate) struct SerialPort(());

impl SerialPort {
    // Bits of the status.
    const HAS_ROOM: u32 = 1 << 0;
    const RECEIVED: u32 = 1 << 2;

    /// The port, of which there is one.
    pub(crate) fn new() -> Self {
        Self(())
    }
}

impl Uart for SerialPort {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = UART_STATUS.read() & Self::HAS_ROOM != 0;
        if has_room {
            UART_DATA.write(byte.into());
        }
        has_room
    }

    fn take(&mut self) -> Option<u8> {
        (UART_STATUS.read() & Self::RECEIVED != 0).then(|| UART_DATA.read() as u8)
    }
}
