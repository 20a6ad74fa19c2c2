//! The courier driver as its node sees it: commands in, motion out.

#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use feeder_control::courier::{
    CourierConfig, Driver, DriverEvent, DriverStatus, Fault, GoalOutcome, Rejection, Trajectory, TrajectoryPoint,
    VibrationPhase,
};
use feeder_model::motion::MotionSample;
use feeder_model::motor::{PlanarMotor, Wrench};
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, SimulatedDriver, assumed_motor};
use feeder_sim::motor::{MotorParameters, SimulatedMotor};
use nalgebra::Vector3;
use proptest::prelude::*;

/// Servo ticks in 10 ms.
const BLOCK: usize = 20;

fn driver() -> SimulatedDriver {
    SimulatedCourier::default().driver(1).unwrap()
}

fn paper_waveform() -> Waveform {
    Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 9.0 * 1.962, 66.7 * 1.962).unwrap()
}

fn at_rest(time_s: f64, x_m: f64, y_m: f64) -> TrajectoryPoint {
    let zero = Some(Vector3::zeros());
    TrajectoryPoint { time_s, position: Vector3::new(x_m, y_m, 0.0), velocity: zero, acceleration: zero }
}

fn run(driver: &mut SimulatedDriver, blocks: usize) -> (DriverStatus, Vec<DriverEvent>) {
    let mut events = Vec::new();
    let mut status = None;
    for _ in 0..blocks {
        let output = driver.step(BLOCK);
        events.extend(output.events);
        status = Some(output.status);
    }
    (status.unwrap(), events)
}

/// Runs so many servo ticks and gives the true motion in them.
fn truth(driver: &mut SimulatedDriver, ticks: usize) -> Vec<MotionSample> {
    driver.motor_mut().take_block();
    driver.step(ticks);
    driver.motor_mut().take_block().samples
}

/// A plant that can be held fast or lose its sensor.
struct Faulty {
    inner: SimulatedMotor,
    frozen: bool,
    blind: bool,
}

impl PlanarMotor for Faulty {
    fn step(&mut self, command: Wrench, duration_s: f64) {
        if !self.frozen {
            self.inner.step(command, duration_s);
        }
    }
    fn measure(&mut self) -> Vector3<f64> {
        if self.blind { Vector3::repeat(f64::NAN) } else { self.inner.measure() }
    }
    fn set_air(&mut self, on: bool) {
        self.inner.set_air(on);
    }
}

fn faulty() -> Driver<Faulty> {
    let inner = SimulatedMotor::new(MotorParameters::IDEAL, Vector3::zeros(), 1).unwrap();
    Driver::with_motor(CourierConfig::default(), Faulty { inner, frozen: false, blind: false }).unwrap()
}

#[test]
fn verif_a_300_mm_trajectory_ends_within_5_micrometres_20_ms_after_its_end() {
    // The bound is the requirement on the assumed plant, noise, lag, delay and ripple included.
    for motor in [MotorParameters::IDEAL, assumed_motor()] {
        let mut driver = SimulatedCourier { motor, ..SimulatedCourier::default() }.driver(1).unwrap();
        let trajectory = Trajectory { points: vec![at_rest(0.0, 0.0, 0.0), at_rest(1.0, 0.3, 0.0)] };
        let goal = driver.execute(1, &trajectory).unwrap();
        let (_, mut events) = run(&mut driver, 102);
        let (status, more) = run(&mut driver, 20);
        events.extend(more);
        assert_eq!(events, [DriverEvent::GoalEnded(goal, GoalOutcome::Succeeded)]);
        assert!(status.tracking_error_peak.xy().norm() < 5e-6, "{}", status.tracking_error_peak);
        assert!((driver.motor_mut().motion().0.x - 0.3).abs() < 5e-6);
        assert!(status.at_rest());
    }
}

#[test]
fn verif_a_thousand_periods_leave_no_net_motion() {
    // Sampling at 2 kHz leaves the set point's position between kinks off by up to Δa dt²/8 = 5 µrad; feedback keeps
    // that from adding up. At the end the courier is where it began, to rounding.
    let mut driver = driver();
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let mut mean_yaw_rad = Vec::new();
    for _ in 0..100 {
        // Ten periods of 1/30 s are no whole number of ticks, but thirty are a second.
        let mut sum = 0.0;
        for _ in 0..100 {
            sum += truth(&mut driver, BLOCK).iter().map(|sample| sample.position.z).sum::<f64>();
        }
        mean_yaw_rad.push(sum / 2000.0);
    }
    let steady = &mean_yaw_rad[1..];
    let drift_rad = steady.last().unwrap() - steady.first().unwrap();
    assert!(drift_rad.abs() < 1e-12, "{drift_rad}");
    assert!(steady.iter().all(|mean_rad| mean_rad.abs() < 1e-7), "{steady:?}");

    driver.set_waveform(&paper_waveform(), false).unwrap();
    let (status, _) = run(&mut driver, 20);
    assert!(status.at_rest());
    // 100 ms after the stop, what the integral had taken up decays with its time of 80 ms; the rest is long gone.
    let (position, velocity) = driver.motor_mut().motion();
    assert!(position.norm() < 1e-9, "{position}");
    assert!(velocity.norm() < 1e-8, "{velocity}");
}

#[test]
fn verif_the_ideal_plant_follows_the_waveform_at_every_tick() {
    let mut driver = driver();
    let waveform = paper_waveform();
    driver.set_waveform(&waveform, true).unwrap();
    run(&mut driver, 100);
    // At 2 kHz the tick-averaged acceleration has the exact velocity at every tick; what feedback adds to keep the
    // position is below 1 % of the peak velocity.
    let mut worst_rad_s = 0.0_f64;
    for block in 0..100 {
        for (index, sample) in truth(&mut driver, BLOCK).iter().enumerate() {
            let time_s = 1.0 + f64::from(block) * 0.01 + index as f64 * 0.5e-3;
            worst_rad_s = worst_rad_s.max((sample.velocity.z - waveform.state_at(time_s).velocity).abs());
        }
    }
    assert!(worst_rad_s < 0.01 * waveform.peak_speed(), "{worst_rad_s}");
}

#[test]
fn vibration_begins_and_ends_smoothly_and_says_so() {
    let mut driver = driver();
    driver.set_waveform(&paper_waveform(), false).unwrap();
    assert_eq!(run(&mut driver, 5).0.vibration, VibrationPhase::Off);
    driver.set_waveform(&paper_waveform(), true).unwrap();
    assert_eq!(run(&mut driver, 1).0.vibration, VibrationPhase::FadingIn);
    assert_eq!(run(&mut driver, 10).0.vibration, VibrationPhase::Steady);
    driver.set_waveform(&paper_waveform(), false).unwrap();
    let mut blocks = 0;
    while !run(&mut driver, 1).0.at_rest() {
        blocks += 1;
    }
    // The rest of a period and two periods of fading.
    assert!(blocks <= 10, "{blocks}");
}

#[test]
fn another_waveform_waits_for_the_end_of_the_first() {
    let mut driver = driver();
    driver.set_waveform(&paper_waveform(), true).unwrap();
    run(&mut driver, 20);
    let shake = Waveform::coulomb_pump(Axis::X, 0.05, 5.0, 0.4).unwrap();
    driver.set_waveform(&shake, true).unwrap();
    let (mut both, mut seen) = (false, false);
    for _ in 0..50 {
        for sample in truth(&mut driver, BLOCK) {
            let (x, yaw) = (sample.velocity.x.abs() > 1e-4, sample.velocity.z.abs() > 1e-2);
            both |= x && yaw;
            seen |= x;
        }
    }
    assert!(seen && !both);
    assert_eq!(driver.waveform(), Some((&shake, true)));
}

#[test]
fn vibration_and_trajectory_add_up() {
    let mut driver = driver();
    driver.set_waveform(&paper_waveform(), true).unwrap();
    run(&mut driver, 50);
    driver.execute(1, &Trajectory { points: vec![at_rest(1.0, 0.2, -0.1)] }).unwrap();
    let (status, _) = run(&mut driver, 50);
    assert!(status.moving && status.vibration == VibrationPhase::Steady);
    assert!((status.nominal_position - Vector3::new(0.1, -0.05, 0.0)).norm() < 1e-9);
    let (status, _) = run(&mut driver, 60);
    let position = driver.motor_mut().motion().0;
    assert!(!status.moving && (position.xy() - status.nominal_position.xy()).norm() < 1e-9);
}

#[test]
fn refused_commands_name_the_reason_and_change_nothing() {
    let mut touched = driver();
    let mut untouched = driver();
    let long = |x_m| Trajectory { points: vec![at_rest(0.0, 0.0, 0.0), at_rest(1.0, x_m, 0.0)] };
    let envelope = |result: Result<_, Rejection>, quantity: &str| match result {
        Err(Rejection::Envelope(violation)) => assert_eq!(violation.quantity, quantity),
        other => panic!("{other:?}"),
    };
    envelope(touched.execute(1, &long(0.6)).map(|_| ()), "courier_x (m)");
    let fast = Trajectory { points: vec![at_rest(0.0, 0.0, 0.0), at_rest(0.3, 0.3, 0.0)] };
    envelope(touched.execute(1, &fast).map(|_| ()), "speed (m/s)");
    let hard = Trajectory { points: vec![at_rest(0.0, 0.0, 0.0), at_rest(0.08, 0.05, 0.0)] };
    envelope(touched.execute(1, &hard).map(|_| ()), "acceleration (m/s²)");
    let mut yawed = long(0.1);
    yawed.points[1].position.z = 0.05;
    envelope(touched.execute(1, &yawed).map(|_| ()), "courier_yaw (rad)");
    let mut jumping = long(0.1);
    jumping.points[1].velocity = None;
    envelope(touched.execute(1, &jumping).map(|_| ()), "acceleration (m/s²)");
    let mut cubic = long(0.1);
    cubic.points[1] = TrajectoryPoint { acceleration: None, ..at_rest(0.3, 0.1, 0.0) };
    envelope(touched.execute(1, &cubic).map(|_| ()), "jerk (m/s³)");
    let elsewhere = Trajectory { points: vec![at_rest(0.0, 0.1, 0.0), at_rest(1.0, 0.2, 0.0)] };
    assert!(matches!(touched.execute(1, &elsewhere), Err(Rejection::Start { axis: 0, .. })));
    let wide = Waveform::stick_slip(Axis::Yaw, 0.3, 17.0, 100.0).unwrap();
    envelope(touched.set_waveform(&wide, true), "courier_yaw (rad)");
    let violent = Waveform::stick_slip(Axis::Yaw, 0.02, 100.0, 600.0).unwrap();
    envelope(touched.set_waveform(&violent, true), "torque (N m)");
    assert_eq!(touched.step(50), untouched.step(50));
}

#[test]
fn a_waveform_near_the_limit_is_faded_in_more_slowly() {
    // 96 % of the torque left for commands; the default fade of two periods would need more.
    let mut driver = driver();
    let near = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.0, 0.96 * 0.9 * 2.7 / 0.005).unwrap();
    driver.set_waveform(&near, true).unwrap();
    for _ in 0..200 {
        let output = driver.step(BLOCK);
        assert_eq!(output.status.saturated_ticks, 0);
        for sample in driver.motor_mut().take_block().samples {
            assert!((sample.acceleration.z * 0.005).abs() <= 2.7);
        }
    }
}

#[test]
fn a_second_client_waits_and_the_same_client_preempts() {
    let mut driver = driver();
    let first = driver.execute(1, &Trajectory { points: vec![at_rest(1.0, 0.3, 0.0)] }).unwrap();
    run(&mut driver, 50);
    let back = Trajectory { points: vec![at_rest(1.0, 0.0, 0.2)] };
    assert_eq!(driver.execute(2, &back), Err(Rejection::Busy { holder: 1 }));
    let second = driver.execute(1, &back).unwrap();
    let (_, events) = run(&mut driver, 110);
    assert_eq!(
        events,
        [DriverEvent::GoalEnded(first, GoalOutcome::Preempted), DriverEvent::GoalEnded(second, GoalOutcome::Succeeded)]
    );
    assert!(driver.execute(2, &Trajectory { points: vec![at_rest(1.0, 0.0, 0.0)] }).is_ok());
}

#[test]
fn a_halt_comes_to_rest_on_the_path_and_sooner_than_its_end() {
    let mut driver = driver();
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let goal = driver.execute(1, &Trajectory { points: vec![at_rest(1.0, 0.3, 0.15)] }).unwrap();
    run(&mut driver, 50);
    driver.halt();
    let (status, events) = run(&mut driver, 15);
    assert_eq!(events, [DriverEvent::GoalEnded(goal, GoalOutcome::Halted)]);
    let (position, velocity) = driver.motor_mut().motion();
    assert!(status.at_rest() && velocity.norm() < 1e-3, "{status:?}");
    // Half way at 0.56 m/s: braking at 20 m/s² takes 8 mm and 50 ms or so.
    assert!((0.15..0.18).contains(&position.x), "{position}");
    assert!((position.y - 0.5 * position.x).abs() < 1e-6);
    assert!(!driver.cancel(goal));
}

#[test]
fn a_frozen_courier_is_a_fault_until_it_is_reset() {
    let mut driver = faulty();
    driver.motor_mut().frozen = true;
    let trajectory = Trajectory { points: vec![at_rest(1.0, 0.3, 0.0)] };
    let goal = driver.execute(1, &trajectory).unwrap();
    let mut events = Vec::new();
    for _ in 0..50 {
        events.extend(driver.step(BLOCK).events);
    }
    let [
        DriverEvent::GoalEnded(ended, GoalOutcome::Faulted(_)),
        DriverEvent::Fault(fault @ Fault::TrackingError { axis: 0, .. }),
    ] = &events[..]
    else {
        panic!("{events:?}")
    };
    assert_eq!(*ended, goal);
    assert_eq!(driver.execute(1, &trajectory), Err(Rejection::Faulted(fault.clone())));
    assert!(driver.set_waveform(&paper_waveform(), true).is_err());
    driver.motor_mut().frozen = false;
    driver.step(200);
    driver.reset_fault().unwrap();
    driver.execute(1, &trajectory).unwrap();
    assert_eq!(driver.step(2400).events.len(), 1);
}

#[test]
fn a_lost_sensor_is_a_fault_without_force() {
    let mut driver = faulty();
    driver.motor_mut().blind = true;
    let output = driver.step(BLOCK);
    assert_eq!(output.status.fault, Some(Fault::SensorLost));
    let moved = driver.motor_mut().inner.take_block().samples;
    assert!(moved.iter().all(|sample| sample.acceleration == Vector3::zeros()));
    assert_eq!(driver.reset_fault(), Err(Fault::SensorLost));
    driver.motor_mut().blind = false;
    assert_eq!(driver.reset_fault(), Ok(()));
}

/// A command to throw at the driver.
#[derive(Clone, Debug)]
enum Command {
    Waveform { slow: f64, fast: f64, period_s: f64, enabled: bool, axis: Axis },
    Move { client: u64, duration_s: f64, target: Vector3<f64>, via: Option<Vector3<f64>> },
    Halt,
    Bad,
}

fn command() -> impl Strategy<Value = Command> {
    let target = || (-0.6..0.6, -0.6..0.6, -0.04..0.04).prop_map(|(x, y, yaw)| Vector3::new(x, y, yaw));
    let axis = prop_oneof![Just(Axis::X), Just(Axis::Y), Just(Axis::Yaw)];
    prop_oneof![
        (0.5..20.0, 1.5..30.0, 0.01..0.2, any::<bool>(), axis).prop_map(|(slow, ratio, period_s, enabled, axis)| {
            Command::Waveform { slow, fast: slow * ratio, period_s, enabled, axis }
        }),
        (1_u64..3, 0.05..1.5, target(), prop::option::of(target()))
            .prop_map(|(client, duration_s, target, via)| Command::Move { client, duration_s, target, via }),
        Just(Command::Halt),
        Just(Command::Bad),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn whatever_is_commanded_the_courier_stays_inside_its_envelope(
        commands in prop::collection::vec((command(), 1_usize..30), 1..12),
    ) {
        let config = CourierConfig::default();
        let limits = config.limits;
        let mut driver = SimulatedCourier { config, ..SimulatedCourier::default() }.driver(1).unwrap();
        for (command, blocks) in commands {
            match command {
                Command::Waveform { slow, fast, period_s, enabled, axis } => {
                    let waveform = Waveform::stick_slip(axis, period_s, slow, fast).unwrap();
                    let _ = driver.set_waveform(&waveform, enabled);
                }
                Command::Move { client, duration_s, target, via } => {
                    let velocity = Some(Vector3::zeros());
                    let end = TrajectoryPoint { time_s: duration_s, position: target, velocity, acceleration: velocity };
                    let mut points = vec![end];
                    if let Some(position) = via {
                        let velocity = Some((target - position) / duration_s);
                        let via = TrajectoryPoint { time_s: 0.5 * duration_s, position, velocity, acceleration: None };
                        points.insert(0, via);
                    }
                    let _ = driver.execute(client, &Trajectory { points });
                }
                Command::Halt => driver.halt(),
                Command::Bad => {
                    let bad = TrajectoryPoint { time_s: f64::NAN, ..at_rest(0.0, 0.0, 0.0) };
                    let refused = driver.execute(1, &Trajectory { points: vec![bad] });
                    prop_assert!(refused.is_err());
                }
            }
            let output = driver.step(blocks * BLOCK);
            prop_assert_eq!(output.status.fault, None);
            prop_assert_eq!(output.status.saturated_ticks, 0);
            for sample in driver.motor_mut().take_block().samples {
                // 20 µm, 20 µrad: what tick averaging may put between set point and ideal plant.
                let (position, acceleration) = (sample.position, sample.acceleration);
                prop_assert!(position.iter().chain(&acceleration).all(|value| value.is_finite()));
                prop_assert!(position.x >= limits.x_m_min - 2e-5 && position.x <= limits.x_m_max + 2e-5);
                prop_assert!(position.y >= limits.y_m_min - 2e-5 && position.y <= limits.y_m_max + 2e-5);
                prop_assert!(position.z.abs() <= limits.yaw_rad_max + 2e-5);
                prop_assert!(sample.velocity.xy().norm() <= limits.speed_m_s_max * 1.01);
                prop_assert!(acceleration.xy().norm() <= limits.acceleration_m_s2_max * 1.05);
            }
        }
    }

    #[test]
    fn the_same_commands_and_seed_give_the_same_motion(seed in any::<u64>()) {
        let config = SimulatedCourier { motor: assumed_motor(), ..SimulatedCourier::default() };
        let mut drivers = [(); 2].map(|()| config.driver(seed).unwrap());
        let [a, b] = drivers.each_mut().map(|driver| {
            driver.set_waveform(&paper_waveform(), true).unwrap();
            driver.execute(1, &Trajectory { points: vec![at_rest(0.5, 0.1, 0.0)] }).unwrap();
            let output = driver.step(300);
            (output, driver.motor_mut().take_block())
        });
        prop_assert_eq!(a, b);
    }
}
