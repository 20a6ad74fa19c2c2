//! A lone part on a vibrating tray.

use std::f64::consts::PI;

use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;
use feeder_sim::parts::{BulkSettings, PartBulk};

use crate::support::{G, YawVibration, bulk, bulk_of, settings, spec};

/// The paper's ramp and plateau, with the outer wall out of the way of a part at 90 mm.
const TRAY: TrayGeometry = TrayGeometry { outer_radius_m: 0.1, ..TrayGeometry::PAPER };
const ON_RAMP_RAD: f64 = 1.0;
const ON_PLATEAU_RAD: f64 = 4.0;

/// Mean speed (mm/s) along the path of a lone part in the steady state, with the samples of a perfect tracker.
///
/// All periods here divide 0.1 s, which is a whole number of samples.
fn feed_mm_s(vibration: &YawVibration, radius_m: f64, angle_rad: f64, samples_per_tenth_s: u32) -> f64 {
    let part = PartType::new(&spec(0.002, 0.2)).expect("a sound part");
    let mut bulk = PartBulk::new(TRAY, part, BulkSettings::default(), 1).expect("sound settings");
    bulk.put(radius_m, angle_rad, 0.0, 0).expect("room");
    let block = vibration.block(0, samples_per_tenth_s, 0.1 / f64::from(samples_per_tenth_s));
    let mut run = |tenths: u32| {
        for _ in 0..tenths {
            bulk.step(&block).expect("sound motion");
        }
        bulk.parts()[0].angle_rad()
    };
    let start_rad = run(10);
    let turned_rad = run(10) - start_rad;
    let slope_rad = if angle_rad < TRAY.ramp_angle_rad { TRAY.ramp_slope_rad(radius_m) } else { 0.0 };
    1e3 * radius_m * turned_rad / slope_rad.cos()
}

/// fig15_speed_vs_radius.csv: radius m, speed on the ramp and on the plateau in mm/s.
const FIG_15: [(f64, f64, f64); 3] =
    [(0.060, 0.291_633, 4.092_400), (0.080, 1.792_674, 7.056_473), (0.090, 2.196_802, 8.704_249)];

#[test]
fn verif_fig_15_ramp_at_servo_rate() {
    // On the ramp this waveform never lets the part stick, and averaging the acceleration over a sample changes
    // next to nothing. The case is ill-conditioned, so the tolerance is a share of μ g T = 65.4 mm/s.
    for (radius_m, ramp_mm_s, _) in FIG_15 {
        let feed = feed_mm_s(&YawVibration::paper(), radius_m, ON_RAMP_RAD, 200);
        let share = (feed - ramp_mm_s) / (0.2 * G * 1e3 / 30.0);
        assert!(share.abs() < 1e-4, "{feed} mm/s at {radius_m} m, expected {ramp_mm_s}");
    }
}

#[test]
fn verif_fig_15_plateau_loses_a_few_percent_at_servo_rate_and_converges() {
    for (radius_m, _, plateau_mm_s) in FIG_15 {
        let error = |samples_per_tenth_s| {
            let vibration = YawVibration::paper();
            feed_mm_s(&vibration, radius_m, ON_PLATEAU_RAD, samples_per_tenth_s) / plateau_mm_s - 1.0
        };
        // Switches fall inside samples of 0.5 ms, so the waveform that the part feels is blunted. The fine integrator
        // of `reference` loses as much.
        let at_2_khz = error(200);
        assert!((-0.045..-0.032).contains(&at_2_khz), "{at_2_khz} at {radius_m} m");
        let at_32_khz = error(3200);
        assert!(at_32_khz.abs() < 0.003, "{at_32_khz} at {radius_m} m");
    }
}

#[test]
fn verif_fig_15_critical_radius() {
    // 57.6 mm for ideal switching: inside, parts slide back.
    let vibration = YawVibration::paper();
    assert!(feed_mm_s(&vibration, 0.0565, ON_RAMP_RAD, 200) < 0.0);
    assert!(feed_mm_s(&vibration, 0.0590, ON_RAMP_RAD, 200) > 0.0);
}

#[test]
fn verif_optimal_waveform_of_a_tenth_of_a_second() {
    // longer_period.csv, hybrid, T = 0.1 s at 85 mm in two dimensions: 24.048 on the ramp, 29.066 on the plateau.
    let optimal = YawVibration::optimal(0.1, 0.085, TRAY.ramp_slope_rad(0.085), 0.2);
    for (angle_rad, table_mm_s) in [(ON_RAMP_RAD, 24.048), (ON_PLATEAU_RAD, 29.066)] {
        let at_2_khz = feed_mm_s(&optimal, 0.085, angle_rad, 200) / table_mm_s - 1.0;
        assert!((-0.04..0.0).contains(&at_2_khz), "{at_2_khz} at 2 kHz");
        let at_32_khz = feed_mm_s(&optimal, 0.085, angle_rad, 3200) / table_mm_s - 1.0;
        assert!(at_32_khz.abs() < 0.003, "{at_32_khz} at 32 kHz");
    }
}

#[test]
fn feed_grows_with_the_period() {
    // At given accelerations v is proportional to T, but for centrifugal effects that grow with T².
    let (least, most) = (9.0 * 0.2 * G, 66.7 * 0.2 * G);
    let short = YawVibration::stick_slip(0.025, least, most);
    let long = YawVibration::stick_slip(0.05, least, most);
    for angle_rad in [ON_RAMP_RAD, ON_PLATEAU_RAD] {
        let ratio = feed_mm_s(&long, 0.085, angle_rad, 400) / feed_mm_s(&short, 0.085, angle_rad, 800);
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
    }
}

#[test]
fn mass_changes_nothing() {
    let run = |density_kg_m3: f64| {
        let part = feeder_model::part::PartSpec { density_kg_m3, ..spec(0.006, 0.2) };
        let mut bulk = bulk_of(&part, settings(), 5);
        bulk.load(20);
        bulk.step(&YawVibration::paper().block(0, 2000, 5e-4)).unwrap();
        bulk.parts().to_vec()
    };
    assert_eq!(run(900.0), run(19_000.0));
}

#[test]
fn mirrored_motion_gives_the_mirror_image() {
    // Mirror the plateau about the tray's y axis: ψ → 3π − ψ.
    let run = |vibration: &YawVibration, angle_rad: f64| {
        let mut bulk = bulk(0.005, 1);
        bulk.put(0.080, angle_rad, 0.0, 0).unwrap();
        bulk.step(&vibration.block(0, 600, 5e-4)).unwrap();
        bulk.parts()[0]
    };
    let straight = run(&YawVibration::paper(), ON_PLATEAU_RAD);
    let mirrored = run(&YawVibration::paper().mirrored(), 3.0 * PI - ON_PLATEAU_RAD);
    assert!((straight.x_m + mirrored.x_m).abs() < 1e-12);
    assert!((straight.y_m - mirrored.y_m).abs() < 1e-12);
    assert!((straight.velocity_x_m_s + mirrored.velocity_x_m_s).abs() < 1e-10);
}
