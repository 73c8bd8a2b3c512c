//! The independent watchdog, RM0433 chapter 45: its counter runs on 32 kHz of its own.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32h743::generated::iwdg::Register;
use rigless::time::{EventId, VirtualNanos};

const START: u64 = 0xcccc;
const RELOAD: u64 = 0xaaaa;
const CLOCK_HZ: u64 = 32_000;

/// The watchdog, stopped until the board starts it.
#[derive(Debug, Default)]
pub struct Iwdg {
    is_running: bool,
    /// The end of the time-out since it was fed last.
    end: Option<EventId>,
    last_ns: u64,
    /// How often it was fed, and the longest time between two meals, ns.
    pub meals: u32,
    pub longest_ns: u64,
}

impl Device for Iwdg {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register != Register::Kr || !matches!(value, START | RELOAD) {
            return;
        }
        let now = context.now().0;
        if self.is_running {
            self.longest_ns = self.longest_ns.max(now - self.last_ns);
        }
        self.is_running |= value == START;
        self.last_ns = now;
        self.meals += 1;
        if self.is_running {
            let prescaler = 4 << registers.get(Register::Pr).min(6);
            let counts = registers.get(Register::Rlr) + 1;
            let timeout_ns = counts * prescaler * 1_000_000_000 / CLOCK_HZ;
            self.end = Some(context.schedule(VirtualNanos(now + timeout_ns)));
        }
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.end == Some(event) {
            context.request_reset();
        }
    }

    fn reset(&mut self) {
        self.is_running = false;
        self.end = None;
    }
}
