//! The chip's independent watchdog, which has a clock of its own.

use embassy_stm32::Peri;
use embassy_stm32::pac::iwdg::{
    self,
    vals::{Key, Pr},
};
use embassy_stm32::wdg::{IndependentWatchdog, Instance};
use vgstereo_firmware::Watchdog;

/// Largest reload value.
const RELOAD_MAX: u16 = 0xfff;

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

    /// Runs what takes up to half a minute, with the longest time-out there is: an erase of flash is not
    /// interrupted.
    pub fn stretched<T>(&mut self, run: impl FnOnce() -> T) -> T {
        let (prescaler, reload) = (self.0.pr().read(), self.0.rlr().read());
        self.set(Pr::DIVIDE_BY256, RELOAD_MAX);
        let result = run();
        self.set(prescaler.pr(), reload.rl());
        result
    }

    /// Sets the time-out anew, and feeds the watchdog.
    fn set(&mut self, prescaler: Pr, reload: u16) {
        self.0.kr().write(|key| key.set_key(Key::ENABLE));
        self.0.pr().write(|value| value.set_pr(prescaler));
        self.0.rlr().write(|value| value.set_rl(reload));
        // They take some of its own clock's periods. Should they not come to an end, it bites.
        while self.0.sr().read().0 & 0b11 != 0 {}
        self.feed();
    }
}

impl Watchdog for Iwdg {
    fn feed(&mut self) {
        self.0.kr().write(|key| key.set_key(Key::RESET));
    }
}
