use super::*;
use crate::calibration::{Maps, RectifiedPair};
use crate::rectify::rectified;
use crate::scene::Mask;
use crate::views::{picture_of, views_of};
use vgstereo_core::geometry::{Interpolation, Rectification};
use vgstereo_frame::Views;

/// Small, and free of noise so that colours can be compared.
const CLEAN: RenderOptions = RenderOptions {
    width: 240,
    height: 180,
    d_max: 31,
    seed: 7,
    texture: 1.0,
    noise: 0.0,
    exposure: Exposure::EQUAL,
    line_offset_px: 0.0,
};

struct Parts {
    left_px: Vec<f32>,
    right_px: Vec<f32>,
    nonocc: Mask,
    all: Mask,
    disc: Mask,
}

fn parts(scene: &Scene) -> Parts {
    let truth = scene.truth.clone().unwrap();
    Parts {
        left_px: truth.left_px,
        right_px: truth.right_px.unwrap(),
        nonocc: truth.nonocc.unwrap(),
        all: truth.all.unwrap(),
        disc: truth.disc.unwrap(),
    }
}

/// Everything rendered, as bits: NaN equals NaN.
#[derive(PartialEq)]
struct Bits {
    left: Vec<u8>,
    right: Vec<u8>,
    left_px: Vec<u32>,
    right_px: Vec<u32>,
    masks: [Mask; 3],
}

fn bits(scene: &Scene) -> Bits {
    let parts = parts(scene);
    let bits = |map: Vec<f32>| map.into_iter().map(f32::to_bits).collect();
    Bits {
        left: scene.left.as_raw().clone(),
        right: scene.right.as_raw().clone(),
        left_px: bits(parts.left_px),
        right_px: bits(parts.right_px),
        masks: [parts.nonocc, parts.all, parts.disc],
    }
}

fn mean(image: &RgbImage, lines: core::ops::Range<u32>) -> f64 {
    let bytes = image.width() as usize * 3;
    let raw = &image.as_raw()[lines.start as usize * bytes..lines.end as usize * bytes];
    raw.iter().map(|&grey| f64::from(grey)).sum::<f64>() / raw.len() as f64
}

#[test]
fn same_options_same_bits_on_any_number_of_threads() {
    let options = RenderOptions {
        noise: 2.0,
        ..CLEAN
    };
    let expected = bits(&render(&options));
    assert!(bits(&render(&options)) == expected);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert!(bits(&pool.install(|| render(&options))) == expected);
    }
    let other = render(&RenderOptions { seed: 8, ..options });
    assert!(bits(&other).left != expected.left);
}

/// Fails where a platform or a change of the renderer moves a bit. The sums come from
/// this renderer on x86-64 Linux.
#[test]
fn bits_are_those_recorded() {
    let scene = render(&RenderOptions {
        noise: 2.0,
        ..RenderOptions::default()
    });
    let Bits {
        left,
        right,
        left_px,
        right_px,
        ..
    } = bits(&scene);
    // FNV-1a, 32 bits.
    let sum = |bytes: &mut dyn Iterator<Item = u8>| {
        bytes.fold(0x811C_9DC5_u32, |sum, byte| {
            (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
        })
    };
    let sums = [
        sum(&mut left.into_iter()),
        sum(&mut right.into_iter()),
        sum(&mut left_px.into_iter().flat_map(u32::to_le_bytes)),
        sum(&mut right_px.into_iter().flat_map(u32::to_le_bytes)),
    ];
    assert_eq!(
        sums,
        [0xEE83_4EB5, 0xE03E_4D0A, 0xDA55_1550, 0x7428_2DB1],
        "{sums:#010X?}"
    );
}

#[test]
fn disparities_fill_the_range() {
    for seed in 0..6 {
        for (width, height, d_max) in [(160, 120, 31), (240, 180, 47), (120, 200, 20)] {
            let scene = render(&RenderOptions {
                width,
                height,
                d_max,
                seed,
                ..CLEAN
            });
            let Parts {
                left_px, right_px, ..
            } = parts(&scene);
            let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
            for &d in left_px.iter().chain(&right_px) {
                assert!(d.is_finite(), "seed {seed}");
                low = low.min(d);
                high = high.max(d);
            }
            let limit = f32::from(d_max);
            assert!(low >= 1.0 && high <= limit, "seed {seed}: {low}..{high}");
            assert!(low < 0.25 * limit && high > 0.85 * limit, "{low}..{high}");
        }
    }
}

#[test]
fn masks_are_nested_and_not_trivial() {
    let scene = render(&CLEAN);
    let Parts {
        left_px,
        nonocc,
        all,
        disc,
        ..
    } = parts(&scene);
    for (index, d) in left_px.iter().enumerate() {
        assert!(nonocc[index] || !disc[index]);
        assert!(all[index] || !nonocc[index]);
        assert_eq!(all[index], d.is_finite());
        // Points left of the right image are not visible in it.
        let x = index % 240;
        assert!(x as f32 >= *d - 1e-3 || !nonocc[index]);
    }
    assert!(disc.count() > all.count() / 20);
    assert!(nonocc.count() > disc.count() * 2);
    // Occluded inside the image, beyond the columns the right view lacks.
    let hidden = (0..left_px.len())
        .filter(|&index| !nonocc[index] && index % 240 > 31)
        .count();
    assert!(hidden > all.count() / 100, "{hidden}");
}

#[test]
fn views_agree_on_visible_points() {
    let scene = render(&CLEAN);
    let Parts {
        left_px,
        right_px,
        nonocc,
        disc,
        ..
    } = parts(&scene);
    let (mut checked, mut agreed, mut smooth, mut smooth_agreed) = (0, 0, 0, 0);
    for (index, &d) in left_px.iter().enumerate().filter(|&(i, _)| nonocc[i]) {
        let x_right = (index % 240) as f32 - d;
        let base = index - index % 240 + x_right as usize;
        let next = if x_right.fract() > 0.0 {
            base + 1
        } else {
            base
        };
        let share = x_right.fract();
        let seen = right_px[base] * (1.0 - share) + right_px[next] * share;
        let agrees = (seen - d).abs() < 0.05;
        checked += 1;
        agreed += usize::from(agrees);
        if !disc[index] {
            smooth += 1;
            smooth_agreed += usize::from(agrees);
        }
    }
    // Next to an edge of the right view its neighbours lie on two surfaces. The far side
    // of an occluded stretch is such an edge, and no discontinuity of the left view.
    assert!(
        agreed * 100 > checked * 93,
        "{agreed} of {checked} visible pixels"
    );
    assert!(
        smooth_agreed * 100 > smooth * 98,
        "{smooth_agreed} of {smooth} pixels off discontinuities"
    );
}

#[test]
fn truth_warps_the_right_view_to_the_left() {
    let scene = render(&CLEAN);
    let Parts {
        left_px, nonocc, ..
    } = parts(&scene);
    let error = |shift: f32| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (index, &d) in left_px.iter().enumerate().filter(|&(i, _)| nonocc[i]) {
            let (x, y) = (index % 240, (index / 240) as u32);
            let x_right = x as f32 - d - shift;
            if !(2.0..=236.0).contains(&x_right) {
                continue;
            }
            let share = x_right.fract();
            let base = x_right as u32;
            for channel in 0..3 {
                let at = |x: u32| f32::from(scene.right.get_pixel(x, y).0[channel]);
                let warped = at(base) * (1.0 - share) + at(base + 1) * share;
                let left = scene.left.get_pixel(x as u32, y).0[channel];
                sum += (warped - f32::from(left)).abs();
                count += 1.0;
            }
        }
        sum / count
    };
    let (exact, nearer, farther) = (error(0.0), error(2.0), error(-2.0));
    assert!(exact < 8.0, "{exact}");
    assert!(nearer > exact * 2.0, "{nearer} against {exact}");
    assert!(farther > exact * 2.0, "{farther} against {exact}");
}

#[test]
fn exposure_changes_the_right_view_alone() {
    let clean = render(&CLEAN);
    let exposed = render(&RenderOptions {
        exposure: Exposure {
            gain: 0.8,
            offset: 10.0,
            ..Exposure::EQUAL
        },
        ..CLEAN
    });
    assert_eq!(exposed.left, clean.left);
    for (&after, &before) in exposed.right.as_raw().iter().zip(clean.right.as_raw()) {
        let expected = f32::from(before) * 0.8 + 10.0;
        assert!((f32::from(after) - expected).abs() <= 1.0);
    }
    let graded = render(&RenderOptions {
        exposure: Exposure {
            gain_gradient: 0.4,
            ..Exposure::EQUAL
        },
        ..CLEAN
    });
    assert_eq!(graded.left, clean.left);
    let ratio = |lines: core::ops::Range<u32>| {
        mean(&graded.right, lines.clone()) / mean(&clean.right, lines)
    };
    assert!((ratio(0..4) - 0.8).abs() < 0.02, "{}", ratio(0..4));
    assert!((ratio(88..92) - 1.0).abs() < 0.02, "{}", ratio(88..92));
    assert!(ratio(176..180) > 1.1, "{}", ratio(176..180));
}

#[test]
fn light_that_was_kept_gives_what_is_rendered() {
    let options = RenderOptions {
        width: 95,
        height: 61,
        noise: 1.5,
        line_offset_px: 0.7,
        ..CLEAN
    };
    let exposures = Exposures::new(&options);
    let exposure = Exposure {
        gain: 0.8,
        gain_gradient: 0.3,
        offset: 5.0,
        offset_gradient: -9.0,
    };
    for exposure in [Exposure::EQUAL, exposure] {
        let rendered = render(&RenderOptions {
            exposure,
            ..options
        });
        assert!(bits(&exposures.scene(exposure)) == bits(&rendered));
    }
}

#[test]
fn without_texture_edges_and_shadows_are_left() {
    let steps = |texture: f32| -> Vec<u8> {
        let scene = render(&RenderOptions { texture, ..CLEAN });
        let grey = image::DynamicImage::from(scene.left).into_luma8();
        let lines = grey
            .rows()
            .map(|line| line.map(|p| p.0[0]).collect::<Vec<u8>>());
        let lines = lines.flat_map(|line| {
            line.windows(2)
                .map(|w| w[0].abs_diff(w[1]))
                .collect::<Vec<_>>()
        });
        let mut steps: Vec<u8> = lines.collect();
        steps.sort_unstable();
        steps
    };
    let [whole, half, bare] = [1.0, 0.5, 0.0].map(steps);
    let median = |steps: &[u8]| steps[steps.len() / 2];
    assert!(median(&whole) >= 4, "{}", median(&whole));
    let halved = median(&whole).div_ceil(2);
    assert!(median(&half).abs_diff(halved) <= 1, "{}", median(&half));
    assert_eq!(median(&bare), 0);
    assert!(*bare.last().unwrap() > 50);
}

#[test]
fn noise_has_its_deviation_and_differs_between_views() {
    let clean = render(&CLEAN);
    let noisy = render(&RenderOptions {
        noise: 4.0,
        ..CLEAN
    });
    let residuals = |noisy: &RgbImage, clean: &RgbImage| -> Vec<f64> {
        noisy
            .as_raw()
            .iter()
            .zip(clean.as_raw())
            // Grey levels near the ends saturate.
            .map(|(&after, &before)| {
                if (30..225).contains(&before) {
                    f64::from(after) - f64::from(before)
                } else {
                    0.0
                }
            })
            .collect()
    };
    let left = residuals(&noisy.left, &clean.left);
    let right = residuals(&noisy.right, &clean.right);
    for view in [&left, &right] {
        let used: Vec<f64> = view.iter().copied().filter(|&r| r != 0.0).collect();
        let square = used.iter().map(|r| r * r).sum::<f64>() / used.len() as f64;
        // Without the zeros, which a deviation of 4 rounds to in a tenth of the cases.
        assert!((square.sqrt() - 4.2).abs() < 0.2, "{}", square.sqrt());
    }
    let product: f64 = left.iter().zip(&right).map(|(a, b)| a * b).sum();
    let covariance = product / left.len() as f64;
    assert!(covariance.abs() < 0.3, "{covariance}");
}

#[test]
fn odd_and_extreme_options_render() {
    let odd = render(&RenderOptions {
        width: 161,
        height: 123,
        ..CLEAN
    });
    assert_eq!(odd.left.dimensions(), (161, 123));
    assert_eq!(odd.right.dimensions(), (161, 123));
    assert_eq!(parts(&odd).left_px.len(), 161 * 123);
    let nothing = render(&RenderOptions {
        width: 0,
        height: 0,
        d_max: 0,
        noise: f32::NAN,
        exposure: Exposure {
            gain: f32::INFINITY,
            gain_gradient: f32::NAN,
            offset: f32::NEG_INFINITY,
            offset_gradient: f32::NAN,
        },
        ..CLEAN
    });
    assert_eq!(nothing.left.dimensions(), (SIDE_MIN_PX, SIDE_MIN_PX));
    assert_eq!(nothing.d_max, 1);
    let much = render(&RenderOptions {
        width: 33,
        height: 200,
        d_max: u16::MAX,
        noise: f32::MAX,
        exposure: Exposure {
            gain: f32::MAX,
            offset: f32::MIN,
            ..Exposure::EQUAL
        },
        ..CLEAN
    });
    assert_eq!(much.d_max, 16);
}

/// What the core makes of the raw views is what rectified cameras see: the truth holds for it.
#[test]
fn distorted_views_are_rectified_to_the_plain_ones() {
    let plain = render(&CLEAN);
    let (raw, calibration) = render_distorted(&CLEAN).unwrap();
    let truth = parts(&raw);
    assert_eq!(truth.left_px, parts(&plain).left_px);
    assert!(truth.nonocc == parts(&plain).nonocc);
    let pair = RectifiedPair::from_stored(&calibration, [240, 180]);
    let pair = pair.unwrap().unwrap();
    let maps = Maps::new(&pair, calibration.unit_mm, Interpolation::Cubic).unwrap();
    let rectification = Rectification::from_bytes(&maps.bytes).unwrap();
    // The cameras of the scene, to rounding.
    let cameras = rendered_cameras(&CLEAN);
    assert!((f64::from(rectification.focal_q8) / 256.0 - cameras.focal_px).abs() < 0.01);
    assert_eq!(
        rectification.depth,
        rectified_camera(&cameras).map(|c| c.depth())
    );
    let difference = |a: &Views, b: &Views, view: usize| {
        let (a, b) = (picture_of(a, view).unwrap(), picture_of(b, view).unwrap());
        let sum: u64 = a
            .iter()
            .zip(b.iter())
            .map(|(&a, &b)| u64::from(a.abs_diff(b)))
            .sum();
        sum as f64 / a.len() as f64
    };
    let views = |scene: Scene| views_of(scene.left, scene.right, false).unwrap();
    let (plain, raw) = (views(plain), views(raw));
    let made = rectified(&raw, &rectification).unwrap();
    for view in 0..2 {
        let (before, after) = (
            difference(&raw, &plain, view),
            difference(&made, &plain, view),
        );
        // Interpolation softens the texture; the scene stays where it is.
        assert!(
            before > 25.0 && after < 6.0,
            "view {view}: {before} to {after}"
        );
        // Nearly all of it was seen.
        let seen: usize = made.valid_columns[view]
            .iter()
            .map(ExactSizeIterator::len)
            .sum();
        assert!(seen > 240 * 180 * 97 / 100, "view {view}: {seen}");
    }
}

/// What is lighter than in the scene without the board is the white of the board: its shadow is darker.
#[test]
fn boards_are_whole_in_both_pictures_and_go_about_in_them() {
    let options = RenderOptions {
        width: 160,
        height: 120,
        d_max: 16,
        noise: 0.0,
        ..RenderOptions::default()
    };
    let (empty, calibration) = render_distorted(&options).unwrap();
    let pictures = BoardPictures::new(&options).unwrap();
    assert_eq!(pictures.calibration.cameras, calibration.cameras);
    let mut middles = Vec::new();
    for pose in 0..18 {
        let views = pictures.render(pose).unwrap();
        for (view, empty) in views.iter().zip([&empty.left, &empty.right]) {
            let white: Vec<[u32; 2]> = view
                .enumerate_pixels()
                .filter(|&(x, y, pixel)| {
                    let lighter = |channel: usize| {
                        pixel[channel] > empty.get_pixel(x, y)[channel].saturating_add(30)
                    };
                    (0..3).all(lighter)
                })
                .map(|(x, y, _)| [x, y])
                .collect();
            assert!(white.len() > 30, "pose {pose}: {} px", white.len());
            let mean =
                |axis: usize| white.iter().map(|at| at[axis]).sum::<u32>() / white.len() as u32;
            middles.push([mean(0), mean(1)]);
            let inside = |&[x, y]: &[u32; 2]| (2..158).contains(&x) && (2..118).contains(&y);
            assert!(white.iter().all(inside), "pose {pose}");
        }
    }
    for (axis, least) in [(0, 40), (1, 20)] {
        let places = middles.iter().map(|middle| middle[axis]);
        let span = places.clone().max().unwrap() - places.min().unwrap();
        assert!(span >= least, "axis {axis}: {span} px");
    }
}
