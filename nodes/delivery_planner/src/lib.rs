//! The delivery planner: feeds until a part lies right, carries it gently under a station, hands it over and returns.

mod messages;

use std::collections::BTreeMap;
use std::time::Duration;

use feeder_core::delivery::{
    CourierReport, Delivered, DeliveryId, DeliveryRequest, DeliverySequencer, MoveId, Output, Phase,
};
use feeder_core::scenario::Scenario;
use feeder_core::seed::generator;
use feeder_runtime::dds::Qos;
use feeder_runtime::node::{
    ActionClient, ActionClientPorts, ActionServer, ActionServerPorts, Client, ClientEvent, Declare, FeederNode,
    GoalEnd, GoalId, Latency, NodeError, Publisher, Server, ServerEvent, StepIo, Subscriber, ns_of_stamp, stamp_of_ns,
};
use minifactory_msgs::action::{DeliverPart, DeliverPartFeedback, DeliverPartGoal, DeliverPartResult};
use minifactory_msgs::control_msgs::action::{FollowJointTrajectory, FollowJointTrajectoryResult};
use minifactory_msgs::convert::{planar_pose, yaw_of_quaternion};
use minifactory_msgs::geometry_msgs::msg::Pose;
use minifactory_msgs::msg::{CourierState, DeliveryState};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::srv::{ReportHandover, ReportHandoverRequest, ReportHandoverResponse};
use minifactory_msgs::std_srvs::srv::{SetBool, SetBoolRequest};
use minifactory_msgs::vision_msgs::msg::Detection3DArray;
use nalgebra::Vector3;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Handles of the planner's ports.
pub struct Ports {
    candidates: Subscriber<Detection3DArray>,
    odometry: Subscriber<Odometry>,
    courier_state: Subscriber<CourierState>,
    set_feeding: Client<SetBool>,
    trajectory: ActionClientPorts<FollowJointTrajectory>,
    deliver: ActionServerPorts<DeliverPart>,
    handover: Server<ReportHandover>,
    state: Publisher<DeliveryState>,
}

/// The delivery planner.
pub struct DeliveryPlanner {
    candidates: Subscriber<Detection3DArray>,
    odometry: Subscriber<Odometry>,
    courier_state: Subscriber<CourierState>,
    set_feeding: Client<SetBool>,
    handover: Server<ReportHandover>,
    state: Publisher<DeliveryState>,
    trajectory: ActionClient<FollowJointTrajectory>,
    deliver: ActionServer<DeliverPart>,
    sequencer: DeliverySequencer,
    part_class: String,
    tray_frame: String,
    random: Pcg64Mcg,
    /// Open goals of agents.
    deliveries: BTreeMap<DeliveryId, Open>,
    moves: BTreeMap<MoveId, GoalId>,
    /// What was last said, to be said again when something changes.
    said: DeliveryState,
}

struct Open {
    goal: GoalId,
    station: String,
}

impl FeederNode for DeliveryPlanner {
    const NAME: &'static str = "delivery_planner";
    type Config = Scenario;
    type Ports = Ports;

    fn namespaces(config: &Scenario) -> Vec<String> {
        vec![config.namespace()]
    }

    fn tick(config: &Scenario) -> Duration {
        Duration::from_nanos(config.time.tick_ns())
    }

    fn declare(io: &mut Declare, _: &Scenario) -> Ports {
        Ports {
            candidates: io.subscriber("candidates", Latency::Forward, Qos::command()),
            odometry: io.subscriber("odometry", Latency::Forward, Qos::command()),
            courier_state: io.subscriber("courier_state", Latency::Forward, Qos::command()),
            set_feeding: io.client("set_feeding", Latency::Feedback),
            trajectory: io.action_client("follow_joint_trajectory", Latency::Feedback),
            deliver: io.action_server("deliver_part"),
            handover: io.server("report_handover"),
            state: io.publisher("delivery_state", Qos::command()),
        }
    }

    fn open(ports: Ports, config: &Scenario) -> Result<Self, NodeError> {
        let courier = &config.courier;
        let sequencer = DeliverySequencer::new(config.delivery(), config.tray.geometry, courier.limits, courier.load)
            .map_err(NodeError::new)?;
        Ok(Self {
            candidates: ports.candidates,
            odometry: ports.odometry,
            courier_state: ports.courier_state,
            set_feeding: ports.set_feeding,
            handover: ports.handover,
            state: ports.state,
            trajectory: ActionClient::new(ports.trajectory),
            deliver: ActionServer::new(ports.deliver),
            sequencer,
            part_class: config.part_type().map_err(NodeError::new)?.name,
            tray_frame: format!("{}/tray", config.feeder),
            random: generator(config.seed, Self::NAME),
            deliveries: BTreeMap::new(),
            moves: BTreeMap::new(),
            said: DeliveryState::default(),
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        let now = Duration::from_nanos(io.now_ns());
        self.hear(io);
        self.take_requests(io, now);
        for output in self.sequencer.step(now) {
            self.act(io, now, output);
        }
        Ok(())
    }
}

impl DeliveryPlanner {
    /// Takes in what the feeder's other nodes say.
    fn hear(&mut self, io: &mut StepIo) {
        let states = io.take(&self.courier_state);
        for odometry in io.take(&self.odometry) {
            let stamp_ns = ns_of_stamp(&odometry.header.stamp);
            // Both are published together; without its state a pose says nothing about rest.
            if let Some(state) = states.iter().find(|state| ns_of_stamp(&state.header.stamp) == stamp_ns) {
                let pose = &odometry.pose.pose;
                self.sequencer.courier(CourierReport {
                    stamp: Duration::from_nanos(stamp_ns),
                    position: Vector3::new(pose.position.x, pose.position.y, yaw_of_quaternion(&pose.orientation)),
                    vibrating: state.vibrating,
                    moving: state.moving,
                });
            }
        }
        for message in io.take(&self.candidates) {
            self.sequencer.candidates(messages::candidate_frame(&message));
        }
        for (_, response) in io.replies(&self.set_feeding) {
            if !response.success {
                self.sequencer.feed_refused(response.message);
            }
        }
        for event in self.trajectory.poll(io) {
            let (goal, result) = match event {
                ClientEvent::Accepted(_) | ClientEvent::Feedback(..) => continue,
                ClientEvent::Rejected(goal) => (goal, Err("the courier driver refused the trajectory".to_owned())),
                ClientEvent::Finished(goal, Some(GoalEnd::Succeeded), _) => (goal, Ok(())),
                ClientEvent::Finished(goal, _, FollowJointTrajectoryResult { error_string, .. }) => {
                    (goal, Err(error_string))
                }
            };
            let ended = self.moves.iter().find(|(_, known)| **known == goal).map(|(id, _)| *id);
            if let Some(id) = ended {
                self.moves.remove(&id);
                self.sequencer.move_ended(id, result);
            }
        }
    }

    /// Takes in what other agents ask for.
    fn take_requests(&mut self, io: &mut StepIo, now: Duration) {
        for event in self.deliver.poll(io) {
            match event {
                ServerEvent::Requested(request) => {
                    let station = request.goal.station.clone();
                    match self.request(now, &request.goal) {
                        Ok(id) => {
                            self.deliveries.insert(id, Open { goal: request.id, station });
                            self.deliver.accept(io, request);
                        }
                        Err(reason) => self.deliver.reject(io, request, &reason),
                    }
                }
                ServerEvent::CancelRequested(goal) => {
                    let open = self.deliveries.iter().find(|(_, open)| open.goal == goal).map(|(id, _)| *id);
                    if let Some(id) = open {
                        self.sequencer.cancel(now, id);
                    }
                }
            }
        }
        for (asker, request) in io.requests(&self.handover) {
            let response = match self.report_handover(&request) {
                Ok(()) => ReportHandoverResponse { accepted: true, message: String::new() },
                Err(message) => ReportHandoverResponse { accepted: false, message },
            };
            io.reply(&self.handover, asker, &response);
        }
    }

    fn request(&mut self, now: Duration, goal: &DeliverPartGoal) -> Result<DeliveryId, String> {
        if !goal.part_class.is_empty() && goal.part_class != self.part_class {
            return Err(format!("part_class = {:?}, allowed is {:?}", goal.part_class, self.part_class));
        }
        let timeout = match goal.timeout_s {
            0.0 => None,
            timeout_s => Some(
                Duration::try_from_secs_f64(timeout_s)
                    .map_err(|_| format!("timeout_s = {timeout_s}, allowed is 0 (never) or a positive number"))?,
            ),
        };
        let request = DeliveryRequest {
            station: goal.station.clone(),
            part_class: self.part_class.clone(),
            pose_class: goal.pose_class.clone(),
            tolerance_m: goal.tolerance_m,
            timeout,
        };
        self.sequencer.request(now, request).map_err(|refusal| refusal.to_string())
    }

    fn report_handover(&mut self, request: &ReportHandoverRequest) -> Result<(), String> {
        let id = messages::delivery_of_text(&request.delivery_id)
            .ok_or_else(|| format!("delivery_id = {:?} names no delivery", request.delivery_id))?;
        if !request.taken {
            tracing::warn!("{} was not taken: {}", request.delivery_id, request.message);
        }
        self.sequencer.report_hand_over(id, request.taken).map_err(|refusal| refusal.to_string())
    }

    fn act(&mut self, io: &mut StepIo, now: Duration, output: Output) {
        match output {
            Output::Feed(on) => {
                io.call(&self.set_feeding, &SetBoolRequest { data: on });
            }
            Output::Move(id, plan) => {
                let goal = GoalId(self.random.random());
                self.moves.insert(id, goal);
                self.trajectory.send(io, goal, messages::trajectory_goal(&plan.trajectory()));
            }
            Output::CancelMove(id) => {
                if let Some(goal) = self.moves.get(&id) {
                    self.trajectory.cancel(io, *goal);
                }
            }
            Output::Phase { phase, delivery, presented_at } => self.tell_phase(io, now, phase, delivery, presented_at),
            Output::Presented(id, delivered) => self.tell_presented(io, id, &delivered),
            Output::Finished(id, result) => self.finish(io, id, result.map_err(|failure| failure.to_string())),
            Output::Warning(warning) => tracing::warn!("{warning}"),
        }
    }

    fn tell_phase(
        &mut self,
        io: &mut StepIo,
        now: Duration,
        phase: Phase,
        delivery: Option<DeliveryId>,
        presented_at: Option<Duration>,
    ) {
        let (goal, station) = match delivery.and_then(|id| self.deliveries.get(&id)) {
            Some(open) => (Some(open.goal), open.station.clone()),
            None => (None, String::new()),
        };
        self.said.phase = messages::phase_number(phase);
        self.said.delivery_id = delivery.map(messages::text_of_delivery).unwrap_or_default();
        self.said.station = station;
        if phase != Phase::Presented {
            self.said.look_stamp = stamp_of_ns(0);
            self.said.part_in_tray = Pose::default();
        }
        self.publish_state(io);
        // What is presented is told with the part's place.
        if let Some(goal) = goal.filter(|_| phase != Phase::Presented) {
            let feedback = DeliverPartFeedback {
                phase: self.said.phase,
                eta_s: presented_at.map_or(-1.0, |at| at.saturating_sub(now).as_secs_f64()),
                delivery_id: self.said.delivery_id.clone(),
                part_in_station: Pose::default(),
            };
            self.deliver.feedback(io, goal, feedback);
        }
    }

    fn tell_presented(&mut self, io: &mut StepIo, id: DeliveryId, delivered: &Delivered) {
        let candidate = &delivered.choice.candidate;
        let in_tray = candidate.position_in_tray_m;
        self.said.look_stamp = messages::stamp(delivered.choice.look);
        self.said.part_in_tray = planar_pose(in_tray.x, in_tray.y, 0.0, candidate.yaw_in_tray_rad);
        self.publish_state(io);
        if let Some(open) = self.deliveries.get(&id) {
            let feedback = DeliverPartFeedback {
                phase: DeliveryState::PRESENTED,
                eta_s: 0.0,
                delivery_id: messages::text_of_delivery(id),
                part_in_station: part_in_station(delivered),
            };
            self.deliver.feedback(io, open.goal, feedback);
        }
    }

    fn finish(&mut self, io: &mut StepIo, id: DeliveryId, outcome: Result<Delivered, String>) {
        match &outcome {
            Ok(_) => self.said.delivered += 1,
            Err(_) => self.said.failed += 1,
        }
        self.publish_state(io);
        let Some(open) = self.deliveries.remove(&id) else { return };
        let delivery_id = messages::text_of_delivery(id);
        let (end, result) = match outcome {
            Ok(delivered) => {
                let part_in_station = part_in_station(&delivered);
                let result = DeliverPartResult { success: true, reason: String::new(), delivery_id, part_in_station };
                (GoalEnd::Succeeded, result)
            }
            Err(reason) => {
                let end = if reason == "cancelled" { GoalEnd::Canceled } else { GoalEnd::Aborted };
                (end, DeliverPartResult { success: false, reason, delivery_id, part_in_station: Pose::default() })
            }
        };
        self.deliver.finish(io, open.goal, end, result);
    }

    fn publish_state(&mut self, io: &mut StepIo) {
        self.said.header = io.header(&self.tray_frame);
        io.publish(&self.state, &self.said);
    }
}

fn part_in_station(delivered: &Delivered) -> Pose {
    planar_pose(delivered.part_in_station_m.x, delivered.part_in_station_m.y, 0.0, delivered.yaw_rad)
}
