//! What faults cost: frames that come whole out of 1,000, for each kind of fault and each rate.
//!
//! A model says which frames a script of faults breaks, and the session must deliver all others,
//! with the disparities of an undisturbed frame. The table of the counts is stored in
//! `tests/snapshots/faults.txt` and shown in `docs/boards.md`. When it changes for a reason,
//! `UPDATE_EXPECT=1 cargo test -p vgstereo-tests --test faults` stores it anew.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt::Write;
use std::fs;

use expect_test::expect_file;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::{Config, DisparityLine, DisparityRange, Matcher, Portable, Preset};
use vgstereo_firmware::camera::{ErrorType, Geometry, LinePair, LinePairSource};
use vgstereo_firmware::scripted::{FaultKind, FaultyCamera, ScriptedFault};
use vgstereo_firmware::session::memory_words;
use vgstereo_firmware::session::sync::MISSED_FRAMES_MAX;
use vgstereo_firmware::sink::{DisparitySink, FrameInfo};
use vgstereo_firmware::{Event, Fault, Session};
use vgstereo_sim::sink::{FrameCollector, UnexpectedLine};
use vgstereo_tests::faults::{SmallCamera, stays_whole};

const HEIGHT: u32 = 24;
const FRAMES: u32 = 1000;
/// Lines with a fault, in 1/10,000 of all.
const RATES: [u32; 4] = [1, 10, 100, 1000];

/// What goes wrong at a line.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Scripted(FaultKind),
    /// One bit of the frame's number is wrong.
    FrameNumber,
    /// One bit of the line's number is wrong.
    LineNumber,
    /// The number of pairs lost before is random.
    DroppedCount,
    /// The sink refuses the line of disparities.
    Sink,
}

impl Kind {
    fn all() -> impl Iterator<Item = Self> {
        let others = [
            Self::FrameNumber,
            Self::LineNumber,
            Self::DroppedCount,
            Self::Sink,
        ];
        FaultKind::ALL.map(Self::Scripted).into_iter().chain(others)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Scripted(kind) => kind.name(),
            Self::FrameNumber => "wrong frame number",
            Self::LineNumber => "wrong line number",
            Self::DroppedCount => "wrong count of lost lines",
            Self::Sink => "error of the sink",
        }
    }
}

/// A fault at a line of a frame. `random` chooses the wrong bit or number.
#[derive(Debug, Clone, Copy)]
struct Strike {
    frame: u32,
    line: u32,
    random: u32,
}

impl Strike {
    fn bit(self) -> u32 {
        1 << (self.random % 32)
    }
}

/// Faults at `rate` of all lines, at random, ordered by place.
fn strikes(rate: u32, seed: u64) -> Vec<Strike> {
    let mut generator = Pcg32::seed_from_u64(seed);
    let lines = FRAMES * HEIGHT;
    let mut strikes = BTreeMap::new();
    while strikes.len() < (lines * rate / 10_000) as usize {
        let at = generator.next_u32() % lines;
        let strike = Strike {
            frame: at / HEIGHT,
            line: at % HEIGHT,
            random: generator.next_u32(),
        };
        strikes.insert(at, strike);
    }
    strikes.into_values().collect()
}

/// The frames that do not come whole, from the script alone.
fn broken_frames(kind: Kind, strikes: &[Strike]) -> BTreeSet<u32> {
    let mut broken = BTreeSet::new();
    for strike in strikes {
        let Strike { frame, line, .. } = *strike;
        match kind {
            Kind::DroppedCount => {}
            Kind::Scripted(kind) if stays_whole(HEIGHT, line, kind) => {}
            Kind::Scripted(_) | Kind::LineNumber | Kind::Sink => {
                broken.insert(frame);
            }
            Kind::FrameNumber => {
                broken.insert(frame);
                // The next frame has begun with a last line, and so not with line 0.
                if line + 1 == HEIGHT && frame ^ strike.bit() == frame + 1 {
                    broken.insert(frame + 1);
                }
            }
        }
    }
    broken.retain(|frame| *frame < FRAMES);
    broken
}

/// A camera that makes numbers wrong.
struct WrongNumbers<C> {
    camera: C,
    kind: Kind,
    strikes: HashMap<(u32, u32), Strike>,
}

impl<C: ErrorType> ErrorType for WrongNumbers<C> {
    type Error = C::Error;
}

impl<C: LinePairSource> LinePairSource for WrongNumbers<C> {
    fn geometry(&self) -> Geometry {
        self.camera.geometry()
    }

    fn read_pair(&mut self, left: &mut [u8], right: &mut [u8]) -> Result<LinePair, C::Error> {
        let mut pair = self.camera.read_pair(left, right)?;
        if let Some(strike) = self.strikes.get(&(pair.frame, pair.line)) {
            match self.kind {
                Kind::FrameNumber => pair.frame ^= strike.bit(),
                Kind::LineNumber => pair.line ^= strike.bit(),
                Kind::DroppedCount => pair.dropped = strike.random,
                Kind::Scripted(_) | Kind::Sink => {}
            }
        }
        Ok(pair)
    }
}

/// A collector of frames that refuses some lines.
struct RefusingSink {
    collector: FrameCollector,
    refused: HashMap<(u32, u32), Strike>,
}

impl DisparitySink for RefusingSink {
    type Error = UnexpectedLine;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), UnexpectedLine> {
        self.collector.begin_frame(info)
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), UnexpectedLine> {
        if self.refused.contains_key(&(frame, line.line)) {
            return Err(UnexpectedLine);
        }
        self.collector.line(frame, line)
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), UnexpectedLine> {
        self.collector.end_frame(info)
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        self.collector.abort_frame(frame, fault);
    }
}

/// The frames that come whole, each with its disparities in 1/16 px.
fn delivered(kind: Kind, strikes: &[Strike]) -> Vec<(u32, Vec<i16>)> {
    let script: Vec<_> = match kind {
        Kind::Scripted(kind) => strikes
            .iter()
            .map(|&Strike { frame, line, .. }| ScriptedFault { frame, line, kind })
            .collect(),
        _ => vec![],
    };
    let by_place = strikes
        .iter()
        .map(|strike| ((strike.frame, strike.line), *strike));
    let by_place: HashMap<_, _> = by_place.collect();
    let camera = WrongNumbers {
        camera: FaultyCamera::new(SmallCamera::new(HEIGHT), script),
        kind,
        strikes: by_place.clone(),
    };
    let sink = RefusingSink {
        collector: FrameCollector::new(),
        refused: if kind == Kind::Sink {
            by_place
        } else {
            HashMap::new()
        },
    };
    let mut parameters = Preset::PaperRaw.parameters();
    parameters.synapses = 32;
    let config = Config::new(parameters, SmallCamera::WIDTH, DisparityRange::up_to(3));
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; memory_words(&camera.geometry())];
    let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let mut session = Session::new(camera, matcher, sink, &mut lines).unwrap();
    let mut frames = vec![];
    loop {
        if let Ok(Event::FrameDone { frame }) = session.step() {
            if frame >= FRAMES {
                // A wrong number adds no more than is stated; with repeated frames the camera
                // delivers twice as many lines.
                let statistics = session.statistics();
                let wrong = strikes.len() as u32 * (MISSED_FRAMES_MAX + 2);
                assert!(
                    statistics.frames_dropped <= FRAMES + wrong,
                    "{kind:?}: {statistics:?}"
                );
                let lines = statistics.lines + statistics.lines_dropped;
                assert!(lines <= 3 * FRAMES * HEIGHT, "{kind:?}: {statistics:?}");
                return frames;
            }
            let whole = session.sink_mut().collector.take_frame().unwrap();
            frames.push((frame, whole.disparities_q4));
        }
    }
}

#[test]
fn frames_come_whole_as_a_model_of_the_faults_says() {
    let undisturbed = delivered(Kind::Sink, &[]);
    assert_eq!(undisturbed.len() as u32, FRAMES);
    let (_, expected) = &undisturbed[0];

    let columns = RATES.map(|rate| format!(" {} % |", f64::from(rate) / 100.0));
    let mut table = format!(
        "| fault |{}\n|---|{}\n",
        columns.concat(),
        "---:|".repeat(4)
    );
    for (row, kind) in Kind::all().enumerate() {
        let name = match kind {
            Kind::Scripted(_) => format!("`{}`", kind.name()),
            _ => kind.name().to_owned(),
        };
        write!(table, "| {name} |").unwrap();
        for (column, rate) in RATES.into_iter().enumerate() {
            let strikes = strikes(rate, (row * RATES.len() + column) as u64);
            let broken = broken_frames(kind, &strikes);
            let frames = delivered(kind, &strikes);
            let numbers = frames.iter().map(|(frame, _)| *frame);
            let due = (0..FRAMES).filter(|frame| !broken.contains(frame));
            assert!(numbers.eq(due), "{kind:?} at {rate}/10000");
            for (frame, disparities_q4) in &frames {
                assert!(
                    disparities_q4 == expected,
                    "{kind:?}: frame {frame} differs"
                );
            }
            write!(table, " {} |", frames.len()).unwrap();

            // All lines of a frame must be spared by chance: four deviations of that.
            let spared = (1.0 - f64::from(rate) / 1e4).powi(HEIGHT as i32);
            let mean = f64::from(FRAMES)
                * if kind == Kind::DroppedCount {
                    1.0
                } else {
                    spared
                };
            let deviation = (mean * (1.0 - spared)).sqrt();
            let off = (frames.len() as f64 - mean).abs();
            // The last line may be repeated.
            let repeated = mean * f64::from(rate) / 1e4;
            assert!(
                off <= 4.0 * deviation + repeated,
                "{kind:?} at {rate}/10000: {off}"
            );
        }
        table.push('\n');
    }
    expect_file!["../snapshots/faults.txt"].assert_eq(&table);
}

#[test]
fn the_documents_show_the_stored_table() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let table = fs::read_to_string(format!("{root}/tests/snapshots/faults.txt")).unwrap();
    let page = fs::read_to_string(format!("{root}/docs/boards.md")).unwrap();
    assert!(page.contains(&table), "docs/boards.md must show:\n{table}");
}
