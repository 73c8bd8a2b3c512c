//! The serial port of an emulated board, as the port to the host.

use vgstereo_firmware::live::LinkPort;

/// How often a port is looked at for what is about to happen. An emulator hands over a byte that has
/// come some time after the one before was taken, in which the board executes instructions.
const LOOKS: u32 = 20_000;

/// The registers of a serial port, which are looked at and never waited for.
pub trait Uart {
    /// Sends a byte, if there is room for it; returns whether there was.
    fn put(&mut self, byte: u8) -> bool;

    /// Takes the byte that has come, if one has.
    fn take(&mut self) -> Option<u8>;
}

/// A serial port without a buffer as a port to the host. It gives the emulator a moment to take or bring
/// the next byte, and none to bring the first.
#[derive(Debug)]
pub struct SerialPort<U>(U);

impl<U: Uart> SerialPort<U> {
    /// A port over these registers.
    #[must_use]
    pub const fn new(uart: U) -> Self {
        Self(uart)
    }
}

impl<U: Uart> LinkPort for SerialPort<U> {
    // Not inlined into each message that is sent.
    #[inline(never)]
    fn send(&mut self, bytes: &[u8]) -> usize {
        let has_room = |byte: &&u8| (0..LOOKS).any(|_| self.0.put(**byte));
        bytes.iter().take_while(has_room).count()
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        let mut count = 0;
        for place in bytes {
            let looks = if count == 0 { 1 } else { LOOKS };
            let Some(byte) = (0..looks).find_map(|_| self.0.take()) else {
                break;
            };
            *place = byte;
            count += 1;
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// A port that needs so many looks before it has room for a byte, or hands one over.
    struct Slow {
        looks: u32,
        looked: u32,
        sent: Vec<u8>,
        coming: Vec<u8>,
    }

    impl Slow {
        fn new(looks: u32, coming: &[u8]) -> Self {
            Self {
                looks,
                looked: 0,
                sent: vec![],
                coming: coming.to_vec(),
            }
        }

        fn is_ready(&mut self) -> bool {
            self.looked += 1;
            let is_ready = self.looked >= self.looks;
            if is_ready {
                self.looked = 0;
            }
            is_ready
        }
    }

    impl Uart for &mut Slow {
        fn put(&mut self, byte: u8) -> bool {
            let is_ready = self.is_ready();
            if is_ready {
                self.sent.push(byte);
            }
            is_ready
        }

        fn take(&mut self) -> Option<u8> {
            let has_come = !self.coming.is_empty() && self.is_ready();
            has_come.then(|| self.coming.remove(0))
        }
    }

    #[test]
    fn bytes_go_in_their_order_and_one_that_was_not_taken_is_not_lost() {
        let mut slow = Slow::new(9, &[]);
        assert_eq!(SerialPort::new(&mut slow).send(&[1, 2, 3]), 3);
        assert_eq!(slow.sent, [1, 2, 3]);
        // A host that takes nothing is not waited for without end.
        let mut stuck = Slow::new(u32::MAX, &[]);
        assert_eq!(SerialPort::new(&mut stuck).send(&[1, 2, 3]), 0);
        assert_eq!(stuck.looked, LOOKS);
    }

    #[test]
    fn bytes_that_follow_are_received_together() {
        let mut slow = Slow::new(9, &[1, 2, 3]);
        slow.looked = 8;
        let mut bytes = [0; 8];
        assert_eq!(SerialPort::new(&mut slow).receive(&mut bytes), 3);
        assert_eq!(bytes[..3], [1, 2, 3]);
        assert_eq!(SerialPort::new(&mut slow).receive(&mut bytes), 0);
        // No more than there is room for, and the rest next.
        let mut fast = Slow::new(1, &[4, 5, 6]);
        let mut two = [0; 2];
        assert_eq!(SerialPort::new(&mut fast).receive(&mut two), 2);
        assert_eq!(SerialPort::new(&mut fast).receive(&mut two), 1);
        assert_eq!(two, [6, 5]);
    }

    #[test]
    fn a_port_to_which_nothing_comes_is_looked_at_once() {
        let mut slow = Slow::new(2, &[7]);
        assert_eq!(SerialPort::new(&mut slow).receive(&mut [0; 8]), 0);
        assert_eq!(slow.looked, 1);
    }
}
