//! Time since start that never goes back, and waits by it.
//!
//! The 16-bit time driver of embassy-stm32 0.6 can read half a period of its counter, 65.5 ms, too
//! late and then right again (embassy issue 4883), and an `Instant` that is earlier than the one
//! before makes `elapsed` panic. Here a reading that went back counts as no time passed. A wait can
//! so be 65.5 ms shorter or longer than asked. A driver with 32 bits is in embassy, but in no
//! release yet.

use core::cell::Cell;

use cortex_m::asm::wfi;
use critical_section::Mutex;
use embassy_time::{Duration, Instant};

/// The latest time that was read.
static LATEST: Mutex<Cell<Instant>> = Mutex::new(Cell::new(Instant::MIN));

/// Returns the time since start, no earlier than any that was returned before.
pub fn now() -> Instant {
    let read = Instant::now();
    critical_section::with(|token| {
        let latest = LATEST.borrow(token);
        latest.set(latest.get().max(read));
        latest.get()
    })
}

/// Returns the time that has passed since `begun`; zero if that is still to come.
pub fn since(begun: Instant) -> Duration {
    now().saturating_duration_since(begun)
}

/// Waits until `has_happened` returns true, for at most `longest`. Returns whether it did.
///
/// The core sleeps in between: what happens must come with an interrupt. That of the time driver,
/// every 33 ms, ends the wait.
pub fn wait_for(longest: Duration, mut has_happened: impl FnMut() -> bool) -> bool {
    let begun = now();
    while since(begun) < longest {
        // An interrupt that comes before the core sleeps still wakes it, and is served after.
        let happened = critical_section::with(|_| {
            let happened = has_happened();
            if !happened {
                wfi();
            }
            happened
        });
        if happened {
            return true;
        }
    }
    false
}
