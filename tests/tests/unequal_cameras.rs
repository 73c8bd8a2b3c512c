//! Unequal cameras on the built-in scene: the exposure and the alignment that are learned on the
//! way make up for most of the difference.

use vgstereo_core::{Output, Preset};
use vgstereo_sim::exposure::Exposure;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::render::{Exposures, RenderOptions, render};
use vgstereo_sim::scene::Scene;
use vgstereo_sim::stress::{Kind, Stress};
use vgstereo_tests::{bad_percent, mean_bad_percent, with_sgm};

fn lowered(line_offset_px: f32) -> Scene {
    render(&RenderOptions {
        line_offset_px,
        ..RenderOptions::default()
    })
}

/// Name of the exposure whose first lines clip.
const CLIPPING: &str = "falling gain that clips at first";

#[test]
fn what_neither_clips_nor_drowns_in_noise_costs_little() {
    let exposures = [
        ("brighter", 1.25, 0.0, 0.0, 0.0),
        ("lower black level", 1.0, 0.0, -30.0, 0.0),
        ("higher black level", 1.0, 0.0, 30.0, 0.0),
        ("rising black level", 1.0, 0.0, 0.0, 60.0),
        ("falling black level", 1.0, 0.0, 0.0, -60.0),
        ("falling gain", 1.0, -0.8, 0.0, 0.0),
        (CLIPPING, 1.1, -1.0, 0.0, 0.0),
    ];
    let presets = [Preset::Lite, Preset::Micro, Preset::Balanced];
    let rendered = Exposures::new(&RenderOptions::default());
    let equal = rendered.scene(Exposure::EQUAL);
    let equal = presets.map(|preset| mean_bad_percent(preset.parameters(), &equal));
    for (name, gain, gain_gradient, offset, offset_gradient) in exposures {
        let scene = rendered.scene(Exposure {
            gain,
            gain_gradient,
            offset,
            offset_gradient,
        });
        for (preset, equal) in presets.into_iter().zip(equal) {
            let cost = mean_bad_percent(preset.parameters(), &scene) - equal;
            // Clipped levels are lost, and patterns of what is clipped tell less. The gain is largest at
            // the blank wall, for which `lite` pays most.
            let most = match (preset, name) {
                (Preset::Lite, CLIPPING) => 2.3,
                (_, CLIPPING) => 1.2,
                _ => 0.65,
            };
            assert!(cost <= most, "{preset}, {name}: {cost:+.2}");
        }
    }
}

/// The scene begins with a blank wall, and an exposure learned wrongly from its first lines affects
/// many lines below.
#[test]
fn a_darker_camera_does_not_upset_a_blank_wall() {
    let rendered = Exposures::new(&RenderOptions::default());
    let darker = rendered.scene(Exposure {
        gain: 0.6,
        ..Exposure::EQUAL
    });
    let balanced = Preset::Balanced.parameters();
    let equal = rendered.scene(Exposure::EQUAL);
    let cost = bad_percent(balanced, &darker) - bad_percent(balanced, &equal);
    assert!(cost <= 2.0, "{cost:+.2}");
}

/// Alignment recovers most of the accuracy that a vertical offset costs.
#[test]
fn lines_that_lie_too_low_or_too_high_cost_little() {
    let aligned = lowered(0.0);
    for line_offset_px in [-0.9, 0.9] {
        let scene = lowered(line_offset_px);
        for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
            let moved = preset.parameters();
            let unmoved = with_sgm(moved, |sgm| sgm.line_offset_max_lines = 0);
            let aligned = bad_percent(moved, &aligned);
            let cost = bad_percent(moved, &scene) - aligned;
            let cost_unmoved = bad_percent(unmoved, &scene) - aligned;
            let what = format!("{preset}, {line_offset_px} px: {cost:+.2} of {cost_unmoved:+.2}");
            // `lite` pays 1.9 to 2.5 with the seeds 2 to 6, and 3.3 with its own, which loses least
            // where lines are aligned.
            let most = if preset == Preset::Lite { 3.5 } else { 2.5 };
            assert!(
                cost <= most && cost_unmoved >= 4.0 * cost.max(1.0),
                "{what}"
            );
        }
    }
}

/// If one camera is turned against the other, the offset changes along the line.
#[test]
fn a_turned_camera_costs_little() {
    let as_it_is = lowered(0.0);
    for (degrees, lines_max) in [(0.25, 1), (-0.25, 1), (0.5, 2)] {
        let mut scene = lowered(0.0);
        let roll = Stress {
            kind: Kind::Roll,
            amount: degrees,
        };
        roll.apply(&mut scene, 1).unwrap();
        for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
            let with =
                |lines| with_sgm(preset.parameters(), |sgm| sgm.line_offset_max_lines = lines);
            let equal = bad_percent(preset.parameters(), &as_it_is);
            let (bad, bad_unmoved) = (
                bad_percent(with(lines_max), &scene),
                bad_percent(with(0), &scene),
            );
            let what =
                format!("{preset}, {degrees} degrees: {bad:.2} of {bad_unmoved:.2}, {equal:.2}");
            println!("{what}");
            // The first lines are matched before the offset is known.
            assert!(bad <= 1.3 * equal && bad_unmoved > 1.5 * equal, "{what}");
        }
    }
}

/// If one camera sees everything larger, no part of a frame shows by how much its next lines are off, but the frame
/// before does.
#[test]
fn a_larger_view_costs_little_from_the_third_frame_on() {
    let as_it_is = lowered(0.0);
    let mut scene = lowered(0.0);
    let scale = Stress {
        kind: Kind::Scale,
        amount: 1.0,
    };
    scale.apply(&mut scene, 1).unwrap();
    let scene = Prepared::new(scene, false).unwrap();
    for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
        let parameters = with_sgm(preset.parameters(), |sgm| sgm.line_offset_max_lines = 2);
        let equal = bad_percent(preset.parameters(), &as_it_is);
        let [first, third] = [1, 3].map(|frame| {
            let matched = scene.matched_as_frame(frame, parameters, Output::Dense, 2);
            let bad = scene.measure(&matched.unwrap(), 1.0, false).unwrap();
            bad.average().unwrap()
        });
        let what = format!("{preset}: {first:.2}, then {third:.2}; {equal:.2}");
        println!("{what}");
        assert!(
            third <= 1.5 * equal && third < first - 0.1 * equal,
            "{what}"
        );
    }
}

/// Lines that one camera alone sees brighter or darker are mended before they are matched.
#[test]
fn bands_of_light_and_noise_of_rows_cost_little() {
    let undisturbed = lowered(0.0);
    let presets = [Preset::Lite, Preset::Micro, Preset::Balanced];
    let equal = presets.map(|preset| bad_percent(preset.parameters(), &undisturbed));
    for (kind, amount) in [
        (Kind::Bands, 10.0),
        (Kind::Bands, 20.0),
        (Kind::RowNoise, 3.0),
        (Kind::RowNoise, 8.0),
    ] {
        let mut scene = undisturbed.clone();
        Stress { kind, amount }.apply(&mut scene, 1).unwrap();
        for (preset, equal) in presets.into_iter().zip(equal) {
            let mending = preset.parameters();
            let unmended = with_sgm(mending, |sgm| sgm.line_gain_max_q8 = 0);
            let most = 1.5 * equal;
            let (bad, bad_unmended) = (bad_percent(mending, &scene), bad_percent(unmended, &scene));
            let what = format!("{preset}, {kind:?} {amount}: {bad:.2} of {bad_unmended:.2} %");
            println!("{what}");
            assert!(bad <= most && bad_unmended > bad, "{what}");
        }
    }
}

/// Under strong noise of both sensors, what noise makes of single pixels counts less.
#[test]
fn strong_noise_costs_less_where_it_is_reckoned_with() {
    let mut scene = lowered(0.0);
    let noise = Stress {
        kind: Kind::Noise,
        amount: 25.0,
    };
    noise.apply(&mut scene, 1).unwrap();
    for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
        let adapting = preset.parameters();
        let stubborn = with_sgm(adapting, |sgm| sgm.usual_difference_max = u8::MAX);
        let (bad, bad_stubborn) = (bad_percent(adapting, &scene), bad_percent(stubborn, &scene));
        let what = format!("{preset}: {bad:.2} of {bad_stubborn:.2} %");
        println!("{what}");
        assert!(bad < 0.9 * bad_stubborn, "{what}");
    }
}
