//! What a board sends as messages of [Foxglove's schemas](https://docs.foxglove.dev/docs/sdk/schemas) in an
//! MCAP file, which Foxglove and the tools of ROS 2 open.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{BufWriter, Seek, Write};

use anyhow::{Result, anyhow};
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    CameraCalibration, FrameTransform, LaserScan, Log, PackedElementField, PointCloud, Pose,
    Quaternion, RawImage, Timestamp, Vector3, log,
};
use foxglove::{Encode, Schema};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use serde_json::Value;
use vgstereo_core::geometry::{Point, RectifiedCamera};
use vgstereo_core::{DisparityRange, INVALID};
use vgstereo_link::board::Level;
use vgstereo_link::{BoardMessage, Packet};

use super::attended::Observer;
use super::board::{Board, Frame, Pictures, Scan, reason_name};
use super::derived;
use super::pixels::unpacked;
use super::plane::Plane;
use super::recording::LIBRARY;
use crate::pictures::colour_disparities;

/// The left camera: x right, y down, z forward, as images and clouds have it.
const OPTICAL_FRAME: &str = "camera_optical";
/// The same place as ROS's bodies have it: x forward, y left, z up. Scans lie in its plane.
const BODY_FRAME: &str = "camera";
/// Bytes of a chunk of the file, about.
const CHUNK_BYTES: u64 = 4 << 20;

/// Makes messages of all that a board sends, and writes them to an MCAP file. Depths, cloud and scan take
/// the board's camera.
pub struct Exporter<W: Write + Seek> {
    writer: Writer<BufWriter<W>>,
    channels: BTreeMap<&'static str, u16>,
    /// Bytes of the message under way.
    buffer: Vec<u8>,
    /// The camera that is used where the board tells none.
    calibrated: Option<RectifiedCamera>,
    messages: u64,
    frames: u64,
    frames_without_camera: u64,
}

impl<W: Write + Seek> fmt::Debug for Exporter<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Exporter")
            .field("messages", &self.messages)
            .finish_non_exhaustive()
    }
}

/// When and of what a message is.
#[derive(Clone, Copy)]
struct Stamp {
    /// The time of arrival, ns since 1970.
    arrived_ns: u64,
    /// The number of the frame.
    frame: u32,
}

impl Stamp {
    /// The time, which is at most the largest that the schemas have.
    fn timestamp(self) -> Option<Timestamp> {
        const SECOND_NS: u64 = 1_000_000_000;
        let seconds = u32::try_from(self.arrived_ns / SECOND_NS).unwrap_or(u32::MAX);
        Timestamp::new_checked(seconds, (self.arrived_ns % SECOND_NS) as u32)
    }
}

/// The size of the images that have a value for each pixel of the reference view.
type Size = [usize; 2];

impl<W: Write + Seek> Exporter<W> {
    /// An exporter to this file. `calibrated` is the camera that disparities are seen with, where the board
    /// tells none.
    ///
    /// # Errors
    /// Fails when it cannot be written.
    pub fn new(output: W, calibrated: Option<RectifiedCamera>) -> Result<Self> {
        let options = WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .library(LIBRARY);
        Ok(Self {
            writer: options.create(BufWriter::new(output))?,
            channels: BTreeMap::new(),
            buffer: Vec::new(),
            calibrated,
            messages: 0,
            frames: 0,
            frames_without_camera: 0,
        })
    }

    /// Ends the file and returns what it had, in words.
    ///
    /// # Errors
    /// Fails when it cannot be written.
    pub fn finish(mut self) -> Result<String> {
        self.writer.finish()?;
        let topics: Vec<&str> = self.channels.keys().copied().collect();
        let mut text = format!(
            "{} messages of {} frames: {}",
            self.messages,
            self.frames,
            topics.join(", ")
        );
        if self.frames_without_camera > 0 {
            text += &format!(
                "; no depths, points and scans of {} frames, as the board has told no camera: give --calibration",
                self.frames_without_camera
            );
        }
        self.writer
            .into_inner()
            .into_inner()
            .map_err(|error| error.into_error())?;
        Ok(text)
    }

    fn write<M: Encode>(&mut self, topic: &'static str, stamp: Stamp, message: &M) -> Result<()> {
        let channel_id = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => {
                let Some(Schema {
                    name,
                    encoding,
                    data,
                }) = M::get_schema()
                else {
                    return Err(anyhow!("{topic}: there is no schema"));
                };
                let schema = self.writer.add_schema(&name, &encoding, &data)?;
                let encoding = M::get_message_encoding();
                let channel =
                    self.writer
                        .add_channel(schema, topic, &encoding, &BTreeMap::new())?;
                self.channels.insert(topic, channel);
                channel
            }
        };
        self.buffer.clear();
        message
            .encode(&mut self.buffer)
            .map_err(|error| anyhow!("{topic}: {error}"))?;
        let header = MessageHeader {
            channel_id,
            sequence: stamp.frame,
            log_time: stamp.arrived_ns,
            publish_time: stamp.arrived_ns,
        };
        self.writer.write_to_known_channel(&header, &self.buffer)?;
        self.messages += 1;
        Ok(())
    }

    fn log(&mut self, stamp: Stamp, level: log::Level, message: String) -> Result<()> {
        let log = Log {
            timestamp: stamp.timestamp(),
            level: level.into(),
            message,
            name: "vgstereo".to_owned(),
            ..Log::default()
        };
        self.write("/log", stamp, &log)
    }

    fn image(
        &mut self,
        topic: &'static str,
        stamp: Stamp,
        [width, height]: Size,
        encoding: &str,
        data: Vec<u8>,
    ) -> Result<()> {
        let image = RawImage {
            timestamp: stamp.timestamp(),
            frame_id: OPTICAL_FRAME.to_owned(),
            width: u32::try_from(width)?,
            height: u32::try_from(height)?,
            encoding: encoding.to_owned(),
            step: u32::try_from(data.len() / height.max(1))?,
            data: data.into(),
        };
        self.write(topic, stamp, &image)
    }

    fn views(
        &mut self,
        topics: [&'static str; 2],
        stamp: Stamp,
        pictures: &Pictures,
    ) -> Result<()> {
        for (topic, view) in topics.into_iter().zip(unpacked(pictures)) {
            let size = [view.grey.width, view.grey.height()];
            match view.colour {
                Some(colour) => self.image(topic, stamp, size, "rgb8", colour.values)?,
                None => self.image(topic, stamp, size, "mono8", view.grey.values)?,
            }
        }
        Ok(())
    }

    fn camera(
        &mut self,
        stamp: Stamp,
        [width, height]: Size,
        camera: &RectifiedCamera,
    ) -> Result<()> {
        let focal_px = f64::from(camera.focal_q8()) / 256.0;
        let [column, line] = camera.principal_q8().map(|q8| f64::from(q8) / 256.0);
        let calibration = CameraCalibration {
            timestamp: stamp.timestamp(),
            frame_id: OPTICAL_FRAME.to_owned(),
            width: u32::try_from(width)?,
            height: u32::try_from(height)?,
            // The views are rectified: nothing is left to undo.
            distortion_model: String::new(),
            d: Vec::new(),
            k: vec![focal_px, 0.0, column, 0.0, focal_px, line, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![
                focal_px, 0.0, column, 0.0, 0.0, focal_px, line, 0.0, 0.0, 0.0, 1.0, 0.0,
            ],
        };
        self.write("/camera", stamp, &calibration)?;
        let transform = FrameTransform {
            timestamp: stamp.timestamp(),
            parent_frame_id: BODY_FRAME.to_owned(),
            child_frame_id: OPTICAL_FRAME.to_owned(),
            translation: Some(Vector3::default()),
            rotation: Some(Quaternion {
                x: -0.5,
                y: 0.5,
                z: -0.5,
                w: 0.5,
            }),
        };
        self.write("/tf", stamp, &transform)
    }

    fn points(&mut self, stamp: Stamp, frame: &Frame, camera: &RectifiedCamera) -> Result<()> {
        let Some(disparities) = &frame.disparities else {
            return Ok(());
        };
        let width = disparities.width;
        let lines = disparities.values.chunks_exact(width);
        let mut points = vec![Point::NONE; width];
        let mut data = Vec::new();
        for (row, disparities_q4) in lines.enumerate() {
            let line = disparities.y.saturating_add(u32::try_from(row)?);
            let column = u16::try_from(disparities.x)?;
            camera.line_points(line, column, disparities_q4, &mut points);
            for (at, point) in points.iter().enumerate() {
                if *point == Point::NONE {
                    continue;
                }
                let mm = [point.x_mm.into(), point.y_mm.into(), point.z_mm.into()];
                data.extend(mm.iter().flat_map(|mm: &f32| (mm / 1000.0).to_le_bytes()));
                let confidences = frame.confidences.as_ref();
                let confidence = confidences.and_then(|plane| plane.values.get(row * width + at));
                data.extend(confidence);
            }
        }
        let mut fields = vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
        ];
        if frame.confidences.is_some() {
            fields.push(field("confidence", 12, NumericType::Uint8));
        }
        let cloud = PointCloud {
            timestamp: stamp.timestamp(),
            frame_id: OPTICAL_FRAME.to_owned(),
            pose: Some(in_place()),
            point_stride: if frame.confidences.is_some() { 13 } else { 12 },
            fields,
            data: data.into(),
        };
        self.write("/points", stamp, &cloud)
    }

    fn scan(&mut self, stamp: Stamp, scan: &Scan) -> Result<()> {
        let start_angle = f64::from(scan.bearing_min_rad);
        let steps = scan.ranges_mm.len().saturating_sub(1) as f64;
        let range = |mm: &u16| match mm {
            0 => f64::NAN,
            mm => f64::from(*mm) / 1000.0,
        };
        let scan = LaserScan {
            timestamp: stamp.timestamp(),
            frame_id: BODY_FRAME.to_owned(),
            pose: Some(in_place()),
            start_angle,
            end_angle: start_angle + steps * f64::from(scan.bearing_step_rad),
            ranges: scan.ranges_mm.iter().map(range).collect(),
            intensities: Vec::new(),
        };
        self.write("/scan", stamp, &scan)
    }
}

fn field(name: &str, offset: u32, kind: NumericType) -> PackedElementField {
    PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    }
}

/// The pose of what lies in its frame as it is.
fn in_place() -> Pose {
    Pose {
        position: Some(Vector3::default()),
        orientation: Some(Quaternion {
            w: 1.0,
            ..Quaternion::default()
        }),
    }
}

/// The values of a plane in the view that is matched, `none` outside of it, and the size of that.
fn in_view<T: Copy>(board: &Board, plane: &Plane<T>, none: T) -> Option<(Size, Vec<T>)> {
    let told = board.hello.as_ref().map(|hello| hello.matched);
    let told = told.map(|view| [view.width_px.into(), view.height_lines]);
    // Without it, up to the plane's last corner.
    let width = u32::try_from(plane.width).ok()?.checked_add(plane.x)?;
    let height = u32::try_from(plane.height()).ok()?.checked_add(plane.y)?;
    let sizes = [told, Some([width, height])];
    sizes.into_iter().flatten().find_map(|size| {
        let values = plane.in_view(size, none)?;
        Some((size.map(|side| side as usize), values))
    })
}

/// The disparities that the board searches.
fn searched(board: &Board) -> DisparityRange {
    let fields = board.hello.as_ref().map(|hello| &hello.fields);
    let number = |name: &str| {
        fields
            .and_then(|fields| fields.get(name))
            .and_then(Value::as_i64)
    };
    let minimum_px = number("disparity_min_px").and_then(|px| i16::try_from(px).ok());
    let count = number("disparity_count").and_then(|count| u16::try_from(count).ok());
    DisparityRange {
        minimum_px: minimum_px.unwrap_or(0),
        count: count.unwrap_or(64).max(1),
    }
}

impl<W: Write + Seek + Send> Observer for Exporter<W> {
    fn packet(&mut self, arrived_ns: Option<u64>, packet: &Packet<BoardMessage<'_>>) -> Result<()> {
        let stamp = |frame| Stamp {
            // Where no times of arrival are known, that of sending.
            arrived_ns: arrived_ns.unwrap_or(packet.timestamp_us.saturating_mul(1000)),
            frame,
        };
        match &packet.message {
            BoardMessage::Log { level, text } => {
                let level = match level {
                    Level::Error => log::Level::Error,
                    Level::Warning => log::Level::Warning,
                    Level::Information => log::Level::Info,
                    Level::Debug | Level::Trace => log::Level::Debug,
                };
                self.log(stamp(0), level, (*text).to_owned())
            }
            BoardMessage::FrameAborted { frame, reason } => {
                let reason = reason_name(*reason);
                let message = format!("frame {frame} was aborted: {reason}");
                self.log(stamp(*frame), log::Level::Warning, message)
            }
            _ => Ok(()),
        }
    }

    fn frame(&mut self, arrived_ns: Option<u64>, frame: &Frame, board: &Board) -> Result<()> {
        let stamp = Stamp {
            arrived_ns: arrived_ns.unwrap_or(frame.sent_us[1].saturating_mul(1000)),
            frame: frame.begun.frame,
        };
        self.frames += 1;
        if !frame.is_whole() {
            let message = format!("lines of frame {} are missing", frame.begun.frame);
            self.log(stamp, log::Level::Warning, message)?;
        }
        if let Some(pictures) = &frame.raw {
            self.views(["/left/raw", "/right/raw"], stamp, pictures)?;
        }
        if let Some(pictures) = &frame.rectified {
            self.views(["/left/rectified", "/right/rectified"], stamp, pictures)?;
        }
        if let Some(plane) = &frame.disparities
            && let Some((size, values_q4)) = in_view(board, plane, INVALID)
        {
            let width = u32::try_from(size[0])?;
            let picture = colour_disparities(&values_q4, width, searched(board));
            self.image("/disparity", stamp, size, "rgb8", picture.into_raw())?;
        }
        if let Some(plane) = &frame.confidences
            && let Some((size, values)) = in_view(board, plane, 0)
        {
            self.image("/confidence", stamp, size, "mono8", values)?;
        }
        let camera = board.rectified_camera().or(self.calibrated);
        let computed = camera.and_then(|camera| derived::depths(frame, &camera));
        if let Some(plane) = frame.depths.as_ref().or(computed.as_ref())
            && let Some((size, depths_mm)) = in_view(board, plane, 0)
        {
            let bytes = depths_mm.iter().flat_map(|mm| mm.to_le_bytes()).collect();
            self.image("/depth", stamp, size, "16UC1", bytes)?;
            if let Some(camera) = &camera {
                self.camera(stamp, size, camera)?;
            }
        }
        if let Some(camera) = &camera {
            self.points(stamp, frame, camera)?;
        } else if frame.disparities.is_some() {
            self.frames_without_camera += 1;
        }
        let computed = camera.and_then(|camera| derived::scan(frame, &camera));
        match frame.scan.as_ref().or(computed.as_ref()) {
            Some(scan) => self.scan(stamp, scan),
            None => Ok(()),
        }
    }
}
