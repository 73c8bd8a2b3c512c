//! The link on lines that were found: how many bytes they take, and what a decoder in another
//! language makes of them.
//!
//! Teddy needs `MIDDLEBURY_DIR`, and the decoder `python3`; what cannot run is listed as ignored.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs};

use libtest_mimic::{Arguments, Failed, Trial};
use vgstereo_core::{Output, Preset};
use vgstereo_frame::Matched;
use vgstereo_link::board::FrameBegun;
use vgstereo_link::pack::{pack, packed_bytes_max};
use vgstereo_link::{
    BoardMessage, Decoder, Encoder, FrameAssembler, Line, PixelFormat, Region, Sample, Streams,
    Values, memory_bytes,
};
use vgstereo_sim::dataset::load_scene;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::scene::Scene;
use vgstereo_tests::failed;

/// Bytes that a disparity in 1/16 px may take on average, packed.
const BYTES_MAX: f64 = 0.6;

const PRESETS: [Preset; 3] = [Preset::Lite, Preset::Micro, Preset::Balanced];

fn main() {
    let mut trials = Vec::new();
    for preset in PRESETS {
        for (output, name) in [(Output::Dense, "dense"), (Output::Sparse, "with_gaps")] {
            trials.push(Trial::test(
                format!("bytes::built_in::{preset}::{name}"),
                move || is_packed(&built_in(), preset, output),
            ));
            let folder = env::var_os("MIDDLEBURY_DIR").map(PathBuf::from);
            let absent = folder.is_none();
            let teddy = Trial::test(format!("bytes::teddy::{preset}::{name}"), move || {
                let folder = folder.unwrap_or_default().join("teddy");
                let scene = load_scene(&folder).map_err(failed)?;
                is_packed(&scene, preset, output)
            });
            trials.push(teddy.with_ignored_flag(absent));
        }
    }
    trials.push(Trial::test("frames_arrive_as_they_were_sent", || {
        frames_arrive_as_they_were_sent();
        Ok(())
    }));
    let python = Command::new("python3").arg("--version").output();
    let absent = !python.is_ok_and(|output| output.status.success());
    for (name, test) in [
        (
            "python::understands_the_packets_of_the_document",
            python_understands_the_packets_of_the_document as fn() -> Result<(), Failed>,
        ),
        (
            "python::understands_a_recorded_stream",
            python_understands_a_recorded_stream,
        ),
    ] {
        trials.push(Trial::test(name, test).with_ignored_flag(absent));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

fn built_in() -> Scene {
    render(&RenderOptions::default())
}

fn matched(scene: &Scene, preset: Preset, output: Output) -> Matched {
    let prepared = Prepared::new(scene.clone(), false).unwrap();
    prepared.matched(preset.parameters(), output, 1).unwrap()
}

/// Bytes that a value of these lines takes packed.
fn bytes_per_value<'a, T: Sample + 'a>(lines: impl Iterator<Item = &'a [T]>) -> f64 {
    let (mut taken, mut values) = (0, 0);
    for line in lines {
        let mut packed = vec![0; packed_bytes_max(line.len(), T::BYTES)];
        taken += pack(line, &mut packed).unwrap();
        values += line.len();
    }
    taken as f64 / values as f64
}

fn is_packed(scene: &Scene, preset: Preset, output: Output) -> Result<(), Failed> {
    let matched = matched(scene, preset, output);
    let width = scene.left.width() as u16;
    let disparities = bytes_per_value(matched.lines(width).map(|line| line.disparities_q4));
    let confidences = bytes_per_value(matched.lines(width).map(|line| line.confidences));
    println!(
        "{}, {preset}, {output:?}: a disparity takes {disparities:.3} bytes, a confidence {confidences:.3}",
        scene.name
    );
    if disparities <= BYTES_MAX {
        Ok(())
    } else {
        Err(format!("a disparity takes {disparities:.3} bytes").into())
    }
}

/// The messages of a frame of the built-in scene, as packets.
fn recorded(matched: &Matched, width: u16, height: u32) -> Vec<Vec<u8>> {
    let streams = Streams::DISPARITIES.with(Streams::CONFIDENCES);
    let mut memory = vec![0; memory_bytes(width, PixelFormat::Grey8, streams)];
    let mut encoder = Encoder::new(&mut memory);
    let mut packets = Vec::new();
    let mut send = |message: BoardMessage<'_>| {
        let time_us = 1000 * packets.len() as u64;
        packets.push(encoder.encode(time_us, &message).unwrap().to_vec());
    };
    send(BoardMessage::FrameBegun(begun(width, height)));
    for line in matched.lines(width) {
        send(BoardMessage::Disparities(Line {
            frame: 6,
            line: line.line,
            column: line.column,
            values: Values::Plain(line.disparities_q4),
        }));
        send(BoardMessage::Confidences(Line {
            frame: 6,
            line: line.line,
            column: line.column,
            values: Values::Plain(line.confidences),
        }));
    }
    send(BoardMessage::FrameDone { frame: 6 });
    packets
}

fn begun(width: u16, height: u32) -> FrameBegun {
    FrameBegun {
        frame: 6,
        timestamp_us: 70,
        region: Region {
            x_px: 0,
            y_lines: 0,
            width_px: width,
            height_lines: height,
        },
    }
}

fn frames_arrive_as_they_were_sent() {
    let scene = built_in();
    let (width, height) = (scene.left.width() as u16, scene.left.height());
    let matched = matched(&scene, Preset::Lite, Output::Sparse);
    let mut packets = recorded(&matched, width, height);
    // Of line 20 the confidences are lost, of line 30 the disparities are damaged.
    packets.remove(42);
    packets[60][9] ^= 1;
    let streams = Streams::DISPARITIES.with(Streams::CONFIDENCES);
    let mut memory = vec![0; memory_bytes(width, PixelFormat::Grey8, streams)];
    let mut decoder = Decoder::new(&mut memory);
    let pixels = usize::from(width) * height as usize;
    let words = FrameAssembler::<i16>::present_words(height as usize);
    let (mut disparities, mut confidences) = (vec![0; pixels], vec![0; pixels]);
    let mut present = [vec![0; words], vec![0; words]];
    let [first, second] = &mut present;
    let mut disparities = FrameAssembler::<i16>::new(&mut disparities, first);
    let mut confidences = FrameAssembler::<u8>::new(&mut confidences, second);
    let stream = packets.concat();
    let mut rest = &stream[..];
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        match received.map(|packet| packet.message) {
            Ok(BoardMessage::FrameBegun(begun)) => {
                assert!(disparities.begin(&begun) && confidences.begin(&begun));
            }
            Ok(BoardMessage::Disparities(line)) => assert!(disparities.push(&line)),
            Ok(BoardMessage::Confidences(line)) => assert!(confidences.push(&line)),
            _ => {}
        }
    }
    assert!(disparities.missing().eq([30]) && confidences.missing().eq([20]));
    let mut expected = matched.disparities_q4.clone();
    let columns = usize::from(width);
    expected[30 * columns..31 * columns].fill(i16::MIN);
    assert!(disparities.values() == expected);
    let mut expected = matched.confidences.clone();
    expected[20 * columns..21 * columns].fill(0);
    assert!(confidences.values() == expected);
    let counters = decoder.counters();
    assert_eq!((counters.lost, counters.broken), (2, 1));
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// What the decoder in Python prints of a stream.
fn printed(stream: &[u8]) -> Result<String, Failed> {
    let mut python = Command::new("python3")
        .arg(workspace().join("tools/link_decoder.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut input = python.stdin.take().ok_or("no standard input")?;
    // It prints after it has read everything.
    input.write_all(stream)?;
    drop(input);
    let output = python.wait_with_output()?;
    if !output.status.success() {
        return Err("the decoder failed".into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

fn python_understands_the_packets_of_the_document() -> Result<(), Failed> {
    let text = fs::read_to_string(workspace().join("docs/link.md"))?;
    let (_, text) = text
        .split_once("### From the board, by number\n")
        .ok_or("the document has no packets")?;
    let text = text.split("\n#").next().unwrap_or_default();
    let (mut stream, mut expected) = (Vec::new(), String::new());
    for block in text.split("\n\n") {
        let (hex, meaning) = block.trim().rsplit_once('\n').ok_or("no meaning")?;
        for word in hex.split_whitespace().filter(|word| *word != "\\") {
            stream.push(u8::from_str_radix(word, 16)?);
        }
        writeln!(expected, "{}", meaning.trim())?;
    }
    assert_eq!(printed(&stream)?, expected);
    Ok(())
}

/// Values as Python prints them.
fn python_list<T: Sample + ToString>(values: &[T]) -> String {
    let values = values.iter().map(|value| {
        if *value == T::NONE {
            "None".to_owned()
        } else {
            value.to_string()
        }
    });
    format!("[{}]", values.collect::<Vec<_>>().join(", "))
}

fn python_understands_a_recorded_stream() -> Result<(), Failed> {
    let scene = built_in();
    let (width, height) = (scene.left.width() as u16, scene.left.height());
    let matched = matched(&scene, Preset::Micro, Output::Sparse);
    let mut packets = recorded(&matched, width, height);
    let mut expected = format!("0 0 frame-begun 6 70 0 0 {width} {height}\n");
    for line in matched.lines(width) {
        let number = line.line;
        let disparities = python_list(line.disparities_q4);
        let confidences = python_list(line.confidences);
        for (sequence, name, values) in [
            (2 * number + 1, "disparities", disparities),
            (2 * number + 2, "confidences", confidences),
        ] {
            writeln!(
                expected,
                "{sequence} {sequence}000 {name} 6 {number} 0 {values}"
            )?;
        }
    }
    let last = 2 * height + 1;
    write!(expected, "damaged\n{last} {last}000 frame-done 6\n")?;
    let mut damaged = packets[7].clone();
    // Another byte, and no zero, which would make two of it.
    damaged[20] = damaged[20] % 255 + 1;
    packets.insert(packets.len() - 1, damaged);
    let printed = printed(&packets.concat())?;
    for (printed, expected) in printed.lines().zip(expected.lines()) {
        assert_eq!(printed, expected);
    }
    assert_eq!(printed.len(), expected.len());
    Ok(())
}
