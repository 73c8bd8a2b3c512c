//! The UART of Arm's Cortex-M System Design Kit (CMSDK), which the boards of Arm have as port to the host.

use crate::serial::Uart;

/// A port of the kit.
#[derive(Debug)]
pub struct CmsdkUart(*mut Registers);

#[repr(C)]
struct Registers {
    data: u32,
    state: u32,
    control: u32,
    interrupts: u32,
    baud_divider: u32,
}

// Bits of the state: the one byte of room to send is taken, or that to receive.
const IS_FULL: u32 = 1 << 0;
const RECEIVED: u32 = 1 << 1;
/// Bits of the control register: transmitter and receiver are enabled.
const ENABLED: u32 = 1 << 0 | 1 << 1;

impl CmsdkUart {
    /// Enables the port whose registers are at this address. The emulator takes bytes at any rate.
    ///
    /// # Safety
    /// The registers of a port of the kit are there, and nothing else uses them.
    #[must_use]
    pub unsafe fn start(address: usize) -> Self {
        let registers: *mut Registers = core::ptr::with_exposed_provenance_mut(address);
        // SAFETY: as the caller promises.
        unsafe {
            // The smallest divider that the port takes.
            (&raw mut (*registers).baud_divider).write_volatile(16);
            (&raw mut (*registers).control).write_volatile(ENABLED);
        }
        Self(registers)
    }

    fn has(&self, state: u32) -> bool {
        // SAFETY: this register may be read at any time.
        unsafe { (&raw const (*self.0).state).read_volatile() & state != 0 }
    }
}

impl Uart for CmsdkUart {
    fn put(&mut self, byte: u8) -> bool {
        let has_room = !self.has(IS_FULL);
        if has_room {
            // SAFETY: the port is enabled, and its own.
            unsafe { (&raw mut (*self.0).data).write_volatile(byte.into()) };
        }
        has_room
    }

    fn take(&mut self) -> Option<u8> {
        // SAFETY: the port is enabled, and its own.
        self.has(RECEIVED)
            .then(|| unsafe { (&raw const (*self.0).data).read_volatile() } as u8)
    }
}
