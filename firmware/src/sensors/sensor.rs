//! The trait of sensors.

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c;

use super::error::SensorError;
use super::settings::SensorSettings;

/// An image sensor on an I²C bus, or on its place of a shared one.
pub trait Sensor {
    /// Error of the bus.
    type BusError: i2c::Error;

    /// Sets the sensor up, whatever it was set to before. Afterwards it sends frames, or waits for
    /// what starts them.
    ///
    /// # Errors
    /// [`SensorError`], after which the sensor is to be set up again before it is used. Nothing was
    /// written where it cannot do what the settings say.
    fn set_up(
        &mut self,
        settings: &SensorSettings,
        delay: &mut impl DelayNs,
    ) -> Result<(), SensorError<Self::BusError>>;

    /// Returns whether a sensor that was set up still is. One that has lost its power, or was
    /// reset, has forgotten its settings.
    ///
    /// # Errors
    /// [`SensorError`] if it does not answer.
    fn is_set_up(&mut self) -> Result<bool, SensorError<Self::BusError>>;
}
