//! An HM01B0 as the board sees it on I2C: its registers, and whether it is there.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::i2c::Peer;
use rigless::snapshot::Store;

const ADDRESS: u8 = 0x24;
const SOFTWARE_RESET: u16 = 0x0103;
const MODE: u16 = 0x0100;
const TRIGGER_MODE: u8 = 5;
const INTEGRATION_LINES: u16 = 0x0202;
const LINE_LENGTH: u16 = 0x0342;
const CLOCK: u16 = 0x3060;
/// Registers that the board or the port reads, with their values after a reset, from the datasheet: the
/// chip's number, the integration in lines, the length of a frame in lines, that of a line in clocks.
const AFTER_RESET: [(u16, u16); 4] = [
    (0x0000, 0x01b0),
    (INTEGRATION_LINES, 0x0108),
    (0x0340, 0x0232),
    (LINE_LENGTH, 0x0178),
];

/// Registers of a sensor and its absences.
#[derive(Debug)]
pub struct Sensor {
    registers: Vec<u8>,
    /// Times without power, ns.
    absences: Vec<Range<u64>>,
    /// Number of times that the board has armed it for its trigger.
    pub armed: u32,
}

impl Sensor {
    fn new(absences: Vec<Range<u64>>) -> Self {
        let mut sensor = Self {
            registers: vec![],
            absences,
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
        let is_there = !self.absences.iter().any(|absence| absence.contains(&at));
        if !is_there {
            self.reset();
        }
        is_there
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
    /// A sensor without power at these times, ns.
    pub fn new(absences: Vec<Range<u64>>) -> Self {
        Self(Arc::new(Mutex::new(Sensor::new(absences))))
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
        address == ADDRESS && self.sensor.look().is_there(time.now().0)
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
