//! Reset of sensors by their pin.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::OutputPin;

/// Times of a sensor's reset, which its pin starts when it is low.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ResetTiming {
    /// Time for which the pin is low, us.
    pub low_us: u32,
    /// Time from then on until the sensor's bus may be used, us.
    pub settling_us: u32,
}

/// Resets a sensor, or both of a pair that share the wire, so that they begin at the same time.
/// Their clock has to run.
///
/// # Errors
/// That of the pin.
pub fn reset_by_pin<P: OutputPin>(
    pin: &mut P,
    timing: ResetTiming,
    delay: &mut impl DelayNs,
) -> Result<(), P::Error> {
    pin.set_low()?;
    delay.delay_us(timing.low_us);
    pin.set_high()?;
    delay.delay_us(timing.settling_us);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::{mt9v034, ov7670};
    use embedded_hal_mock::eh1::MockError;
    use embedded_hal_mock::eh1::delay::{CheckedDelay, Transaction as Delay};
    use embedded_hal_mock::eh1::digital::{Mock, State, Transaction};
    use std::io::ErrorKind;

    #[test]
    fn the_pin_is_low_and_then_high_for_the_times_of_the_sensor() {
        for (timing, low_us, settling_us) in [(mt9v034::RESET, 1, 1), (ov7670::RESET, 1000, 1000)] {
            let mut pin = Mock::new(&[Transaction::set(State::Low), Transaction::set(State::High)]);
            let delays = [Delay::delay_us(low_us), Delay::delay_us(settling_us)];
            let mut delay = CheckedDelay::new(&delays);
            assert_eq!(reset_by_pin(&mut pin, timing, &mut delay), Ok(()));
            pin.done();
            delay.done();
        }
    }

    #[test]
    fn an_error_of_the_pin_is_returned() {
        let broken = || MockError::Io(ErrorKind::NotConnected);
        let low = Transaction::set(State::Low);
        let high = Transaction::set(State::High).with_error(broken());
        for (script, delays) in [
            (&[low.clone().with_error(broken())][..], &[][..]),
            (&[low, high][..], &[Delay::delay_us(1)][..]),
        ] {
            let mut pin = Mock::new(script);
            let mut delay = CheckedDelay::new(delays);
            let reset = reset_by_pin(&mut pin, mt9v034::RESET, &mut delay);
            assert_eq!(reset, Err(broken()));
            pin.done();
            delay.done();
        }
    }
}
