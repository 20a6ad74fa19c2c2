//! The overhead manipulator: a vertical axis z and a rotation θ about it, above a fixed point of the platen.
//!
//! It asks the feeder for a part, turns its gripper to the part's yaw while the part comes, goes down, closes, comes up
//! and puts the part away. It cannot move sideways: the feeder brings the part under its axis.

mod axis;

pub use axis::AxisSpeed;
use axis::RestToRest;
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_pcg::Pcg64Mcg;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::{OutOfRange, check_ranges};

/// A manipulator and how it works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ManipulatorConfig {
    /// Height of the open gripper above the plateau while it waits, m.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub travel_height_m: f64,
    /// The vertical axis.
    pub z: AxisSpeed,
    /// The rotation.
    pub theta: AxisSpeed,
    /// Time the gripper takes to close, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub grip_s: f64,
    /// Time it takes to put a part away before it asks for the next, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub place_s: f64,
    /// Largest offset of a presented part from the axis that it still picks, m.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub tolerance_m: f64,
    /// How long it waits for a part before it asks anew, s.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub timeout_s: f64,
    /// How far the gripper closes from where it was told to, along each of x and y: standard deviation, m.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub pick_error_m: f64,
    /// Share of picks that fail: the gripper loses the part again before it is lifted.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub pick_failure_probability: f64,
    /// A fault to test with: after so many picks it never says anything again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub silent_after: Option<u32>,
}

impl Default for ManipulatorConfig {
    fn default() -> Self {
        Self {
            travel_height_m: 0.030,
            z: AxisSpeed { speed_max: 0.3, acceleration_max: 5.0 },
            theta: AxisSpeed { speed_max: 10.0, acceleration_max: 200.0 },
            grip_s: 0.05,
            place_s: 1.0,
            tolerance_m: 0.0005,
            timeout_s: 60.0,
            pick_error_m: 0.0,
            pick_failure_probability: 0.0,
            silent_after: None,
        }
    }
}

impl ManipulatorConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("", self)?;
        check_ranges("z.", &self.z)?;
        check_ranges("theta.", &self.theta)
    }
}

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
    /// The feeder took the request up.
    Accepted,
    /// The feeder refused the request, or the request ended without a part presented.
    NoPart(String),
    /// A part lies under the axis.
    Presented(Presented),
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
    /// Until when it rests, s.
    Resting(f64),
    /// Since when it has waited, s.
    Waiting(f64),
    Descending(Presented),
    /// When the gripper will have closed, s.
    Closing(Presented, f64),
    Gripping(Presented),
    /// Which delivery, and how long to rest after it, s.
    Ascending(String, f64),
}

/// The manipulator. Time arrives as an argument, s.
#[derive(Clone, Debug, PartialEq)]
pub struct Manipulator {
    config: ManipulatorConfig,
    phase: Phase,
    z: RestToRest,
    theta: RestToRest,
    random: Pcg64Mcg,
    picks: u32,
}

impl Manipulator {
    /// A manipulator at rest above its station, about to ask for a part. Its errors are drawn from `random`.
    ///
    /// # Errors
    /// The first parameter out of its range.
    pub fn new(config: ManipulatorConfig, random: Pcg64Mcg) -> Result<Self, OutOfRange> {
        config.validate()?;
        Ok(Self {
            config,
            random,
            picks: 0,
            phase: Phase::Resting(0.0),
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
        match self.phase.clone() {
            Phase::Resting(until_s) if now_s >= until_s => {
                self.phase = Phase::Waiting(now_s);
                actions.push(Action::Request);
            }
            Phase::Descending(part) if now_s >= self.z.end_s().max(self.theta.end_s()) => {
                self.phase = Phase::Closing(part, now_s + self.config.grip_s);
            }
            Phase::Closing(part, closed_s) if now_s >= closed_s => {
                self.picks += 1;
                if self.random.random_bool(self.config.pick_failure_probability) {
                    // The fingers close on the part, but do not keep it.
                    let lost = Err("the part slipped out of the gripper".to_owned());
                    self.ascend(now_s, part.delivery_id, lost, &mut actions);
                } else {
                    let [x_m, y_m] = self.pick_error_m();
                    actions.push(Action::Grip { x_m, y_m, z_m: self.z.at(now_s).0, theta_rad: self.theta.at(now_s).0 });
                    self.phase = Phase::Gripping(part);
                }
            }
            Phase::Ascending(delivery_id, rest_s) if now_s >= self.z.end_s() => {
                self.phase = Phase::Resting(now_s + rest_s);
                actions.push(Action::Release { delivery_id });
            }
            _ => {}
        }
        actions
    }

    /// Tells how the hand-over went, and comes up.
    fn ascend(&mut self, now_s: f64, delivery_id: String, taken: Result<(), String>, actions: &mut Vec<Action>) {
        let rest_s = if taken.is_ok() { self.config.place_s } else { 0.0 };
        actions.push(Action::Report { delivery_id: delivery_id.clone(), taken });
        self.z = RestToRest::new(self.z.at(now_s).0, self.config.travel_height_m, now_s, self.config.z);
        self.phase = Phase::Ascending(delivery_id, rest_s);
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
            (Event::Presented(part), Phase::Waiting(_)) => {
                let offset_m = part.x_m.hypot(part.y_m);
                if offset_m > self.config.tolerance_m {
                    let reason = format!(
                        "the part lies {:.3} mm from the axis, allowed is {:.3} mm",
                        offset_m * 1e3,
                        self.config.tolerance_m * 1e3
                    );
                    self.ascend(now_s, part.delivery_id.clone(), Err(reason), actions);
                    return;
                }
                let (theta, _) = self.theta.at(now_s);
                let (z, _) = self.z.at(now_s);
                self.theta = RestToRest::new(theta, part.yaw_rad, now_s, self.config.theta);
                self.z = RestToRest::new(z, 0.0, now_s, self.config.z);
                self.phase = Phase::Descending(part.clone());
            }
            (Event::Gripped(taken), Phase::Gripping(part)) => {
                self.ascend(now_s, part.delivery_id.clone(), taken.clone(), actions);
            }
            // Ask again after a while, so that a feeder that refuses is not asked a hundred times a second.
            (Event::NoPart(_), Phase::Waiting(_)) => self.phase = Phase::Resting(now_s + self.config.place_s),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn presented(x_m: f64) -> Event {
        Event::Presented(Presented { delivery_id: "d1".into(), x_m, y_m: 0.0, yaw_rad: 1.0 })
    }

    /// Runs until an action comes out.
    fn until_action(manipulator: &mut Manipulator, now_s: &mut f64) -> Action {
        for _ in 0..10_000 {
            *now_s += 0.01;
            if let Some(action) = manipulator.step(*now_s, &[]).pop() {
                return action;
            }
        }
        panic!("no action within 100 s")
    }

    fn manipulator(config: ManipulatorConfig) -> Manipulator {
        Manipulator::new(config, feeder_model::seed::generator(1, "manipulator")).unwrap()
    }

    /// Presents one part and says how the gripper fared; returns everything the manipulator does until it asks again.
    fn pick(manipulator: &mut Manipulator, now_s: &mut f64, gripped: &Result<(), String>) -> Vec<Action> {
        manipulator.step(*now_s, &[Event::Accepted]);
        let mut actions = manipulator.step(*now_s, &[presented(0.0001)]);
        while actions.last() != Some(&Action::Request) {
            let mut action = until_action(manipulator, now_s);
            while let Action::Grip { .. } = action {
                actions.push(action);
                actions.extend(manipulator.step(*now_s, &[Event::Gripped(gripped.clone())]));
                action = until_action(manipulator, now_s);
            }
            actions.push(action);
        }
        actions
    }

    #[test]
    fn a_part_is_asked_for_gripped_at_plateau_height_reported_and_the_feeder_released() {
        let mut manipulator = manipulator(ManipulatorConfig::default());
        let mut now_s = 0.0;
        assert_eq!(manipulator.step(now_s, &[]), [Action::Request]);
        let actions = pick(&mut manipulator, &mut now_s, &Ok(()));
        let expected = [
            Action::Grip { x_m: 0.0, y_m: 0.0, z_m: 0.0, theta_rad: 1.0 },
            Action::Report { delivery_id: "d1".into(), taken: Ok(()) },
            Action::Release { delivery_id: "d1".into() },
            Action::Request,
        ];
        assert_eq!(actions, expected);
        let [(z_m, speed_m_s), _] = manipulator.joints(now_s);
        assert_eq!((z_m, speed_m_s), (ManipulatorConfig::default().travel_height_m, 0.0));
    }

    #[test]
    fn a_part_off_the_axis_is_not_taken() {
        let mut manipulator = manipulator(ManipulatorConfig::default());
        manipulator.step(0.0, &[]);
        let actions = manipulator.step(0.1, &[presented(0.002)]);
        assert!(matches!(&actions[0], Action::Report { taken: Err(reason), .. } if reason.contains("2.000 mm")));
        // The tool never came down.
        assert_eq!(actions[1..], [Action::Release { delivery_id: "d1".into() }]);
        assert_eq!(manipulator.step(0.2, &[]), [Action::Request]);
    }

    #[test]
    fn the_tolerance_is_the_one_configured() {
        let tolerance_m = ManipulatorConfig::default().tolerance_m;
        for (share, is_taken) in [(0.99, true), (1.01, false)] {
            let mut manipulator = manipulator(ManipulatorConfig::default());
            manipulator.step(0.0, &[]);
            let refused = !manipulator.step(0.1, &[presented(share * tolerance_m)]).is_empty();
            assert_eq!(refused, !is_taken);
        }
    }

    #[test]
    fn the_gripper_closes_when_height_and_rotation_have_both_arrived() {
        let slow = AxisSpeed { speed_max: 0.5, acceleration_max: 5.0 };
        let defaults = ManipulatorConfig::default();
        let low = AxisSpeed { speed_max: 0.005, ..defaults.z };
        for config in [ManipulatorConfig { theta: slow, ..defaults }, ManipulatorConfig { z: low, ..defaults }] {
            let mut manipulator = manipulator(config);
            let mut now_s = 0.0;
            manipulator.step(now_s, &[]);
            manipulator.step(now_s, &[presented(0.0)]);
            let grip = until_action(&mut manipulator, &mut now_s);
            assert_eq!(grip, Action::Grip { x_m: 0.0, y_m: 0.0, z_m: 0.0, theta_rad: 1.0 });
        }
    }

    #[test]
    fn the_gripper_is_given_its_time_to_close() {
        let config = ManipulatorConfig { grip_s: 0.2, ..Default::default() };
        let mut manipulator = manipulator(config);
        let mut now_s = 1.0;
        manipulator.step(now_s, &[]);
        manipulator.step(now_s, &[presented(0.0)]);
        let (mut there_s, mut gripped_s) = (None, None);
        for _ in 0..200 {
            now_s += 0.01;
            let is_there = manipulator.joints(now_s) == [(0.0, 0.0), (1.0, 0.0)];
            there_s = there_s.or(is_there.then_some(now_s));
            gripped_s = gripped_s.or(manipulator.step(now_s, &[]).pop().map(|_| now_s));
        }
        let closing_s = gripped_s.unwrap() - there_s.unwrap();
        assert!((0.2 - 1e-9..0.23).contains(&closing_s), "{closing_s}");
    }

    #[test]
    fn the_next_part_is_asked_for_when_the_last_is_put_away_and_a_while_after_a_refusal() {
        let config = ManipulatorConfig::default();
        let mut manipulator = manipulator(config);
        let mut now_s = 3.0;
        manipulator.step(now_s, &[]);
        let waits = |manipulator: &mut Manipulator, now_s: &mut f64| {
            let since_s = *now_s;
            assert_eq!(until_action(manipulator, now_s), Action::Request);
            *now_s - since_s
        };
        manipulator.step(now_s, &[Event::NoPart("none fits".into())]);
        let after_refusal_s = waits(&mut manipulator, &mut now_s);
        manipulator.step(now_s, &[presented(0.0)]);
        assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Grip { .. }));
        manipulator.step(now_s, &[Event::Gripped(Ok(()))]);
        assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Release { .. }));
        let after_pick_s = waits(&mut manipulator, &mut now_s);
        for waited_s in [after_refusal_s, after_pick_s] {
            assert!((config.place_s - 1e-9..config.place_s + 0.03).contains(&waited_s), "{waited_s}");
        }
    }

    #[test]
    fn the_feeder_is_released_when_the_tool_is_up() {
        let mut manipulator = manipulator(ManipulatorConfig::default());
        let mut now_s = 0.0;
        manipulator.step(now_s, &[]);
        manipulator.step(now_s, &[presented(0.0)]);
        until_action(&mut manipulator, &mut now_s);
        manipulator.step(now_s, &[Event::Gripped(Ok(()))]);
        assert_eq!(until_action(&mut manipulator, &mut now_s), Action::Release { delivery_id: "d1".into() });
        let [(z_m, speed_m_s), _] = manipulator.joints(now_s);
        assert_eq!((z_m, speed_m_s), (ManipulatorConfig::default().travel_height_m, 0.0));
    }

    #[test]
    fn picks_miss_and_fail_as_often_and_as_far_as_configured() {
        let config = ManipulatorConfig { pick_error_m: 2e-4, pick_failure_probability: 0.25, ..Default::default() };
        let mut manipulator = manipulator(config);
        let mut now_s = 0.0;
        manipulator.step(now_s, &[]);
        let (mut failed, mut errors_m) = (0, Vec::new());
        for _ in 0..400 {
            for action in pick(&mut manipulator, &mut now_s, &Ok(())) {
                match action {
                    Action::Grip { x_m, y_m, .. } => errors_m.extend([x_m, y_m]),
                    Action::Report { taken: Err(_), .. } => failed += 1,
                    _ => {}
                }
            }
        }
        // 400 × 0.25 ± 4 √(400 × 0.25 × 0.75); the deviation of about 600 numbers is within 4/√1200 of the true one.
        assert!((65..=135).contains(&failed), "{failed}");
        let deviation_m = (errors_m.iter().map(|m| m * m).sum::<f64>() / errors_m.len() as f64).sqrt();
        assert!((deviation_m / 2e-4 - 1.0).abs() < 0.12, "{deviation_m}");
    }

    #[test]
    fn a_silent_manipulator_says_nothing_after_its_last_pick() {
        let mut manipulator = manipulator(ManipulatorConfig { silent_after: Some(1), ..Default::default() });
        let mut now_s = 0.0;
        manipulator.step(now_s, &[]);
        manipulator.step(now_s, &[presented(0.0)]);
        assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Grip { .. }));
        for _ in 0..1000 {
            now_s += 0.01;
            assert_eq!(manipulator.step(now_s, &[Event::Gripped(Ok(()))]), []);
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let bad = [
            (ManipulatorConfig { grip_s: f64::NAN, ..Default::default() }, "grip_s"),
            (ManipulatorConfig { pick_error_m: -1.0, ..Default::default() }, "pick_error_m"),
            (ManipulatorConfig { pick_failure_probability: 1.5, ..Default::default() }, "pick_failure_probability"),
        ];
        for (config, named) in bad {
            assert!(config.validate().unwrap_err().to_string().contains(named));
        }
    }
}
