//! The walk from raw pictures to recorded depths over the link, as a person takes it with a board on the
//! bench: `vgstereo capture`, `tools/calibrate.py`, `vgstereo calibration --send`, `vgstereo record` and
//! `vgstereo replay`. The board is an emulated one that looks through the distorted built-in cameras.
//!
//! It needs the board's compiler and emulator as well (`cargo firmware setup`).

use std::fs;
use std::io::Read;
use std::net::TcpStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use image::ImageReader;
use vgstereo_boards::board::{Board, MPS2_AN500};
use vgstereo_boards::bridge::Damage;
use vgstereo_boards::build::build;
use vgstereo_boards::host;
use vgstereo_boards::live::{Link, LiveBoard};
use vgstereo_boards::pair::Pair;
use vgstereo_boards::toolchain;
use vgstereo_core::geometry::Rectification;
use vgstereo_core::{DisparityRange, Preset, Reference};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_sim::link::attended::Attended;
use vgstereo_sim::link::board::Frame;
use vgstereo_sim::link::client::Memory;
use vgstereo_sim::link::source::Source;
use vgstereo_sim::render::{RenderOptions, render_distorted};
use vgstereo_tests::command::vgstereo;
use vgstereo_tests::python::Python;

use super::BoardPictures;

const BOARD: Board = MPS2_AN500;
/// Pairs of pictures that the cameras are calibrated by.
const PAIRS: &str = "16";
/// Frames that are recorded, beside those under way when the streams are selected.
const RECORDED: usize = 3;
const DISPARITIES: u16 = 60;
/// Longest time that anything may take.
const LONG: Duration = Duration::from_secs(120);

/// Returns whether the board's compiler or its emulator is missing.
pub(crate) fn is_absent() -> bool {
    toolchain::ensure_complete(&[BOARD]).is_err()
}

/// Takes the walk.
pub(crate) fn walk(python: &Python, poses: &BoardPictures) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let pictures = folder.join("pictures");
    let [calibration, cameras] = ["calibration.yml", "cameras.vgr"].map(|name| folder.join(name));
    let frames = frames(poses.folder()?)?;
    let request = frames[0].live_request(Preset::Lite, &[])?;
    let link = Link::local(Damage::default());
    let board = LiveBoard::emulated(&BOARD, &build(&BOARD)?, &frames, &request, link)?;
    let address = board.address().to_string();

    // The courtyard shows no board of squares, and is passed over.
    vgstereo([
        &"capture",
        &address,
        &pictures,
        &"--corners",
        &"9x6",
        &"--seen-only",
        &"--count",
        &PAIRS,
    ])?;
    let outcome = python.calibrate(
        &pictures,
        &[
            "--board",
            "9x6",
            "--square",
            "40mm",
            "--out",
            calibration.to_str().context("a name")?,
        ],
    );
    ensure!(outcome.code == Some(0), "{}", outcome.stderr);
    vgstereo([
        &"calibration",
        &calibration,
        &"--keep",
        &"valid",
        &"--out",
        &cameras,
    ])?;
    vgstereo([&"calibration", &cameras, &"--send", &address])?;

    let recording = folder.join("walk.mcap");
    vgstereo([
        &"record",
        &address,
        &recording,
        &"--streams",
        &"rectified,disparities,confidences,depths",
        &"--frames",
        &RECORDED.to_string(),
    ])?;
    drop(board);

    let recorded = all_frames(&recording)?;
    check(&recorded, &frames, &fs::read(&cameras)?)?;
    // Taken out, and played to a host, these are the same bytes and frames.
    let plain = folder.join("walk.bin");
    vgstereo([&"replay", &recording, &"--out", &plain])?;
    ensure!(
        all_frames(&plain)? == recorded,
        "other frames were taken out"
    );
    ensure!(
        played(&recording)? == fs::read(&plain)?,
        "other bytes were played"
    );
    Ok(())
}

/// What the cameras see in turn: the courtyard, and the board of squares in all poses.
fn frames(poses: &Path) -> Result<Vec<Pair>> {
    let (courtyard, _) = render_distorted(&RenderOptions::default())?;
    let pair = |name: String, views: [image::RgbImage; 2]| {
        let [left, right] = views;
        Pair {
            name,
            left,
            right,
            format: PixelFormat::Grey8,
            disparities: DisparityRange::up_to(DISPARITIES - 1),
            rectification: None,
            camera: None,
        }
    };
    let mut frames = vec![pair(courtyard.name, [courtyard.left, courtyard.right])];
    for pose in 1..=BoardPictures::PAIRS {
        let view = |side: &str| -> Result<image::RgbImage> {
            let path = poses.join(format!("{side}_{pose:02}.png"));
            Ok(ImageReader::open(path)?.decode()?.to_rgb8())
        };
        frames.push(pair(
            format!("pose {pose}"),
            [view("left")?, view("right")?],
        ));
    }
    Ok(frames)
}

/// Checks that the recorded frames are what the host makes of the same views with the same calibration.
fn check(recorded: &[Frame], frames: &[Pair], cameras: &[u8]) -> Result<()> {
    ensure!(recorded.len() >= RECORDED, "{} frames", recorded.len());
    let camera = Rectification::from_bytes(cameras)?.camera(Reference::Left);
    let depth = camera.context("the baseline is known")?.depth();
    let whole = recorded.iter().filter(|frame| frame.is_whole());
    let mut checked = 0;
    for frame in whole {
        let Some(depths) = &frame.depths else {
            // It was under way when the streams were selected.
            continue;
        };
        let seen = Pair {
            rectification: Some(cameras.to_vec()),
            ..frames[frame.begun.frame as usize % frames.len()].clone()
        };
        let (expected, _) = host::run(&seen, &seen.request(Preset::Lite, 1, &[])?)?;
        let disparities_q4 = &frame.disparities.as_ref().context("disparities")?.values;
        ensure!(
            *disparities_q4 == expected.disparities_q4(),
            "other disparities"
        );
        let confidences = &frame.confidences.as_ref().context("confidences")?.values;
        ensure!(*confidences == expected.confidences, "other confidences");
        let depths_mm = disparities_q4.iter().map(|&q4| depth.mm(q4));
        ensure!(depths.values.iter().copied().eq(depths_mm), "other depths");
        ensure!(frame.rectified.is_some(), "no rectified views");
        checked += 1;
    }
    ensure!(checked >= RECORDED, "{checked} whole frames");
    Ok(())
}

/// All frames of a recording.
fn all_frames(recording: &Path) -> Result<Vec<Frame>> {
    let source = Source::File {
        path: recording.to_owned(),
        is_fast: true,
    };
    let mut memory = Memory::default();
    let mut attended = Attended::open(&source, &mut memory)?;
    let mut frames = vec![];
    while let Some(frame) = attended.frame()? {
        frames.push(*frame);
    }
    Ok(frames)
}

/// The bytes that a host gets when a recording is played to it.
fn played(recording: &Path) -> Result<Vec<u8>> {
    // A port that was free a moment ago.
    let address = std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?;
    let (path, listen) = (recording.to_owned(), address.to_string());
    let player =
        thread::spawn(move || vgstereo([&"replay", &path, &"--fast", &"--listen", &listen]));
    let begun = Instant::now();
    let mut host = loop {
        match TcpStream::connect(address) {
            Ok(host) => break host,
            Err(error) => ensure!(begun.elapsed() < LONG, "{address}: {error}"),
        }
        thread::sleep(Duration::from_millis(20));
    };
    let mut bytes = vec![];
    host.read_to_end(&mut bytes)?;
    drop(host);
    player.join().expect("it does not panic")?;
    Ok(bytes)
}
