//! Watchdogs: hardware timers that reset the board unless they are fed in time.

/// A running watchdog. embedded-hal had this trait until version 1.0.
///
/// [`Session`](crate::Session) feeds it once for each pair of lines that was matched and whose
/// disparities the sink has taken. It does not feed it while it waits for the camera, after an
/// error, or for pairs that it leaves out. So a dead camera or sink resets the board.
///
/// # For boards
///
/// After a fault, the next pair that is matched is line 0 of the next whole frame. The watchdog's
/// time-out must be longer than the time until then, including the camera's own time-outs.
pub trait Watchdog {
    /// Restarts the watchdog's time-out.
    fn feed(&mut self);
}

impl<T: Watchdog + ?Sized> Watchdog for &mut T {
    fn feed(&mut self) {
        (**self).feed();
    }
}

/// Stand-in for boards without a watchdog.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoWatchdog;

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}
