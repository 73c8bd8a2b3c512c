//! Lines that the board adds to the host's log: restarts by the watchdog, and problems of the sensors.

use core::cell::Cell;
use core::fmt;

use vgstereo_firmware::sensors::SensorError;

use crate::i2c::BusError;

/// Why the sensors cannot be set up.
pub(crate) type Problem = SensorError<BusError>;

/// A line of the log.
#[derive(Clone, Copy)]
pub(crate) enum News {
    /// The watchdog has restarted the board, so many times since it got its power.
    Restarted(u32),
    /// The problem because of which the sensors cannot be set up; `None` once both are.
    Sensors(Option<Problem>),
}

impl fmt::Display for News {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Restarted(times) => write!(f, "restarted by the watchdog: {times}"),
            Self::Sensors(None) => f.write_str("both sensors are set up"),
            Self::Sensors(Some(SensorError::Nack(error) | SensorError::Bus(error))) => error.fmt(f),
            Self::Sensors(Some(SensorError::WrongChip { found, .. })) => {
                write!(f, "the sensors are another chip: {found:#06x}")
            }
            Self::Sensors(Some(_)) => f.write_str("the sensors cannot be set up like that"),
        }
    }
}

/// Where news go.
pub(crate) trait Log {
    fn tell(&self, news: News);
}

/// News that wait until they are asked for: the last of each kind.
#[derive(Default)]
pub(crate) struct Pending {
    restarted: Cell<Option<News>>,
    sensors: Cell<Option<News>>,
}

impl Pending {
    /// Returns what has not been asked for, if there is anything.
    pub(crate) fn take(&self) -> Option<News> {
        self.restarted.take().or_else(|| self.sensors.take())
    }
}

impl Log for Pending {
    fn tell(&self, news: News) {
        let place = match news {
            News::Restarted(_) => &self.restarted,
            News::Sensors(_) => &self.sensors,
        };
        place.set(Some(news));
    }
}
