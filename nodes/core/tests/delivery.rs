//! Moves against theory and table, and whole deliveries with a courier, a camera and a manipulator around the sequencer.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::TAU;
use std::time::Duration;

use feeder_core::courier::plant::PlantParameters;
use feeder_core::courier::{
    CourierConfig, CourierDriver, CourierLimits, DriverEvent, GoalHandle, GoalOutcome, Load, VibrationPhase,
};
use feeder_core::delivery::{
    Candidate, CandidateFrame, CourierReport, DeliveryConfig, DeliveryId, DeliveryRequest, DeliverySequencer, Failure,
    GentleParameters, MoveId, MovePlanner, Output, Phase, Policy, Refusal, Stamp, Warning, holding_acceleration_m_s2,
};
use feeder_core::mechanics::Friction;
use feeder_core::mechanics::annular::{AnnularTrack, PartState};
use feeder_core::tray::TrayGeometry;
use feeder_core::waveform::{Axis, Waveform};
use nalgebra::{Vector2, Vector3};
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
    let table = include_str!("data/gentle_delivery.csv");
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
    assert!(refused(Vector3::new(0.1, 0.0, 0.01), &[]).contains("yaw"));
    assert!(refused(Vector3::new(0.1, 0.0, 0.0), &[half_way_up(0.031)]).contains("at rest"));
}

/// Largest displacement of a part in the tray while the courier moves, m.
fn slip_m(plant: PlantParameters, friction_share: f64, to: Vector3<f64>, part: Vector2<f64>, seed: u64) -> f64 {
    let config = CourierConfig { plant, ..CourierConfig::default() };
    let mut driver = CourierDriver::simulated(config, seed).unwrap();
    let gentle = GentleParameters { friction_share, ..GentleParameters::default() };
    let plan = planner(gentle).plan(Vector3::zeros(), to, &[part]).unwrap();
    driver.execute(1, &plan.trajectory()).unwrap();
    let friction = Friction::uniform(gentle.friction).unwrap();
    let track = AnnularTrack::new(TrayGeometry::PAPER, friction, gentle.gravity_m_s2).unwrap();
    let start = PartState::at_rest(part.norm(), part.y.atan2(part.x).rem_euclid(TAU));
    let (mut state, mut slip_m) = (start, 0.0_f64);
    for sample in driver.step(3000).block.samples {
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
            for plant in [PlantParameters::IDEAL, PlantParameters::assumed()] {
                let slip_m = slip_m(plant, 0.97, to, part, index as u64);
                assert!(slip_m <= 10e-6, "{part} {to}: {slip_m}");
            }
            let slip_m = slip_m(PlantParameters::assumed(), 1.2, to, part, index as u64);
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
        let mut driver = CourierDriver::simulated(CourierConfig::default(), 1).unwrap();
        driver.execute(1, &plan.trajectory()).unwrap();
        let tray = TrayGeometry::PAPER;
        let samples = std::iter::from_fn(|| {
            let step = driver.step(1);
            step.status.moving.then_some(step.block.samples[0])
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
        let status = driver.step(1).status;
        prop_assert!((status.position - to).norm() < 1e-7);
    }
}

/// 10 ms of the loop.
const TICK: Duration = Duration::from_millis(10);

/// What can go wrong around the sequencer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Faults {
    blind: bool,
    manipulator_silent: bool,
    manipulator_misses: bool,
    feed_refused: bool,
    moves_refused: bool,
    never_stops: bool,
}

/// The rest of the feeder, as far as the sequencer can tell: everything it sends or hears is 50 ms late.
struct World {
    now: Stamp,
    driver: CourierDriver,
    sequencer: DeliverySequencer,
    faults: Faults,
    /// Parts that lie on the plateau, in the tray.
    parts: Vec<Vector2<f64>>,
    /// Feeding so far, and how much of it brings a part.
    fed: u32,
    moves: BTreeMap<GoalHandle, MoveId>,
    to_world: VecDeque<(Stamp, Output)>,
    to_sequencer: VecDeque<(Stamp, Heard)>,
    log: Vec<(Stamp, Output)>,
    vibrating_moves: usize,
}

enum Heard {
    Courier(CourierReport),
    Frame(CandidateFrame),
    MoveEnded(MoveId, Result<(), String>),
    FeedRefused,
    HandOver(DeliveryId, bool),
}

impl World {
    const LATENCY: Duration = Duration::from_millis(50);
    /// Feeding that brings one part onto the plateau, in ticks.
    const TICKS_PER_PART: u32 = 150;

    fn new(faults: Faults, policy: Policy) -> Self {
        let stations_m = [("left", Vector2::new(-0.3, 0.2)), ("right", Vector2::new(0.3, 0.1))];
        let config = DeliveryConfig {
            feeding_place: Vector3::new(0.1, -0.1, 0.0),
            stations_m: stations_m.map(|(name, station_m)| (name.into(), station_m)).into(),
            policy,
            ..DeliveryConfig::default()
        };
        let limits = CourierLimits::default();
        Self {
            now: Stamp::ZERO,
            driver: CourierDriver::simulated(CourierConfig::default(), 1).unwrap(),
            sequencer: DeliverySequencer::new(config, TrayGeometry::PAPER, limits, Load::default()).unwrap(),
            faults,
            parts: Vec::new(),
            fed: 0,
            moves: BTreeMap::new(),
            to_world: VecDeque::new(),
            to_sequencer: VecDeque::new(),
            log: Vec::new(),
            vibrating_moves: 0,
        }
    }

    fn request(&mut self, station: &str, timeout_s: Option<u64>) -> DeliveryId {
        let request = DeliveryRequest {
            station: station.into(),
            part_class: "washer".into(),
            pose_class: String::new(),
            tolerance_m: 0.5e-3,
            timeout: timeout_s.map(Duration::from_secs),
        };
        self.sequencer.request(self.now, request).unwrap()
    }

    fn tell(&mut self, heard: Heard) {
        self.to_sequencer.push_back((self.now + Self::LATENCY, heard));
    }

    fn act(&mut self, output: Output) {
        match output {
            Output::Feed(true) if self.faults.feed_refused => self.tell(Heard::FeedRefused),
            Output::Feed(false) if self.faults.never_stops => {}
            Output::Feed(on) => {
                let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.66, 130.9).unwrap();
                self.driver.set_waveform(&waveform, on).unwrap();
            }
            Output::Move(id, _) if self.faults.moves_refused => {
                self.tell(Heard::MoveEnded(id, Err("refused by a test".into())));
            }
            Output::Move(id, plan) => match self.driver.execute(1, &plan.trajectory()) {
                Ok(goal) => drop(self.moves.insert(goal, id)),
                Err(rejection) => self.tell(Heard::MoveEnded(id, Err(rejection.to_string()))),
            },
            Output::CancelMove(id) => {
                let goal = self.moves.iter().find(|(_, named)| **named == id).map(|(goal, _)| *goal);
                goal.map(|goal| self.driver.cancel(goal));
            }
            Output::Presented(id, delivered) if !self.faults.manipulator_silent => {
                let taken = !self.faults.manipulator_misses;
                if taken {
                    let position = delivered.choice.candidate.position_in_tray_m;
                    self.parts.retain(|part| *part != position);
                }
                self.tell(Heard::HandOver(id, taken));
            }
            _ => {}
        }
    }

    fn tick(&mut self) {
        while self.to_world.front().is_some_and(|(due, _)| *due <= self.now) {
            let (_, output) = self.to_world.pop_front().unwrap();
            self.act(output);
        }
        let step = self.driver.step(20);
        for event in step.events {
            if let DriverEvent::GoalEnded(goal, outcome) = event {
                let result = if outcome == GoalOutcome::Succeeded { Ok(()) } else { Err(format!("{outcome:?}")) };
                self.tell(Heard::MoveEnded(self.moves[&goal], result));
            }
        }
        let status = step.status;
        let vibrating = status.vibration != VibrationPhase::Off;
        self.vibrating_moves += usize::from(vibrating && status.moving);
        self.now += TICK;
        let position = status.position;
        self.tell(Heard::Courier(CourierReport { stamp: self.now, position, vibrating, moving: status.moving }));
        if status.vibration == VibrationPhase::Steady {
            self.fed += 1;
            if self.fed.is_multiple_of(Self::TICKS_PER_PART) {
                self.parts.push(Vector2::new(0.06, -0.02 - 1e-5 * f64::from(self.fed)));
            }
        }
        if self.now.as_millis().is_multiple_of(100) && !self.faults.blind {
            let candidates = self.parts.iter().map(|&position_in_tray_m| Candidate {
                position_in_tray_m,
                yaw_in_tray_rad: 0.3,
                part_class: "washer".into(),
                pose_class: "face_up".into(),
                confidence: 0.9,
                clearance_m: 0.01,
                on_plateau: true,
            });
            let frame = CandidateFrame { stamp: self.now, candidates: candidates.collect() };
            self.tell(Heard::Frame(frame));
        }
        while self.to_sequencer.front().is_some_and(|(due, _)| *due <= self.now) {
            match self.to_sequencer.pop_front().unwrap().1 {
                Heard::Courier(report) => self.sequencer.courier(report),
                Heard::Frame(frame) => self.sequencer.candidates(frame),
                Heard::MoveEnded(id, result) => self.sequencer.move_ended(id, result),
                Heard::FeedRefused => self.sequencer.feed_refused("refused by a test".into()),
                // A report on a delivery that was given up meanwhile is refused, as it should be.
                Heard::HandOver(id, taken) => drop(self.sequencer.report_hand_over(id, taken)),
            }
        }
        for output in self.sequencer.step(self.now) {
            self.log.push((self.now, output.clone()));
            self.to_world.push_back((self.now + Self::LATENCY, output));
        }
    }

    fn run(&mut self, seconds: u64) {
        for _ in 0..seconds * 100 {
            self.tick();
        }
    }

    fn finished(&self) -> Vec<(DeliveryId, Result<(), Failure>)> {
        self.log
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Finished(id, result) => Some((*id, result.as_ref().map(|_| ()).map_err(Clone::clone))),
                _ => None,
            })
            .collect()
    }

    fn phases(&self) -> Vec<Phase> {
        self.log
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Phase { phase, .. } => Some(*phase),
                _ => None,
            })
            .collect()
    }
}

#[test]
fn a_delivery_goes_through_its_phases_and_the_courier_returns() {
    use Phase::{Feeding, Idle, Looking, Moving, Presented, Returning, Settling, Stopping};
    for policy in [Policy::Selected, Policy::All] {
        let mut world = World::new(Faults::default(), policy);
        let id = world.request("right", Some(60));
        world.run(12);
        assert_eq!(world.finished(), [(id, Ok(()))]);
        let mut phases = vec![Returning, Idle, Stopping, Settling, Looking, Feeding, Stopping, Settling, Looking];
        phases.extend([Moving, Presented, Returning, Idle]);
        assert_eq!(world.phases(), phases);
        let status = world.driver.step(1).status;
        assert!(status.at_rest() && (status.position - Vector3::new(0.1, -0.1, 0.0)).norm() < 1e-6);
        assert_eq!(world.vibrating_moves, 0);
    }
}

#[test]
fn the_part_presented_lies_under_the_tool_axis_and_was_seen_at_rest() {
    let mut world = World::new(Faults::default(), Policy::Selected);
    world.request("left", None);
    world.run(12);
    let presented = world.log.iter().find_map(|(_, output)| match output {
        Output::Presented(_, delivered) => Some(delivered.clone()),
        _ => None,
    });
    let delivered = presented.unwrap();
    assert!(delivered.part_in_station_m.norm() < 20e-6);
    assert!((delivered.yaw_rad - 0.3).abs() < 1e-6);
    let stopping = |(_, output): &&(Stamp, Output)| matches!(output, Output::Phase { phase: Phase::Settling, .. });
    let settling = world.log.iter().rfind(stopping).unwrap().0;
    assert!(delivered.choice.look + World::LATENCY >= settling);
}

#[test]
fn parts_left_on_the_plateau_are_delivered_without_feeding_again() {
    let mut world = World::new(Faults::default(), Policy::Selected);
    world.parts = vec![Vector2::new(0.06, -0.03), Vector2::new(-0.05, -0.05)];
    let ids = [world.request("left", None), world.request("right", None)];
    world.run(12);
    assert_eq!(world.finished(), ids.map(|id| (id, Ok(()))));
    assert!(!world.log.iter().any(|(_, output)| *output == Output::Feed(true)));
}

#[test]
fn every_fault_ends_the_delivery_with_its_name() {
    let faults = Faults::default();
    let cases = [
        (Faults { blind: true, ..faults }, Failure::NoImage),
        (Faults { manipulator_silent: true, ..faults }, Failure::NoHandOver),
        (Faults { manipulator_misses: true, ..faults }, Failure::NotTaken),
        (Faults { feed_refused: true, ..faults }, Failure::FeedRefused("refused by a test".into())),
        (Faults { never_stops: true, ..faults }, Failure::DidNotStop),
    ];
    for (faults, failure) in cases {
        let mut world = World::new(faults, Policy::Selected);
        let id = world.request("right", None);
        world.run(30);
        assert_eq!(world.finished(), [(id, Err(failure))], "{faults:?}");
    }
}

#[test]
fn a_courier_that_does_not_return_ends_in_fault_until_reset() {
    let mut world = World::new(Faults { moves_refused: true, ..Faults::default() }, Policy::Selected);
    let id = world.request("right", None);
    world.run(10);
    assert_eq!(world.finished(), [(id, Err(Failure::Fault("refused by a test".into())))]);
    assert_eq!(world.sequencer.phase(), Phase::Fault);
    let request = DeliveryRequest {
        station: "left".into(),
        part_class: "washer".into(),
        pose_class: String::new(),
        tolerance_m: 1e-3,
        timeout: None,
    };
    assert!(matches!(world.sequencer.request(world.now, request), Err(Refusal::Fault(_))));
    world.faults = Faults::default();
    world.sequencer.reset();
    let id = world.request("left", None);
    world.run(15);
    assert_eq!(world.finished().last(), Some(&(id, Ok(()))));
}

#[test]
fn a_request_that_cannot_be_served_is_refused() {
    let mut world = World::new(Faults::default(), Policy::Selected);
    let request = |station: &str, tolerance_m| DeliveryRequest {
        station: station.into(),
        part_class: "washer".into(),
        pose_class: String::new(),
        tolerance_m,
        timeout: None,
    };
    let refusal = |world: &mut World, request| world.sequencer.request(Stamp::ZERO, request).unwrap_err();
    assert!(matches!(refusal(&mut world, request("nowhere", 1e-3)), Refusal::UnknownStation { .. }));
    for tolerance_m in [-1.0, 0.0, 1e-6, f64::NAN, f64::INFINITY] {
        assert!(matches!(refusal(&mut world, request("left", tolerance_m)), Refusal::Tolerance { .. }));
    }
    assert_eq!(world.sequencer.report_hand_over(DeliveryId(7), true), Err(Refusal::NotPresented(DeliveryId(7))));
    let far = DeliveryConfig {
        stations_m: [("far".to_string(), Vector2::new(0.7, 0.0))].into(),
        ..DeliveryConfig::default()
    };
    let mut sequencer =
        DeliverySequencer::new(far, TrayGeometry::PAPER, CourierLimits::default(), Load::default()).unwrap();
    let refusal = sequencer.request(Stamp::ZERO, request("far", 1e-3)).unwrap_err();
    assert!(matches!(refusal, Refusal::OutOfReach { beyond_m, .. } if (beyond_m - 0.11).abs() < 1e-12));
}

#[test]
fn starvation_is_a_warning_and_the_timeout_a_failure() {
    let mut world = World::new(Faults::default(), Policy::Selected);
    world.fed = 1_000_000_001;
    let id = world.request("right", Some(40));
    for _ in 0..45 * 100 {
        world.parts.clear();
        world.tick();
    }
    assert!(world.log.iter().any(|(_, output)| matches!(output, Output::Warning(Warning::Starved(_)))));
    assert_eq!(world.finished(), [(id, Err(Failure::TimedOut(Phase::Feeding)))]);
    assert!(world.driver.step(1).status.at_rest());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever fails and whatever is cancelled when, every request ends exactly once, no move begins while the tray
    /// vibrates, and the courier ends at rest.
    #[test]
    fn every_request_ends_exactly_once(
        blind in prop::bool::weighted(0.1), manipulator_silent in prop::bool::weighted(0.1),
        manipulator_misses in any::<bool>(), all in any::<bool>(),
        requests in prop::collection::vec((0_u64..800, any::<bool>(), 1_u64..20, prop::option::of(0_u64..600)), 1..4),
    ) {
        let faults = Faults { blind, manipulator_silent, manipulator_misses, ..Faults::default() };
        let mut world = World::new(faults, if all { Policy::All } else { Policy::Selected });
        let mut ids = Vec::new();
        let mut cancels = Vec::new();
        for tick in 0..6000 {
            for &(at, left, timeout_s, cancel_after) in &requests {
                if tick == at {
                    let id = world.request(if left { "left" } else { "right" }, Some(timeout_s));
                    ids.push(id);
                    cancels.extend(cancel_after.map(|after| (tick + after, id)));
                }
            }
            for &(at, id) in &cancels {
                if tick == at {
                    world.sequencer.cancel(world.now, id);
                }
            }
            world.tick();
        }
        let mut ended: Vec<_> = world.finished().into_iter().map(|(id, _)| id).collect();
        ended.sort_unstable();
        prop_assert_eq!(ended, ids);
        prop_assert_eq!(world.vibrating_moves, 0);
        prop_assert_eq!(world.sequencer.phase(), Phase::Idle);
        prop_assert!(world.driver.step(1).status.at_rest());
    }
}
