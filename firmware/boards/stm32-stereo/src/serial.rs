//! The serial port as the port to the host.

use core::task::Poll;

use embassy_futures::poll_once;
use embassy_stm32::usart::BufferedUart;
use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use vgstereo_firmware::live::LinkPort;

/// A serial port whose bytes leave and come by interrupts. Bytes that come while its receive buffer is
/// full are lost, by which the host's command is, too.
pub struct SerialPort(BufferedUart<'static>);

impl SerialPort {
    /// A port over this one.
    #[must_use]
    pub const fn new(uart: BufferedUart<'static>) -> Self {
        Self(uart)
    }

    /// Waits until all bytes have left, but no longer than `longest`.
    pub fn drain(&mut self, longest: Duration) {
        let begun = Instant::now();
        while poll_once(self.0.flush()).is_pending() && begun.elapsed() < longest {}
    }
}

impl LinkPort for SerialPort {
    fn send(&mut self, bytes: &[u8]) -> usize {
        match poll_once(self.0.write(bytes)) {
            Poll::Ready(Ok(taken)) => taken,
            Poll::Ready(Err(_)) | Poll::Pending => 0,
        }
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        // After an error of the line, the next look goes on with what has come since.
        match poll_once(self.0.read(bytes)) {
            Poll::Ready(Ok(received)) => received,
            Poll::Ready(Err(_)) | Poll::Pending => 0,
        }
    }
}
