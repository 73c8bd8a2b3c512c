//! The laser scan of the built-in scene against the renderer's own ranges.

use vgstereo_core::geometry::{LaserScan, ScanConfig};
use vgstereo_core::{Config, DisparityLine, DisparityRange};
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::arguments::aggregating_unless_named;
use vgstereo_sim::render::{
    RenderOptions, rectified_camera, render, rendered_cameras, surface_points,
};
use vgstereo_sim::views::views_of;

/// The range at each bearing of the scan, mm, from the points that the renderer's rays meet: of the
/// nearest in each line, the `lines_min`-th smallest; infinity where there are fewer.
fn true_ranges_mm(
    options: &RenderOptions,
    config: &ScanConfig,
    first_rad: f64,
    step_rad: f64,
) -> Vec<f64> {
    let mut nearest = vec![Vec::new(); config.bearings.into()];
    for line in surface_points(options).chunks(options.width as usize) {
        let mut of_line = vec![f64::INFINITY; nearest.len()];
        for [right, up, forward] in line.iter().flatten() {
            let height_mm = up * 1000.0;
            let bearing_rad = (-right).atan2(*forward);
            let place = ((bearing_rad - first_rad) / step_rad).round();
            let (low, high) = (config.heights_mm.start(), config.heights_mm.end());
            if !(f64::from(*low)..=f64::from(*high)).contains(&height_mm) || place < 0.0 {
                continue;
            }
            if let Some(range_mm) = of_line.get_mut(place as usize) {
                *range_mm = range_mm.min(right.hypot(*forward) * 1000.0);
            }
        }
        for (nearest, range_mm) in nearest.iter_mut().zip(of_line) {
            nearest.push(range_mm);
        }
    }
    let of_bearing = |mut ranges: Vec<f64>| {
        ranges.sort_by(f64::total_cmp);
        ranges[usize::from(config.lines_min) - 1]
    };
    nearest.into_iter().map(of_bearing).collect()
}

/// The built-in scene, and its scan's configuration: 60 bearings, without the ground.
fn scene(width: u32, height: u32, d_max: u16) -> (RenderOptions, ScanConfig) {
    let options = RenderOptions {
        width,
        height,
        d_max,
        ..RenderOptions::default()
    };
    let cameras = rendered_cameras(&options);
    let config = ScanConfig {
        camera: rectified_camera(&cameras).unwrap(),
        columns: 0..u16::try_from(width).unwrap(),
        bearings: 60,
        pitch_rad: cameras.pitch_rad as f32,
        heights_mm: -500..=300,
        range_max_mm: 60_000,
        lines_min: 3,
        confidence_min: 1,
    };
    (options, config)
}

/// The errors of a scan, as parts of the renderer's ranges, smallest first, and the number of bearings
/// at which nothing was seen though something is there.
fn errors<'a>(
    options: &RenderOptions,
    config: &ScanConfig,
    lines: impl Iterator<Item = DisparityLine<'a>>,
) -> (Vec<f64>, usize) {
    let mut memory = vec![0; LaserScan::words(config.bearings, config.lines_min)];
    let mut scan = LaserScan::new(config, &mut memory).unwrap();
    lines.for_each(|line| scan.push(&line));
    let scan = scan.finish();
    let (first, step) = (
        scan.bearing_min_rad.into(),
        f64::from(scan.bearing_step_rad),
    );
    let truth = true_ranges_mm(options, config, first, step);
    let pairs = scan.ranges_mm.iter().zip(&truth);
    let missed = pairs
        .clone()
        .filter(|(found, known)| **found == 0 && known.is_finite());
    let missed = missed.count();
    let seen = pairs.filter(|(found, _)| **found > 0);
    let mut errors: Vec<f64> = seen
        .map(|(&found, &known)| (f64::from(found) / known - 1.0).abs())
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors, missed)
}

/// With the true disparities, rounded to 1/16 px, the scan is the renderer's.
#[test]
fn the_scan_of_true_disparities_is_within_two_percent_of_the_renderers_ranges() {
    for (width, height, d_max) in [(160, 120, 31), (320, 240, 47), (480, 360, 63)] {
        let (options, config) = scene(width, height, d_max);
        let truth = render(&options).truth.unwrap();
        let left_px = truth.left_px.iter();
        let disparities_q4: Vec<i16> = left_px.map(|px| (px * 16.0).round() as i16).collect();
        let confidences = vec![255; disparities_q4.len()];
        let columns = width as usize;
        let lines = disparities_q4
            .chunks(columns)
            .zip(confidences.chunks(columns));
        let lines = (0..).zip(lines);
        let lines = lines.map(|(line, (disparities_q4, confidences))| DisparityLine {
            line,
            column: 0,
            disparities_q4,
            confidences,
        });
        let (errors, missed) = errors(&options, &config, lines);
        // The outermost bearings look past the lines that are out of the band.
        assert!(
            errors.len() + 3 >= 60 && missed == 0,
            "{width}: {missed} missed"
        );
        let worst = errors.last().unwrap();
        assert!(*worst < 0.02, "{width}: an error of {worst}");
    }
}

/// With disparities that were found, most bearings are; thin leaves and twigs are missed, which the
/// renderer's rays meet.
#[test]
fn most_of_the_scan_of_found_disparities_is_within_two_percent() {
    let (options, config) = scene(320, 240, 47);
    let scene = render(&options);
    let views = views_of(scene.left, scene.right, false).unwrap();
    for preset in aggregating_unless_named(&[]) {
        let disparities = DisparityRange::up_to(scene.d_max);
        let matcher = Config {
            colour: true,
            ..Config::new(preset.parameters(), 320, disparities)
        };
        let matched = match_frame(&matcher, &views, NativeKernels::fastest(), 1).unwrap();
        let (errors, missed) = errors(&options, &config, matched.lines(320));
        let median = errors[errors.len() / 2];
        let share = errors.iter().filter(|&&error| error < 0.02).count() * 100 / 60;
        println!("{preset}: median {median:.4}, {share} % within 2 %, {missed} missed");
        assert!(
            median < 0.01 && share >= 70,
            "{preset}: {median}, {share} %"
        );
    }
}
