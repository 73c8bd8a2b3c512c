//! The port to the host.

/// A port to the host that never waits: a serial port, USB, a socket. embedded-io has no trait for
/// this that drivers of serial ports implement: few say whether they would wait.
pub trait LinkPort {
    /// Takes as many of these bytes as it has room for now, from the first on, and returns how many.
    fn send(&mut self, bytes: &[u8]) -> usize;

    /// Writes bytes that have come to the front of `bytes`, and returns how many; 0 if none has come.
    fn receive(&mut self, bytes: &mut [u8]) -> usize;
}

impl<T: LinkPort + ?Sized> LinkPort for &mut T {
    fn send(&mut self, bytes: &[u8]) -> usize {
        (**self).send(bytes)
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        (**self).receive(bytes)
    }
}
