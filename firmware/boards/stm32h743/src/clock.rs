//! Time since start that never goes back.
//!
//! The 16-bit time driver of embassy-stm32 0.6 can read half a period of its counter, 65.5 ms, too
//! late and then right again (embassy issue 4883), and an `Instant` that is earlier than the one
//! before makes `elapsed` panic. Here a reading that went back counts as no time passed. A wait can
//! so be 65.5 ms shorter or longer than asked. A driver with 32 bits is in embassy, but in no
//! release yet.

use core::cell::Cell;

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
