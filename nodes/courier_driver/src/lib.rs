//! The courier driver: runs the waveform and the trajectories it is given, and tells how the courier moves.
//!
//! What is published in a tick is the motion of the tick before it: stamps are never in the future.

mod messages;
mod trajectory;

use std::time::Duration;

use feeder_core::courier::{self, DriverEvent, DriverStatus, GoalHandle, GoalOutcome, VibrationPhase};
use feeder_core::motion::MotionBlock;
use feeder_core::scenario::Scenario;
use feeder_core::seed::seed_for;
use feeder_core::waveform::Waveform;
use feeder_runtime::dds::Qos;
use feeder_runtime::node::{
    ActionServer, ActionServerPorts, Declare, FeederNode, GoalEnd, GoalId, Latency, NodeError, Publisher, Server,
    ServerEvent, StepIo, Subscriber,
};
use minifactory_msgs::control_msgs::action::{FollowJointTrajectory, FollowJointTrajectoryResult};
use minifactory_msgs::msg::{self, CourierState, TrayMotion};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_srvs::srv::{Trigger, TriggerResponse};
use minifactory_msgs::tf2_msgs::msg::TFMessage;

/// Goals come from the delivery planner alone in normal running; the driver tells clients apart by number.
const ANY_CLIENT: u64 = 0;

/// Handles of the driver's ports.
pub struct Ports {
    waveform: Subscriber<msg::Waveform>,
    trajectory: ActionServerPorts<FollowJointTrajectory>,
    halt: Server<Trigger>,
    reset_fault: Server<Trigger>,
    motion: Publisher<TrayMotion>,
    odometry: Publisher<Odometry>,
    joint_states: Publisher<JointState>,
    state: Publisher<CourierState>,
    tf: Publisher<TFMessage>,
    tf_static: Publisher<TFMessage>,
}

/// The courier driver.
pub struct CourierDriver {
    waveform: Subscriber<msg::Waveform>,
    halt: Server<Trigger>,
    reset_fault: Server<Trigger>,
    motion: Publisher<TrayMotion>,
    odometry: Publisher<Odometry>,
    joint_states: Publisher<JointState>,
    state: Publisher<CourierState>,
    tf: Publisher<TFMessage>,
    tf_static: Publisher<TFMessage>,
    trajectory: ActionServer<FollowJointTrajectory>,
    driver: courier::CourierDriver,
    servo_ticks: usize,
    tick: Duration,
    sequence: u32,
    names: messages::Names,
    tray_height_m: f64,
    goals: Vec<(GoalHandle, GoalId)>,
}

impl FeederNode for CourierDriver {
    const NAME: &'static str = "courier_driver";
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
            waveform: io.subscriber("waveform", Latency::Forward, Qos::latched()),
            trajectory: io.action_server("follow_joint_trajectory"),
            halt: io.server("halt"),
            reset_fault: io.server("reset_fault"),
            motion: io.publisher("tray_motion", Qos::command()),
            odometry: io.publisher("odometry", Qos::command()),
            joint_states: io.publisher("joint_states", Qos::command()),
            state: io.publisher("courier_state", Qos::command()),
            tf: io.publisher("/tf", Qos::command()),
            tf_static: io.publisher("/tf_static", Qos::latched()),
        }
    }

    fn open(ports: Ports, config: &Scenario) -> Result<Self, NodeError> {
        let seed = seed_for(config.seed, Self::NAME);
        let driver = courier::CourierDriver::simulated(config.courier, seed).map_err(NodeError::new)?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a scenario holds a small positive ratio"
        )]
        let servo_ticks = (config.time.tick_s() / config.courier.servo_period_s).round() as usize;
        Ok(Self {
            waveform: ports.waveform,
            halt: ports.halt,
            reset_fault: ports.reset_fault,
            motion: ports.motion,
            odometry: ports.odometry,
            joint_states: ports.joint_states,
            state: ports.state,
            tf: ports.tf,
            tf_static: ports.tf_static,
            trajectory: ActionServer::new(ports.trajectory),
            driver,
            servo_ticks,
            tick: Duration::from_millis(config.time.tick_ms),
            sequence: 0,
            names: messages::Names::new(&config.feeder),
            tray_height_m: config.tray.floor_height_m,
            goals: Vec::new(),
        })
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        // First the tick that has just passed, under the commands that were known then.
        let ran = if io.tick() > 0 { self.servo_ticks } else { 0 };
        let output = self.driver.step(ran);
        if io.tick() == 0 {
            io.publish(&self.tf_static, &self.names.static_transforms(io.stamp(), self.tray_height_m));
        } else {
            self.publish_motion(io, &output.block);
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
    fn publish_motion(&mut self, io: &mut StepIo, block: &MotionBlock) {
        let started_ns = io.now_ns().saturating_sub(u64::try_from(self.tick.as_nanos()).unwrap_or(0));
        let mut message = TrayMotion::from(block);
        message.header.stamp = feeder_runtime::node::stamp_of_ns(started_ns);
        "platen".clone_into(&mut message.header.frame_id);
        message.sequence = self.sequence;
        self.sequence += 1;
        io.publish(&self.motion, &message);
    }

    fn publish_state(&self, io: &mut StepIo, status: &DriverStatus) {
        let stamp = io.stamp();
        io.publish(&self.odometry, &self.names.odometry(stamp, status));
        io.publish(&self.joint_states, &messages::joint_states(stamp, status));
        io.publish(&self.tf, &self.names.transforms(stamp, status));
        let error = status.tracking_error_peak;
        let state = CourierState {
            header: io.header("platen"),
            vibrating: status.vibration != VibrationPhase::Off,
            moving: status.moving,
            position_error_m: error.xy().norm(),
            yaw_error_rad: error.z,
            fault: status.fault.as_ref().map(ToString::to_string).unwrap_or_default(),
        };
        io.publish(&self.state, &state);
    }

    fn report(&mut self, io: &mut StepIo, event: DriverEvent) {
        match event {
            DriverEvent::GoalEnded(handle, outcome) => {
                let Some(index) = self.goals.iter().position(|(known, _)| *known == handle) else { return };
                let (_, id) = self.goals.remove(index);
                let (end, error_code, error_string) = match outcome {
                    GoalOutcome::Succeeded => {
                        (GoalEnd::Succeeded, FollowJointTrajectoryResult::SUCCESSFUL, String::new())
                    }
                    // As ros2_control ends a goal that another one replaces.
                    GoalOutcome::Preempted => (
                        GoalEnd::Canceled,
                        FollowJointTrajectoryResult::INVALID_GOAL,
                        "replaced by another goal".to_owned(),
                    ),
                    GoalOutcome::Halted => {
                        (GoalEnd::Canceled, FollowJointTrajectoryResult::SUCCESSFUL, "halted".to_owned())
                    }
                    GoalOutcome::ToleranceViolated { error } => (
                        GoalEnd::Aborted,
                        FollowJointTrajectoryResult::GOAL_TOLERANCE_VIOLATED,
                        format!("the end was missed by ({}, {}) m and {} rad", error.x, error.y, error.z),
                    ),
                    GoalOutcome::Faulted(fault) => {
                        (GoalEnd::Aborted, FollowJointTrajectoryResult::PATH_TOLERANCE_VIOLATED, fault.to_string())
                    }
                };
                self.trajectory.finish(io, id, end, FollowJointTrajectoryResult { error_code, error_string });
            }
            DriverEvent::Fault(fault) => tracing::error!("fault: {fault}"),
        }
    }

    fn take_commands(&mut self, io: &mut StepIo) {
        for message in io.take(&self.waveform) {
            let refused = match Waveform::try_from(&message) {
                Ok(waveform) => {
                    self.driver.set_waveform(&waveform, message.enabled).err().map(|error| error.to_string())
                }
                Err(error) => Some(error.to_string()),
            };
            if let Some(reason) = refused {
                tracing::warn!("refused waveform {}: {reason}", message.sequence);
            }
        }
        for event in self.trajectory.poll(io) {
            match event {
                ServerEvent::Requested(request) => {
                    let begun = trajectory::parse(&request.goal)
                        .and_then(|path| self.driver.execute(ANY_CLIENT, &path).map_err(|error| error.to_string()));
                    match begun {
                        Ok(handle) => {
                            self.goals.push((handle, request.id));
                            self.trajectory.accept(io, request);
                        }
                        Err(reason) => self.trajectory.reject(io, request, &reason),
                    }
                }
                ServerEvent::CancelRequested(id) => {
                    if let Some((handle, _)) = self.goals.iter().find(|(_, known)| *known == id) {
                        self.driver.cancel(*handle);
                    }
                }
            }
        }
        for (asker, _) in io.requests(&self.halt) {
            self.driver.halt();
            io.reply(&self.halt, asker, &TriggerResponse { success: true, message: "coming to rest".to_owned() });
        }
        for (asker, _) in io.requests(&self.reset_fault) {
            let response = match self.driver.reset_fault() {
                Ok(()) => TriggerResponse { success: true, message: String::new() },
                Err(fault) => TriggerResponse { success: false, message: fault.to_string() },
            };
            io.reply(&self.reset_fault, asker, &response);
        }
    }
}
