//! Effect of smoothing: surfaces whose texture is faint compared with the noise are matched better.

use vgstereo_core::Preset;
use vgstereo_sim::exposure::Exposure;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_tests::{mean_bad_percent, with_sgm};

/// Percentage of bad pixels on the built-in scene with the preset's smoothing, and without.
fn smoothed_or_not(preset: Preset, texture: f32) -> [f64; 2] {
    let scene = render(&RenderOptions {
        texture,
        exposure: Exposure::EQUAL,
        ..RenderOptions::default()
    });
    let smoothed = preset.parameters();
    let as_they_came = with_sgm(smoothed, |sgm| sgm.smoothing_step = 0);
    [smoothed, as_they_came].map(|parameters| mean_bad_percent(parameters, &scene))
}

#[test]
fn faint_texture_is_matched_better_smoothed() {
    for preset in [Preset::Lite, Preset::Micro] {
        let [smoothed, as_it_came] = smoothed_or_not(preset, 0.05);
        println!("{preset}: {smoothed:.2} % for {as_it_came:.2} %");
        assert!(smoothed < as_it_came - 1.0, "{preset}");
    }
}

#[test]
fn clear_texture_loses_nothing() {
    for preset in [Preset::Lite, Preset::Micro, Preset::Balanced] {
        let [smoothed, as_it_came] = smoothed_or_not(preset, 1.0);
        println!("{preset}: {smoothed:.2} % for {as_it_came:.2} %");
        assert!(smoothed < as_it_came + 0.1, "{preset}");
    }
}
