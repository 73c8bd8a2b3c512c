//! `vgstereo match --points`: clouds of points.

use std::fs;

use image::Rgb;
use serde::Deserialize;
use vgstereo_core::kernel::luma_row;
use vgstereo_firmware::camera::PixelFormat;

use crate::fixture::{Fixture, HEIGHT, SHIFT, WIDTH, texture};

/// A point of a PLY, as a reader that did not write it finds it.
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

const MATCH: [&str; 7] = [
    "match",
    "left.png",
    "right.png",
    "--d-max",
    "20",
    "--out",
    "map.png",
];
const CAMERA: [&str; 8] = [
    "--focal",
    "100",
    "--baseline",
    "60",
    "--doffs",
    "1.5",
    "--principal",
    "30.25,22",
];

/// The points of a match with these options, row by row.
fn points(fixture: &Fixture, more: &[&str]) -> Vec<Found> {
    let outputs = ["--points", "cloud.ply"];
    let outcome = fixture.run(&[&MATCH[..], &CAMERA, &outputs, more].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let told = "wrote cloud.ply: m, x right, y down, z forward, row by row, NaN = none";
    assert!(outcome.stdout.contains(told), "{}", outcome.stdout);
    let bytes = fs::read(fixture.path("cloud.ply")).unwrap();
    let mut reader = serde_ply::PlyReader::from_reader(bytes.as_slice()).unwrap();
    let organised = [format!("num_cols {WIDTH}"), format!("num_rows {HEIGHT}")];
    assert_eq!(reader.header().obj_info, organised);
    let points: Vec<Found> = reader.next_element().unwrap();
    assert_eq!(points.len(), (WIDTH * HEIGHT) as usize);
    points
}

fn pixels() -> impl Iterator<Item = (u32, u32)> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
}

/// A wall across the view, seen by the camera of either reference.
#[test]
fn points_lie_on_the_wall_in_the_colours_of_the_reference() {
    let fixture = Fixture::new();
    let wall_m = 100.0 * 0.06 / (f64::from(SHIFT) + 1.5);
    for (reference, cx_px, colours) in [
        ("left", 30.25, texture(0)),
        ("right", 31.75, texture(SHIFT)),
    ] {
        let points = points(&fixture, &["--reference", reference]);
        let mut on_wall = 0;
        for ((x, y), point) in pixels().zip(&points) {
            let colour = Rgb([point.red, point.green, point.blue]);
            assert_eq!(colour, *colours.get_pixel(x, y), "{reference} {x}, {y}");
            let expected = [
                (f64::from(x) - cx_px) / 100.0 * wall_m,
                (f64::from(y) - 22.0) / 100.0 * wall_m,
                wall_m,
            ];
            let found = [point.x, point.y, point.z].map(f64::from);
            // Off by 1/16 px at most.
            let off_max_m = wall_m / (16.0 * (f64::from(SHIFT) + 1.5) - 1.0) + 0.0011;
            let is_near = |(found, expected): (f64, f64)| (found - expected).abs() < off_max_m;
            on_wall += usize::from(found.into_iter().zip(expected).all(is_near));
        }
        assert!(on_wall * 10 > points.len() * 9, "{reference}: {on_wall}");
    }
}

/// The pixels without a disparity in the map are those without a point, and confidences are as in
/// their own map.
#[test]
fn what_is_not_known_is_not_a_number() {
    let fixture = Fixture::new();
    let more = ["--sparse", "--confidence", "sure.png", "--grey"];
    let points = points(&fixture, &more);
    let map = image::open(fixture.path("map.png")).unwrap().into_luma16();
    let sure = image::open(fixture.path("sure.png")).unwrap().into_luma8();
    let mut unknown = 0;
    for ((x, y), point) in pixels().zip(&points) {
        let is_unknown = map.get_pixel(x, y).0[0] == 0;
        for number in [point.x, point.y, point.z] {
            assert_eq!(number.is_nan(), is_unknown, "{x}, {y}: {point:?}");
        }
        assert_eq!(point.confidence, sure.get_pixel(x, y).0[0], "{x}, {y}");
        let mut grey = [0];
        luma_row(
            PixelFormat::Rgb888,
            &texture(0).get_pixel(x, y).0,
            &mut grey,
        );
        assert_eq!([point.red, point.green, point.blue], [grey[0]; 3]);
        unknown += u32::from(is_unknown);
    }
    assert!(unknown > HEIGHT && unknown < WIDTH * HEIGHT / 2);
}

#[test]
fn both_formats_have_the_same_points() {
    let fixture = Fixture::new();
    let ply = points(&fixture, &[]);
    let more = ["--points", "cloud.PCD"];
    let outcome = fixture.run(&[&MATCH[..], &CAMERA, &more].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let bytes = fs::read(fixture.path("cloud.PCD")).unwrap();
    let data = &bytes[bytes.len() - ply.len() * 17..];
    let header = String::from_utf8_lossy(&bytes[..bytes.len() - data.len()]);
    for line in [
        format!("WIDTH {WIDTH}\n"),
        format!("HEIGHT {HEIGHT}\n"),
        "DATA binary\n".to_owned(),
    ] {
        assert!(header.contains(&line), "{header}");
    }
    for (record, point) in data.chunks_exact(17).zip(&ply) {
        let place = [point.x, point.y, point.z];
        let place: Vec<u8> = place.into_iter().flat_map(f32::to_le_bytes).collect();
        assert_eq!(record[..12], place);
        let rest = [point.blue, point.green, point.red, 0, point.confidence];
        assert_eq!(record[12..], rest);
    }
}

#[test]
fn a_cloud_needs_cameras_and_a_name_of_its_own() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.ply"), "%YAML:1.0\n").unwrap();
    let refuses = |more: &[&str], words: &[&str]| {
        fixture.refuses(&[&MATCH[..], more].concat(), words);
    };
    let cloud = ["--points", "cloud.ply"];
    refuses(&cloud, &["--points", "--calibration", "--focal"]);
    for name in ["cloud.xyz", "cloud", "-"] {
        let more = [&CAMERA[..], &["--points", name]].concat();
        refuses(&more, &[name, ".ply", ".pcd"]);
    }
    let over = ["--calibration", "cal.ply", "--points", "./cal.ply"];
    refuses(&over, &["--points", "cal.ply", "input"]);
    let twice = [&CAMERA[..], &["--points", "no/cloud.ply"]].concat();
    refuses(&twice, &["no/cloud.ply", "folder"]);
    let focal = ["--focal", "8", "--baseline", "60"];
    refuses(
        &[&focal[..], &cloud].concat(),
        &["--points", "focal length", "16"],
    );
}
