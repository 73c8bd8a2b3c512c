//! One sink that is two.

use vgstereo_core::{DisparityLine, Line};

use super::{DisparitySink, FrameInfo, Needs};
use crate::camera::LinePair;
use crate::fault::Fault;

/// A sink that gives all that it gets to two others, such as one that sends disparities and one that
/// makes a scan. Their errors are of one type. A frame that one of them does not take is aborted for
/// the other one too, unless that has ended it.
#[derive(Debug)]
pub struct BothSinks<A, B> {
    /// The sink that is called first.
    pub first: A,
    /// The sink that is called when the first one has taken a call.
    pub second: B,
    /// Whether the first one has ended the frame that was begun last.
    first_is_done: bool,
}

impl<A: DisparitySink, B: DisparitySink<Error = A::Error>> BothSinks<A, B> {
    /// Joins two sinks.
    #[must_use]
    pub fn new(first: A, second: B) -> Self {
        Self {
            first,
            second,
            first_is_done: true,
        }
    }
}

impl<A: DisparitySink, B: DisparitySink<Error = A::Error>> DisparitySink for BothSinks<A, B> {
    type Error = A::Error;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.first.begin_frame(info)?;
        self.first_is_done = false;
        let begun = self.second.begin_frame(info);
        if begun.is_err() {
            // The frame counts as not begun: nobody else will abort it.
            self.first.abort_frame(info.frame, Fault::Sink);
        }
        begun
    }

    fn needs(&self) -> Needs {
        self.first.needs().or(self.second.needs())
    }

    fn raw_pair(&mut self, pair: &LinePair, lines: [&[u8]; 2]) {
        self.first.raw_pair(pair, lines);
        self.second.raw_pair(pair, lines);
    }

    fn rectified_pair(&mut self, frame: u32, line: u32, lines: [&dyn Line; 2]) {
        self.first.rectified_pair(frame, line, lines);
        self.second.rectified_pair(frame, line, lines);
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        self.first.line(frame, line)?;
        self.second.line(frame, line)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Self::Error> {
        self.first.end_frame(info)?;
        self.first_is_done = true;
        self.second.end_frame(info)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        if !self.first_is_done {
            self.first.abort_frame(frame, fault);
        }
        self.second.abort_frame(frame, fault);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;
    use vgstereo_core::Region;

    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Call {
        Begin,
        Line,
        End,
        Abort,
    }

    /// Notes each call and fails at `fails`.
    struct Sink {
        calls: Vec<Call>,
        fails: Option<Call>,
    }

    impl Sink {
        fn note(&mut self, call: Call) -> Result<(), ()> {
            self.calls.push(call);
            if self.fails == Some(call) {
                Err(())
            } else {
                Ok(())
            }
        }
    }

    impl DisparitySink for Sink {
        type Error = ();

        fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), ()> {
            self.note(Call::Begin)
        }

        fn line(&mut self, _: u32, _: &DisparityLine<'_>) -> Result<(), ()> {
            self.note(Call::Line)
        }

        fn end_frame(&mut self, _: &FrameInfo) -> Result<(), ()> {
            self.note(Call::End)
        }

        fn abort_frame(&mut self, _: u32, _: Fault) {
            self.calls.push(Call::Abort);
        }
    }

    /// The calls of both sinks for a frame of one line, aborted as a session does it.
    fn calls(fails: [Option<Call>; 2]) -> [Vec<Call>; 2] {
        let [mut first, mut second] = fails.map(|fails| Sink {
            calls: Vec::new(),
            fails,
        });
        let mut both = BothSinks::new(&mut first, &mut second);
        let info = FrameInfo {
            frame: 3,
            timestamp_us: 0,
            region: Region::whole(1),
        };
        let line = DisparityLine {
            line: 0,
            column: 0,
            disparities_q4: &[0],
            confidences: &[1],
        };
        if both.begin_frame(&info).is_ok() {
            let ended = both.line(3, &line).and_then(|()| both.end_frame(&info));
            if ended.is_err() {
                both.abort_frame(3, Fault::Sink);
            }
        }
        [first.calls, second.calls]
    }

    #[test]
    fn each_frame_that_a_sink_began_has_one_end() {
        use Call::{Abort, Begin, End, Line};
        let whole = [Begin, Line, End].as_slice();
        for (first, second, expected) in [
            (None, None, [whole, whole]),
            (Some(Begin), None, [&[Begin], &[]]),
            (None, Some(Begin), [&[Begin, Abort], &[Begin]]),
            (Some(Line), None, [&[Begin, Line, Abort], &[Begin, Abort]]),
            (
                None,
                Some(Line),
                [&[Begin, Line, Abort], &[Begin, Line, Abort]],
            ),
            (
                Some(End),
                None,
                [&[Begin, Line, End, Abort], &[Begin, Line, Abort]],
            ),
            (None, Some(End), [whole, &[Begin, Line, End, Abort]]),
        ] {
            assert_eq!(calls([first, second]), expected, "{first:?} {second:?}");
        }
    }
}
