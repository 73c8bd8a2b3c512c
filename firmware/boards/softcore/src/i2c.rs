//! The I2C bus of both sensors (`rtl/i2c.sv`).

use core::fmt;

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::i2c::{self, I2c, NoAcknowledgeSource, Operation};

use crate::registers::{I2C_BYTE, SENSORS_RESET};

// Bits of what is sent: a byte is above its acknowledgement.
const RELEASED: u32 = 1 << 0;
const START: u32 = 1 << 9;
const STOP: u32 = 1 << 10;
const READ: u32 = 1 << 11 | 0xff << 1;
// Of what comes of it.
const UNDER_WAY: u32 = 1 << 16;
const NOT_ACKNOWLEDGED: u32 = 17;
const HELD: u32 = 19;
const CLOCK_HELD: u32 = 1 << 21;

/// One sensor, or both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sides {
    Left = 1,
    Right = 2,
    Both = 3,
}

impl Sides {
    /// Returns the sensors whose bits of a status are set: bit `first` is the left one's, and the next the right one's.
    /// `None` if neither is set.
    fn of(status: u32, first: u32) -> Option<Self> {
        match status >> first & 3 {
            1 => Some(Self::Left),
            2 => Some(Self::Right),
            3 => Some(Self::Both),
            _ => None,
        }
    }
}

impl fmt::Display for Sides {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Left => "left sensor",
            Self::Right => "right sensor",
            Self::Both => "both sensors",
        })
    }
}

/// Why a transaction failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BusError {
    /// These do not acknowledge.
    NoAcknowledge(Sides),
    /// The SDA of these is low where it is released.
    Held(Sides),
    /// SCL is low where it is released.
    ClockHeld,
    /// The sensors answer unlike each other.
    Unlike,
}

impl fmt::Display for BusError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAcknowledge(sides) => write!(f, "{sides}: no acknowledgement"),
            Self::Held(sides) => write!(f, "{sides}: SDA is held low"),
            Self::ClockHeld => f.write_str("both sensors: SCL is held low"),
            Self::Unlike => f.write_str("the sensors answer unlike each other"),
        }
    }
}

impl i2c::Error for BusError {
    fn kind(&self) -> i2c::ErrorKind {
        match self {
            Self::NoAcknowledge(_) => i2c::ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown),
            Self::Held(_) => i2c::ErrorKind::ArbitrationLoss,
            Self::ClockHeld => i2c::ErrorKind::Bus,
            Self::Unlike => i2c::ErrorKind::Other,
        }
    }
}

/// The bus: what is written is written to both sensors at the same time, and what is read is what both answer.
pub(crate) struct SensorBus(());

impl SensorBus {
    /// The bus, of which there is one.
    pub(crate) fn new() -> Self {
        Self(())
    }

    /// Sends a byte and its acknowledgement, which the sensors may answer, and returns what has come. The wait ends: no
    /// bit takes longer than SCL may be held.
    fn send(&mut self, bits: u32) -> Result<u32, BusError> {
        I2C_BYTE.write(bits);
        let mut status = UNDER_WAY;
        while status & UNDER_WAY != 0 {
            status = I2C_BYTE.read();
        }
        if let Some(sides) = Sides::of(status, HELD) {
            return Err(BusError::Held(sides));
        }
        if status & CLOCK_HELD != 0 {
            return Err(BusError::ClockHeld);
        }
        match Sides::of(status, NOT_ACKNOWLEDGED) {
            Some(sides) => Err(BusError::NoAcknowledge(sides)),
            None => Ok(status),
        }
    }

    fn write_byte(&mut self, byte: u8, start: u32) -> Result<u32, BusError> {
        self.send(u32::from(byte) << 1 | RELEASED | start)
    }

    /// Reads a byte, the last one of its operation or not.
    fn read_byte(&mut self, is_last: bool) -> Result<u8, BusError> {
        let status = self.send(READ | u32::from(is_last))?;
        let [left, right, ..] = status.to_le_bytes();
        (left == right).then_some(left).ok_or(BusError::Unlike)
    }

    fn all(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), BusError> {
        let mut was_read = None;
        let mut rest = operations.iter_mut().peekable();
        while let Some(operation) = rest.next() {
            let is_read = matches!(operation, Operation::Read(_));
            // Operations of one kind are one.
            if was_read != Some(is_read) {
                self.write_byte(address << 1 | u8::from(is_read), START)?;
            }
            was_read = Some(is_read);
            match operation {
                Operation::Write(bytes) => {
                    for &byte in *bytes {
                        self.write_byte(byte, 0)?;
                    }
                }
                Operation::Read(bytes) => {
                    let goes_on = matches!(rest.peek(), Some(Operation::Read(_)));
                    let mut places = bytes.iter_mut().peekable();
                    while let Some(place) = places.next() {
                        *place = self.read_byte(!goes_on && places.peek().is_none())?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl i2c::ErrorType for SensorBus {
    type Error = BusError;
}

impl I2c for SensorBus {
    // Not inlined into each of a set-up's writes.
    #[inline(never)]
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), BusError> {
        let done = self.all(address, operations);
        if done.is_err() {
            // A sensor may be amid a byte that it sends, which it ends where the acknowledgement is missing.
            let _ = self.read_byte(true);
        }
        let stopped = self.send(STOP).map(drop);
        done.and(stopped)
    }
}

/// The wire of both sensors' reset.
pub(crate) struct ResetPin(());

impl ResetPin {
    /// The wire, of which there is one.
    pub(crate) fn new() -> Self {
        Self(())
    }
}

impl digital::ErrorType for ResetPin {
    type Error = core::convert::Infallible;
}

impl OutputPin for ResetPin {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        SENSORS_RESET.write(0);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Self::Error> {
        SENSORS_RESET.write(1);
        Ok(())
    }
}
