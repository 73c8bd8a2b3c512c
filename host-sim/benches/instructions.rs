//! Instructions of a frame and of its kernels, counted by Valgrind: the same in every run,
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
use vgstereo_core::{Config, DisparityRange, Preset};
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::frame::{Matched, match_frame};
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::views::Views;

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

/// A count that grew by more than this is a regression, percent.
const TOLERANCE_PERCENT: f64 = 2.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match arguments.as_slice() {
        [word, preset] if word == MEASURED => frame(preset).map(|()| true),
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

/// What runs under Valgrind: a frame of the built-in scene.
fn frame(preset: &str) -> Result<()> {
    let preset: Preset = preset.parse()?;
    let scene = render(&RenderOptions {
        width: WIDTH.into(),
        height: HEIGHT.into(),
        d_max: D_MAX,
        ..RenderOptions::default()
    });
    let views = Views::new(scene.left.clone(), scene.right.clone(), false)?;
    let config = Config {
        colour: views.has_colour(),
        ..Config::new(preset.parameters(), WIDTH, DisparityRange::up_to(D_MAX))
    };
    black_box(measured_frame(&config, &views)?);
    Ok(())
}

#[inline(never)]
fn measured_frame(config: &Config, views: &Views) -> Result<Matched> {
    let portable = NativeKernels::available().next().context("no kernel set")?;
    Ok(match_frame(config, views, portable, 1)?)
}

/// Counts all presets; whether none of the counts grew.
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
    for preset in Preset::ALL {
        for (name, count) in counts(preset)? {
            let name = format!("{preset} {name}");
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
fn counts(preset: Preset) -> Result<Vec<(&'static str, u64)>> {
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
        .args([MEASURED, preset.name()]))?;
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
