//! The NUCLEO-H743ZI2 as it is wired: the chip, its crystal, both sensors, and a listener on the
//! serial port.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::num::{NonZeroU32, NonZeroU64};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, anyhow};
use rigless::chip::{Timeline, uart};
use rigless::cpu::armv7m::windows;
use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::Bus;
use rigless::soc::stm32h743::{Stm32h743, peripherals::usart};
use rigless::time::VirtualNanos;

use crate::port::Port;
use crate::sensor::{Shared, Wire};
use crate::stuck_bus::StuckBus;
use crate::trouble::{Trouble, Troubles};
use crate::watchdog::Iwdg;

const CRYSTAL_HZ: u64 = 8_000_000;
const SUPPLY_MV: u32 = 3300;
const CORE_HZ: u64 = 400_000_000;
/// The port that the debug probe listens to.
const SERIAL: &str = "USART3";
/// Name of the one chip.
const CHIP: &str = "stm32h743";

/// The chip, with the models that the crate does not have in their places.
#[derive(Debug)]
pub struct Chip {
    inner: Stm32h743,
    pub port: Port,
    pub watchdog: Iwdg,
    /// Places of the two on the bus.
    places: [usize; 2],
    stuck_bus: StuckBus,
    /// Places of the left sensor's interface and of the right one's.
    sensor_buses: [usize; 2],
    troubles: Troubles,
}

impl Mcu for Chip {
    fn bus(&self) -> &Bus {
        self.inner.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.inner.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.inner.reset(at, cause);
        Device::reset(&mut self.port);
        Device::reset(&mut self.watchdog);
    }

    /// Nothing on the board speaks by itself: whatever its models do, they have scheduled.
    fn poll(&mut self, _: VirtualNanos) {}

    fn split(&mut self, place: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let (bus, model) = self.inner.split(place);
        let side = self.sensor_buses.iter().position(|bus| *bus == place);
        if side.is_some_and(|side| self.troubles.are_now(Trouble::SdaLow(side))) {
            (bus, Some(&mut self.stuck_bus))
        } else if place == self.places[0] {
            (bus, Some(&mut self.port))
        } else if place == self.places[1] {
            (bus, Some(&mut self.watchdog))
        } else {
            (bus, model)
        }
    }
}

/// The far end of the serial port.
#[derive(Debug, Clone)]
pub enum Listener {
    /// Keeps what the port sends, and says nothing.
    Keeps(Arc<Mutex<Vec<u8>>>),
    /// Passes on what the port sends to this program's standard output, and what comes from its standard
    /// input to the port.
    Passes(Arc<Mutex<VecDeque<u8>>>),
}

impl Listener {
    /// A listener that keeps.
    pub fn keeping() -> Self {
        Self::Keeps(Arc::default())
    }

    /// A listener that passes on. The program ends with its standard input.
    pub fn passing() -> Self {
        let incoming = Arc::new(Mutex::new(VecDeque::new()));
        let filled = Arc::clone(&incoming);
        std::thread::spawn(move || {
            let mut chunk = [0; 256];
            while let Ok(count @ 1..) = io::stdin().lock().read(&mut chunk) {
                lock(&filled).extend(&chunk[..count]);
            }
            std::process::exit(0);
        });
        Self::Passes(incoming)
    }

    /// Returns the bytes that were kept.
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Keeps(bytes) => lock(bytes).clone(),
            Self::Passes(_) => vec![],
        }
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Store for Listener {}

impl uart::Peer for Listener {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        let byte = word as u8;
        match self {
            Self::Keeps(bytes) => lock(bytes).push(byte),
            Self::Passes(_) => {
                let mut output = io::stdout().lock();
                let written = output.write_all(&[byte]);
                // Packets end with a zero.
                let flushed = if byte == 0 { output.flush() } else { Ok(()) };
                if written.and(flushed).is_err() {
                    std::process::exit(0);
                }
            }
        }
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        match self {
            Self::Keeps(_) => None,
            Self::Passes(incoming) => lock(incoming).pop_front().map(u16::from),
        }
    }
}

/// The whole board.
#[derive(Debug)]
pub struct Nucleo {
    pub chip: Chip,
    pub serial: Listener,
}

impl Nucleo {
    /// Wires the board up.
    pub fn new(
        port: Port,
        sensors: &[Shared; 2],
        troubles: Troubles,
        serial: Listener,
    ) -> Result<Self> {
        let mut inner = Stm32h743::new().map_err(|error| anyhow!("{error}"))?;
        inner.rcc.attach_crystals(CRYSTAL_HZ, 0);
        inner.set_supply(SUPPLY_MV);
        inner.set_analog_supply(SUPPLY_MV);
        for (bus, sensor) in inner.i2c.iter_mut().zip(sensors) {
            bus.attach(Wire::new(sensor.clone()));
        }
        let number = usart::INSTANCES.iter().position(|&name| name == SERIAL);
        inner.usart[number.context(SERIAL)?].attach(serial.clone());
        let place = |name| inner.bus().slot_of(name).context(name);
        let places = [place("DCMI")?, place("IWDG")?];
        let sensor_buses = [place("I2C1")?, place("I2C2")?];
        let chip = Chip {
            inner,
            port,
            watchdog: Iwdg::default(),
            places,
            stuck_bus: StuckBus,
            sensor_buses,
            troubles,
        };
        Ok(Self { chip, serial })
    }
}

impl Store for Nucleo {}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        "nucleo-h743zi2"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![CHIP]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = u32::from(self.chip.cpu().interrupt_lines);
        let core = armv7m::Core {
            variant: armv7m::Variant::M7,
            clock_hz: NonZeroU64::new(CORE_HZ).expect("it runs"),
            interrupt_lines: NonZeroU32::new(lines).expect("it has interrupts"),
            priority_bits: 4,
            refclk_divider: const { NonZeroU32::new(8).unwrap() },
            // One instruction per cycle, about what the matcher has on hardware.
            instructions_per_second: NonZeroU64::new(CORE_HZ).expect("it runs"),
            boot: "flash",
        };
        let mut config = armv7m::Config::new(core, &windows(self.chip.bus()));
        config.mpu_regions = armv7m::MpuRegions::Sixteen;
        config.vector_table = Some(0x0800_0000);
        config.branch_prediction = armv7m::BranchPrediction::Always;
        // As the programming manual PM0253 gives them for this core and its caches of 16 KB.
        config.cpuid = 0x411f_c271;
        config.caches = Some(armv7m::Caches {
            clidr: 0x0900_0003,
            ctr: 0x8303_c003,
            ccsidr: &[0xf00f_e019, 0xf01f_e009],
        });
        vec![Target::new(CHIP, &mut self.chip, config.spec())]
    }
}
