//! Sessions whose camera is not rectified: frames equal those that are rectified whole and matched
//! then, after every fault, and what does not fit is refused.

use vgstereo_boards::host;
use vgstereo_boards::pair::Pair;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_core::{Matcher, Portable, Preset};
use vgstereo_firmware::camera::{LinePairSource, PixelFormat};
use vgstereo_firmware::scripted::{FaultKind, ScriptedFault};
use vgstereo_firmware::session::{self, SessionError};
use vgstereo_firmware::{NoWatchdog, Session};
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::rectify::rectified;
use vgstereo_sim::sink::FrameCollector;
use vgstereo_sim::views::views_of;

const WIDTH: u16 = 64;
const HEIGHT: u16 = 40;

/// The disparities and confidences of views that are rectified whole, and matched after that.
fn rectified_whole(pair: &Pair, preset: Preset) -> (Vec<u8>, Vec<u8>) {
    let request = pair.request(preset, 1, &[]).unwrap();
    let is_grey = pair.format.is_grey();
    let raw = views_of(pair.left.clone(), pair.right.clone(), is_grey).unwrap();
    let bytes = pair.rectification.as_ref().unwrap();
    let views = rectified(&raw, &Rectification::from_bytes(bytes).unwrap()).unwrap();
    let matched = match_frame(&request.config(), &views, NativeKernels::fastest(), 2).unwrap();
    let disparities = matched.disparities_q4.iter().flat_map(|d| d.to_le_bytes());
    (disparities.collect(), matched.confidences)
}

#[test]
fn frames_are_those_of_views_rectified_whole_after_every_fault() {
    for format in [PixelFormat::Grey8, PixelFormat::Rgb888] {
        let pair = Pair {
            format,
            ..Pair::crooked(WIDTH, HEIGHT, 16, true).unwrap()
        };
        for preset in [Preset::Lite, Preset::Micro, Preset::Paper] {
            let (disparities, confidences) = rectified_whole(&pair, preset);
            for kind in FaultKind::ALL {
                for line in [0, 1, 19, 38, 39] {
                    let fault = ScriptedFault {
                        frame: 1,
                        line,
                        kind,
                    };
                    let request = pair.request(preset, 2, &[fault]).unwrap();
                    let (frames, _) = host::run(&pair, &request).unwrap();
                    let what = format!("{preset}, {format:?}, {fault}");
                    assert!(frames.disparities == disparities.repeat(2), "{what}");
                    assert!(frames.confidences == confidences.repeat(2), "{what}");
                }
            }
        }
    }
}

#[test]
fn a_rectification_for_others_is_refused() {
    let pair = Pair::crooked(WIDTH, HEIGHT, 16, true).unwrap();
    let bytes = pair.rectification.clone().unwrap();
    let rectification = Rectification::from_bytes(&bytes).unwrap();
    let refused = |camera_of: &Pair, width: u16| {
        let mut config = pair.request(Preset::Lite, 1, &[]).unwrap().config();
        config.width = width;
        config.region.width = width;
        let mut memory = vec![0; config.memory_words()];
        let matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
        let mut strip = vec![0; Rectifier::words(&rectification, false)];
        let mut rectifier = Rectifier::new(rectification, false, Portable, &mut strip).unwrap();
        let camera = camera_of.camera().unwrap();
        let mut lines = vec![0; session::memory_words(&camera.geometry())];
        let sink = FrameCollector::new();
        Session::rectifying(
            camera,
            Some(&mut rectifier),
            matcher,
            sink,
            &mut lines,
            NoWatchdog,
        )
        .err()
    };
    assert_eq!(refused(&pair, WIDTH), None);
    let is_refused = |error| matches!(error, Some(SessionError::Rectification { .. }));
    assert!(is_refused(refused(&pair, WIDTH - 1)));
    let narrower = Pair::rendered(u32::from(WIDTH) - 4, HEIGHT.into(), 16);
    assert!(is_refused(refused(&narrower, WIDTH)));
    let higher = Pair::rendered(WIDTH.into(), u32::from(HEIGHT) + 1, 16);
    assert!(is_refused(refused(&higher, WIDTH)));
}
