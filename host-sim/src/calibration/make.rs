//! From calibration files to the rectification of a pair.

use anyhow::{Context, Result, anyhow, ensure};
use vgstereo_core::geometry::Interpolation;

use super::check::checked;
use super::maps::Maps;
use super::read::read;
use super::rectified::{Keep, RectifiedPair};
use super::stereo::StereoCalibration;

/// What the files leave open.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Width and height of the raw views, px; `None`: as the files state.
    pub size: Option<[u16; 2]>,
    /// Width and height of the rectified views, px; `None`: those of the raw views.
    pub view_size: Option<[u16; 2]>,
    /// The part of the scene to keep; `None`: as the files' own rectification has it, or else
    /// [`Keep::Valid`].
    pub keep: Option<Keep>,
    /// Projections of the left and the right rectified view, 3 by 4 and row-major, instead of those that
    /// would be chosen.
    pub projections: Option<[[f64; 12]; 2]>,
    /// Millimetres in the unit of the files' translation; `None`: as the format has it.
    pub unit_mm: Option<f64>,
    /// Column and line of the files' picture at which those that the cameras deliver begin.
    pub cropped: Option<[u16; 2]>,
    /// Pixels that the camera joins in each direction, against the files; of the cropped picture.
    pub binned: Option<u16>,
    /// How levels between raw pixels are made.
    pub interpolation: Interpolation,
}

/// A pair that can be rectified.
#[derive(Debug, Clone)]
pub struct Rectified {
    /// The calibration with its warnings.
    pub calibration: StereoCalibration,
    /// The geometry of the rectified views.
    pub pair: RectifiedPair,
    /// The maps for the core.
    pub maps: Maps,
    /// Whether the rectification is the files' own.
    pub is_stored: bool,
}

/// Makes the rectification of a pair from the names and the contents of its calibration files.
///
/// # Errors
/// Fails with one line that names the file or option and the reason.
pub fn rectify(files: &[(String, Vec<u8>)], options: &Options) -> Result<Rectified> {
    let mut calibration = read(files)?;
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let names = names.join(", ");
    if let Some(corner) = options.cropped {
        calibration = calibration.cropped(corner);
    }
    if let Some(factor) = options.binned {
        calibration = calibration.binned(factor).context("--binned")?;
    }
    if let Some(unit_mm) = options.unit_mm {
        calibration.unit_mm = Some(unit_mm);
    }
    let (mut calibration, raw_size) =
        checked(calibration, options.size).with_context(|| names.clone())?;
    let size = options.view_size.unwrap_or(raw_size);
    let stored = match RectifiedPair::from_stored(&calibration, raw_size) {
        Ok(stored) => stored,
        Err(reason) => {
            calibration.warnings.push(format!(
                "the rectification in the files is not used, it contradicts R and T or itself: {reason}"
            ));
            None
        }
    };
    let crop = match options.keep {
        Some(Keep::Crop(crop)) => Some(crop),
        _ => None,
    };
    ensure!(
        crop.is_none() || options.view_size.is_none(),
        "--view-size: the part that --keep gives has a size already"
    );
    let uses_stored = matches!(options.keep, None | Some(Keep::Crop(_))) && size == raw_size;
    let (mut pair, is_stored) = match (stored, options.projections) {
        (Some(stored), None) if uses_stored => (stored, true),
        (_, projections) => {
            let all = options.keep == Some(Keep::All);
            let computed = RectifiedPair::compute(&calibration, raw_size, size, all)
                .with_context(|| names.clone())?;
            match projections {
                Some(projections) => {
                    let given = RectifiedPair::from_projections(
                        &calibration,
                        computed.rotations,
                        projections,
                        size,
                    )?;
                    let baseline = computed.baseline;
                    (
                        RectifiedPair {
                            raw_size,
                            baseline,
                            ..given
                        },
                        false,
                    )
                }
                None => (computed, false),
            }
        }
    };
    if let Some(crop) = crop {
        pair = pair.cropped(crop).context("--keep")?;
    }
    let maps = Maps::new(&pair, calibration.unit_mm, options.interpolation).map_err(|reason| {
        // What was warned of may well be the cause.
        let warnings = calibration.warnings.iter();
        let warnings: String = warnings.map(|warning| format!("; {warning}")).collect();
        anyhow!("{names}: {reason:#}{warnings}")
    })?;
    if let Some(share) = maps.valid.iter().copied().reduce(f64::min)
        && share < 0.5
    {
        calibration.warnings.push(format!(
            "{:.0} % of a rectified view are seen by its camera: are the calibration and --keep right?",
            share * 100.0
        ));
    }
    Ok(Rectified {
        calibration,
        pair,
        maps,
        is_stored,
    })
}

#[cfg(test)]
mod tests {
    use super::super::camera::Camera;
    use super::super::lens::Lens;
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    const SIZE: [u16; 2] = [320, 240];
    const LEFT: [f64; 5] = [-0.31, 0.11, 0.0004, -0.0003, 0.0];
    const RIGHT: [f64; 5] = [-0.29, 0.1, -0.0002, 0.0005, 0.0];

    /// Two cameras that are turned against each other and against their baseline, mm.
    fn calibration() -> StereoCalibration {
        let camera = |intrinsics, coefficients: &[f64]| {
            let lens = Lens::radial_tangential(coefficients).unwrap();
            Camera::new(intrinsics, lens, Some(SIZE)).unwrap()
        };
        let turn = DVec3::new(0.012, -0.021, 0.016);
        StereoCalibration {
            format: "test",
            cameras: [
                camera([250.0, 251.0, 157.0, 124.0], &LEFT),
                camera([248.0, 249.0, 165.0, 117.0], &RIGHT),
            ],
            rotation: DMat3::from_axis_angle(turn.normalize(), turn.length()),
            translation: DVec3::new(-60.0, 1.2, -0.8),
            unit_mm: None,
            stored: None,
            warnings: Vec::new(),
        }
    }

    fn row_major(matrix: DMat3) -> [f64; 9] {
        matrix.transpose().to_cols_array()
    }

    fn list(numbers: &[f64]) -> String {
        let words: Vec<String> = numbers.iter().map(|n| format!("{n:?}")).collect();
        words.join(", ")
    }

    fn matrix_of(camera: &Camera) -> [f64; 9] {
        let (f, c) = (camera.focal_px, camera.principal_px);
        [f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0]
    }

    fn intrinsics_of(camera: &Camera) -> [f64; 4] {
        let (f, c) = (camera.focal_px, camera.principal_px);
        [f.x, f.y, c.x, c.y]
    }

    fn rows_of(rotation: DMat3, offset: DVec3) -> Vec<f64> {
        let r = row_major(rotation);
        let rows = (0..3).flat_map(|y| [r[3 * y], r[3 * y + 1], r[3 * y + 2], offset[y]]);
        rows.chain([0.0, 0.0, 0.0, 1.0]).collect()
    }

    fn file(name: &str, text: String) -> (String, Vec<u8>) {
        (name.to_owned(), text.into_bytes())
    }

    fn opencv(c: &StereoCalibration, head: &str) -> (String, Vec<u8>) {
        let [left, right] = c.cameras;
        let mut text = head.to_owned();
        for (name, rows, numbers) in [
            ("M1", 3, matrix_of(&left).to_vec()),
            ("D1", 1, LEFT.to_vec()),
            ("M2", 3, matrix_of(&right).to_vec()),
            ("D2", 5, RIGHT.to_vec()),
            ("R", 3, row_major(c.rotation).to_vec()),
            ("T", 3, c.translation.to_array().to_vec()),
        ] {
            text += &format!(
                "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {}\n   dt: d\n   data: [ {} ]\n",
                numbers.len() / rows,
                list(&numbers)
            );
        }
        file("stereo.yml", text)
    }

    fn opencv_xml(c: &StereoCalibration) -> (String, Vec<u8>) {
        let [left, right] = c.cameras;
        let mut text = "<?xml version=\"1.0\"?>\n<opencv_storage>\n".to_owned();
        for (name, numbers) in [
            ("cameraMatrix1", matrix_of(&left).to_vec()),
            ("distCoeffs1", LEFT.to_vec()),
            ("cameraMatrix2", matrix_of(&right).to_vec()),
            ("distCoeffs2", RIGHT.to_vec()),
            ("R", row_major(c.rotation).to_vec()),
            ("T", c.translation.to_array().to_vec()),
        ] {
            text += &format!(
                "<{name} type_id=\"opencv-matrix\"><rows>1</rows><cols>{}</cols><dt>d</dt>\n<data>\n{}\
                 </data></{name}>\n",
                numbers.len(),
                list(&numbers).replace(',', "\n")
            );
        }
        file("stereo.xml", text + "</opencv_storage>\n")
    }

    fn ros(c: &StereoCalibration) -> Vec<(String, Vec<u8>)> {
        let pair = RectifiedPair::compute(c, SIZE, SIZE, false).unwrap();
        let (f, at) = (pair.focal_px, pair.principal_px[0]);
        let camera = |view: usize, name: &str, coefficients: &[f64], offset: f64| {
            let projection = [f, 0.0, at.x, offset, 0.0, f, at.y, 0.0, 0.0, 0.0, 1.0, 0.0];
            let mut text = format!(
                "image_width: {}\nimage_height: {}\ncamera_name: {name}\ndistortion_model: plumb_bob\n",
                SIZE[0], SIZE[1]
            );
            for (key, numbers) in [
                ("camera_matrix", matrix_of(&c.cameras[view]).to_vec()),
                ("distortion_coefficients", coefficients.to_vec()),
                (
                    "rectification_matrix",
                    row_major(pair.rotations[view]).to_vec(),
                ),
                ("projection_matrix", projection.to_vec()),
            ] {
                text += &format!("{key}:\n  data: [{}]\n", list(&numbers));
            }
            file(&format!("{name}.yaml"), text)
        };
        vec![
            camera(1, "right", &RIGHT, -f * pair.baseline / 1000.0),
            camera(0, "left", &LEFT, 0.0),
        ]
    }

    fn kalibr(c: &StereoCalibration) -> (String, Vec<u8>) {
        let mut text = String::new();
        for (view, coefficients) in [LEFT, RIGHT].iter().enumerate() {
            text += &format!(
                "cam{view}:\n  camera_model: pinhole\n  distortion_model: radtan\n  \
                 distortion_coeffs: [{}]\n  intrinsics: [{}]\n  resolution: [{}, {}]\n",
                list(&coefficients[..4]),
                list(&intrinsics_of(&c.cameras[view])),
                SIZE[0],
                SIZE[1]
            );
        }
        text += "  T_cn_cnm1:\n";
        for row in rows_of(c.rotation, c.translation / 1000.0).chunks(4) {
            text += &format!("  - [{}]\n", list(row));
        }
        file("camchain.yaml", text)
    }

    fn euroc(c: &StereoCalibration) -> Vec<(String, Vec<u8>)> {
        // The left camera stands somewhere on a body, and the right one as it must.
        let left = (DMat3::from_rotation_z(1.5), DVec3::new(0.1, -0.2, 0.05));
        let back = c.rotation.transpose();
        let right_rotation = left.0 * back;
        let right = (
            right_rotation,
            left.1 - right_rotation * c.translation / 1000.0,
        );
        [left, right]
            .into_iter()
            .enumerate()
            .map(|(view, (rotation, offset))| {
                let text = format!(
                    "%YAML:1.0\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\nresolution: [{}, {}]\n\
                     camera_model: pinhole\nintrinsics: [{}] #fu, fv, cu, cv\n\
                     distortion_model: radial-tangential\ndistortion_coefficients: [{}]\n",
                    list(&rows_of(rotation, offset)),
                    SIZE[0],
                    SIZE[1],
                    list(&intrinsics_of(&c.cameras[view])),
                    list(&[LEFT, RIGHT][view][..4])
                );
                file(&format!("cam{view}/sensor.yaml"), text)
            })
            .collect()
    }

    #[test]
    fn every_format_gives_the_cameras_that_were_written() {
        let c = calibration();
        let cases = [
            ("yaml", vec![opencv(&c, "%YAML:1.0\n---\n")], 1.0),
            ("old yaml", vec![opencv(&c, "%YAML:1.0\n")], 1.0),
            ("new yaml", vec![opencv(&c, "%YAML 1.2\n---\n")], 1.0),
            ("xml", vec![opencv_xml(&c)], 1.0),
            ("ros", ros(&c), 1000.0),
            ("kalibr", vec![kalibr(&c)], 1000.0),
            ("euroc", euroc(&c), 1000.0),
        ];
        for (name, files, unit_mm) in cases {
            let found = read(&files).unwrap_or_else(|error| panic!("{name}: {error:#}"));
            assert_eq!(found.unit_mm.unwrap_or(1.0), unit_mm, "{name}");
            assert!(found.rotation.abs_diff_eq(c.rotation, 1e-9), "{name}");
            let translation = found.translation * unit_mm;
            assert!(translation.abs_diff_eq(c.translation, 1e-6), "{name}");
            for (found, expected) in found.cameras.iter().zip(&c.cameras) {
                assert_eq!(found.focal_px, expected.focal_px, "{name}");
                assert_eq!(found.principal_px, expected.principal_px, "{name}");
                assert_eq!(found.lens, expected.lens, "{name}");
            }
            let options = Options {
                size: Some(SIZE),
                ..Options::default()
            };
            let made = rectify(&files, &options).unwrap();
            assert!(made.maps.error_px <= 0.1, "{name}");
            assert!(made.calibration.warnings.is_empty(), "{name}");
        }
    }

    #[test]
    fn points_come_to_equal_lines_at_the_disparity_of_their_depth() {
        let c = calibration();
        let files = [opencv(&c, "%YAML:1.0\n---\n")];
        for keep in [Keep::Valid, Keep::All, Keep::Crop([30, 20, 200, 150])] {
            let options = Options {
                size: Some(SIZE),
                keep: Some(keep),
                unit_mm: Some(1.0),
                ..Options::default()
            };
            let made = rectify(&files, &options).unwrap();
            let pair = &made.pair;
            let depth = made.maps.rectification().unwrap().depth.unwrap();
            for (x, y, z) in [
                (20.0, -30.0, 400.0),
                (0.0, 0.0, 900.0),
                (-150.0, 90.0, 700.0),
            ] {
                let points = [
                    DVec3::new(x, y, z),
                    c.rotation * DVec3::new(x, y, z) + c.translation,
                ];
                let rectified = [0, 1].map(|view: usize| {
                    let turned = pair.rotations[view] * points[view];
                    turned.truncate() / turned.z * pair.focal_px + pair.principal_px[view]
                });
                assert!((rectified[0].y - rectified[1].y).abs() < 1e-9);
                let turned_z = (pair.rotations[0] * points[0]).z;
                let disparity = rectified[0].x - rectified[1].x;
                assert!(
                    (disparity - pair.focal_px * c.translation.length() / turned_z).abs() < 1e-9
                );
                let nearest_q4 = (disparity * 16.0).round();
                let of_step = turned_z * (disparity / (nearest_q4 / 16.0) - 1.0).abs();
                let mm = f64::from(depth.mm(nearest_q4 as i16));
                assert!((mm - turned_z).abs() < of_step + 0.6, "{mm} {turned_z}");
                for view in [0, 1] {
                    let (place, _) = pair.raw_position(view, rectified[view]);
                    let (seen, _) = c.cameras[view].project(points[view]);
                    assert!((place - seen).length() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn exchanged_views_are_put_into_order_with_a_warning() {
        let c = calibration();
        let exchanged = c.clone().exchanged();
        assert!(exchanged.translation.x > 0.0);
        let (mended, _) = checked(exchanged, None).unwrap();
        assert!(mended.warnings.iter().any(|w| w.contains("exchanged")));
        assert!(mended.rotation.abs_diff_eq(c.rotation, 1e-12));
        assert!(mended.translation.abs_diff_eq(c.translation, 1e-9));
        assert_eq!(mended.cameras, c.cameras);
    }

    #[test]
    fn a_stored_rectification_that_contradicts_is_not_used() {
        let c = calibration();
        let mut files = ros(&c);
        files.reverse();
        let (good, _) = checked(read(&files).unwrap(), None).unwrap();
        assert!(RectifiedPair::from_stored(&good, SIZE).unwrap().is_some());
        for spoil in [
            |c: &mut StereoCalibration| c.rotation = DMat3::from_rotation_x(0.01) * c.rotation,
            |c: &mut StereoCalibration| c.translation *= 1.1,
            |c: &mut StereoCalibration| c.stored.as_mut().unwrap().projections[1][6] += 1.0,
            |c: &mut StereoCalibration| c.stored.as_mut().unwrap().projections[1][0] += 1.0,
        ] {
            let mut bad = good.clone();
            spoil(&mut bad);
            assert!(RectifiedPair::from_stored(&bad, SIZE).is_err());
        }
    }

    #[test]
    fn sizes_baselines_and_mountings_that_do_not_fit_are_refused() {
        let refused = |change: &dyn Fn(&mut StereoCalibration), size| {
            let mut changed = calibration();
            change(&mut changed);
            checked(changed, size).unwrap_err().to_string()
        };
        let other = refused(&|_| {}, Some([640, 480]));
        assert!(other.contains("--binned"), "{other}");
        let placeholder = refused(&|c| c.translation = DVec3::ZERO, None);
        assert!(placeholder.contains("baseline is 0"), "{placeholder}");
        let above = refused(&|c| c.translation = DVec3::new(1.0, -60.0, 0.0), None);
        assert!(above.contains("side by side"), "{above}");
        let outside = refused(
            &|c| c.cameras[1].principal_px = DVec2::new(635.0, 380.0),
            None,
        );
        assert!(outside.contains("another resolution"), "{outside}");
        let unknown = refused(&|c| c.cameras.iter_mut().for_each(|c| c.size = None), None);
        assert!(unknown.contains("--size"), "{unknown}");
        // A baseline of 60 in metres.
        let mut implausible = calibration();
        implausible.unit_mm = Some(1000.0);
        let (warned, _) = checked(implausible, None).unwrap();
        assert_eq!((warned.unit_mm, warned.warnings.len()), (None, 1));
    }
}
