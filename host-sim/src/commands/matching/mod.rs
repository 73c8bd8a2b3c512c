//! `vgstereo match`: matches pairs of images or of a recording, rectified before or by a calibration, and
//! writes maps of disparity and depth, points and scans.

mod batch;
mod many;
mod options;
mod plan;
mod recorded;
mod rows;
mod targets;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;

use self::options::Options;
use self::plan::{Kind, Plan};
use self::targets::Targets;
use crate::arguments::name_of;
use crate::escapes::shown;
use crate::files::{ensure_distinct_outputs, ensure_ending, make_folder, write_files};
use crate::images::bits_note;
use crate::pair_arguments::{Given, PairArguments};
use crate::pair_check::hints;
use crate::pair_files::Pair;
use crate::tables::{kib, milliseconds};
use crate::terminal::{Said, write_output};

/// The arguments of `vgstereo match`.
#[derive(Debug, Args)]
#[command(
    after_help = "Left column x matches right column x - d. The map is of the reference view.\n\n\
    A rectified pair:    vgstereo match left.png right.png --out disparity.png --d-max 59 --colour colour.png\n\
    Two cameras as are:  vgstereo match left.png right.png --calibration intrinsics.yml extrinsics.yml \\\n\
    \x20                    --unit mm --out disparity.png --depth depth.png\n\
    A cloud of points:   vgstereo match left.png right.png --focal 700 --baseline 60 \\\n\
    \x20                    --out disparity.png --points cloud.ply\n\
    Both in one image:   vgstereo match both.png --side-by-side --out disparity.png\n\
    \x20                    vgstereo match both.png --top-bottom --out disparity.png\n\n\
    Many pairs: {} in the names of what is written stands for the name of the pair, which is that of its left image \
    without what tells the side. Pairs that cannot be matched are named, the others are matched, and the exit code \
    is 2.\n\n\
    Of a folder:         vgstereo match pictures --out 'maps/{}.png' --colour 'colours/{}.png' --threads 4\n\
    Of two folders:      vgstereo match image_2 image_3 --out 'maps/{}.png'\n\
    Of a list:           vgstereo match pairs.txt --out 'maps/{}.png'\n\
    One after the other: vgstereo match l1.png r1.png l2.png r2.png --out 'maps/{}.pfm'\n\
    Of a recording:      vgstereo match walk.mcap --out 'maps/{}.png'\n\n\
    The images of a pair in a folder, or in folders in it, differ in the side alone: left_01.png right_01.png, \
    a_left.png a_right.png, 7-l.png 7-r.png, left/7.png right/7.png, cam0/7.png cam1/7.png, a/im0.png a/im1.png, \
    image_0/7.png image_1/7.png, or image_2 and image_3. A list has a left and a right image on each line, and a name \
    if wanted; tabs stand between names with spaces. With --side-by-side or --top-bottom each image is a pair.\n\n\
    The pairs of a recording are named for the numbers of their frames. Rectified pairs are matched as they are, and so \
    are raw ones unless the board rectifies: those take --calibration. The cameras are those that the board has told, \
    or of --calibration. Frames without a whole pair are left out and counted."
)]
pub struct Match {
    #[command(flatten)]
    images: PairArguments,
    #[command(flatten)]
    options: Options,
}

impl Match {
    /// Matches the pair or the pairs, writes the disparity maps and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason. Of one pair, nothing is written
    /// then; of many, those that could be matched are.
    pub fn run(self) -> Result<Said> {
        for path in self.options.colour.iter().chain(&self.options.confidence) {
            ensure_ending(path, "png")?;
        }
        match self.images.given()? {
            Given::One(pair) => {
                ensure!(!self.options.json, "--json is for many pairs");
                match_one(&self.options, &pair)
            }
            Given::Many(found) => many::run(&self.options, &found),
            Given::Recording(path) => recorded::run(&self.options, &path),
        }
    }
}

/// Matches a pair.
fn match_one(options: &Options, pair: &Pair) -> Result<Said> {
    let standard = Path::new("-");
    let targets = Targets::of(options);
    let mut inputs = pair.paths();
    inputs.extend(options.other_inputs());
    let outputs = targets.files();
    let mut outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
    // `-` is standard input or output.
    for paths in [&mut inputs, &mut outputs] {
        paths.retain(|path| *path != standard);
    }
    ensure_distinct_outputs(&inputs, &outputs).context(targets::OPTIONS)?;
    // What can be refused is, before anything is decoded.
    let files = pair.open()?;
    let plan = Plan::new(options, &targets, Kind::of_images(files.dimensions()?))?;
    let images = files.decode(options.bits)?;
    drop(files);
    let bits = images.bits;
    let mut done = plan.run(options, &targets, images, options.threads.get())?;
    if let Some(folder) = &targets.rectified {
        make_folder(folder)?;
    }
    let to_stdout = targets.out == standard;
    if to_stdout {
        let (map, others): (Vec<_>, _) = std::mem::take(&mut done.files)
            .into_iter()
            .partition(|(path, _)| path == standard);
        write_files(&others)?;
        for (_, bytes) in map {
            write_output(&bytes)?;
        }
    } else {
        write_files(&done.files)?;
    }
    let disparities = plan.disparities();
    let mut text = format!(
        "{}: {}x{} px, disparities {} to {}, {} ms, {} KiB of working memory, {} lines of latency\n",
        name_of(plan.parameters(), options.preset),
        plan.size()[0],
        plan.size()[1],
        disparities.range_px().start,
        disparities.range_px().end - 1,
        milliseconds(done.matched.time),
        kib(done.matched.working_bytes),
        done.matched.latency_lines
    );
    if let Some(bits) = bits {
        writeln!(text, "{}", bits_note(bits))?;
    }
    text += &plan.rectification_told()?;
    let rest = if options.sparse {
        "left out"
    } else {
        "filled in where it can be"
    };
    writeln!(
        text,
        "found {} % of the pixels; the rest is {rest}",
        done.found_percent()
    )?;
    if let Some(told) = plan.line_offsets_told(&done.matched) {
        writeln!(text, "{told}")?;
    }
    if !options.no_check {
        for hint in hints(&done.views, disparities)? {
            writeln!(text, "hint: {hint}")?;
        }
    }
    for (path, meaning) in plan.written(&targets) {
        match meaning {
            Some(meaning) => writeln!(text, "wrote {}: {meaning}", shown(&path))?,
            None => writeln!(text, "wrote {}", shown(&path))?,
        }
    }
    Ok(if to_stdout {
        Said::Aside(text)
    } else {
        Said::Output(text)
    })
}
