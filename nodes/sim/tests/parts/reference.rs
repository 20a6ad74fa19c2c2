//! The bulk against the independent integrator of the mechanics: fourth-order Runge-Kutta in polar coordinates, with steps
//! far shorter than a servo sample.

use std::f64::consts::TAU;

use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::tray::TrayGeometry;
use nalgebra::Vector3;

use crate::rk4::Rk4;
use crate::support::{G, YawVibration, bulk};

const FRICTION: f64 = 0.2;

/// Runs bulk and reference through the same motion. Returns how far apart they end (m) and how far the part went (m).
fn compare(block: &MotionBlock, radius_m: f64, angle_rad: f64, steps: u32) -> (f64, f64) {
    let tray = TrayGeometry::PAPER;
    let mut bulk = bulk(0.002, 1);
    bulk.put(radius_m, angle_rad, 0.0, 0).expect("room");
    bulk.step(block).expect("sound motion");
    let part = bulk.parts()[0];
    let reference = Rk4 { tray, friction: FRICTION, gravity_m_s2: G };
    let sample_s = block.sample_period_s;
    let follow = |state, sample| reference.follow(state, sample, sample_s, sample_s / f64::from(steps));
    let [r, psi, ..] = block.samples.iter().fold([radius_m, angle_rad, 0.0, 0.0], follow);
    let around = (part.angle_rad() - psi + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
    let apart = (part.radius_m() - r).hypot(r * around);
    let went = (r - radius_m).hypot(radius_m * (psi - angle_rad));
    (apart, went)
}

/// A smooth tour that turns and translates at once, hard enough to make parts slide in every direction.
fn tour(sample_period_s: f64, count: u32) -> MotionBlock {
    let velocity = |t: f64| Vector3::new(0.19 * (19.0 * t).cos(), -0.184 * (23.0 * t).sin(), 0.9 * (29.0 * t).cos());
    let position =
        |t: f64| Vector3::new(0.01 * (19.0 * t).sin(), 0.008 * (23.0 * t).cos(), 0.9 / 29.0 * (29.0 * t).sin());
    let samples = (0..count).map(|index| {
        let t = f64::from(index) * sample_period_s;
        MotionSample {
            position: position(t),
            velocity: velocity(t),
            acceleration: (velocity(t + sample_period_s) - velocity(t)) / sample_period_s,
        }
    });
    MotionBlock { sample_period_s, samples: samples.collect() }
}

#[test]
fn verif_vibration_agrees_with_the_fine_integrator() {
    // Both follow the same samples, so what is left is the bulk's one step a sample against 500 of the reference:
    // measured at most 0.7 µm in 2 mm (T = 1/30 s) and 15 µm in 10 mm (T = 0.1 s), in half a second.
    let slope_rad = TrayGeometry::PAPER.ramp_slope_rad(0.085);
    let optimal = YawVibration::optimal(0.1, 0.085, slope_rad, FRICTION);
    for (vibration, tolerance_m) in [(YawVibration::paper(), 1.5e-6), (optimal, 3e-5)] {
        let block = vibration.block(0, 1000, 5e-4);
        for (radius_m, angle_rad) in [(0.085, 1.0), (0.060, 2.0), (0.085, 4.0)] {
            let (apart_m, _) = compare(&block, radius_m, angle_rad, 500);
            assert!(apart_m < tolerance_m, "{apart_m} m apart at {radius_m} m, {angle_rad} rad");
        }
    }
}

#[test]
fn verif_turning_and_translating_converges_to_the_fine_integrator() {
    // Parts swept up to 50 mm over ramp and plateau in every direction. One step a sample is first-order where the
    // friction turns: the distance to the reference halves with the sample period.
    for (radius_m, angle_rad) in [(0.080, 1.0), (0.060, 2.0), (0.070, 4.0)] {
        let distance =
            |period_s: f64, count: u32, steps: u32| compare(&tour(period_s, count), radius_m, angle_rad, steps);
        let (at_2_khz_m, went_m) = distance(5e-4, 800, 500);
        let (at_16_khz_m, _) = distance(6.25e-5, 6400, 62);
        assert!(went_m > 0.02, "went {went_m} m");
        assert!(at_2_khz_m < 0.004 * went_m, "{at_2_khz_m} m apart after {went_m} m");
        assert!(at_16_khz_m < 0.2 * at_2_khz_m, "{at_16_khz_m} m after {at_2_khz_m} m");
    }
}
