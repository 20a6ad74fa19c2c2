//! The courier driver: runs the waveform and the trajectories it is given, and tells how the courier moves, as far as its
//! sensor and its commands can tell.
//!
//! The motor that it drives is set up in the module `machine`, and nowhere else does this node name it.
//!
//! What is published in a tick is the motion of the tick before it: stamps are never in the future.

mod machine;
mod messages;

use std::time::Duration;

use feeder_control::courier::{self, Commander, DriverEvent, DriverStatus, GoalHandle, Rejection};
use feeder_model::motor::{CarriedParts, Load};
use feeder_model::seed::seed_for;
use feeder_runtime::node::{
    ActionServer, ActionServerPorts, Declare, FeederNode, GoalId, GoalRequest, NodeError, Publisher, Server,
    ServerEvent, Start, StepIo, Subscriber,
};
use feeder_scenario::plan::{CourierDriverConfig, NodeConfig};
use feeder_wire::trajectory::{self, TrajectoryEnd};
use feeder_wire::{nodes, response, services, topics};
use minifactory_msgs::control_msgs::action::FollowJointTrajectory;
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticArray;
use minifactory_msgs::msg::{self, CourierState, DeliveryState};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::{Header, String as Text};
use minifactory_msgs::std_srvs::srv::Trigger;
use minifactory_msgs::tf2_msgs::msg::TFMessage;

/// Between two messages of feedback on a trajectory.
const FEEDBACK_PERIOD: Duration = Duration::from_millis(50);
/// Between two messages on `/diagnostics`.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// Handles of the driver's ports.
pub struct Ports {
    topics: Topics,
    services: Services,
    trajectory: ActionServerPorts<FollowJointTrajectory>,
    truth: machine::TruthPorts,
}

struct Topics {
    waveform: Subscriber<msg::Waveform>,
    delivery_state: Subscriber<DeliveryState>,
    odometry: Publisher<Odometry>,
    joint_states: Publisher<JointState>,
    state: Publisher<CourierState>,
    diagnostics: Publisher<DiagnosticArray>,
    tf: Publisher<TFMessage>,
    tf_static: Publisher<TFMessage>,
    description: Publisher<Text>,
}

struct Services {
    halt: Server<Trigger>,
    home: Server<Trigger>,
    emergency_stop: Server<Trigger>,
    reset_fault: Server<Trigger>,
}

/// The courier driver.
pub struct CourierDriver {
    topics: Topics,
    services: Services,
    trajectory: ActionServer<FollowJointTrajectory>,
    driver: courier::Driver<machine::Motor>,
    /// Whether the driver was last told to be active.
    active: bool,
    truth: machine::Truth,
    servo_ticks: usize,
    tick: Duration,
    name: String,
    names: messages::Names,
    tray_height_m: f64,
    /// The courier as URDF.
    description: Text,
    goals: Vec<(GoalHandle, GoalId)>,
    carried: Carried,
    /// The waveform last accepted, its stamp left out: hearing it again changes nothing.
    accepted: Option<msg::Waveform>,
    /// Why the waveform last heard was refused.
    refused: Option<String>,
    /// Number of the waveform last heard, for the generator to know that it was.
    heard_sequence: u32,
}

/// What the driver reckons that the tray carries: it hears of every part that is handed over.
struct Carried {
    parts: CarriedParts,
    /// What the tray carries beside parts.
    own: Load,
    /// Parts that the planner said last it had delivered, and all that were since the start.
    said: u32,
    taken: u32,
    /// Parts that the driver was told last are there.
    told: u32,
}

impl Carried {
    fn new(parts: CarriedParts, full: &Load) -> Self {
        Self { parts, own: parts.without(full), said: 0, taken: 0, told: parts.left(0) }
    }

    /// Takes the planner's count, which begins anew when the planner does. Gives the number of parts left, if it is not what
    /// the driver was told.
    fn hear(&mut self, delivered: u32) -> Option<u32> {
        let more = delivered.checked_sub(self.said).unwrap_or(delivered);
        self.said = delivered;
        self.taken = self.taken.saturating_add(more);
        Some(self.parts.left(self.taken)).filter(|left| *left != self.told)
    }

    fn load(&self, left: u32) -> Load {
        self.own.with(left.into(), &self.parts.part)
    }
}

impl FeederNode for CourierDriver {
    const NAME: &'static str = nodes::COURIER_DRIVER;
    // On hardware nothing moves before somebody has said so.
    const START: Option<Start> = Some(Start::Unconfigured);
    type Config = CourierDriverConfig;
    type Ports = Ports;

    fn tick(config: &CourierDriverConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &CourierDriverConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, _: &CourierDriverConfig) -> Ports {
        Ports {
            topics: Topics {
                waveform: io.subscriber(&topics::WAVEFORM),
                delivery_state: io.subscriber(&topics::DELIVERY_STATE),
                odometry: io.publisher(&topics::ODOMETRY),
                joint_states: io.publisher(&topics::JOINT_STATES),
                state: io.publisher(&topics::COURIER_STATE),
                diagnostics: io.publisher(&topics::DIAGNOSTICS),
                tf: io.publisher(&topics::TF),
                tf_static: io.publisher(&topics::TF_STATIC),
                description: io.publisher(&topics::ROBOT_DESCRIPTION),
            },
            services: Services {
                halt: io.server(&services::HALT),
                home: io.server(&services::HOME),
                emergency_stop: io.server(&services::EMERGENCY_STOP),
                reset_fault: io.server(&services::RESET_FAULT),
            },
            trajectory: io.action_server(&services::FOLLOW_JOINT_TRAJECTORY),
            truth: machine::declare(io),
        }
    }

    fn open(ports: Ports, config: &CourierDriverConfig) -> Result<Self, NodeError> {
        let seed = seed_for(config.seed, Self::NAME);
        let courier = config.simulated_courier();
        let motor = machine::connect(&courier, seed)?;
        let mut driver = courier::Driver::with_motor(courier.config, motor).map_err(NodeError::new)?;
        driver.set_active(false);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a checked configuration holds a small positive ratio"
        )]
        let servo_ticks = (Self::tick(config).as_secs_f64() / config.courier.servo_period_s).round() as usize;
        let carried = Carried::new(config.parts, &config.courier.load);
        Ok(Self {
            topics: ports.topics,
            services: ports.services,
            trajectory: ActionServer::new(ports.trajectory),
            driver,
            active: false,
            servo_ticks,
            truth: machine::Truth::new(ports.truth, Self::tick(config), carried.own, carried.parts.part.mass_kg),
            carried,
            tick: Self::tick(config),
            name: format!("/{}/{}", config.feeder, Self::NAME),
            names: messages::Names::new(&config.feeder),
            tray_height_m: config.tray.floor_height_m,
            description: messages::description(config),
            goals: Vec::new(),
            accepted: None,
            refused: None,
            heard_sequence: 0,
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        // In every state it tells how the courier stands; it moves it in one.
        if self.active != io.is_active() {
            self.active = io.is_active();
            self.driver.set_active(self.active);
        }
        self.truth.hear(io, self.driver.motor_mut());
        // First the tick that has just passed, under the commands that were known then.
        let ran = if io.tick() > 0 { self.servo_ticks } else { 0 };
        let output = self.driver.step(ran);
        if io.tick() == 0 {
            io.publish(&self.topics.tf_static, &self.names.static_transforms(io.stamp(), self.tray_height_m));
            io.publish(&self.topics.description, &self.description);
        } else {
            self.truth.publish(io, self.driver.motor_mut());
        }
        self.publish_state(io, &output.status);
        for event in output.events {
            self.report(io, event);
        }
        self.take_commands(io);
        Ok(())
    }
}

impl CourierDriver {
    fn publish_state(&self, io: &mut StepIo, status: &DriverStatus) {
        let stamp = io.stamp();
        io.publish(&self.topics.odometry, &self.names.odometry(stamp, status));
        io.publish(&self.topics.joint_states, &messages::joint_states(stamp, status));
        io.publish(&self.topics.tf, &self.names.transforms(stamp, status));
        io.publish(&self.topics.state, &messages::courier_state(stamp, status, self.active, self.heard_sequence));
        if let Some((_, id)) = self.goals.last().filter(|_| self.due(io, FEEDBACK_PERIOD)) {
            self.trajectory.feedback(io, *id, messages::feedback(stamp, status));
        }
        if self.due(io, DIAGNOSTICS_PERIOD) {
            let health = messages::health(&self.name, io.lifecycle().label(), status);
            io.publish(&self.topics.diagnostics, &health.into_message(io.header("")));
        }
    }

    /// Whether something that is done every `period` is done in this tick.
    fn due(&self, io: &StepIo, period: Duration) -> bool {
        let ticks = u64::try_from(period.as_nanos() / self.tick.as_nanos().max(1)).unwrap_or(1);
        io.tick().is_multiple_of(ticks.max(1))
    }

    fn report(&mut self, io: &mut StepIo, event: DriverEvent) {
        match event {
            DriverEvent::GoalEnded(handle, outcome) => {
                let Some(index) = self.goals.iter().position(|(known, _)| *known == handle) else { return };
                let (_, id) = self.goals.remove(index);
                let (goal_end, end) = messages::end(outcome);
                self.trajectory.finish(io, id, goal_end, trajectory::to_result(end));
            }
            DriverEvent::Fault(fault) => tracing::error!("fault: {fault}"),
        }
    }

    fn take_commands(&mut self, io: &mut StepIo) {
        for message in io.take(&self.topics.waveform) {
            self.driver.hear(Commander::Generator);
            self.heard_sequence = message.sequence;
            self.take_waveform(message);
        }
        if let Some(newest) = io.take(&self.topics.delivery_state).pop() {
            self.driver.hear(Commander::Planner);
            self.unload(newest.delivered);
        }
        for event in self.trajectory.poll(io) {
            match event {
                ServerEvent::Requested(request) => self.begin(io, request),
                ServerEvent::CancelRequested(id) => {
                    if let Some((handle, _)) = self.goals.iter().find(|(_, known)| *known == id) {
                        self.driver.cancel(*handle);
                    }
                }
            }
        }
        for (asker, _) in io.requests(&self.services.halt) {
            self.driver.halt();
            io.reply(&self.services.halt, asker, &response::done("coming to rest"));
        }
        for (asker, _) in io.requests(&self.services.home) {
            let way = self.driver.home(asker.client()).map(|_| "on the way");
            io.reply(&self.services.home, asker, &response::to_message(way));
        }
        for (asker, _) in io.requests(&self.services.emergency_stop) {
            self.driver.emergency_stop();
            io.reply(&self.services.emergency_stop, asker, &response::done("stopped until reset_fault"));
        }
        for (asker, _) in io.requests(&self.services.reset_fault) {
            let reset = self.driver.reset_fault().map(|()| "");
            io.reply(&self.services.reset_fault, asker, &response::to_message(reset));
        }
    }

    /// Lets the driver reckon with the parts that are left. A load that it cannot take now is told again with the planner's
    /// next sign of life.
    fn unload(&mut self, delivered: u32) {
        if let Some(left) = self.carried.hear(delivered) {
            match self.driver.set_load(self.carried.load(left)) {
                Ok(()) => self.carried.told = left,
                Err(reason) => tracing::debug!("the load of {left} parts waits: {reason}"),
            }
        }
    }

    /// Takes a waveform. One that was accepted before is only a sign of life: what a halt or a fault has stopped stays so.
    fn take_waveform(&mut self, message: msg::Waveform) {
        let message = msg::Waveform { header: Header::default(), ..message };
        if self.accepted.as_ref() == Some(&message) {
            return;
        }
        let taken =
            feeder_wire::waveform::from_message(&message).map_err(|error| error.to_string()).and_then(|waveform| {
                self.driver.set_waveform(&waveform, message.enabled).map_err(|error| error.to_string())
            });
        let refused = taken.err();
        if let Some(reason) = refused.as_ref().filter(|_| self.refused != refused) {
            tracing::warn!("refused waveform {}: {reason}", message.sequence);
        }
        if refused.is_none() {
            self.accepted = Some(message);
        }
        self.refused = refused;
    }

    /// Begins a goal, or refuses it and says why.
    fn begin(&mut self, io: &mut StepIo, request: GoalRequest<FollowJointTrajectory>) {
        let begun = trajectory::from_goal(&request.goal, io.now_ns()).and_then(|(trajectory, tolerances)| {
            let begun = self.driver.execute_within(request.client(), &trajectory, &tolerances);
            begun.map_err(|reason: Rejection| (TrajectoryEnd::InvalidGoal, reason.to_string()))
        });
        match begun {
            Ok(handle) => {
                self.goals.push((handle, request.id));
                self.trajectory.accept(io, request);
            }
            Err(end) => {
                let reason = end.1.clone();
                self.trajectory.reject_with(io, request, &reason, trajectory::to_result(end));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_handed_over_are_taken_off_the_load_also_when_the_planner_counts_anew() {
        let part = Load { mass_kg: 2e-3, inertia_kg_m2: 1.4e-5 };
        let parts = CarriedParts { part, count_max: 20, refill_below: 15 };
        let mut carried = Carried::new(parts, &Load { mass_kg: 0.14, inertia_kg_m2: 1.28e-3 });
        assert_eq!(carried.hear(0), None);
        assert_eq!(carried.hear(2), Some(18));
        assert!((carried.load(18).mass_kg - 0.136).abs() < 1e-12);
        // Told again until the driver takes it.
        assert_eq!(carried.hear(2), Some(18));
        carried.told = 18;
        assert_eq!(carried.hear(2), None);
        assert_eq!(carried.hear(1), Some(17));
        carried.told = 17;
        // What the hopper keeps there stays.
        assert_eq!(carried.hear(9), Some(15));
    }
}
