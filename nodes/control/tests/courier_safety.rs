//! What stops the courier: tolerances, the lifecycle, silence, the emergency stop, and hardware that fails.

#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use feeder_control::courier::{
    Commander, CourierConfig, DriverEvent, DriverStatus, Fault, GoalOutcome, Rejection, Tolerances, Trajectory,
    TrajectoryPoint,
};
use feeder_model::motion::MotionSample;
use feeder_model::motor::PlanarMotor as _;
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, SimulatedDriver, assumed_motor};
use feeder_sim::motor::{FaultHooks, MotorParameters, SizedWindow, Window};
use nalgebra::Vector3;

/// Servo ticks in 10 ms.
const BLOCK: usize = 20;

fn courier(motor: MotorParameters) -> SimulatedCourier {
    SimulatedCourier { motor, ..SimulatedCourier::default() }
}

fn assumed(faults: FaultHooks) -> SimulatedDriver {
    courier(MotorParameters { faults, ..assumed_motor() }).driver(1).unwrap()
}

fn to(duration_s: f64, x_m: f64, y_m: f64) -> Trajectory {
    Trajectory { points: vec![TrajectoryPoint::at_rest(duration_s, Vector3::new(x_m, y_m, 0.0))] }
}

fn paper_waveform() -> Waveform {
    Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.87).unwrap()
}

/// Runs so many servo ticks and gives the true motion in them.
fn truth(driver: &mut SimulatedDriver, ticks: usize) -> Vec<MotionSample> {
    driver.motor_mut().take_block();
    driver.step(ticks);
    driver.motor_mut().take_block().samples
}

/// Runs blocks and gives the last status with all events.
fn run(driver: &mut SimulatedDriver, blocks: usize) -> (DriverStatus, Vec<DriverEvent>) {
    let mut events = Vec::new();
    let mut last = None;
    for _ in 0..blocks {
        let output = driver.step(BLOCK);
        events.extend(output.events);
        last = Some(output.status);
    }
    (last.unwrap(), events)
}

#[test]
fn a_path_tolerance_ends_the_goal_and_the_courier_comes_to_rest_on_its_path() {
    let mut driver = assumed(FaultHooks::NONE);
    run(&mut driver, 50);
    let tolerances = Tolerances { path_position: Vector3::new(5e-6, 0.0, 0.0), ..Tolerances::default() };
    let goal = driver.execute_within(1, &to(0.6, 0.3, 0.15), &tolerances).unwrap();
    let (status, events) = run(&mut driver, 40);
    let [DriverEvent::GoalEnded(ended, GoalOutcome::PathViolated { quantity: "position", axis: 0, error, allowed })] =
        &events[..]
    else {
        panic!("{events:?}")
    };
    assert!(*ended == goal && error.abs() > *allowed && (allowed - 5e-6).abs() < 1e-18);
    assert!(status.fault.is_none() && status.at_rest());
    let position = driver.motor_mut().motion().0;
    assert!((position.y - 0.5 * position.x).abs() < 1e-4 && position.x < 0.25);
    // Without a tolerance the same move goes through.
    driver
        .execute_within(1, &to(0.6, 0.3, 0.15), &Tolerances { path_position: Vector3::repeat(-1.0), ..tolerances })
        .unwrap();
    let (_, events) = run(&mut driver, 70);
    assert!(matches!(events[..], [DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)]), "{events:?}");
}

#[test]
fn a_goal_tolerance_tighter_than_the_noise_is_missed_in_the_time_given() {
    let mut driver = assumed(FaultHooks::NONE);
    let tolerances = Tolerances { goal_position: Vector3::repeat(1e-12), goal_time_s: 0.05, ..Tolerances::default() };
    let goal = driver.execute_within(1, &to(0.5, 0.1, 0.0), &tolerances).unwrap();
    let (_, early) = run(&mut driver, 54);
    let (status, late) = run(&mut driver, 3);
    assert!(early.is_empty(), "{early:?}");
    assert!(
        matches!(late[..], [DriverEvent::GoalEnded(ended, GoalOutcome::ToleranceViolated { .. })] if ended == goal)
    );
    assert_eq!(status.fault, None);
    let nan = Tolerances { goal_velocity: Vector3::new(0.0, f64::NAN, 0.0), ..Tolerances::default() };
    let refused = driver.execute_within(1, &to(0.5, 0.2, 0.0), &nan);
    assert!(matches!(refused, Err(Rejection::Tolerance { tolerance: "goal velocity tolerance", axis: 1, .. })));
}

#[test]
fn an_inactive_driver_halts_and_refuses() {
    let mut driver = assumed(FaultHooks::NONE);
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let goal = driver.execute(1, &to(1.0, 0.3, 0.0)).unwrap();
    run(&mut driver, 50);
    driver.set_active(false);
    assert_eq!(driver.execute(1, &to(1.0, 0.0, 0.0)), Err(Rejection::Inactive));
    assert_eq!(driver.set_waveform(&paper_waveform(), true), Err(Rejection::Inactive));
    assert_eq!(driver.home(1), Err(Rejection::Inactive));
    let (status, events) = run(&mut driver, 20);
    assert_eq!(events, [DriverEvent::GoalEnded(goal, GoalOutcome::Halted)]);
    assert!(status.at_rest() && status.fault.is_none());
    driver.set_active(true);
    driver.home(1).unwrap();
    let (status, events) = run(&mut driver, 150);
    assert!(matches!(events[..], [DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)]));
    assert!(status.fault.is_none());
    let position = driver.motor_mut().motion().0;
    assert!(position.xy().norm() < 2e-5, "{position}");
}

#[test]
fn home_waits_for_another_clients_goal() {
    let mut driver = assumed(FaultHooks::NONE);
    driver.execute(1, &to(1.0, 0.3, 0.0)).unwrap();
    run(&mut driver, 10);
    assert_eq!(driver.home(2), Err(Rejection::Busy { holder: 1 }));
    driver.halt();
    run(&mut driver, 20);
    driver.home(2).unwrap();
}

#[test]
fn an_emergency_stop_brakes_hard_and_stays() {
    let mut driver = assumed(FaultHooks::NONE);
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let goal = driver.execute(1, &to(0.5, 0.3, 0.0)).unwrap();
    run(&mut driver, 25);
    let before = truth(&mut driver, 1)[0];
    assert!(before.velocity.x > 1.0);
    driver.emergency_stop();
    let samples = truth(&mut driver, 12 * BLOCK);
    // 1.12 m/s at 20 m/s²: 56 ms at the least, twice that by a smooth stop; the feedback settles behind it.
    let at_rest = samples.iter().rposition(|sample| sample.velocity.norm() > 5e-3).unwrap();
    assert!(at_rest < 320, "{at_rest}");
    assert!(samples.last().unwrap().position.x - before.position.x < 0.09);
    let (status, events) = run(&mut driver, 20);
    assert!(events.is_empty() && status.fault == Some(Fault::EmergencyStop), "{events:?} {goal:?}");
    assert_eq!(driver.execute(1, &to(1.0, 0.0, 0.0)), Err(Rejection::Faulted(Fault::EmergencyStop)));
    driver.reset_fault().unwrap();
    driver.home(1).unwrap();
}

#[test]
fn a_fault_is_not_reset_before_the_courier_stands() {
    // A stop by the motor, and one without it: the air is off and friction brakes.
    let weak = Some(SizedWindow { from_s: 0.2, to_s: 2.0, size: 0.005 });
    for faults in [FaultHooks::NONE, FaultHooks { saturation: weak, ..FaultHooks::NONE }] {
        let mut driver = assumed(faults);
        driver.execute(1, &to(0.5, 0.3, 0.0)).unwrap();
        run(&mut driver, 25);
        driver.emergency_stop();
        let mut refused = (0, 0);
        for _ in 0..1000 {
            let status = driver.step(1).status;
            if driver.motor_mut().motion().1.norm() > 20e-3 {
                let reset = driver.reset_fault();
                assert!(reset.is_err(), "{status:?}");
                refused = (refused.0 + 1, refused.1 + u32::from(status.fault.is_some()));
            }
        }
        // With the fault latched, and not only while it is on its way.
        assert!(refused.0 > 10 && (refused.1 > 10 || faults == FaultHooks::NONE), "{refused:?}");
        driver.motor_mut().set_faults(FaultHooks::NONE);
        run(&mut driver, 50);
        assert_eq!(driver.reset_fault(), Ok(()));
    }
}

#[test]
fn silence_stops_in_order_and_is_a_fault_afterwards() {
    for (commander, vibrates) in [(Commander::Generator, true), (Commander::Planner, false)] {
        let mut driver = assumed(FaultHooks::NONE);
        driver.hear(commander);
        if vibrates {
            driver.set_waveform(&paper_waveform(), true).unwrap();
        } else {
            driver.execute(1, &to(10.0, 0.3, 0.0)).unwrap();
        }
        // Word every second keeps it going for longer than the two seconds allowed.
        for _ in 0..3 {
            let (status, _) = run(&mut driver, 100);
            assert!(status.fault.is_none() && !status.at_rest());
            driver.hear(commander);
        }
        let (status, events) = run(&mut driver, 195);
        assert!(status.fault.is_none() && events.is_empty() && !status.at_rest());
        let (status, events) = run(&mut driver, 25);
        let silent = |fault: &Fault| matches!(fault, Fault::Silence { of, .. } if *of == commander);
        assert!(status.at_rest() && status.fault.as_ref().is_some_and(silent), "{status:?}");
        assert!(matches!(events.last(), Some(DriverEvent::Fault(fault)) if silent(fault)));
        assert!(matches!(driver.execute(1, &to(1.0, 0.0, 0.0)), Err(Rejection::Faulted(fault)) if silent(&fault)));
        run(&mut driver, 20);
        driver.reset_fault().unwrap();
        driver.home(1).unwrap();
    }
}

#[test]
fn a_commander_never_heard_is_not_missed() {
    let mut driver = assumed(FaultHooks::NONE);
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let (status, _) = run(&mut driver, 1000);
    assert!(status.fault.is_none() && !status.at_rest());
}

/// What a driver does about a fault of its hardware in the middle of a move of 300 mm in 1 s.
fn fails(faults: FaultHooks, expected: impl Fn(&Fault) -> bool) {
    let mut driver = assumed(faults);
    driver.execute(1, &to(1.0, 0.3, 0.0)).unwrap();
    let (_, events) = run(&mut driver, 100);
    let faulted = |event: &DriverEvent| matches!(event, DriverEvent::Fault(fault) if expected(fault));
    assert!(events.iter().any(faulted), "{events:?}");
    // It stays where it is, on the platen, until it is reset and sent home.
    let (status, events) = run(&mut driver, 100);
    assert!(events.is_empty() && status.at_rest());
    let (position, velocity) = driver.motor_mut().motion();
    assert!(velocity.norm() < 1e-2 && position.xy().norm() < 0.3, "{position} {velocity}");
    // Blind or not, the driver knows that much too.
    assert!(status.velocity.norm() < 2e-2 && status.position.xy().norm() < 0.3, "{status:?}");
    driver.motor_mut().set_faults(FaultHooks::NONE);
    run(&mut driver, 50);
    driver.reset_fault().unwrap();
    driver.home(1).unwrap();
    let (status, _) = run(&mut driver, 300);
    assert!(status.fault.is_none() && driver.motor_mut().motion().0.xy().norm() < 2e-5, "{status:?}");
}

#[test]
fn hardware_that_fails_in_a_move_is_stopped_and_recovers() {
    let window = Some(Window { from_s: 0.4, to_s: 2.0 });
    let sized = |size| Some(SizedWindow { from_s: 0.4, to_s: 2.0, size });
    fails(FaultHooks { freeze: window, ..FaultHooks::NONE }, |fault| matches!(fault, Fault::TrackingError { .. }));
    fails(FaultHooks { sensor_dropout: window, ..FaultHooks::NONE }, |fault| *fault == Fault::SensorLost);
    fails(FaultHooks { saturation: sized(0.005), ..FaultHooks::NONE }, |fault| {
        matches!(fault, Fault::TrackingError { .. } | Fault::Saturated { .. })
    });
    fails(FaultHooks { message_loss: sized(1.0), ..FaultHooks::NONE }, |fault| {
        matches!(fault, Fault::TrackingError { .. } | Fault::Saturated { .. })
    });
}

#[test]
fn a_courier_that_freezes_while_it_vibrates_is_stuck() {
    let freeze = Some(Window { from_s: 1.0, to_s: 3.0 });
    let mut driver = assumed(FaultHooks { freeze, ..FaultHooks::NONE });
    driver.set_waveform(&paper_waveform(), true).unwrap();
    let (status, _) = run(&mut driver, 100);
    assert_eq!(status.fault, None);
    let (status, _) = run(&mut driver, 21);
    assert!(matches!(status.fault, Some(Fault::Stuck { axis: 2, .. })), "{status:?}");
    run(&mut driver, 200);
    driver.reset_fault().unwrap();
    driver.home(1).unwrap();
}

#[test]
fn a_dropout_of_a_millisecond_is_bridged() {
    let mut driver =
        assumed(FaultHooks { sensor_dropout: Some(Window { from_s: 0.4, to_s: 0.401 }), ..FaultHooks::NONE });
    driver.execute(1, &to(1.0, 0.3, 0.0)).unwrap();
    let (status, events) = run(&mut driver, 110);
    assert!(matches!(events[..], [DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)]), "{events:?}");
    assert!(driver.motor_mut().measure().x > 0.29 && status.fault.is_none());
}

#[test]
fn a_courier_pushed_over_its_bounds_is_a_fault() {
    // The start lies on the bound; the tether pulls it over while the forcers give next to nothing.
    let motor = MotorParameters {
        tether_anchor_m: [2.0, 0.0],
        tether_tension_n: 0.5,
        faults: FaultHooks { saturation: Some(SizedWindow { from_s: 0.0, to_s: 60.0, size: 0.0 }), ..FaultHooks::NONE },
        ..assumed_motor()
    };
    let start = Vector3::new(0.5, 0.0, 0.0);
    let config = CourierConfig { start, ..CourierConfig::default() };
    let mut driver = SimulatedCourier { config, motor }.driver(1).unwrap();
    let (status, _) = run(&mut driver, 20);
    let Some(Fault::LeftEnvelope { quantity, value, allowed }) = status.fault else { panic!("{status:?}") };
    assert!(quantity == "courier_x" && value > allowed && (allowed - 0.501).abs() < 1e-12);
}
