//! Parts while the courier carries the tray: what slides, and how far.

use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::part::PartSpec;
use feeder_model::tray::TrayGeometry;
use feeder_sim::parts::{Part, PartBulk};
use nalgebra::{Rotation2, Vector2, Vector3};

use crate::support::{G, bulk, bulk_of, settings, spec, straight};

const ON_RAMP_RAD: f64 = 1.2;
const ON_PLATEAU_RAD: f64 = 4.4;
const RADIUS_M: f64 = 0.080;
/// The tray stands like this in the platen, so that the frames cannot be mixed up unnoticed.
const YAW_RAD: f64 = 0.7;

/// A part whose static friction is well above the kinetic.
fn sticky() -> PartSpec {
    PartSpec { friction_static: 0.25, friction_kinetic: 0.20, ..spec(0.002, 0.2) }
}

fn alone(part: &PartSpec, angle_rad: f64) -> PartBulk {
    let mut bulk = bulk_of(part, settings(), 1);
    bulk.put(RADIUS_M, angle_rad, 0.0, 0).expect("room");
    bulk
}

/// The part after `count` samples under an acceleration of the tray along (`outward`, `around`) at the part.
fn accelerated(angle_rad: f64, outward: f64, around: f64, count: u32) -> Part {
    let mut bulk = alone(&sticky(), angle_rad);
    let in_platen = Rotation2::new(angle_rad + YAW_RAD) * Vector2::new(outward, around);
    bulk.step(&straight(in_platen.x, in_platen.y, YAW_RAD, count)).expect("sound motion");
    bulk.parts()[0]
}

#[test]
fn verif_slip_threshold_on_the_plateau() {
    let limit = 0.25 * G;
    for direction in [0.0, 0.9, 2.5, 4.0_f64] {
        let (along, across) = (direction.cos(), direction.sin());
        let held = accelerated(ON_PLATEAU_RAD, 0.99 * limit * along, 0.99 * limit * across, 400);
        assert!(held.is_sticking());
        assert_eq!(held, alone(&sticky(), ON_PLATEAU_RAD).parts()[0], "moved below the limit");
        let slid = accelerated(ON_PLATEAU_RAD, 1.01 * limit * along, 1.01 * limit * across, 10);
        assert!(!slid.is_sticking());
    }
}

#[test]
fn verif_slip_thresholds_on_the_ramp() {
    // Uphill g tan(φ_f − φ), downhill g tan(φ_f + φ), radially g cos φ √(μ² − tan² φ), with the static friction.
    let slope_rad = TrayGeometry::PAPER.ramp_slope_rad(RADIUS_M);
    let friction_rad = 0.25_f64.atan();
    let uphill = G * (friction_rad - slope_rad).tan();
    let downhill = G * (friction_rad + slope_rad).tan();
    let radial = G * slope_rad.cos() * (0.25_f64.powi(2) - slope_rad.tan().powi(2)).sqrt();
    for (outward, around) in [(0.0, uphill), (0.0, -downhill), (radial, 0.0), (-radial, 0.0)] {
        assert!(accelerated(ON_RAMP_RAD, 0.999 * outward, 0.999 * around, 50).is_sticking());
        assert!(!accelerated(ON_RAMP_RAD, 1.001 * outward, 1.001 * around, 50).is_sticking());
    }
}

#[test]
fn verif_slip_distance_is_the_closed_form() {
    // Slides against (1.01 μ_s − μ_k) g for 40 ms, then against μ_k g until it stops.
    let (start, slip, stop) = (1.01 * 0.25 * G, (1.01 * 0.25 - 0.2) * G, 0.2 * G);
    let mut bulk = alone(&sticky(), ON_PLATEAU_RAD);
    let before = bulk.parts()[0].position_m();
    bulk.step(&straight(start, 0.0, YAW_RAD, 80)).unwrap();
    bulk.step(&straight(0.0, 0.0, YAW_RAD, 80)).unwrap();
    let part = bulk.parts()[0];
    assert!(part.is_sticking());
    let speed = slip * 0.04;
    let distance_m = 0.5 * speed * 0.04 + 0.5 * speed * speed / stop;
    let expected = Rotation2::new(-YAW_RAD) * Vector2::new(-distance_m, 0.0);
    assert!((part.position_m() - before - expected).norm() < 1e-9 * distance_m);
}

#[test]
fn verif_a_steady_turn_throws_parts_at_the_friction_limit() {
    let limit_rad_s = (0.25 * G / RADIUS_M).sqrt();
    for (share, sticks) in [(0.999, true), (1.001, false)] {
        let mut bulk = alone(&sticky(), ON_PLATEAU_RAD);
        let sample = MotionSample { velocity: Vector3::new(0.0, 0.0, share * limit_rad_s), ..MotionSample::default() };
        let block = MotionBlock { sample_period_s: 5e-4, samples: vec![sample; 4] };
        bulk.step(&block).unwrap();
        let part = bulk.parts()[0];
        assert_eq!(part.is_sticking(), sticks);
        assert!(sticks || part.radial_velocity_m_s() > 0.0);
    }
}

#[test]
fn verif_a_tray_at_rest_lets_parts_slide_only_inside_31_8_mm() {
    // c/μ = 31.83 mm for μ = 0.2: steeper than the angle of friction inside.
    let mut bulk = bulk(0.002, 1);
    bulk.put(0.0316, 2.0, 0.0, 0).unwrap();
    bulk.put(0.0321, 1.0, 0.0, 0).unwrap();
    bulk.step(&straight(0.0, 0.0, 0.0, 2000)).unwrap();
    assert!(bulk.parts()[0].angle_rad() < 1.99);
    assert!((bulk.parts()[1].angle_rad() - 1.0).abs() < 1e-12);
}

#[test]
fn nothing_moves_below_the_least_of_all_limits_even_in_a_crowd() {
    let mut bulk = bulk(0.006, 1);
    bulk.load(40);
    let before = bulk.parts().to_vec();
    let slope_rad = TrayGeometry::PAPER.ramp_slope_rad(0.075);
    let limit = G * (0.2_f64.atan() - slope_rad).tan();
    for direction in [0.3, 2.0, 4.5_f64] {
        let (x, y) = (0.99 * limit * direction.cos(), 0.99 * limit * direction.sin());
        bulk.step(&straight(x, y, YAW_RAD, 500)).unwrap();
    }
    assert_eq!(bulk.parts(), before);
}
