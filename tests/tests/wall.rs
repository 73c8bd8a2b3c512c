//! `vgstereo wall` on rendered walls, against figures that are computed here from what the renderer knows.

use vgstereo_core::kernel::SubpixelStep;
use vgstereo_core::{Config, DisparityRange, INVALID, Output, Parameters, Preset};
use vgstereo_frame::{Views, match_frame};
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::render::{
    RenderOptions, RenderedCameras, rectified_camera, render_wall, rendered_cameras,
};
use vgstereo_sim::views::views_of;
use vgstereo_sim::wall::{Figures, Part, measure};
use vgstereo_tests::with_sgm;

const WIDTH: usize = 240;
const HEIGHT: usize = 180;
const FRAMES: u32 = 3;

fn options() -> RenderOptions {
    RenderOptions {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        d_max: 39,
        noise: 3.0,
        ..RenderOptions::default()
    }
}

/// The disparities of some pairs of a wall, 1/16 px.
fn frames(distance_mm: f64, turned_degrees: [f64; 2]) -> Vec<Vec<i16>> {
    let frame = |number| {
        let views = views(distance_mm, turned_degrees, number);
        matched(&views, Preset::Micro.parameters())
    };
    (0..FRAMES).map(frame).collect()
}

fn views(distance_mm: f64, turned_degrees: [f64; 2], frame: u32) -> Views {
    let [left, right] = render_wall(&options(), distance_mm, turned_degrees, frame);
    views_of(left, right, false).unwrap()
}

/// The disparities of a pair, 1/16 px.
fn matched(views: &Views, parameters: Parameters) -> Vec<i16> {
    let config = Config {
        colour: views.has_colour(),
        output: Output::Sparse,
        ..Config::new(parameters, WIDTH as u16, DisparityRange::up_to(39))
    };
    let matched = match_frame(&config, views, NativeKernels::fastest(), 1);
    matched.unwrap().disparities_q4
}

/// What is known of a wall: the unit normal, away from the camera, and the distance, mm.
struct Truth {
    normal: [f64; 3],
    distance_mm: f64,
}

impl Truth {
    fn new(distance_mm: f64, [about_columns, about_lines]: [f64; 2]) -> Self {
        let (c, l) = (about_columns.to_radians(), about_lines.to_radians());
        Self {
            normal: [c.sin() * l.cos(), l.sin(), c.cos() * l.cos()],
            distance_mm,
        }
    }

    /// The true depth of a pixel, mm.
    fn depth_mm(&self, cameras: &RenderedCameras, x: usize, y: usize) -> f64 {
        let [ray_x, ray_y] = [(x, 0), (y, 1)]
            .map(|(at, axis)| (at as f64 - cameras.principal_px[axis]) / cameras.focal_px);
        self.distance_mm / (self.normal[0] * ray_x + self.normal[1] * ray_y + self.normal[2])
    }
}

/// Within 5 %, or so little that a sixteenth of a pixel is more.
fn is_close(measured: f64, known: f64, least: f64) -> bool {
    (measured - known).abs() <= (0.05 * known.abs()).max(least)
}

#[test]
fn figures_are_those_that_the_renderer_knows() {
    let cameras = rendered_cameras(&options());
    let numerator = cameras.focal_px * cameras.baseline_mm;
    let part = Part::middle([WIDTH, HEIGHT], 0.5);
    for (distance_mm, turned) in [
        (1400.0, [0.0, 0.0]),
        (1900.0, [12.0, -7.0]),
        (2700.0, [-20.0, 5.0]),
    ] {
        let truth = Truth::new(distance_mm, turned);
        let frames = frames(distance_mm, turned);
        let camera = rectified_camera(&cameras).unwrap();
        let Figures {
            fill_percent,
            plane,
            z_accuracy_mm,
            temporal_noise_mm,
            ..
        } = measure(&frames, WIDTH, part, &camera, Some(distance_mm)).unwrap();

        // The errors of each frame, against the true wall: their mean is the accuracy, and what is left is the
        // noise.
        let mut errors = vec![];
        let mut deviations_mm = vec![];
        let mut missing = 0;
        for y in part.corner[1]..part.corner[1] + part.size[1] {
            for x in part.corner[0]..part.corner[0] + part.size[0] {
                let true_mm = truth.depth_mm(&cameras, x, y);
                let mut depths_mm = vec![];
                for frame in &frames {
                    let q4 = frame[y * WIDTH + x];
                    if q4 == INVALID {
                        missing += 1;
                        continue;
                    }
                    let px = f64::from(q4) / 16.0;
                    depths_mm.push(numerator / px);
                    // Along the normal, a depth counts by the share of the true one.
                    let along_mm = distance_mm * (numerator / px) / true_mm;
                    errors.push((along_mm - distance_mm, px - numerator / true_mm));
                }
                let mean = depths_mm.iter().sum::<f64>() / depths_mm.len() as f64;
                let squares: f64 = depths_mm.iter().map(|mm| (mm - mean).powi(2)).sum();
                deviations_mm.push((squares / (depths_mm.len() as f64 - 1.0)).sqrt());
            }
        }
        let count = errors.len() as f64;
        let pixels = (part.size[0] * part.size[1]) as f64 * f64::from(FRAMES);
        assert!(is_close(
            fill_percent,
            100.0 - 100.0 * f64::from(missing) / pixels,
            1e-6
        ));

        let mut along_mm: Vec<f64> = errors.iter().map(|error| error.0).collect();
        along_mm.sort_by(f64::total_cmp);
        let accuracy_mm = along_mm[along_mm.len() / 2];
        let sixteenth_mm = distance_mm * distance_mm / numerator / 16.0;
        let told = z_accuracy_mm.unwrap();
        assert!(
            is_close(told, accuracy_mm, sixteenth_mm),
            "{told} for {accuracy_mm}"
        );

        // A fitted plane takes up a little of the noise.
        let rms = |value: fn(&(f64, f64)) -> f64| {
            let mean = errors.iter().map(value).sum::<f64>() / count;
            let squares: f64 = errors
                .iter()
                .map(|error| (value(error) - mean).powi(2))
                .sum();
            (squares / count).sqrt()
        };
        let (rms_mm, rms_px) = (rms(|error| error.0), rms(|error| error.1));
        println!("{distance_mm} mm: {plane:?}, {rms_mm} mm, {rms_px} px, {told} for {accuracy_mm}");
        assert!(plane.rms_mm <= 1.05 * rms_mm && plane.subpixel_rms_px <= 1.05 * rms_px);
        assert!(is_close(
            plane.distance_mm,
            distance_mm + accuracy_mm,
            sixteenth_mm
        ));
        let tilt = truth.normal[2].acos().to_degrees();
        assert!(
            (plane.tilt_degrees - tilt).abs() < 0.6,
            "{} for {tilt}",
            plane.tilt_degrees
        );

        deviations_mm.retain(|mm| mm.is_finite());
        deviations_mm.sort_by(f64::total_cmp);
        let noise_mm = deviations_mm[deviations_mm.len() / 2];
        assert!(is_close(temporal_noise_mm.unwrap(), noise_mm, 1e-9));
    }
}

/// How far disparities are from true: the standard deviation of those that are off by less than a
/// pixel, px, and how many times more often than the true ones they are whole pixels.
#[derive(Debug, Default)]
struct Spread {
    squares: f64,
    found: f64,
    whole: f64,
    truly_whole: f64,
}

impl Spread {
    fn add(&mut self, disparities_q4: &[i16], true_px: impl Fn(usize, usize) -> f64) {
        for y in 20..HEIGHT - 20 {
            for x in 50..WIDTH - 20 {
                let q4 = f64::from(disparities_q4[y * WIDTH + x]);
                let true_px = true_px(x, y);
                let error = q4 / 16.0 - true_px;
                if error.abs() < 1.0 {
                    self.squares += error * error;
                    self.found += 1.0;
                    self.whole += f64::from(u8::from(q4 % 16.0 == 0.0));
                    self.truly_whole += f64::from(u8::from((true_px * 16.0).round() % 16.0 == 0.0));
                }
            }
        }
    }

    fn rms_px(&self) -> f64 {
        (self.squares / self.found).sqrt()
    }

    fn excess(&self) -> f64 {
        self.whole / self.truly_whole
    }
}

/// On three planes, each at 20 distances, a parabola through the sums is drawn to whole pixels; the
/// finer step is hardly, and is nearer to the truth.
#[test]
fn the_finer_step_is_hardly_drawn_to_whole_pixels() {
    let cameras = rendered_cameras(&options());
    let numerator = cameras.focal_px * cameras.baseline_mm;
    let finer = SubpixelStep {
        relief: 50,
        lines_min: 110,
    };
    for turned in [[0.0, 0.0], [12.0, -7.0], [-20.0, 5.0]] {
        let mut spreads = [Spread::default(), Spread::default()];
        for frame in 0..20 {
            // Along the optical axis, 28 to 10 px.
            let axis_px = 28.0 - 0.93 * f64::from(frame);
            let [_, _, axis] = Truth::new(1.0, turned).normal;
            let truth = Truth::new(numerator / axis_px * axis, turned);
            let views = views(truth.distance_mm, turned, frame);
            for (subpixel, spread) in [SubpixelStep::PARABOLA, finer]
                .into_iter()
                .zip(&mut spreads)
            {
                let micro = Preset::Micro.parameters();
                let parameters = with_sgm(micro, |sgm| sgm.subpixel = subpixel);
                let disparities_q4 = matched(&views, parameters);
                spread.add(&disparities_q4, |x, y| {
                    numerator / truth.depth_mm(&cameras, x, y)
                });
            }
        }
        let [parabola, finer] = spreads;
        let [p, f] = [&parabola, &finer].map(|spread| (spread.rms_px(), spread.excess()));
        println!("{turned:?} degrees: parabola {p:?}, finer {f:?}");
        assert!(f.0 < 0.75 * p.0, "{f:?} for {p:?}");
        assert!(f.1 < 0.65 * p.1, "{f:?} for {p:?}");
    }
}
