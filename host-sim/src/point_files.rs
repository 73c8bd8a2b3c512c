//! Clouds of points as files.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use image::RgbImage;
use pcd_rs::{DataKind, PcdSerialize, ViewPoint, WriterInit, rgb_to_float};
use ply_rs_bw::ply::{
    Addable, ElementDef, Encoding, Ply, PropertyAccess, PropertyDef, PropertyType, ScalarType,
};
use ply_rs_bw::writer::Writer;
use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::{Point, RectifiedCamera};

use crate::escapes::shown;

/// How clouds of points are stored in a file. Both formats are binary and little endian, and have a
/// point for each pixel of the reference view, row by row: its place in metres, NaN where nothing
/// is known, its colour, and its confidence as maps of confidence have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointFormat {
    /// PLY. The lines `obj_info num_cols` and `num_rows` state width and height, as range scans
    /// have them and as PCL reads them.
    Ply,
    /// PCL's PCD, whose header has width and height. The colour is packed in the bits of a float,
    /// as PCL has it.
    Pcd,
}

impl PointFormat {
    /// Chooses the format by the ending of a file's name.
    ///
    /// # Errors
    /// Fails with one line that names the file when it is neither `.ply` nor `.pcd`.
    pub fn choose(path: &Path) -> Result<Self> {
        match path.extension().map(|ending| ending.to_ascii_lowercase()) {
            Some(ending) if ending == "ply" => Ok(Self::Ply),
            Some(ending) if ending == "pcd" => Ok(Self::Pcd),
            _ => bail!(
                "{}: the name of a cloud of points ends in .ply or .pcd",
                shown(path)
            ),
        }
    }

    /// Returns how the places of a file are to be read, in one phrase.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        "m, x right, y down, z forward, row by row, NaN = none"
    }

    /// Returns the bytes of a file with the points that [`RectifiedCamera::line_points`] makes of
    /// these lines, which are those of a whole view whose colours are `colours`. Places are whole
    /// millimetres.
    ///
    /// # Errors
    /// Fails when the lines are not those of the view.
    pub fn encode<'a>(
        self,
        lines: impl Iterator<Item = DisparityLine<'a>>,
        colours: &RgbImage,
        camera: &RectifiedCamera,
    ) -> Result<Vec<u8>> {
        let (width, height) = colours.dimensions();
        let pixels = colours.as_raw().len() / 3;
        let mut vertices = Vec::with_capacity(pixels);
        let mut colours = colours.pixels();
        let mut points = vec![Point::NONE; usize::try_from(width)?];
        for line in lines {
            camera.line_points(line.line, line.column, line.disparities_q4, &mut points);
            let pixels = points.iter().zip(line.confidences).zip(&mut colours);
            vertices.extend(
                pixels.map(|((point, &confidence), colour)| {
                    Vertex::new(*point, colour.0, confidence)
                }),
            );
        }
        ensure!(
            vertices.len() == pixels,
            "the disparities do not fill the image"
        );
        match self {
            Self::Ply => ply(vertices, [width, height], self.meaning()),
            Self::Pcd => pcd(&vertices, [width, height]),
        }
    }
}

/// A point as a PCD stores it.
#[derive(Debug, Clone, Default, PcdSerialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    /// The bytes 0, red, green, blue, from the highest on.
    rgb: f32,
    confidence: u8,
}

impl Vertex {
    fn new(point: Point, [red, green, blue]: [u8; 3], confidence: u8) -> Self {
        let [x, y, z] = if point == Point::NONE {
            [f32::NAN; 3]
        } else {
            let mm = [point.x_mm.into(), point.y_mm.into(), point.z_mm.into()];
            mm.map(|mm: f32| mm / 1000.0)
        };
        Self {
            x,
            y,
            z,
            rgb: rgb_to_float(red, green, blue),
            confidence,
        }
    }
}

/// The properties of a point in a PLY, in their order.
const PROPERTIES: [(&str, ScalarType); 7] = [
    ("x", ScalarType::Float),
    ("y", ScalarType::Float),
    ("z", ScalarType::Float),
    ("red", ScalarType::UChar),
    ("green", ScalarType::UChar),
    ("blue", ScalarType::UChar),
    ("confidence", ScalarType::UChar),
];

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        match name {
            "x" => Some(self.x),
            "y" => Some(self.y),
            "z" => Some(self.z),
            _ => None,
        }
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        let [_, red, green, blue] = self.rgb.to_bits().to_be_bytes();
        match name {
            "red" => Some(red),
            "green" => Some(green),
            "blue" => Some(blue),
            "confidence" => Some(self.confidence),
            _ => None,
        }
    }
}

fn ply(vertices: Vec<Vertex>, [width, height]: [u32; 2], meaning: &str) -> Result<Vec<u8>> {
    let mut ply = Ply::<Vertex>::new();
    ply.header.encoding = Encoding::BinaryLittleEndian;
    ply.header.comments.push(meaning.to_owned());
    ply.header.obj_infos.push(format!("num_cols {width}"));
    ply.header.obj_infos.push(format!("num_rows {height}"));
    let mut vertex = ElementDef::new("vertex".to_owned());
    for (name, scalar) in PROPERTIES {
        let property = PropertyDef::new(name.to_owned(), PropertyType::Scalar(scalar));
        vertex.properties.add(property);
    }
    ply.header.elements.add(vertex);
    ply.payload.insert("vertex".to_owned(), vertices);
    let mut bytes = Vec::new();
    Writer::new().write_ply(&mut bytes, &mut ply)?;
    Ok(bytes)
}

fn pcd(vertices: &[Vertex], [width, height]: [u32; 2]) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut writer = WriterInit {
        width: width.into(),
        height: height.into(),
        viewpoint: ViewPoint::default(),
        data_kind: DataKind::Binary,
        schema: None,
        version: None,
    }
    .build_from_writer(Cursor::new(&mut bytes))?;
    let pushed = vertices.iter().try_for_each(|vertex| writer.push(vertex));
    // A writer that is not finished panics when it is dropped, after an error too.
    writer.finish()?;
    pushed?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;
    use vgstereo_core::INVALID;
    use vgstereo_core::geometry::Depth;

    /// A point as a reader finds it.
    #[derive(Debug, Deserialize)]
    struct Found {
        x: f32,
        y: f32,
        z: f32,
        red: u8,
        green: u8,
        blue: u8,
        confidence: u8,
    }

    const SIZE: [u32; 2] = [5, 3];
    const FOCAL_PX: f64 = 100.25;
    const PRINCIPAL_PX: [f64; 2] = [1.5, 2.25];
    const BASELINE_MM: f64 = 60.0;
    const DOFFS_PX: f64 = 2.5;

    /// Disparities from 10 px on, with a point that is not known, one at infinity and one too far
    /// away.
    fn disparities_q4() -> Vec<i16> {
        let mut map: Vec<i16> = (0..15).map(|at| 160 + 33 * at).collect();
        map[6] = INVALID;
        map[7] = -40;
        map[8] = -39;
        map
    }

    fn colour(at: u32) -> [u8; 3] {
        [at as u8, 100 + at as u8, 255 - at as u8]
    }

    fn confidence(at: usize) -> u8 {
        if at == 3 { 0 } else { 17 * at as u8 }
    }

    fn encoded(format: PointFormat) -> Vec<u8> {
        let q8 = |px: f64| (px * 256.0).round();
        let depth = Depth::new(q8(FOCAL_PX * BASELINE_MM) as u32, q8(DOFFS_PX) as i32).unwrap();
        let principal_q8 = PRINCIPAL_PX.map(|px| q8(px) as i32);
        let camera = RectifiedCamera::new(depth, q8(FOCAL_PX) as u32, principal_q8).unwrap();
        let map = disparities_q4();
        let confidences: Vec<u8> = (0..15).map(confidence).collect();
        let lines = (0..).zip(map.chunks(5).zip(confidences.chunks(5))).map(
            |(line, (disparities_q4, confidences))| DisparityLine {
                line,
                column: 0,
                disparities_q4,
                confidences,
            },
        );
        let colours = RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| image::Rgb(colour(y * 5 + x)));
        format.encode(lines, &colours, &camera).unwrap()
    }

    /// The points of a PCD, by its format as PCL documents it.
    fn points_of_pcd(bytes: &[u8]) -> Vec<Found> {
        let end = b"DATA binary\n";
        let at = bytes.windows(end.len()).position(|part| part == end);
        let (header, data) = bytes.split_at(at.unwrap() + end.len());
        let header: Vec<&str> = std::str::from_utf8(header).unwrap().lines().collect();
        for line in [
            "VERSION .7",
            "FIELDS x y z rgb confidence",
            "SIZE 4 4 4 4 1",
            "TYPE F F F F U",
            "COUNT 1 1 1 1 1",
            "WIDTH 5",
            "HEIGHT 3",
            "VIEWPOINT 0 0 0 1 0 0 0",
        ] {
            assert!(header.contains(&line), "{line} in {header:?}");
        }
        assert!(header.iter().any(|line| line.trim_end() == "POINTS 15"));
        assert_eq!(data.len(), 15 * 17);
        let points = data.chunks_exact(17).map(|record| {
            let number = |at: usize| f32::from_le_bytes(record[at..at + 4].try_into().unwrap());
            Found {
                x: number(0),
                y: number(4),
                z: number(8),
                red: record[14],
                green: record[13],
                blue: record[12],
                confidence: record[16],
            }
        });
        points.collect()
    }

    fn points_of_ply(bytes: &[u8]) -> Vec<Found> {
        let mut reader = serde_ply::PlyReader::from_reader(bytes).unwrap();
        let header = reader.header();
        assert_eq!(header.format, serde_ply::PlyFormat::BinaryLittleEndian);
        assert_eq!(header.obj_info, ["num_cols 5", "num_rows 3"]);
        assert!(header.comments[0].starts_with("m, x right, y down, z forward"));
        assert_eq!(header.elem_defs[0].name, "vertex");
        reader.next_element().unwrap()
    }

    #[test]
    fn every_pixel_has_its_place_colour_and_confidence() {
        let ply = points_of_ply(&encoded(PointFormat::Ply));
        let pcd = points_of_pcd(&encoded(PointFormat::Pcd));
        for (format, points) in [("PLY", ply), ("PCD", pcd)] {
            assert_eq!(points.len(), 15, "{format}");
            let mut known = 0;
            for (at, (point, disparity_q4)) in points.iter().zip(disparities_q4()).enumerate() {
                let found = [point.x, point.y, point.z];
                let told = format!("{format}, {at}: {point:?}");
                assert_eq!([point.red, point.green, point.blue], colour(at as u32));
                assert_eq!(point.confidence, confidence(at), "{told}");
                // 96 m at the ninth are beyond what a point can say.
                if (6..=8).contains(&at) {
                    assert!(found.iter().all(|number| number.is_nan()), "{told}");
                    continue;
                }
                let disparity_px = f64::from(disparity_q4) / 16.0 + DOFFS_PX;
                let z_m = FOCAL_PX * BASELINE_MM / disparity_px / 1000.0;
                let [right_px, down_px] = [
                    (at % 5) as f64 - PRINCIPAL_PX[0],
                    (at / 5) as f64 - PRINCIPAL_PX[1],
                ];
                let expected = [right_px * z_m / FOCAL_PX, down_px * z_m / FOCAL_PX, z_m];
                for (found, expected) in found.into_iter().zip(expected) {
                    // Half a millimetre, and what half a millimetre of depth is to the side.
                    assert!((f64::from(found) - expected).abs() < 0.00052, "{told}");
                }
                known += 1;
            }
            assert_eq!(known, 12);
        }
    }

    #[test]
    fn lines_that_do_not_fill_the_view_are_refused() {
        let camera = RectifiedCamera::new(Depth::new(256_000, 0).unwrap(), 25_600, [0, 0]).unwrap();
        for format in [PointFormat::Ply, PointFormat::Pcd] {
            let none = std::iter::empty();
            assert!(format.encode(none, &RgbImage::new(2, 2), &camera).is_err());
        }
        assert_eq!(
            PointFormat::choose(Path::new("a.PLY")).unwrap(),
            PointFormat::Ply
        );
        let error = PointFormat::choose(Path::new("a.xyz")).unwrap_err();
        assert!(error.to_string().contains("a.xyz"));
    }
}
