//! A frame as the page gets it: values rather than colours, in one binary message.
//!
//! A message is the number of bytes of its head (4, little-endian), the head in JSON, and planes of
//! values, little-endian. Each plane begins at a multiple of 8 bytes of the message, as the head
//! states, so that a browser reads them in place.

use serde::Serialize;
use vgstereo_core::geometry::RectifiedCamera;
use vgstereo_link::Region;

use super::focus::focus;
use super::request::{Show, Shown};
use crate::link::board::{Frame, Pictures, Scan};
use crate::link::derived::{depths, scan};
use crate::link::pixels::{Pixels, unpacked};
use crate::link::plane::Plane;

/// Every plane begins at a multiple of so many bytes.
const ALIGNMENT_BYTES: usize = 8;

/// What stands before the planes.
#[derive(Serialize)]
struct Head<'a> {
    frame: u32,
    timestamp_us: u64,
    /// From the sending of the frame's beginning to that of its end.
    duration_us: u64,
    region: Region,
    is_whole: bool,
    /// Of the left and the right view, of what is shown of them.
    focus: Option<[f64; 2]>,
    scan: Option<&'a Scan>,
    planes: Vec<PlaneHead>,
}

#[derive(Serialize)]
struct PlaneHead {
    name: &'static str,
    /// `u8`, `i16` or `u16`.
    kind: &'static str,
    /// Values of a pixel: 3 of a picture in colour, red, green and blue; otherwise 1.
    channels: usize,
    width: usize,
    height: usize,
    x: u32,
    y: u32,
    /// Place in the message.
    offset: usize,
    /// Runs of missing lines, counted in the plane: the first, and how many.
    missing: Vec<[usize; 2]>,
}

/// The planes of a message under way.
#[derive(Default)]
struct Planes {
    heads: Vec<PlaneHead>,
    bytes: Vec<u8>,
}

impl Planes {
    fn add<T: Copy, const BYTES: usize>(
        &mut self,
        name: &'static str,
        kind: &'static str,
        plane: &Plane<T>,
        channels: usize,
        to_bytes: impl Fn(T) -> [u8; BYTES],
    ) {
        self.heads.push(PlaneHead {
            name,
            kind,
            channels,
            width: plane.width / channels,
            height: plane.height(),
            x: plane.x,
            y: plane.y,
            offset: self.bytes.len(),
            missing: plane.missing(),
        });
        self.bytes
            .extend(plane.values.iter().flat_map(|&value| to_bytes(value)));
        let padded = self.bytes.len().next_multiple_of(ALIGNMENT_BYTES);
        self.bytes.resize(padded, 0);
    }

    /// Adds both views, and returns how sharp they are.
    fn add_views(&mut self, names: [&'static str; 2], pictures: &Pictures) -> [f64; 2] {
        let mut figures = [0.0; 2];
        let views = names.into_iter().zip(unpacked(pictures));
        for ((name, Pixels { grey, colour }), figure) in views.zip(&mut figures) {
            *figure = focus(&grey.values, grey.width);
            match colour {
                Some(colour) => self.add(name, "u8", &colour, 3, |level| [level]),
                None => self.add(name, "u8", &grey, 1, |level| [level]),
            }
        }
        figures
    }
}

/// Returns the message of a frame with what is shown of it. Depths and scan are the board's or,
/// with the
/// `camera` that the disparities are seen with, made of its disparities.
#[must_use]
pub fn encode(frame: &Frame, camera: Option<&RectifiedCamera>, show: &Show) -> Vec<u8> {
    let mut planes = Planes::default();
    let mut figures = None;
    if let Some(pictures) = &frame.raw {
        figures = Some(planes.add_views(["raw_left", "raw_right"], pictures));
    }
    if let Some(pictures) = &frame.rectified {
        let both = planes.add_views(["rectified_left", "rectified_right"], pictures);
        figures = figures.or(Some(both));
    }
    if let Some(disparities) = &frame.disparities {
        planes.add("disparities", "i16", disparities, 1, i16::to_le_bytes);
    }
    if let Some(confidences) = &frame.confidences {
        planes.add("confidences", "u8", confidences, 1, |value| [value]);
    }
    let computed = camera.and_then(|camera| depths(frame, camera));
    if let Some(depths) = frame.depths.as_ref().or(computed.as_ref()) {
        planes.add("depths", "u16", depths, 1, u16::to_le_bytes);
    }
    let computed = match (&frame.scan, camera) {
        (None, Some(camera)) if show.contains(Shown::Scan) => scan(frame, camera),
        _ => None,
    };
    let scan = frame.scan.as_ref().or(computed.as_ref());
    let [begun_us, ended_us] = frame.sent_us;
    let mut head = Head {
        frame: frame.begun.frame,
        timestamp_us: frame.begun.timestamp_us,
        duration_us: ended_us.saturating_sub(begun_us),
        region: frame.begun.region,
        is_whole: frame.is_whole(),
        focus: figures,
        scan,
        planes: planes.heads,
    };
    // The head states places in the message, and its own length decides on them: there is room for
    // the longest numbers.
    let room = |head: &Head<'_>| serde_json::to_vec(head).unwrap_or_default();
    let digits = 20 * head.planes.len();
    let start = (4 + room(&head).len() + digits).next_multiple_of(ALIGNMENT_BYTES);
    for plane in &mut head.planes {
        plane.offset += start;
    }
    let mut json = room(&head);
    // White space at the end is JSON still.
    json.resize(start - 4, b' ');
    let mut message = Vec::with_capacity(start + planes.bytes.len());
    message.extend(u32::try_from(json.len()).unwrap_or_default().to_le_bytes());
    message.extend(json);
    message.extend(planes.bytes);
    message
}

#[cfg(test)]
mod tests {
    use serde_json::Value;
    use vgstereo_core::geometry::Depth;
    use vgstereo_link::board::FrameBegun;

    use super::*;

    const REGION: Region = Region {
        x_px: 3,
        y_lines: 1,
        width_px: 5,
        height_lines: 4,
    };

    fn frame() -> Frame {
        let region = REGION;
        let begun = FrameBegun {
            frame: 9,
            timestamp_us: 1,
            region,
        };
        let mut disparities = Plane::new([3, 1], [5, 4], i16::MIN).unwrap();
        let mut confidences = Plane::new([3, 1], [5, 4], 0_u8).unwrap();
        for line in [1, 2, 4] {
            disparities.put(line, 3, 5, |place| {
                place.copy_from_slice(&[160, i16::MIN, 320, -7, 0]);
                true
            });
            confidences.put(line, 3, 5, |place| {
                place.fill(200);
                true
            });
        }
        Frame {
            begun,
            sent_us: [10, 25],
            raw: None,
            rectified: None,
            disparities: Some(disparities),
            confidences: Some(confidences),
            depths: None,
            scan: None,
        }
    }

    fn camera() -> RectifiedCamera {
        // 100 px and 60 mm: 6 m at a disparity of 1 px.
        let depth = Depth::new(100 * 60 * 256, 0).unwrap();
        RectifiedCamera::new(depth, 100 * 256, [5 * 256, 3 * 256]).unwrap()
    }

    /// The head of a message, and the bytes of a plane in it.
    fn read(message: &[u8]) -> (Value, impl Fn(&str) -> Option<Vec<u8>>) {
        let length = u32::from_le_bytes(message[..4].try_into().unwrap()) as usize;
        let head: Value = serde_json::from_slice(&message[4..4 + length]).unwrap();
        let planes = head["planes"].as_array().unwrap().clone();
        let bytes = move |name: &str| {
            let plane = planes.iter().find(|plane| plane["name"] == name)?;
            let number = |field: &str| plane[field].as_u64().unwrap() as usize;
            let size = if plane["kind"] == "u8" { 1 } else { 2 };
            let count = number("width") * number("height") * number("channels") * size;
            assert_eq!(number("offset") % 8, 0);
            Some(message[number("offset")..][..count].to_vec())
        };
        (head, bytes)
    }

    #[test]
    fn a_message_has_the_values_and_tells_what_is_missing() {
        let message = encode(&frame(), None, &Show::default());
        let (head, bytes) = read(&message);
        let line = [160_i16, i16::MIN, 320, -7, 0];
        let none = [i16::MIN; 5];
        let expected: Vec<u8> = [line, line, none, line]
            .as_flattened()
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        assert_eq!(bytes("disparities").unwrap(), expected);
        assert_eq!(bytes("confidences").unwrap()[8..12], [200, 200, 0, 0]);
        assert_eq!(bytes("depths"), None);
        let plane = &head["planes"][0];
        assert_eq!(plane["missing"], serde_json::json!([[2, 1]]));
        assert_eq!([&plane["x"], &plane["y"]], [3, 1]);
        assert_eq!(
            (&head["frame"], &head["duration_us"]),
            (&9.into(), &15.into())
        );
        assert_eq!(head["is_whole"], false);
    }

    #[test]
    fn with_a_camera_there_are_depths_and_a_scan_where_it_is_shown() {
        let show = |shown: &[Shown]| shown.iter().copied().collect::<Show>();
        let message = encode(&frame(), Some(&camera()), &show(&[Shown::Depth]));
        let (head, bytes) = read(&message);
        let depths = bytes("depths").unwrap();
        let depths: Vec<u16> = depths
            .as_chunks()
            .0
            .iter()
            .map(|b| u16::from_le_bytes(*b))
            .collect();
        // 6000 mm / 10 px and / 20 px; none of none, behind and at infinity.
        assert_eq!(depths[..5], [600, 0, 300, 0, 0]);
        assert_eq!(depths[10..15], [0; 5], "the missing line");
        assert_eq!(head["scan"], Value::Null);
        let message = encode(&frame(), Some(&camera()), &show(&[Shown::Scan]));
        let (head, _) = read(&message);
        // The three lines that came see 300 mm straight ahead, in column 5 of the frame.
        let ranges = head["scan"]["ranges_mm"].as_array().unwrap();
        assert_eq!(ranges.len(), 5);
        assert_eq!(ranges[2], 300);
    }

    #[test]
    fn views_are_unpacked_by_their_format() {
        let view = |bytes: &[u8]| {
            let mut view = Plane::new([0, 0], [bytes.len() as u32, 1], 0).unwrap();
            view.put(0, 0, bytes.len(), |place| {
                place.copy_from_slice(bytes);
                true
            });
            view
        };
        let mut frame = frame();
        frame.raw = Some(Pictures {
            format: vgstereo_link::PixelFormat::Rgb565,
            // Full red, green and blue, then black and white.
            views: [
                view(&[0xf8, 0, 0x07, 0xe0, 0, 0x1f]),
                view(&[0, 0, 0xff, 0xff, 0, 0]),
            ],
        });
        let message = encode(&frame, None, &Show::default());
        let (head, bytes) = read(&message);
        assert_eq!(
            bytes("raw_left").unwrap(),
            [255, 0, 0, 0, 255, 0, 0, 0, 255]
        );
        assert_eq!(
            bytes("raw_right").unwrap(),
            [0, 0, 0, 255, 255, 255, 0, 0, 0]
        );
        assert_eq!(
            [&head["planes"][0]["width"], &head["planes"][0]["channels"]],
            [3, 3]
        );
    }
}
