//! Calibrations of OpenCV's programs: matrices in YAML, XML, JSON, npy or npz, under names that differ
//! from program to program.

use std::collections::BTreeMap;

use anyhow::{Result, anyhow, ensure};

use super::camera::Camera;
use super::document::{Document, Entry};
use super::lens::Lens;
use super::stereo::{StereoCalibration, StoredRectification, parse_unit, rotation};
use glam::{DMat3, DVec3};

/// What a matrix is, by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Camera,
    Distortion,
    /// The rotation between the cameras without a side, that to the rectified view with one.
    Rotation,
    Projection,
    Translation,
    Size,
}

/// Names of matrices, lower-case letters and digits alone, without what names the side.
const NAMES: [(Kind, &[&str]); 6] = [
    (
        Kind::Camera,
        &[
            "m",
            "k",
            "a",
            "mtx",
            "cammat",
            "cammats",
            "cammatrix",
            "cameramat",
            "cameramatrix",
            "cameramatrices",
            "intrinsic",
            "intrinsics",
            "intrinsicmatrix",
            "cameraintrinsics",
        ],
    ),
    (
        Kind::Distortion,
        &[
            "d",
            "dist",
            "distcoef",
            "distcoefs",
            "distcoeff",
            "distcoeffs",
            "distortion",
            "distortions",
            "distortioncoefficients",
            "distortioncoeffs",
            "distortioncoefs",
        ],
    ),
    (
        Kind::Rotation,
        &[
            "r",
            "rot",
            "rotmat",
            "rotation",
            "rotationmatrix",
            "rect",
            "recttrans",
            "rectmat",
            "rectification",
            "rectificationmatrix",
            "rectificationtransform",
        ],
    ),
    (
        Kind::Projection,
        &[
            "p",
            "proj",
            "projmat",
            "projmats",
            "projection",
            "projectionmatrix",
            "newcameramatrix",
        ],
    ),
    (
        Kind::Translation,
        &[
            "t",
            "trans",
            "trns",
            "transvec",
            "tvec",
            "translation",
            "translationvector",
            "translationvec",
        ],
    ),
    (
        Kind::Size,
        &["size", "imagesize", "imgsize", "framesize", "resolution"],
    ),
];

/// The matrices of the files, by kind and side; a side of `None` is what both cameras share.
type Found<'a> = BTreeMap<(Kind, Option<usize>), Entry<'a>>;

/// Reads one file or several that complete each other.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub(super) fn read(documents: &[Document]) -> Result<StereoCalibration> {
    let mut found = Found::new();
    for document in documents {
        for (name, entry) in document.root().entries() {
            if let Some((kind, side)) = kind_and_side(&name) {
                // A file of one camera names it in its own name alone.
                let is_of_one = matches!(kind, Kind::Camera | Kind::Distortion);
                let side = side.or_else(|| if is_of_one { document.side() } else { None });
                let key = (kind, side);
                let again = found.insert(key, entry.clone());
                ensure!(
                    again.is_none(),
                    entry.error("is there twice, in one file or in two: whose calibration is it?")
                );
            }
        }
    }
    let names = || {
        let names: Vec<&str> = documents.iter().map(|d| d.name.as_str()).collect();
        names.join(", ")
    };
    let missing = |what: &str| {
        anyhow!(
            "{}: there is no {what}; a calibration of OpenCV has the matrices M1 D1 M2 D2 R T, or others \
             that name themselves so",
            names()
        )
    };
    let size = size(&found, documents)?;
    let is_fisheye = is_fisheye(documents)?;
    let camera = |side: usize| -> Result<Camera> {
        let matrix = found.get(&(Kind::Camera, Some(side))).ok_or_else(|| {
            missing(
                [
                    "camera matrix of the left camera",
                    "camera matrix of the right camera",
                ][side],
            )
        })?;
        let distortion = found.get(&(Kind::Distortion, Some(side))).ok_or_else(|| {
            missing(
                [
                    "distortion of the left camera",
                    "distortion of the right camera",
                ][side],
            )
        })?;
        let coefficients = distortion.list()?;
        let lens = distortion.within(if is_fisheye == Some(true) {
            Lens::named("fisheye", &coefficients)
        } else {
            Lens::radial_tangential(&coefficients)
        })?;
        matrix.within(Camera::from_matrix(matrix.numbers()?, lens, size))
    };
    let cameras = [camera(0)?, camera(1)?];
    let stored = stored(&found)?;
    let (rotation, translation) = match (
        found.get(&(Kind::Rotation, None)),
        found.get(&(Kind::Translation, None)),
        &stored,
    ) {
        (Some(turned), Some(moved), _) => {
            let moved = moved.numbers()?;
            (rotation_of(turned)?, DVec3::from_array(moved))
        }
        (_, _, Some(stored)) => stored.motion(),
        (None, ..) => return Err(missing("rotation R from the left to the right camera")),
        (_, None, _) => return Err(missing("translation T from the left to the right camera")),
    };
    let mut warnings = Vec::new();
    if let Some(entry) = found.get(&(Kind::Distortion, Some(0)))
        && entry.list()?.len() == 4
        && is_fisheye.is_none()
    {
        warnings.push(
            "four distortion coefficients are taken as k1 k2 p1 p2; if they are k1 to k4 of OpenCV's \
             fisheye module, add the line fisheye_model: 1"
                .to_owned(),
        );
    }
    Ok(StereoCalibration {
        format: "OpenCV",
        cameras,
        rotation,
        translation,
        unit_mm: unit_mm(documents)?,
        stored,
        warnings,
    })
}

/// Whether any of the names in a file is one of a stereo calibration of OpenCV.
pub(super) fn is_known(document: &Document) -> bool {
    let entries = document.root().entries();
    entries
        .iter()
        .any(|(name, _)| kind_and_side(name).is_some())
}

/// What a name says: `cameraMatrix1`, `LEFT.K`, `dist_coefs_right`, `R`.
fn kind_and_side(name: &str) -> Option<(Kind, Option<usize>)> {
    let plain: String = name
        .chars()
        .filter(char::is_ascii_alphanumeric)
        .map(|letter| letter.to_ascii_lowercase())
        .collect();
    let kind = |stem: &str| {
        let named = NAMES.iter().find(|(_, names)| names.contains(&stem));
        named.map(|&(kind, _)| kind)
    };
    if let Some(kind) = kind(&plain) {
        return Some((kind, None));
    }
    for (side, marks) in [["left", "1", "l"], ["right", "2", "r"]].iter().enumerate() {
        for mark in marks {
            let stems = [plain.strip_suffix(mark), plain.strip_prefix(mark)];
            if let Some(kind) = stems.into_iter().flatten().find_map(kind) {
                return Some((kind, Some(side)));
            }
        }
    }
    None
}

/// The size of the pictures, where one is stated.
fn size(found: &Found<'_>, documents: &[Document]) -> Result<Option<[u16; 2]>> {
    if let Some(entry) = found.get(&(Kind::Size, None)) {
        return entry.size().map(Some);
    }
    for document in documents {
        for (width, height) in [
            ("image_width", "image_height"),
            ("imageWidth", "imageHeight"),
            ("width", "height"),
            ("Camera.width", "Camera.height"),
        ] {
            if let Some(size) = document.root().size_of(width, height)? {
                return Ok(Some(size));
            }
        }
    }
    Ok(None)
}

/// Whether the lenses are those of OpenCV's fisheye module, where a file states it: under the name that
/// OpenCV's own program for one camera gives it.
fn is_fisheye(documents: &[Document]) -> Result<Option<bool>> {
    let entries = documents
        .iter()
        .find_map(|document| document.root().get("fisheye_model"));
    let Some(entry) = entries else {
        return Ok(None);
    };
    match entry.numbers()? {
        [0.0] => Ok(Some(false)),
        [1.0] => Ok(Some(true)),
        _ => Err(entry.error("is neither 0 nor 1")),
    }
}

/// Millimetres in the unit of the translation, where a file states it: under the name that
/// `tools/calibrate.py` gives it, or by being one of ORB-SLAM2, whose unit is the metre.
fn unit_mm(documents: &[Document]) -> Result<Option<f64>> {
    for document in documents {
        let root = document.root();
        if let Some(entry) = root.get("translation_unit") {
            let text = entry.text().map_or_else(
                || entry.numbers().map(|[mm]: [f64; 1]| mm.to_string()),
                |text| Ok(text.to_owned()),
            )?;
            let unit = parse_unit(&text).map_err(|reason| anyhow!("is {text:?}: {reason}"));
            return entry.within(unit).map(Some);
        }
        if root.get("Camera.bf").is_some() {
            return Ok(Some(1000.0));
        }
    }
    Ok(None)
}

fn stored(found: &Found<'_>) -> Result<Option<StoredRectification>> {
    let get = |kind, side| found.get(&(kind, Some(side)));
    let (Some(r1), Some(r2), Some(p1), Some(p2)) = (
        get(Kind::Rotation, 0),
        get(Kind::Rotation, 1),
        get(Kind::Projection, 0),
        get(Kind::Projection, 1),
    ) else {
        return Ok(None);
    };
    Ok(Some(StoredRectification {
        rotations: [rotation_of(r1)?, rotation_of(r2)?],
        projections: [p1.numbers()?, p2.numbers()?],
    }))
}

/// A rotation as a matrix, or as a vector along its axis as long as its angle.
fn rotation_of(entry: &Entry<'_>) -> Result<DMat3> {
    if entry.list()?.len() == 3 {
        let axis = DVec3::from_array(entry.numbers()?);
        let angle = axis.length();
        return Ok(match axis.try_normalize() {
            Some(axis) => DMat3::from_axis_angle(axis, angle),
            None => DMat3::IDENTITY,
        });
    }
    entry.within(rotation(entry.numbers()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pair of cameras with these distortion coefficients and further entries.
    fn pair(coefficients: &str, more: &str) -> Result<StereoCalibration> {
        let camera = "[300, 0, 160, 0, 300, 120, 0, 0, 1]";
        let text = format!(
            "M1: {camera}\nM2: {camera}\nD1: {coefficients}\nD2: {coefficients}\n\
             R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-60, 0, 0]\n{more}"
        );
        read(&[Document::parse("stereo.yml", text.as_bytes())?])
    }

    #[test]
    fn files_state_their_unit_and_whether_lenses_are_fisheyes() {
        let plain = pair("[0.1, 0, 0, 0]", "").unwrap();
        assert_eq!((plain.unit_mm, plain.warnings.len()), (None, 1));
        let stated = pair("[0.1, 0, 0, 0]", "fisheye_model: 0\ntranslation_unit: cm\n").unwrap();
        assert_eq!((stated.unit_mm, stated.warnings.len()), (Some(10.0), 0));
        assert_eq!(stated.cameras, plain.cameras);
        let fisheye = pair(
            "[0.1, 0, 0, 0]",
            "fisheye_model: 1\ntranslation_unit: 25.4\n",
        )
        .unwrap();
        assert_eq!((fisheye.unit_mm, fisheye.warnings.len()), (Some(25.4), 0));
        let lens = Lens::named("equidistant", &[0.1, 0.0, 0.0, 0.0]).unwrap();
        assert!(fisheye.cameras.iter().all(|camera| camera.lens == lens));
        for (coefficients, more, words) in [
            ("[0.1, 0, 0, 0, 0]", "fisheye_model: 1", "4 coefficients"),
            ("[0.1, 0, 0, 0]", "fisheye_model: 2", "fisheye_model"),
            ("[0.1, 0, 0, 0]", "translation_unit: ft", "translation_unit"),
            ("[0.1, 0, 0, 0]", "translation_unit: -1", "translation_unit"),
        ] {
            let error = format!("{:#}", pair(coefficients, more).unwrap_err());
            assert!(
                error.contains("stereo.yml") && error.contains(words),
                "{error}"
            );
        }
    }

    #[test]
    fn names_tell_what_a_matrix_is_and_of_which_side() {
        let cases = [
            ("M1", Some((Kind::Camera, Some(0)))),
            ("K2", Some((Kind::Camera, Some(1)))),
            ("cameraMatrix1", Some((Kind::Camera, Some(0)))),
            ("camera_matrix_right", Some((Kind::Camera, Some(1)))),
            ("leftCameraMatrix", Some((Kind::Camera, Some(0)))),
            ("cam_mats_left", Some((Kind::Camera, Some(0)))),
            ("KR", Some((Kind::Camera, Some(1)))),
            ("LEFT.D", Some((Kind::Distortion, Some(0)))),
            ("distCoeffs2", Some((Kind::Distortion, Some(1)))),
            ("R", Some((Kind::Rotation, None))),
            ("rot_mat", Some((Kind::Rotation, None))),
            ("R1", Some((Kind::Rotation, Some(0)))),
            ("rect_trans_right", Some((Kind::Rotation, Some(1)))),
            ("trans_vec", Some((Kind::Translation, None))),
            ("Trns", Some((Kind::Translation, None))),
            ("mtxL", Some((Kind::Camera, Some(0)))),
            ("dist_2", Some((Kind::Distortion, Some(1)))),
            ("P2", Some((Kind::Projection, Some(1)))),
            ("imageSize", Some((Kind::Size, None))),
            ("Q", None),
            ("avg_reprojection_error", None),
            ("valid_boxes_left", None),
        ];
        for (name, expected) in cases {
            assert_eq!(kind_and_side(name), expected, "{name}");
        }
    }
}
