//! `tools/calibrate.py`: real boards are calibrated as well as OpenCV can, rendered ones to the cameras that
//! rendered them, what spoils a calibration is named, and `vgstereo calibration` reads what is written. Then what a
//! person does with it, from pictures of a board to distances: of files, and over the link.
//!
//! The tests run if the Python that `PYTHON` names, or else `python3`, has what `tools/requirements.txt`
//! lists. Some need the pictures of Debian's package `opencv-doc` as well, in its folder or that which
//! `OPENCV_DOC_DIR` names, or those of `UNRECTIFIED_DIR`. What is missing is listed as ignored.

mod over_link;
mod walk;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use anyhow::{Context, Error, Result, ensure};
use clap::Parser;
use glam::DVec2;
use libtest_mimic::{Arguments, Trial};
use tempfile::TempDir;
use vgstereo_sim::calibration::{Lens, RectifiedPair, StereoCalibration, read};
use vgstereo_sim::commands::CommandLine;
use vgstereo_sim::terminal::Said;
use vgstereo_tests::command::vgstereo;
use vgstereo_tests::failed;
use vgstereo_tests::python::{Outcome, Python};

/// Pairs of real boards: the folder, the board and its squares; and options of `--check`: the files, and
/// the unit that they leave open.
const BOARDS: [(&str, &str, &str, &[&str]); 3] = [
    (
        "stereopi_board",
        "9x6",
        "25mm",
        &["intrinsics.yml", "extrinsics.yml", "--unit", "cm"],
    ),
    (
        "opencv_board",
        "9x6",
        "25mm",
        &["intrinsics.yml", "extrinsics.yml", "--unit", "25"],
    ),
    (
        "bumblebee_board",
        "4x6",
        "30mm",
        &["left.yaml", "right.yaml", "--unit", "mm"],
    ),
];

fn main() {
    let python = Python::find();
    let folder = |variable, usual: &str| {
        let named = std::env::var_os(variable).map_or_else(|| usual.into(), PathBuf::from);
        named.is_dir().then_some(named)
    };
    let documents = folder("OPENCV_DOC_DIR", "/usr/share/doc/opencv-doc/examples/data");
    let boards = folder("UNRECTIFIED_DIR", "/nowhere");
    let mut trials = Vec::new();
    let mut add = |name: &str, needed: &[&Option<PathBuf>], test: Test| {
        let folders: Option<Vec<PathBuf>> = needed.iter().map(|&folder| folder.clone()).collect();
        let is_absent = folders.is_none();
        let test = move |python: &Python| test(python, &folders.context("a folder is missing")?);
        trials.push(trial(name, &python, is_absent, test));
    };
    add("names", &[], Box::new(|python, _| names(python)));
    add("numbering", &[], Box::new(|python, _| numbering(python)));
    add(
        "archives_of_numpy",
        &[],
        Box::new(|python, _| archives(python)),
    );
    add("refusals", &[], Box::new(|python, _| refusals(python)));
    add(
        "rendered::spoilt",
        &[],
        Box::new(|python, _| spoilt(python)),
    );
    for (name, render, options) in RENDERED {
        let test: Test = Box::new(|python, _| rendered(python, render, options));
        add(&format!("rendered::{name}"), &[], test);
    }
    add(
        "opencv_doc::calibrated_to_a_fifth_of_a_pixel",
        &[&documents],
        Box::new(|python, folders| documented(python, &folders[0])),
    );
    add(
        "opencv_doc::corners_that_others_found_are_on_one_line",
        &[&documents, &boards],
        Box::new(|python, folders| others_corners(python, &folders[0], &folders[1])),
    );
    for (name, board, square, calibration) in BOARDS {
        let folder = move |folders: &[PathBuf]| folders[0].join(name);
        add(
            &format!("{name}::corners_are_those_that_are_stored"),
            &[&boards],
            Box::new(move |python, folders| corners(python, &folder(folders), board)),
        );
        add(
            &format!("{name}::check_measures_what_was_measured"),
            &[&boards],
            Box::new(move |python, folders| {
                checked(python, &folder(folders), board, square, calibration)
            }),
        );
    }
    let pictures = Arc::new(BoardPictures::new().unwrap());
    let of_walk = Arc::clone(&pictures);
    let walk = move |python: &Python| walk::walk(python, &of_walk);
    trials.push(trial("walk", &python, false, walk));
    let of_link = Arc::clone(&pictures);
    let over_link = move |python: &Python| over_link::walk(python, &of_link);
    trials.push(trial(
        "over_link",
        &python,
        over_link::is_absent(),
        over_link,
    ));
    let conclusion = libtest_mimic::run(&Arguments::from_args(), trials);
    // The process ends without dropping what is left.
    drop(pictures);
    conclusion.exit();
}

/// Returns a test with this Python, ignored if that or anything else that it needs is absent.
fn trial(
    name: &str,
    python: &Option<Python>,
    is_absent: bool,
    test: impl FnOnce(&Python) -> Result<()> + Send + 'static,
) -> Trial {
    let is_absent = is_absent || python.is_none();
    let python = python.clone();
    let run = move || test(&python.context("there is no Python with OpenCV")?);
    let run = move || run().map_err(failed);
    Trial::test(name, run).with_ignored_flag(is_absent)
}

/// The pictures of a board that `demo --board` makes, which two tests take: they are made once.
struct BoardPictures {
    folder: TempDir,
    made: OnceLock<Result<(), String>>,
}

impl BoardPictures {
    /// Pairs of pictures.
    const PAIRS: usize = 20;

    fn new() -> std::io::Result<Self> {
        let folder = tempfile::tempdir()?;
        let made = OnceLock::new();
        Ok(Self { folder, made })
    }

    /// Returns the folder of the pictures, which are made if they are not there.
    fn folder(&self) -> Result<&Path> {
        let folder = self.folder.path();
        let pairs = Self::PAIRS.to_string();
        let make = || vgstereo([&"demo", &"--board", &folder, &"--poses", &pairs]);
        let made = self
            .made
            .get_or_init(|| make().map_err(|error| format!("{error:#}")));
        made.clone().map_err(Error::msg)?;
        Ok(folder)
    }
}

type Test = Box<dyn FnOnce(&Python, &[PathBuf]) -> Result<()> + Send>;

/// Rendered pairs: options of the renderer, and of the tool.
const RENDERED: [(&str, &[&str], &[&str]); 5] = [
    ("pinhole", &[], &["--board", "9x6"]),
    (
        "fisheye",
        &["--lens", "fisheye", "--pairs", "16"],
        &["--board", "9x6", "--fisheye"],
    ),
    (
        "charuco",
        &["--charuco", "--board", "8x5", "--pairs", "16"],
        &["--board", "8x5", "--charuco", "4X4_100", "--marker", "18mm"],
    ),
    // Boards that look the same when they are turned, where either end may be numbered first.
    (
        "even_board_on_its_side",
        &["--board", "8x6", "--roll", "90"],
        &["--board", "8x6"],
    ),
    (
        "square_board_on_its_corner",
        &["--board", "5x5", "--roll", "45"],
        &["--board", "5x5"],
    ),
];

/// The cameras that rendered a board are found: points in space that they see come to one line, at their
/// distance.
fn rendered(python: &Python, render: &[&str], options: &[&str]) -> Result<()> {
    let folder = tempfile::tempdir()?;
    python.render_boards(folder.path(), render);
    let told = calibrated(python, folder.path(), options)?;
    print!("{told}");
    ensure_true(folder.path())
}

/// Pairs that spoil a calibration are named with the reason, and without them the cameras are found.
fn spoilt(python: &Python) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let faults = ["--moved", "3", "--covered", "5", "--bent", "7"];
    python.render_boards(folder.path(), &faults);
    let told = calibrated(python, folder.path(), &["--board", "9x6"])?;
    let named = |told: &str, pair: &str, words: &str| {
        let line = told.lines().find(|line| {
            line.starts_with(&format!("left_{pair}.png right_{pair}.png")) && line.contains(": ")
        });
        ensure!(
            line.is_some_and(|line| line.contains(words)),
            "{pair}, {words:?}: {told}"
        );
        Ok(())
    };
    named(&told, "05", "not seen whole in right_05.png")?;
    // By 6, 0 and 5 mm.
    named(&told, "03", "spoils it: the board stands 8 mm elsewhere")?;
    named(&told, "07", "spoils it: the corners in left_07.png are")?;
    let spoilers = told.lines().filter(|line| line.contains("spoils it:"));
    ensure!(spoilers.count() == 2, "{told}");
    ensure!(ensure_true(folder.path()).is_err(), "spoilt, and true");
    let told = calibrated(python, folder.path(), &["--board", "9x6", "--drop"])?;
    named(&told, "03", "left out: the board stands")?;
    named(&told, "07", "left out: the corners")?;
    ensure_true(folder.path())?;
    // What was moved is seen with the true calibration as well.
    let truth = folder.path().join("truth.yml");
    let truth = truth.to_str().context("a name")?;
    let outcome = python.calibrate(
        folder.path(),
        &["--board", "9x6", "--square", "25mm", "--check", truth],
    );
    named(&succeeded(&outcome)?, "03", "its vertical error is")
}

/// The 13 pairs of OpenCV's samples, whose own calibration is off by 1.79 px.
fn documented(python: &Python, pictures: &Path) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("calibration.yml");
    let told = calibrated_to(python, pictures, &["--board", "9x6"], &out)?;
    println!("{told}");
    ensure!(told.starts_with("13 pairs of 640x480 px"), "{told}");
    let (vertical_px, _) = after(&told, "vertical error ")?;
    ensure!(vertical_px <= 0.2, "{vertical_px} px");
    ensure!(!told.contains("spoils it"), "{told}");
    // Others calibrated these pictures to 3.316 squares of 25 mm, and 527 px for both cameras.
    let told = understood(&out, folder.path())?;
    let (baseline_mm, rest) = after(&told, "baseline ")?;
    ensure!(
        (baseline_mm / 82.9 - 1.0).abs() < 0.01 && rest.starts_with(" mm"),
        "{told}"
    );
    let (focal_px, _) = after(&told, "distortion, focal length ")?;
    ensure!((focal_px / 527.2 - 1.0).abs() < 0.02, "{told}");
    Ok(())
}

/// Corners of one of these pairs that were found by another program lie on one line of both views, once
/// they are rectified by the simulator.
fn others_corners(python: &Python, pictures: &Path, boards: &Path) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("calibration.yml");
    calibrated_to(python, pictures, &["--board", "9x6"], &out)?;
    let pair = rectified(&read_file(&out)?)?;
    let mut squares = Vec::new();
    for numbers in stored_corners(&boards.join("opencv_board"))? {
        let [left, right] = [0, 1].map(|view: usize| {
            pair.rectified_ray(view, DVec2::from_slice(&numbers[2 + 2 * view..]))
        });
        let off_px = (left.context("left")? - right.context("right")?).y * pair.focal_px;
        squares.push(off_px * off_px);
    }
    let rms_px = root_mean(&squares);
    println!("{} corners, vertical rms {rms_px:.3} px", squares.len());
    // By the calibration beside them it is 0.17 px.
    ensure!(squares.len() == 54 && rms_px <= 0.2, "{rms_px} px");
    Ok(())
}

/// Corners are within 0.2 px of where another program found them.
fn corners(python: &Python, folder: &Path, board: &str) -> Result<()> {
    let stored = stored_corners(folder)?;
    for (view, name) in ["left.png", "right.png"].iter().enumerate() {
        let script = "import pathlib, sys\n\
                      from calibration import board, pictures\n\
                      columns, rows = map(int, sys.argv[2].split('x'))\n\
                      picture = pictures.grey(pathlib.Path(sys.argv[1]))\n\
                      for x, y in board.Chessboard(columns, rows, 1.0).find(picture).px:\n\
                      \x20   print(x, y)\n";
        let path = folder.join(name);
        let path = path.to_str().context("a name")?;
        let found = succeeded(&python.run(&["-c", script, path, board]))?;
        let found = found.lines().map(|line| {
            let numbers: Vec<f64> = line.split(' ').map(str::parse).collect::<Result<_, _>>()?;
            Ok(DVec2::from_slice(&numbers))
        });
        let found: Vec<DVec2> = found.collect::<Result<_>>()?;
        ensure!(found.len() == stored.len(), "{} corners", found.len());
        let mut largest_px: f64 = 0.0;
        for numbers in &stored {
            let at = DVec2::from_slice(&numbers[2 + 2 * view..]);
            let nearest = found.iter().map(|found| found.distance(at));
            largest_px = largest_px.max(nearest.fold(f64::INFINITY, f64::min));
        }
        println!("{name}: largest distance {largest_px:.3} px");
        ensure!(largest_px <= 0.2, "{name}: {largest_px} px");
    }
    Ok(())
}

/// `--check` measures the vertical error and the squares of a real pair as they were measured with OpenCV.
fn checked(
    python: &Python,
    folder: &Path,
    board: &str,
    square: &str,
    calibration: &[&str],
) -> Result<()> {
    let files = calibration.iter().map(|word| match word.rsplit_once('.') {
        Some(_) => folder.join(word).display().to_string(),
        None => (*word).to_owned(),
    });
    let files: Vec<String> = files.collect();
    let mut options = vec!["--board", board, "--square", square];
    options.extend(["--left", "left.png", "--right", "right.png", "--check"]);
    options.extend(files.iter().map(String::as_str));
    let told = succeeded(&python.calibrate(folder, &options))?;
    print!("{told}");
    let meta: toml::Table = fs::read_to_string(folder.join("meta.toml"))?.parse()?;
    let number = |table: &str, key: &str| {
        let value = meta[table].get(key).and_then(toml::Value::as_float);
        value.with_context(|| key.to_owned())
    };
    // The tool's errors are at the scale of the pictures, the stored ones at that of the rectified views.
    let stored = stored_corners(folder)?;
    let squares = stored
        .iter()
        .map(|numbers| (numbers[7] - numbers[9]).powi(2));
    let squares: Vec<f64> = squares.collect();
    let (vertical_px, rest) = after(&told, "vertical error ")?;
    let (focal_px, _) = after(rest, "focal length of ")?;
    let expected_px = root_mean(&squares) * focal_px / number("rectified", "focal_px")?;
    println!("stored corners: {expected_px:.3} px at that scale");
    ensure!(
        (vertical_px - expected_px).abs() <= 0.03,
        "{vertical_px} px, not {expected_px}"
    );
    let (square_mm, _) = after(&told, "squares measure ")?;
    let share = number("board", "square_measured")? / number("board", "square")?;
    let (true_mm, _) = after(&told, "given are ")?;
    let expected_mm = share * true_mm;
    ensure!(
        (square_mm / expected_mm - 1.0).abs() < 0.004,
        "{square_mm} mm, not {expected_mm}"
    );
    Ok(())
}

/// Pictures are paired by their names.
fn names(python: &Python) -> Result<()> {
    let script = "import pathlib, sys\n\
                  from calibration import pictures\n\
                  folder = pathlib.Path(sys.argv[1])\n\
                  pairs, alone = pictures.pairs_by_name(folder)\n\
                  for paths in [*pairs, *([path] for path in alone)]:\n\
                  \x20   print(*(path.relative_to(folder).as_posix() for path in paths))\n";
    let cases: [(&[&str], &[&str]); 9] = [
        // In the order of their numbers.
        (
            &["left10.png", "left2.png", "right2.png", "right10.png"],
            &["left2.png right2.png", "left10.png right10.png"],
        ),
        (
            &["01_left.jpg", "01_RIGHT.jpg"],
            &["01_left.jpg 01_RIGHT.jpg"],
        ),
        (&["left/1.png", "right/1.png"], &["left/1.png right/1.png"]),
        (
            &["left/left1.png", "right/right1.png"],
            &["left/left1.png right/right1.png"],
        ),
        (&["cam0/7.png", "cam1/7.png"], &["cam0/7.png cam1/7.png"]),
        (
            &["a_l.png", "a_r.png", "L1.png", "R1.png"],
            &["L1.png R1.png", "a_l.png a_r.png"],
        ),
        (
            &["imageLeft3.png", "imageRight3.png"],
            &["imageLeft3.png imageRight3.png"],
        ),
        // No pictures, no sides, and one without a partner.
        (
            &[
                "left.yml",
                "right.yml",
                "bright1.png",
                "control1.png",
                "left_01.png",
            ],
            &["left_01.png"],
        ),
        (&["left1.png", "right1.jpg"], &["left1.png", "right1.jpg"]),
    ];
    for (files, expected) in cases {
        let folder = tempfile::tempdir()?;
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().context("a folder")?)?;
            fs::write(path, "")?;
        }
        let path = folder.path().to_str().context("a name")?;
        let found = succeeded(&python.run(&["-c", script, path]))?;
        let found: Vec<&str> = found.lines().collect();
        ensure!(found == expected, "{files:?}: {found:?}");
    }
    Ok(())
}

/// A right view whose board was numbered from another end is numbered as the left one.
fn numbering(python: &Python) -> Result<()> {
    let script = "import numpy\n\
                  from calibration.board import Chessboard, Seen\n\
                  for columns, rows in (9, 6), (8, 6), (7, 5), (5, 5), (6, 6):\n\
                  \x20   board = Chessboard(columns, rows, 1.0)\n\
                  \x20   for degrees in range(0, 360, 30):\n\
                  \x20       turn = numpy.radians(degrees)\n\
                  \x20       turn = numpy.array([[numpy.cos(turn), -numpy.sin(turn)],\n\
                  \x20                           [numpy.sin(turn), numpy.cos(turn)]])\n\
                  \x20       ids = numpy.arange(columns * rows)\n\
                  \x20       px = 100 + 20 * board.points(ids)[:, :2] @ turn.T\n\
                  \x20       for turns in range(0, 4, 1 if columns == rows else 2):\n\
                  \x20           grid = numpy.rot90(px.reshape(rows, columns, 2), turns)\n\
                  \x20           right = Seen(ids, grid.reshape(-1, 2) + [-30, 2], None)\n\
                  \x20           found, is_mended = board.matched(Seen(ids, px, None), right)\n\
                  \x20           assert is_mended == (turns != 0), (columns, rows, degrees, turns)\n\
                  \x20           assert numpy.allclose(found.px, px + [-30, 2])\n";
    succeeded(&python.run(&["-c", script])).map(drop)
}

/// Archives that `NumPy` writes are read: matrices of several types, by rows and by columns.
fn archives(python: &Python) -> Result<()> {
    let script = "import sys, numpy\n\
                  camera = lambda f: numpy.array([[f, 0, 160], [0, f, 120], [0, 0, 1.0]])\n\
                  s, c = 0.6, 0.8\n\
                  matrices = dict(\n\
                  \x20   cameraMatrix1=camera(300), distCoeffs1=numpy.array([[-0.2, 0.1, 0, 0, 0.01]]),\n\
                  \x20   cameraMatrix2=camera(310).astype('f4'), distCoeffs2=numpy.zeros(8),\n\
                  \x20   R=numpy.asfortranarray([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),\n\
                  \x20   T=numpy.array([[-60.0], [1], [2]]), imageSize=numpy.array([320, 240]),\n\
                  \x20   rvecs=numpy.array([numpy.zeros((3, 1)), None], object),\n\
                  \x20   map1=numpy.zeros((240, 320, 2), 'f4'))\n\
                  numpy.savez(sys.argv[1] + '/stored.npz', **matrices)\n\
                  numpy.savez_compressed(sys.argv[1] + '/deflated.npz', **matrices)\n";
    let folder = tempfile::tempdir()?;
    let path = folder.path().to_str().context("a name")?;
    succeeded(&python.run(&["-c", script, path]))?;
    for name in ["stored.npz", "deflated.npz"] {
        let found = read_file(&folder.path().join(name))?;
        let [left, right] = found.cameras;
        ensure!(
            left.focal_px.x == 300.0 && right.focal_px.x == 310.0,
            "{found:?}"
        );
        let lens = Lens::radial_tangential(&[-0.2, 0.1, 0.0, 0.0, 0.01])?;
        ensure!(left.lens == lens && right.lens == Lens::radial_tangential(&[])?);
        ensure!(left.size == Some([320, 240]) && found.unit_mm.is_none());
        ensure!(found.translation.to_array() == [-60.0, 1.0, 2.0]);
        // What is ahead to the right of the left camera is turned down by the right one.
        let turned = found.rotation * glam::DVec3::X;
        ensure!(
            turned.abs_diff_eq(glam::DVec3::new(0.8, 0.6, 0.0), 1e-12),
            "{turned}"
        );
    }
    Ok(())
}

/// A folder below that of the pictures, options, and words of the refusal.
type Refusal<'a> = (&'a str, &'a [&'a [&'a str]], &'a [&'a str]);

/// What cannot be used is one line on the screen that names it, and nothing is written.
fn refusals(python: &Python) -> Result<()> {
    let folder = tempfile::tempdir()?;
    python.render_boards(folder.path(), &["--pairs", "5"]);
    let pictures = folder.path();
    fs::write(pictures.join("bad.yml"), "M1: [1, 2\n")?;
    fs::write(pictures.join("few.yml"), "M1: [1, 2]\n")?;
    let broken = tempfile::tempdir()?;
    for name in ["left1.png", "right1.png"] {
        fs::write(broken.path().join(name), "no picture")?;
    }
    let broken = broken.path().to_str().context("a name")?;
    let out = pictures.join("out.yml");
    let out = out.to_str().context("a name")?;
    let file = |name: &str| pictures.join(name).display().to_string();
    let (bad, few, truth, none) = (
        file("bad.yml"),
        file("few.yml"),
        file("truth.yml"),
        file("none/out.yml"),
    );
    let board = ["--board", "9x6", "--square", "25mm"];
    let exchanged = ["--left", "right_*", "--right", "left_*", "--out", out];
    let cases: [Refusal<'_>; 14] = [
        (
            "",
            &[&["--board", "9x6", "--square", "25", "--out", out]],
            &["--square", "25mm"],
        ),
        (
            "",
            &[&["--board", "9x6", "--square", "0mm", "--out", out]],
            &["--square", "0mm"],
        ),
        (
            "",
            &[&["--board", "9 6", "--square", "25mm", "--out", out]],
            &["--board", "9x6"],
        ),
        // Squares instead of the corners between them.
        (
            "",
            &[&["--board", "10x7", "--square", "25mm", "--out", out]],
            &["10x7", "9x6"],
        ),
        ("", &[&board], &["--out"]),
        ("", &[&board, &["--out", &none]], &["--out", "none/out.yml"]),
        (
            "",
            &[&board, &["--out", out, "--left", "left_*"]],
            &["--left", "--right"],
        ),
        (
            "",
            &[&board, &["--out", out, "--charuco", "4X4_50"]],
            &["--marker"],
        ),
        (
            "",
            &[
                &board,
                &[
                    "--left",
                    "left_0[12]*",
                    "--right",
                    "right_0[12]*",
                    "--out",
                    out,
                ],
            ],
            &["2 pairs", "5"],
        ),
        ("", &[&board, &exchanged], &["exchanged"]),
        ("nowhere", &[&board, &["--out", out]], &["nowhere"]),
        (
            broken,
            &[&board, &["--out", out]],
            &["left1.png", "no picture"],
        ),
        ("", &[&board, &["--check", &bad]], &["bad.yml"]),
        ("", &[&board, &["--check", &few]], &["few.yml", "M1 D1"]),
    ];
    for (below, options, words) in cases {
        let outcome = python.calibrate(&pictures.join(below), &options.concat());
        let said = &outcome.stderr;
        ensure!(
            outcome.code == Some(2) && said.starts_with("error: ") && said.lines().count() == 1,
            "{options:?}: {outcome:?}"
        );
        ensure!(
            words.iter().all(|word| said.contains(word)),
            "{words:?}: {said}"
        );
        ensure!(
            !Path::new(out).exists(),
            "{options:?}: something is written"
        );
    }
    // The pictures themselves are good.
    let outcome = python.calibrate(pictures, &[&board[..], &["--check", &truth]].concat());
    ensure!(succeeded(&outcome)?.contains("is good"), "{outcome:?}");
    Ok(())
}

/// What a program said that succeeded.
fn succeeded(outcome: &Outcome) -> Result<String> {
    ensure!(outcome.code == Some(0), "{outcome:?}");
    Ok(outcome.stdout.clone())
}

/// Calibrates the pictures of a folder to its `calibration.yml`, and returns what is told.
fn calibrated(python: &Python, folder: &Path, options: &[&str]) -> Result<String> {
    calibrated_to(python, folder, options, &folder.join("calibration.yml"))
}

fn calibrated_to(python: &Python, folder: &Path, options: &[&str], out: &Path) -> Result<String> {
    let common = ["--square", "25mm", "--out", out.to_str().context("a name")?];
    succeeded(&python.calibrate(folder, &[options, &common].concat()))
}

fn read_file(path: &Path) -> Result<StereoCalibration> {
    read(&[(path.display().to_string(), fs::read(path)?)])
}

/// The rectification that the simulator makes of a calibration.
fn rectified(calibration: &StereoCalibration) -> Result<RectifiedPair> {
    let size = calibration.cameras[0].size.context("no size")?;
    RectifiedPair::compute(calibration, size, size, false)
}

/// What `vgstereo calibration` tells about a file, from which it makes a rectification.
fn understood(file: &Path, folder: &Path) -> Result<String> {
    let out = folder.join("cameras.vgr");
    let command = ["vgstereo", "calibration"].map(PathBuf::from);
    let files = [file.to_owned(), "--out".into(), out.clone()];
    let said = CommandLine::try_parse_from([&command[..], &files].concat())?.run()?;
    ensure!(fs::metadata(out)?.len() > 0);
    match said {
        Said::Output(told) => Ok(told),
        Said::Aside(told) => anyhow::bail!("aside: {told}"),
    }
}

/// `calibration.yml` in a folder is that of the cameras in its `truth.yml`: what these see, near and far and
/// but for the borders, where there were few corners, is rectified to one line and to its distance.
fn ensure_true(folder: &Path) -> Result<()> {
    let file = folder.join("calibration.yml");
    let truth = read_file(&folder.join("truth.yml"))?;
    let told = understood(&file, folder)?;
    let found = read_file(&file)?;
    ensure!(found.unit_mm == Some(1.0), "{:?}", found.unit_mm);
    ensure!(found.warnings.is_empty(), "{:?}", found.warnings);
    let is_fisheye = |calibration: &StereoCalibration| {
        calibration.cameras[0].lens.to_string().contains("fisheye")
    };
    ensure!(is_fisheye(&found) == is_fisheye(&truth), "{told}");
    let pair = rectified(&found)?;
    let focal_px = found.cameras[0].focal_px.y;
    let last = DVec2::from(pair.raw_size.map(f64::from)) - 1.0;
    let (mut vertical, mut along) = (Vec::new(), Vec::new());
    for step in 0..17 * 13 {
        let share = DVec2::new(f64::from(step % 17) / 16.0, f64::from(step / 17) / 12.0);
        let at = (share * 0.6 + 0.2) * last;
        let ray = truth.cameras[0].ray(at).context("no ray")?;
        for distance_mm in [300.0, 700.0, 2000.0] {
            let point = ray.extend(1.0).normalize() * distance_mm;
            let seen = truth.rotation * point + truth.translation;
            let (other, _) = truth.cameras[1].project(seen);
            let [left, right] = [pair.rectified_ray(0, at), pair.rectified_ray(1, other)];
            let (left, right) = (left.context("left")?, right.context("right")?);
            vertical.push(((left.y - right.y) * focal_px).powi(2));
            // The disparity that the distance from the left camera asks for.
            let expected = truth.translation.length() * left.extend(1.0).length() / distance_mm;
            along.push(((left.x - right.x - expected) * focal_px).powi(2));
        }
    }
    let [vertical_px, along_px] = [vertical, along].map(|squares| root_mean(&squares));
    println!("vertical rms {vertical_px:.3} px, disparities off by {along_px:.3} px rms");
    // At most 0.07 and 0.13 px when the bounds were set.
    ensure!(
        vertical_px <= 0.1 && along_px <= 0.2,
        "vertical rms {vertical_px} px, disparities {along_px} px"
    );
    Ok(())
}

/// The rows of `corners.csv`: row, column, raw left and right, rectified left and right place, and more.
fn stored_corners(folder: &Path) -> Result<Vec<Vec<f64>>> {
    let text = fs::read_to_string(folder.join("corners.csv"))?;
    let rows = text.lines().skip(1);
    rows.map(|row| Ok(row.split(',').map(str::parse).collect::<Result<_, _>>()?))
        .collect()
}

fn root_mean(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The number behind these words, and what follows it.
fn after<'a>(text: &'a str, words: &str) -> Result<(f64, &'a str)> {
    let at = text
        .find(words)
        .with_context(|| format!("no {words:?} in {text}"))?;
    let rest = &text[at + words.len()..];
    let end = rest
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(rest.len());
    let (number, rest) = rest.split_at(end);
    Ok((
        number
            .parse()
            .with_context(|| format!("{words:?}: {number:?}"))?,
        rest,
    ))
}
