//! The delivery planner: feeds until parts lie right, carries them gently under manipulators, hands them over and returns.
//!
//! What it offers to other agents is described in `msgs/PROTOCOL.md`.

mod agents;
mod factsheet;
mod messages;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use feeder_control::delivery::{CourierReport, DeliveryId, DeliverySequencer, MoveId, Output, ReserveId};
use feeder_model::motor::CarriedParts;
use feeder_model::seed::generator;
use feeder_model::trajectory::Tolerances;
use feeder_runtime::node::{
    ActionClient, ActionClientPorts, ActionServer, ActionServerPorts, Asker, CallId, Client, ClientEvent, Declare,
    FeederNode, GoalEnd, GoalId, NodeError, Publisher, Server, Start, StepIo, Subscriber, ns_of_stamp,
};
use feeder_scenario::plan::{DeliveryPlannerConfig, NodeConfig, PlannedRecipe};
use feeder_wire::area::{self, AreaRequest};
use feeder_wire::delivery_state::PlannerStand;
use feeder_wire::feeder_state::FeederReport;
use feeder_wire::part_candidates::ImageWorth;
use feeder_wire::{courier_state, frames, nodes, odometry, response, services, topics, trajectory};
use minifactory_msgs::action::DeliverPart;
use minifactory_msgs::control_msgs::action::FollowJointTrajectory;
use minifactory_msgs::msg::{CourierState, DeliveryState, Factsheet, FeederState, PartCandidates};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::srv::{
    ChangeRecipe, Purge, ReleaseArea, ReleaseAreaRequest, ReportHandover, ReserveArea, SetWaveform,
};
use minifactory_msgs::std_srvs::srv::{SetBool, SetBoolRequest, Trigger};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// The delivery state is said at least this often, ns: a sign of life, by which the courier driver knows that moves are
/// wanted.
const REPEAT_PERIOD_NS: u64 = 500_000_000;

/// Handles of the planner's plain ports.
#[derive(Clone, Copy)]
struct Plain {
    part_candidates: Subscriber<PartCandidates>,
    odometry: Subscriber<Odometry>,
    courier_state: Subscriber<CourierState>,
    set_feeding: Client<SetBool>,
    set_waveform: Client<SetWaveform>,
    handover: Server<ReportHandover>,
    purge: Server<Purge>,
    change_recipe: Server<ChangeRecipe>,
    reset: Server<Trigger>,
    delivery_state: Publisher<DeliveryState>,
    state: Publisher<FeederState>,
    factsheet: Publisher<Factsheet>,
    arbiter: Option<Arbiter>,
}

/// The services of a platen that is shared.
#[derive(Clone, Copy)]
struct Arbiter {
    reserve: Client<ReserveArea>,
    release: Client<ReleaseArea>,
}

/// Handles of the planner's ports.
pub struct Ports {
    plain: Plain,
    trajectory: ActionClientPorts<FollowJointTrajectory>,
    deliver: ActionServerPorts<DeliverPart>,
}

/// The delivery planner.
pub struct DeliveryPlanner {
    ports: Plain,
    trajectory: ActionClient<FollowJointTrajectory>,
    deliver: ActionServer<DeliverPart>,
    sequencer: DeliverySequencer,
    /// Whether the courier driver said last that it is active.
    courier_active: bool,
    parts: CarriedParts,
    feeder: String,
    part_class: String,
    tray_frame: String,
    random: Pcg64Mcg,
    recipes: Vec<PlannedRecipe>,
    /// Index of the recipe in force.
    recipe: usize,
    /// Open goals of agents.
    deliveries: BTreeMap<DeliveryId, Open>,
    /// The last reports on hand-overs.
    reported: VecDeque<agents::Accepted>,
    moves: BTreeMap<MoveId, GoalId>,
    reserving: BTreeMap<CallId, ReserveId>,
    purging: Option<Asker>,
    /// Recipe changes that wait for the generator, and the recipe each asks for.
    changing: VecDeque<(CallId, Asker, usize)>,
    /// What was last said, to be said again when something changes.
    said: PlannerStand,
    /// When that was, ns.
    said_ns: u64,
    said_state: Option<FeederReport>,
    /// What the selector says where the latest image does not tell what lies on the plateau.
    unrecognised: Option<String>,
    fact: Factsheet,
    said_fact: bool,
}

struct Open {
    goal: GoalId,
    station: String,
    /// The process that has asked: it alone may report on the delivery.
    owner: u64,
}

impl FeederNode for DeliveryPlanner {
    const NAME: &'static str = nodes::DELIVERY_PLANNER;
    const START: Option<Start> = Some(Start::Active);
    type Config = DeliveryPlannerConfig;
    type Ports = Ports;

    fn tick(config: &DeliveryPlannerConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &DeliveryPlannerConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, config: &DeliveryPlannerConfig) -> Ports {
        let plain = Plain {
            part_candidates: io.subscriber(&topics::PART_CANDIDATES),
            odometry: io.subscriber(&topics::ODOMETRY),
            courier_state: io.subscriber(&topics::COURIER_STATE),
            set_feeding: io.client(&services::SET_FEEDING),
            set_waveform: io.client(&services::SET_WAVEFORM),
            handover: io.server(&services::REPORT_HANDOVER),
            purge: io.server(&services::PURGE),
            change_recipe: io.server(&services::CHANGE_RECIPE),
            reset: io.server(&services::RESET),
            delivery_state: io.publisher(&topics::DELIVERY_STATE),
            state: io.publisher(&topics::STATE),
            factsheet: io.publisher(&topics::FACTSHEET),
            arbiter: config.arbitrated.then(|| Arbiter {
                reserve: io.client(&services::RESERVE_AREA),
                release: io.client(&services::RELEASE_AREA),
            }),
        };
        let trajectory = io.action_client(&services::FOLLOW_JOINT_TRAJECTORY);
        Ports { plain, trajectory, deliver: io.action_server(&services::DELIVER_PART) }
    }

    fn open(ports: Ports, config: &DeliveryPlannerConfig) -> Result<Self, NodeError> {
        let mut sequencer = DeliverySequencer::new(config.delivery(), config.tray.geometry, config.limits, config.load)
            .map_err(NodeError::new)?;
        if let Some(recipe) = config.recipes.first() {
            sequencer.expect_feed(recipe.plateau_feed.clone(), recipe.period_s, recipe.climb_per_s);
        }
        sequencer.carry(config.parts.left(0));
        Ok(Self {
            ports: ports.plain,
            trajectory: ActionClient::new(ports.trajectory),
            deliver: ActionServer::new(ports.deliver).cancelled_by_owners(),
            sequencer,
            courier_active: true,
            parts: config.parts,
            feeder: config.feeder.clone(),
            part_class: config.part_class.clone(),
            tray_frame: frames::tray(&config.feeder),
            random: generator(config.seed, Self::NAME),
            recipes: config.recipes.clone(),
            recipe: 0,
            deliveries: BTreeMap::new(),
            reported: VecDeque::new(),
            moves: BTreeMap::new(),
            reserving: BTreeMap::new(),
            purging: None,
            changing: VecDeque::new(),
            said: PlannerStand::idle(),
            said_ns: 0,
            said_state: None,
            unrecognised: None,
            fact: factsheet::of(config),
            said_fact: false,
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        let now = Duration::from_nanos(io.now_ns());
        self.hear(io);
        // A planner or a courier driver that is not active is no fault: it goes on by itself when they are.
        let own = io.check_active(Self::NAME).err();
        self.sequencer.suspend(own.as_deref().or((!self.courier_active).then_some(courier_state::NOT_ACTIVE)));
        self.take_requests(io, now);
        for output in self.sequencer.step(now) {
            self.act(io, now, output);
        }
        if io.is_active() && io.now_ns().saturating_sub(self.said_ns) >= REPEAT_PERIOD_NS {
            self.publish_delivery_state(io);
        }
        self.tell_state(io);
        Ok(())
    }
}

impl DeliveryPlanner {
    /// Takes in what the feeder's other nodes and the arbiter say.
    fn hear(&mut self, io: &mut StepIo) {
        let mut states = io.take(&self.ports.courier_state);
        if let Some(newest) = states.last() {
            let activity = courier_state::from_message(newest.clone());
            self.courier_active = activity.active;
            self.sequencer.courier_fault(activity.fault.as_deref());
            self.sequencer.courier_warning(Duration::from_nanos(io.now_ns()), activity.warning);
        }
        for message in io.take(&self.ports.odometry) {
            let stamp_ns = ns_of_stamp(&message.header.stamp);
            // Both are published together; without its state a pose says nothing about rest.
            if let Some(index) = states.iter().position(|state| ns_of_stamp(&state.header.stamp) == stamp_ns) {
                let activity = courier_state::from_message(states.swap_remove(index));
                self.sequencer.courier(CourierReport {
                    stamp: Duration::from_nanos(stamp_ns),
                    position: odometry::from_message(&message).position,
                    vibrating: activity.vibrating,
                    moving: activity.moving,
                });
            }
        }
        for message in io.take(&self.ports.part_candidates) {
            let image = ImageWorth::of_message(&message);
            self.unrecognised = image.is_blind.then(|| image.doubts.join("; "));
            match messages::candidate_frame(&message) {
                Ok(frame) => self.sequencer.candidates(frame),
                Err(error) => tracing::warn!("part_candidates passed over: {error}"),
            }
        }
        for (_, response) in io.replies(&self.ports.set_feeding) {
            if let Err(reason) = response::from_message(response) {
                self.sequencer.feed_refused(reason);
            }
        }
        if let Some(arbiter) = self.ports.arbiter {
            for (call, response) in io.replies(&arbiter.reserve) {
                if let Some(id) = self.reserving.remove(&call) {
                    self.sequencer.area_answered(id, area::from_response(response).map_err(|(_, message)| message));
                }
            }
            for (_, response) in io.replies(&arbiter.release) {
                if let Err(reason) = response::from_message(response) {
                    tracing::warn!("an area was not released: {reason}");
                }
            }
        }
        for event in self.trajectory.poll(io) {
            let (goal, result) = match event {
                ClientEvent::Accepted(_) | ClientEvent::Feedback(..) => continue,
                ClientEvent::Rejected(goal) => (goal, Err("the courier driver refused the trajectory".to_owned())),
                ClientEvent::Lost(goal) => (goal, Err("the courier driver does not answer".to_owned())),
                ClientEvent::Finished(goal, Some(GoalEnd::Succeeded), _) => (goal, Ok(())),
                ClientEvent::Finished(goal, _, result) => {
                    let reason = trajectory::from_result(result).map(|(_, reason)| reason);
                    (goal, Err(reason.unwrap_or_else(|unknown| unknown.to_string())))
                }
            };
            let ended = self.moves.iter().find(|(_, known)| **known == goal).map(|(id, _)| *id);
            if let Some(id) = ended {
                self.moves.remove(&id);
                self.sequencer.move_ended(id, result);
            }
        }
    }

    fn act(&mut self, io: &mut StepIo, now: Duration, output: Output) {
        match output {
            Output::Feed(on) => {
                io.call(&self.ports.set_feeding, &SetBoolRequest { data: on });
            }
            Output::Move(id, plan) => {
                let goal = GoalId(self.random.random());
                self.moves.insert(id, goal);
                self.trajectory.send(io, goal, trajectory::to_goal(&plan.trajectory(), &Tolerances::default()));
            }
            Output::CancelMove(id) => {
                if let Some(goal) = self.moves.get(&id) {
                    self.trajectory.cancel(io, *goal);
                }
            }
            Output::Reserve { id, area, parked, duration, wait } => {
                let request = AreaRequest::New { area, parked, occupied: true, wait };
                self.reserve(io, id, &request, duration);
            }
            Output::Renew { id, lease, duration } => {
                self.reserve(io, id, &AreaRequest::Renew { lease }, duration);
            }
            Output::Release(lease_id) => {
                if let Some(arbiter) = self.ports.arbiter {
                    io.call(&arbiter.release, &ReleaseAreaRequest { agent: self.feeder.clone(), lease_id });
                }
            }
            Output::Phase { phase, delivery, presented_at } => self.tell_phase(io, now, phase, delivery, presented_at),
            Output::Presented(id, delivered) => self.tell_presented(io, id, &delivered),
            Output::Finished(id, result) => self.finish(io, id, &result),
            Output::Purged(result) => self.end_purge(io, result),
            Output::Warning(warning) => tracing::warn!("{warning}"),
        }
    }

    fn reserve(&mut self, io: &mut StepIo, id: ReserveId, request: &AreaRequest, duration: Duration) {
        if let Some(arbiter) = self.ports.arbiter {
            let call = io.call(&arbiter.reserve, &area::to_request(&self.feeder, request, duration));
            self.reserving.insert(call, id);
        }
    }
}
