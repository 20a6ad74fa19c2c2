//! Moves against theory and table.

use std::f64::consts::TAU;

use feeder_control::courier::{CourierConfig, CourierLimits};
use feeder_control::delivery::{
    GentleParameters, MovePlan, MovePlanner, Surroundings, Tether, holding_acceleration_m_s2,
};
use feeder_control::platen::Area;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::{AnnularTrack, PartState};
use feeder_model::motion::MotionSample;
use feeder_model::motor::Load;
use feeder_model::tray::TrayGeometry;
use feeder_scenario::{SimulatedCourier, assumed_motor};
use feeder_sim::motor::MotorParameters;
use nalgebra::{Rotation2, Vector2, Vector3};
use proptest::prelude::*;

fn planner(gentle: GentleParameters) -> MovePlanner {
    // A platen long enough for every row of the table.
    let limits = CourierLimits { x_m_min: -1.0, x_m_max: 1.0, ..CourierLimits::default() };
    MovePlanner::new(gentle, TrayGeometry::PAPER, limits, Load::default()).unwrap()
}

fn along_x(distance_m: f64) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::zeros(), Vector3::new(distance_m, 0.0, 0.0))
}

/// Where a part on the ramp half way up faces uphill along -x and downhill along +x.
fn half_way_up(radius_m: f64) -> Vector2<f64> {
    Vector2::new(0.0, radius_m)
}

#[test]
fn verif_move_times_match_the_reference_table() {
    let table = include_str!("../../../model/tests/data/gentle_delivery.csv");
    let mut rows = 0;
    for row in table.lines().filter(|line| line.starts_with("plateau") || line.starts_with("ramp")) {
        let (surface, numbers) = row.split_once(',').unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|field| field.parse().unwrap()).collect();
        let [friction, limit_m_s2, distance_mm, bang_bang_s, j200_s, j100_s, j50_s, ..] = numbers[..] else {
            panic!("{row}")
        };
        let (from, to) = along_x(distance_mm * 1e-3);
        if surface.starts_with("plateau") {
            for (jerk_m_s3_max, expected_s) in [(200.0, j200_s), (100.0, j100_s), (50.0, j50_s)] {
                let gentle = GentleParameters { friction, jerk_m_s3_max, ..GentleParameters::default() };
                let plan = planner(gentle).plan(from, to, &[]).unwrap();
                // The same closed forms, to rounding.
                assert!((plan.bound_s - bang_bang_s).abs() < 1e-9, "{row}");
                assert!((plan.jerk_bound_s - expected_s).abs() < 1e-9, "{row}: {}", plan.jerk_bound_s);
                // Required; 3 % less acceleration than friction holds costs 1.5 % of time.
                assert!(plan.duration_s <= 1.03 * plan.jerk_bound_s, "{row}");
                assert!(plan.peak_acceleration_m_s2 <= limit_m_s2);
            }
        } else {
            let radius_m = surface.split_once("r=").unwrap().1[..2].parse::<f64>().unwrap() * 1e-3;
            let (tray, uphill) = (TrayGeometry::PAPER, -Vector2::x());
            let held = holding_acceleration_m_s2(&tray, &half_way_up(radius_m), &uphill, friction, 9.81).unwrap();
            assert!((held - limit_m_s2).abs() < 1e-9, "{row}: {held}");
        }
        rows += 1;
    }
    assert_eq!(rows, 64);
}

#[test]
fn verif_selected_moves_stay_near_the_jerk_limited_bound() {
    for friction in [0.15, 0.2, 0.3] {
        for distance_mm in [20.0, 50.0, 100.0, 300.0, 600.0] {
            let (from, to) = along_x(distance_mm * 1e-3);
            let gentle = GentleParameters { friction, ..GentleParameters::default() };
            let plan = planner(gentle).plan(from, to, &[Vector2::new(0.0, -0.07)]).unwrap();
            assert!(plan.duration_s <= 1.03 * plan.jerk_bound_s, "{friction} {distance_mm}");
        }
    }
    let (from, to) = along_x(0.3);
    let plan = planner(GentleParameters::default()).plan(from, to, &[]).unwrap();
    assert!(plan.duration_s <= 1.05 * plan.bound_s);
}

#[test]
fn verif_protecting_a_part_on_the_ramp_uses_its_unequal_limits() {
    // 300 mm at μ 0.2 and r 90 mm: 0.838 s with unequal acceleration and braking, whichever comes first.
    for sign in [1.0, -1.0] {
        let (from, to) = along_x(0.3 * sign);
        let plan = planner(GentleParameters::default()).plan(from, to, &[half_way_up(0.09)]).unwrap();
        assert!((plan.bound_s - 0.838).abs() < 5e-4, "{}", plan.bound_s);
        assert!(plan.duration_s <= 1.03 * plan.jerk_bound_s);
    }
    // With a part on the plateau as well, braking is limited to μ g.
    let (from, to) = along_x(-0.3);
    let plan = planner(GentleParameters::default()).plan(from, to, &[half_way_up(0.09), -half_way_up(0.06)]).unwrap();
    let expected_s = (0.6 * (1.0 / 1.250_4 + 1.0 / 1.962_f64)).sqrt();
    assert!((plan.bound_s - expected_s).abs() < 1e-3, "{}", plan.bound_s);
}

#[test]
fn a_move_that_cannot_be_is_refused_with_the_reason() {
    let planner = planner(GentleParameters::default());
    let refused =
        |to: Vector3<f64>, parts: &[Vector2<f64>]| planner.plan(Vector3::zeros(), to, parts).unwrap_err().to_string();
    assert!(refused(Vector3::new(2.0, 0.0, 0.0), &[]).contains("courier_x"));
    assert!(refused(Vector3::new(f64::NAN, 0.0, 0.0), &[]).contains("courier_x"));
    assert!(refused(Vector3::zeros(), &[]).contains("already"));
    assert!(refused(Vector3::new(0.1, 0.0, 0.04), &[]).contains("yaw"));
    assert!(refused(Vector3::new(0.1, 0.0, 0.0), &[half_way_up(0.031)]).contains("at rest"));
}

/// A post in the way, so that the route has corners.
fn around_a_post() -> MovePlanner {
    let keep_out = vec![Area::disc(Vector2::new(0.2, 0.01), 0.05)];
    planner(GentleParameters::default()).among(Surroundings { keep_out, ..Surroundings::default() }).unwrap()
}

/// What the driver makes of a plan, tick by tick.
fn executed(from: Vector3<f64>, plan: &MovePlan) -> Vec<MotionSample> {
    let config = CourierConfig { start: from, ..CourierConfig::default() };
    let mut driver = SimulatedCourier { config, ..SimulatedCourier::default() }.driver(1).unwrap();
    driver.execute(1, &plan.trajectory()).unwrap();
    let mut samples = Vec::new();
    loop {
        let step = driver.step(1);
        if !step.status.moving {
            return samples;
        }
        samples.extend(driver.motor_mut().take_block().samples);
    }
}

/// How hard a part at `part` is pushed about in the tray's frame, and how hard it may be, as a share.
fn share_of_hold(sample: &MotionSample, part: &Vector2<f64>, friction: f64) -> f64 {
    let (spin, turn) = (sample.velocity.z, sample.acceleration.z);
    let courier = Rotation2::new(-sample.position.z) * sample.acceleration.xy();
    let a = courier + turn * Vector2::new(-part.y, part.x) - spin * spin * part;
    if a.norm() < 1e-6 {
        return 0.0;
    }
    a.norm() / holding_acceleration_m_s2(&TrayGeometry::PAPER, part, &(a / a.norm()), friction, 9.81).unwrap()
}

#[test]
fn a_route_round_a_post_keeps_clear_holds_the_parts_and_rounds_its_corners() {
    let (from, to) = (Vector3::zeros(), Vector3::new(0.4, 0.0, 0.0));
    for parts in [vec![Vector2::new(0.0, -0.07)], vec![half_way_up(0.08), Vector2::new(0.06, -0.03)]] {
        let plan = around_a_post().plan(from, to, &parts).unwrap();
        assert!(plan.route_m.len() > 2, "{:?}", plan.route_m);
        let samples = executed(from, &plan);
        for sample in &samples {
            let clear_m = (sample.position.xy() - Vector2::new(0.2, 0.01)).norm() - 0.05 - 0.1;
            assert!(clear_m >= -1e-5, "{clear_m}");
            for part in &parts {
                assert!(share_of_hold(sample, part, 0.2) <= 0.98, "{sample:?}");
            }
        }
        // Stopping at each corner takes longer than rounding it.
        let legs = plan.route_m.windows(2).map(|pair| {
            let at = |point: &Vector2<f64>| Vector3::new(point.x, point.y, 0.0);
            planner(GentleParameters::default()).plan(at(&pair[0]), at(&pair[1]), &parts).unwrap().duration_s
        });
        let stop_and_go_s: f64 = legs.sum();
        assert!(plan.duration_s < 0.9 * stop_and_go_s, "{} s against {stop_and_go_s} s", plan.duration_s);
        // And no way is quicker than the straight one.
        assert!(plan.duration_s > plan.jerk_bound_s);
    }
}

#[test]
fn a_tether_and_keep_out_areas_forbid_places() {
    let tether = Some(Tether { anchor_m: Vector2::new(-0.5, 0.0), length_m: 0.8 });
    let tied = planner(GentleParameters::default()).among(Surroundings { tether, ..Surroundings::default() }).unwrap();
    let refused = |planner: &MovePlanner, x_m| {
        planner.plan(Vector3::zeros(), Vector3::new(x_m, 0.0, 0.0), &[]).unwrap_err().to_string()
    };
    assert!(refused(&tied, 0.4).contains("0.9000 m long, but is 0.8 m"));
    assert!(tied.plan(Vector3::zeros(), Vector3::new(0.25, 0.0, 0.0), &[]).is_ok());
    assert!(refused(&around_a_post(), 0.25).contains("keep-out area 0"));
}

proptest! {
    /// Moves that turn hold every part too: with the turn's own acceleration and the centripetal one, as executed.
    #[test]
    fn moves_that_turn_hold_the_parts(
        x_m in -0.4..0.4, y_m in -0.4..0.4, from_rad in -0.034..0.034, to_rad in -0.034..0.034,
        parts in prop::collection::vec((0.065..0.088, 0.0..6.2), 1..4),
    ) {
        let turn: f64 = to_rad - from_rad;
        prop_assume!(turn.abs() > 1e-3);
        let parts: Vec<_> = parts.iter().map(|&(r, psi): &(f64, f64)| Vector2::new(psi.cos(), psi.sin()) * r).collect();
        let (from, to) = (Vector3::new(0.0, 0.0, from_rad), Vector3::new(x_m, y_m, to_rad));
        let plan = planner(GentleParameters::default()).plan(from, to, &parts).unwrap();
        let samples = executed(from, &plan);
        for part in &parts {
            for sample in &samples {
                prop_assert!(share_of_hold(sample, part, 0.2) <= 0.985);
            }
        }
        let last = samples.last().unwrap().position;
        prop_assert!((last - to).norm() < 1e-5);
    }
}

/// Largest displacement of a part in the tray while the courier moves, m.
fn slip_m(motor: MotorParameters, friction_share: f64, to: Vector3<f64>, part: Vector2<f64>, seed: u64) -> f64 {
    let courier = SimulatedCourier { motor, ..SimulatedCourier::default() };
    let mut driver = courier.driver(seed).unwrap();
    let gentle = GentleParameters { friction_share, ..GentleParameters::default() };
    let plan = planner(gentle).plan(Vector3::zeros(), to, &[part]).unwrap();
    driver.execute(1, &plan.trajectory()).unwrap();
    let friction = Friction::uniform(gentle.friction).unwrap();
    let track = AnnularTrack::new(TrayGeometry::PAPER, friction, gentle.gravity_m_s2).unwrap();
    let start = PartState::at_rest(part.norm(), part.y.atan2(part.x).rem_euclid(TAU));
    let (mut state, mut slip_m) = (start, 0.0_f64);
    driver.step(3000);
    for sample in driver.motor_mut().take_block().samples {
        track.step(&mut state, &sample, 0.5e-3);
        let along_m = (state.angle_rad - start.angle_rad) * start.radius_m;
        slip_m = slip_m.max(along_m.hypot(state.radius_m - start.radius_m));
    }
    slip_m
}

#[test]
fn verif_parts_stay_where_they_are_and_slide_when_the_limit_is_set_too_high() {
    let parts = [Vector2::new(0.0, -0.07), Vector2::new(0.05, -0.03), half_way_up(0.085)];
    for (index, part) in parts.into_iter().enumerate() {
        for (x_m, y_m) in [(0.3, 0.0), (-0.3, 0.0), (0.2, -0.2), (0.05, 0.02)] {
            let to = Vector3::new(x_m, y_m, 0.0);
            // 10 µm is required; the assumed plant's noise and lag cost a few.
            for motor in [MotorParameters::IDEAL, assumed_motor()] {
                let slip_m = slip_m(motor, GentleParameters::default().friction_share, to, part, index as u64);
                assert!(slip_m <= 10e-6, "{part} {to}: {slip_m}");
            }
            let slip_m = slip_m(assumed_motor(), 1.2, to, part, index as u64);
            assert!(slip_m > 0.1e-3, "{part} {to}: {slip_m}");
        }
    }
}

proptest! {
    /// The driver's interpolation of a planned trajectory keeps to the friction limit and to the stated move, on the
    /// ideal plant, tick by tick.
    #[test]
    fn planned_moves_are_executed_within_the_friction_limit(
        x_m in -0.45..0.45, y_m in -0.45..0.45, friction in 0.1..0.4, jerk_m_s3_max in 20.0..300.0,
        ramp in prop::collection::vec((0.07..0.09, 0.0..3.1), 0..4),
    ) {
        prop_assume!(Vector2::new(x_m, y_m).norm() > 1e-3);
        let gentle = GentleParameters { friction, jerk_m_s3_max, ..GentleParameters::default() };
        let parts: Vec<_> = ramp.iter().map(|&(r, psi): &(f64, f64)| Vector2::new(psi.cos(), psi.sin()) * r).collect();
        let to = Vector3::new(x_m, y_m, 0.0);
        let plan = planner(gentle).plan(Vector3::zeros(), to, &parts).unwrap();
        let mut driver = SimulatedCourier::default().driver(1).unwrap();
        driver.execute(1, &plan.trajectory()).unwrap();
        let tray = TrayGeometry::PAPER;
        let samples = std::iter::from_fn(|| {
            let moving = driver.step(1).status.moving;
            let sample = driver.motor_mut().take_block().samples[0];
            moving.then_some(sample)
        });
        for sample in samples {
            let a = sample.acceleration.xy();
            // Feedback against rounding adds nothing to speak of.
            if a.norm() > 1e-6 {
                let held = parts
                    .iter()
                    .map(|part| holding_acceleration_m_s2(&tray, part, &(a / a.norm()), friction, 9.81).unwrap())
                    .fold(if parts.is_empty() { friction * 9.81 } else { f64::INFINITY }, f64::min);
                prop_assert!(a.norm() <= 0.98 * held);
            }
        }
        // Ticks average the jerk; what that leaves of the position, feedback takes away.
        driver.step(1);
        prop_assert!((driver.motor_mut().motion().0 - to).norm() < 1e-7);
    }
}
