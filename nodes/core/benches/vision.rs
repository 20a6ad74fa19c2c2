//! What a camera frame costs: rendering, coding and selecting, 640x480 px.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use feeder_core::camera::{
    CameraModel, CameraPose, CameraSpec, Distortion, LightModel, MountedTray, PartAppearance, PartView, Renderer,
    Scene, SensorModel, TrayAppearance, codec,
};
use feeder_core::selection::{Selector, SelectorConfig, TeachFrame, TeachSpec, teach};
use feeder_core::tray::TrayGeometry;
use image::GrayImage;
use nalgebra::{Isometry2, Vector2};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

const DIAMETER_M: f64 = 0.006;
const HEIGHT_M: f64 = 0.002;

fn scene() -> Scene {
    let camera = CameraSpec {
        width_px: 640,
        height_px: 480,
        focal_length_px: None,
        platen_m_per_px: Some(0.000_45),
        principal_point_px: None,
        distortion: Distortion::default(),
        pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
    };
    Scene {
        camera: CameraModel::new(camera).expect("the camera is sound"),
        tray: MountedTray::new(TrayGeometry::PAPER),
        tray_appearance: TrayAppearance::default(),
        part: PartAppearance::grommet(DIAMETER_M, HEIGHT_M),
        light: LightModel::default(),
        sensor: SensorModel::default(),
    }
}

/// Parts in five evenly filled rings over the angles from `from_rad` on.
fn parts(count: u32, from_rad: f64, pose: Option<usize>) -> Vec<PartView> {
    (0..count)
        .map(|index| {
            let (ring, place) = (index % 5, f64::from(index / 5) + 0.5);
            let span_rad = std::f64::consts::TAU - 0.2 - from_rad;
            let psi_rad = from_rad + 0.1 + span_rad * place / f64::from(count.div_ceil(5));
            let radius_m = 0.040 + 0.010 * f64::from(ring);
            PartView {
                x_m: radius_m * psi_rad.cos(),
                y_m: radius_m * psi_rad.sin(),
                z_m: TrayGeometry::PAPER.height_m(psi_rad),
                yaw_rad: 0.0,
                pose: pose.unwrap_or(index as usize % 2),
            }
        })
        .collect()
}

fn vision(criterion: &mut Criterion) {
    let scene = scene();
    let renderer = Renderer::new(&scene).expect("the scene is sound");
    let pose = Isometry2::new(Vector2::new(0.302, 0.299), 0.01);
    let mut noise = Pcg64Mcg::seed_from_u64(1);
    let mut image = GrayImage::default();
    for count in [0, 20, 100] {
        let parts = parts(count, 0.0, None);
        criterion.bench_function(&format!("render_{count}_parts"), |bencher| {
            bencher.iter(|| renderer.render(black_box(&pose), &parts, &mut noise, &mut image));
        });
    }
    criterion.bench_function("encode", |bencher| {
        bencher.iter(|| codec::encode(black_box(&image), codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX));
    });
    let bytes = codec::encode(&image, codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).expect("the frame is small");
    criterion.bench_function("decode", |bencher| {
        bencher.iter(|| codec::decode(black_box(&bytes)));
    });

    let mut shoot = |parts: &[PartView]| {
        let mut image = GrayImage::default();
        renderer.render(&pose, parts, &mut noise, &mut image).expect("the parts are sound");
        image
    };
    let taught = [0, 1].map(|face| shoot(&parts(20, std::f64::consts::PI, Some(face))));
    let frames = [0, 1].map(|face| TeachFrame { image: &taught[face], platen_from_tray: pose, pose: face });
    let spec = TeachSpec { diameter_m: DIAMETER_M, height_m: HEIGHT_M, contrast_min_levels: 10.0 };
    let model = teach(&frames, &scene.camera, &scene.tray, spec).expect("both faces are shown");
    for count in [5, 20, 50] {
        let image = shoot(&parts(count, std::f64::consts::PI, None));
        let mut selector = Selector::new(SelectorConfig::default(), &scene.camera, &scene.tray, model.clone())
            .expect("the configuration is sound");
        criterion.bench_function(&format!("select_{count}_plateau_parts"), |bencher| {
            bencher.iter(|| selector.process(black_box(0.1), &image, &pose));
        });
    }
}

criterion_group!(benches, vision);
criterion_main!(benches);
