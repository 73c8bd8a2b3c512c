//! The camera port, RM0433 chapter 31, as far as the board uses it - 8 bits, hardware syncs, crop -
//! and the two sensors and the multiplexer at its pins.

use std::collections::{BTreeMap, VecDeque};

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::dcmi::{Register, cr};
use rigless::time::{EventId, VirtualNanos};

use crate::fault::Kind;
use crate::sensor::Shared;
use crate::trouble::{Trouble, Troubles};

/// Period of the sensors' clock, of which each brings a byte, ns.
const CLOCK_NS: u64 = 125;
/// How often the pin of the trigger is looked at, ns.
const LOOK_NS: u64 = 20_000;
/// Output register of port D, and the trigger's pin in it.
const TRIGGER_PORT: u64 = 0x5802_0c14;
const TRIGGER_PIN: u64 = 1 << 4;
/// Margin of each view, px and lines, whose bytes are noise.
const MARGIN: usize = 2;
/// Bytes that a short line lacks.
const LACKING: usize = 8;
/// Lines that come at once after a fault that is to be an overrun.
const HASTY_LINES: usize = 4;
/// Depth of the port's FIFO, in words.
const FIFO_WORDS: usize = 4;

// Bits of the raw interrupt status.
const FRAME: u64 = 1;
const OVERRUN: u64 = 1 << 1;
const VSYNC: u64 = 1 << 3;
const LINE: u64 = 1 << 4;

/// The next change of the wires' levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    /// Nothing, until the trigger rises.
    Trigger,
    /// The frame becomes valid.
    Frame,
    /// This line begins.
    Line(usize),
    /// Four bytes of the line from this byte on.
    Bytes(usize, usize),
    /// The frame is no longer valid.
    End,
}

/// Port, sensors' outputs and what happened there.
#[derive(Debug)]
pub struct Port {
    /// Lines as they come over the wires, with their margins.
    lines: Vec<Vec<u8>>,
    sensors: [Shared; 2],
    faults: BTreeMap<usize, (usize, Kind)>,
    troubles: Troubles,
    next: Next,
    due: Option<EventId>,
    is_high: bool,
    is_capturing: bool,
    fifo: VecDeque<u32>,
    word: [u8; 4],
    filled: usize,
    raised: u64,
    interrupt: bool,
    request: bool,
    /// Frames that began, and those that ended.
    pub begun: usize,
    pub ended: usize,
    /// Words that the FIFO had no room for.
    pub overruns: u32,
    /// When frames became valid, ns.
    pub begun_ns: Vec<u64>,
}

impl Port {
    /// A port to which the sensors send `lines` of both views, `width` px each, as every frame.
    pub fn new(
        views: &[u8],
        width: usize,
        sensors: [Shared; 2],
        faults: BTreeMap<usize, (usize, Kind)>,
        troubles: Troubles,
    ) -> Self {
        Self {
            lines: on_the_wires(views, width),
            sensors,
            faults,
            troubles,
            next: Next::Trigger,
            due: None,
            is_high: false,
            is_capturing: false,
            fifo: VecDeque::new(),
            word: [0; 4],
            filled: 0,
            raised: 0,
            interrupt: false,
            request: false,
            begun: 0,
            ended: 0,
            overruns: 0,
            begun_ns: vec![],
        }
    }

    /// The fault of the frame under way at the line, if it has one there.
    fn fault_at(&self, line: usize) -> Option<Kind> {
        let frame = self.begun.checked_sub(1)?;
        let (at, kind) = self.faults.get(&frame)?;
        (at + MARGIN == line).then_some(*kind)
    }

    /// Whether the line comes right after the one before.
    fn is_hasty(&self, line: usize) -> bool {
        (line.saturating_sub(HASTY_LINES)..line).any(|at| self.fault_at(at) == Some(Kind::Overrun))
    }

    fn in_ns(&mut self, wait_ns: u64, next: Next, context: &mut DeviceContext<'_>) {
        self.next = next;
        let at = VirtualNanos(context.now().0 + wait_ns.max(1));
        self.due = Some(context.schedule(at));
    }

    fn take_byte(&mut self, byte: u8) {
        self.word[self.filled] = byte;
        self.filled += 1;
        if self.filled < self.word.len() {
            return;
        }
        self.filled = 0;
        if self.fifo.len() < FIFO_WORDS {
            self.fifo.push_back(u32::from_le_bytes(self.word));
        } else {
            self.raised |= OVERRUN;
            self.overruns += 1;
            self.is_capturing = false;
        }
    }

    /// Sends four bytes of a line, and takes in those within the crop window.
    fn send(&mut self, line: usize, first: usize, registers: &RegisterFile, now_ns: u64) -> usize {
        let start = registers.get(Register::Cwstrt) as usize;
        let size = registers.get(Register::Cwsize) as usize;
        let columns = start & 0x3fff;
        let columns = columns..columns + (size & 0x3fff) + 1;
        let rows = start >> 16 & 0x1fff;
        let rows = rows..rows + (size >> 16 & 0x3fff) + 1;
        let crops = registers.get(Register::Cr) & cr::CROP.mask() != 0;
        let lacking = if self.fault_at(line) == Some(Kind::ShortLine) {
            LACKING
        } else {
            0
        };
        let length = self.lines[line].len() - lacking;
        let end = length.min(first + 4);
        let right_is_there = self.sensors[1].look().is_there(now_ns);
        let is_seen = self.is_capturing && !self.troubles.are(Trouble::LvldLow, now_ns);
        for at in first..end {
            // The views alternate, left first; nobody drives the wires of a sensor that is gone.
            let is_driven = at % 2 == 0 || right_is_there;
            let byte = if is_driven {
                self.lines[line][at]
            } else {
                0xff
            };
            let inside = !crops || rows.contains(&line) && columns.contains(&at);
            if is_seen && inside {
                self.take_byte(byte);
            }
        }
        if end < length { end } else { 0 }
    }

    fn settle(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Ris, self.raised);
        let masked = self.raised & registers.get(Register::Ier);
        registers.set(Register::Mis, masked);
        let in_frame = !matches!(self.next, Next::Trigger | Next::Frame);
        let in_line = matches!(self.next, Next::Bytes(..));
        let waits = !self.fifo.is_empty();
        let status = u64::from(!in_line) | u64::from(!in_frame) << 1 | u64::from(waits) << 2;
        registers.set(Register::Sr, status);
        if (masked != 0) != self.interrupt {
            self.interrupt = masked != 0;
            context.interrupt(0, Level::from(self.interrupt));
        }
        if waits != self.request {
            self.request = waits;
            context.request(0, Level::from(waits));
        }
    }

    /// The frame is over, or torn off: sync, and the end of a capture.
    fn end_frame(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let control = registers.get(Register::Cr);
        self.ended += 1;
        if control & cr::ENABLE.mask() != 0 {
            self.raised |= VSYNC;
        }
        if self.is_capturing {
            self.raised |= FRAME;
            self.is_capturing = false;
            if control & cr::CM.mask() != 0 {
                registers.set(Register::Cr, control & !cr::CAPTURE.mask());
            }
        }
        self.in_ns(LOOK_NS, Next::Trigger, context);
    }
}

impl Device for Port {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        if register != Register::Dr {
            return None;
        }
        let word = self.fifo.pop_front().unwrap_or(0);
        self.settle(registers, context);
        Some(word.into())
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            Register::Icr => self.raised &= !value,
            Register::Cr => {
                let stays = value & cr::ENABLE.mask() != 0 && value & cr::CAPTURE.mask() != 0;
                self.is_capturing &= stays;
                if value & cr::ENABLE.mask() == 0 {
                    self.fifo.clear();
                    self.filled = 0;
                }
                if self.due.is_none() {
                    self.in_ns(LOOK_NS, Next::Trigger, context);
                }
            }
            _ => {}
        }
        self.settle(registers, context);
    }

    /// The trigger's pin, which was asked for.
    fn on_access(
        &mut self,
        _: u64,
        value: u64,
        _: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let is_high = value & TRIGGER_PIN != 0;
        let rose = is_high && !self.is_high;
        self.is_high = is_high;
        let now = context.now().0;
        let mut sensors = self.sensors.each_ref().map(Shared::look);
        let left_answers = sensors[0].is_there(now) && sensors[0].is_armed();
        let exposure_ns = sensors[0].integration_lines() * sensors[0].line_ns(CLOCK_NS);
        drop(sensors);
        // The left sensor's syncs are the ones on the wires.
        if rose && left_answers && !self.troubles.are(Trouble::ClockStuck, now) {
            self.in_ns(exposure_ns, Next::Frame, context);
        } else {
            self.in_ns(LOOK_NS, Next::Trigger, context);
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.due != Some(event) {
            return;
        }
        self.due = None;
        let now = context.now().0;
        self.troubles.tell(now);
        if self.next != Next::Trigger && self.troubles.are(Trouble::ClockStuck, now) {
            // Sensors and port stand still.
            self.in_ns(LOOK_NS, self.next, context);
            return;
        }
        let is_enabled = registers.get(Register::Cr) & cr::ENABLE.mask() != 0;
        let left_is_there = self.sensors[0].look().is_there(now);
        let line_ns = self.sensors[0].look().line_ns(CLOCK_NS);
        match self.next {
            Next::Trigger => context.read_from(TRIGGER_PORT, Width::W32, 0),
            // Without its sensor the syncs fall.
            _ if !left_is_there => self.end_frame(registers, context),
            Next::Frame => {
                self.begun += 1;
                self.begun_ns.push(now);
                let captures = registers.get(Register::Cr) & cr::CAPTURE.mask() != 0;
                self.is_capturing = is_enabled && captures;
                self.in_ns(line_ns / 2, Next::Line(0), context);
            }
            Next::Line(line) => {
                self.filled = 0;
                match self.fault_at(line) {
                    // The sensor hangs within its frame, until it is looked at again.
                    Some(Kind::Timeout) => {
                        self.ended += 1;
                        self.in_ns(LOOK_NS, Next::Trigger, context);
                    }
                    Some(Kind::ShortFrame) => self.end_frame(registers, context),
                    _ => self.in_ns(4 * CLOCK_NS, Next::Bytes(line, 0), context),
                }
            }
            Next::Bytes(line, first) => {
                let rest = self.send(line, first, registers, now);
                if rest > 0 {
                    self.in_ns(4 * CLOCK_NS, Next::Bytes(line, rest), context);
                } else {
                    if is_enabled && !self.troubles.are(Trouble::LvldLow, now) {
                        self.raised |= LINE;
                    }
                    let used_ns = (self.lines[line].len() as u64 + 4) * CLOCK_NS;
                    let pause_ns = if self.is_hasty(line + 1) {
                        4 * CLOCK_NS
                    } else {
                        line_ns.saturating_sub(used_ns)
                    };
                    let next = if line + 1 < self.lines.len() {
                        Next::Line(line + 1)
                    } else {
                        Next::End
                    };
                    self.in_ns(pause_ns, next, context);
                }
            }
            Next::End => self.end_frame(registers, context),
        }
        self.settle(registers, context);
    }

    fn reset(&mut self) {
        self.next = Next::Trigger;
        self.due = None;
        self.is_high = false;
        self.is_capturing = false;
        self.fifo.clear();
        self.filled = 0;
        self.raised = 0;
        self.interrupt = false;
        self.request = false;
    }
}

/// Lines of both views, left then right, as the multiplexer sends them, in a margin of noise.
fn on_the_wires(views: &[u8], width: usize) -> Vec<Vec<u8>> {
    let mut state = 1_u32;
    let mut noise = move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 24) as u8
    };
    let height = views.len() / (2 * width);
    let mut lines = vec![];
    for row in 0..height + 2 * MARGIN {
        let mut line = vec![];
        for column in 0..width + 2 * MARGIN {
            for view in 0..2 {
                let row = row.checked_sub(MARGIN).filter(|row| *row < height);
                let column = column.checked_sub(MARGIN).filter(|column| *column < width);
                line.push(match (row, column) {
                    (Some(row), Some(column)) => views[(2 * row + view) * width + column],
                    _ => noise(),
                });
            }
        }
        lines.push(line);
    }
    lines
}
