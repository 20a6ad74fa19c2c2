//! The overhead manipulator: a vertical axis z and a rotation θ about it, above a fixed point of the platen.
//!
//! It keeps some requests for parts open. When a part lies under its axis it turns its gripper to the part's yaw, goes down,
//! closes, comes up and puts the part away; what the feeder presents meanwhile waits. It cannot move sideways: the feeder
//! brings the part under its axis.

mod axis;
mod config;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use axis::RestToRest;
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64Mcg;

use feeder_model::range::OutOfRange;

pub use axis::AxisSpeed;
pub use config::ManipulatorConfig;

/// A part presented under the axis, in the station's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Presented {
    /// Which delivery this is.
    pub delivery_id: String,
    /// Offset from the axis along x, m.
    pub x_m: f64,
    /// Offset from the axis along y, m.
    pub y_m: f64,
    /// Yaw that the tool must have to grip it, rad.
    pub yaw_rad: f64,
}

/// What the manipulator hears.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The feeder refused a request, or one ended without a part presented.
    NoPart(String),
    /// A part lies under the axis.
    Presented(Presented),
    /// A part that was presented is so no longer.
    Withdrawn {
        /// Which delivery.
        delivery_id: String,
    },
    /// The gripper holds a part, or not and why.
    Gripped(Result<(), String>),
}

/// What the manipulator does.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Ask the feeder for a part.
    Request,
    /// Close the gripper: the tool is this far from the axis, at this height above the plateau with this rotation.
    Grip {
        /// Which delivery.
        delivery_id: String,
        /// Offset from the axis along x, m.
        x_m: f64,
        /// Offset from the axis along y, m.
        y_m: f64,
        /// Height above the plateau, m.
        z_m: f64,
        /// Rotation, rad.
        theta_rad: f64,
    },
    /// Tell the feeder whether the part was taken, and if not why.
    Report {
        /// Which delivery.
        delivery_id: String,
        /// Whether the part was taken, and if not why.
        taken: Result<(), String>,
    },
    /// Tell the feeder that the tool is out of its way.
    Release {
        /// Which delivery.
        delivery_id: String,
    },
}

#[derive(Clone, Debug, PartialEq)]
enum Phase {
    /// Up and empty.
    Ready,
    Descending(Presented),
    /// When the gripper will have closed, s.
    Closing(Presented, f64),
    Gripping(Presented),
    /// Which delivery, and how long it takes to put its part away, s.
    Ascending(String, f64),
    /// Until when a part is put away, s.
    Placing(f64),
}

/// The manipulator. Time arrives as an argument, s.
#[derive(Clone, Debug, PartialEq)]
pub struct Manipulator {
    config: ManipulatorConfig,
    phase: Phase,
    /// Requests that have not come to nothing, and whose part has not been put away.
    open: u32,
    /// Not to ask before this, s.
    may_ask_s: f64,
    /// Parts that wait under the axis for the gripper.
    presented: VecDeque<Presented>,
    z: RestToRest,
    theta: RestToRest,
    random: Pcg64Mcg,
    picks: u32,
}

impl Manipulator {
    /// A manipulator at rest above its station, about to ask for parts. Its errors are drawn from `random`.
    ///
    /// # Errors
    /// The first parameter out of its range.
    pub fn new(config: ManipulatorConfig, random: Pcg64Mcg) -> Result<Self, OutOfRange> {
        config.validate()?;
        Ok(Self {
            config,
            random,
            picks: 0,
            phase: Phase::Ready,
            open: 0,
            may_ask_s: 0.0,
            presented: VecDeque::new(),
            z: RestToRest::new(config.travel_height_m, config.travel_height_m, 0.0, config.z),
            theta: RestToRest::new(0.0, 0.0, 0.0, config.theta),
        })
    }

    /// Height above the plateau (m) and its speed, rotation (rad) and its speed.
    #[must_use]
    pub fn joints(&self, now_s: f64) -> [(f64, f64); 2] {
        [self.z.at(now_s), self.theta.at(now_s)]
    }

    /// Takes in what was heard and says what to do now.
    pub fn step(&mut self, now_s: f64, events: &[Event]) -> Vec<Action> {
        if self.config.silent_after.is_some_and(|picks| self.picks >= picks) {
            return Vec::new();
        }
        let mut actions = Vec::new();
        for event in events {
            self.hear(now_s, event, &mut actions);
        }
        self.work(now_s, &mut actions);
        if matches!(self.phase, Phase::Ready)
            && let Some(part) = self.presented.pop_front()
        {
            self.take_up(now_s, part, &mut actions);
            self.work(now_s, &mut actions);
        }
        while self.open < self.config.goals_open && now_s >= self.may_ask_s {
            self.open += 1;
            actions.push(Action::Request);
        }
        actions
    }

    /// Goes on with the part in hand.
    fn work(&mut self, now_s: f64, actions: &mut Vec<Action>) {
        match self.phase.clone() {
            Phase::Descending(part) if now_s >= self.z.end_s().max(self.theta.end_s()) => {
                self.phase = Phase::Closing(part, now_s + self.config.grip_s);
            }
            Phase::Closing(part, closed_s) if now_s >= closed_s => {
                self.picks += 1;
                if self.random.random_bool(self.config.pick_failure_probability) {
                    // The fingers close on the part, but do not keep it.
                    let lost = Err("the part slipped out of the gripper".to_owned());
                    self.ascend(now_s, part.delivery_id, lost, actions);
                } else {
                    let [x_m, y_m] = self.pick_error_m();
                    let (z_m, theta_rad) = (self.z.at(now_s).0, self.theta.at(now_s).0);
                    let delivery_id = part.delivery_id.clone();
                    actions.push(Action::Grip { delivery_id, x_m, y_m, z_m, theta_rad });
                    self.phase = Phase::Gripping(part);
                }
            }
            Phase::Ascending(delivery_id, place_s) if now_s >= self.z.end_s() => {
                actions.push(Action::Release { delivery_id });
                self.phase = Phase::Placing(now_s + place_s);
                self.work(now_s, actions);
            }
            Phase::Placing(until_s) if now_s >= until_s => {
                self.open = self.open.saturating_sub(1);
                self.phase = Phase::Ready;
            }
            _ => {}
        }
    }

    /// Goes down to a part, unless it lies too far from the axis.
    fn take_up(&mut self, now_s: f64, part: Presented, actions: &mut Vec<Action>) {
        let offset_m = part.x_m.hypot(part.y_m);
        if offset_m > self.config.tolerance_m {
            let reason = format!(
                "the part lies {:.3} mm from the axis, allowed is {:.3} mm",
                offset_m * 1e3,
                self.config.tolerance_m * 1e3
            );
            return self.ascend(now_s, part.delivery_id, Err(reason), actions);
        }
        self.theta = RestToRest::new(self.theta.at(now_s).0, part.yaw_rad, now_s, self.config.theta);
        self.z = RestToRest::new(self.z.at(now_s).0, 0.0, now_s, self.config.z);
        self.phase = Phase::Descending(part);
    }

    /// Tells how the hand-over went, and comes up.
    fn ascend(&mut self, now_s: f64, delivery_id: String, taken: Result<(), String>, actions: &mut Vec<Action>) {
        let place_s = if taken.is_ok() { self.config.place_s } else { 0.0 };
        actions.push(Action::Report { delivery_id: delivery_id.clone(), taken });
        self.z = RestToRest::new(self.z.at(now_s).0, self.config.travel_height_m, now_s, self.config.z);
        self.phase = Phase::Ascending(delivery_id, place_s);
    }

    /// How far the gripper closes from where it was told to, along x and y, m.
    fn pick_error_m(&mut self) -> [f64; 2] {
        [(); 2].map(|()| {
            let standard: f64 = StandardNormal.sample(&mut self.random);
            self.config.pick_error_m * standard
        })
    }

    fn hear(&mut self, now_s: f64, event: &Event, actions: &mut Vec<Action>) {
        match (event, &self.phase) {
            (Event::Presented(part), _) => self.presented.push_back(part.clone()),
            (Event::Gripped(taken), Phase::Gripping(part)) => {
                self.ascend(now_s, part.delivery_id.clone(), taken.clone(), actions);
            }
            (Event::Gripped(_), _) => {}
            // Ask again after a while, so that a feeder that refuses is not asked a hundred times a second.
            (Event::NoPart(_), _) => {
                self.open = self.open.saturating_sub(1);
                self.may_ask_s = now_s + self.config.place_s;
            }
            // What is in hand is seen to its end.
            (Event::Withdrawn { delivery_id }, _) => {
                if let Some(index) = self.presented.iter().position(|part| part.delivery_id == *delivery_id) {
                    self.presented.remove(index);
                    self.open = self.open.saturating_sub(1);
                }
            }
        }
    }
}
