//! What the tests of all sensors share: buses that expect a script of transactions, and fail in it.

use std::vec::Vec;

use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_hal_mock::eh1::i2c::{Mock, Transaction};

use super::error::{SensorError, Setting, SettingError};
use super::sensor::Sensor;
use super::settings::SensorSettings;

/// Errors of a bus, and whether each is a missing acknowledgement. A bus that hangs until its
/// driver gives up is an error of the kind `Other`.
const BUS_ERRORS: [(ErrorKind, bool); 6] = [
    (ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address), true),
    (ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data), true),
    (ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown), true),
    (ErrorKind::Other, false),
    (ErrorKind::Bus, false),
    (ErrorKind::ArbitrationLoss, false),
];

/// What `call` gives for a sensor whose bus expects exactly `script`.
pub(super) fn on_bus<S, T>(
    script: &[Transaction],
    new: impl Fn(Mock) -> S,
    call: impl FnOnce(&mut S) -> T,
) -> T {
    let mut bus = Mock::new(script);
    let result = call(&mut new(bus.clone()));
    bus.done();
    result
}

/// Lets each transaction of a set-up fail in turn, with each error: it is returned, and nothing is
/// written after it. The first `repeated` transactions are tried ten times, from the first one on.
pub(super) fn each_step_may_fail<S: Sensor<BusError = ErrorKind>>(
    script: &[Transaction],
    repeated: usize,
    new: impl Fn(Mock) -> S,
    settings: &SensorSettings,
) {
    for step in 0..script.len() {
        for (kind, is_nack) in BUS_ERRORS {
            let mut failing = script[..=step].to_vec();
            failing[step] = failing[step].clone().with_error(kind);
            let attempts = if step < repeated { 10 } else { 1 };
            let failing: Vec<_> = (0..attempts).flat_map(|_| failing.clone()).collect();
            let set_up = on_bus(&failing, &new, |sensor| {
                sensor.set_up(settings, &mut NoopDelay::new())
            });
            let expected = if is_nack {
                SensorError::Nack(kind)
            } else {
                SensorError::Bus(kind)
            };
            assert_eq!(set_up, Err(expected), "step {step}");
        }
    }
}

/// The error for a setting outside of its bounds, or between its steps.
pub(super) fn out_of_bounds(
    setting: Setting,
    value: u32,
    min: u32,
    max: u32,
    step: u32,
) -> SettingError {
    SettingError::OutOfBounds {
        setting,
        value,
        min,
        max,
        step,
    }
}

/// Settings that are refused without a word on the bus.
pub(super) fn are_refused<S: Sensor<BusError = ErrorKind>>(
    new: impl Fn(Mock) -> S,
    refused: &[(SensorSettings, SettingError)],
) {
    for (settings, error) in refused {
        let set_up = on_bus(&[], &new, |sensor| {
            sensor.set_up(settings, &mut NoopDelay::new())
        });
        assert_eq!(set_up, Err(SensorError::Setting(*error)), "{settings:?}");
    }
}
