//! The selector against rendered scenes whose truth is known.

use std::f64::consts::TAU;

use image::{GrayImage, Luma};
use nalgebra::Vector2;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use feeder_model::part::PartType;
use feeder_sim::camera::{AllRound, LightModel, Renderer, Scene};

mod accuracy;
mod clicks;
mod looks;
mod otherwise;
pub(crate) mod recognition;
mod scenes;
mod told_apart;

use scenes::*;
pub(crate) use scenes::{at, camera, empty_tray, over_camera, simple_picture};

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
    // Parts that no picture has shown for longer are forgotten, also where there was nothing to look at.
    for index in 0..=selector.config.tracker.missed_max {
        let blank = GrayImage::from_pixel(640, 480, Luma([0]));
        selector.process(0.4 + 0.1 * f64::from(index), &blank, &pose).unwrap_err();
    }
    let later = selector.process(2.0, &good, &pose).unwrap();
    assert!(later.len() == 2 && ids(&later).iter().all(|id| !ids(&before).contains(id)));
    // Uniform grey is an empty plateau as far as anyone can see.
    let grey = GrayImage::from_pixel(640, 480, Luma([128]));
    assert_eq!(selector.process(2.1, &grey, &pose), Ok(Vec::new()));
}

#[test]
fn over_exposure_yields_no_candidates() {
    let mut bright = scene(&GROMMET, 2.0);
    bright.light.white_level = 2_000.0;
    let mut renderer = Renderer::new(&bright).unwrap();
    let image = shoot(&mut renderer, &over_camera(), &[at(0.06, 4.0, 0)], &mut Pcg64Mcg::seed_from_u64(1));
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

/// The parts that candidates mean, each once.
fn assert_seen(candidates: &[Candidate], parts: &[LaidPart]) {
    assert_eq!(candidates.len(), parts.len(), "{candidates:?}");
    for part in parts {
        let seen = candidates.iter().find(|candidate| (candidate.centre() - part.place).norm() < 0.000_3).unwrap();
        // A round part has no yaw.
        assert_eq!((seen.pose, seen.yaw_rad), (Some(part.pose), None));
    }
}

#[test]
fn more_or_less_light_changes_nothing() {
    let mut dim = scene(&GROMMET, 2.0);
    dim.light = LightModel { white_level: 150.0, gradient_down_ratio: 0.0, ..LightModel::default() };
    let mut renderer = Renderer::new(&dim).unwrap();
    let parts: Vec<LaidPart> = (0..7_u32).map(|i| at(0.065, 3.5 + 0.4 * f64::from(i), (i % 2) as usize)).collect();
    let image = shoot(&mut renderer, &over_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(9));
    assert_seen(&selector().detect(&image, &over_camera()).unwrap(), &parts);
}

#[test]
fn touching_parts_are_told_apart_and_not_isolated() {
    let middle = at(0.06, 4.5, 0);
    let mut parts = vec![middle];
    // On the lamp's side of the middle one, so that none lies in the shadow of two others.
    for step in 1..3 {
        let (sin, cos) = (f64::from(step) * std::f64::consts::FRAC_PI_3).sin_cos();
        parts.push(LaidPart { pose: 1, place: middle.place + Vector2::new(cos, sin) * (2.0 * RADIUS_M), ..middle });
    }
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    assert_seen(&candidates, &parts);
    assert!(candidates.iter().all(|candidate| candidate.part_gap_m < 0.000_4), "{candidates:?}");
}

#[test]
fn a_thing_that_is_no_part_is_an_obstacle() {
    let part = at(0.06, 4.5, 0);
    let mut image = simple_picture(&[part]);
    let mut selector = selector();
    let free = selector.detect(&image, &over_camera()).unwrap()[0];
    assert!(free.part_gap_m > 0.01 && selector.admits(&free));
    // A dark bar, 5 mm wide, its near edge 0.6 mm beside the part, in its shade.
    let scene = scene(&GROMMET, 2.0);
    let places = (0..20).flat_map(|along| (0..25).map(move |across| (along, across))).map(|(along, across)| {
        let (along_m, across_m) = (f64::from(along) * 0.000_2, f64::from(across) * 0.000_2);
        part.place + Vector2::new(RADIUS_M + 0.000_6 + across_m, along_m)
    });
    paint(&mut image, &scene, places, 20);
    let blocked = selector.detect(&image, &over_camera()).unwrap();
    let blocked = blocked.iter().find(|candidate| (candidate.centre() - part.place).norm() < 0.000_3).unwrap();
    assert!(blocked.part_gap_m < 0.001 && !selector.admits(blocked), "{}", blocked.part_gap_m);
}

#[test]
fn the_shaded_edge_of_a_thing_is_part_of_it() {
    let part = at(0.06, 4.5, 0);
    let mut image = simple_picture(&[part]);
    let scene = scene(&GROMMET, 2.0);
    let view = view::View { camera: &scene.camera, tray: &scene.tray, platen_from_tray: over_camera() };
    // A dark bar 1.5 mm beside the part, and before it for 0.7 mm a rim that is no darker than a shade may be.
    let middle = view.pixel(part.place, scene.tray.plateau_height_m()).unwrap();
    let m_per_px = scene.camera.m_per_px(scene.tray.plateau_height_m());
    for (x, y, level) in image.enumerate_pixels_mut() {
        let beyond_m = (f64::from(x) - middle.x) * m_per_px - RADIUS_M;
        if (f64::from(y) - middle.y).abs() * m_per_px > 0.004 || beyond_m > 0.006 {
            continue;
        }
        if beyond_m > 0.001_5 {
            level.0[0] = 20;
        } else if beyond_m > 0.000_8 {
            level.0[0] -= level.0[0] / 11;
        }
    }
    let mut selector = selector();
    let seen = selector.detect(&image, &over_camera()).unwrap();
    let beside = seen.iter().find(|candidate| (candidate.centre() - part.place).norm() < 0.000_3).unwrap();
    assert!(beside.part_gap_m < 0.001 && !selector.admits(beside), "{}", beside.part_gap_m);
}

#[test]
fn how_much_of_the_plateau_is_in_the_picture_is_told() {
    let scene = scene(&GROMMET, 2.0);
    let mut renderer = Renderer::new(&scene).unwrap();
    let steps = || (-45..=45).map(|step| 0.002 * f64::from(step));
    let places = steps().flat_map(|x_m| steps().map(move |y_m| Point2::new(x_m, y_m)));
    let plateau: Vec<_> = places.filter(|at| at.y < 0.0 && (0.03..0.09).contains(&at.coords.norm())).collect();
    for beside_m in [0.0, 0.04, 0.08, 0.12] {
        let pose = Isometry2::new(Vector2::new(0.0, -beside_m), 0.0) * over_camera();
        let image = shoot(&mut renderer, &pose, &[], &mut Pcg64Mcg::seed_from_u64(5));
        let mut selector = selector();
        selector.detect(&image, &pose).unwrap();
        let view = view::View { camera: &scene.camera, tray: &scene.tray, platen_from_tray: pose };
        let in_view = |at: &&Point2<f64>| {
            let pixel = view.pixel(**at, scene.tray.plateau_height_m()).unwrap();
            (0.0..480.0).contains(&pixel.y)
        };
        let share = plateau.iter().filter(in_view).count() as f64 / plateau.len() as f64;
        let told = selector.health().in_view_ratio;
        // Hub and outer wall hide some of it.
        assert!((told - share).abs() < 0.1, "{beside_m} m: {told} {share}");
    }
}

#[test]
fn how_much_of_the_plateau_is_covered_and_what_of_it_is_explained_is_told() {
    let parts: Vec<LaidPart> = (0..6_u32).map(|i| at(0.065, 3.5 + 0.4 * f64::from(i), 0)).collect();
    let mut image = simple_picture(&parts);
    let mut selector = selector();
    selector.detect(&image, &over_camera()).unwrap();
    let parts_alone = selector.health().clone();
    let plateau_m2 = 0.25 * TAU * (0.09_f64.powi(2) - 0.03_f64.powi(2));
    let parts_ratio = 6.0 * 0.5 * TAU * RADIUS_M.powi(2) / plateau_m2;
    assert_eq!(parts_alone.recognised, 6);
    // Their shades, which count with them, are about as large again.
    assert!((1.5 * parts_ratio..3.0 * parts_ratio).contains(&parts_alone.covered_ratio), "{parts_alone:?}");
    assert!(parts_alone.explained_ratio > 0.97, "{parts_alone:?}");
    // A thing of six by six millimetres, with a blurred edge.
    let steps = || (-30..=30).map(|step| 0.000_1 * f64::from(step));
    let places = steps().flat_map(|x_m| steps().map(move |y_m| Point2::new(x_m, y_m - 0.045)));
    paint(&mut image, &scene(&GROMMET, 2.0), places, 20);
    selector.detect(&image, &over_camera()).unwrap();
    let health = selector.health();
    let thing_ratio = health.covered_ratio - parts_alone.covered_ratio;
    let painted_ratio = 0.006_f64.powi(2) / plateau_m2;
    assert!((painted_ratio..1.6 * painted_ratio).contains(&thing_ratio), "{thing_ratio} {painted_ratio}");
    assert!((health.explained_ratio - (1.0 - thing_ratio / health.covered_ratio)).abs() < 0.03, "{health:?}");
}

#[test]
fn light_that_falls_otherwise_is_told_and_looked_at_twice() {
    let parts: Vec<LaidPart> = (0..7_u32).map(|i| at(0.065, 3.5 + 0.4 * f64::from(i), (i % 2) as usize)).collect();
    let mut selector = selector();
    selector.detect(&simple_picture(&parts), &over_camera()).unwrap();
    assert!(!selector.health().light_differs(), "{:?}", selector.health());
    let mut other = scene(&GROMMET, 2.0);
    other.light.gradient_right_ratio += 0.05;
    let mut renderer = Renderer::new(&other).unwrap();
    let image = shoot(&mut renderer, &over_camera(), &parts, &mut Pcg64Mcg::seed_from_u64(9));
    assert_seen(&selector.detect(&image, &over_camera()).unwrap(), &parts);
    assert!(selector.health().causes().contains(&HealthCause::LightDiffers), "{:?}", selector.health());
}

/// As where a crowd lies on it, of which no light is known; what the light taught explains as it did counts all the same.
#[test]
fn a_covered_plateau_tells_of_no_light() {
    let parts: Vec<LaidPart> = (0..4_u32).map(|i| at(0.06, 3.8 + 0.6 * f64::from(i), (i % 2) as usize)).collect();
    let covered = |parts: &[LaidPart]| {
        let mut image = simple_picture(parts);
        let radii_m = (0..240).map(|step| 0.03 + 0.000_25 * f64::from(step));
        let places = radii_m.flat_map(|radius_m| {
            (0..1200).map(move |step| at(radius_m, TAU * (0.5 + f64::from(step) / 2400.0), 0).place)
        });
        let is_clear = |place: &Point2<f64>| parts.iter().all(|part| (part.place - place).norm() > RADIUS_M + 0.001);
        paint(&mut image, &scene(&GROMMET, 2.0), places.filter(is_clear), 60);
        selector().detect(&image, &over_camera())
    };
    assert_eq!(covered(&[]), Err(ImageFault::NoBackground));
    let candidates = covered(&parts).unwrap();
    for part in &parts {
        let is_it = |seen: &&Candidate| (seen.centre() - part.place).norm() < 0.000_3;
        let seen = candidates.iter().find(is_it);
        assert_eq!(seen.and_then(|seen| seen.pose), Some(part.pose), "{candidates:?}");
    }
}

#[test]
fn only_what_lies_wholly_on_the_plateau_is_on_it() {
    let parts = [at(0.06, 4.5, 0), at(0.06, TAU - 0.02, 0), at(0.06, std::f64::consts::PI + 0.02, 0), at(0.06, 1.0, 0)];
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    let on: Vec<_> = candidates.iter().filter(|candidate| candidate.on_plateau).collect();
    assert_eq!(on.len(), 1);
    assert!((on[0].centre() - parts[0].place).norm() < 0.000_3);
}

#[test]
fn gaps_to_walls_are_measured() {
    let parts = [at(0.090 - RADIUS_M, 4.2, 0), at(0.030 + RADIUS_M, 5.2, 0), at(0.06, 4.7, 0)];
    let candidates = selector().detect(&simple_picture(&parts), &over_camera()).unwrap();
    assert_seen(&candidates, &parts);
    for candidate in candidates {
        let truth = parts.iter().find(|part| (part.place - candidate.centre()).norm() < 0.000_4).unwrap();
        let radius_m = truth.place.coords.norm();
        let gap_m = (0.090 - radius_m).min(radius_m - 0.030) - RADIUS_M;
        assert!((candidate.wall_gap_m - gap_m).abs() < 0.000_3);
    }
}

#[test]
fn what_may_be_picked_is_sure_and_has_room_in_whatever_pose() {
    let parts = [at(0.06, 4.0, 0), at(0.06, 4.6, 1), at(0.06, 5.2, 0), at(0.06, 5.2 + 0.0055 / 0.06, 1)];
    let image = simple_picture(&parts);
    let mut selector = selector();
    let tracked =
        (0..4).map(|frame| selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap()).last().unwrap();
    assert_eq!(tracked.len(), 4);
    for part in &tracked {
        let laid = parts.iter().position(|laid| (part.position_m - laid.place).norm() < 0.000_3).unwrap();
        let expected = Refusals { part_too_near: laid >= 2, ..Refusals::default() };
        assert_eq!((part.pose, selector.refusals(part)), (Some(parts[laid].pose), expected), "part {laid}");
    }
    // A first look is not enough.
    let fresh = self::selector().process(0.0, &image, &over_camera()).unwrap();
    assert!(fresh.iter().all(|part| selector.refusals(part).pose_unsure), "{fresh:?}");
    let overlay = draw_overlay(&image, &tracked, &selector, &over_camera());
    let green = overlay.pixels().filter(|pixel| pixel.0[1] > 200 && pixel.0[0] < 100).count();
    assert!(green > 20, "the wanted part that may be picked is outlined in green: {green} px");
}

#[test]
fn parts_keep_their_identity_and_their_motion_is_foreseen() {
    let mut renderer = Renderer::new(&scene(&GROMMET, 2.0)).unwrap();
    let mut noise = Pcg64Mcg::seed_from_u64(3);
    let mut selector = selector();
    let place = |frame: i32, lane: i32| {
        at(0.05 + 0.015 * f64::from(lane), 4.0 + 0.5 * f64::from(lane) + 0.015 * f64::from(frame), 0)
    };
    let mut last = Vec::new();
    for frame in 0..15 {
        let parts: Vec<LaidPart> = (0..3).map(|lane| place(frame, lane)).collect();
        let image = shoot(&mut renderer, &over_camera(), &parts, &mut noise);
        let tracked = selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap();
        if frame > 0 {
            let ids = |parts: &[TrackedCandidate]| parts.iter().map(|part| part.id).collect::<Vec<_>>();
            assert_eq!(ids(&last), ids(&tracked));
        }
        last = tracked;
    }
    for part in &last {
        let foreseen = part.predict(0.1 * 17.0);
        let miss_m = (0..3).map(|lane| (place(17, lane).place - foreseen).norm()).fold(f64::INFINITY, f64::min);
        assert!(miss_m < 0.000_5, "foreseen {} mm off", miss_m * 1e3);
        assert_eq!(part.frames_seen, 15);
    }
}

#[test]
fn the_same_frames_give_the_same_selection_and_a_stored_model_does_too() {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let image = simple_picture(&strewn(&GROMMET, None, 60, 2.0 * RADIUS_M, &mut random));
    let run = |model: &PartModel| {
        let scene = scene(&GROMMET, 2.0);
        let mut selector = Selector::new(SelectorConfig::default(), &scene.camera, &scene.tray, model).unwrap();
        (0..3)
            .map(|frame| selector.process(0.1 * f64::from(frame), &image, &over_camera()).unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(run(&MODEL), run(&MODEL));
    let stored = serde_json::to_string(&*MODEL).unwrap();
    let read: PartModel = serde_json::from_str(&stored).unwrap();
    let poses = |seen: &[Vec<TrackedCandidate>]| seen[2].iter().map(|part| part.pose).collect::<Vec<_>>();
    assert_eq!(poses(&run(&read)), poses(&run(&MODEL)));
}

#[test]
fn teaching_refuses_poses_that_look_the_same_or_are_not_shown() {
    let scene = scene(&GROMMET, 2.0);
    let mut renderer = Renderer::new(&scene).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let bare = shoot(&mut renderer, &over_camera(), &[], &mut random);
    let bare = TeachFrame { image: &bare, platen_from_tray: over_camera(), parts: &[] };
    let spec = drawing(&GROMMET);
    // Of other lights a frame of each pose is enough.
    let lessons: Vec<Vec<LaidPart>> = (0..2).map(|pose| strewn(&GROMMET, Some(pose), 20, 0.009, &mut random)).collect();
    let lit = Lit::new(&scene, &lessons, &mut random);
    let lit = lit.frames();
    let taught = |frames: &[TeachFrame], spec: &TeachSpec| teach(frames, &lit, &scene.camera, &scene.tray, spec);
    assert!(matches!(taught(&[], &spec), Err(TeachError::NoBarePlateau)));
    assert!(matches!(taught(&[bare], &spec), Err(TeachError::TooFew { pose: 0, shown: 0 })));
    // Parts that all lie in one pose, half of them said to lie in another.
    let parts = strewn(&GROMMET, Some(0), 40, 0.009, &mut random);
    let image = shoot(&mut renderer, &over_camera(), &parts, &mut random);
    let said: Vec<LaidPart> = parts.iter().enumerate().map(|(i, part)| LaidPart { pose: i % 2, ..*part }).collect();
    let lied = TeachFrame { image: &image, platen_from_tray: over_camera(), parts: &said };
    assert!(matches!(taught(&[bare, lied], &spec), Err(TeachError::NotRecognised { .. })));
    let mut nonsense = drawing(&GROMMET);
    nonsense.poses[0].height_m = f64::NAN;
    assert!(matches!(taught(&[bare], &nonsense), Err(TeachError::Value(_))));
    let black = GrayImage::new(640, 480);
    let black = TeachFrame { image: &black, ..bare };
    assert!(matches!(taught(&[black], &spec), Err(TeachError::Frame { index: 0, source: ImageFault::UnderExposed })));
}

/// As where walls are so high that low light reaches hardly anything on the plateau.
#[test]
fn a_part_is_taught_where_nothing_is_seen_in_low_light_from_one_side() {
    let scene = scene(&GROMMET, 2.0);
    let mut renderer = Renderer::new(&scene).unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut lessons: Vec<Vec<LaidPart>> = vec![Vec::new(); 3];
    lessons.extend((0..8).map(|index| strewn(&GROMMET, Some(index % 2), 9, 0.009, &mut random)));
    let images: Vec<GrayImage> =
        lessons.iter().map(|parts| shoot(&mut renderer, &over_camera(), parts, &mut random)).collect();
    let lit = Lit::new(&scene, &lessons, &mut random);
    let in_the_dark = OtherLights { from_side: Vec::new(), ..lit.frames() };
    let frames = frames(&images, &lessons);
    let model = teach(&frames, &in_the_dark, &scene.camera, &scene.tray, &drawing(&GROMMET)).unwrap();
    assert!(model.poses.iter().flat_map(|pose| &pose.from_side).all(|plane| plane.values().iter().all(|v| *v == 0.0)));
}

#[test]
fn bad_configurations_are_refused_by_name() {
    let scene = scene(&GROMMET, 2.0);
    let refused = |config: SelectorConfig, model: PartModel| {
        Selector::new(config, &scene.camera, &scene.tray, &model).unwrap_err().parameter
    };
    let config = SelectorConfig::default;
    let model = || MODEL.clone();
    assert_eq!(refused(SelectorConfig { wanted_poses: vec![2], ..config() }, model()), "selector.wanted_poses");
    assert_eq!(refused(SelectorConfig { confidence_min: 2.0, ..config() }, model()), "selector.confidence_min");
    let tracker = TrackerConfig { memory: 1.0, ..TrackerConfig::default() };
    assert_eq!(refused(SelectorConfig { tracker, ..config() }, model()), "selector.tracker.memory");
    let tracker = TrackerConfig { gate_m: 0.0, ..TrackerConfig::default() };
    assert_eq!(refused(SelectorConfig { tracker, ..config() }, model()), "selector.tracker.gate_m");
    let odometry = PoseHistoryConfig { gap_s_max: -1.0, ..PoseHistoryConfig::default() };
    assert_eq!(refused(SelectorConfig { odometry, ..config() }, model()), "selector.odometry.gap_s_max");
    assert_eq!(refused(config(), PartModel { poses: Vec::new(), ..model() }), "part_model.poses");
    assert_eq!(refused(config(), PartModel { taught_at_m: [f64::NAN, 0.0], ..model() }), "part_model.taught_at_m");
    assert_eq!(refused(config(), PartModel { hub_level: 0.0, ..model() }), "part_model.hub_level");
    let damaged = serde_json::to_string(&*MODEL).unwrap().replacen("7f", "zz", 1);
    assert!(serde_json::from_str::<PartModel>(&damaged).unwrap_err().to_string().contains("hexadecimal"));
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
