//! The session under every fault of a camera or a sink.

use std::cell::Cell;

use image::{DynamicImage, GrayImage, RgbImage};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::{
    Config, DisparityLine, DisparityRange, INVALID, LineOffsets, Matcher, Method, Output, Portable,
    Preset, Region,
};
use vgstereo_firmware::camera::{
    ErrorKind, ErrorType, Geometry, Layout, LinePair, LinePairSource, PixelFormat,
};
use vgstereo_firmware::live::{self, LinkPort, Live, Next, NoStore, Setup};
use vgstereo_firmware::scripted::{FaultKind, FaultyCamera, ScriptedFault};
use vgstereo_firmware::session::{
    ATTEMPT_FRAMES, PATIENCE_FRAMES, RunError, SessionError, memory_words,
};
use vgstereo_firmware::{
    DisparitySink, Event, Fault, FrameInfo, NoWatchdog, Session, Statistics, Watchdog,
};
use vgstereo_link::{BoardMessage, Decoder, Encoder, HostMessage, Selection, Source, Streams};
use vgstereo_sim::camera::{LINE_PERIOD_US, SimulatedCamera};
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::scene::Scene;
use vgstereo_sim::sink::FrameCollector;
use vgstereo_tests::Pair;
use vgstereo_tests::faults::{count_fault, count_whole_frames, error_counter};

const WIDTH: u16 = 21;
const HEIGHT: u32 = 14;

const ERROR_KINDS: [ErrorKind; 7] = [
    ErrorKind::Overrun,
    ErrorKind::SyncLost,
    ErrorKind::ShortLine,
    ErrorKind::ShortFrame,
    ErrorKind::Timeout,
    ErrorKind::Bus,
    ErrorKind::Other,
];

fn fault_kinds() -> Vec<FaultKind> {
    let mut kinds = vec![
        FaultKind::DroppedLine,
        FaultKind::DuplicatedLine,
        FaultKind::LostSync,
        FaultKind::Truncated,
        FaultKind::DuplicatedFrame,
    ];
    kinds.extend(ERROR_KINDS.map(FaultKind::Error));
    kinds
}

/// A configuration with every stage of the paper's method: 10 lines of latency, fewer than the
/// frame has.
fn config() -> Config {
    let mut parameters = Preset::Paper.parameters().with_sigma(1.0);
    parameters.synapses = 32;
    if let Method::Recall(recall) = &mut parameters.method {
        recall.median_reach_px = 2;
    }
    Config::new(parameters, WIDTH, DisparityRange::up_to(6))
}

/// The configuration of [`config`] for a camera of another pixel format.
fn config_in(format: PixelFormat) -> Config {
    Config {
        colour: !format.is_grey(),
        ..config()
    }
}

/// A textured pair of views; the right one is shifted 3 px to the left and has some noise.
fn colours(height: u32) -> (RgbImage, RgbImage) {
    let mut generator = Pcg32::seed_from_u64(20);
    let mut random = |_, _| image::Rgb([0; 3].map(|_: u8| generator.next_u32() as u8));
    let scene = RgbImage::from_fn(u32::from(WIDTH) + 3, height, &mut random);
    let noise = RgbImage::from_fn(u32::from(WIDTH) + 3, height, &mut random);
    let left = RgbImage::from_fn(WIDTH.into(), height, |x, y| *scene.get_pixel(x, y));
    let right = RgbImage::from_fn(WIDTH.into(), height, |x, y| {
        let (mut pixel, noise) = (*scene.get_pixel(x + 3, y), noise.get_pixel(x, y));
        pixel.0[1] ^= noise.0[1] & 7;
        pixel
    });
    (left, right)
}

fn camera(height: u32, layout: Layout, format: PixelFormat) -> SimulatedCamera {
    let (left, right) = colours(height);
    SimulatedCamera::new(left, right, layout, format).unwrap()
}

fn grey_camera() -> SimulatedCamera {
    camera(HEIGHT, Layout::SideBySide, PixelFormat::Grey8)
}

/// Returns the luma of an image after it has passed through a pixel format.
fn grey(format: PixelFormat, image: &RgbImage) -> GrayImage {
    let luma = |[red, green, blue]: [u32; 3]| (77 * red + 150 * green + 29 * blue + 128) >> 8;
    GrayImage::from_fn(image.width(), image.height(), |x, y| {
        let rgb = image.get_pixel(x, y).0.map(u32::from);
        let rgb = if format == PixelFormat::Rgb565 {
            let five_bits = |value| (value >> 3 << 3) | (value >> 5);
            let six_bits = |value| (value >> 2 << 2) | (value >> 6);
            [five_bits(rgb[0]), six_bits(rgb[1]), five_bits(rgb[2])]
        } else {
            rgb
        };
        image::Luma([u8::try_from(luma(rgb)).unwrap()])
    })
}

/// Returns the frame that the matcher alone computes from grey views.
fn direct(config: &Config, left: &GrayImage, right: &GrayImage) -> Vec<i16> {
    let mut memory = vec![0; config.memory_words()];
    let mut matcher = Matcher::new(config, Portable, &mut memory).unwrap();
    let mut frame = Vec::new();
    let width = usize::from(config.width);
    let lines = left.chunks_exact(width).zip(right.chunks_exact(width));
    for (left, right) in lines {
        if let Some(line) = matcher.push(left, right).unwrap() {
            frame.extend_from_slice(line.disparities_q4);
        }
    }
    while let Some(line) = matcher.finish() {
        frame.extend_from_slice(line.disparities_q4);
    }
    frame
}

/// Returns the frame of [`grey_camera`] without faults.
fn undisturbed() -> Vec<i16> {
    let (left, right) = colours(HEIGHT);
    let of = |image| grey(PixelFormat::Grey8, image);
    direct(&config(), &of(&left), &of(&right))
}

/// Runs `body` with a session in lent memory of exactly the stated size.
fn with_session<C: LinePairSource, S: DisparitySink, R>(
    config: &Config,
    camera: C,
    sink: S,
    body: impl FnOnce(Session<'_, C, Portable, S>) -> R,
) -> R {
    with_watched_session(config, camera, sink, NoWatchdog, body)
}

/// Does what [`with_session`] does, for a session with a watchdog.
fn with_watched_session<C: LinePairSource, S: DisparitySink, W: Watchdog, R>(
    config: &Config,
    camera: C,
    sink: S,
    watchdog: W,
    body: impl FnOnce(Session<'_, C, Portable, S, W>) -> R,
) -> R {
    let mut memory = vec![0; config.memory_words()];
    // The initial content of the lent memory must not matter.
    let mut lines = vec![u32::MAX; memory_words(&camera.geometry())];
    let matcher = Matcher::new(config, Portable, &mut memory).unwrap();
    body(Session::with_watchdog(camera, matcher, sink, &mut lines, watchdog).unwrap())
}

/// Steps the session until frame `last` is done, and asserts that every complete frame equals
/// `expected`.
fn run_until<C: LinePairSource>(
    session: &mut Session<'_, C, Portable, FrameCollector>,
    last: u32,
    expected: &[i16],
) -> Vec<Event> {
    let mut events = Vec::new();
    loop {
        let event = session.step().unwrap();
        events.push(event);
        if let Event::FrameDone { frame } = event {
            let collected = session.sink_mut().take_frame().unwrap();
            assert_eq!(collected.info.frame, frame);
            assert!(
                collected.disparities_q4 == expected,
                "frame {frame} differs"
            );
            if frame == last {
                return events;
            }
        }
        assert!(events.len() < 10_000, "frame {last} never comes");
    }
}

fn scripted(frame: u32, line: u32, kind: FaultKind) -> ScriptedFault {
    ScriptedFault { frame, line, kind }
}

#[test]
fn each_fault_at_each_place_costs_one_frame_and_no_more() {
    let expected_frame = undisturbed();
    for kind in fault_kinds() {
        for line in [0, 1, HEIGHT / 2, HEIGHT - 2, HEIGHT - 1] {
            let camera = FaultyCamera::new(grey_camera(), [scripted(1, line, kind)]);
            with_session(&config(), camera, FrameCollector::new(), |mut session| {
                let events = run_until(&mut session, 2, &expected_frame);

                let mut expected = Statistics::default();
                count_whole_frames(&mut expected, HEIGHT, 2);
                count_fault(&mut expected, HEIGHT, line, kind);
                assert_eq!(session.statistics(), expected, "{kind:?} at line {line}");

                let is_fault =
                    |event: &&Event| matches!(event, Event::Fault(_) | Event::Resync { .. });
                let faults: Vec<_> = events.iter().filter(is_fault).collect();
                let fault = match kind {
                    FaultKind::Error(kind) => Fault::Camera(kind),
                    FaultKind::LostSync => Fault::Camera(ErrorKind::SyncLost),
                    _ => Fault::Sequence,
                };
                let at_once = match kind {
                    FaultKind::Truncated => true,
                    FaultKind::DroppedLine => line == HEIGHT - 1,
                    _ => false,
                };
                let told = if at_once {
                    Event::Resync { frame: 2 }
                } else {
                    Event::Fault(fault)
                };
                assert_eq!(faults, [&told], "{kind:?} at line {line}");

                // A frame of which no pair was matched was not begun at the sink.
                let begun = expected.lines > 2 * HEIGHT && expected.frames_dropped == 1;
                let aborted: &[_] = if begun { &[(1, fault)] } else { &[] };
                assert_eq!(session.sink().aborted(), aborted, "{kind:?} at line {line}");
            });
        }
    }
}

#[test]
fn random_faults_in_every_other_frame_are_counted_exactly() {
    let expected_frame = undisturbed();
    let kinds = fault_kinds();
    for seed in 0..20 {
        println!("seed {seed}");
        let mut generator = Pcg32::seed_from_u64(seed);
        let mut below = |limit: usize| generator.next_u32() as usize % limit;
        let mut expected = Statistics::default();
        let script: Vec<_> = (0..6)
            .map(|fault| {
                let line = below(HEIGHT as usize) as u32;
                let kind = kinds[below(kinds.len())];
                count_fault(&mut expected, HEIGHT, line, kind);
                scripted(2 * fault + 1, line, kind)
            })
            .collect();
        count_whole_frames(&mut expected, HEIGHT, 7);
        let camera = FaultyCamera::new(grey_camera(), script.clone());
        with_session(&config(), camera, FrameCollector::new(), |mut session| {
            run_until(&mut session, 12, &expected_frame);
            assert_eq!(session.statistics(), expected, "seed {seed}: {script:?}");
        });
    }
}

#[test]
fn a_storm_of_faults_ends_with_a_whole_frame() {
    let expected_frame = undisturbed();
    let kinds = fault_kinds();
    for seed in 100..120 {
        println!("seed {seed}");
        let mut generator = Pcg32::seed_from_u64(seed);
        let mut below = |limit: usize| generator.next_u32() as usize % limit;
        let mut script = Vec::new();
        for frame in 1..20 {
            for line in 0..HEIGHT {
                if below(25) == 0 {
                    script.push(scripted(frame, line, kinds[below(kinds.len())]));
                }
            }
        }
        let camera = FaultyCamera::new(grey_camera(), script);
        with_session(&config(), camera, FrameCollector::new(), |mut session| {
            let events = run_until(&mut session, 20, &expected_frame);
            let statistics = session.statistics();
            assert_eq!(
                statistics.frames + statistics.frames_dropped,
                21,
                "seed {seed}"
            );
            let errors: u32 = ERROR_KINDS.map(|kind| statistics.errors(kind)).iter().sum();
            let count = |is: fn(&Event) -> bool| {
                u32::try_from(events.iter().filter(|event| is(event)).count()).unwrap()
            };
            let camera_faults = count(|event| matches!(event, Event::Fault(Fault::Camera(_))));
            assert_eq!(errors, camera_faults, "seed {seed}");
            let breaks = count(|event| {
                matches!(event, Event::Fault(Fault::Sequence) | Event::Resync { .. })
            });
            assert_eq!(statistics.sequence_breaks, breaks, "seed {seed}");
            let matched = count(|event| {
                matches!(
                    event,
                    Event::Line { .. } | Event::FrameDone { .. } | Event::Resync { .. }
                )
            });
            assert_eq!(statistics.lines, matched, "seed {seed}");
            // Each pair that the camera sent is either matched or dropped; repeated pairs are
            // counted too.
            assert!(statistics.lines + statistics.lines_dropped >= 21 * HEIGHT);
        });
    }
}

#[test]
fn every_layout_and_format_gives_the_matchers_own_frame() {
    let config = config();
    let (left, right) = colours(HEIGHT);
    let layouts = [
        Layout::Separate,
        Layout::SideBySide,
        Layout::LineMultiplexed,
        Layout::PixelMultiplexed { phase: 0 },
        Layout::PixelMultiplexed { phase: 1 },
        Layout::PixelMultiplexed { phase: 7 },
    ];
    for format in PixelFormat::ALL {
        let expected = direct(&config, &grey(format, &left), &grey(format, &right));
        for layout in layouts {
            let camera = camera(HEIGHT, layout, format);
            let config = config_in(format);
            with_session(&config, camera, FrameCollector::new(), |mut session| {
                for number in 0..2 {
                    assert_eq!(session.run_frame(), Ok(number));
                    let frame = session.sink_mut().take_frame().unwrap();
                    assert!(frame.disparities_q4 == expected, "{layout:?} {format:?}");
                    let start_us = u64::from(number * HEIGHT) * LINE_PERIOD_US;
                    assert_eq!(frame.info.timestamp_us, start_us);
                }
            });
        }
    }
}

#[test]
fn a_session_holds_two_raw_lines() {
    for format in PixelFormat::ALL {
        let camera = camera(HEIGHT, Layout::Separate, format);
        // Each line starts at a word.
        let line = (usize::from(WIDTH) * format.bytes_per_pixel()).div_ceil(4);
        assert_eq!(memory_words(&camera.geometry()), 2 * line, "{format:?}");
    }
}

/// SGM presets compare colour: the session passes lines on as the camera sends them.
#[test]
fn an_aggregating_matcher_gets_the_cameras_own_lines() {
    let (left, right) = colours(HEIGHT);
    for (format, output) in PixelFormat::ALL
        .into_iter()
        .flat_map(|format| [(format, Output::Dense), (format, Output::Sparse)])
    {
        let disparities = DisparityRange::up_to(6);
        let config = Config {
            colour: !format.is_grey(),
            output,
            ..Config::new(Preset::Micro.parameters(), WIDTH, disparities)
        };
        let mut lines = camera(HEIGHT, Layout::Separate, format);
        let bytes = format.line_bytes(WIDTH);
        let mut pair = Pair {
            format,
            width: WIDTH.into(),
            height: HEIGHT as usize,
            left: Vec::new(),
            right: Vec::new(),
            valid_columns: Default::default(),
        };
        for _ in 0..HEIGHT {
            let (mut left, mut right) = (vec![0; bytes], vec![0; bytes]);
            lines.read_pair(&mut left, &mut right).unwrap();
            pair.left.extend(left);
            pair.right.extend(right);
        }
        if format == PixelFormat::Rgb888 {
            assert!(&pair.left == left.as_raw() && &pair.right == right.as_raw());
        }
        let expected = pair.stream(&config, Portable);
        // Matches of the first columns lie outside the other view.
        assert_eq!(expected.contains(&INVALID), output == Output::Sparse);
        let fault = scripted(1, HEIGHT / 2, FaultKind::LostSync);
        let camera = FaultyCamera::new(camera(HEIGHT, Layout::SideBySide, format), [fault]);
        with_session(&config, camera, FrameCollector::new(), |mut session| {
            run_until(&mut session, 2, &expected);
        });
    }
}

#[test]
fn grey_images_reach_the_matcher_unchanged_in_every_lossless_format() {
    let config = config();
    let (left, right) = colours(HEIGHT);
    let of = |image| grey(PixelFormat::Grey8, image);
    let (left, right) = (of(&left), of(&right));
    let expected = direct(&config, &left, &right);
    for format in [PixelFormat::Grey8, PixelFormat::Rgb888, PixelFormat::Yuv422] {
        let view = |image: &GrayImage| DynamicImage::from(image.clone());
        let (left, right) = (view(&left), view(&right));
        let camera = SimulatedCamera::new(left, right, Layout::Separate, format).unwrap();
        let config = config_in(format);
        with_session(&config, camera, FrameCollector::new(), |mut session| {
            session.run_frame().unwrap();
            let frame = session.sink_mut().take_frame().unwrap();
            assert!(frame.disparities_q4 == expected, "{format:?}");
        });
    }
}

#[test]
fn a_region_ends_with_the_frame() {
    let (left, right) = colours(HEIGHT);
    let of = |image| grey(PixelFormat::Grey8, image);
    for (height, lines) in [(3, 3), (u32::MAX, HEIGHT - 5)] {
        let mut config = config();
        config.region = Region {
            x: 4,
            y: 5,
            width: 9,
            height,
        };
        let expected = direct(&config, &of(&left), &of(&right));
        with_session(
            &config,
            grey_camera(),
            FrameCollector::new(),
            |mut session| {
                session.run_frame().unwrap();
                let frame = session.sink_mut().take_frame().unwrap();
                assert_eq!(frame.info.region.height, lines);
                assert!(frame.disparities_q4 == expected);
            },
        );
    }
}

#[test]
fn a_session_may_begin_amid_a_frame() {
    let expected_frame = undisturbed();
    let mut camera = grey_camera();
    let (mut left, mut right) = ([0; WIDTH as usize], [0; WIDTH as usize]);
    for _ in 0..5 {
        camera.read_pair(&mut left, &mut right).unwrap();
    }
    with_session(
        &config(),
        &mut camera,
        FrameCollector::new(),
        |mut session| {
            let events = run_until(&mut session, 1, &expected_frame);
            assert_eq!(events[0], Event::Skipped { frame: 0, line: 5 });
            let mut expected = Statistics::default();
            count_whole_frames(&mut expected, HEIGHT, 1);
            expected.frames_dropped = 1;
            expected.lines_dropped = HEIGHT - 5;
            assert_eq!(session.statistics(), expected);
        },
    );
}

#[test]
fn a_matcher_left_amid_a_frame_begins_anew() {
    let expected_frame = undisturbed();
    let config = config();
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; 2 * usize::from(WIDTH)];
    let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    matcher
        .push(&[9; WIDTH as usize], &[8; WIDTH as usize])
        .unwrap();
    let mut session =
        Session::new(grey_camera(), matcher, FrameCollector::new(), &mut lines).unwrap();
    run_until(&mut session, 0, &expected_frame);
    let (mut camera, _matcher, sink) = session.into_parts();
    assert!(sink.aborted().is_empty());
    let next = camera.read_pair(&mut [0; WIDTH as usize], &mut [0; WIDTH as usize]);
    assert_eq!(next.map(|pair| (pair.frame, pair.line)), Ok((1, 0)));
}

#[test]
fn frames_of_one_line_are_done_at_once() {
    let (left, right) = colours(1);
    let of = |image| grey(PixelFormat::Grey8, image);
    let expected = direct(&config(), &of(&left), &of(&right));
    let camera = camera(1, Layout::SideBySide, PixelFormat::Grey8);
    let camera = FaultyCamera::new(camera, [scripted(1, 0, FaultKind::DroppedLine)]);
    with_session(&config(), camera, FrameCollector::new(), |mut session| {
        let events = run_until(&mut session, 2, &expected);
        let done = [0, 2].map(|frame| Event::FrameDone { frame });
        assert_eq!(events, done);
        let statistics = session.statistics();
        assert_eq!((statistics.frames, statistics.frames_dropped), (2, 1));
        assert_eq!(
            (statistics.sequence_breaks, statistics.lines_dropped),
            (1, 1)
        );
    });
}

/// A camera that always fails, and counts its reads.
struct DeadCamera {
    kind: ErrorKind,
    reads: u32,
}

impl ErrorType for DeadCamera {
    type Error = ErrorKind;
}

impl LinePairSource for DeadCamera {
    fn geometry(&self) -> Geometry {
        Geometry {
            width: WIDTH,
            height: HEIGHT,
            format: PixelFormat::Grey8,
        }
    }

    fn read_pair(&mut self, _: &mut [u8], _: &mut [u8]) -> Result<LinePair, ErrorKind> {
        self.reads += 1;
        Err(self.kind)
    }
}

#[test]
fn a_dead_camera_ends_the_run_after_the_stated_attempts() {
    for kind in ERROR_KINDS {
        let mut camera = DeadCamera { kind, reads: 0 };
        let reads = ATTEMPT_FRAMES * HEIGHT;
        with_session(
            &config(),
            &mut camera,
            FrameCollector::new(),
            |mut session| {
                let last_fault = Some(Fault::Camera(kind));
                let gave_up = Err(RunError::Attempts { reads, last_fault });
                assert_eq!(session.run_frame(), gave_up);
                let mut expected = Statistics::default();
                *error_counter(&mut expected, kind) = reads;
                assert_eq!(session.statistics(), expected);
                assert!(session.sink().aborted().is_empty());
            },
        );
        assert_eq!(camera.reads, reads);
    }
}

/// A watchdog that counts how often it is fed, in a shared counter.
struct Meals<'a>(&'a Cell<u32>);

impl Watchdog for Meals<'_> {
    fn feed(&mut self) {
        self.0.set(self.0.get() + 1);
    }
}

#[test]
fn the_watchdog_is_fed_once_for_each_line_matched() {
    for kind in fault_kinds() {
        for line in 0..HEIGHT {
            let camera = FaultyCamera::new(grey_camera(), [scripted(1, line, kind)]);
            let (meals, sink) = (Cell::new(0), FrameCollector::new());
            with_watched_session(&config(), camera, sink, Meals(&meals), |mut session| {
                let mut matched = 0;
                while session.statistics().frames_dropped + session.statistics().frames < 3 {
                    let event = session.step().unwrap();
                    let left_out = matches!(event, Event::Fault(_) | Event::Skipped { .. });
                    matched += u32::from(!left_out);
                    assert_eq!(meals.get(), matched, "{kind:?} at line {line}: {event:?}");
                }
                assert_eq!(matched, session.statistics().lines);
            });
        }
    }
}

#[test]
fn the_watchdog_starves_while_the_camera_is_dead() {
    for kind in ERROR_KINDS {
        // The camera fails from line 5 of the second frame on.
        let lines = (1..=1 + ATTEMPT_FRAMES).flat_map(|frame| {
            let first = if frame == 1 { 5 } else { 0 };
            (first..HEIGHT).map(move |line| scripted(frame, line, FaultKind::Error(kind)))
        });
        let camera = FaultyCamera::new(grey_camera(), lines.collect::<Vec<_>>());
        let (meals, sink) = (Cell::new(0), FrameCollector::new());
        with_watched_session(&config(), camera, sink, Meals(&meals), |mut session| {
            assert_eq!(session.run_frame(), Ok(0));
            assert!(session.run_frame().is_err());
            assert_eq!(meals.get(), HEIGHT + 5, "{kind:?}");
        });
    }
}

/// Reads a camera `reads` times and returns how often the watchdog was fed in all and in the last
/// half of the reads.
fn meals<C: LinePairSource>(camera: C, sink: impl DisparitySink, reads: u32) -> (u32, u32) {
    let fed = Cell::new(0);
    let last_half = with_watched_session(&config(), camera, sink, Meals(&fed), |mut session| {
        (0..reads / 2).for_each(|_| drop(session.step()));
        let first_half = fed.get();
        (0..reads / 2).for_each(|_| drop(session.step()));
        fed.get() - first_half
    });
    (fed.get(), last_half)
}

#[test]
fn the_watchdog_starves_when_no_frame_comes_whole() {
    // Each frame takes one read at least, and not many more than it has lines.
    let reads = 4 * PATIENCE_FRAMES * HEIGHT;
    for kind in FaultKind::ALL {
        for line in [1, HEIGHT / 2, HEIGHT - 1] {
            let is_repeat = matches!(kind, FaultKind::DuplicatedLine | FaultKind::DuplicatedFrame);
            if is_repeat && line == HEIGHT - 1 {
                // Such a frame is whole.
                continue;
            }
            let script: Vec<_> = (0..reads)
                .map(|frame| scripted(frame, line, kind))
                .collect();
            let camera = FaultyCamera::new(grey_camera(), script);
            let (fed, late) = meals(camera, FrameCollector::new(), reads);
            let lines = if is_repeat { line + 1 } else { line };
            assert_eq!((fed, late), (PATIENCE_FRAMES * lines, 0), "{kind:?} {line}");
        }
    }
}

#[test]
fn the_watchdog_is_fed_as_long_as_one_frame_in_so_many_comes_whole() {
    let frames = 4 * PATIENCE_FRAMES;
    let broken = |frame: &u32| frame % PATIENCE_FRAMES != PATIENCE_FRAMES - 1;
    let line = HEIGHT - 1;
    let script: Vec<_> = (0..frames)
        .filter(broken)
        .map(|frame| scripted(frame, line, FaultKind::Error(ErrorKind::ShortLine)))
        .collect();
    let faults = script.len() as u32;
    let camera = FaultyCamera::new(grey_camera(), script);
    let (fed, _) = meals(camera, FrameCollector::new(), frames * HEIGHT);
    assert_eq!(fed, frames * HEIGHT - faults);
}

/// A camera whose numbers are made by a function of the number of the read.
struct Numbered<F>(u32, F);

impl<F> ErrorType for Numbered<F> {
    type Error = ErrorKind;
}

impl<F: Fn(u32) -> (u32, u32)> LinePairSource for Numbered<F> {
    fn geometry(&self) -> Geometry {
        grey_camera().geometry()
    }

    fn read_pair(&mut self, _: &mut [u8], _: &mut [u8]) -> Result<LinePair, ErrorKind> {
        let (frame, line) = self.1(self.0);
        self.0 += 1;
        Ok(LinePair {
            frame,
            line,
            timestamp_us: 0,
            dropped: 0,
        })
    }
}

#[test]
fn the_watchdog_starves_when_numbers_make_no_frame() {
    let reads = 4 * PATIENCE_FRAMES * HEIGHT;
    let sink = FrameCollector::new;
    // The frame's number stands still: one frame, and then none.
    let still = Numbered(0, |read| (7, read % HEIGHT));
    assert_eq!(meals(still, sink(), reads), (HEIGHT, 0));
    // Line 0 never comes.
    let headless = Numbered(0, |read| (read / (HEIGHT - 1), 1 + read % (HEIGHT - 1)));
    assert_eq!(meals(headless, sink(), reads), (0, 0));
    // Nothing but line 0 comes.
    let beheaded = Numbered(0, |read| (read, 0));
    assert_eq!(meals(beheaded, sink(), reads), (PATIENCE_FRAMES, 0));
    // Two frames take turns.
    let turns = Numbered(0, |read| (read % 2, read / 2 % HEIGHT));
    let (fed, late) = meals(turns, sink(), reads);
    assert_eq!(late, 0, "{fed}");
}

/// A sink that always fails at one call.
struct BrokenSink(FailAt);

impl DisparitySink for BrokenSink {
    type Error = Refused;

    fn begin_frame(&mut self, _: &FrameInfo) -> Result<(), Refused> {
        refuse(self.0 == FailAt::Begin)
    }

    fn line(&mut self, _: u32, line: &DisparityLine<'_>) -> Result<(), Refused> {
        refuse(self.0 == FailAt::Line(line.line))
    }

    fn end_frame(&mut self, _: &FrameInfo) -> Result<(), Refused> {
        refuse(self.0 == FailAt::End)
    }

    fn abort_frame(&mut self, _: u32, _: Fault) {}
}

fn refuse(refused: bool) -> Result<(), Refused> {
    if refused { Err(Refused) } else { Ok(()) }
}

#[test]
fn the_watchdog_starves_when_the_sink_takes_no_frame() {
    let reads = 4 * PATIENCE_FRAMES * HEIGHT;
    let latency = config().parameters.latency_lines();
    for (fail_at, lines) in [
        (FailAt::Begin, 0),
        (FailAt::Line(0), latency),
        (FailAt::Line(HEIGHT - 1), HEIGHT - 1),
        (FailAt::End, HEIGHT - 1),
    ] {
        let (fed, late) = meals(grey_camera(), BrokenSink(fail_at), reads);
        assert_eq!((fed, late), (PATIENCE_FRAMES * lines, 0), "{fail_at:?}");
    }
}

/// Call at which a [`StrictSink`] fails, once, and a [`BrokenSink`] always.
#[derive(Debug, Clone, Copy, PartialEq)]
enum FailAt {
    Begin,
    Line(u32),
    End,
}

#[derive(Debug, PartialEq)]
struct Refused;

/// A sink that fails at a given call, and asserts that the session makes its calls in order.
struct StrictSink {
    fail_at: FailAt,
    fail_frame: u32,
    open: Option<(u32, u32)>,
    done: Vec<u32>,
    aborted: Vec<(u32, Fault)>,
    failed: bool,
}

impl StrictSink {
    fn new(fail_frame: u32, fail_at: FailAt) -> Self {
        Self {
            fail_at,
            fail_frame,
            open: None,
            done: Vec::new(),
            aborted: Vec::new(),
            failed: false,
        }
    }

    fn check(&mut self, frame: u32, at: FailAt) -> Result<(), Refused> {
        assert!(!self.failed, "called between an error and the abort");
        if (frame, at) == (self.fail_frame, self.fail_at) {
            // A frame that could not begin is not aborted.
            self.failed = at != FailAt::Begin;
            return Err(Refused);
        }
        Ok(())
    }
}

impl DisparitySink for StrictSink {
    type Error = Refused;

    fn begin_frame(&mut self, info: &FrameInfo) -> Result<(), Refused> {
        assert_eq!(self.open, None);
        self.check(info.frame, FailAt::Begin)?;
        self.open = Some((info.frame, 0));
        Ok(())
    }

    fn line(&mut self, frame: u32, line: &DisparityLine<'_>) -> Result<(), Refused> {
        assert_eq!(self.open, Some((frame, line.line)));
        self.check(frame, FailAt::Line(line.line))?;
        self.open = Some((frame, line.line + 1));
        Ok(())
    }

    fn end_frame(&mut self, info: &FrameInfo) -> Result<(), Refused> {
        assert_eq!(self.open, Some((info.frame, info.region.height)));
        self.check(info.frame, FailAt::End)?;
        self.open = None;
        self.done.push(info.frame);
        Ok(())
    }

    fn abort_frame(&mut self, frame: u32, fault: Fault) {
        assert_eq!(self.open.map(|(open, _)| open), Some(frame));
        self.open = None;
        self.failed = false;
        self.aborted.push((frame, fault));
    }
}

#[test]
fn a_failing_sink_costs_one_frame_and_no_more() {
    let config = config();
    let latency = config.parameters.latency_lines();
    assert!(latency + 1 < HEIGHT, "some lines come before the last pair");
    let lines = (0..HEIGHT).map(FailAt::Line);
    for fail_at in lines.chain([FailAt::Begin, FailAt::End]) {
        let mut sink = StrictSink::new(1, fail_at);
        let (camera, meals) = (grey_camera(), Cell::new(0));
        with_watched_session(&config, camera, &mut sink, Meals(&meals), |mut session| {
            assert_eq!(session.run_frame(), Ok(0));
            assert_eq!(session.run_frame(), Err(RunError::Sink(Refused)));
            assert_eq!(session.run_frame(), Ok(2));
            let mut expected = Statistics::default();
            count_whole_frames(&mut expected, HEIGHT, 2);
            let matched = match fail_at {
                FailAt::Begin => 0,
                FailAt::Line(line) => (line + latency + 1).min(HEIGHT),
                FailAt::End => HEIGHT,
            };
            expected.lines += matched;
            expected.lines_dropped = HEIGHT - matched;
            expected.frames_dropped = 1;
            expected.sink_errors = 1;
            assert_eq!(session.statistics(), expected, "{fail_at:?}");
            // The watchdog is not fed for the pair at which the sink failed.
            let fed = 2 * HEIGHT + matched.saturating_sub(1);
            assert_eq!(meals.get(), fed, "{fail_at:?}");
        });
        assert_eq!(sink.done, [0, 2]);
        let aborted: &[_] = match fail_at {
            FailAt::Begin => &[],
            _ => &[(1, Fault::Sink)],
        };
        assert_eq!(sink.aborted, aborted, "{fail_at:?}");
    }
}

#[test]
fn the_sink_sees_calls_in_order_under_faults() {
    for kind in fault_kinds() {
        for line in 0..HEIGHT {
            let camera = FaultyCamera::new(grey_camera(), [scripted(1, line, kind)]);
            // No frame has this number, so the sink only checks the order of the calls.
            let mut sink = StrictSink::new(u32::MAX, FailAt::Begin);
            with_session(&config(), camera, &mut sink, |mut session| {
                while session.run_frame() != Ok(3) {}
            });
            assert_eq!(sink.done.len() as u32 + count_dropped(line, kind), 4);
        }
    }
}

fn count_dropped(line: u32, kind: FaultKind) -> u32 {
    let mut statistics = Statistics::default();
    count_fault(&mut statistics, HEIGHT, line, kind);
    statistics.frames_dropped
}

#[test]
fn what_does_not_fit_is_refused() {
    let refusal = |config: &Config, memory_short: usize| {
        let camera = camera(HEIGHT, Layout::SideBySide, PixelFormat::Rgb888);
        let mut memory = vec![0; config.memory_words()];
        let mut lines = vec![0; memory_words(&camera.geometry()) - memory_short];
        let matcher = Matcher::new(config, Portable, &mut memory).unwrap();
        Session::new(camera, matcher, FrameCollector::new(), &mut lines).map(|_| ())
    };
    let rgb = || config_in(PixelFormat::Rgb888);
    assert_eq!(refusal(&rgb(), 0), Ok(()));
    assert!(matches!(refusal(&rgb(), 1), Err(SessionError::Memory(_))));

    // If the configuration does not ask for colour, the luma is matched.
    assert_eq!(refusal(&config_in(PixelFormat::Grey8), 0), Ok(()));
    let grey = camera(HEIGHT, Layout::SideBySide, PixelFormat::Grey8);
    let mut memory = vec![0; rgb().memory_words()];
    let mut lines = vec![0; memory_words(&grey.geometry())];
    let matcher = Matcher::new(&rgb(), Portable, &mut memory).unwrap();
    let refused = Session::new(grey, matcher, FrameCollector::new(), &mut lines).map(|_| ());
    let expected = SessionError::Colour {
        camera: PixelFormat::Grey8,
    };
    assert_eq!(refused, Err(expected));

    let mut other = rgb();
    other.width = WIDTH + 1;
    let expected = SessionError::Width {
        camera_px: WIDTH,
        matcher_px: WIDTH + 1,
    };
    assert_eq!(refusal(&other, 0), Err(expected));

    let mut other = rgb();
    other.region.y = HEIGHT;
    let expected = SessionError::Height {
        camera_lines: HEIGHT,
        first_line: HEIGHT,
    };
    assert_eq!(refusal(&other, 0), Err(expected));
    other.region.y = HEIGHT - 1;
    assert_eq!(refusal(&other, 0), Ok(()));
}

/// A camera whose right view lies 0.8 px too low, with a configuration for it.
fn lowered() -> (SimulatedCamera, Scene, Config) {
    let scene = render(&RenderOptions {
        width: 160,
        height: 120,
        d_max: 15,
        line_offset_px: 0.8,
        ..RenderOptions::default()
    });
    let (left, right) = (scene.left.clone(), scene.right.clone());
    let camera = SimulatedCamera::new(left, right, Layout::SideBySide, PixelFormat::Grey8).unwrap();
    let config = Config::new(Preset::Lite.parameters(), 160, DisparityRange::up_to(15));
    (camera, scene, config)
}

/// If that is asked for, a frame begins with the offsets of lines that the last whole one taught: a broken one
/// teaches nothing.
#[test]
fn frames_begin_with_the_offsets_of_lines_that_the_last_whole_one_taught() {
    let (camera, scene, config) = lowered();
    let prepared = Prepared::new(scene, true).unwrap();
    let parameters = config.parameters;
    let [first, second, third] = [1, 2, 3].map(|number| {
        let matched = prepared.matched_as_frame(number, parameters, Output::Dense, 1);
        matched.unwrap()
    });
    assert_ne!(first.disparities_q4, second.disparities_q4);
    let faults = [ScriptedFault {
        frame: 1,
        line: 100,
        kind: FaultKind::DroppedLine,
    }];
    let camera = FaultyCamera::new(camera, &faults[..]);
    with_session(&config, camera, FrameCollector::new(), |mut session| {
        session.keep_line_offsets(true);
        assert_eq!(session.matcher().line_offsets(), LineOffsets::NONE);
        for matched in [&first, &second, &third] {
            session.run_frame().unwrap();
            let frame = session.sink_mut().take_frame().unwrap();
            assert!(frame.disparities_q4 == matched.disparities_q4);
            assert_eq!(session.matcher().line_offsets(), matched.line_offsets);
        }
        assert_eq!(session.statistics().frames_dropped, 1);
        session.keep_line_offsets(false);
        session.set_line_offsets(LineOffsets::NONE);
        for _ in 0..2 {
            session.run_frame().unwrap();
            let frame = session.sink_mut().take_frame().unwrap();
            assert!(frame.disparities_q4 == first.disparities_q4);
        }
    });
}

/// A port that keeps what is sent, and receives what it was given.
#[derive(Default)]
struct Port {
    sent: Vec<u8>,
    incoming: Vec<u8>,
}

impl LinkPort for Port {
    fn send(&mut self, bytes: &[u8]) -> usize {
        self.sent.extend_from_slice(bytes);
        bytes.len()
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        let count = bytes.len().min(self.incoming.len());
        bytes[..count].copy_from_slice(&self.incoming[..count]);
        self.incoming.drain(..count);
        count
    }
}

thread_local! {
    static NOW_US: Cell<u64> = const { Cell::new(0) };
}

fn board_setup<'m>(port: &'m mut Port, memory: &'m mut [u32]) -> Setup<'m, &'m mut Port> {
    Setup {
        port,
        device: "board",
        firmware: "0",
        preset: "lite",
        camera: None,
        selection: Selection::whole(Streams::DISPARITIES),
        is_started: true,
        clock: || NOW_US.get(),
        gap_us: 0,
        keeps_line_offsets: true,
        store: NoStore,
        memory,
    }
}

/// A live session tells the host once how the lines lie, and forgets it with the source.
#[test]
fn the_host_is_told_of_offsets_of_lines() {
    let (camera, _, config) = lowered();
    let geometry = camera.geometry();
    let mut memory = vec![0; config.memory_words()];
    let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
    let mut lines = vec![0; memory_words(&geometry)];
    let mut packets = vec![0; live::memory_words(&geometry, &config)];
    let mut port = Port::default();
    let mut encoder_memory = vec![0; 500];
    let pattern = HostMessage::Source(Source::TestPattern);
    let pattern = Encoder::new(&mut encoder_memory)
        .encode(0, &pattern)
        .unwrap()
        .to_vec();
    let setup = board_setup(&mut port, &mut packets);
    let mut board = Live::new(camera, None, matcher, &mut lines, NoWatchdog, setup).unwrap();
    let mut frames = 0;
    while frames < 6 {
        if let Next::Event(Event::FrameDone { .. }) = board.step() {
            frames += 1;
            // Reports are one second apart at least.
            NOW_US.set(NOW_US.get() + 2_000_000);
        }
    }
    let (matcher, _, _) = board.into_parts();
    let learned = matcher.line_offsets();
    assert_ne!(learned, LineOffsets::NONE);
    let mut decoder_memory = vec![0; live::sent_bytes(&geometry, &config)];
    let mut decoder = Decoder::new(&mut decoder_memory);
    let (mut rest, mut told) = (&port.sent[..], Vec::new());
    while let Some(packet) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        if let BoardMessage::Log { text, .. } = packet.unwrap().message {
            told.push(text.to_owned());
        }
    }
    // Where there is little texture it takes some frames; then less changes than is told.
    assert!((1..=5).contains(&told.len()), "{told:?}");
    let px = told
        .last()
        .and_then(|told| told.strip_prefix("the right view lies ")?.split(' ').next());
    let px: f64 = px.unwrap().parse().unwrap();
    assert!((px - 0.8).abs() < 0.06, "{told:?}");

    // With another source nothing is known, and what was learned would spoil it.
    let begun = Config {
        line_offsets: learned,
        ..config
    };
    let mut port = Port {
        incoming: pattern,
        ..Port::default()
    };
    let mut memory = vec![0; begun.memory_words()];
    let mut lines = vec![0; memory_words(&geometry)];
    let mut packets = vec![0; live::memory_words(&geometry, &begun)];
    let matcher = Matcher::new(&begun, Portable, &mut memory).unwrap();
    let setup = board_setup(&mut port, &mut packets);
    let (camera, ..) = lowered();
    let mut board = Live::new(camera, None, matcher, &mut lines, NoWatchdog, setup).unwrap();
    let _ = board.serve();
    let (matcher, ..) = board.into_parts();
    assert_eq!(matcher.line_offsets(), LineOffsets::NONE);
}
