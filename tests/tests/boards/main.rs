//! Tests on the emulated boards: results equal to the host's, exact counters under faults,
//! repeatable instruction counts. And tests of the real boards: no panics, and, of the one
//! whose chip has a model, the firmware that is flashed, run on that; and of the board in RTL, whose
//! cameras fail at their pins.
//!
//! A board is tested if its compiler and emulator are installed (`cargo firmware setup`); otherwise its
//! tests are listed as ignored. So are those on the model of a chip, and of boards that are built for one preset, which
//! take minutes to build; of the variants of another board; of stereo units of other widths than the board's, of what
//! comes to the pins of the board without one, of all that can, and of the board with another processor:
//! `-- --include-ignored stm32h743`, to name some, runs those as well.

mod pins;

use std::io::Write;
use std::process::{Command, Stdio};

use libtest_mimic::{Arguments, Failed, Trial};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_boards::board::{
    ALONE_DISPARITIES, Board, MPS2_AN500, MPS3_AN547, Processor, STM32F405, UNIT_LANES,
};
use vgstereo_boards::build::{build, build_suite};
use vgstereo_boards::elf::Sizes;
use vgstereo_boards::emulator::{self, Clock};
use vgstereo_boards::model::{Ran, Scenario};
use vgstereo_boards::pair::Pair;
use vgstereo_boards::stereo_unit::SimulatedUnit;
use vgstereo_boards::toolchain::Simulator;
use vgstereo_boards::{host, model, panics, simulation, stack, toolchain};
use vgstereo_core::{INVALID, Kernels, Portable, Preset};
use vgstereo_firmware::camera::{ErrorKind, PixelFormat};
use vgstereo_firmware::scripted::{FaultKind, ScriptedFault};
use vgstereo_kernels::cases::{
    Case, ConvertCase, Median9Case, PackCase, PenaltyCase, RowsCase, SmoothCase, below, generator,
};
use vgstereo_kernels::{StereoUnit, byte_instruction};
use vgstereo_tests::failed;

/// Limits of RAM: board, preset, columns, number of disparities, and KiB that statics, working
/// memory and stack may take together.
const RAM_KIB: [(Board, Preset, u32, u16, u64); 7] = [
    (STM32F405, Preset::Lite, 160, 32, 44),
    (STM32F405, Preset::Lite, 320, 48, 88),
    (STM32F405, Preset::Micro, 320, 48, 120),
    (MPS2_AN500, Preset::Lite, 450, 60, 150),
    (MPS2_AN500, Preset::Balanced, 450, 60, 300),
    (MPS3_AN547, Preset::Lite, 320, 48, 88),
    (MPS3_AN547, Preset::Quality, 640, 96, 410),
];

/// Most flash of a board that is built for one preset, KiB.
const ALONE_FLASH_KIB: [(Preset, u64); 2] = [(Preset::Lite, 64), (Preset::Micro, 92)];

type BoardTest = fn(&Board) -> Result<(), Failed>;

/// Tests of each emulated board, ignored if a tool that the board needs is missing.
const TESTS: [(&str, BoardTest); 9] = [
    ("presets", same_bytes_with_every_preset),
    ("raw_lines", same_bytes_of_raw_lines),
    ("faults", exact_under_every_fault),
    ("random_faults", exact_under_random_faults),
    ("dead_camera", a_dead_camera_ends_the_run),
    ("counts", the_same_counts_in_every_run),
    ("log", every_frame_is_logged),
    ("panics", no_panic_in_the_pipeline),
    ("memory", within_the_memory_promised),
];

/// Tests of each modelled board, ignored unless they are asked for.
const MODEL_TESTS: [(&str, BoardTest); 7] = [
    ("frames", two_frames_as_on_the_host_and_a_fault),
    ("calibrated", a_frame_of_raw_lines_as_on_the_host),
    ("wires", recovers_from_faults_at_the_wires),
    ("stuck_wires", recovers_from_stuck_wires),
    ("sensors", waits_for_sensors_and_sets_them_up_again),
    ("strangers", waits_out_another_chip_and_a_stuck_bus),
    ("hung_bus", restarts_when_a_bus_hangs),
];

/// The parts of a board in RTL that a test builds, and whether it takes minutes.
#[derive(Clone, Copy, PartialEq)]
enum Needs {
    /// Its firmware.
    Firmware,
    /// Its firmware, and its RTL as a program: ignored if that cannot be simulated.
    Simulation,
    /// Both, and minutes: ignored unless it is asked for.
    Minutes,
}

/// Tests of each board in RTL, with its stereo unit, without, and with another processor. Those that run it are ignored
/// without the unit, as what is at the pins is the same. With another processor or preset, of whose firmware all has to be
/// built, all are.
const SIMULATION_TESTS: [(&str, BoardTest, Needs); 8] = [
    ("panics", no_panic_in_the_pipeline, Needs::Firmware),
    ("memory", within_its_block_ram, Needs::Firmware),
    ("pins", pins::exact_under_faults, Needs::Simulation),
    ("all_pins", pins::exact_under_all_faults, Needs::Minutes),
    (
        "watchdog",
        pins::restarts_when_the_sensors_hang,
        Needs::Minutes,
    ),
    (
        "free_running",
        pins::exact_when_frames_come_too_fast,
        Needs::Simulation,
    ),
    (
        "overrun",
        pins::exact_when_lines_come_too_fast,
        Needs::Simulation,
    ),
    (
        "sensors",
        pins::sets_both_sensors_up_and_again,
        Needs::Simulation,
    ),
];

fn main() {
    let mut trials = Vec::new();
    for board in Board::simulated() {
        let name = format!("{}::instructions", board.name);
        let trial = Trial::test(name, move || the_byte_instructions_equal_plain_code(&board));
        let unsimulated = Simulator::find(Processor::VexRiscv).is_err();
        trials.push(trial.with_ignored_flag(unsimulated));
        for lanes in UNIT_LANES {
            let other = board.with_unit(lanes);
            let name = format!("{}::unit_{lanes}", board.name);
            let trial = Trial::test(name, move || the_stereo_unit_equals_the_reference(&other));
            trials.push(trial.with_ignored_flag(unsimulated || other != board));
        }
    }
    for (board, suffix, is_built, is_run) in Board::simulated().flat_map(simulated_variants) {
        let unbuilt = !is_built || toolchain::ensure_complete(&[board]).is_err();
        let unsimulated = !is_run || Simulator::find(Processor::VexRiscv).is_err();
        for (name, test, needs) in SIMULATION_TESTS {
            let name = format!("{}{suffix}::{name}", board.program());
            let trial = Trial::test(name, move || test(&board));
            let is_ignored = match needs {
                Needs::Firmware => unbuilt,
                Needs::Simulation => unbuilt || unsimulated,
                Needs::Minutes => true,
            };
            trials.push(trial.with_ignored_flag(is_ignored));
        }
    }
    for board in Board::real() {
        let unbuilt = toolchain::ensure_complete(&[board]).is_err() || board.is_variant();
        let name = format!("{}::panics", board.name);
        let trial = Trial::test(name, move || no_panic_in_the_pipeline(&board));
        trials.push(trial.with_ignored_flag(unbuilt));
    }
    for board in Board::modelled() {
        for (name, test) in MODEL_TESTS {
            let name = format!("{}::{name}", board.name);
            let trial = Trial::test(name, move || test(&board));
            trials.push(trial.with_ignored_flag(true));
        }
    }
    for board in Board::emulated() {
        let absent = toolchain::ensure_complete(&[board]).is_err() || board.is_variant();
        for (name, test) in TESTS {
            let name = format!("{}::{name}", board.name);
            let trial = Trial::test(name, move || test(&board));
            trials.push(trial.with_ignored_flag(absent));
        }
        if !board.alone_presets.is_empty() {
            let name = format!("{}::alone", board.name);
            let trial = Trial::test(name, move || alone_in_less_flash(&board));
            trials.push(trial.with_ignored_flag(true));
        }
        if board.kernel_suite.is_some() {
            let name = format!("{}::kernels", board.name);
            let trial = Trial::test(name, move || every_kernel_equals_the_reference(&board));
            trials.push(trial.with_ignored_flag(absent));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// A board in RTL with its stereo unit, without, and without and with another preset or another processor: what comes after
/// the name of the program in the names of its tests, and whether it is built and run without being asked for.
fn simulated_variants(board: Board) -> Vec<(Board, &'static str, bool, bool)> {
    let plain = board.with_unit(0);
    let other = plain.with_processor(Processor::Cv32e40p);
    let micro = plain.alone(Preset::Micro).ok();
    let mut variants = vec![
        (board, "", true, true),
        (plain, "", true, false),
        (other, "-cv32e40p", false, false),
    ];
    variants.extend(micro.map(|micro| (micro, "-micro", false, false)));
    variants
}

/// The built-in scene, with more lines than all stages together look ahead.
fn small_pair() -> Pair {
    Pair::rendered(64, 40, 16)
}

/// Raw lines, rectified on the board, in grey and in colour, with a fault between two frames; and the
/// laser scan of each.
fn same_bytes_of_raw_lines(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let fault = ScriptedFault {
        frame: 1,
        line: 20,
        kind: FaultKind::Truncated,
    };
    for format in [PixelFormat::Grey8, PixelFormat::Rgb888] {
        let pair = Pair {
            format,
            ..Pair::crooked(64, 40, 16, true).map_err(failed)?
        };
        for preset in [Preset::Lite, Preset::Paper] {
            let mut request = pair.request(preset, 2, &[fault]).map_err(failed)?;
            request.scan = pair.scan();
            let ran = emulator::run(board, &firmware, &pair, &request, Clock::Host);
            let (frames, report) = ran.map_err(failed)?;
            let (expected, statistics) = host::run(&pair, &request).map_err(failed)?;
            assert_eq!(report.statistics, statistics, "{preset} {format:?}");
            assert_eq!(statistics.frames_dropped, 1);
            // Two scans of 60 bearings, each after two angles; something is seen.
            assert_eq!(frames.scans.len(), 2 * (2 * 4 + 60 * 2));
            assert!(frames.scans[8..128].iter().any(|&byte| byte > 0));
            let difference = host::first_difference(&frames, &expected, 64);
            assert_eq!(difference, None, "{preset} {format:?}");
            // Pixels that no camera saw have no disparity, and others have.
            let disparities = frames.disparities_q4();
            let known = disparities.iter().filter(|&&d| d != INVALID).count();
            assert!(known > 0 && known < disparities.len());
        }
    }
    Ok(())
}

/// A board that is built for one preset has the host's bytes of that and refuses others, without panics, in less
/// flash.
fn alone_in_less_flash(board: &Board) -> Result<(), Failed> {
    let pair = Pair::rendered(320, 40, ALONE_DISPARITIES);
    for &preset in board.alone_presets {
        let alone = board.alone(preset)?;
        let firmware = build(&alone).map_err(failed)?;
        let flash_bytes = Sizes::read(&firmware).map_err(failed)?.flash_bytes;
        println!("{}: {flash_bytes} bytes of flash", alone.full_name());
        let (_, kib) = ALONE_FLASH_KIB
            .into_iter()
            .find(|of| of.0 == preset)
            .unwrap();
        assert!(flash_bytes <= kib * 1024, "{preset}: {flash_bytes} bytes");
        let panics = panics::of_pipeline(&firmware).map_err(failed)?;
        assert!(panics.is_empty(), "{}", panics.join("\n"));
        let request = pair.request(preset, 2, &[]).map_err(failed)?;
        assert!(alone.is_built_for(&request), "{preset}");
        for other in Preset::ALL {
            let request = pair.request(other, 2, &[]).map_err(failed)?;
            let ran = emulator::run(&alone, &firmware, &pair, &request, Clock::Host);
            if !alone.is_built_for(&request) {
                let refusal = ran.unwrap_err().to_string();
                assert!(refusal.contains("not built for this request"), "{refusal}");
                continue;
            }
            let (frames, report) = ran.map_err(failed)?;
            let (expected, statistics) = host::run(&pair, &request).map_err(failed)?;
            assert_eq!(report.statistics, statistics, "{preset}");
            assert_eq!(
                host::first_difference(&frames, &expected, 320),
                None,
                "{preset}"
            );
            assert_eq!(frames.confidences.len(), 2 * 320 * 40, "two frames");
        }
    }
    Ok(())
}

/// Kernels whose instructions no host has are held to the reference on the board.
fn every_kernel_equals_the_reference(board: &Board) -> Result<(), Failed> {
    let program = build_suite(board).map_err(failed)?;
    emulator::run_suite(board, &program).map_err(failed)
}

fn same_bytes_with_every_preset(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    for format in [PixelFormat::Grey8, PixelFormat::Rgb888] {
        let pair = Pair {
            format,
            ..small_pair()
        };
        let presets = Preset::ALL.into_iter().map(|preset| (preset, false));
        for (preset, hamming_alone) in presets.chain([(Preset::Lite, true)]) {
            let mut request = pair.request(preset, 2, &[]).map_err(failed)?;
            request.hamming_alone = hamming_alone;
            let ran = emulator::run(board, &firmware, &pair, &request, Clock::Host);
            let (frames, report) = ran.map_err(failed)?;
            let (expected, statistics) = host::run(&pair, &request).map_err(failed)?;
            assert_eq!(report.statistics, statistics, "{preset} {format:?}");
            let difference = host::first_difference(&frames, &expected, 64);
            assert_eq!(difference, None, "{preset} {format:?}");
            let pixels = 2 * 64 * 40;
            let lengths = (frames.confidences.len(), frames.disparities.len());
            assert_eq!(lengths, (pixels, 2 * pixels), "two frames");
        }
    }
    Ok(())
}

fn exact_under_every_fault(board: &Board) -> Result<(), Failed> {
    let last = small_pair().left.height() - 1;
    for line in [0, 1, last / 2, last - 1, last] {
        // One fault in every other frame.
        let script = FaultKind::ALL.into_iter().zip((1..).step_by(2));
        let script: Vec<_> = script
            .map(|(kind, frame)| ScriptedFault { frame, line, kind })
            .collect();
        exact_under(board, &script)?;
    }
    Ok(())
}

fn exact_under_random_faults(board: &Board) -> Result<(), Failed> {
    let height = small_pair().left.height();
    for seed in 0..5 {
        let mut generator = Pcg32::seed_from_u64(seed);
        let mut below = |limit: u32| generator.next_u32() % limit;
        let script: Vec<_> = (0..16)
            .map(|_| ScriptedFault {
                frame: below(12),
                line: below(height),
                kind: FaultKind::ALL[below(FaultKind::ALL.len() as u32) as usize],
            })
            .collect();
        println!("seed {seed}: {script:?}");
        exact_under(board, &script)?;
    }
    Ok(())
}

/// Asserts that every complete frame equals the undisturbed one, and that the counters equal the
/// host's.
fn exact_under(board: &Board, script: &[ScriptedFault]) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let pair = small_pair();
    let run = |frames: u32, script: &[ScriptedFault]| {
        let request = pair.request(Preset::Lite, frames, script)?;
        let board = emulator::run(board, &firmware, &pair, &request, Clock::Host)?;
        anyhow::Ok((board, host::run(&pair, &request)?))
    };
    let ((undisturbed, _), _) = run(1, &[]).map_err(failed)?;
    // As many frames as are complete among the disturbed ones, and one after them.
    let frames = script.len() as u32 + 1;
    let ((frames, report), (expected, statistics)) = run(frames, script).map_err(failed)?;
    assert_eq!(report.statistics, statistics, "{script:?}");
    assert!(statistics.frames_dropped > 0, "no fault has happened");
    assert_eq!(host::first_difference(&frames, &expected, 64), None);
    let whole = frames.disparities.chunks(undisturbed.disparities.len());
    for (number, frame) in whole.enumerate() {
        assert!(frame == undisturbed.disparities, "{script:?}, {number}");
    }
    Ok(())
}

/// With a camera whose frames always end too early, the board gives up and reports it.
fn a_dead_camera_ends_the_run(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let pair = small_pair();
    let mut request = pair.request(Preset::Lite, 1, &[]).map_err(failed)?;
    request.geometry.height += 1;
    let ran = emulator::run(board, &firmware, &pair, &request, Clock::Host);
    let (frames, report) = ran.map_err(failed)?;
    assert!(frames.disparities.is_empty());
    let statistics = report.statistics;
    assert_eq!((statistics.frames, statistics.short_frames), (0, 4));
    Ok(())
}

fn the_same_counts_in_every_run(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    // With raw lines, every stage has instructions.
    let pair = Pair::crooked(64, 40, 16, true).map_err(failed)?;
    let request = pair.request(Preset::Micro, 1, &[]).map_err(failed)?;
    let count = || emulator::run(board, &firmware, &pair, &request, Clock::Instructions);
    let ((_, first), (_, second)) = (count().map_err(failed)?, count().map_err(failed)?);
    assert_eq!(first, second);
    assert!(first.instructions.iter().all(|&count| count > 0), "{first}");
    Ok(())
}

fn every_frame_is_logged(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let pair = small_pair();
    let fault = "1:10:overrun".parse().unwrap();
    let request = pair.request(Preset::Lite, 2, &[fault]).map_err(failed)?;
    let ran = emulator::run_logged(board, &firmware, &pair, &request, Clock::Host);
    let (_, _, log) = ran.map_err(failed)?;
    // A frame has 40 lines; the second frame is lost from line 10 on.
    let lines = [
        "info frame 0: 40 lines so far, 0 dropped; 0 frames dropped",
        "info frame 2: 90 lines so far, 30 dropped; 1 frames dropped",
    ];
    assert_eq!(log, lines);
    Ok(())
}

fn no_panic_in_the_pipeline(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let panics = panics::of_pipeline(&firmware).map_err(failed)?;
    assert!(panics.is_empty(), "{}", panics.join("\n"));
    Ok(())
}

fn within_the_memory_promised(board: &Board) -> Result<(), Failed> {
    let firmware = build(board).map_err(failed)?;
    let sizes = Sizes::read(&firmware).map_err(failed)?;
    let deepest_bytes = stack::deepest_bytes(&firmware).map_err(failed)?;
    // What is lent, the statics and the deepest stack, that of the link too, are in 128 KB.
    if let Some(deepest_bytes) = deepest_bytes.filter(|_| *board == STM32F405) {
        let bytes = sizes.statics_bytes + sizes.lent_bytes as u64 + deepest_bytes;
        assert!(bytes <= 128 * 1024, "{bytes} bytes");
    }
    for (of, preset, width, disparities, kib) in RAM_KIB {
        if of != *board {
            continue;
        }
        // Memory does not depend on the height of the frame.
        let pair = Pair::rendered(width, 40, disparities);
        let request = pair.request(preset, 1, &[]).map_err(failed)?;
        let ran = emulator::run(board, &firmware, &pair, &request, Clock::Host);
        let (_, report) = ran.map_err(failed)?;
        let bytes =
            sizes.statics_bytes + u64::from(report.working_bytes) + u64::from(report.stack_bytes);
        println!("{} {preset} {width}x{disparities}: {bytes} bytes", of.name);
        assert!(bytes <= kib * 1024, "{preset} {width}: {bytes} bytes");
        // The measured stack is within the bound that follows from the compiler's stack sizes.
        if let Some(deepest_bytes) = deepest_bytes {
            assert!(u64::from(report.stack_bytes) <= deepest_bytes, "{preset}");
        }
    }
    Ok(())
}

/// What the linker places in the data memory, what is lent, and the deepest stack are in it together.
fn within_its_block_ram(board: &Board) -> Result<(), Failed> {
    const RAM_BYTES: u64 = 80 * 1024;
    let firmware = build(board).map_err(failed)?;
    let sizes = Sizes::read(&firmware).map_err(failed)?;
    let statics_bytes = sizes.statics_bytes + sizes.lent_bytes as u64;
    if let Some(deepest_bytes) = stack::deepest_bytes(&firmware).map_err(failed)? {
        let bytes = statics_bytes + deepest_bytes;
        assert!(bytes <= RAM_BYTES, "{bytes} bytes");
    }
    // The lines for which its ports have room, raw.
    let preset = board.simulation.ok_or("the board is simulated")?.preset;
    let pair = Pair::crooked(160, 120, 32, true).map_err(failed)?;
    let request = pair.request(preset, 1, &[]).map_err(failed)?;
    println!("{preset}: {} bytes", request.working_bytes());
    assert!(request.working_bytes() <= sizes.lent_bytes);
    Ok(())
}

/// All instructions of the processor's port for our own, the functions that there are not among them, on random operands
/// in which bytes at the ends of their range and equal ones are frequent.
fn the_byte_instructions_equal_plain_code(board: &Board) -> Result<(), Failed> {
    const OPERANDS: usize = 400;
    let program = simulation::build_instructions(board).map_err(failed)?;
    let random = &mut generator(1);
    let mut operand = || {
        let [any, ends] = [(); 2].map(|()| random.next_u32().to_le_bytes());
        u32::from_le_bytes(std::array::from_fn(|at| match ends[at] % 8 {
            0 => 0,
            1 => u8::MAX,
            2 => 1,
            _ => any[at],
        }))
    };
    let mut instructions = Vec::new();
    // All three bits of funct3, and those of funct7 up to some that have no function.
    for function in (0..128).chain([1 << 9, (1 << 10) - 1]) {
        for index in 0..OPERANDS {
            let a = operand();
            let b = if index % 8 == 0 { a } else { operand() };
            instructions.push((function, a, b));
        }
    }
    // So that a different function follows each.
    let stride = 7919;
    let count = instructions.len();
    let instructions: Vec<_> = (0..count)
        .map(|index| instructions[index * stride % count])
        .collect();
    let mut input = Vec::new();
    for &(function, a, b) in &instructions {
        input.extend((function as u16).to_le_bytes());
        input.extend(a.to_le_bytes());
        input.extend(b.to_le_bytes());
    }
    let mut command = Command::new(program);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn()?;
    // It reads all before it writes.
    let mut to_logic = child.stdin.take().ok_or("no input")?;
    to_logic.write_all(&input)?;
    drop(to_logic);
    let output = child.wait_with_output()?;
    assert!(output.status.success(), "the logic has stopped");
    let results = output.stdout.as_chunks().0;
    assert_eq!(results.len(), count);
    for (&(function, a, b), &result) in instructions.iter().zip(results) {
        let expected = byte_instruction(function >> 3, function & 7, a, b);
        let result = u32::from_le_bytes(result);
        assert_eq!(
            result, expected,
            "function {function:#x} of {a:#010x} and {b:#010x}"
        );
    }
    Ok(())
}

/// Random tasks for the stereo unit alone, with as many costs in a cycle as it is built for.
fn the_stereo_unit_equals_the_reference(board: &Board) -> Result<(), Failed> {
    const TASKS: u64 = 40;
    let program = simulation::build_unit(board).map_err(failed)?;
    let simulated = SimulatedUnit::start(&program).map_err(failed)?;
    let unit = StereoUnit::new(&simulated);
    for seed in 0..TASKS {
        let random = &mut generator(seed);
        let task = format!("seed {seed}");
        let width = 1 + below(random, 300);
        let mut cells = PackCase::random(random, width);
        compare(&mut cells, unit, &task);
        compare(&mut SmoothCase::random(random, width, 0), unit, &task);
        compare(&mut ConvertCase::random(random, width), unit, &task);
        compare(&mut PenaltyCase::random(random, width), unit, &task);
        compare(&mut Median9Case::random(random, width), unit, &task);
        let disparities = 1 + below(random, 64);
        let width_max = (1..=160).rfind(|&width| unit.fits(width, disparities));
        let width = 1 + below(random, width_max.unwrap_or(1));
        let mut rows = RowsCase::random(random, width, 3, disparities, 4);
        let task = format!("{task}, {width} px, {disparities} disparities");
        compare(&mut rows, unit, &task);
    }
    Ok(())
}

/// Runs a task with a kernel set and with the reference.
fn compare<C: Case>(case: &mut C, kernels: impl Kernels, task: &str) {
    let mut reference = case.clone();
    reference.run(Portable);
    case.run(kernels);
    assert!(
        case.output() == reference.output(),
        "{task}: {:?} for {:?}",
        case.output(),
        reference.output()
    );
}

/// Runs a modelled board, and asserts that each frame that it calls done equals the host's, that
/// its chip took every access, and that the watchdog has restarted it so many times.
fn run_modelled_restarted(
    board: &Board,
    scenario: &Scenario,
    restarts: usize,
) -> Result<Ran, Failed> {
    let built_for = board.model.ok_or("the board has a model")?;
    let program = model::build(board).map_err(failed)?;
    let firmware = build(board).map_err(failed)?;
    let pair = model::built_in_pair(&built_for);
    let ran = model::run(&program, &firmware, &pair, scenario).map_err(failed)?;
    println!("{:#?}\n{:#?}", ran.report, ran.log);
    let expected = model::expected(&built_for, &pair).map_err(failed)?;
    for frame in ran.frames.iter().filter(|frame| frame.is_whole) {
        assert!(
            frame.disparities == expected.disparities,
            "{}",
            frame.number
        );
    }
    ran.report.ensure_all_accesses_taken().map_err(failed)?;
    let resets = &ran.report.resets;
    assert_eq!(resets.len(), restarts, "{resets:?}");
    Ok(ran)
}

/// Runs a modelled board as [`run_modelled_restarted`] does, and asserts that its watchdog, which
/// waits for 3.7 s, stays far from its end.
fn run_modelled(board: &Board, scenario: &Scenario) -> Result<Ran, Failed> {
    let ran = run_modelled_restarted(board, scenario, 0)?;
    assert!(ran.report.longest_hunger_ms < 3000);
    Ok(ran)
}

/// The numbers of the frames that the board has called done.
fn whole_frames(ran: &Ran) -> Vec<u32> {
    let whole = ran.frames.iter().filter(|frame| frame.is_whole);
    whole.map(|frame| frame.number).collect()
}

/// How many lines of the log have this in them.
fn logged(ran: &Ran, part: &str) -> usize {
    ran.log.iter().filter(|line| line.contains(part)).count()
}

/// With a calibration in its slot, the board rectifies: as the host does, and in time. One that is for
/// another camera is told, and not used.
fn a_frame_of_raw_lines_as_on_the_host(board: &Board) -> Result<(), Failed> {
    let built_for = board.model.ok_or("the board has no model")?;
    let (program, firmware) = (
        model::build(board).map_err(failed)?,
        build(board).map_err(failed)?,
    );
    let scenario = Scenario {
        frames: 1,
        until_ms: 10_000,
        ..Scenario::default()
    };
    let pair = Pair::crooked(320, 240, built_for.disparities, true).map_err(failed)?;
    let ran = model::run(&program, &firmware, &pair, &scenario).map_err(failed)?;
    ran.report.ensure_all_accesses_taken().map_err(failed)?;
    assert_eq!(ran.report.resets, [""; 0]);
    assert_eq!(logged(&ran, "calibrated: "), 1);
    let expected = model::expected(&built_for, &pair).map_err(failed)?;
    let whole: Vec<_> = ran.frames.iter().filter(|frame| frame.is_whole).collect();
    assert_eq!(whole.len(), 1, "{:?}", ran.log);
    assert!(whole[0].disparities == expected.disparities);

    let other = Pair::crooked(300, 240, built_for.disparities, true).map_err(failed)?;
    let mistaken = Pair {
        rectification: other.rectification,
        ..model::built_in_pair(&built_for)
    };
    let scenario = Scenario {
        frames: 1,
        until_ms: 100,
        ..Scenario::default()
    };
    let ran = model::run(&program, &firmware, &mistaken, &scenario).map_err(failed)?;
    assert_eq!(logged(&ran, "the calibration is not used"), 1);
    assert_eq!(ran.report.resets, [""; 0]);
    Ok(())
}

/// Two whole frames, and between them one with a line that is too short.
fn two_frames_as_on_the_host_and_a_fault(board: &Board) -> Result<(), Failed> {
    let scenario = Scenario {
        frames: 3,
        faults: vec![ScriptedFault {
            frame: 1,
            line: 20,
            kind: FaultKind::Error(ErrorKind::ShortLine),
        }],
        until_ms: 10_000,
        ..Scenario::default()
    };
    let ran = run_modelled(board, &scenario)?;
    assert_eq!(whole_frames(&ran), [0, 2]);
    assert_eq!(ran.report.armed, [1, 1]);
    assert_eq!(logged(&ran, "Camera(ShortLine)"), 1);
    assert_eq!(logged(&ran, "warn"), 1);
    // The watchdog is fed once for each line, and started.
    assert!(ran.report.meals > 2 * 240);
    Ok(())
}

fn recovers_from_faults_at_the_wires(board: &Board) -> Result<(), Failed> {
    let kinds = [
        (20, ErrorKind::ShortLine),
        (30, ErrorKind::ShortFrame),
        (10, ErrorKind::Overrun),
        (15, ErrorKind::Timeout),
    ];
    let faults: Vec<_> = (0..)
        .zip(kinds)
        .map(|(frame, (line, kind))| ScriptedFault {
            frame,
            line,
            kind: FaultKind::Error(kind),
        })
        .collect();
    let scenario = Scenario {
        frames: 5,
        faults,
        until_ms: 20_000,
        ..Scenario::default()
    };
    let ran = run_modelled(board, &scenario)?;
    assert_eq!(whole_frames(&ran), [4]);
    for (line, kind) in kinds {
        let warning = format!("Camera({kind:?})");
        assert_eq!(logged(&ran, &warning), 1, "{warning} at line {line}");
    }
    let counters = "frames_dropped: 4";
    assert_eq!(logged(&ran, counters), 1, "{counters}");
    Ok(())
}

fn waits_for_sensors_and_sets_them_up_again(board: &Board) -> Result<(), Failed> {
    let scenario = Scenario {
        frames: 3,
        troubles: vec![
            // Both are late, the right one more.
            ("left-absent", 0, 400),
            ("right-absent", 0, 1100),
            // In the first frame the right sensor is unplugged for a moment, whose syncs the port
            // does not take, and in the second one the left sensor for longer.
            ("right-absent", 1700, 1750),
            ("left-absent", 2900, 3500),
        ],
        until_ms: 20_000,
        ..Scenario::default()
    };
    let ran = run_modelled(board, &scenario)?;
    assert_eq!(whole_frames(&ran).len(), 1, "of three frames");
    assert_eq!(ran.report.armed, [2, 2]);
    for side in ["left", "right"] {
        assert!(logged(&ran, &format!("no {side} sensor")) > 0);
        assert_eq!(logged(&ran, &format!("the {side} sensor was lost")), 1);
        assert_eq!(logged(&ran, &format!("the {side} sensor is set up")), 2);
    }
    assert!(logged(&ran, "Camera(Bus)") > 0);
    Ok(())
}

/// Wires of the camera port that are stuck, at the start and in frames.
fn recovers_from_stuck_wires(board: &Board) -> Result<(), Failed> {
    let scenario = Scenario {
        frames: 3,
        troubles: vec![
            // The first frame that is asked for does not come; the one after it does.
            ("clock-stuck", 0, 2000),
            // In the next one lines are not told: the first is cut.
            ("lvld-low", 3900, 4000),
            // In the third one nothing comes any more, until the watchdog has restarted the board.
            ("clock-stuck", 4900, 9500),
        ],
        until_ms: 14_000,
        ..Scenario::default()
    };
    let ran = run_modelled_restarted(board, &scenario, 1)?;
    assert_eq!(whole_frames(&ran).len(), 2, "before and after the restart");
    assert_eq!(logged(&ran, "Camera(ShortLine)"), 1);
    // Before the first frame, in the third one, and after the restart.
    assert_eq!(logged(&ran, "Camera(Timeout)"), 3);
    assert_eq!(logged(&ran, "timeouts: 1,"), 2, "counted");
    Ok(())
}

/// A chip that is no HM01B0 and a bus that is stuck for less than the watchdog waits: the board tells
/// both, and goes on without a restart.
fn waits_out_another_chip_and_a_stuck_bus(board: &Board) -> Result<(), Failed> {
    let scenario = Scenario {
        frames: 2,
        troubles: vec![
            ("left-other-chip", 0, 700),
            ("right-sda-low", 0, 1500),
            // Amid the first frame, in which the bus is not used, until after its end.
            ("left-sda-low", 2400, 3600),
        ],
        until_ms: 10_000,
        ..Scenario::default()
    };
    let ran = run_modelled(board, &scenario)?;
    assert_eq!(whole_frames(&ran).len(), 1, "of two frames");
    assert_eq!(ran.report.armed, [2, 1]);
    // The number of an HM0360, which has the same address.
    let stranger = "no left sensor, failure 1: WrongChip { found: 864, expected: 432 }";
    assert_eq!(logged(&ran, stranger), 1);
    let stuck = "no right sensor, failure 1: Bus(Timeout)";
    assert_eq!(logged(&ran, stuck), 1);
    assert_eq!(logged(&ran, "the left sensor was lost"), 1);
    let (others, buses) = (logged(&ran, "Camera(Other)"), logged(&ran, "Camera(Bus)"));
    assert!(others > 0 && buses > 0);
    let counters = format!("bus_errors: {buses}, other_errors: {others},");
    assert_eq!(logged(&ran, &counters), 1, "{counters}");
    assert_eq!(logged(&ran, "frames_dropped: 1,"), 1);
    Ok(())
}

/// A bus that is stuck for longer than the watchdog waits restarts the board, whose start frees the
/// chip's side of it.
fn restarts_when_a_bus_hangs(board: &Board) -> Result<(), Failed> {
    let scenario = Scenario {
        frames: 1,
        troubles: vec![("left-sda-low", 0, 4200)],
        until_ms: 10_000,
        ..Scenario::default()
    };
    let ran = run_modelled_restarted(board, &scenario, 1)?;
    assert_eq!(whole_frames(&ran), [0]);
    assert!(logged(&ran, "Bus(Timeout)") > 2);
    assert_eq!(ran.report.armed, [1, 1]);
    Ok(())
}
