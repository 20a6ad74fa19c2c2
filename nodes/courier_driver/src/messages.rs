//! What the driver says, in standard messages.

use feeder_control::courier::{AXES, DriverStatus, GoalOutcome, VibrationPhase};
use feeder_runtime::node::GoalEnd;
use feeder_wire::frames;
use feeder_wire::joints::{self, Joint};
use feeder_wire::odometry::{self, EstimatedMotion};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::control_msgs::action::{FollowJointTrajectoryFeedback, FollowJointTrajectoryResult};
use minifactory_msgs::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use nalgebra::Vector3 as Motion;

use crate::machine::HARDWARE_ID;

/// Names of the feeder's frames.
pub(crate) struct Names {
    courier: String,
    tray: String,
}

impl Names {
    pub(crate) fn new(feeder: &str) -> Self {
        Self { courier: format!("{feeder}/courier"), tray: format!("{feeder}/tray") }
    }

    /// Pose and velocity of the courier as estimated for the end of the step.
    pub(crate) fn odometry(&self, stamp: Time, status: &DriverStatus) -> Odometry {
        let motion = EstimatedMotion {
            position: status.position,
            velocity: status.velocity,
            position_variance: status.position_variance,
            velocity_variance: status.velocity_variance,
        };
        Odometry {
            header: Header { stamp, frame_id: "platen".to_owned() },
            child_frame_id: self.courier.clone(),
            ..odometry::to_message(&motion)
        }
    }

    /// Where the courier is on the platen.
    pub(crate) fn transforms(&self, stamp: Time, status: &DriverStatus) -> TFMessage {
        let place = frames::upright(status.position.x, status.position.y, 0.0, status.position.z);
        frames::to_message(stamp, "platen", &self.courier, &place)
    }

    /// How the tray sits on the courier.
    pub(crate) fn static_transforms(&self, stamp: Time, tray_height_m: f64) -> TFMessage {
        frames::to_message(stamp, &self.courier, &self.tray, &frames::upright(0.0, 0.0, tray_height_m, 0.0))
    }
}

/// Position and velocity of the courier's three axes.
pub(crate) fn joint_states(stamp: Time, status: &DriverStatus) -> JointState {
    let axes = AXES.iter().zip(status.position.iter().zip(&status.velocity));
    let joints: Vec<Joint> = axes
        .map(|(name, (position, velocity))| Joint {
            name: (*name).to_owned(),
            position: *position,
            velocity: *velocity,
        })
        .collect();
    joints::to_message(Header { stamp, frame_id: String::new() }, &joints)
}

/// Set point, motion and their difference, as the feedback of a trajectory.
pub(crate) fn feedback(stamp: Time, status: &DriverStatus) -> FollowJointTrajectoryFeedback {
    let point = |position: Motion<f64>, velocity: Motion<f64>| JointTrajectoryPoint {
        positions: position.iter().copied().collect(),
        velocities: velocity.iter().copied().collect(),
        ..JointTrajectoryPoint::default()
    };
    let (position, velocity) = (status.set_point, status.set_point_velocity);
    FollowJointTrajectoryFeedback {
        header: Header { stamp, frame_id: "platen".to_owned() },
        joint_names: AXES.map(str::to_owned).to_vec(),
        desired: point(position, velocity),
        actual: point(status.position, status.velocity),
        error: point(position - status.position, velocity - status.velocity),
        ..FollowJointTrajectoryFeedback::default()
    }
}

/// How a goal ended, in the terms of its action.
pub(crate) fn result(outcome: GoalOutcome) -> (GoalEnd, FollowJointTrajectoryResult) {
    use FollowJointTrajectoryResult as Code;
    let (end, error_code, error_string) = match outcome {
        GoalOutcome::Succeeded => (GoalEnd::Succeeded, Code::SUCCESSFUL, String::new()),
        // As ros2_control ends a goal that another one replaces.
        GoalOutcome::Preempted => (GoalEnd::Canceled, Code::INVALID_GOAL, "replaced by another goal".to_owned()),
        GoalOutcome::Halted => (GoalEnd::Canceled, Code::SUCCESSFUL, "halted".to_owned()),
        GoalOutcome::ToleranceViolated { error } => {
            let reason = format!("the end was missed by ({}, {}) m and {} rad", error.x, error.y, error.z);
            (GoalEnd::Aborted, Code::GOAL_TOLERANCE_VIOLATED, reason)
        }
        GoalOutcome::PathViolated { quantity, axis, error, allowed } => {
            let reason = format!("{quantity} of {} was {error:.6} off the path, allowed is {allowed:.6}", AXES[axis]);
            (GoalEnd::Aborted, Code::PATH_TOLERANCE_VIOLATED, reason)
        }
        GoalOutcome::Faulted(fault) => (GoalEnd::Aborted, Code::PATH_TOLERANCE_VIOLATED, fault.to_string()),
    };
    (end, FollowJointTrajectoryResult { error_code, error_string })
}

/// How the driver fares, for `/diagnostics`.
pub(crate) fn diagnostics(stamp: Time, name: &str, state: &str, status: &DriverStatus) -> DiagnosticArray {
    let (level, message) = match &status.fault {
        Some(fault) => (DiagnosticStatus::ERROR, fault.to_string()),
        None if status.saturated_ticks > 0 => (DiagnosticStatus::WARN, "force or torque at its peak".to_owned()),
        None => (DiagnosticStatus::OK, state.to_owned()),
    };
    let error = status.tracking_error_peak;
    let vibration = match status.vibration {
        VibrationPhase::Off => "off",
        VibrationPhase::FadingIn => "fading in",
        VibrationPhase::Steady => "steady",
        VibrationPhase::FadingOut => "fading out",
    };
    let values = [
        ("lifecycle state", state.to_owned()),
        ("vibration", vibration.to_owned()),
        ("moving", status.moving.to_string()),
        ("position error (m)", format!("{:.3e}", error.xy().norm())),
        ("yaw error (rad)", format!("{:.3e}", error.z)),
        ("saturated servo ticks", status.saturated_ticks.to_string()),
        ("learned delay (s)", format!("{:.3e}", status.learned_delay_s)),
    ];
    let values = values.map(|(key, value)| KeyValue { key: key.to_owned(), value }).to_vec();
    let status =
        DiagnosticStatus { level, name: name.to_owned(), message, hardware_id: HARDWARE_ID.to_owned(), values };
    DiagnosticArray { header: Header { stamp, frame_id: String::new() }, status: vec![status] }
}
