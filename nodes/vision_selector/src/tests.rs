//! Images as cameras send them, good and bad.

use feeder_model::seed::generator;
use feeder_runtime::node::stamp_of_ns;
use feeder_scenario::Scenario;
use feeder_sim::camera::codec;
use feeder_sim::camera::{PartView, Renderer, TrayShot};
use feeder_vision::{CalibrationFault, NoPose};
use image::GrayImage;
use minifactory_msgs::msg::PartCandidate;
use nalgebra::{Isometry2, Vector3 as Vector};

use super::*;

const FRAME_NS: u64 = 80_000_000;

/// A sight with the tray under the camera in the frames looked at, and the compressed picture of a part on the plateau.
fn sight() -> (Sight, Vec<u8>) {
    let scenario = Scenario::default();
    let plan = scenario.plan().unwrap();
    let (_, config) = plan.of_kind::<VisionSelectorConfig>().next().unwrap();
    let place = scenario.delivery.feeding_place;
    let platen_from_tray = Isometry2::new(place.xy(), place.z);
    let mut sight = Sight::new(config).unwrap();
    (1..=8).for_each(|frame| sight.poses.note(standing(frame * FRAME_NS)));
    let part = scenario.part_type().unwrap();
    let scene = scenario.scene(&part);
    let tray = &scenario.tray.geometry;
    let radius_m = 0.5 * (tray.inner_radius_m + tray.outer_radius_m);
    let angle_rad = 0.5 * (tray.ramp_angle_rad + std::f64::consts::TAU);
    let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
    let view = PartView { x_m, y_m, z_m: tray.rise_m, pose: part.wanted_poses[0], ..PartView::default() };
    let mut image = GrayImage::default();
    let mut renderer = Renderer::new(&scene).unwrap();
    renderer.render(&TrayShot::still(platen_from_tray), &[view], &mut generator(1, "camera"), &mut image).unwrap();
    (sight, codec::encode(&image, codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).unwrap())
}

/// The tray at its feeding place.
fn standing(stamp_ns: u64) -> TimedPose {
    let place = Scenario::default().delivery.feeding_place;
    TimedPose { stamp_ns, position: Vector::new(place.x, place.y, place.z), velocity: Vector::zeros() }
}

fn message(frame: u64, data: &[u8]) -> Frame {
    message_at(frame * FRAME_NS, data)
}

fn message_at(stamp_ns: u64, data: &[u8]) -> Frame {
    let mut message = CompressedImage { data: data.into(), ..CompressedImage::default() };
    message.header.stamp = stamp_of_ns(stamp_ns);
    Frame::Compressed(message)
}

#[test]
fn before_the_first_image_nothing_is_well_and_no_camera_has_stopped() {
    let text = |fault: Option<&LookError>| fault.filter(|fault| fault.is_wrong()).map(ToString::to_string);
    assert!(text(LookError::in_force(None, false)).unwrap().contains("no image has come yet"));
    // None ever came, long after the start: still no camera has stopped.
    let late = LookError::without_image(false);
    assert!(text(LookError::in_force(Some(&late), false)).unwrap().contains("no image has come yet"));
    // One came, and all is well until no more do.
    assert_eq!(text(LookError::in_force(None, true)), None);
    let stopped = LookError::without_image(true);
    assert!(text(LookError::in_force(Some(&stopped), true)).unwrap().contains("the camera has stopped"));
}

#[test]
fn a_corrupt_image_is_named_and_the_next_good_one_is_seen() {
    let (mut sight, good) = sight();
    assert_eq!(sight.look(&message(1, &good)).unwrap().tracked.len(), 1);
    let noise: Vec<u8> = good.iter().map(|byte| byte.wrapping_mul(31).wrapping_add(7)).collect();
    for (frame, bad) in [(2, &[][..]), (3, &good[..100]), (4, &noise[..]), (5, b"not an image")] {
        let fault = sight.look(&message(frame, bad)).map(|picture| picture.tracked).unwrap_err();
        assert!(matches!(fault, LookError::Decode(_)), "{fault}");
    }
    // Half of it may decode: then the rest is grey, and whatever is seen is seen in what came.
    let _ = sight.look(&message(6, &good[..good.len() / 2]));
    assert_eq!(sight.look(&message(7, &good)).unwrap().tracked.len(), 1);
}

#[test]
fn an_image_that_cannot_show_the_plateau_is_not_even_decoded() {
    let (mut sight, good) = sight();
    assert_eq!(sight.look(&message(7, &good)).unwrap().tracked.len(), 1);
    let stamp_ns = 9 * FRAME_NS;
    let mut away = standing(stamp_ns);
    away.position.x += 0.4;
    sight.poses.note(TimedPose { stamp_ns: stamp_ns - 1_000_000, ..away });
    sight.poses.note(away);
    let fault = sight.look(&message_at(stamp_ns, b"not an image")).map(|picture| picture.tracked).unwrap_err();
    assert_eq!(fault, LookError::Image(ImageFault::PlateauOutOfView));
    // What was tracked has not been seen meanwhile, as after any image without a plateau.
    sight.poses.note(standing(20 * FRAME_NS - 1_000_000));
    sight.poses.note(standing(20 * FRAME_NS));
    assert_eq!(sight.look(&message(20, &good)).unwrap().tracked.len(), 1);
}

#[test]
fn under_way_nothing_is_looked_at_and_parts_are_known_again_afterwards() {
    let (mut sight, good) = sight();
    let before = sight.look(&message(7, &good)).unwrap().tracked[0];
    let later_ns = |ms: u64| 8 * FRAME_NS + ms * 1_000_000;
    for ms in (10..=2000).step_by(10) {
        let mut going = standing(later_ns(ms));
        going.velocity.x = 0.3;
        sight.poses.note(going);
    }
    for ms in [500, 1000, 1500, 1990] {
        let fault = sight.look(&message_at(later_ns(ms), b"not an image")).map(|picture| picture.tracked).unwrap_err();
        // What is further back than odometry is remembered tells nothing.
        let expected = if ms < 1500 { LookError::Pose(NoPose::TooOld) } else { LookError::UnderWay };
        assert_eq!(fault, expected, "{ms} ms");
        assert_eq!(fault.is_wrong(), ms < 1500);
    }
    sight.poses.note(standing(later_ns(2010)));
    let mut shaken = standing(later_ns(2020));
    shaken.velocity.z = 0.3;
    sight.poses.note(shaken);
    let again = sight.look(&message_at(later_ns(2020), &good)).unwrap().tracked[0];
    assert_eq!((again.id, again.frames_seen), (before.id, before.frames_seen + 1));
}

#[test]
fn an_image_of_another_camera_is_a_fault_with_both_sizes() {
    let (mut sight, _) = sight();
    let small = codec::encode(&GrayImage::new(320, 240), codec::DEFAULT_QUALITY, codec::DEFAULT_BYTES_MAX).unwrap();
    let fault = sight.look(&message(1, &small)).map(|picture| picture.tracked).unwrap_err();
    assert_eq!(
        fault.to_string(),
        "the image has 320x240 px; the camera has 640x480 px, and a picture of a whole multiple of that is binned"
    );
}

#[test]
fn an_image_between_two_odometry_messages_is_looked_at() {
    let (mut sight, good) = sight();
    sight.poses.note(standing(8 * FRAME_NS + 10_000_000));
    let between = message_at(8 * FRAME_NS + 3_000_000, &good);
    assert_eq!(sight.look(&between).unwrap().tracked.len(), 1);
}

#[test]
fn an_image_ahead_of_odometry_waits_for_so_long_and_one_that_is_too_old_does_not() {
    let (mut sight, good) = sight();
    let ahead = message(9, &good);
    assert!(sight.awaits_odometry(&ahead, Duration::from_millis(90)));
    assert!(!sight.awaits_odometry(&ahead, Duration::from_millis(100)));
    let fault = sight.look(&ahead).map(|picture| picture.tracked).unwrap_err();
    assert_eq!(fault, LookError::Pose(NoPose::Ahead));
    let old = message(0, &good);
    assert!(!sight.awaits_odometry(&old, Duration::ZERO));
    let fault = sight.look(&old).map(|picture| picture.tracked).unwrap_err();
    assert_eq!(fault, LookError::Pose(NoPose::TooOld));
    // The gap of 80 ms between two messages is longer than is interpolated across.
    let between = message_at(7 * FRAME_NS + 1, &good);
    let fault = sight.look(&between).map(|picture| picture.tracked).unwrap_err();
    assert_eq!(fault, LookError::Pose(NoPose::Gap));
}

#[test]
fn both_messages_tell_of_the_same_parts_and_one_of_what_speaks_against_them() {
    let (mut sight, good) = sight();
    let part = Scenario::default().part_type().unwrap();
    let poses = part.poses.iter().map(|pose| pose.name.clone()).collect();
    let names = Names {
        part: part.name.clone(),
        poses,
        tray_frame: "feeder/tray".to_owned(),
        plateau_m: 0.02,
        node: String::new(),
    };
    for frame in 1..=8 {
        let message = message(frame, &good);
        let tracked = sight.look(&message).unwrap().tracked;
        let header = message.header();
        let (shown, told) =
            names.messages(header, &tracked, &names.seen(&tracked, &sight.selector), &sight.selector, &sight.worth());
        assert_eq!((&told.header, told.parts.len()), (&shown.header, 1));
        assert_eq!(told.parts[0].id.to_string(), shown.detections[0].id);
        // A first look alone is not sure enough; eight are.
        match frame {
            1 => assert_eq!(told.parts[0].refusals, PartCandidate::POSE_UNSURE, "{told:?}"),
            8 => assert_eq!(told.parts[0].refusals, 0, "{told:?}"),
            _ => {}
        }
    }
}

#[test]
fn pictures_of_all_kinds_are_seen_alike() {
    let (mut sight, good) = sight();
    let grey = feeder_vision::decode(&good).unwrap();
    let (width, height) = grey.dimensions();
    let mut raw = |frame: u64, encoding: &str, channels: u32, data: Vec<u8>| {
        let mut message =
            Image { width, height, encoding: encoding.to_owned(), step: channels * width, data, ..Image::default() };
        message.header.stamp = stamp_of_ns(frame * FRAME_NS);
        sight.look(&Frame::Raw(message)).map(|picture| (picture.image == grey, picture.tracked.len()))
    };
    assert_eq!(raw(1, "mono8", 1, grey.to_vec()).unwrap(), (true, 1));
    assert_eq!(raw(2, "bgr8", 3, grey.iter().flat_map(|level| [*level; 3]).collect()).unwrap(), (true, 1));
    let deep = grey.iter().flat_map(|level| (u16::from(*level) * 257).to_le_bytes());
    assert_eq!(raw(3, "mono16", 2, deep.collect()).unwrap(), (true, 1));
    let refused = raw(4, "yuv422", 2, vec![0; 2 * grey.len()]).unwrap_err();
    assert!(refused.to_string().contains("yuv422"), "{refused}");
}

#[test]
fn a_picture_of_twice_the_size_is_binned() {
    let (mut sight, good) = sight();
    let grey = feeder_vision::decode(&good).unwrap();
    let large = image::imageops::resize(&grey, 1280, 960, image::imageops::FilterType::Nearest);
    let mut png = Vec::new();
    large.write_with_encoder(image::codecs::png::PngEncoder::new(&mut png)).unwrap();
    let picture = sight.look(&message(1, &png)).unwrap();
    assert_eq!((picture.image == grey, picture.tracked.len()), (true, 1));
}

#[test]
fn a_camera_off_its_calibration_is_warned_of_and_then_refused() {
    for (off_m, warned, refused) in [(0.0, false, false), (0.0005, true, false), (0.0015, true, true)] {
        let (mut sight, good) = sight();
        // Odometry says that the tray stands beside where the picture shows it.
        let mut beside = standing(9 * FRAME_NS);
        beside.position.x += off_m;
        sight.poses.note(beside);
        let looked = sight.look(&message(9, &good)).map(|picture| picture.tracked.len());
        assert_eq!(sight.warnings()[0].is_some(), warned, "{off_m} m: {:?}", sight.warnings());
        match looked {
            Err(LookError::Calibration(CalibrationFault::Off { misalignment, .. })) => {
                assert!(refused, "{off_m} m: {misalignment}");
                assert!((misalignment.error_m - off_m).abs() < 0.00015, "{misalignment}");
            }
            other => assert!(other == Ok(1) && !refused, "{off_m} m: {other:?}"),
        }
    }
}

#[test]
fn what_the_camera_says_of_itself_is_compared_with_the_scenario() {
    let (mut sight, _) = sight();
    let k = |focal_px: f64| [focal_px, 0.0, 319.5, 0.0, focal_px, 239.5, 0.0, 0.0, 1.0];
    let focal_px = 0.5 / 0.000_36;
    let info = CameraInfo { width: 640, height: 480, k: k(focal_px), ..CameraInfo::default() };
    let mut warning = |info: CameraInfo| {
        sight.hear(info);
        sight.warnings()[1].clone()
    };
    assert_eq!(warning(info.clone()), None);
    let longer = warning(CameraInfo { k: k(1.01 * focal_px), ..info.clone() }).unwrap();
    assert!(longer.contains("focal length 1402.8 against 1388.9 px"), "{longer}");
    let bent = warning(CameraInfo { d: vec![-0.2, 0.0, 0.0, 0.0, 0.0], ..info.clone() }).unwrap();
    assert!(bent.contains("k1 -0.2000 against 0.0000"), "{bent}");
    let fisheye = warning(CameraInfo { distortion_model: "equidistant".to_owned(), ..info.clone() }).unwrap();
    assert!(fisheye.contains("equidistant"), "{fisheye}");
    let small = warning(CameraInfo { width: 320, height: 240, ..info.clone() }).unwrap();
    assert!(small.contains("320x240 px"), "{small}");
    // Twice the pixels are binned, and then it is the same camera; one never calibrated says nothing.
    let fine = [2.0 * focal_px, 0.0, 639.5, 0.0, 2.0 * focal_px, 479.5, 0.0, 0.0, 1.0];
    assert_eq!(warning(CameraInfo { width: 1280, height: 960, k: fine, ..info.clone() }), None);
    assert_eq!(warning(CameraInfo { k: [0.0; 9], ..info }), None);
}

#[test]
fn a_frame_that_comes_twice_or_late_is_not_new_and_one_after_a_gap_is() {
    let (mut sight, good) = sight();
    let mut new = |frame| sight.is_new(&message(frame, &good));
    assert_eq!([1, 2, 2, 1, 5, 4, 6].map(&mut new), [true, true, false, false, true, false, true]);
    // A stamp from the future stops nothing.
    assert_eq!([99, 7, 7].map(new), [true, true, false]);
}

#[test]
fn images_too_seldom_to_follow_parts_that_are_fed_are_told_of_and_those_of_a_tray_at_rest_are_not() {
    // So many images, so far apart; the tray vibrates between them if it `feeds`.
    let told = |images: u64, apart_ms: u64, feeds: bool| {
        let (mut sight, good) = sight();
        for image in 1..=images {
            let at_ns = (1_000 + image * apart_ms) * 1_000_000;
            for before_ns in [20_000_000, 10_000_000, 0] {
                let mut pose = standing(at_ns - before_ns);
                pose.velocity.z = if feeds { 0.3 } else { 0.0 };
                sight.poses.note(pose);
            }
            sight.look(&message_at(at_ns, &good)).unwrap();
        }
        sight.warnings().into_iter().flatten().any(|warning| warning.contains("images come more than 500 ms apart"))
    };
    assert!(told(5, 510, true));
    assert!(!told(4, 510, true));
    assert!(!told(6, 500, true));
    assert!(!told(6, 1_000, false));
}
