//! Faults at the camera pins of a board in RTL, at every stage of a frame.
//!
//! The counters that a fault is expected to raise, and the frames that are expected to come whole, are derived from the
//! signals at the pins, by hand for each kind of fault ([`cost`]).

use libtest_mimic::Failed;
use vgstereo_boards::board::Board;
use vgstereo_boards::build::build;
use vgstereo_boards::host::{self, Frames};
use vgstereo_boards::pair::Pair;
use vgstereo_boards::simulation::{self, Ran, Scenario};
use vgstereo_firmware::Statistics;
use vgstereo_tests::failed;

/// Lines of a frame: three more than the matcher looks ahead.
const HEIGHT: u32 = 10;

/// The lines at which faults are: while the matcher fills up, the first, while disparities come with each, the last, and
/// the gap to the next frame.
const STAGES: [u32; 5] = [3, 0, 8, HEIGHT - 1, HEIGHT];

/// What comes after the name of a kind: of both sensors, or of one.
const SIDES: [&str; 3] = ["", "-left", "-right"];

/// A kind, the line and the sides.
type Fault = (&'static str, u32, &'static str);

/// Kinds of faults that take no longer than a frame, as `sim/sensors.h` has them.
const KINDS: [&str; 10] = [
    "short-line",
    "long-line",
    "lost-line",
    "extra-line",
    "joined-lines",
    "early-frame",
    "false-frame",
    "cut-line",
    "lost-frame",
    "late-line",
];

/// Faults that take as long as a hundred of the others.
const STOPPED: [Fault; 2] = [("stopped-clock", HEIGHT, ""), ("stopped-clock", 8, "-left")];

/// What becomes of the frames of a fault, up to the next one that it leaves alone.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    /// Number of frames that the sensors mean to send.
    frames: u32,
    /// Number of times that VSYNC rises, of the sensor at which it rises more often.
    begun: u32,
    /// Whether the frame of the fault, or the one before which it is, comes whole all the same.
    is_whole: bool,
    /// Number of pairs of lines that are matched.
    matched: u32,
    /// Which counters tell it, and how often.
    told: Statistics,
}

/// What a fault of this kind costs, at both sensors or at one, at a line, or, at that of number [`HEIGHT`], in the gap
/// behind the frame. `None` if there is no such fault, or none that can be seen before the frame is done.
fn cost(kind: &str, is_one: bool, line: u32) -> Option<Cost> {
    let last = HEIGHT - 1;
    let is_gap = line == HEIGHT;
    let mut told = Statistics::default();
    let (frames, begun, is_whole, matched) = match kind {
        "stopped-clock" => {
            told.timeouts = 1;
            (1, 1, is_gap, line)
        }
        // Empty, as nothing comes between it and the next one, and no fault: a number is missing.
        "false-frame" if !is_one && (line == 0 || is_gap) => {
            told.sequence_breaks = 1;
            (1, 2, true, HEIGHT)
        }
        // Cut in two, and each part is short.
        "false-frame" if !is_one => {
            told.short_frames = 2;
            (1, 2, false, HEIGHT)
        }
        // The next frame is of another number at each.
        "false-frame" | "extra-line" if is_gap && is_one => {
            told.sync_losses = 1;
            (2, 2 + u32::from(kind == "false-frame"), true, HEIGHT)
        }
        "extra-line" if is_gap => {
            told.sync_losses = 1;
            (1, 1, true, HEIGHT)
        }
        _ if is_gap => return None,
        "short-line" => {
            told.short_lines = 1;
            (1, 1, false, line)
        }
        // The frame ends a line too early, of which its lines do not tell.
        "lost-line" if !is_one => {
            told.short_frames = 1;
            (1, 1, false, last)
        }
        // The other's line is known to be alone when the next frame begins.
        "lost-line" if line == last => {
            told.sync_losses = 1;
            (2, 2, false, last)
        }
        "long-line" | "lost-line" => {
            told.sync_losses = 1;
            (1, 1, false, line)
        }
        "joined-lines" if line < last => {
            told.sync_losses = 1;
            (1, 1, false, line)
        }
        // It comes when the other's line does, which it is taken for.
        "extra-line" if is_one && line < last => {
            told.sync_losses = 1;
            (1, 1, false, line + 1)
        }
        "late-line" if is_one => {
            told.sync_losses = 1;
            (1, 1, false, line)
        }
        "early-frame" if is_one => {
            told.sync_losses = 1;
            (2, 2, false, line)
        }
        // Empty, as above.
        "early-frame" if line == 0 => {
            told.sequence_breaks = 1;
            (1, 1, false, 0)
        }
        "early-frame" => {
            told.short_frames = 1;
            (1, 1, false, line)
        }
        "false-frame" => {
            told.sync_losses = 1;
            (1, 2, false, line)
        }
        "cut-line" if is_one => {
            told.sync_losses = 1;
            (1, 2, false, line)
        }
        // The rest of the line is the first of another frame, of which lines are missing as well.
        "cut-line" => {
            told.short_lines = 1;
            told.short_frames = if line == 0 { 0 } else { 2 };
            (1, 2, false, line)
        }
        // Whatever the line. Its lines are below the frame before.
        "lost-frame" if line == 0 => {
            told.sync_losses = 1;
            (1, u32::from(is_one), false, 0)
        }
        _ => return None,
    };
    Some(Cost {
        frames,
        begun,
        is_whole,
        matched,
        told,
    })
}

/// Each kind of fault in each stage of a frame, of one of [`SIDES`].
pub(crate) fn exact_under_faults(board: &Board) -> Result<(), Failed> {
    let each = all().enumerate().filter(|(index, _)| {
        let kind_and_stage = index / SIDES.len();
        // Each kind has each in turn.
        (kind_and_stage / STAGES.len() + kind_and_stage) % SIDES.len() == index % SIDES.len()
    });
    exact_under(
        board,
        each.map(|(_, fault)| fault)
            .chain(STOPPED.into_iter().take(1)),
    )
}

/// Each kind of fault in each stage of a frame, of all of [`SIDES`].
pub(crate) fn exact_under_all_faults(board: &Board) -> Result<(), Failed> {
    exact_under(board, all().chain(STOPPED))
}

/// The kinds of faults in each stage of both sensors and of each.
fn all() -> impl Iterator<Item = Fault> {
    let kinds = KINDS.into_iter();
    let each = kinds.flat_map(|kind| STAGES.map(|line| SIDES.map(|sides| (kind, line, sides))));
    each.flatten()
}

/// After each fault a frame is left alone. All frames that are whole equal the host's, and the board numbers them as the
/// sensors have begun them.
fn exact_under(board: &Board, script: impl Iterator<Item = Fault>) -> Result<(), Failed> {
    let mut pair = Pair::rendered(16, 16, 8);
    pair.cut(HEIGHT);
    let mut faults = Vec::new();
    let mut expected = Statistics::default();
    // Frames that the sensors mean to send, and those that they have begun.
    let (mut sent, mut begun) = (0, 0);
    let mut whole = Vec::new();
    for (kind, line, sides) in script {
        let Some(cost) = cost(kind, !sides.is_empty(), line) else {
            continue;
        };
        faults.push(format!("{sent}:{line}:{kind}{sides}"));
        if cost.is_whole {
            // An empty one may be before it.
            whole.push(begun + if line == 0 { cost.begun - 1 } else { 0 });
        }
        expected.lines += cost.matched + HEIGHT;
        let Statistics {
            sequence_breaks,
            sync_losses,
            short_lines,
            short_frames,
            timeouts,
            ..
        } = cost.told;
        expected.sequence_breaks += sequence_breaks;
        expected.sync_losses += sync_losses;
        expected.short_lines += short_lines;
        expected.short_frames += short_frames;
        expected.timeouts += timeouts;
        sent += cost.frames + 1;
        begun += cost.begun + 1;
        whole.push(begun - 1);
    }
    expected.frames = whole.len() as u32;
    expected.frames_dropped = begun - expected.frames;
    expected.lines_dropped = begun * HEIGHT - expected.lines;
    let scenario = Scenario {
        faults,
        ..Default::default()
    };
    let ran = run_simulated(board, &pair, &scenario, expected.frames)?;
    assert_eq!(whole_numbers(&ran), whole);
    assert_eq!(ran.report.statistics, expected);
    Ok(())
}

/// The board's numbers of the frames that it has called done.
fn whole_numbers(ran: &Ran) -> Vec<u32> {
    let whole = ran.sent.iter().filter(|frame| frame.is_whole);
    whole.map(|frame| frame.number).collect()
}

/// Sensors that do not wait send frames faster than the board matches them: it takes as many as its rings have room for,
/// from then on a frame where there is room again, and those that are left out count as lost.
pub(crate) fn exact_when_frames_come_too_fast(board: &Board) -> Result<(), Failed> {
    // More than the rings have room for.
    const FRAMES: u32 = 16;
    let mut pair = Pair::rendered(16, 16, 8);
    pair.cut(HEIGHT);
    let scenario = Scenario {
        // Of dozens of frames it takes one.
        free_running_gap: Some(6000),
        ..Default::default()
    };
    let ran = run_simulated(board, &pair, &scenario, FRAMES)?;
    let numbers = whole_numbers(&ran);
    let gaps = numbers.windows(2).filter(|pair| pair[0] + 1 != pair[1]);
    let mut expected = Statistics::default();
    expected.frames = FRAMES;
    expected.frames_dropped = numbers[numbers.len() - 1] + 1 - numbers[0] - FRAMES;
    expected.lines = FRAMES * HEIGHT;
    expected.lines_dropped = expected.frames_dropped * HEIGHT;
    expected.overruns = gaps.count() as u32;
    assert!(expected.overruns > 1, "{numbers:?}");
    assert_eq!(ran.report.statistics, expected);
    Ok(())
}

/// The sensors hang amid a frame until they are reset, which nothing does: they answer. The watchdog runs out, the board
/// begins anew, tells it, resets the sensors, and sends all that was asked for.
pub(crate) fn restarts_when_the_sensors_hang(board: &Board) -> Result<(), Failed> {
    const FRAMES: u32 = 5;
    let mut pair = Pair::rendered(16, 16, 8);
    pair.cut(HEIGHT);
    let scenario = Scenario {
        faults: vec![format!("{}:4:hung-clock", FRAMES - 1)],
        ..Default::default()
    };
    let ran = run_simulated(board, &pair, &scenario, FRAMES)?;
    assert_eq!(whole_numbers(&ran), [0, 1, 2, 3, 0, 1, 2, 3, 4]);
    assert_eq!(ran.log[0], "restarted by the watchdog: 1");
    let mut expected = Statistics::default();
    expected.frames = FRAMES;
    expected.lines = FRAMES * HEIGHT;
    assert_eq!(ran.report.statistics, expected);
    Ok(())
}

/// Runs a board in RTL while its cameras fail, until so many frames are whole, and asserts that each of those equals the
/// host's.
fn run_simulated(
    board: &Board,
    pair: &Pair,
    scenario: &Scenario,
    frames: u32,
) -> Result<Ran, Failed> {
    let (program, firmware) = (
        simulation::build(board).map_err(failed)?,
        build(board).map_err(failed)?,
    );
    let preset = board.simulation.ok_or("the board is simulated")?.preset;
    let request = pair.request(preset, frames, &[]).map_err(failed)?;
    let ran = simulation::run(board, &program, &firmware, pair, &request, scenario);
    let ran = ran.map_err(failed)?;
    println!("{} cycles\n{}", ran.cycles, ran.report);
    let one = pair.request(preset, 1, &[]).map_err(failed)?;
    let (expected, _) = host::run(pair, &one).map_err(failed)?;
    for frame in ran.sent.iter().filter(|frame| frame.is_whole) {
        let sent = Frames {
            disparities: frame.disparities.clone(),
            confidences: frame.confidences.clone(),
            ..Frames::default()
        };
        let difference = host::first_difference(&sent, &expected, pair.left.width());
        assert_eq!(difference, None, "frame {}", frame.number);
    }
    Ok(ran)
}

/// When the cameras do not wait, the ring takes as many lines as it has room for, and one for each that is read
/// meanwhile. The frame ends there; the next one, for which they wait again, is whole.
pub(crate) fn exact_when_lines_come_too_fast(board: &Board) -> Result<(), Failed> {
    const RING_LINES: u32 = 128;
    let pair = Pair::rendered(16, 160, 16);
    let height = pair.left.height();
    let scenario = Scenario {
        faults: vec!["0:0:burst".to_owned()],
        ..Default::default()
    };
    let ran = run_simulated(board, &pair, &scenario, 1)?;
    let lines = ran.report.statistics.lines;
    assert!((RING_LINES + height..2 * height).contains(&lines));
    let mut expected = Statistics::default();
    expected.frames = 1;
    expected.frames_dropped = 1;
    expected.lines = lines;
    expected.lines_dropped = 2 * height - lines;
    expected.overruns = 1;
    assert_eq!(ran.report.statistics, expected);
    assert_eq!(ran.sent.len(), 2);
    Ok(())
}

/// The left sensor's SDA is held low at first, the right sensor gets its power late, and each is named; then both are set
/// up. They lose it for a moment amid a frame, and are set up again. What the bus has written is what the data sheet asks for.
pub(crate) fn sets_both_sensors_up_and_again(board: &Board) -> Result<(), Failed> {
    // A window of 48x20 pixels in the middle, from column 296 and row 230 on, to which 168 and 12 are added. A line of 66
    // us is 792 pixels of two clocks at 24 MHz, 784 and 8 dummy ones; 30 ms are 454 of them.
    const SET_UP: [[u8; 2]; 31] = [
        [0x12, 0x80], // COM7: reset
        [0x12, 0x00], // COM7: YUV
        [0x13, 0xc0], // COM8: none of AGC, AWB, AEC
        [0x11, 0x80], // CLKRC: divided by 1
        [0x6b, 0x0a], // DBLV: PLL bypassed
        [0x3a, 0x04], // TSLB: Y first
        [0x3d, 0x88], // COM13
        [0x40, 0xc0], // COM15: 0x00 to 0xff
        [0x0c, 0x04], // COM3: DCW enable
        [0x3e, 0x19], // COM14: PCLK by 2
        [0x70, 0x3a], // SCALING_XSC
        [0x71, 0x35], // SCALING_YSC
        [0x72, 0x11], // SCALING_DCWCTR: by 2
        [0x73, 0xf1], // SCALING_PCLK_DIV: by 2
        [0xa2, 0x02], // SCALING_PCLK_DELAY
        [0x17, 0x3a], // HSTART: 464 = 58 * 8
        [0x18, 0x40], // HSTOP: 512 = 64 * 8
        [0x32, 0x80], // HREF
        [0x19, 0x3c], // VSTRT: 242 = 60 * 4 + 2
        [0x1a, 0x41], // VSTOP: 262 = 65 * 4 + 2
        [0x03, 0x0a], // VREF
        [0x2a, 0x00], // EXHCH
        [0x2b, 0x08], // EXHCL
        [0x92, 0x00], // DM_LNL
        [0x93, 0x00], // DM_LNH
        [0xb1, 0x04], // ABLC1: enabled
        [0xb3, 0x80], // THL_ST
        [0x00, 0x00], // GAIN: once
        [0x07, 0x00], // AECHH
        [0x10, 0x71], // AECH: 454 = 113 * 4 + 2
        [0x04, 0x02], // COM1
    ];
    const LINES_BEFORE: u32 = 5;
    let mut pair = Pair::rendered(24, 16, 16);
    pair.cut(10);
    let height = pair.left.height();
    let mut expected = Statistics::default();
    expected.bus_errors = 2;
    expected.timeouts = 1;
    expected.frames = 2;
    expected.frames_dropped = 1;
    expected.lines = 2 * height + LINES_BEFORE;
    expected.lines_dropped = height - LINES_BEFORE;
    let scenario = Scenario {
        faults: vec![format!("1:{LINES_BEFORE}:lost-power")],
        powered_us: [0, 80_000],
        sda_held_us: [30_000, 0],
        ..Default::default()
    };
    let ran = run_simulated(board, &pair, &scenario, expected.frames)?;
    assert_eq!(ran.report.statistics, expected);
    let twice = [SET_UP, SET_UP].concat();
    assert_eq!(ran.sensor_writes, [twice.clone(), twice]);
    let told = [
        "left sensor: SDA is held low",
        "right sensor: no acknowledgement",
        "both sensors are set up",
    ];
    assert_eq!(ran.log[..3], told);
    Ok(())
}
