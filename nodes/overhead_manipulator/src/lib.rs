//! A sample partner agent: an overhead (z, θ) manipulator that keeps asking a feeder for parts and picks them.
//!
//! It knows the feeders by their public interface alone: the action `deliver_part` and the service `report_handover`.
//! Where a scenario names several feeders for a station, it asks them in turn.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use feeder_control::manipulator::{Action, Event, Manipulator, ManipulatorConfig, Presented};
use feeder_model::delivery::{HandOver, Outcome, Phase};
use feeder_model::seed::generator;
use feeder_runtime::node::{
    ActionClient, ActionClientPorts, CallId, Client, ClientEvent, Declare, FeederNode, GoalId, NodeError, Publisher,
    StepIo,
};
use feeder_scenario::plan::{NodeConfig, OverheadManipulatorConfig};
use feeder_wire::deliver_part::{self, DeliveryProgress, PartWanted, PresentedPart};
use feeder_wire::hand_over::{self, HandOverReport};
use feeder_wire::joints::{self, Joint};
use feeder_wire::pick::{self, GripRequest};
use feeder_wire::pose::UprightPose;
use feeder_wire::robot_description::{self, Tool};
use feeder_wire::{frames, nodes, response, services, topics};
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartResult};
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::srv::{Pick, ReportHandover, ReportHandoverRequest};
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use nalgebra::Isometry3;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// What the manipulator uses of one feeder.
struct FeederPorts {
    deliver: ActionClientPorts<DeliverPart>,
    pick: Client<Pick>,
    report: Client<ReportHandover>,
}

/// One feeder.
struct Feeder {
    deliver: ActionClient<DeliverPart>,
    pick: Client<Pick>,
    report: Client<ReportHandover>,
}

/// How often a report is sent before the feeder is given up.
const REPORT_ATTEMPTS: u32 = 3;

/// A goal that has not ended.
struct OpenGoal {
    id: GoalId,
    /// Index of the feeder.
    feeder: usize,
    /// Once its part is presented.
    delivery_id: Option<String>,
    /// Number of the last report on this delivery.
    sequence: u32,
}

/// A report on a hand-over that its feeder has not answered yet.
struct OpenReport {
    /// Index of the feeder.
    feeder: usize,
    request: ReportHandoverRequest,
    attempts: u32,
}

/// Handles of the manipulator's ports.
pub struct Ports {
    feeders: Vec<FeederPorts>,
    publishers: Publishers,
}

/// What the manipulator says.
#[derive(Clone, Copy)]
struct Publishers {
    joint_states: Publisher<JointState>,
    tf: Publisher<TFMessage>,
    tf_static: Publisher<TFMessage>,
    description: Publisher<Text>,
}

/// The manipulator.
pub struct OverheadManipulator {
    feeders: Vec<Feeder>,
    /// Index of the feeder asked last.
    asked: usize,
    publishers: Publishers,
    manipulator: Manipulator,
    config: OverheadManipulatorConfig,
    random: Pcg64Mcg,
    goals: Vec<OpenGoal>,
    /// Why there was no part last, until there is one: said once, however often it is asked for.
    no_part: Option<String>,
    /// What the manipulator is to hear of itself in the next step.
    own_events: Vec<Event>,
    gripping: Option<CallId>,
    /// In the order they are to be heard in.
    reports: VecDeque<OpenReport>,
    /// The first of them, on its way.
    reporting: Option<CallId>,
}

impl FeederNode for OverheadManipulator {
    const NAME: &'static str = nodes::OVERHEAD_MANIPULATOR;
    type Config = OverheadManipulatorConfig;
    type Ports = Ports;

    fn tick(config: &OverheadManipulatorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &OverheadManipulatorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, config: &OverheadManipulatorConfig) -> Ports {
        let feeders = config.feeders.iter().map(|feeder| FeederPorts {
            deliver: io.action_client_in(&format!("/{}", feeder.name), &services::DELIVER_PART),
            pick: io.client_in(&feeder.pick_namespace, &services::PICK),
            report: io.client_in(&format!("/{}", feeder.name), &services::REPORT_HANDOVER),
        });
        Ports {
            feeders: feeders.collect(),
            publishers: Publishers {
                joint_states: io.publisher(&topics::TOOL_JOINT_STATES),
                tf: io.publisher(&topics::TF),
                tf_static: io.publisher(&topics::TF_STATIC),
                description: io.publisher(&topics::TOOL_DESCRIPTION),
            },
        }
    }

    fn open(ports: Ports, config: &OverheadManipulatorConfig) -> Result<Self, NodeError> {
        let feeders = ports.feeders.into_iter().map(|feeder| Feeder {
            deliver: ActionClient::new(feeder.deliver),
            pick: feeder.pick,
            report: feeder.report,
        });
        let random = generator(config.seed, &format!("{}/pick", config.station));
        Ok(Self {
            feeders: feeders.collect(),
            asked: 0,
            publishers: ports.publishers,
            manipulator: Manipulator::new(config.manipulator, random).map_err(NodeError::new)?,
            random: generator(config.seed, &config.station),
            config: config.clone(),
            goals: Vec::new(),
            no_part: None,
            own_events: Vec::new(),
            gripping: None,
            reports: VecDeque::new(),
            reporting: None,
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        if io.tick() == 0 {
            io.publish(&self.publishers.tf_static, &self.mounting(io));
            io.publish(&self.publishers.description, &self.description());
        }
        let events = self.hear(io);
        let now_s = io.now_s();
        for action in self.manipulator.step(now_s, &events) {
            self.act(io, action);
        }
        let joints = self.manipulator.joints(now_s);
        let named = self.joint_names().into_iter().zip(joints).map(|(name, (position, velocity))| Joint {
            name,
            position,
            velocity,
        });
        let state = joints::to_message(io.header(""), &named.collect::<Vec<_>>());
        io.publish(&self.publishers.joint_states, &state);
        io.publish(&self.publishers.tf, &self.transforms(io, joints.map(|(position, _)| position)));
        Ok(())
    }
}

impl OverheadManipulator {
    fn hear(&mut self, io: &mut StepIo) -> Vec<Event> {
        let mut events = std::mem::take(&mut self.own_events);
        for feeder in &mut self.feeders {
            for event in feeder.deliver.poll(io) {
                let (id, end) = match event {
                    ClientEvent::Accepted(_) => continue,
                    ClientEvent::Feedback(id, feedback) => {
                        if let Some(goal) = self.goals.iter_mut().find(|goal| goal.id == id)
                            && goal.delivery_id.is_none()
                            && let Some(part) = presented(feedback, self.config.jaws_yaw_rad)
                        {
                            goal.delivery_id = Some(part.delivery_id.clone());
                            self.no_part = None;
                            events.push(Event::Presented(part));
                        }
                        continue;
                    }
                    ClientEvent::Rejected(id) => (id, Some("the feeder refused the request".to_owned())),
                    ClientEvent::Lost(id) => (id, Some("the feeder does not answer".to_owned())),
                    // Its planner was started again; the result that comes with it is empty, and would read as delivered.
                    ClientEvent::Finished(id, None, _) => (id, Some("the feeder knows no such request".to_owned())),
                    ClientEvent::Finished(id, Some(_), result) => (id, failure(result)),
                };
                let Some(index) = self.goals.iter().position(|goal| goal.id == id) else { continue };
                let goal = self.goals.swap_remove(index);
                let Some(reason) = end else { continue };
                if self.no_part.as_ref() != Some(&reason) {
                    tracing::warn!("no part: {reason}");
                    self.no_part = Some(reason.clone());
                }
                events.push(match goal.delivery_id {
                    None => Event::NoPart(reason),
                    Some(delivery_id) => Event::Withdrawn { delivery_id },
                });
            }
            for (call, response) in io.replies(&feeder.pick) {
                if self.gripping == Some(call) {
                    self.gripping = None;
                    events.push(Event::Gripped(pick::from_response(response).map(|_| ())));
                }
            }
            for (call, response) in io.answers(&feeder.report) {
                if self.reporting != Some(call) {
                    continue;
                }
                self.reporting = None;
                match response {
                    // It may have arrived; by its number the feeder knows it when it comes again.
                    None if self.reports.front().is_some_and(|report| report.attempts < REPORT_ATTEMPTS) => {}
                    None => {
                        tracing::warn!("the feeder does not answer to the report");
                        self.reports.pop_front();
                    }
                    Some(response) => {
                        if let Err(reason) = response::from_message(response) {
                            tracing::warn!("the feeder did not accept the report: {reason}");
                        }
                        self.reports.pop_front();
                    }
                }
            }
        }
        self.send_report(io);
        events
    }

    fn act(&mut self, io: &mut StepIo, action: Action) {
        let config = &self.config.manipulator;
        match action {
            Action::Request => {
                self.asked = (self.asked + 1) % self.feeders.len();
                let id = GoalId(self.random.random());
                self.goals.push(OpenGoal { id, feeder: self.asked, delivery_id: None, sequence: 0 });
                let wanted = PartWanted {
                    station: self.config.station.clone(),
                    part_class: Some(self.config.part_class.clone()),
                    pose_class: Some(self.config.pose_class.clone()),
                    tolerance_m: config.tolerance_m,
                    part_gap_m_min: Some(self.config.part_gap_m_min).filter(|gap_m| *gap_m > 0.0),
                    timeout: Some(Duration::from_secs_f64(config.timeout_s)),
                };
                self.feeders[self.asked].deliver.send(io, id, deliver_part::to_goal(&wanted));
            }
            Action::Grip { delivery_id, x_m, y_m, z_m, theta_rad } => {
                let Some(feeder) = self.goal_of(&delivery_id).map(|goal| goal.feeder) else {
                    let ended = Err("the delivery has ended".to_owned());
                    return self.own_events.push(Event::Gripped(ended));
                };
                let grip = GripRequest {
                    station: self.config.station.clone(),
                    tool_in_platen: UprightPose {
                        x_m: self.config.x_m + x_m,
                        y_m: self.config.y_m + y_m,
                        z_m: self.config.plateau_height_m + z_m,
                        yaw_rad: theta_rad,
                    },
                    opening_m: self.config.gripper_opening_m,
                };
                self.gripping = Some(io.call(&self.feeders[feeder].pick, &pick::to_request(&grip)));
            }
            Action::Report { delivery_id, taken } => {
                let (hand_over, message) = match taken {
                    Ok(()) => (HandOver::Taken, String::new()),
                    Err(message) => (HandOver::NotTaken, message),
                };
                self.report(io, delivery_id, hand_over, message);
            }
            Action::Release { delivery_id } => {
                self.report(io, delivery_id, HandOver::Released, String::new());
            }
        }
    }

    fn goal_of(&mut self, delivery_id: &str) -> Option<&mut OpenGoal> {
        self.goals.iter_mut().find(|goal| goal.delivery_id.as_deref() == Some(delivery_id))
    }

    /// Reports on a delivery; one that has ended needs no report.
    fn report(&mut self, io: &mut StepIo, delivery_id: String, hand_over: HandOver, message: String) {
        let Some(goal) = self.goal_of(&delivery_id) else { return };
        goal.sequence += 1;
        let (feeder, sequence) = (goal.feeder, goal.sequence);
        let request = hand_over::to_request(HandOverReport { delivery_id, sequence, hand_over, message });
        self.reports.push_back(OpenReport { feeder, request, attempts: 0 });
        self.send_report(io);
    }

    /// Sends the next report once the one before is answered.
    fn send_report(&mut self, io: &mut StepIo) {
        if self.reporting.is_none()
            && let Some(next) = self.reports.front_mut()
        {
            next.attempts += 1;
            self.reporting = Some(io.call(&self.feeders[next.feeder].report, &next.request));
        }
    }

    /// The tool frame: where the axis meets the height of the plateau.
    fn mounting(&self, io: &StepIo) -> TFMessage {
        frames::to_message(io.stamp(), frames::PLATEN, &frames::tool(&self.config.station), &self.platen_from_tool())
    }

    /// Where the gripper is, a frame for each joint.
    fn transforms(&self, io: &StepIo, [z_m, theta_rad]: [f64; 2]) -> TFMessage {
        let station = &self.config.station;
        let (slide, gripper) = (frames::tool_slide(station), frames::gripper(station));
        let frames = [
            (slide.as_str(), frames::upright(0.0, 0.0, z_m, 0.0)),
            (&gripper, frames::upright(0.0, 0.0, 0.0, theta_rad)),
        ];
        frames::chain(io.stamp(), &frames::tool(station), frames)
    }

    fn platen_from_tool(&self) -> Isometry3<f64> {
        frames::upright(self.config.x_m, self.config.y_m, self.config.plateau_height_m, 0.0)
    }

    fn joint_names(&self) -> [String; 2] {
        ["z", "theta"].map(|axis| format!("{}_{axis}", self.config.station))
    }

    /// The tool as URDF.
    fn description(&self) -> Text {
        let ManipulatorConfig { travel_height_m, z, theta, .. } = self.config.manipulator;
        let [along, about] = self.joint_names();
        robot_description::tool(&Tool {
            station: &self.config.station,
            platen_from_tool: self.platen_from_tool(),
            joints: [&along, &about],
            height_m_max: travel_height_m,
            speed_max: [z.speed_max, theta.speed_max],
            opening_m: self.config.gripper_opening_m,
        })
    }
}

/// The part that feedback tells of, once it is presented; its yaw is that of the direction across which jaws close, which is
/// `jaws_yaw_rad` in the part's own frame.
fn presented(feedback: DeliverPartFeedback, jaws_yaw_rad: f64) -> Option<Presented> {
    match deliver_part::from_feedback(feedback) {
        Ok(DeliveryProgress { phase: Phase::Presented, delivery_id, part: Some(part), .. }) => {
            let PresentedPart { pose_in_station: UprightPose { x_m, y_m, yaw_rad, .. }, .. } = part;
            let yaw_rad = yaw_rad + jaws_yaw_rad;
            // Jaws are alike: half a turn makes no difference to them.
            Some(Presented { delivery_id, x_m, y_m, yaw_rad: yaw_rad - PI * (yaw_rad / PI).round() })
        }
        Ok(_) => None,
        Err(error) => {
            tracing::warn!("feedback passed over: {error}");
            None
        }
    }
}

/// Why there is no part, if there is none.
fn failure(result: DeliverPartResult) -> Option<String> {
    match deliver_part::from_result(result) {
        Ok(end) => (end.outcome != Outcome::Delivered).then_some(end.reason),
        Err(error) => Some(error.to_string()),
    }
}
