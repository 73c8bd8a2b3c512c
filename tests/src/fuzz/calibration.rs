//! The readers of calibration files, and what is made from them.

use vgstereo_sim::calibration::{Options, read, rectify};

use super::rectification::rectify_frames;
use super::{accepted, within_memory};

/// A line that begins with this, and goes on with a name, begins a file.
const FILE_MARK: &[u8] = b"=== ";
/// Maps of larger views are not made here, because they take long.
const SIDE_MAX_PX: u16 = 96;
/// Width and height of views whose files do not state them, px.
const SIZE: [u16; 2] = [64, 48];

/// Reads one calibration file or several: those that follow lines `=== NAME`. From what is accepted
/// a rectification is made, which rectifies frames.
pub fn run(bytes: &[u8]) {
    let files = files(bytes);
    let Some((first, _)) = files.first() else {
        return;
    };
    // A refusal names one of the files.
    let common = first.as_str();
    let bytes_max = (4 << 20) + 2048 * bytes.len() as u64;
    let calibration = within_memory(bytes_max, || read(&files));
    let Some(calibration) = accepted_of(calibration, &files, common) else {
        return;
    };
    for camera in &calibration.cameras {
        assert!(camera.focal_px.is_finite() && camera.principal_px.is_finite());
    }
    assert!(calibration.rotation.is_finite() && calibration.translation.is_finite());
    let stated = calibration.cameras.map(|camera| camera.size);
    let size = stated[0].or(stated[1]);
    if size.is_some_and(|sides| sides.into_iter().any(|side| side > SIDE_MAX_PX)) {
        return;
    }
    let options = Options {
        size: size.is_none().then_some(SIZE),
        ..Options::default()
    };
    let Some(made) = accepted_of(rectify(&files, &options), &files, common) else {
        return;
    };
    assert!(made.maps.error_px.is_finite());
    rectify_frames(&made.maps.rectification().unwrap());
}

/// What was read, or `None` after a refusal that must name one of the files.
fn accepted_of<T>(
    result: anyhow::Result<T>,
    files: &[(String, Vec<u8>)],
    common: &str,
) -> Option<T> {
    let message = result.as_ref().err().map(|error| format!("{error:#}"));
    let named = message.and_then(|message| {
        let mut names = files.iter().map(|(name, _)| name.as_str());
        names.find(|name| message.contains(name))
    });
    accepted(result, named.unwrap_or(common))
}

/// The files that bytes stand for, with their names.
fn files(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        match (line.strip_prefix(FILE_MARK), files.last_mut()) {
            (Some(name), _) => {
                let name = String::from_utf8_lossy(name).trim().to_owned();
                files.push((name, Vec::new()));
            }
            (None, Some((_, content))) => content.extend_from_slice(line),
            (None, None) => files.push(("stereo.yml".to_owned(), line.to_vec())),
        }
    }
    files
}
