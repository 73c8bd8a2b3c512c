//! Instructions of a frame and of its kernels, and of sending and receiving its disparities, counted by Valgrind: the same in every run,
//! whatever else the machine does, so that a small regression shows.
//!
//! `cargo bench --bench instructions` counts, compares with `instructions.txt` beside this file
//! and fails where a count grew by more than 2 %; `-- --save` writes that file. It needs
//! `valgrind`. Counts are of the portable kernels, and change with the compiler too.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, ensure};
use vgstereo_core::{Config, DisparityLine, DisparityRange, Preset};
use vgstereo_courtyard::{Courtyard, Side};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_frame::{Matched, Views, match_frame};
use vgstereo_kernels::NativeKernels;
use vgstereo_link::{BoardMessage, Decoder, Encoder, Line, Streams, Values, memory_bytes};

const WIDTH: u16 = 160;
const HEIGHT: u16 = 120;
const D_MAX: u16 = 31;

/// The function in which instructions are counted.
const MEASURED: &str = "measured_frame";

const KERNELS: [&str; 9] = [
    "smooth_row",
    "pack_cells",
    "recall_row",
    "mask_block",
    "cost_run",
    "aggregate_row",
    "arms_row",
    "median9_row",
    "weighted_median_row",
];

/// What is counted besides the presets: the link's two ends for the disparities of a frame.
const LINK: [&str; 2] = ["link-send", "link-receive"];

/// A count that grew by more than this is a regression, percent.
const TOLERANCE_PERCENT: f64 = 2.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match arguments.as_slice() {
        [word, subject] if word == MEASURED => measure(subject).map(|()| true),
        arguments => report(arguments.iter().any(|argument| argument == "--save")),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// What runs under Valgrind: a frame of the built-in scene with a preset, or the link with that of
/// `lite`.
fn measure(subject: &str) -> Result<()> {
    let preset: Preset = if LINK.contains(&subject) {
        Preset::Lite
    } else {
        subject.parse()?
    };
    let views = rendered();
    let config = Config {
        colour: views.has_colour(),
        ..Config::new(preset.parameters(), WIDTH, DisparityRange::up_to(D_MAX))
    };
    if !LINK.contains(&subject) {
        black_box(measured_frame(&config, &views)?);
        return Ok(());
    }
    let matched = match_frame(&config, &views, portable()?, 1)?;
    let mut memory = [0; memory_bytes(
        WIDTH,
        vgstereo_link::PixelFormat::Grey8,
        Streams::DISPARITIES,
    )];
    let mut encoder = Encoder::new(&mut memory);
    if subject == LINK[0] {
        let bytes = measured_frame_sent(&mut encoder, &matched);
        ensure!(black_box(bytes) > 0, "a frame does not fit the link");
        return Ok(());
    }
    let mut stream = Vec::new();
    for line in matched.lines(WIDTH) {
        stream.extend_from_slice(encoder.encode(0, &message(&line))?);
    }
    let mut memory = [0; memory_bytes(
        WIDTH,
        vgstereo_link::PixelFormat::Grey8,
        Streams::DISPARITIES,
    )];
    let lines = measured_frame_received(&mut Decoder::new(&mut memory), &stream);
    ensure!(lines == u32::from(HEIGHT), "lines are lost");
    Ok(())
}

/// The built-in scene, without noise.
fn rendered() -> Views {
    let (width, height) = (WIDTH.into(), HEIGHT.into());
    let mut yard = Courtyard::new(width, height, 0, D_MAX, 1, 1.0);
    yard.furnish();
    let view = |side| {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let light =
            |(x, y): (u32, u32)| yard.exposed(side, x.into(), y.into(), &|x, y| Some([x, y]));
        // The cast saturates.
        pixels
            .flat_map(light)
            .map(|light| (255.0 * light.sqrt() + 0.5) as u8)
            .collect()
    };
    Views::new(
        view(Side::Left),
        view(Side::Right),
        WIDTH,
        PixelFormat::Rgb888,
    )
}

/// The lines of a frame of disparities, as packets.
#[inline(never)]
fn measured_frame_sent(encoder: &mut Encoder<'_>, matched: &Matched) -> usize {
    let mut bytes = 0;
    // No closure, whose name would have that of this function.
    for line in matched.lines(WIDTH) {
        bytes += encoder.encode(0, &message(&line)).map_or(0, <[u8]>::len);
    }
    bytes
}

/// The number of lines that these bytes have, each of which is unpacked.
#[inline(never)]
fn measured_frame_received(decoder: &mut Decoder<'_>, mut stream: &[u8]) -> u32 {
    let mut values = [0; WIDTH as usize];
    let mut lines = 0;
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut stream) {
        let Ok(packet) = received else { continue };
        if let BoardMessage::Disparities(line) = packet.message
            && line.values.unpack(&mut values).is_ok()
        {
            black_box(&values);
            lines += 1;
        }
    }
    lines
}

fn message<'a>(line: &DisparityLine<'a>) -> BoardMessage<'a> {
    BoardMessage::Disparities(Line {
        frame: 0,
        line: line.line,
        column: line.column,
        values: Values::Plain(line.disparities_q4),
    })
}

fn portable() -> Result<NativeKernels> {
    NativeKernels::available().next().context("no kernel set")
}

#[inline(never)]
fn measured_frame(config: &Config, views: &Views) -> Result<Matched> {
    Ok(match_frame(config, views, portable()?, 1)?)
}

/// Counts all presets and the link; whether none of the counts grew.
fn report(save: bool) -> Result<bool> {
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/instructions.txt");
    let before: BTreeMap<String, u64> = std::fs::read_to_string(&stored)
        .unwrap_or_default()
        .lines()
        .filter_map(|line| {
            let (name, count) = line.rsplit_once(' ')?;
            Some((name.trim().to_owned(), count.parse().ok()?))
        })
        .collect();
    println!(
        "instructions of a frame, {WIDTH}x{HEIGHT}, {} disparities",
        D_MAX + 1
    );
    let pixel_disparities = f64::from(WIDTH) * f64::from(HEIGHT) * f64::from(D_MAX + 1);
    let (mut text, mut holds) = (String::new(), true);
    let presets = Preset::ALL.map(Preset::name);
    for subject in presets.into_iter().chain(LINK) {
        for (name, count) in counts(subject)? {
            let name = format!("{subject} {name}");
            let change = before.get(&name).map(|&before| {
                let change = 100.0 * (count as f64 / before as f64 - 1.0);
                holds &= change <= TOLERANCE_PERCENT;
                format!("{change:+.2} %")
            });
            println!(
                "{name:<30} {count:>12} {:>7.2} per pixel and disparity  {}",
                count as f64 / pixel_disparities,
                change.unwrap_or_default()
            );
            text += &format!("{name:<30} {count}\n");
        }
    }
    if save {
        std::fs::write(&stored, text)?;
        return Ok(true);
    }
    Ok(holds)
}

/// Instructions of the whole frame and, among them, of each kernel.
fn counts(subject: &str) -> Result<Vec<(&'static str, u64)>> {
    let folder = tempfile::tempdir()?;
    let profile = folder.path().join("callgrind.out");
    let run = |command: &mut Command| -> Result<String> {
        let program = command.get_program().to_string_lossy().into_owned();
        let output = command.output().with_context(|| program.clone())?;
        let errors = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{program}: {errors}");
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    };
    run(Command::new("valgrind")
        .arg("--tool=callgrind")
        .arg(format!("--callgrind-out-file={}", profile.display()))
        .arg(format!("--toggle-collect=*{MEASURED}*"))
        .arg(std::env::current_exe()?)
        .args([MEASURED, subject]))?;
    let annotated = run(Command::new("callgrind_annotate")
        .args(["--inclusive=yes", "--threshold=100"])
        .arg(&profile))?;
    // Lines are "count (percent) file:function [object]".
    let count_of = |function: &str| -> Option<u64> {
        let line = annotated.lines().find(|line| line.contains(function))?;
        let count = line.split_whitespace().next()?.replace(',', "");
        count.parse().ok()
    };
    let total = count_of("PROGRAM TOTALS").context("callgrind_annotate gave no total")?;
    let mut counts = vec![("frame", total)];
    for kernel in KERNELS {
        let function = format!("NativeKernels as vgstereo_core::kernel::Kernels>::{kernel}");
        counts.extend(count_of(&function).map(|count| (kernel, count)));
    }
    Ok(counts)
}
