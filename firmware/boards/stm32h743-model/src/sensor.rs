//! An HM01B0 as the board sees it on I2C: its registers, and whether it is there.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::i2c::Peer;
use rigless::snapshot::Store;

use crate::trouble::{Trouble, Troubles};

const ADDRESS: u8 = 0x24;
const SOFTWARE_RESET: u16 = 0x0103;
const MODE: u16 = 0x0100;
const TRIGGER_MODE: u8 = 5;
const INTEGRATION_LINES: u16 = 0x0202;
const LINE_LENGTH: u16 = 0x0342;
const CLOCK: u16 = 0x3060;
/// The number of an HM0360, a chip with the same address.
const OTHER_CHIP: [u8; 2] = [0x03, 0x60];
/// Registers that the board or the port reads, with their values after a reset, from the datasheet: the
/// chip's number, the integration in lines, the length of a frame in lines, that of a line in clocks.
const AFTER_RESET: [(u16, u16); 4] = [
    (0x0000, 0x01b0),
    (INTEGRATION_LINES, 0x0108),
    (0x0340, 0x0232),
    (LINE_LENGTH, 0x0178),
];

/// Registers of a sensor and its troubles.
#[derive(Debug)]
pub struct Sensor {
    /// 0 for the left one, 1 for the right one.
    side: usize,
    registers: Vec<u8>,
    troubles: Troubles,
    /// Number of times that the board has armed it for its trigger.
    pub armed: u32,
}

impl Sensor {
    fn new(side: usize, troubles: Troubles) -> Self {
        let mut sensor = Self {
            side,
            registers: vec![],
            troubles,
            armed: 0,
        };
        sensor.reset();
        sensor
    }

    fn reset(&mut self) {
        self.registers = vec![0; 1 << 16];
        for (register, value) in AFTER_RESET {
            let at = usize::from(register);
            self.registers[at..at + 2].copy_from_slice(&value.to_be_bytes());
        }
    }

    /// Returns whether it has power at this time, ns; without, it forgets its registers.
    pub fn is_there(&mut self, at: u64) -> bool {
        let is_there = !self.troubles.are(Trouble::Absent(self.side), at);
        if !is_there {
            self.reset();
        }
        is_there
    }

    /// Leaves its place to another chip, if there is one at this time, ns.
    fn give_place(&mut self, at: u64) {
        if self.troubles.are(Trouble::OtherChip(self.side), at) {
            self.reset();
            self.registers[..2].copy_from_slice(&OTHER_CHIP);
        } else if self.registers[..2] == OTHER_CHIP {
            self.reset();
        }
    }

    fn pair(&self, register: u16) -> u64 {
        let at = usize::from(register);
        u64::from(u16::from_be_bytes([
            self.registers[at],
            self.registers[at + 1],
        ]))
    }

    /// Whether it waits for its trigger.
    pub fn is_armed(&self) -> bool {
        self.registers[usize::from(MODE)] == TRIGGER_MODE
    }

    /// Period of a line, ns, with a clock of this period.
    pub fn line_ns(&self, clock_ns: u64) -> u64 {
        let divider = 8 >> (self.registers[usize::from(CLOCK)] & 3);
        self.pair(LINE_LENGTH) * divider * clock_ns
    }

    /// Lines of exposure before a frame.
    pub fn integration_lines(&self) -> u64 {
        self.pair(INTEGRATION_LINES)
    }

    fn write(&mut self, register: u16, value: u8) {
        if register == SOFTWARE_RESET {
            self.reset();
            return;
        }
        self.registers[usize::from(register)] = value;
        self.armed += u32::from(register == MODE && value == TRIGGER_MODE);
    }
}

/// A sensor that its bus and the camera port share.
#[derive(Debug, Clone)]
pub struct Shared(Arc<Mutex<Sensor>>);

impl Shared {
    /// A sensor, the left one (0) or the right one (1), with its troubles.
    pub fn new(side: usize, troubles: Troubles) -> Self {
        Self(Arc::new(Mutex::new(Sensor::new(side, troubles))))
    }

    /// The sensor, for one look.
    pub fn look(&self) -> MutexGuard<'_, Sensor> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A sensor's end of its bus.
#[derive(Debug)]
pub struct Wire {
    sensor: Shared,
    /// Bytes of the register's number that have come, and the register.
    numbered: u8,
    register: u16,
}

impl Wire {
    pub fn new(sensor: Shared) -> Self {
        Self {
            sensor,
            numbered: 0,
            register: 0,
        }
    }
}

impl Store for Wire {}

impl Peer for Wire {
    fn start(&mut self, address: u8, read: bool, time: &mut Timeline<'_, '_>) -> bool {
        if !read {
            self.numbered = 0;
        }
        let mut sensor = self.sensor.look();
        sensor.give_place(time.now().0);
        address == ADDRESS && sensor.is_there(time.now().0)
    }

    fn write(&mut self, byte: u8, _: &mut Timeline<'_, '_>) -> bool {
        if self.numbered < 2 {
            self.numbered += 1;
            self.register = self.register << 8 | u16::from(byte);
        } else {
            self.sensor.look().write(self.register, byte);
            self.register = self.register.wrapping_add(1);
        }
        true
    }

    fn read(&mut self, _: bool, _: &mut Timeline<'_, '_>) -> u8 {
        let byte = self.sensor.look().registers[usize::from(self.register)];
        self.register = self.register.wrapping_add(1);
        byte
    }

    fn stop(&mut self, _: &mut Timeline<'_, '_>) {}
}
