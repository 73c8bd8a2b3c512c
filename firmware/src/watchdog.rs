//! Watchdogs: hardware timers that reset the board unless they are fed in time.

/// A running watchdog. embedded-hal had this trait until version 1.0.
///
/// [`Session`](crate::Session) feeds it once for each pair of lines that was matched and whose
/// disparities the sink has taken, until 16 frames in a row
/// ([`PATIENCE_FRAMES`](crate::session::PATIENCE_FRAMES)) have begun and none has come whole; from
/// then on once for each whole frame. It does not feed it while it waits for the camera, after an
/// error, or for pairs that it leaves out. So a camera or a sink that is dead resets the board, and
/// so does one that breaks every frame.
///
/// # For boards
///
/// With `frame`, the time from the start of a frame to that of the next, and `wait`, the longest
/// time for which the camera's driver waits before it reports an error, choose
///
/// ```text
/// time-out > faults x (wait + frame) + frame
/// ```
///
/// for the number of `faults` in a row, without a line matched between them, that must not reset
/// the board: at least 1. After a fault the next pair that is matched is line 0 of the next whole
/// frame: the sum is the wait for the line that does not come, the rest of its frame, and the time
/// until that line 0 is matched. A frame may take longer than the time-out.
///
/// A camera that gives lines and never a whole frame resets the board after at most
/// `16 x (wait + frame) + time-out`.
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
