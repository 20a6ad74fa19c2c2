//! What the driver knows of the courier's motion, against the truth.

#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use feeder_control::courier::{
    CourierConfig, DriverEvent, DriverStatus, EstimatorParameters, GoalOutcome, Trajectory, TrajectoryPoint,
};
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, SimulatedDriver, assumed_motor};
use feeder_sim::motor::{FaultHooks, MotorParameters, Window};
use nalgebra::Vector3;

/// Servo ticks in a second.
const SECOND: usize = 2000;

/// The assumed motor with a sensor that is noisy and coarse, but well calibrated.
fn calibrated() -> MotorParameters {
    MotorParameters { sensor_scale_error: 0.0, sensor_periodic_error_m: 0.0, ..assumed_motor() }
}

fn driver(motor: MotorParameters, estimator: EstimatorParameters) -> SimulatedDriver {
    let config = CourierConfig { estimator, ..CourierConfig::default() };
    SimulatedCourier { config, motor }.driver(1).unwrap()
}

fn to(duration_s: f64, x_m: f64) -> Trajectory {
    Trajectory { points: vec![TrajectoryPoint::at_rest(duration_s, Vector3::new(x_m, 0.1, 0.01))] }
}

fn vibrate(driver: &mut SimulatedDriver) {
    driver.set_waveform(&Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.87).unwrap(), true).unwrap();
}

/// Errors of the estimate over so many ticks: position and velocity, rms per axis, and the share of those that lie within
/// three standard deviations.
struct Errors {
    position_rms: Vector3<f64>,
    velocity_rms: Vector3<f64>,
    within: f64,
}

fn errors(driver: &mut SimulatedDriver, ticks: usize) -> Errors {
    let (mut position, mut velocity, mut within) = (Vector3::zeros(), Vector3::zeros(), 0_u32);
    for _ in 0..ticks {
        let status = driver.step(1).status;
        let (true_position, true_velocity) = driver.motor_mut().motion();
        let off = status.position - true_position;
        let drift = status.velocity - true_velocity;
        position += off.component_mul(&off);
        velocity += drift.component_mul(&drift);
        for axis in 0..3 {
            within += u32::from(off[axis].powi(2) <= 9.0 * status.position_variance[axis]);
            within += u32::from(drift[axis].powi(2) <= 9.0 * status.velocity_variance[axis]);
        }
    }
    let root = |sum: Vector3<f64>| (sum / ticks as f64).map(f64::sqrt);
    Errors {
        position_rms: root(position),
        velocity_rms: root(velocity),
        within: f64::from(within) / (6 * ticks) as f64,
    }
}

#[test]
fn verif_the_estimate_is_as_good_as_it_says_at_rest_in_a_move_and_in_vibration() {
    let mut driver = driver(calibrated(), EstimatorParameters::default());
    driver.step(SECOND);
    let rest = errors(&mut driver, SECOND);
    driver.execute(1, &to(1.0, 0.3)).unwrap();
    let moving = errors(&mut driver, SECOND);
    vibrate(&mut driver);
    let vibrating = errors(&mut driver, SECOND);
    for (name, found, velocity_m_s, turn_rad_s) in
        [("rest", &rest, 0.15e-3, 1.5e-3), ("moving", &moving, 0.3e-3, 3e-3), ("vibrating", &vibrating, 0.3e-3, 50e-3)]
    {
        // Better than the sensor's own noise of 0.21 µm and 2.3 µrad by filtering, at least where nothing shakes.
        assert!(found.position_rms.xy().max() < 0.25e-6 && found.position_rms.z < 10e-6, "{name}");
        assert!(found.velocity_rms.xy().max() < velocity_m_s && found.velocity_rms.z < turn_rad_s, "{name}");
        assert!(found.within > 0.97, "{name}");
    }
}

#[test]
fn errors_of_calibration_are_in_the_estimate_and_not_in_the_drivers_own_figures() {
    let motor = MotorParameters { sensor_scale_error: 0.005, sensor_periodic_error_m: 20e-6, ..assumed_motor() };
    let [plain, off] = [calibrated(), motor].map(|motor| {
        let mut driver = driver(motor, EstimatorParameters::default());
        driver.execute(1, &to(1.0, 0.3)).unwrap();
        let mut events = driver.step(SECOND).events;
        let output = driver.step(SECOND / 2);
        events.extend(output.events);
        assert!(matches!(events[..], [DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)]), "{events:?}");
        let unknown = output.status.position - driver.motor_mut().motion().0;
        (output.status, unknown)
    });
    let own = |status: &DriverStatus| status.tracking_error_peak.xy().norm();
    // 0.5 % of 300 mm, a periodic error beside it.
    assert!((off.1.x - 1.5e-3).abs() < 30e-6 && plain.1.x.abs() < 1e-6, "{} {}", off.1, plain.1);
    assert!(own(&off.0) < 2.0 * own(&plain.0) + 1e-6 && own(&off.0) < 5e-6, "{} {}", own(&off.0), own(&plain.0));
    assert!((off.0.position.x - 0.3).abs() < 5e-6, "{}", off.0.position);
    assert!(off.0.position_variance.x.sqrt() < 1e-6);
}

#[test]
fn without_readings_the_estimate_goes_on_and_says_how_unsure_it_is() {
    let dropout = Window { from_s: 0.5, to_s: 0.502 };
    let faults = FaultHooks { sensor_dropout: Some(dropout), ..FaultHooks::NONE };
    let mut driver = driver(MotorParameters { faults, ..calibrated() }, EstimatorParameters::default());
    driver.execute(1, &to(1.0, 0.3)).unwrap();
    let sure = driver.step(SECOND / 2).status.position_variance.x;
    let mut last = sure;
    for _ in 0..4 {
        let status = driver.step(1).status;
        assert!(status.position_variance.x > last, "{last}");
        last = status.position_variance.x;
        let off = status.position - driver.motor_mut().motion().0;
        assert!(off.x.powi(2) < 9.0 * last && off.x.abs() < 5e-6, "{off} {last}");
    }
    let status = driver.step(20).status;
    assert!(status.fault.is_none() && status.position_variance.x < 1.2 * sure, "{status:?}");
}

#[test]
fn a_sensor_ten_times_as_noisy_is_sane_whether_the_driver_knows_it_or_not() {
    let motor = MotorParameters { sensor_noise_m_rms: 2e-6, ..calibrated() };
    let told =
        EstimatorParameters { sensor_noise_m_rms: 2e-6, sensor_noise_rad_rms: 23e-6, ..EstimatorParameters::default() };
    for (name, estimator) in [("told", told), ("not told", EstimatorParameters::default())] {
        let mut driver = driver(motor, estimator);
        driver.execute(1, &to(1.0, 0.3)).unwrap();
        let output = driver.step(SECOND + SECOND / 2);
        assert!(matches!(output.events[..], [DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)]), "{output:?}");
        vibrate(&mut driver);
        let output = driver.step(SECOND);
        assert!(output.status.fault.is_none(), "{name}: {output:?}");
        driver.halt();
        driver.step(SECOND / 2);
        let rest = errors(&mut driver, SECOND);
        driver.emergency_stop();
        driver.step(SECOND / 2);
        // One that takes noise for motion may have to be asked again.
        assert!(
            (0..20).any(|_| {
                driver.step(20);
                driver.reset_fault().is_ok()
            }),
            "{name}"
        );
        if name == "told" {
            assert!(rest.position_rms.xy().max() < 2e-6 && rest.within > 0.97);
        }
    }
}
