//! A session that runs for long: 60,000 frames with 5,000 faults, every counter as a model says,
//! and no memory taken after the start.

use std::cell::Cell;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::{Config, DisparityLine, DisparityRange, Matcher, Portable, Preset};
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::scripted::{FaultKind, FaultyCamera, ScriptedFault};
use vgstereo_firmware::session::memory_words;
use vgstereo_firmware::sink::{DisparitySink, FrameInfo};
use vgstereo_firmware::{Event, Fault, Session, Statistics, Watchdog};
use vgstereo_tests::faults::{SmallCamera, count_fault, count_whole_frames};

const HEIGHT: u32 = 4;
const FRAMES: u32 = 60_000;
/// One frame in so many, at most, has a fault, so that the frame after it is whole.
const FRAMES_PER_FAULT: u32 = 12;

/// Counts the whole frames that differ from the first.
#[derive(Default)]
struct Comparison {
    /// Disparities of the first frame and of the one under way, 1/16 px.
    first_q4: Vec<i16>,
    line_q4: Vec<i16>,
    differing: u32,
}

impl Comparison {
    fn with_room() -> Self {
        let pixels = HEIGHT as usize * usize::from(SmallCamera::WIDTH);
        Self {
            first_q4: Vec::with_capacity(pixels),
            line_q4: Vec::with_capacity(pixels),
            ..Self::default()
        }
    }
}

impl DisparitySink for Comparison {
    type Error = std::convert::Infallible;

    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Self::Error> {
        self.line_q4.clear();
        Ok(())
    }

    fn line(&mut self, _: u32, line: &DisparityLine<'_>) -> Result<(), Self::Error> {
        self.line_q4.extend_from_slice(line.disparities_q4);
        Ok(())
    }

    fn end_frame(&mut self, _: &FrameInfo) -> Result<(), Self::Error> {
        if self.first_q4.is_empty() {
            self.first_q4.extend_from_slice(&self.line_q4);
        }
        self.differing += u32::from(self.line_q4 != self.first_q4);
        Ok(())
    }

    fn abort_frame(&mut self, _: u32, _: Fault) {}
}

struct Meals<'a>(&'a Cell<u32>);

impl Watchdog for Meals<'_> {
    fn feed(&mut self) {
        self.0.set(self.0.get() + 1);
    }
}

#[test]
fn a_long_run_with_faults_counts_exactly_and_takes_no_memory() {
    let mut generator = Pcg32::seed_from_u64(3);
    let mut below = |limit: usize| generator.next_u32() as usize % limit;
    let mut expected = Statistics::default();
    let script: Vec<_> = (0..FRAMES / FRAMES_PER_FAULT)
        .map(|fault| {
            let frame = 1 + fault * FRAMES_PER_FAULT + below(FRAMES_PER_FAULT as usize - 2) as u32;
            let line = below(HEIGHT as usize) as u32;
            let kind = FaultKind::ALL[below(FaultKind::ALL.len())];
            count_fault(&mut expected, HEIGHT, line, kind);
            ScriptedFault { frame, line, kind }
        })
        .collect();
    let faults = script.len() as u32;
    count_whole_frames(&mut expected, HEIGHT, FRAMES - faults);

    let config = Config::new(
        Preset::Lite.parameters(),
        SmallCamera::WIDTH,
        DisparityRange::up_to(3),
    );
    let camera = FaultyCamera::new(SmallCamera::new(HEIGHT), script);
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let meals = Cell::new(0);
    let mut sink = Comparison::with_room();
    let watchdog = Meals(&meals);
    let mut session =
        Session::with_watchdog(camera, matcher, &mut sink, &mut lines, watchdog).unwrap();
    let mut steps = 0;
    let allocated = allocation_counter::measure(|| {
        loop {
            steps += 1;
            if let Ok(Event::FrameDone { frame }) = session.step()
                && frame + 1 == FRAMES
            {
                break;
            }
        }
    });
    assert_eq!(allocated.count_total, 0, "{allocated:?}");
    assert!(steps > 100_000, "{steps}");
    assert_eq!(session.statistics(), expected);
    // No fault lasts until patience ends.
    assert_eq!(meals.get(), expected.lines);
    assert_eq!(sink.differing, 0);
}
