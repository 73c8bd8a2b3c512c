//! Watchdogs: hardware that resets the board unless it is fed in time.

/// A watchdog that runs. embedded-hal had this trait until 1.0.
///
/// [`Session`](crate::Session) feeds it once for each pair of lines that is matched and
/// whose disparities the sink has taken, and at no other time: not while the camera is
/// waited for, not after an error, and not for pairs left out. A camera or a sink that is
/// dead thus resets the board.
///
/// # For boards
///
/// After a fault the next pair that counts is line 0 of the next whole frame. The time until
/// the reset must be longer than that takes, the camera's own time-outs included.
pub trait Watchdog {
    /// Puts the reset off by the watchdog's whole time.
    fn feed(&mut self);
}

impl<T: Watchdog + ?Sized> Watchdog for &mut T {
    fn feed(&mut self) {
        (**self).feed();
    }
}

/// No watchdog.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoWatchdog;

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}
