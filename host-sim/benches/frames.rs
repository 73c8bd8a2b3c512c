//! Whole frames of the built-in scene at the size of Middlebury's Teddy, per preset.
//!
//! `cargo bench --bench frames`

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use vgstereo_core::{Config, DisparityRange, Preset};
use vgstereo_frame::match_frame;
use vgstereo_kernels::NativeKernels;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::views::views_of;

const WIDTH: u16 = 450;
const HEIGHT: u16 = 375;
const D_MAX: u16 = 59;

fn frames(criterion: &mut Criterion) {
    let scene = render(&RenderOptions {
        width: WIDTH.into(),
        height: HEIGHT.into(),
        d_max: D_MAX,
        ..RenderOptions::default()
    });
    let views =
        views_of(scene.left.clone(), scene.right.clone(), false).expect("the scene is narrow");
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(20);
    // One element is one pixel at one disparity.
    group.throughput(Throughput::Elements(
        u64::from(WIDTH) * u64::from(HEIGHT) * (u64::from(D_MAX) + 1),
    ));
    for preset in Preset::ALL {
        let config = Config {
            colour: views.has_colour(),
            ..Config::new(preset.parameters(), WIDTH, DisparityRange::up_to(D_MAX))
        };
        let runs = NativeKernels::available()
            .map(|kernels| (kernels, 1))
            .chain([(NativeKernels::fastest(), 2)]);
        for (kernels, threads) in runs {
            let name = format!("{}/{threads} threads", kernels.name());
            group.bench_function(BenchmarkId::new(preset.name(), name), |bencher| {
                bencher.iter(|| match_frame(&config, &views, kernels, threads).unwrap());
            });
        }
    }
}

criterion_group!(benches, frames);
criterion_main!(benches);
