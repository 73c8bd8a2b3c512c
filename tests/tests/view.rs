//! `vgstereo view` in a browser: what the page shows is what a board has sent.
//!
//! The tests need Chromium: the command that `CHROMIUM` names, or `chromium`. Without it they are
//! listed as ignored. One browser serves them all, one test after the other.

use std::ffi::OsString;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use std::{fs, thread};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::{Value, json};
use vgstereo_boards::board::{Board, STM32F405};
use vgstereo_boards::bridge::Damage;
use vgstereo_boards::build::build;
use vgstereo_boards::host::{self, Frames};
use vgstereo_boards::live::{Link, LiveBoard};
use vgstereo_boards::model;
use vgstereo_boards::pair::Pair;
use vgstereo_boards::toolchain::ensure_complete;
use vgstereo_core::{DisparityRange, Preset};
use vgstereo_link::board::{Camera, FrameBegun, Hello, LinePair, View};
use vgstereo_link::{
    BoardMessage, Decoder, Encoder, HostMessage, Line, PixelFormat, Reason, Region, Selection,
    Streams, Values,
};
use vgstereo_sim::commands::CommandLine;
use vgstereo_sim::pictures::colour_disparities;
use vgstereo_tests::browser::{Browser, Page, chromium};
use vgstereo_tests::failed;

const WIDTH: u16 = 64;
const HEIGHT: u32 = 48;
const DISPARITY_COUNT: u16 = 48;
/// 100 px and 60 mm: 6 m at a disparity of 1 px.
const CAMERA: Camera = Camera {
    focal_q8: 100 << 8,
    principal_x_q8: 32 << 8,
    principal_y_q8: 24 << 8,
    depth_q8: 6000 << 8,
    offset_q8: 0,
};
/// Longest time in which a board is built.
const LONGEST_BUILD: Duration = Duration::from_secs(600);
/// Longest time that a frame of a board takes, on the model of a chip.
const LONGEST_FRAME: Duration = Duration::from_secs(400);
const SIZE: [u32; 2] = [1280, 800];
const PICTURE_SIZE: [u32; 2] = [1280, 930];

type Shared = Arc<Mutex<Option<Browser>>>;
type Case = fn(&mut Browser) -> Result<()>;

fn main() {
    let command = chromium();
    let is_missing = command.is_none();
    let browser: Shared = Arc::default();
    let cases: [(&str, Case); 4] = [
        (
            "shows_the_values_that_were_sent",
            shows_the_values_that_were_sent,
        ),
        ("counts_damage_and_goes_on", counts_damage_and_goes_on),
        (
            "asks_the_board_for_what_is_shown",
            asks_the_board_for_what_is_shown,
        ),
        (
            "commands_the_board_of_the_demo",
            commands_the_board_of_the_demo,
        ),
    ];
    let trials = cases.map(|(name, case)| {
        let (browser, command) = (Arc::clone(&browser), command.clone());
        let trial = move || run(&browser, command.as_ref(), case);
        Trial::test(name, trial).with_ignored_flag(is_missing)
    });
    let mut trials = Vec::from(trials);
    for board in Board::emulated() {
        let (browser, command) = (Arc::clone(&browser), command.clone());
        let trial = move || {
            run(&browser, command.as_ref(), |browser| {
                shows_a_damaged_link(&board, browser)
            })
        };
        let is_missing = is_missing || ensure_complete(&[board]).is_err() || board.is_variant();
        let trial = Trial::test(format!("{}::shows_a_damaged_link", board.name), trial);
        trials.push(trial.with_ignored_flag(is_missing));
    }
    for board in Board::modelled() {
        let (browser, command) = (Arc::clone(&browser), command.clone());
        let trial = move || {
            run(&browser, command.as_ref(), |browser| {
                shows_a_modelled_board(&board, browser)
            })
        };
        // It takes minutes, and is ignored unless it is asked for.
        let trial = Trial::test(format!("{}::shows_a_damaged_link", board.name), trial);
        trials.push(trial.with_ignored_flag(true));
    }
    let is_missing = is_missing || ensure_complete(&[STM32F405]).is_err();
    let (shared, named) = (Arc::clone(&browser), command.clone());
    let trial = move || run(&shared, named.as_ref(), starts_a_board_by_its_name);
    let trial = Trial::test("starts_a_board_by_its_name", trial);
    trials.push(trial.with_ignored_flag(is_missing));
    let outcome = libtest_mimic::run(&Arguments::from_args(), trials);
    drop(
        browser
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take(),
    );
    outcome.exit();
}

fn run(
    browser: &Shared,
    command: Option<&OsString>,
    case: impl FnOnce(&mut Browser) -> Result<()>,
) -> Result<(), Failed> {
    let mut browser = browser.lock().unwrap_or_else(PoisonError::into_inner);
    if browser.is_none() {
        let command = command.ok_or("there is no Chromium")?;
        *browser = Some(Browser::start(command).map_err(failed)?);
    }
    let browser = browser.as_mut().ok_or("there is no browser")?;
    case(browser).map_err(failed)
}

/// Runs `vgstereo view` with these arguments, and returns the address of its page. It goes on until
/// the tests end.
fn view(arguments: &[&str]) -> Result<String> {
    let free = TcpListener::bind("127.0.0.1:0")?.local_addr()?.to_string();
    let words = [&["vgstereo", "view", "--listen", &free], arguments].concat();
    let command = CommandLine::try_parse_from(words)?;
    thread::spawn(move || command.run());
    for _ in 0..1000 {
        let Ok(mut stream) = TcpStream::connect(&free) else {
            thread::sleep(Duration::from_millis(10));
            continue;
        };
        // The page is served when the source is open, for which a board may have to be built.
        stream.set_read_timeout(Some(LONGEST_BUILD))?;
        stream.write_all(format!("GET / HTTP/1.1\r\nHost: {free}\r\n\r\n").as_bytes())?;
        stream.read_exact(&mut [0])?;
        return Ok(format!("http://{free}/"));
    }
    anyhow::bail!("the page does not come")
}

/// The disparity of a pixel in a frame, 1/16 px: a slope with holes.
fn disparity_q4(frame: u32, x: usize, y: usize) -> i16 {
    if (x / 8 + y / 8).is_multiple_of(7) {
        return i16::MIN;
    }
    (16 + 11 * x + 3 * y + 5 * frame as usize) as i16
}

fn confidence(x: usize, y: usize) -> u8 {
    (x * 3 + y) as u8
}

fn map(frame: u32) -> Vec<i16> {
    let pixels = (0..HEIGHT as usize).flat_map(|y| (0..usize::from(WIDTH)).map(move |x| (x, y)));
    pixels.map(|(x, y)| disparity_q4(frame, x, y)).collect()
}

fn hello() -> BoardMessage<'static> {
    let view = View {
        width_px: WIDTH,
        height_lines: HEIGHT,
        format: PixelFormat::Grey8,
    };
    BoardMessage::Hello(Hello {
        device: "feeder",
        firmware: "1",
        raw: view,
        matched: view,
        preset: "lite",
        disparity_min_px: 0,
        disparity_count: DISPARITY_COUNT,
        latency_lines: 12,
        streams: Streams::from_bits(0x7),
        calibration_crc32: None,
        rectifies: false,
        piece_bytes_max: 0,
    })
}

fn begun(frame: u32) -> BoardMessage<'static> {
    BoardMessage::FrameBegun(FrameBegun {
        frame,
        timestamp_us: 0,
        region: Region {
            x_px: 0,
            y_lines: 0,
            width_px: WIDTH,
            height_lines: HEIGHT,
        },
    })
}

/// The packets of a frame: its beginning, for each line disparities and confidences, and its end.
fn frame_packets(encoder: &mut Encoder<'_>, frame: u32) -> Vec<Vec<u8>> {
    let mut packets = vec![];
    let mut send = |message: &BoardMessage<'_>| {
        let time_us = 1000 * u64::from(frame);
        packets.push(encoder.encode(time_us, message).unwrap().to_vec());
    };
    send(&begun(frame));
    let map = map(frame);
    for (line, values) in (0..).zip(map.chunks(WIDTH.into())) {
        send(&BoardMessage::Disparities(Line {
            frame,
            line,
            column: 0,
            values: Values::Plain(values),
        }));
        let confidences: Vec<u8> = (0..values.len())
            .map(|x| confidence(x, line as usize))
            .collect();
        send(&BoardMessage::Confidences(Line {
            frame,
            line,
            column: 0,
            values: Values::Plain(&confidences),
        }));
    }
    send(&BoardMessage::FrameDone { frame });
    packets
}

/// Points at a pixel of a panel, and returns the values that the page then shows.
fn values_at(page: &mut Page<'_>, panel: &str, x: usize, y: usize) -> Result<Value> {
    let place = format!(
        "(() => {{ const pixels = document.querySelector('[data-panel={panel}] .pixels');
           const box = pixels.getBoundingClientRect();
           const [across, down] = [({x} + 0.5) / pixels.width, ({y} + 0.5) / pixels.height];
           return [box.left + box.width * across, box.top + box.height * down]; }})()"
    );
    let is_there = format!("vgstereo.values?.x === {x} && vgstereo.values.y === {y}");
    // While frames come, the panels may still move.
    for _ in 0..100 {
        let place = page.evaluate(&place)?;
        let [left, top] = [0, 1].map(|axis| place[axis].as_f64().unwrap_or(-1.0));
        page.point_at(1.0, 1.0)?;
        page.point_at(left, top)?;
        if page.evaluate(&is_there)? == true {
            break;
        }
        thread::sleep(Duration::from_millis(50));
    }
    page.wait_until(&is_there)?;
    page.evaluate("({ ...document.getElementById('readout').dataset })")
}

fn shows_the_values_that_were_sent(browser: &mut Browser) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("recording.bin");
    let mut memory = vec![0; 4096];
    let mut encoder = Encoder::new(&mut memory);
    let mut bytes = encoder.encode(0, &hello())?.to_vec();
    bytes.extend(encoder.encode(0, &BoardMessage::Camera(CAMERA))?);
    bytes.extend(frame_packets(&mut encoder, 7).concat());
    fs::write(&path, bytes)?;
    let address = view(&[path.to_str().context("a path")?])?;
    let mut page = browser.open(&format!("{address}#disparity,depth,confidence"), SIZE)?;
    page.wait_until("vgstereo.frame?.frame === 7 && 'depths' in vgstereo.frame.planes")?;
    for (panel, x, y) in [
        ("disparity", 0, 0),
        ("disparity", 10, 3),
        ("depth", 63, 47),
        ("confidence", 31, 20),
        ("disparity", 62, 1),
    ] {
        let shown = values_at(&mut page, panel, x, y)?;
        let expected = match disparity_q4(7, x, y) {
            i16::MIN => ["none".to_owned(), "none".to_owned()],
            q4 => [
                q4.to_string(),
                (6000.0 * 16.0 / f64::from(q4)).round().to_string(),
            ],
        };
        let [disparity, depth] = expected;
        let confidence = confidence(x, y).to_string();
        let expected = json!({
            "x": x.to_string(), "y": y.to_string(),
            "disparity_q4": disparity, "depth_mm": depth, "confidence": confidence,
        });
        ensure!(shown == expected, "{panel}: {shown} is not {expected}");
    }
    // The keys of the arrows move on from there.
    page.evaluate("document.querySelector('[data-panel=disparity] .marks').focus()")?;
    page.press("ArrowDown")?;
    page.press("ArrowLeft")?;
    page.wait_until("vgstereo.values.x === 61 && vgstereo.values.y === 2")?;
    // The colours are those of the files that `match` writes.
    let pixels = page.evaluate(
        "(() => { const canvas = document.querySelector('[data-panel=disparity] .pixels');
           const { width, height } = canvas;
           return [...canvas.getContext('2d').getImageData(0, 0, width, height).data]; })()",
    )?;
    let pixels: Vec<u8> = serde_json::from_value(pixels)?;
    let range = DisparityRange {
        minimum_px: 0,
        count: DISPARITY_COUNT,
    };
    let map = map(7);
    let picture = colour_disparities(&map, WIDTH.into(), range);
    ensure!(
        pixels.len() == 4 * map.len(),
        "{} bytes of pixels",
        pixels.len()
    );
    let pairs = pixels.chunks(4).zip(picture.pixels()).zip(&map);
    for ((shown, expected), _) in pairs.filter(|(_, q4)| **q4 != i16::MIN) {
        // The page has 256 colours.
        let is_near = shown
            .iter()
            .zip(expected.0)
            .all(|(&a, b)| a.abs_diff(b) <= 4);
        ensure!(is_near, "{shown:?} is not {expected:?}");
    }
    Ok(())
}

fn counts_damage_and_goes_on(browser: &mut Browser) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("recording.bin");
    let mut memory = vec![0; 4096];
    let mut encoder = Encoder::new(&mut memory);
    let hello = encoder.encode(0, &hello())?.to_vec();
    let mut damaged = frame_packets(&mut encoder, 1);
    // The disparities of line 4 lose a byte, and in those of line 9 a bit is flipped.
    damaged[1 + 2 * 4].remove(9);
    damaged[1 + 2 * 9][12] ^= 0x10;
    let whole = frame_packets(&mut encoder, 2);
    fs::write(&path, [hello.clone(), damaged.concat()].concat())?;
    let address = view(&[path.to_str().context("a path")?, "--fast"])?;
    let mut page = browser.open(&format!("{address}#disparity"), SIZE)?;
    page.wait_until("vgstereo.frame?.frame === 1")?;
    let missing = page.evaluate("vgstereo.frame.planes.disparities.missing")?;
    ensure!(missing == json!([[4, 1], [9, 1]]), "{missing}");
    let shown = values_at(&mut page, "disparity", 20, 4)?;
    ensure!(shown["disparity_q4"] == "none", "{shown}");
    let shown = values_at(&mut page, "disparity", 20, 5)?;
    ensure!(
        shown["disparity_q4"] == json!(disparity_q4(1, 20, 5).to_string()),
        "{shown}"
    );
    page.wait_until(
        "document.querySelector('[data-panel=disparity] .mark').textContent.includes('missing')",
    )?;
    drop(page);

    fs::write(&path, [hello, damaged.concat(), whole.concat()].concat())?;
    let address = view(&[path.to_str().context("a path")?, "--fast"])?;
    let mut page = browser.open(&format!("{address}#disparity"), SIZE)?;
    page.wait_until("vgstereo.frame?.frame === 2 && vgstereo.frame.is_whole")?;
    page.wait_until("vgstereo.status.source.kind === 'ended'")?;
    let counted = page.evaluate(
        "Object.fromEntries([...document.querySelectorAll('#counters dd')]
           .map((dd) => [dd.dataset.name, dd.textContent]))",
    )?;
    for (name, count) in [
        ("frames whole", "1"),
        ("frames with gaps", "1"),
        ("packets broken", "2"),
        ("packets lost", "2"),
    ] {
        ensure!(counted[name] == count, "{name}: {counted}");
    }
    page.wait_until("document.getElementById('faults').textContent === '5'")
}

/// The damage of a board's bytes on their way to the page: amid its first frame.
fn damaged_link() -> Link {
    Link::local(Damage {
        dropped: vec![3_000],
        flipped: vec![9_000],
    })
}

/// An emulated board over a damaged link.
fn shows_a_damaged_link(board: &Board, browser: &mut Browser) -> Result<()> {
    let pair = Pair::rendered(64, 40, 16);
    let request = pair.live_request(Preset::Lite, &[])?;
    let (expected, _) = host::run(&pair, &pair.request(Preset::Lite, 1, &[])?)?;
    let firmware = build(board)?;
    let live = LiveBoard::emulated(board, &firmware, &[pair], &request, damaged_link())?;
    let places = [(0, 0), (13, 5), (31, 20), (40, 33), (63, 39)];
    shows_whole_frames_after_damage(
        live,
        &expected,
        (64, &places),
        "#disparity,confidence",
        browser,
    )
}

/// A real board on the model of its chip over a damaged link.
fn shows_a_modelled_board(board: &Board, browser: &mut Browser) -> Result<()> {
    let built_for = board.model.context("there is a model")?;
    let pair = model::built_in_pair(&built_for);
    let expected = model::expected(&built_for, &pair)?;
    let (program, firmware) = (model::build(board)?, build(board)?);
    let live = LiveBoard::modelled(board, &program, &firmware, &pair, damaged_link())?;
    let width = built_for.size.0 as usize;
    // Those that the window shows.
    let places = [(0, 0), (100, 50), (160, 100), (300, 140), (319, 150)];
    // Its serial port has room for disparities alone.
    shows_whole_frames_after_damage(live, &expected, (width, &places), "#disparity", browser)
}

/// The page shows values that equal those that the host computes, at places in views of a width, counts a
/// byte that was dropped and one in which a bit was flipped, and shows whole frames after them.
fn shows_whole_frames_after_damage(
    live: LiveBoard,
    expected: &Frames,
    (width, places): (usize, &[(usize, usize)]),
    panels: &str,
    browser: &mut Browser,
) -> Result<()> {
    let address = view(&[&live.address().to_string()])?;
    let mut page = browser.open(&format!("{address}{panels}"), SIZE)?;
    let counter = |name: &str| {
        format!("+document.querySelector('#counters [data-name=\"{name}\"]')?.textContent")
    };
    // A host that comes amid a packet has one more that is broken, which does not count as lost.
    page.wait_long_until(&format!("{} >= 2", counter("packets lost")), LONGEST_FRAME)?;
    ensure!(page.evaluate(&format!("{} >= 2", counter("packets broken")))? == true);
    let whole = page.evaluate(&counter("frames whole"))?;
    let more = format!("{} > {whole}", counter("frames whole"));
    page.wait_long_until(&more, LONGEST_FRAME)?;
    page.wait_until("vgstereo.frame.is_whole")?;
    let expected_q4 = expected.disparities_q4();
    for &(x, y) in places {
        let shown = values_at(&mut page, "disparity", x, y)?;
        let at = y * width + x;
        let disparity = match expected_q4[at] {
            i16::MIN => "none".to_owned(),
            q4 => q4.to_string(),
        };
        ensure!(
            shown["disparity_q4"] == disparity,
            "{x}, {y}: {shown} is not {disparity}"
        );
        let confidence = expected.confidences[at].to_string();
        let is_shown = panels.contains("confidence");
        ensure!(
            !is_shown || shown["confidence"] == confidence,
            "{x}, {y}: {shown} is not {confidence}"
        );
    }
    // A whole frame, value by value.
    page.evaluate("document.querySelector('[data-key=f]').click()")?;
    let values = page.evaluate("[...vgstereo.frame.planes.disparities.values]")?;
    let values: Vec<i16> = serde_json::from_value(values)?;
    ensure!(values == expected_q4, "the frame differs");
    drop(live);
    page.wait_until("!document.getElementById('notice').hidden")
}

/// `--board` builds and starts the board.
fn starts_a_board_by_its_name(browser: &mut Browser) -> Result<()> {
    let address = view(&["--board", STM32F405.name])?;
    let mut page = browser.open(&format!("{address}#raw,disparity"), SIZE)?;
    page.wait_until("vgstereo.frame?.is_whole && 'disparities' in vgstereo.frame.planes")
}

/// The end of a board that tests play themselves.
struct Player {
    stream: TcpStream,
    encoder: Encoder<'static>,
    decoder: Decoder<'static>,
}

impl Player {
    fn accept(listener: &TcpListener) -> Result<Self> {
        let (stream, _) = listener.accept()?;
        stream.set_read_timeout(Some(Duration::from_secs(20)))?;
        Ok(Self {
            stream,
            encoder: Encoder::new(vec![0; 4096].leak()),
            decoder: Decoder::new(vec![0; 1024].leak()),
        })
    }

    fn send(&mut self, message: &BoardMessage<'_>) -> Result<()> {
        Ok(self.stream.write_all(self.encoder.encode(0, message)?)?)
    }

    /// Waits until the host asks for these streams alone.
    fn wait_for(&mut self, wanted: Streams) -> Result<()> {
        loop {
            // Byte by byte: what follows a command stays in the stream.
            let mut byte = [0];
            self.stream
                .read_exact(&mut byte)
                .with_context(|| format!("no {wanted:?}"))?;
            let mut rest = &byte[..];
            if let Some(Ok(packet)) = self.decoder.next::<HostMessage<'_>>(&mut rest)
                && let HostMessage::Select(Selection { streams, .. }) = packet.message
                && streams == wanted
            {
                return Ok(());
            }
        }
    }
}

fn asks_the_board_for_what_is_shown(browser: &mut Browser) -> Result<()> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = view(&[&listener.local_addr()?.to_string()])?;
    let mut board = Player::accept(&listener)?;
    board.send(&hello())?;
    let mut page = browser.open(&format!("{address}#disparity"), SIZE)?;
    board.wait_for(Streams::DISPARITIES)?;
    page.evaluate("document.querySelector('[data-show=disparity]').click()")?;
    board.wait_for(Streams::NONE)?;
    // By its key.
    page.press("r")?;
    board.wait_for(Streams::RAW)?;
    board.send(&begun(3))?;
    let views = |line: u32| {
        let bytes = |first: u8| {
            (0..WIDTH as u8)
                .map(|x| first + x + line as u8)
                .collect::<Vec<u8>>()
        };
        [bytes(10), bytes(100)]
    };
    for line in (0..HEIGHT).filter(|&line| line != 6) {
        let [left, right] = views(line);
        board.send(&BoardMessage::RawPair(LinePair {
            frame: 3,
            line,
            format: PixelFormat::Grey8,
            left: &left,
            right: &right,
        }))?;
    }
    board.send(&BoardMessage::FrameDone { frame: 3 })?;
    page.wait_until("vgstereo.frame?.frame === 3")?;
    page.wait_until("document.querySelector('[data-panel=raw] .pixels').width === 128")?;
    let pixel = |x: usize, y: u32| {
        format!(
            "document.querySelector('[data-panel=raw] .pixels').getContext('2d')
               .getImageData({x}, {y}, 1, 1).data[0]"
        )
    };
    for (x, y) in [(0, 0), (63, 5), (64, 7), (127, 47)] {
        let shown = page.evaluate(&pixel(x, y))?;
        let expected = views(y).concat()[x];
        ensure!(shown == expected, "{x}, {y}: {shown} is not {expected}");
    }
    // Stripes, where the line is missing.
    let stripes = [page.evaluate(&pixel(2, 6))?, page.evaluate(&pixel(6, 6))?];
    ensure!(stripes[0] != stripes[1], "{stripes:?}");

    board.send(&begun(4))?;
    let reason = Reason::CameraTimeout;
    board.send(&BoardMessage::FrameAborted { frame: 4, reason })?;
    page.wait_until(
        "document.querySelector('[data-panel=raw] .mark').textContent
           .includes('sent nothing in time')",
    )?;
    let held = page.evaluate("vgstereo.frame.frame")?;
    ensure!(held == 3, "{held}");
    drop(board);
    page.wait_until("!document.getElementById('notice').hidden")?;
    let mut board = Player::accept(&listener)?;
    board.wait_for(Streams::RAW)?;
    page.wait_until("document.getElementById('notice').hidden")
}

fn commands_the_board_of_the_demo(browser: &mut Browser) -> Result<()> {
    let address = view(&["--demo"])?;
    let shown = "#raw,disparity,depth,cloud,scan";
    let mut page = browser.open(&format!("{address}{shown}"), PICTURE_SIZE)?;
    page.wait_until("vgstereo.frame?.scan?.ranges_mm.some((mm) => mm > 0)")?;
    page.wait_until("vgstereo.frame.planes.depths.values.some((mm) => mm > 0)")?;
    page.wait_until("vgstereo.status.frames.whole > 2")?;
    page.press("b")?;
    values_at(&mut page, "disparity", 145, 150)?;
    // The picture of docs/view.md.
    fs::write(
        Path::new(env!("CARGO_TARGET_TMPDIR")).join("view.jpg"),
        page.screenshot()?,
    )?;
    page.press("t")?;
    page.wait_until("vgstereo.status.state.source === 1")?;
    page.wait_until("document.getElementById('pattern').getAttribute('aria-pressed') === 'true'")?;
    page.evaluate(
        "(() => { const slider = document.querySelector('[name=margin]');
           slider.value = 77;
           slider.dispatchEvent(new Event('input', { bubbles: true })); })()",
    )?;
    page.wait_until("vgstereo.status.state.parameters.margin === 77")?;
    page.press("x")?;
    page.wait_until("vgstereo.status.state.is_started === false")?;
    page.wait_until("document.getElementById('run').textContent.startsWith('Start')")?;
    // Every control can be reached and has a name, and each button tells its key.
    let nameless = page.evaluate(
        "[...document.querySelectorAll('button, input, summary, .marks')]
           .filter((one) => one.tabIndex < 0 || !(one.getAttribute('aria-label')
             || one.textContent.trim() || one.labels?.[0]?.textContent.trim())).length
         + [...document.querySelectorAll('button')]
           .filter((one) => one.querySelector('kbd')?.textContent.toLowerCase()
             !== one.dataset.key).length",
    )?;
    ensure!(
        nameless == 0,
        "{nameless} controls have no name, no key or no place"
    );
    drop(page);
    for size in [[360, 740], [740, 360]] {
        let mut page = browser.open(&format!("{address}#disparity,depth,raw"), size)?;
        page.wait_until("vgstereo.status !== null && vgstereo.status.board !== null")?;
        let wide = page.evaluate("document.documentElement.scrollWidth > innerWidth")?;
        ensure!(wide == false, "the page is wider than {size:?}");
    }
    Ok(())
}
