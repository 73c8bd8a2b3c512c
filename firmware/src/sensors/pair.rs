//! Both sensors of a pair, set up alike.

use core::fmt;

use embedded_hal::delay::DelayNs;

use super::error::SensorError;
use super::sensor::Sensor;
use super::settings::SensorSettings;

/// A sensor of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// Why a pair is not set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PairError<E> {
    /// The sensor that failed.
    pub side: Side,
    /// Its error.
    pub error: SensorError<E>,
}

impl<E: fmt::Debug> fmt::Display for PairError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = match self.side {
            Side::Left => "left",
            Side::Right => "right",
        };
        write!(f, "{side} sensor: {}", self.error)
    }
}

impl<E: fmt::Debug> core::error::Error for PairError<E> {}

/// Sets both sensors of a pair up with the same settings, the left one first. They sit on a bus
/// each, or share one, which is lent to each by a wrapper such as
/// `embedded_hal_bus::i2c::RefCellDevice`.
///
/// # Errors
/// [`PairError`] with the first sensor that failed. After a failure of the right one, the left one
/// is set up.
pub fn set_up_pair<S: Sensor>(
    left: &mut S,
    right: &mut S,
    settings: &SensorSettings,
    delay: &mut impl DelayNs,
) -> Result<(), PairError<S::BusError>> {
    for (side, sensor) in [(Side::Left, left), (Side::Right, right)] {
        let set_up = sensor.set_up(settings, delay);
        set_up.map_err(|error| PairError { side, error })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::mt9v034::{FULL_WINDOW, Mt9v034};
    use crate::sensors::settings::{FrameSync, TestPattern};
    use core::cell::RefCell;
    use embedded_hal::i2c::{ErrorType, I2c, NoAcknowledgeSource, Operation};
    use embedded_hal_mock::eh1::delay::NoopDelay;
    use std::string::ToString;
    use std::vec;
    use std::vec::Vec;

    const SETTINGS: SensorSettings = SensorSettings {
        window: FULL_WINDOW,
        clock_hz: 27_000_000,
        line_us: 32,
        frame_lines: 525,
        exposure_us: 5000,
        gain_q4: 16,
        sync: FrameSync::Triggered,
        test_pattern: TestPattern::Off,
    };

    /// A bus with MT9V034 at some addresses, which keeps what was written.
    struct Wires {
        present: Vec<u8>,
        written: Vec<(u8, Vec<u8>)>,
    }

    /// A place of the bus.
    #[derive(Clone, Copy)]
    struct Shared<'w>(&'w RefCell<Wires>);

    impl ErrorType for Shared<'_> {
        type Error = embedded_hal::i2c::ErrorKind;
    }

    impl I2c for Shared<'_> {
        fn transaction(
            &mut self,
            address: u8,
            operations: &mut [Operation<'_>],
        ) -> Result<(), Self::Error> {
            let mut wires = self.0.borrow_mut();
            if !wires.present.contains(&address) {
                let source = NoAcknowledgeSource::Address;
                return Err(embedded_hal::i2c::ErrorKind::NoAcknowledge(source));
            }
            for operation in operations {
                match operation {
                    Operation::Write(bytes) => wires.written.push((address, bytes.to_vec())),
                    Operation::Read(bytes) => bytes.copy_from_slice(&[0x13, 0x24]),
                }
            }
            Ok(())
        }
    }

    fn set_up(present: &[u8]) -> (Result<(), PairError<embedded_hal::i2c::ErrorKind>>, Wires) {
        let wires = RefCell::new(Wires {
            present: present.to_vec(),
            written: vec![],
        });
        let [mut left, mut right] =
            [0x48, 0x4c].map(|address| Mt9v034::new(Shared(&wires), address));
        let result = set_up_pair(&mut left, &mut right, &SETTINGS, &mut NoopDelay::new());
        (result, wires.into_inner())
    }

    #[test]
    fn both_sensors_of_a_shared_bus_are_told_the_same() {
        let (result, wires) = set_up(&[0x48, 0x4c]);
        assert_eq!(result, Ok(()));
        let of = |address| {
            let mut written = wires.written.clone();
            written.retain(|(to, _)| *to == address);
            written.into_iter().map(|(_, bytes)| bytes)
        };
        assert!(of(0x48).count() > 20);
        assert!(of(0x48).eq(of(0x4c)));
    }

    #[test]
    fn the_sensor_that_fails_is_told() {
        for (present, side, name) in [
            ([0x4c], Side::Left, "left sensor: "),
            ([0x48], Side::Right, "right sensor: "),
        ] {
            let (result, wires) = set_up(&present);
            let error = result.unwrap_err();
            assert_eq!(error.side, side);
            assert!(matches!(error.error, SensorError::Nack(_)));
            assert!(error.to_string().starts_with(name));
            assert_eq!(wires.written.is_empty(), side == Side::Left);
        }
    }
}
