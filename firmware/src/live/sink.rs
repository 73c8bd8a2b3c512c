//! The sink of a live session: lines of all kinds to the host.

use core::convert::Infallible;

use vgstereo_core::geometry::Depth;
use vgstereo_core::{DisparityLine, INVALID, Line};
use vgstereo_link::board::{self, FrameBegun};
use vgstereo_link::{BoardMessage, PixelFormat, Reason, Region, Selection, Streams, Values};

use super::port::LinkPort;
use super::sender::{End, Sender};
use crate::camera::{ErrorKind, LinePair};
use crate::fault::Fault;
use crate::sink::{DisparitySink, FrameInfo, Needs};

/// Sends what the host has selected of each frame.
#[derive(Debug)]
pub(super) struct LinkSink<'m, P> {
    pub(super) sender: Sender<'m, P>,
    depth: Option<Depth>,
    /// Number of the camera's last line.
    last_line: u32,
    /// A line of depths, or of disparities of which some were left out.
    values: &'m mut [u16],
    /// A rectified line of each view.
    levels: &'m mut [u8],
    /// What is sent of the frame that was begun last; no streams if none is.
    frame: Selection,
    /// Number of frames that were left out since one was sent.
    skipped: u16,
}

impl<'m, P: LinkPort> LinkSink<'m, P> {
    /// `values` has a place for each matched column, `levels` two.
    pub(super) fn new(
        sender: Sender<'m, P>,
        depth: Option<Depth>,
        last_line: u32,
        values: &'m mut [u16],
        levels: &'m mut [u8],
    ) -> Self {
        Self {
            sender,
            depth,
            last_line,
            values,
            levels,
            frame: NOTHING,
            // The first frame is sent.
            skipped: u16::MAX,
        }
    }

    /// Whether a line is inside of the region that is sent.
    fn has_line(&self, line: u32) -> bool {
        self.frame
            .region
            .is_none_or(|region| line.wrapping_sub(region.y_lines) < region.height_lines)
    }

    /// The columns of a line from `column` on that are sent, as a range of its `count` values.
    fn columns(&self, column: u16, count: usize) -> core::ops::Range<usize> {
        let Some(region) = self.frame.region else {
            return 0..count;
        };
        let first = usize::from(region.x_px.saturating_sub(column)).min(count);
        let end = usize::from(region.x_px) + usize::from(region.width_px);
        let end = end.saturating_sub(column.into()).clamp(first, count);
        first..end
    }

    fn sends(&self, streams: Streams) -> bool {
        self.frame.streams.contains(streams)
    }

    fn end(&mut self, frame: u32, end: End) {
        if self.frame.streams != Streams::NONE {
            // A frame whose beginning was not sent has no end.
            if self.sender.owed.begun.take().is_none() {
                self.sender.owed.end = Some((frame, end));
            }
            self.frame = NOTHING;
        }
        self.sender.settle();
    }
}

/// What is sent of a frame that is left out.
const NOTHING: Selection = Selection::whole(Streams::NONE);

impl<P: LinkPort> DisparitySink for LinkSink<'_, P> {
    type Error = Infallible;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Infallible> {
        self.sender.end_gap();
        let state = self.sender.state;
        self.frame = NOTHING;
        if !state.is_started || state.selection.streams == Streams::NONE {
            self.sender.settle();
            return Ok(());
        }
        self.skipped = self.skipped.saturating_add(1);
        if self.skipped < state.selection.every_frames {
            let counters = &mut self.sender.counters;
            counters.frames_decimated = counters.frames_decimated.saturating_add(1);
            self.sender.settle();
            return Ok(());
        }
        self.skipped = 0;
        self.frame = state.selection;
        let whole = Region {
            x_px: info.region.x,
            y_lines: info.region.y,
            width_px: info.region.width,
            height_lines: info.region.height,
        };
        self.sender.owed.begun = Some(FrameBegun {
            frame: info.frame,
            timestamp_us: info.timestamp_us,
            region: state
                .selection
                .region
                .map_or(whole, |part| common(whole, part)),
        });
        self.sender.settle();
        Ok(())
    }

    fn needs(&self) -> Needs {
        let matched = [Streams::DISPARITIES, Streams::CONFIDENCES, Streams::DEPTHS];
        Needs {
            rectified: self.sends(Streams::RECTIFIED),
            disparities: matched.into_iter().any(|stream| self.sends(stream)),
        }
    }

    fn raw_pair(&mut self, pair: &LinePair, [left, right]: [&[u8]; 2]) {
        if self.sends(Streams::RAW) && self.has_line(pair.line) {
            self.sender
                .send_line(&BoardMessage::RawPair(board::LinePair {
                    frame: pair.frame,
                    line: pair.line,
                    format: self.sender.hello.raw.format,
                    left,
                    right,
                }));
        } else {
            self.sender.settle();
        }
        if pair.line == self.last_line {
            self.sender.begin_gap();
        }
    }

    fn rectified_pair(&mut self, frame: u32, line: u32, lines: [&dyn Line; 2]) {
        if !self.has_line(line) {
            return;
        }
        let half = self.levels.len() / 2;
        let Some((left, right)) = self.levels.split_at_mut_checked(half) else {
            return;
        };
        for (row, line) in [&mut *left, &mut *right].into_iter().zip(lines) {
            line.write_grey(row);
        }
        self.sender
            .send_line(&BoardMessage::RectifiedPair(board::LinePair {
                frame,
                line,
                format: PixelFormat::Grey8,
                left,
                right,
            }));
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Infallible> {
        if !self.has_line(line.line) {
            return Ok(());
        }
        let columns = self.columns(line.column, line.disparities_q4.len());
        // Both are within the line.
        let column = line.column.saturating_add(columns.start as u16);
        let disparities_q4 = line.disparities_q4.get(columns.clone()).unwrap_or_default();
        let confidences = line.confidences.get(columns).unwrap_or_default();
        fn sent<T>(frame: u32, line: u32, column: u16, values: &[T]) -> vgstereo_link::Line<'_, T> {
            let values = Values::Plain(values);
            vgstereo_link::Line {
                frame,
                line,
                column,
                values,
            }
        }
        let confidence_min = self.sender.state.parameters.confidence_min.unwrap_or(0);
        if self.sends(Streams::DISPARITIES) {
            let mut sure_q4 = disparities_q4;
            let kept = bytemuck::cast_slice_mut::<u16, i16>(self.values);
            if confidence_min > 0
                && let Some(kept) = kept.get_mut(..disparities_q4.len())
            {
                for ((kept, &q4), &confidence) in
                    kept.iter_mut().zip(disparities_q4).zip(confidences)
                {
                    *kept = if confidence < confidence_min {
                        INVALID
                    } else {
                        q4
                    };
                }
                sure_q4 = kept;
            }
            let message = sent(frame, line.line, column, sure_q4);
            self.sender.send_line(&BoardMessage::Disparities(message));
        }
        if self.sends(Streams::CONFIDENCES) {
            let message = sent(frame, line.line, column, confidences);
            self.sender.send_line(&BoardMessage::Confidences(message));
        }
        if let (true, Some(depth)) = (self.sends(Streams::DEPTHS), self.depth)
            && let Some(depths_mm) = self.values.get_mut(..disparities_q4.len())
        {
            for ((depth_mm, &q4), &confidence) in
                depths_mm.iter_mut().zip(disparities_q4).zip(confidences)
            {
                *depth_mm = if confidence < confidence_min {
                    0
                } else {
                    depth.mm(q4)
                };
            }
            let message = sent(frame, line.line, column, depths_mm);
            self.sender.send_line(&BoardMessage::Depths(message));
        }
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Infallible> {
        self.end(info.frame, End::Done);
        Ok(())
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        self.sender.end_gap();
        self.end(frame, End::Aborted(fault.into()));
    }
}

/// What two regions have in common.
fn common(a: Region, b: Region) -> Region {
    let x_px = a.x_px.max(b.x_px);
    let y_lines = a.y_lines.max(b.y_lines);
    let right = |region: Region| region.x_px.saturating_add(region.width_px);
    let bottom = |region: Region| region.y_lines.saturating_add(region.height_lines);
    Region {
        x_px,
        y_lines,
        width_px: right(a).min(right(b)).saturating_sub(x_px),
        height_lines: bottom(a).min(bottom(b)).saturating_sub(y_lines),
    }
}

impl From<Fault> for Reason {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Camera(ErrorKind::Overrun) => Self::CameraOverrun,
            Fault::Camera(ErrorKind::SyncLost) => Self::CameraSyncLost,
            Fault::Camera(ErrorKind::ShortLine) => Self::CameraShortLine,
            Fault::Camera(ErrorKind::ShortFrame) => Self::CameraShortFrame,
            Fault::Camera(ErrorKind::Timeout) => Self::CameraTimeout,
            Fault::Camera(ErrorKind::Bus) => Self::CameraBus,
            Fault::Camera(_) => Self::CameraOther,
            Fault::Sequence => Self::Sequence,
            Fault::Rectifier(_) => Self::Rectifier,
            Fault::Matcher(_) => Self::Matcher,
            Fault::Sink => Self::Sink,
            Fault::Stopped => Self::Stopped,
        }
    }
}
