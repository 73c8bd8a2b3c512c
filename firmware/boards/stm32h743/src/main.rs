//! Firmware for a NUCLEO-H743ZI2 with two HM01B0 sensors on its camera port. Disparities are sent
//! over the serial port, and the log over the debug probe. The README describes the wiring.
#![no_std]
#![no_main]

mod memory;
mod store;

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::flash::Flash;
use embassy_stm32::peripherals::{DCMI, DMA1_CH0, IWDG1, USART3};
use embassy_stm32::rcc::{Mco, Mco1Source, McoConfig, McoPrescaler};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, dcmi, dma, gpio, i2c, pac, rcc};
use panic_probe as _;
use static_cell::{ConstStaticCell, StaticCell};
use stm32_stereo::calibration;
use stm32_stereo::camera::StereoCamera;
use stm32_stereo::capture::{self, Capture, port_config};
use stm32_stereo::rig::Rig;
use stm32_stereo::run::{Link, run};
use stm32_stereo::sensors::{Sensors, bus_config};
use stm32_stereo::serial::SerialPort;
use stm32_stereo::watchdog::Iwdg;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Config, DisparityRange, Matcher, Preset};
use vgstereo_firmware::camera::{Geometry, Layout, PixelFormat};
use vgstereo_firmware::{live, session};
use vgstereo_kernels::Armv7em;

use crate::store::FlashStore;

/// Geometry of the camera's lines: the middle of the sensors' 324x244 px.
const GEOMETRY: Geometry = Geometry {
    width: 320,
    height: 240,
    format: PixelFormat::Grey8,
};
/// Size, order and timing of the lines that the cameras send. The period of a line is the time that
/// the serial port and the matcher, side by side, have for one line.
const RIG: Rig = Rig {
    geometry: GEOMETRY,
    layout: Layout::PixelMultiplexed { phase: 0 },
    line_us: if cfg!(feature = "serial-8-mbaud") {
        2_500
    } else {
        3_750
    },
};
/// Preset of the matcher, and its configuration.
const PRESET: Preset = Preset::Lite;
const CONFIG: Config = Config::new(
    PRESET.parameters(),
    GEOMETRY.width,
    DisparityRange::up_to(47),
);
/// Baud rate of the serial port. At 2 Mbaud a line of disparities takes 3.3 ms, at 8 Mbaud 0.8 ms.
const BAUD: u32 = if cfg!(feature = "serial-8-mbaud") {
    8_000_000
} else {
    2_000_000
};
bind_interrupts!(struct Interrupts {
    DCMI => capture::LineEnd, dcmi::InterruptHandler<DCMI>;
    DMA1_STREAM0 => dma::InterruptHandler<DMA1_CH0>;
    USART3 => usart::BufferedInterruptHandler<USART3>;
});

/// Memory of the session: one line of each view.
static LINES: ConstStaticCell<[u32; session::memory_words(&GEOMETRY)]> =
    ConstStaticCell::new([0; session::memory_words(&GEOMETRY)]);
/// The rectifier, if there is a calibration.
static RECTIFIER: StaticCell<Rectifier<'static, 'static, Armv7em>> = StaticCell::new();
/// Memory of the link.
static LINK: ConstStaticCell<[u32; live::memory_words(&GEOMETRY, &CONFIG)]> =
    ConstStaticCell::new([0; live::memory_words(&GEOMETRY, &CONFIG)]);
/// Memory of the camera: one raw line.
static RAW_LINE: ConstStaticCell<[u32; RIG.raw_words()]> =
    ConstStaticCell::new([0; RIG.raw_words()]);
/// Send buffer of the serial port: two packets, so that sending and matching overlap.
static OUTGOING: ConstStaticCell<[u8; 2 * live::sent_bytes(&GEOMETRY, &CONFIG)]> =
    ConstStaticCell::new([0; 2 * live::sent_bytes(&GEOMETRY, &CONFIG)]);
/// Receive buffer of the serial port: two commands, which wait for the end of a frame.
static INCOMING: ConstStaticCell<[u8; 2 * live::received_bytes()]> =
    ConstStaticCell::new([0; 2 * live::received_bytes()]);

#[entry]
fn main() -> ! {
    // Before all else, the clocks included: whatever hangs, the board starts again.
    // SAFETY: the peripheral that `init` gives out is not used.
    let watchdog = Iwdg::start(unsafe { IWDG1::steal() }, pac::IWDG1, RIG.watchdog_us());
    let board = embassy_stm32::init(clocks());
    let memories = memory::take();

    let mut sensor_clock = McoConfig::default();
    sensor_clock.prescaler = McoPrescaler::DIV1;
    let _sensor_clock = Mco::new(board.MCO1, board.PA8, Mco1Source::HSE, sensor_clock);
    let bus = bus_config();
    let left = i2c::I2c::new_blocking(board.I2C1, board.PB8, board.PB9, bus);
    let right = i2c::I2c::new_blocking(board.I2C2, board.PF1, board.PF0, bus);
    let sensors = Sensors::new(left, right, &RIG);

    // SAFETY: of the two owners of the channel, `Dcmi` uses it only in its `capture`, which is
    // never called.
    let channel = unsafe { board.DMA1_CH0.clone_unchecked() };
    let port = dcmi::Dcmi::new_8bit(
        board.DCMI,
        board.DMA1_CH0,
        Interrupts,
        board.PC6,
        board.PC7,
        board.PC8,
        board.PC9,
        board.PC11,
        board.PD3,
        board.PE5,
        board.PE6,
        board.PB7,
        board.PA4,
        board.PA6,
        port_config(),
    );
    let trigger = gpio::Output::new(board.PD4, gpio::Level::Low, gpio::Speed::Low);
    let stream = pac::DMA1.st(0);
    let capture = Capture::new(port, channel, stream, Interrupts, &RIG, memories.raw_lines);
    let camera = StereoCamera::new(RIG, sensors, capture, trigger, watchdog, RAW_LINE.take());

    let mut serial = usart::Config::default();
    serial.baudrate = BAUD;
    let serial = BufferedUart::new(
        board.USART3,
        board.PD9,
        board.PD8,
        OUTGOING.take(),
        INCOMING.take(),
        Interrupts,
        serial,
    );
    let serial = defmt::unwrap!(serial);
    let [in_use, staging] = memories.calibrations;
    let bytes = calibration::copied(calibration::slot(), in_use);
    let rectifier = calibration::rectifier(bytes, &RIG, CONFIG.width, Armv7em, memories.rectifier);
    let rectifier = rectifier.map(|rectifier| &mut *RECTIFIER.init(rectifier));
    let matcher = defmt::unwrap!(Matcher::new(&CONFIG, Armv7em, memories.matcher));
    let link = Link {
        port: SerialPort::new(serial),
        device: env!("CARGO_PKG_NAME"),
        firmware: env!("CARGO_PKG_VERSION"),
        preset: PRESET.name(),
        memory: LINK.take(),
        store: FlashStore::new(Flash::new_blocking(board.FLASH), staging, watchdog),
    };
    let lines = LINES.take();
    run(&RIG, camera, rectifier, matcher, lines, link, watchdog)
}

/// Clock tree: 400 MHz from the 8 MHz that the board's debug probe supplies.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz::mhz(8),
        mode: rcc::HseMode::Bypass,
    });
    config.rcc.pll1 = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV1,
        mul: rcc::PllMul::MUL100,
        fracn: None,
        divp: Some(rcc::PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV2;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb3_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb4_pre = rcc::APBPrescaler::DIV2;
    config.rcc.voltage_scale = rcc::VoltageScale::Scale1;
    config
}
