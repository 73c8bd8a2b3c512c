//! Capture of lines from the camera port by DMA, into a ring of two line buffers.
//!
//! embassy's `Dcmi` sets up pins, clock and polarity, but its `capture` needs a buffer for a whole
//! frame. Here the port writes to a ring of two lines instead. At the line sync after each line, an
//! interrupt counts the line and compares it with the position in the ring. So a line with too few
//! pixels is detected, and does not displace the lines after it.
//!
//! The port crops to the geometry: longer lines and additional lines are harmless.

use core::cell::Cell;

use critical_section::Mutex;
use embassy_stm32::Peri;
use embassy_stm32::dcmi::{self, Dcmi, FrameDma};
use embassy_stm32::dma::{self, ReadableRingBuffer, TransferOptions};
use embassy_stm32::interrupt::typelevel::{Binding, DCMI as PortInterrupt, Handler};
use embassy_stm32::pac;
use embassy_stm32::peripherals::DCMI;
use vgstereo_firmware::camera::ErrorKind;

use crate::rig::Rig;

/// Margin that the sensors send on each side of the geometry: pixels of each view, and lines.
const MARGIN: u32 = 2;

/// Returns how the port is to be set up: syncs of an HM01B0, which are high while data is valid, and
/// data that is taken at the clock's rise.
#[must_use]
pub fn port_config() -> dcmi::Config {
    let mut config = dcmi::Config::default();
    config.vsync_level = dcmi::VSyncDataInvalidLevel::Low;
    config.hsync_level = dcmi::HSyncDataInvalidLevel::Low;
    config.pixclk_polarity = dcmi::PixelClockPolarity::RisingEdge;
    config
}

/// Progress of the current frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of complete lines of the geometry received so far.
    pub lines: u32,
    /// Number of line syncs so far.
    syncs: u32,
    /// Whether the frame sync has ended the frame.
    pub has_ended: bool,
    /// First fault in the frame.
    pub fault: Option<ErrorKind>,
}

impl Progress {
    const ENDED: Self = Self {
        lines: 0,
        syncs: 0,
        has_ended: true,
        fault: None,
    };
}

/// Progress of the current frame, written by the interrupt, and by [`Capture::begin_frame`].
static PROGRESS: Mutex<Cell<Progress>> = Mutex::new(Cell::new(Progress::ENDED));

/// The DMA stream and the sizes that the interrupt counts lines by.
#[derive(Clone, Copy)]
struct Ring {
    /// The stream of the DMA controller that fills it.
    stream: pac::dma::St,
    /// Words of each of its two lines.
    line_words: usize,
    /// Lines of a frame.
    height: u32,
}

/// The ring, once the port is set up.
static RING: Mutex<Cell<Option<Ring>>> = Mutex::new(Cell::new(None));

/// Interrupt handler of the port, called at the end of each line and of each frame.
pub struct LineEnd;

impl Handler<PortInterrupt> for LineEnd {
    unsafe fn on_interrupt() {
        let events = pac::DCMI.mis().read();
        pac::DCMI.icr().write(|clear| {
            clear.set_line_isc(events.line_mis());
            clear.set_vsync_isc(events.vsync_mis());
            clear.set_ovr_isc(events.ovr_mis());
            // Not asked for, but raised; embassy's handler would act on it at every line.
            clear.set_frame_isc(true);
        });
        critical_section::with(|token| {
            let Some(ring) = RING.borrow(token).get() else {
                return;
            };
            let cell = PROGRESS.borrow(token);
            let mut progress = cell.get();
            let mut fault = events.ovr_mis().then_some(ErrorKind::Overrun);
            if events.line_mis() && !progress.has_ended {
                progress.syncs = progress.syncs.saturating_add(1);
                progress.lines = progress.syncs.saturating_sub(MARGIN).min(ring.height);
                // Words until the end of the ring, which is all of it after an even number of
                // lines.
                let whole = 2 - progress.lines as usize % 2;
                let left = ring.stream.ndtr().read().ndt();
                if usize::from(left) != whole * ring.line_words {
                    fault = fault.or(Some(ErrorKind::ShortLine));
                }
            }
            if events.vsync_mis() {
                progress.has_ended = true;
            }
            progress.fault = progress.fault.or(fault);
            cell.set(progress);
        });
    }
}

/// The camera port and its ring of lines, which the channel `D` of a DMA controller fills.
/// `I` binds its interrupt.
pub struct Capture<D: FrameDma<DCMI>, I> {
    _port: Dcmi<'static, DCMI>,
    channel: Peri<'static, D>,
    interrupts: I,
    ring: Option<ReadableRingBuffer<'static, u32>>,
    line_words: usize,
    raw_lines: *mut [u32],
}

impl<D, I> Capture<D, I>
where
    D: FrameDma<DCMI>,
    I: Binding<D::Interrupt, dma::InterruptHandler<D>> + Copy + 'static,
{
    /// Sets up an idle port. `stream` is the channel's in its controller. `raw_lines` holds two raw
    /// lines, in memory that the controller reaches and that is not cached.
    pub fn new(
        port: Dcmi<'static, DCMI>,
        channel: Peri<'static, D>,
        stream: pac::dma::St,
        interrupts: I,
        rig: &Rig,
        raw_lines: &'static mut [u32],
    ) -> Self {
        let line_words = rig.raw_words();
        // Pixel clocks of the left margin.
        let margin_clocks = 2 * MARGIN * rig.geometry.format.bytes_per_pixel() as u32;
        critical_section::with(|token| {
            RING.borrow(token).set(Some(Ring {
                stream,
                line_words,
                height: rig.geometry.height,
            }));
        });
        pac::DCMI.cr().modify(|control| {
            control.set_cm(true);
            control.set_crop(true);
        });
        pac::DCMI.cwstrt().write(|start| {
            start.set_hoffcnt(margin_clocks as u16);
            start.set_vst(MARGIN as u16);
        });
        pac::DCMI.cwsize().write(|size| {
            size.set_capcnt((4 * line_words - 1) as u16);
            size.set_vline((rig.geometry.height - 1) as u16);
        });
        Self {
            _port: port,
            channel,
            interrupts,
            ring: None,
            line_words,
            raw_lines,
        }
    }

    /// Discards the current frame and arms the port for the next one.
    pub fn begin_frame(&mut self) {
        pac::DCMI.cr().modify(|control| {
            control.set_capture(false);
            control.set_enable(false);
        });
        // The old transfer ends here, before the memory is lent to the new one.
        self.ring = None;
        let request = FrameDma::<DCMI>::request(&*self.channel);
        // SAFETY: the ring was the only other user of the channel and of the memory, which is
        // static, and it is gone.
        let ring = unsafe {
            let channel = dma::Channel::new(self.channel.clone_unchecked(), self.interrupts);
            let data = pac::DCMI.dr().as_ptr().cast();
            let lines = &mut *self.raw_lines;
            ReadableRingBuffer::new(channel, request, data, lines, TransferOptions::default())
        };
        self.ring.insert(ring).start();
        critical_section::with(|token| {
            PROGRESS.borrow(token).set(Progress {
                has_ended: false,
                ..Progress::ENDED
            });
        });
        pac::DCMI.icr().write(|clear| {
            clear.set_line_isc(true);
            clear.set_vsync_isc(true);
            clear.set_ovr_isc(true);
            clear.set_frame_isc(true);
        });
        pac::DCMI.ier().write(|enable| {
            enable.set_line_ie(true);
            enable.set_vsync_ie(true);
            enable.set_ovr_ie(true);
        });
        pac::DCMI.cr().modify(|control| {
            control.set_enable(true);
            control.set_capture(true);
        });
    }

    /// Returns the progress of the current frame.
    pub fn progress(&self) -> Progress {
        critical_section::with(|token| PROGRESS.borrow(token).get())
    }

    /// Copies the oldest line that was not read yet. A line stays in the ring until one more line
    /// has been received after it.
    ///
    /// # Errors
    /// [`ErrorKind::Overrun`] if the line was, or may have been, overwritten;
    /// [`ErrorKind::SyncLost`] if it is not complete.
    pub fn read(&mut self, raw: &mut [u32]) -> Result<(), ErrorKind> {
        let ring = self.ring.as_mut().ok_or(ErrorKind::Other)?;
        match ring.read(raw) {
            Ok((words, _)) if words == self.line_words => Ok(()),
            Ok(_) => Err(ErrorKind::SyncLost),
            Err(_) => Err(ErrorKind::Overrun),
        }
    }
}
