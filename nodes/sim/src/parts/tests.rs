//! Tests of the bulk that need to see inside it.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::*;
use feeder_model::geometry::{Loop, ShapeSpec, Solid};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::part::{PartSpec, PartType, PoseName};
use feeder_model::tray::TrayGeometry;

/// A disc with a bright and a dark face, equally likely, and one coefficient of friction.
pub(super) fn disc(diameter_m: f64, friction: f64) -> PartType {
    let outline = || Loop::Circle { radius_m: diameter_m / 2.0, centre_m: [0.0; 2] };
    let layer = |z_m, share| Solid::Extruded { outline: outline(), holes: vec![], z_m, reflectance: Some(share) };
    let solids = vec![layer([0.0, 0.0005], 0.2), layer([0.0005, 0.001], 0.8)];
    PartType::new(&PartSpec {
        name: "disc".to_owned(),
        density_kg_m3: 8000.0,
        friction_static: friction,
        friction_kinetic: friction,
        friction_uncertainty_ratio: 0.1,
        reflectance: 0.5,
        shape: ShapeSpec::Solids(solids),
        poses: vec![PoseName { name: "up".to_owned(), up: [0.0, 0.0, 1.0] }],
        wanted_poses: vec!["up".to_owned()],
        drops: None,
    })
    .unwrap()
}

/// A block that lies flat in its first pose.
pub(super) fn block(x_m: f64, y_m: f64, z_m: f64) -> PartType {
    let outline = Loop::Polygon(vec![[0.0, 0.0], [x_m, 0.0], [x_m, y_m], [0.0, y_m]]);
    let solids = vec![Solid::Extruded { outline, holes: vec![], z_m: [0.0, z_m], reflectance: None }];
    PartType::new(&PartSpec {
        name: "block".to_owned(),
        density_kg_m3: 8000.0,
        friction_static: 0.2,
        friction_kinetic: 0.2,
        friction_uncertainty_ratio: 0.1,
        reflectance: 0.5,
        shape: ShapeSpec::Solids(solids),
        poses: vec![PoseName { name: "flat".to_owned(), up: [0.0, 0.0, 1.0] }],
        wanted_poses: vec!["flat".to_owned()],
        drops: None,
    })
    .unwrap()
}

/// The paper's tray for a part.
pub(super) fn track(part: &PartType) -> super::track::TrayPath {
    super::track::TrayPath::new(&TrayGeometry::PAPER, part, &BulkSettings::default())
}

/// A part at rest, outside any bulk.
pub(super) fn part_at(place: Place, x_m: f64, y_m: f64) -> Part {
    Part { x_m, y_m, ..Part::at_rest(place, 0, 0.0) }
}

fn bulk(settings: BulkSettings) -> PartBulk {
    PartBulk::new(TrayGeometry::PAPER, disc(0.006, 0.2), settings, 1).unwrap()
}

fn shaking(count: u32) -> MotionBlock {
    let samples = (0..count).map(|index| {
        let phase = f64::from(index % 40) * 0.05 * std::f64::consts::PI;
        MotionSample {
            acceleration: Vector3::new(1.6 * phase.sin(), 0.4 * phase.cos(), 30.0 * phase.cos()),
            velocity: Vector3::new(0.0, 0.0, 0.1 * phase.sin()),
            ..MotionSample::default()
        }
    });
    MotionBlock { sample_period_s: 5e-4, samples: samples.collect() }
}

fn resting(count: usize) -> MotionBlock {
    MotionBlock { sample_period_s: 5e-4, samples: vec![MotionSample::default(); count] }
}

#[test]
fn skipping_parts_at_rest_changes_nothing() {
    let mut skipping = bulk(BulkSettings::default());
    skipping.load(30);
    let mut plain = skipping.clone();
    let mut skipped = 0;
    for sample in resting(10).samples.iter().chain(&shaking(400).samples).chain(&resting(400).samples) {
        let block = MotionBlock { sample_period_s: 5e-4, samples: vec![*sample] };
        skipping.step(&block).unwrap();
        plain.hold_m_s2 = None;
        plain.step(&block).unwrap();
        assert_eq!(skipping.parts, plain.parts);
        skipped += u32::from(skipping.hold_m_s2.is_some());
    }
    assert!((100..700).contains(&skipped), "{skipped}");
}

#[test]
fn verif_a_sliding_part_pushes_one_at_rest_as_far_as_momentum_says() {
    // Touching at speed u, both go on at u/2 and stop after u²/(8 μ g).
    let settings = BulkSettings { part_restitution: 0.0, ..BulkSettings::default() };
    let mut bulk = bulk(settings);
    // Along the tangent at ψ = 3π/2, a quarter millimetre apart.
    bulk.put(0.070, 1.5 * PI, 0.0, 0).unwrap();
    let gap_m = 0.25e-3;
    let (x_m, y_m) = (-(0.006_f64 + gap_m), -0.070_f64);
    bulk.put(x_m.hypot(y_m), y_m.atan2(x_m) + TAU, 0.0, 0).unwrap();
    let speed = 0.1;
    bulk.parts[1].velocity_x_m_s = speed;
    bulk.parts_changed();
    bulk.step(&resting(400)).unwrap();
    let grip = 0.2 * STANDARD_GRAVITY_M_S2;
    let touching_squared = speed * speed - 2.0 * grip * gap_m;
    let expected_m = touching_squared / (8.0 * grip);
    let pushed_m = bulk.parts[0].x_m;
    assert!(bulk.parts.iter().all(Part::is_sticking));
    // The impact is noticed up to a sample late: 0.1 m/s × 0.5 ms.
    assert!((pushed_m - expected_m).abs() < 5e-5, "{pushed_m} m, expected {expected_m} m");
}

#[test]
fn a_falling_part_waits_until_the_foot_of_the_ramp_is_free() {
    let settings = BulkSettings { landing_scatter_m: 0.0, landing_length_m: 0.0, ..BulkSettings::default() };
    let mut bulk = bulk(settings);
    bulk.put(0.080, 0.05, 0.0, 0).unwrap();
    bulk.put(0.080, 6.2, 0.0, 0).unwrap();
    bulk.parts[1].y_m = 0.0;
    bulk.pass_edges();
    bulk.step(&resting(1000)).unwrap();
    assert_eq!(bulk.parts[1].place, Place::Falling);
    assert_eq!(bulk.counters.recirculated, 1);
    let gripper = |y_m: f64| OpenGripper { x_m: 0.080, y_m, yaw_rad: 0.0, opening_m: 0.008 };
    assert_eq!(bulk.pick(&gripper(0.0)), Err(Missed::Nothing), "a falling part was picked");
    bulk.pick(&gripper(0.004)).unwrap();
    bulk.step(&resting(20)).unwrap();
    assert_eq!((bulk.parts[0].place, bulk.falling), (Place::Ramp, 0));
    assert!((bulk.parts[0].y_m - 0.003).abs() < 1e-12);
    assert!(bulk.is_conserved());
}

#[test]
fn entering_the_plateau_counts_once_a_lap() {
    let mut bulk = bulk(BulkSettings::default());
    bulk.put(0.080, 3.13, 0.0, 0).unwrap();
    let mut cross = |angle_rad: f64, fed: u64, place: Place| {
        bulk.parts[0].x_m = 0.080 * angle_rad.cos();
        bulk.parts[0].y_m = 0.080 * angle_rad.sin();
        bulk.pass_edges();
        assert_eq!((bulk.counters.fed, bulk.parts[0].place), (fed, place));
    };
    cross(3.15, 1, Place::Plateau);
    cross(3.13, 1, Place::Ramp);
    cross(3.15, 1, Place::Plateau);
    cross(6.2, 1, Place::Plateau);
    cross(0.0, 1, Place::Falling);
    bulk.step(&resting(250)).unwrap();
    assert_eq!((bulk.parts[0].place, bulk.parts[0].fed), (Place::Ramp, false));
}

#[test]
fn a_part_that_is_put_elsewhere_is_a_new_one_and_its_own_place_is_free() {
    let mut bulk = bulk(BulkSettings::default());
    let first = bulk.put(0.070, 5.0, 0.0, 0).unwrap();
    let other = bulk.put(0.070, 5.2, 0.0, 0).unwrap();
    let before = bulk.parts.clone();
    assert_eq!(bulk.replace(first, 0.070, 5.2, 0.0, 0), Err(PutError::NoRoom { radius_m: 0.070, angle_rad: 5.2 }));
    assert_eq!(bulk.replace(7, 0.070, 5.0, 0.0, 0), Err(PutError::NoSuchPart { id: 7 }));
    assert_eq!(bulk.parts, before, "who is refused changes nothing");
    let moved = bulk.replace(first, 0.0705, 5.0, 0.3, 1).unwrap();
    assert!(moved > other);
    let part = bulk.parts.last().unwrap();
    assert_eq!((part.id, part.pose, part.yaw_rad, bulk.parts.len()), (moved, 1, 0.3, 2));
    assert!(bulk.remove(other) && !bulk.remove(other));
    assert_eq!((bulk.counters.loaded, bulk.counters.removed, bulk.counters.picked), (3, 2, 0));
    assert!(bulk.is_conserved());
}

#[test]
fn a_falling_part_that_is_taken_away_does_not_land() {
    let settings = BulkSettings { landing_scatter_m: 0.0, landing_length_m: 0.0, ..BulkSettings::default() };
    let mut bulk = bulk(settings);
    let falling = bulk.put(0.080, 6.2, 0.0, 0).unwrap();
    bulk.parts[0].y_m = 0.0;
    bulk.pass_edges();
    assert_eq!((bulk.parts[0].place, bulk.falling), (Place::Falling, 1));
    assert!(bulk.remove(falling));
    assert_eq!(bulk.falling, 0);
    bulk.step(&resting(1000)).unwrap();
    assert!(bulk.parts.is_empty() && bulk.is_conserved());
}
