//! The chip's independent watchdog, which has a clock of its own.

use embassy_stm32::Peri;
use embassy_stm32::pac::iwdg::{self, vals::Key};
use embassy_stm32::wdg::{IndependentWatchdog, Instance};
use vgstereo_firmware::Watchdog;

/// The watchdog, which runs. Each copy feeds the same.
#[derive(Clone, Copy)]
pub struct Iwdg(iwdg::Iwdg);

impl Iwdg {
    /// Starts the watchdog, whose registers are `registers`, with this time-out. It cannot be
    /// stopped.
    pub fn start<T: Instance>(
        peripheral: Peri<'static, T>,
        registers: iwdg::Iwdg,
        timeout_us: u32,
    ) -> Self {
        IndependentWatchdog::new(peripheral, timeout_us).unleash();
        Self(registers)
    }
}

impl Watchdog for Iwdg {
    fn feed(&mut self) {
        self.0.kr().write(|key| key.set_key(Key::RESET));
    }
}
