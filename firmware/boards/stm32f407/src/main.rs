//! Firmware for an STM32F4DISCOVERY with two HM01B0 sensors on the camera port of its STM32F407.
//! Disparities are sent over a serial port, and the log over the debug probe. The README describes
//! the wiring.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use defmt_rtt as _;
use embassy_stm32::peripherals::{DCMI, DMA2_CH1, IWDG, USART3};
use embassy_stm32::rcc::{Mco, Mco1Source, McoConfig, McoPrescaler};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::{bind_interrupts, dcmi, dma, gpio, i2c, pac, rcc};
use panic_probe as _;
use static_cell::{ConstStaticCell, StaticCell};
use stm32_stereo::calibration::{self, RECTIFIER_BYTES};
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
use vgstereo_firmware::live::NoStore;
use vgstereo_firmware::{live, session};
use vgstereo_kernels::Armv7em;

/// Geometry of the camera's lines: the middle of the sensors' 324x244 px.
const GEOMETRY: Geometry = Geometry {
    width: 320,
    height: 240,
    format: PixelFormat::Grey8,
};
/// Size, order and timing of the lines that the cameras send. The period of a line is what the
/// matcher needs for one, with flash's wait states; the serial port needs less.
const RIG: Rig = Rig {
    geometry: GEOMETRY,
    layout: Layout::PixelMultiplexed { phase: 0 },
    line_us: 8_000,
};
/// Preset of the matcher, and its configuration.
const PRESET: Preset = Preset::Lite;
const CONFIG: Config = Config::new(
    PRESET.parameters(),
    GEOMETRY.width,
    DisparityRange::up_to(47),
);
/// Baud rate of the serial port. A line of disparities takes 3.3 ms.
const BAUD: u32 = 2_000_000;
bind_interrupts!(struct Interrupts {
    DCMI => capture::LineEnd, dcmi::InterruptHandler<DCMI>;
    DMA2_STREAM1 => dma::InterruptHandler<DMA2_CH1>;
    USART3 => usart::BufferedInterruptHandler<USART3>;
});

/// Memory of the matcher.
#[unsafe(export_name = "lent_memory")]
static MATCHER: ConstStaticCell<[u32; CONFIG.memory_words()]> =
    ConstStaticCell::new([0; CONFIG.memory_words()]);
/// Memory of the session: one line of each view.
static LINES: ConstStaticCell<[u32; session::memory_words(&GEOMETRY)]> =
    ConstStaticCell::new([0; session::memory_words(&GEOMETRY)]);
/// The two raw lines that DMA2 fills in turn, and the one that is split.
static RAW_LINES: ConstStaticCell<[u32; 2 * RIG.raw_words()]> =
    ConstStaticCell::new([0; 2 * RIG.raw_words()]);
static RAW_LINE: ConstStaticCell<[u32; RIG.raw_words()]> =
    ConstStaticCell::new([0; RIG.raw_words()]);
/// The rectifier, if there is a calibration, and its memory.
static RECTIFIER: StaticCell<Rectifier<'static, 'static, Armv7em>> = StaticCell::new();
static RECTIFIER_MEMORY: ConstStaticCell<[u32; RECTIFIER_BYTES / 4]> =
    ConstStaticCell::new([0; RECTIFIER_BYTES / 4]);
/// Memory of the link.
static LINK: ConstStaticCell<[u32; live::memory_words(&GEOMETRY, &CONFIG)]> =
    ConstStaticCell::new([0; live::memory_words(&GEOMETRY, &CONFIG)]);
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
    let watchdog = Iwdg::start(unsafe { IWDG::steal() }, pac::IWDG, RIG.watchdog_us());
    let board = embassy_stm32::init(clocks());

    let mut sensor_clock = McoConfig::default();
    sensor_clock.prescaler = McoPrescaler::DIV1;
    let _sensor_clock = Mco::new(board.MCO1, board.PA8, Mco1Source::HSE, sensor_clock);
    let bus = bus_config();
    let left = i2c::I2c::new_blocking(board.I2C1, board.PB8, board.PB9, bus);
    let right = i2c::I2c::new_blocking(board.I2C2, board.PB10, board.PB11, bus);
    let sensors = Sensors::new(left, right, &RIG);

    // SAFETY: of the two owners of the channel, `Dcmi` uses it only in its `capture`, which is
    // never called.
    let channel = unsafe { board.DMA2_CH1.clone_unchecked() };
    let port = dcmi::Dcmi::new_8bit(
        board.DCMI,
        board.DMA2_CH1,
        Interrupts,
        board.PC6,
        board.PC7,
        board.PC8,
        board.PC9,
        board.PC11,
        board.PB6,
        board.PE5,
        board.PE6,
        board.PB7,
        board.PA4,
        board.PA6,
        port_config(),
    );
    let trigger = gpio::Output::new(board.PE4, gpio::Level::Low, gpio::Speed::Low);
    let (stream, raw_lines) = (pac::DMA2.st(1), RAW_LINES.take());
    let capture = Capture::new(port, channel, stream, Interrupts, &RIG, raw_lines);
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
    let (slot, memory) = (calibration::slot(), RECTIFIER_MEMORY.take());
    let rectifier = calibration::rectifier(slot, &RIG, CONFIG.width, Armv7em, memory);
    let rectifier = rectifier.map(|rectifier| &mut *RECTIFIER.init(rectifier));
    let matcher = defmt::unwrap!(Matcher::new(&CONFIG, Armv7em, MATCHER.take()));
    let link = Link {
        port: SerialPort::new(serial),
        device: env!("CARGO_PKG_NAME"),
        firmware: env!("CARGO_PKG_VERSION"),
        preset: PRESET.name(),
        memory: LINK.take(),
        // There is no memory for a second calibration beside the one in use.
        store: NoStore,
    };
    let lines = LINES.take();
    run(&RIG, camera, rectifier, matcher, lines, link, watchdog)
}

/// Clock tree: 168 MHz from the board's crystal of 8 MHz.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse {
        freq: Hertz::mhz(8),
        mode: rcc::HseMode::Oscillator,
    });
    config.rcc.pll_src = rcc::PllSource::HSE;
    config.rcc.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config
}
