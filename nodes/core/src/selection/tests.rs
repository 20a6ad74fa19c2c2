//! The selector against rendered scenes whose truth is known.

use std::sync::LazyLock;

use image::{GrayImage, Luma};
use nalgebra::Vector2;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::camera::{
    CameraPose, CameraSpec, Distortion, LightModel, PartAppearance, PartView, Renderer, Scene, SensorModel,
    TrayAppearance,
};
use crate::tray::TrayGeometry;

mod accuracy;

const DIAMETER_M: f64 = 0.008;
const HEIGHT_M: f64 = 0.002_5;

fn scene(noise_sigma_levels: f64) -> Scene {
    Scene {
        camera: CameraModel::new(CameraSpec {
            width_px: 640,
            height_px: 480,
            focal_length_px: None,
            platen_m_per_px: Some(0.000_45),
            principal_point_px: None,
            distortion: Distortion { k1: -0.05, p1: 0.000_5, ..Distortion::default() },
            pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
        })
        .unwrap(),
        tray: MountedTray::new(TrayGeometry::PAPER),
        tray_appearance: TrayAppearance::default(),
        part: PartAppearance::grommet(DIAMETER_M, HEIGHT_M),
        light: LightModel::default(),
        sensor: SensorModel { noise_sigma_levels },
    }
}

fn at(radius_m: f64, psi_rad: f64, pose: usize) -> PartView {
    let z_m = TrayGeometry::PAPER.height_m(psi_rad);
    PartView { x_m: radius_m * psi_rad.cos(), y_m: radius_m * psi_rad.sin(), z_m, yaw_rad: 0.0, pose }
}

fn centre(part: &PartView) -> Point2<f64> {
    Point2::new(part.x_m, part.y_m)
}

fn over_camera() -> Isometry2<f64> {
    Isometry2::new(Vector2::new(0.3, 0.3), 0.0)
}

fn shoot(renderer: &Renderer, pose: &Isometry2<f64>, parts: &[PartView], noise: &mut Pcg64Mcg) -> GrayImage {
    let mut image = GrayImage::default();
    renderer.render(pose, parts, noise, &mut image).unwrap();
    image
}

/// A picture of parts with little noise and the tray under the camera.
fn simple_picture(parts: &[PartView]) -> GrayImage {
    shoot(&Renderer::new(&scene(2.0)).unwrap(), &over_camera(), parts, &mut Pcg64Mcg::seed_from_u64(11))
}

/// Parts scattered over the whole tray, none overlapping.
fn scatter(count: usize, generator: &mut Pcg64Mcg) -> Vec<PartView> {
    let mut parts: Vec<PartView> = Vec::new();
    while parts.len() < count {
        let radius_m = generator.random_range(0.030 + DIAMETER_M / 2.0..0.090 - DIAMETER_M / 2.0);
        let part = at(radius_m, generator.random_range(0.0..std::f64::consts::TAU), generator.random_range(0..2));
        if parts.iter().all(|other| (centre(other) - centre(&part)).norm() >= DIAMETER_M) {
            parts.push(part);
        }
    }
    parts
}

static MODEL: LazyLock<PartModel> = LazyLock::new(|| {
    let scene = scene(2.0);
    let renderer = Renderer::new(&scene).unwrap();
    let mut noise = Pcg64Mcg::seed_from_u64(42);
    let images: Vec<(usize, GrayImage)> = (0..2)
        .map(|pose| {
            let places =
                [(0.05, 3.6), (0.05, 4.4), (0.05, 5.4), (0.075, 3.5), (0.075, 4.2), (0.075, 5.0), (0.075, 5.8)];
            let parts: Vec<PartView> = places.iter().map(|(radius_m, psi_rad)| at(*radius_m, *psi_rad, pose)).collect();
            (pose, shoot(&renderer, &over_camera(), &parts, &mut noise))
        })
        .collect();
    let frames: Vec<TeachFrame> =
        images.iter().map(|(pose, image)| TeachFrame { image, platen_from_tray: over_camera(), pose: *pose }).collect();
    let spec = TeachSpec { diameter_m: DIAMETER_M, height_m: HEIGHT_M, contrast_min_levels: 10.0 };
    teach(&frames, &scene.camera, &scene.tray, spec).unwrap()
});

fn selector() -> Selector {
    let scene = scene(2.0);
    Selector::new(SelectorConfig::default(), &scene.camera, &scene.tray, MODEL.clone()).unwrap()
}

#[test]
fn a_blank_picture_stops_selection_and_a_good_one_resumes_it() {
    let parts = [at(0.06, 4.0, 0), at(0.07, 5.0, 0)];
    let (good, pose) = (simple_picture(&parts), over_camera());
    let mut selector = selector();
    let ids = |tracked: &[TrackedCandidate]| tracked.iter().map(|part| part.id).collect::<Vec<_>>();
    let before = selector.process(0.0, &good, &pose).unwrap();
    assert_eq!(before.len(), 2);
    for (index, level) in [(1.0, 0_u8), (2.0, 255)] {
        let blank = GrayImage::from_pixel(640, 480, Luma([level]));
        let fault = selector.process(0.1 * index, &blank, &pose).unwrap_err();
        assert_eq!(fault, if level == 0 { ImageFault::UnderExposed } else { ImageFault::OverExposed });
    }
    let after = selector.process(0.3, &good, &pose).unwrap();
    assert_eq!(ids(&before), ids(&after));
    // Uniform grey is an empty plateau as far as anyone can see.
    let grey = GrayImage::from_pixel(640, 480, Luma([128]));
    assert_eq!(selector.process(0.4, &grey, &pose), Ok(Vec::new()));
}

#[test]
fn over_exposure_yields_no_candidates() {
    let mut bright = scene(2.0);
    bright.light.white_level = 2_000.0;
    let renderer = Renderer::new(&bright).unwrap();
    let image = shoot(&renderer, &over_camera(), &[at(0.06, 4.0, 0)], &mut Pcg64Mcg::seed_from_u64(1));
    assert_eq!(selector().process(0.0, &image, &over_camera()), Err(ImageFault::OverExposed));
}

#[test]
fn pictures_of_another_size_and_trays_out_of_view_are_faults() {
    let mut selector = selector();
    let small = GrayImage::new(320, 240);
    assert!(matches!(selector.process(0.0, &small, &over_camera()), Err(ImageFault::WrongSize { .. })));
    let image = simple_picture(&[]);
    let away = Isometry2::new(Vector2::new(0.9, 0.3), 0.0);
    assert_eq!(selector.process(0.1, &image, &away), Err(ImageFault::PlateauOutOfView));
    let nowhere = Isometry2::new(Vector2::new(f64::NAN, 0.3), 0.0);
    assert_eq!(selector.process(0.2, &image, &nowhere), Err(ImageFault::PlateauOutOfView));
}

#[test]
fn light_other_than_taught_changes_nothing() {
    let mut dim = scene(2.0);
    dim.light = LightModel {
        white_level: 150.0,
        gradient_right_ratio: 0.2,
        gradient_down_ratio: -0.15,
        azimuth_rad: -0.6,
        ..LightModel::default()
    };
    let renderer = Renderer::new(&dim).unwrap();
    let parts: Vec<PartView> = (0..7_u32).map(|i| at(0.065, 3.5 + 0.4 * f64::from(i), (i % 2) as usize)).collect();
    let image = shoot(&renderer, &over_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(9));
    let candidates = selector().detect(&image, &over_camera()).unwrap();
    assert_eq!(candidates.len(), parts.len());
    for candidate in candidates {
        let truth = parts.iter().find(|part| (centre(part) - candidate.centre()).norm() < 0.000_4).unwrap();
        assert_eq!(candidate.pose, Some(truth.pose));
    }
}

#[test]
fn touching_discs_are_told_apart_and_not_isolated() {
    let middle = at(0.06, 4.5, 0);
    let mut parts = vec![middle];
    for step in 0..3 {
        let (sin, cos) = (f64::from(step) * std::f64::consts::FRAC_PI_3).sin_cos();
        parts.push(PartView {
            x_m: middle.x_m + DIAMETER_M * cos,
            y_m: middle.y_m + DIAMETER_M * sin,
            pose: 1,
            ..middle
        });
    }
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    assert_eq!(candidates.len(), 4);
    for candidate in candidates {
        let truth = parts.iter().find(|part| (centre(part) - candidate.centre()).norm() < 0.000_4).unwrap();
        assert_eq!(candidate.pose, Some(truth.pose));
        assert!(candidate.part_gap_m.abs() < 0.000_5, "{}", candidate.part_gap_m);
    }
}

#[test]
fn a_thing_that_is_no_part_is_an_obstacle() {
    let part = at(0.06, 4.5, 0);
    let mut image = simple_picture(&[part]);
    let mut selector = selector();
    let free = selector.detect(&image, &over_camera()).unwrap()[0];
    assert!(free.part_gap_m > 0.01);
    // A dark bar, 1 mm wide, its near edge 2 mm beside the part.
    let scene = scene(2.0);
    let view = View { camera: &scene.camera, tray: &scene.tray, platen_from_tray: over_camera() };
    for (along, across) in (0..20).flat_map(|along| (0..5).map(move |across| (along, across))) {
        let (along_m, across_m) = (f64::from(along) * 0.000_2, f64::from(across) * 0.000_2);
        let point = Point2::new(part.x_m + DIAMETER_M / 2.0 + 0.002 + across_m, part.y_m + along_m);
        let pixel = view.pixel(point, scene.tray.plateau_height_m()).unwrap();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the image")]
        image.put_pixel(pixel.x.round() as u32, pixel.y.round() as u32, Luma([20]));
    }
    let blocked = selector.detect(&image, &over_camera()).unwrap()[0];
    assert_eq!(blocked.pose, Some(0));
    assert!((blocked.part_gap_m - 0.002).abs() < 0.000_6, "{}", blocked.part_gap_m);
}

#[test]
fn only_what_lies_wholly_on_the_plateau_is_on_it() {
    let parts = [
        at(0.06, 4.5, 0),
        at(0.06, std::f64::consts::TAU - 0.04, 0),
        at(0.06, std::f64::consts::PI + 0.04, 0),
        at(0.06, 1.0, 0),
    ];
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    let on: Vec<_> = candidates.iter().filter(|candidate| candidate.on_plateau).collect();
    assert_eq!(on.len(), 1);
    assert!((on[0].centre() - centre(&parts[0])).norm() < 0.000_3);
    assert!(candidates.iter().all(|candidate| candidate.y_m < 0.0), "the ramp is not looked at");
}

#[test]
fn gaps_to_walls_are_measured() {
    let parts = [at(0.090 - DIAMETER_M / 2.0, 4.2, 0), at(0.030 + DIAMETER_M / 2.0, 5.2, 0), at(0.06, 4.7, 0)];
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    assert_eq!(candidates.len(), 3);
    for candidate in candidates {
        let truth = parts.iter().find(|part| (centre(part) - candidate.centre()).norm() < 0.000_4).unwrap();
        let radius_m = centre(truth).coords.norm();
        let gap_m = (0.090 - radius_m).min(radius_m - 0.030) - DIAMETER_M / 2.0;
        assert!((candidate.wall_gap_m - gap_m).abs() < 0.000_3);
        assert!(candidate.isolation_m() <= candidate.wall_gap_m);
    }
}

#[test]
fn selection_asks_for_pose_confidence_and_room() {
    let parts = [at(0.06, 4.0, 0), at(0.06, 4.6, 1), at(0.06, 5.2, 0), at(0.06, 5.2 + 0.0085 / 0.06, 1)];
    let image = simple_picture(&parts);
    let mut selector = selector();
    let tracked =
        (0..4).map(|frame| selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap()).last().unwrap();
    assert_eq!(tracked.len(), 4);
    let selectable: Vec<_> = tracked.iter().filter(|part| part.selectable).collect();
    assert_eq!(selectable.len(), 1);
    assert!((selectable[0].position_m - centre(&parts[0])).norm() < 0.000_3);
    let overlay = draw_overlay(&image, &tracked, &scene(2.0).camera, &scene(2.0).tray, &over_camera());
    let green = overlay.pixels().filter(|pixel| pixel.0[1] > 200 && pixel.0[0] < 100).count();
    assert!(green > 20, "the part that may be picked is ringed in green: {green} px");
}

#[test]
fn parts_keep_their_identity_and_their_motion_is_foreseen() {
    let renderer = Renderer::new(&scene(2.0)).unwrap();
    let mut noise = Pcg64Mcg::seed_from_u64(3);
    let mut selector = selector();
    let place = |frame: i32, lane: i32| {
        at(0.05 + 0.015 * f64::from(lane), 4.0 + 0.5 * f64::from(lane) + 0.015 * f64::from(frame), 0)
    };
    let mut last = Vec::new();
    for frame in 0..15 {
        let parts: Vec<PartView> = (0..3).map(|lane| place(frame, lane)).collect();
        let image = shoot(&renderer, &over_camera(), &parts, &mut noise);
        let tracked = selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap();
        if frame > 0 {
            let ids = |parts: &[TrackedCandidate]| parts.iter().map(|part| part.id).collect::<Vec<_>>();
            assert_eq!(ids(&last), ids(&tracked));
        }
        last = tracked;
    }
    for part in &last {
        let foreseen = part.predict(0.1 * 17.0);
        let miss_m = (0..3).map(|lane| (centre(&place(17, lane)) - foreseen).norm()).fold(f64::INFINITY, f64::min);
        assert!(miss_m < 0.000_5, "foreseen {} mm off", miss_m * 1e3);
        assert_eq!(part.frames_seen, 15);
    }
}

#[test]
fn the_same_frames_give_the_same_selection() {
    let mut generator = Pcg64Mcg::seed_from_u64(8);
    let image = simple_picture(&scatter(60, &mut generator));
    let run = || {
        let mut selector = selector();
        (0..3)
            .map(|frame| selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn teaching_refuses_poses_that_look_the_same_or_are_not_shown() {
    let scene = scene(2.0);
    let image = simple_picture(&[at(0.06, 4.0, 0), at(0.06, 5.0, 0)]);
    let frame = |pose| TeachFrame { image: &image, platen_from_tray: over_camera(), pose };
    let spec = TeachSpec { diameter_m: DIAMETER_M, height_m: HEIGHT_M, contrast_min_levels: 10.0 };
    let taught = |frames: &[TeachFrame], spec| teach(frames, &scene.camera, &scene.tray, spec);
    assert!(matches!(taught(&[frame(0), frame(1)], spec), Err(TeachError::Alike { first: 0, second: 1, .. })));
    assert!(matches!(taught(&[frame(1)], spec), Err(TeachError::NoPart { pose: 0, .. })));
    assert!(matches!(taught(&[], spec), Err(TeachError::NoPart { pose: 0, .. })));
    let nonsense = TeachSpec { diameter_m: f64::NAN, ..spec };
    assert!(matches!(taught(&[frame(0)], nonsense), Err(TeachError::Value(_))));
    let blank = GrayImage::new(640, 480);
    let black = TeachFrame { image: &blank, ..frame(0) };
    assert!(matches!(taught(&[black], spec), Err(TeachError::Frame { index: 0, source: ImageFault::UnderExposed })));
}

#[test]
fn bad_configurations_are_refused_by_name() {
    let scene = scene(2.0);
    let refused = |config: SelectorConfig, model: PartModel| {
        Selector::new(config, &scene.camera, &scene.tray, model).unwrap_err().field
    };
    let config = SelectorConfig::default;
    let model = || MODEL.clone();
    assert_eq!(refused(SelectorConfig { wanted_poses: vec![2], ..config() }, model()), "selector.wanted_poses");
    assert_eq!(refused(SelectorConfig { confidence_min: 2.0, ..config() }, model()), "selector.confidence_min");
    let tracker = TrackerConfig { memory: 1.0, ..TrackerConfig::default() };
    assert_eq!(refused(SelectorConfig { tracker, ..config() }, model()), "selector.tracker.memory");
    assert_eq!(refused(config(), PartModel { poses: Vec::new(), ..model() }), "part_model.poses");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_picture_and_no_pose_makes_the_selector_panic(
        seed in any::<u64>(), x_m in 0.1..0.5, y_m in 0.1..0.5, yaw_rad in -3.2..3.2, levels in 1_u8..255, block in 1_u32..40,
    ) {
        let mut generator = Pcg64Mcg::seed_from_u64(seed);
        let table: Vec<u8> = (0..4096).map(|_| generator.random_range(0..=levels)).collect();
        let image = GrayImage::from_fn(640, 480, |x, y| Luma([table[((x / block) * 61 + (y / block)) as usize % table.len()]]));
        let pose = Isometry2::new(Vector2::new(x_m, y_m), yaw_rad);
        if let Ok(candidates) = selector().process(0.0, &image, &pose) {
            for part in candidates {
                prop_assert!(part.confidence.is_finite() && (0.0..=1.0).contains(&part.confidence));
                prop_assert!(part.position_m.coords.iter().all(|x| x.is_finite()));
            }
        }
    }
}
