//! The rest of the feeder, as far as the sequencer can tell.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use feeder_control::courier::{CourierConfig, CourierLimits, DriverEvent, GoalHandle, GoalOutcome, VibrationPhase};
use feeder_control::delivery::{
    CandidateFrame, CourierReport, DeliveryConfig, DeliveryId, DeliveryRequest, DeliverySequencer, Failure, HandOver,
    LeaseAnswer, MoveId, OfferedPart, Output, Phase, ReserveId, Stamp,
};
use feeder_control::platen::{Arbiter, Reservation};
use feeder_model::motor::Load;
use feeder_model::part::Refusals;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, SimulatedDriver};
use nalgebra::{Vector2, Vector3};

/// 10 ms of the loop.
const TICK: Duration = Duration::from_millis(10);

/// What can go wrong around the sequencer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Faults {
    pub(crate) blind: bool,
    pub(crate) manipulator_silent: bool,
    pub(crate) manipulator_misses: bool,
    pub(crate) never_released: bool,
    pub(crate) feed_refused: bool,
    pub(crate) moves_refused: bool,
    pub(crate) never_stops: bool,
    /// The chosen part is gone when the courier moves.
    pub(crate) part_falls: bool,
    /// The chosen part lies on its other face when the courier moves.
    pub(crate) part_turns: bool,
    /// All parts slide by 0.2 mm in every move.
    pub(crate) parts_slide: bool,
}

/// A part on the plateau.
#[derive(Clone, Debug)]
struct Lying {
    id: u64,
    position_in_tray_m: Vector2<f64>,
    pose_class: &'static str,
    refusals: Refusals,
}

/// The platen's arbiter, shared by worlds, and whom the answers are for: the world's name is the agent's.
#[derive(Default)]
pub(crate) struct Platen {
    pub(crate) arbiter: Arbiter,
    tickets: BTreeMap<u64, (String, ReserveId)>,
    answers: Vec<(String, ReserveId, LeaseAnswer)>,
    asked: u64,
}

impl Platen {
    pub(crate) fn step(&mut self, now: Stamp) {
        for (ticket, answer) in self.arbiter.step(now) {
            if let Some((agent, id)) = self.tickets.remove(&ticket) {
                let answer = answer.map(|granted| (granted.lease.to_string(), granted.expires));
                self.answers.push((agent, id, answer.map_err(|refusal| refusal.to_string())));
            }
        }
    }
}

/// The rest of the feeder, as far as the sequencer can tell: everything it sends or hears is 50 ms late.
pub(crate) struct World {
    pub(crate) name: String,
    pub(crate) now: Stamp,
    pub(crate) driver: SimulatedDriver,
    pub(crate) sequencer: DeliverySequencer,
    pub(crate) faults: Faults,
    parts: Vec<Lying>,
    added: u64,
    /// Feeding so far in ticks, and whether it brings parts.
    fed: u32,
    pub(crate) barren: bool,
    /// What vision says of the parts that come.
    pub(crate) refusals: Refusals,
    moves: BTreeMap<GoalHandle, MoveId>,
    to_world: VecDeque<(Stamp, Output)>,
    to_sequencer: VecDeque<(Stamp, Heard)>,
    pub(crate) log: Vec<(Stamp, Output)>,
    pub(crate) vibrating_moves: usize,
    platen: Option<Rc<RefCell<Platen>>>,
}

enum Heard {
    Courier(CourierReport),
    Frame(CandidateFrame),
    MoveEnded(MoveId, Result<(), String>),
    FeedRefused,
    HandOver(DeliveryId, HandOver),
    Area(ReserveId, LeaseAnswer),
}

pub(crate) fn config() -> DeliveryConfig {
    let stations_m = [("left", Vector2::new(-0.3, 0.2)), ("right", Vector2::new(0.3, 0.1))];
    DeliveryConfig {
        feeding_place: Vector3::new(0.1, -0.1, 0.0),
        stations_m: stations_m.map(|(name, station_m)| (name.into(), station_m)).into(),
        ..DeliveryConfig::default()
    }
}

/// A washer that may be picked.
pub(crate) fn washer(id: u64, position_in_tray_m: Vector2<f64>) -> OfferedPart {
    OfferedPart {
        id,
        position_in_tray_m,
        yaw_in_tray_rad: 0.3,
        part_class: "washer".into(),
        pose_class: Some(World::FACE_UP.into()),
        radius_m: 0.0025,
        part_gap_m: 0.01,
        refusals: Refusals::default(),
    }
}

pub(crate) fn asking(station: &str, tolerance_m: f64) -> DeliveryRequest {
    DeliveryRequest {
        station: station.into(),
        part_class: "washer".into(),
        pose_classes: Vec::new(),
        tolerance_m,
        part_gap_m_min: None,
        timeout: None,
    }
}

impl World {
    pub(crate) const LATENCY: Duration = Duration::from_millis(50);
    /// Feeding that brings one part onto the plateau, in ticks.
    const TICKS_PER_PART: u32 = 150;
    const FACE_UP: &'static str = "face_up";

    pub(crate) fn new(faults: Faults, config: DeliveryConfig) -> Self {
        Self::sharing("feeder", CourierConfig::default(), faults, config, None)
    }

    pub(crate) fn sharing(
        name: &str,
        courier: CourierConfig,
        faults: Faults,
        config: DeliveryConfig,
        platen: Option<Rc<RefCell<Platen>>>,
    ) -> Self {
        let config = DeliveryConfig { arbitrated: platen.is_some(), ..config };
        let limits = CourierLimits::default();
        Self {
            name: name.into(),
            now: Stamp::ZERO,
            driver: SimulatedCourier { config: courier, ..SimulatedCourier::default() }.driver(1).unwrap(),
            sequencer: DeliverySequencer::new(config, TrayGeometry::PAPER, limits, Load::default()).unwrap(),
            faults,
            parts: Vec::new(),
            added: 0,
            fed: 0,
            barren: false,
            refusals: Refusals::default(),
            moves: BTreeMap::new(),
            to_world: VecDeque::new(),
            to_sequencer: VecDeque::new(),
            log: Vec::new(),
            vibrating_moves: 0,
            platen,
        }
    }

    pub(crate) fn add_part(&mut self, x_m: f64, y_m: f64) {
        self.added += 1;
        let position_in_tray_m = Vector2::new(x_m, y_m);
        self.parts.push(Lying {
            id: self.added,
            position_in_tray_m,
            pose_class: Self::FACE_UP,
            refusals: self.refusals,
        });
    }

    pub(crate) fn clear_parts(&mut self) {
        self.parts.clear();
    }

    pub(crate) fn request(&mut self, station: &str, timeout_s: Option<u64>) -> DeliveryId {
        let request = DeliveryRequest { timeout: timeout_s.map(Duration::from_secs), ..asking(station, 0.5e-3) };
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
            Output::Move(id, plan) => {
                if self.faults.part_falls {
                    self.parts.clear();
                }
                if self.faults.part_turns {
                    self.parts.iter_mut().for_each(|part| part.pose_class = "face_down");
                }
                if self.faults.parts_slide {
                    self.parts.iter_mut().for_each(|part| part.position_in_tray_m.x += 0.2e-3);
                }
                match self.driver.execute(1, &plan.trajectory()) {
                    Ok(goal) => drop(self.moves.insert(goal, id)),
                    Err(rejection) => self.tell(Heard::MoveEnded(id, Err(rejection.to_string()))),
                }
            }
            Output::CancelMove(id) => {
                let goal = self.moves.iter().find(|(_, named)| **named == id).map(|(goal, _)| *goal);
                goal.map(|goal| self.driver.cancel(goal));
            }
            Output::Presented(id, delivered) if !self.faults.manipulator_silent => {
                let taken = !self.faults.manipulator_misses;
                if taken {
                    self.parts.retain(|part| part.id != delivered.choice.candidate.id);
                }
                self.tell(Heard::HandOver(id, if taken { HandOver::Taken } else { HandOver::NotTaken }));
                if !self.faults.never_released {
                    self.tell(Heard::HandOver(id, HandOver::Released));
                }
            }
            Output::Reserve { .. } | Output::Renew { .. } | Output::Release(_) => self.reserve(output),
            _ => {}
        }
    }

    fn reserve(&mut self, output: Output) {
        let platen = Rc::clone(self.platen.as_ref().unwrap());
        let mut platen = platen.borrow_mut();
        match output {
            Output::Reserve { id, area, parked, duration, wait } => {
                platen.asked += 1;
                let ticket = platen.asked;
                platen.tickets.insert(ticket, (self.name.clone(), id));
                let agent = self.name.clone();
                let reservation = Reservation { agent, area, parked, occupied: true, duration, wait };
                platen.arbiter.reserve(self.now, ticket, reservation);
            }
            Output::Renew { id, lease, duration } => {
                let renewed = platen.arbiter.renew(self.now, &self.name, lease.parse().unwrap(), duration);
                let answer = renewed.map(|expires| (lease, expires)).map_err(|error| error.to_string());
                platen.answers.push((self.name.clone(), id, answer));
            }
            Output::Release(lease) => platen.arbiter.release(&self.name, lease.parse().unwrap()).unwrap(),
            _ => {}
        }
    }

    /// Takes the arbiter's answers for this world.
    fn hear_platen(&mut self) {
        let Some(platen) = self.platen.clone() else { return };
        let mine: Vec<_> = {
            let mut platen = platen.borrow_mut();
            let (mine, others) =
                std::mem::take(&mut platen.answers).into_iter().partition(|(name, ..)| *name == self.name);
            platen.answers = others;
            mine
        };
        for (_, id, answer) in mine {
            self.tell(Heard::Area(id, answer));
        }
    }

    pub(crate) fn tick(&mut self) {
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
        if status.vibration == VibrationPhase::Steady && !self.barren {
            self.fed += 1;
            if self.fed.is_multiple_of(Self::TICKS_PER_PART) {
                self.add_part(0.06, -0.02 - 1e-5 * f64::from(self.fed));
            }
        }
        if self.now.as_millis().is_multiple_of(100) && !self.faults.blind {
            self.tell(Heard::Frame(self.frame()));
        }
        self.hear_platen();
        while self.to_sequencer.front().is_some_and(|(due, _)| *due <= self.now) {
            match self.to_sequencer.pop_front().unwrap().1 {
                Heard::Courier(report) => self.sequencer.courier(report),
                Heard::Frame(frame) => self.sequencer.candidates(frame),
                Heard::MoveEnded(id, result) => self.sequencer.move_ended(id, result),
                Heard::FeedRefused => self.sequencer.feed_refused("refused by a test".into()),
                // A report on a delivery that was given up meanwhile is refused, as it should be.
                Heard::HandOver(id, report) => drop(self.sequencer.report_hand_over(id, report)),
                Heard::Area(id, answer) => self.sequencer.area_answered(id, answer),
            }
        }
        for output in self.sequencer.step(self.now) {
            self.log.push((self.now, output.clone()));
            self.to_world.push_back((self.now + Self::LATENCY, output));
        }
    }

    fn frame(&self) -> CandidateFrame {
        let candidates = self.parts.iter().map(|part| OfferedPart {
            pose_class: Some(part.pose_class.into()),
            refusals: part.refusals,
            ..washer(part.id, part.position_in_tray_m)
        });
        CandidateFrame { stamp: self.now, candidates: candidates.collect(), is_blind: false }
    }

    pub(crate) fn run(&mut self, seconds: u64) {
        for _ in 0..seconds * 100 {
            self.tick();
        }
    }

    /// Runs until the sequencer is in a phase.
    pub(crate) fn run_until(&mut self, phase: Phase) {
        for _ in 0..10_000 {
            if self.sequencer.phase() == phase {
                return;
            }
            self.tick();
        }
        panic!("{phase:?} did not come within 100 s; the phase is {:?}", self.sequencer.phase());
    }

    pub(crate) fn finished(&self) -> Vec<(DeliveryId, Result<(), Failure>)> {
        self.log
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Finished(id, result) => Some((*id, result.as_ref().map(|_| ()).map_err(Clone::clone))),
                _ => None,
            })
            .collect()
    }

    pub(crate) fn phases(&self) -> Vec<Phase> {
        self.log
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Phase { phase, .. } => Some(*phase),
                _ => None,
            })
            .collect()
    }

    pub(crate) fn position(&mut self) -> Vector3<f64> {
        self.driver.motor_mut().motion().0
    }
}
