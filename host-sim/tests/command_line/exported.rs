//! `--mcap`: the file passes MCAP's own reader, its schemas are the published ones, and each message decodes by
//! the schema in the file into what the board sent.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use mcap::read::Options;
use mcap::{MessageStream, Summary};
use prost_reflect::{DescriptorPool, DynamicMessage, Value};
use vgstereo_sim::link::attended::Attended;
use vgstereo_sim::link::board::Frame;
use vgstereo_sim::link::client::Memory;
use vgstereo_sim::link::source::Source;

use crate::fixture::Fixture;

/// A decoded message, and its time, ns.
struct Message {
    log_ns: u64,
    fields: DynamicMessage,
}

impl Message {
    fn value(&self, name: &str) -> Value {
        let value = self.fields.get_field_by_name(name);
        value.unwrap_or_else(|| panic!("{name}")).into_owned()
    }

    fn number(&self, name: &str) -> u32 {
        self.value(name).as_u32().unwrap()
    }

    fn text(&self, name: &str) -> String {
        self.value(name).as_str().unwrap().to_owned()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        self.value(name).as_bytes().unwrap().to_vec()
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        let value = self.value(name);
        let list = value.as_list().unwrap();
        list.iter().map(|value| value.as_f64().unwrap()).collect()
    }

    /// The time in the message, ns.
    fn stamp_ns(&self) -> u64 {
        let stamp = self.value("timestamp");
        let stamp = stamp.as_message().unwrap();
        let part = |name: &str| stamp.get_field_by_name(name).unwrap().into_owned();
        let seconds = part("seconds").as_i64().unwrap() as u64;
        seconds * 1_000_000_000 + part("nanos").as_i32().unwrap() as u64
    }
}

/// The schema of each topic as Foxglove publishes it.
const SCHEMAS: [(&str, &str); 12] = [
    ("/camera", "foxglove.CameraCalibration"),
    ("/confidence", "foxglove.RawImage"),
    ("/depth", "foxglove.RawImage"),
    ("/disparity", "foxglove.RawImage"),
    ("/left/raw", "foxglove.RawImage"),
    ("/left/rectified", "foxglove.RawImage"),
    ("/log", "foxglove.Log"),
    ("/points", "foxglove.PointCloud"),
    ("/right/raw", "foxglove.RawImage"),
    ("/right/rectified", "foxglove.RawImage"),
    ("/scan", "foxglove.LaserScan"),
    ("/tf", "foxglove.FrameTransform"),
];

/// The messages of a file by topic, with all checksums checked, decoded by the schemas in it.
fn messages(path: &Path) -> BTreeMap<String, Vec<Message>> {
    let file = fs::read(path).unwrap();
    let stream = MessageStream::new_with_options(&file, Options::ValidateChunkCrcs.into()).unwrap();
    let mut topics: BTreeMap<String, Vec<Message>> = BTreeMap::new();
    let mut count = 0;
    for message in stream {
        let message = message.unwrap();
        let (channel, schema) = (&message.channel, message.channel.schema.as_ref().unwrap());
        let published = SCHEMAS.iter().find(|(topic, _)| *topic == channel.topic);
        assert_eq!(published.unwrap().1, schema.name);
        assert_eq!(
            (&*schema.encoding, &*channel.message_encoding),
            ("protobuf", "protobuf")
        );
        let pool = DescriptorPool::decode(&schema.data[..]).unwrap();
        let descriptor = pool.get_message_by_name(&schema.name).unwrap();
        let fields = DynamicMessage::decode(descriptor, &message.data[..]).unwrap();
        assert_eq!(fields.unknown_fields().count(), 0, "{}", channel.topic);
        let message = Message {
            log_ns: message.log_time,
            fields,
        };
        if channel.topic != "/log" {
            assert_eq!(message.stamp_ns(), message.log_ns);
        }
        topics
            .entry(channel.topic.clone())
            .or_default()
            .push(message);
        count += 1;
    }
    let summary = Summary::read(&file).unwrap().unwrap();
    assert_eq!(summary.stats.as_ref().unwrap().message_count, count);
    assert!(!summary.chunk_indexes.is_empty());
    topics
}

/// The frames of a recording, with the times at which they had come, ns.
fn frames(path: &Path) -> Vec<(u64, Frame)> {
    let source = Source::File {
        path: path.to_owned(),
        is_fast: true,
    };
    let mut memory = Memory::default();
    let mut board = Attended::open(&source, &mut memory).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = board.frame().unwrap() {
        frames.push((board.client().arrived_ns().unwrap(), *frame));
    }
    frames
}

fn image(message: &Message, encoding: &str, pixel_bytes: u32) -> Vec<u8> {
    let (width, height) = (message.number("width"), message.number("height"));
    assert_eq!((width, height), (320, 240));
    assert_eq!(message.text("encoding"), encoding);
    assert_eq!(message.number("step"), width * pixel_bytes);
    let bytes = message.bytes("data");
    assert_eq!(bytes.len() as u32, width * height * pixel_bytes);
    bytes
}

#[test]
fn every_message_decodes_by_its_schema_into_what_was_sent() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&[
        "record",
        "--demo",
        "a.mcap",
        "--frames",
        "3",
        "--streams",
        "raw,disparities,confidences",
        "--mcap",
        "live.mcap",
    ]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let outcome = fixture.run(&["replay", "a.mcap", "--mcap", "later.mcap"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    // What is made while it is recorded is what is made of the recording.
    let [live, later] =
        ["live.mcap", "later.mcap"].map(|name| fs::read(fixture.path(name)).unwrap());
    assert!(live == later);

    let frames = frames(&fixture.path("a.mcap"));
    assert!(frames.len() >= 3);
    let topics = messages(&fixture.path("later.mcap"));
    let found: Vec<&str> = topics.keys().map(String::as_str).collect();
    let expected = [
        "/camera",
        "/confidence",
        "/depth",
        "/disparity",
        "/left/raw",
        "/points",
        "/right/raw",
        "/scan",
        "/tf",
    ];
    assert_eq!(found, expected);
    for (topic, messages) in &topics {
        let times: Vec<u64> = messages.iter().map(|message| message.log_ns).collect();
        let arrived: Vec<u64> = frames.iter().map(|(arrived_ns, _)| *arrived_ns).collect();
        assert_eq!(times, arrived, "{topic}");
    }
    for (number, (_, frame)) in frames.iter().enumerate() {
        let of = |topic: &str| &topics[topic][number];
        let raw = frame.raw.as_ref().unwrap();
        for (topic, view) in ["/left/raw", "/right/raw"].into_iter().zip(&raw.views) {
            assert!(image(of(topic), "mono8", 1) == view.values);
        }
        let disparities = frame.disparities.as_ref().unwrap();
        let confidences = frame.confidences.as_ref().unwrap();
        assert_eq!([disparities.x, disparities.y], [0, 0]);
        assert!(image(of("/confidence"), "mono8", 1) == confidences.values);
        let colours = image(of("/disparity"), "rgb8", 3);
        let depths = image(of("/depth"), "16UC1", 2);
        // The numbers of the camera, and the depth of each disparity by them.
        let k = of("/camera").numbers("K");
        assert_eq!([k[0], k[4], k[8]], [k[0], k[0], 1.0]);
        assert!((100.0..1000.0).contains(&k[0]));
        assert_eq!(of("/camera").numbers("P")[..3], k[..3]);
        let cloud = of("/points");
        assert_eq!(cloud.number("point_stride"), 13);
        let data = cloud.bytes("data");
        let mut points = data.chunks_exact(13);
        let mut seen = 0;
        for (at, disparity_q4) in disparities.values.iter().enumerate() {
            let depth_mm = u16::from_le_bytes([depths[2 * at], depths[2 * at + 1]]);
            let is_black = colours[3 * at..3 * at + 3] == [0; 3];
            assert_eq!(*disparity_q4 == i16::MIN, is_black);
            if depth_mm == 0 {
                // None, or further than 16 bits hold.
                assert!(f64::from(*disparity_q4) / 16.0 * 65_536.0 <= PRODUCT_PX_MM);
                continue;
            }
            let product = f64::from(depth_mm) * f64::from(*disparity_q4) / 16.0;
            assert!(
                (product / PRODUCT_PX_MM - 1.0).abs() < 0.01,
                "{at}: {product}"
            );
            let point = points.next().unwrap();
            let metres =
                |from: usize| f32::from_le_bytes(point[from..from + 4].try_into().unwrap());
            let (x, y, z) = (metres(0), metres(4), metres(8));
            assert_eq!((f64::from(z) * 1000.0).round(), f64::from(depth_mm));
            let column = f64::from(x / z) * k[0] + k[2];
            let line = f64::from(y / z) * k[4] + k[5];
            assert!((column - (at % 320) as f64).abs() < 0.6, "{at} {column}");
            assert!((line - (at / 320) as f64).abs() < 0.6, "{at} {line}");
            assert_eq!(point[12], confidences.values[at]);
            seen += 1;
        }
        assert!(points.next().is_none() && seen > 50_000, "{seen}");
        let ranges = of("/scan").numbers("ranges");
        let angles =
            ["start_angle", "end_angle"].map(|name| of("/scan").value(name).as_f64().unwrap());
        assert!(ranges.len() == 90 && angles[0] < 0.0 && angles[1] > 0.0);
        assert!(ranges.iter().any(|range| (0.3..20.0).contains(range)));
    }
}

/// Focal length times baseline of the demo's cameras, px mm, as its board states it in 1/256.
const PRODUCT_PX_MM: f64 = 14_679_040.0 / 256.0;

#[test]
fn files_that_are_there_and_a_calibration_for_nothing_are_refused() {
    let fixture = Fixture::new();
    fs::write(fixture.path("there.mcap"), []).unwrap();
    fixture.refuses(
        &["record", "--demo", "a.mcap", "--mcap", "there.mcap"],
        &["there.mcap", "there already"],
    );
    fixture.refuses(
        &["record", "--demo", "a.mcap", "--mcap", "a.mcap"],
        &["--mcap", "a.mcap"],
    );
    fixture.refuses(
        &["replay", "there.mcap", "--mcap", "there.mcap"],
        &["--mcap", "there.mcap"],
    );
    fixture.refuses(
        &["replay", "there.mcap", "--mcap", "none/b.mcap"],
        &["none/b.mcap"],
    );
}
