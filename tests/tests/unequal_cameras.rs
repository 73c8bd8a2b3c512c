//! Unequal cameras on the built-in scene: what exposure and alignment learned on the way must
//! make up for.

use vgstereo_core::config::{Config, Method, Parameters};
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::preset::Preset;
use vgstereo_sim::exposure::Exposure;
use vgstereo_sim::frame::match_frame;
use vgstereo_sim::kernels::HostKernels;
use vgstereo_sim::metrics::BadPixels;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::scene::Scene;
use vgstereo_sim::views::Views;

/// Average of the bad pixels over the masks, percent.
fn bad(parameters: Parameters, scene: &Scene) -> f64 {
    let views = Views::new(&scene.left, &scene.right, false).unwrap();
    let config = Config {
        format: views.format,
        ..Config::new(parameters, views.width, DisparityRange::up_to(scene.d_max))
    };
    let matched = match_frame(&config, &views, HostKernels::fastest(), 1).unwrap();
    let truth = scene.truth.as_ref().unwrap();
    let bad = BadPixels::measure(&matched.disparities_q4, truth, 1.0, false);
    bad.average().unwrap()
}

fn exposed(exposure: Exposure) -> Scene {
    render(&RenderOptions {
        exposure,
        ..RenderOptions::default()
    })
}

fn lowered(line_offset_px: f32) -> Scene {
    render(&RenderOptions {
        line_offset_px,
        ..RenderOptions::default()
    })
}

#[test]
fn what_neither_clips_nor_drowns_in_noise_costs_little() {
    let exposures = [
        ("brighter", 1.25, 0.0, 0.0, 0.0),
        ("lower black level", 1.0, 0.0, -30.0, 0.0),
        ("higher black level", 1.0, 0.0, 30.0, 0.0),
        ("rising black level", 1.0, 0.0, 0.0, 60.0),
        ("falling black level", 1.0, 0.0, 0.0, -60.0),
        ("falling gain", 1.0, -0.8, 0.0, 0.0),
        ("falling gain that clips at first", 1.1, -1.0, 0.0, 0.0),
    ];
    // How far a blank wall is filled from either side hangs on the synapses drawn.
    let mean = |preset: Preset, scene: &Scene| {
        let seeds = 1..=6;
        let bad = seeds.map(|seed| bad(preset.parameters().with_seed(seed), scene));
        bad.sum::<f64>() / 6.0
    };
    let presets = [Preset::Lite, Preset::Micro, Preset::Balanced];
    let equal = exposed(Exposure::EQUAL);
    let equal = presets.map(|preset| mean(preset, &equal));
    for (name, gain, gain_gradient, offset, offset_gradient) in exposures {
        let scene = exposed(Exposure {
            gain,
            gain_gradient,
            offset,
            offset_gradient,
        });
        for (preset, equal) in presets.into_iter().zip(equal) {
            let cost = mean(preset, &scene) - equal;
            // What clips is lost: the blank wall is where the gain is largest.
            let most = if name.contains("clips") { 1.7 } else { 0.65 };
            assert!(cost <= most, "{preset}, {name}: {cost:+.2}");
        }
    }
}

/// The scene begins with a blank wall: what its first lines are taken for is carried far down.
#[test]
fn a_darker_camera_does_not_upset_a_blank_wall() {
    let darker = exposed(Exposure {
        gain: 0.6,
        ..Exposure::EQUAL
    });
    let balanced = Preset::Balanced.parameters();
    let cost = bad(balanced, &darker) - bad(balanced, &exposed(Exposure::EQUAL));
    assert!(cost <= 2.0, "{cost:+.2}");
}

/// Most of what an offset of the lines costs is made up for.
#[test]
fn lines_that_lie_too_low_or_too_high_cost_little() {
    let aligned = lowered(0.0);
    for line_offset_px in [-0.9, 0.9] {
        let scene = lowered(line_offset_px);
        for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
            let moved = preset.parameters();
            let mut unmoved = moved;
            if let Method::Aggregation(aggregation) = &mut unmoved.method {
                aggregation.line_offset_max_q4 = 0;
            }
            let aligned = bad(moved, &aligned);
            let cost = bad(moved, &scene) - aligned;
            let cost_unmoved = bad(unmoved, &scene) - aligned;
            let what = format!("{preset}, {line_offset_px} px: {cost:+.2} of {cost_unmoved:+.2}");
            assert!(cost <= 2.5 && cost_unmoved >= 4.0 * cost.max(1.0), "{what}");
        }
    }
}
