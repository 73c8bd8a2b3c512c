//! From files of any supported kind to the calibration of a pair.

use anyhow::{Result, bail, ensure};

use super::document::Document;
use super::lens::not_computed;
use super::stereo::StereoCalibration;
use super::{boofcv, euroc, kalibr, opencv, ros};

/// Reads the calibration of a pair from the names and the contents of its files.
///
/// Of files that are of a camera each, the left one's is that whose name says so, or else the first.
///
/// # Errors
/// Fails with one line that names the file and the reason: files that cannot be parsed, are of no supported
/// kind, lack something, or have a lens model that is not computed.
pub fn read(files: &[(String, Vec<u8>)]) -> Result<StereoCalibration> {
    let documents = files
        .iter()
        .map(|(name, bytes)| Document::parse(name, bytes))
        .collect::<Result<Vec<_>>>()?;
    for document in &documents {
        refuse_basalt(document)?;
    }
    let all = |is_known: fn(&Document) -> bool| documents.iter().all(is_known);
    match documents.as_slice() {
        [] => bail!("no calibration file is given"),
        [one] if kalibr::is_known(one) => kalibr::read(one),
        [one] if boofcv::is_known(one) => boofcv::read(one),
        [one] if ros::is_known(one) => bail!(
            "{}: a camera_info file of ROS is of one camera: give those of the left and the right one",
            one.name
        ),
        [one] if euroc::is_known(one) => bail!(
            "{}: a sensor file is of one camera: give those of the left and the right one",
            one.name
        ),
        [first, second] if all(ros::is_known) => ros::read(left_first(first, second)),
        [first, second] if all(euroc::is_known) => euroc::read(left_first(first, second)),
        several => {
            for document in several {
                ensure!(
                    several.len() == 1
                        || !kalibr::is_known(document) && !boofcv::is_known(document),
                    "{}: this file is of both cameras: give it alone",
                    document.name
                );
                ensure!(
                    !ros::is_known(document) && !euroc::is_known(document),
                    "{}: this file is of one camera: give that of the other one with it, and no more",
                    document.name
                );
            }
            if let [one] = several {
                ensure!(
                    opencv::is_known(one),
                    "{}: not a calibration of OpenCV, ROS, Kalibr, EuRoC or BoofCV",
                    one.name
                );
            }
            opencv::read(several)
        }
    }
}

/// Reads the projections of the left and the right rectified view, 3 by 4 and row-major, from the
/// entries `P1` and `P2` of a file or of its entry `rectified`; `None` if there are none.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn projections(name: &str, bytes: &[u8]) -> Result<Option<[[f64; 12]; 2]>> {
    let document = Document::parse(name, bytes)?;
    let root = document.root();
    for entry in root.get("rectified").into_iter().chain([root]) {
        if let (Some(left), Some(right)) = (entry.get("P1"), entry.get("P2")) {
            return Ok(Some([left.numbers()?, right.numbers()?]));
        }
    }
    Ok(None)
}

/// Two files, that of the left camera first if their names tell.
fn left_first<'a>(first: &'a Document, second: &'a Document) -> [&'a Document; 2] {
    if first.side() == Some(1) && second.side() == Some(0) {
        [second, first]
    } else {
        [first, second]
    }
}

/// Names the lens model of Basalt's files, which are not read otherwise.
fn refuse_basalt(document: &Document) -> Result<()> {
    let intrinsics = document
        .root()
        .get("value0")
        .and_then(|value| value.get("intrinsics"));
    let Some(intrinsics) = intrinsics else {
        return Ok(());
    };
    for (_, camera) in intrinsics.entries() {
        if let Some(model) = camera.get("camera_type") {
            model.within(Err(not_computed(model.text().unwrap_or_default())))?;
        }
    }
    bail!(
        "{}: calibrations of Basalt are not read: use the chain that Kalibr wrote",
        document.name
    )
}
