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
use embassy_stm32::dcmi::{Dcmi, FrameDma};
use embassy_stm32::dma::{self, ReadableRingBuffer, TransferOptions};
use embassy_stm32::interrupt::typelevel::{DCMI as PortInterrupt, Handler};
use embassy_stm32::pac;
use embassy_stm32::peripherals::{DCMI, DMA1_CH0};
use vgstereo_firmware::camera::ErrorKind;

use crate::{GEOMETRY, Interrupts, LAYOUT};

/// Bytes per raw line, which holds one line of each view.
const RAW_BYTES: usize = LAYOUT.raw_bytes(GEOMETRY.format, GEOMETRY.width);
/// Words per raw line: the port packs four bytes into a word.
pub const RAW_WORDS: usize = RAW_BYTES.div_ceil(4);
/// Margin that the sensors send on each side of the geometry: pixels of each view, and lines.
const MARGIN: u32 = 2;
/// Number of pixel clocks of the left margin.
const MARGIN_CLOCKS: u32 = 2 * MARGIN * GEOMETRY.format.bytes_per_pixel() as u32;

/// Stream of the DMA controller that the camera uses: that of `DMA1_CH0`.
const STREAM: usize = 0;

const _: () = assert!(LAYOUT.lines_per_pair() == 1, "a raw line must be a pair");

/// Progress of the current frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of line syncs so far.
    syncs: u32,
    /// Whether the frame sync has ended the frame.
    pub has_ended: bool,
    /// First fault in the frame.
    pub fault: Option<ErrorKind>,
}

impl Progress {
    const ENDED: Self = Self {
        syncs: 0,
        has_ended: true,
        fault: None,
    };

    /// Number of complete lines of the geometry received so far.
    pub fn lines(&self) -> u32 {
        self.syncs.saturating_sub(MARGIN).min(GEOMETRY.height)
    }
}

/// Progress of the current frame, written by the interrupt, and by [`Capture::begin_frame`].
static PROGRESS: Mutex<Cell<Progress>> = Mutex::new(Cell::new(Progress::ENDED));

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
            let cell = PROGRESS.borrow(token);
            let mut progress = cell.get();
            let mut fault = events.ovr_mis().then_some(ErrorKind::Overrun);
            if events.line_mis() && !progress.has_ended {
                progress.syncs = progress.syncs.saturating_add(1);
                // Words until the end of the ring, which is all of it after an even number of
                // lines.
                let whole = 2 - progress.lines() as usize % 2;
                let left = pac::DMA1.st(STREAM).ndtr().read().ndt();
                if usize::from(left) != whole * RAW_WORDS {
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

/// The camera port and its ring of lines.
pub struct Capture {
    _port: Dcmi<'static, DCMI>,
    channel: Peri<'static, DMA1_CH0>,
    ring: Option<ReadableRingBuffer<'static, u32>>,
    raw_lines: *mut [u32],
}

impl Capture {
    /// Sets up an idle port. `raw_lines` holds two raw lines, in memory that DMA1 reaches and that
    /// is not cached.
    pub fn new(
        port: Dcmi<'static, DCMI>,
        channel: Peri<'static, DMA1_CH0>,
        raw_lines: &'static mut [u32],
    ) -> Self {
        pac::DCMI.cr().modify(|control| {
            control.set_cm(true);
            control.set_crop(true);
        });
        pac::DCMI.cwstrt().write(|start| {
            start.set_hoffcnt(MARGIN_CLOCKS as u16);
            start.set_vst(MARGIN as u16);
        });
        pac::DCMI.cwsize().write(|size| {
            size.set_capcnt((4 * RAW_WORDS - 1) as u16);
            size.set_vline((GEOMETRY.height - 1) as u16);
        });
        Self {
            _port: port,
            channel,
            ring: None,
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
            let channel = dma::Channel::new(self.channel.clone_unchecked(), Interrupts);
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
    pub fn read(&mut self, raw: &mut [u32; RAW_WORDS]) -> Result<(), ErrorKind> {
        let ring = self.ring.as_mut().ok_or(ErrorKind::Other)?;
        match ring.read(raw) {
            Ok((RAW_WORDS, _)) => Ok(()),
            Ok(_) => Err(ErrorKind::SyncLost),
            Err(_) => Err(ErrorKind::Overrun),
        }
    }
}
