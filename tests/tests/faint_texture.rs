//! What smoothing is for: surfaces whose texture is faint beside the noise.

use vgstereo_core::config::{Config, Method, Parameters};
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::preset::Preset;
use vgstereo_sim::exposure::Exposure;
use vgstereo_sim::frame::match_frame;
use vgstereo_sim::kernels::HostKernels;
use vgstereo_sim::metrics::BadPixels;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::views::Views;

/// Average of the bad pixels on the built-in scene as the preset is and without smoothing,
/// percent, mean of six seeds.
fn bad(preset: Preset, texture: f32) -> [f64; 2] {
    let scene = render(&RenderOptions {
        texture,
        exposure: Exposure::EQUAL,
        ..RenderOptions::default()
    });
    let truth = scene.truth.as_ref().unwrap();
    let views = Views::new(&scene.left, &scene.right, false).unwrap();
    let smoothed = preset.parameters();
    let Method::Aggregation(mut aggregation) = smoothed.method else {
        panic!("{preset} aggregates");
    };
    aggregation.smoothing_step = 0;
    let as_they_came = Parameters {
        method: Method::Aggregation(aggregation),
        ..smoothed
    };
    [smoothed, as_they_came].map(|parameters| {
        let bad = (1..=6).map(|seed| {
            let disparities = DisparityRange::up_to(scene.d_max);
            let config = Config {
                format: views.format,
                ..Config::new(parameters.with_seed(seed), views.width, disparities)
            };
            let matched = match_frame(&config, &views, HostKernels::fastest(), 1).unwrap();
            let bad = BadPixels::measure(&matched.disparities_q4, truth, 1.0, false);
            bad.average().unwrap()
        });
        bad.sum::<f64>() / 6.0
    })
}

#[test]
fn faint_texture_is_matched_better_smoothed() {
    for preset in [Preset::Lite, Preset::Micro] {
        let [smoothed, as_it_came] = bad(preset, 0.05);
        println!("{preset}: {smoothed:.2} % for {as_it_came:.2} %");
        assert!(smoothed < as_it_came - 1.0, "{preset}");
    }
}

#[test]
fn clear_texture_loses_nothing() {
    for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
        let [smoothed, as_it_came] = bad(preset, 1.0);
        println!("{preset}: {smoothed:.2} % for {as_it_came:.2} %");
        assert!(smoothed < as_it_came + 0.1, "{preset}");
    }
}
