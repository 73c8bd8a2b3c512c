//! Time, cycles, and the watchdog.

use embedded_hal::delay::DelayNs;
use vgstereo_emulated::meter::Counter;
use vgstereo_firmware::Watchdog;

use crate::registers::{TIME_HIGH_US, TIME_LOW_US, WATCHDOG_RESETS, WATCHDOG_US};

/// Cycles of a microsecond, as `rtl/soc.sv` has them.
pub(crate) const CLOCK_MHZ: u32 = 48;

/// Time since the reset of the board, µs.
pub(crate) fn now_us() -> u64 {
    // The high word is that of the last read of the low one.
    let low = TIME_LOW_US.read();
    u64::from(TIME_HIGH_US.read()) << 32 | u64::from(low)
}

/// The low word of the time, for spans.
pub(crate) fn span_us() -> u32 {
    TIME_LOW_US.read()
}

/// Waits by the timer.
pub(crate) struct Delay;

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        self.delay_us(ns.div_ceil(1000));
    }

    fn delay_us(&mut self, us: u32) {
        let begun_us = span_us();
        // The microsecond that is now has begun before.
        while span_us().wrapping_sub(begun_us) <= us {}
    }
}

/// The processor's counter of cycles.
#[derive(Clone, Copy)]
pub(crate) struct Cycles;

impl Counter for Cycles {
    // What is counted here are cycles.
    const INSTRUCTIONS_PER_64_TICKS: u32 = 64;

    #[inline(always)]
    fn ticks(self) -> u32 {
        riscv::register::mcycle::read() as u32
    }
}

/// Time-out of the watchdog, µs: longer than six faults in a row take, each with the longest wait for a pair and a frame of
/// the sensors.
const TIME_OUT_US: u32 = 1_000_000;

/// The watchdog of the timer.
pub(crate) struct Timer(());

impl Timer {
    /// Number of times that the watchdog has restarted the board since that has its power, or was reset.
    pub(crate) fn restarts() -> u32 {
        WATCHDOG_RESETS.read()
    }

    /// Starts the watchdog. Nothing stops it but a reset.
    pub(crate) fn start() -> Self {
        feed();
        Self(())
    }
}

/// Feeds the watchdog, which runs from now on.
pub(crate) fn feed() {
    WATCHDOG_US.write(TIME_OUT_US);
}

impl Watchdog for Timer {
    fn feed(&mut self) {
        feed();
    }
}
