//! The chip's independent watchdog, which has a clock of its own.

use embassy_stm32::Peri;
use embassy_stm32::pac::{self, iwdg::vals::Key};
use embassy_stm32::peripherals::IWDG1;
use embassy_stm32::wdg::IndependentWatchdog;
use vgstereo_firmware::Watchdog;

/// The watchdog, which runs. Each copy feeds the same.
#[derive(Clone, Copy)]
pub struct Iwdg(());

impl Iwdg {
    /// Starts the watchdog with this time-out. It cannot be stopped.
    pub fn start(peripheral: Peri<'static, IWDG1>, timeout_us: u32) -> Self {
        IndependentWatchdog::new(peripheral, timeout_us).unleash();
        Self(())
    }
}

impl Watchdog for Iwdg {
    fn feed(&mut self) {
        pac::IWDG1.kr().write(|key| key.set_key(Key::RESET));
    }
}
