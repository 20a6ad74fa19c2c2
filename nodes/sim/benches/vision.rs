//! What a camera frame costs: rendering, coding and selecting, 640x480 px.

use std::f64::consts::TAU;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use feeder_model::tray::TrayGeometry;
use feeder_scenario::Scenario;
use feeder_scenario::plan::VisionSelectorConfig;
use feeder_sim::camera::{PartView, Renderer, TrayShot, codec};
use image::GrayImage;
use nalgebra::Isometry2;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Parts in five evenly filled rings over the angles from `from_rad` on.
fn parts(count: u32, from_rad: f64) -> Vec<PartView> {
    (0..count)
        .map(|index| {
            let (ring, place) = (index % 5, f64::from(index / 5) + 0.5);
            let psi_rad = from_rad + 0.1 + (TAU - 0.2 - from_rad) * place / f64::from(count.div_ceil(5));
            let radius_m = 0.040 + 0.010 * f64::from(ring);
            PartView {
                x_m: radius_m * psi_rad.cos(),
                y_m: radius_m * psi_rad.sin(),
                z_m: TrayGeometry::PAPER.height_m(psi_rad),
                yaw_rad: f64::from(index),
                pose: index as usize % 2,
                ..PartView::default()
            }
        })
        .collect()
}

fn vision(criterion: &mut Criterion) {
    let scenario = Scenario::default();
    let part = scenario.part_type().expect("the catalogue is sound");
    let mut renderer = Renderer::new(&scenario.scene(&part)).expect("the scene is sound");
    let place = scenario.delivery.feeding_place;
    let pose = Isometry2::new(place.xy(), place.z);
    let shot = TrayShot::still(pose);
    let mut noise = Pcg64Mcg::seed_from_u64(1);
    let mut image = GrayImage::default();
    for count in [0, 20, 100] {
        let parts = parts(count, 0.0);
        criterion.bench_function(&format!("render_{count}_parts"), |bencher| {
            bencher.iter(|| renderer.render(black_box(&shot), &parts, &mut noise, &mut image));
        });
    }
    renderer.render(&shot, &parts(100, 0.0), &mut noise, &mut image).expect("the parts are sound");
    criterion.bench_function("encode", |bencher| {
        bencher.iter(|| codec::encode(black_box(&image), codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX));
    });
    let bytes = codec::encode(&image, codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).expect("the frame is small");
    criterion.bench_function("decode", |bencher| {
        bencher.iter(|| feeder_vision::decode(black_box(&bytes)));
    });
    let plan = scenario.plan().expect("the built-in scenario can run");
    let (_, taught) = plan.of_kind::<VisionSelectorConfig>().next().expect("it has a selector");
    for count in [5, 20, 50] {
        let parts = parts(count, std::f64::consts::PI);
        renderer.render(&shot, &parts, &mut noise, &mut image).expect("the parts are sound");
        let mut selector = taught.selector().expect("the part was taught");
        criterion.bench_function(&format!("select_{count}_plateau_parts"), |bencher| {
            bencher.iter(|| selector.process(black_box(0.1), &image, &pose));
        });
    }
}

criterion_group!(benches, vision);
criterion_main!(benches);
