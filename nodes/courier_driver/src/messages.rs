//! What the driver says, in standard messages.

use feeder_control::courier::{AXES, DriverStatus, GoalOutcome, VibrationPhase};
use feeder_runtime::node::{GoalEnd, Health, HealthLevel};
use feeder_scenario::plan::CourierDriverConfig;
use feeder_wire::courier_state::{self, CourierActivity};
use feeder_wire::frames::{self, PLATEN};
use feeder_wire::joints::{self, Joint};
use feeder_wire::odometry::{self, EstimatedMotion};
use feeder_wire::robot_description::{self, Courier};
use feeder_wire::trajectory::{self, EndOfGoal, Following, TrajectoryEnd};
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::control_msgs::action::FollowJointTrajectoryFeedback;
use minifactory_msgs::msg::CourierState;
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::{Header, String as Text};
use minifactory_msgs::tf2_msgs::msg::TFMessage;

use crate::machine::HARDWARE_ID;

/// Names of the feeder's frames.
pub(crate) struct Names {
    slides: [String; 2],
    courier: String,
    tray: String,
}

impl Names {
    pub(crate) fn new(feeder: &str) -> Self {
        Self { slides: frames::courier_slides(feeder), courier: frames::courier(feeder), tray: frames::tray(feeder) }
    }

    /// Pose and velocity of the courier as estimated for the end of the step.
    pub(crate) fn odometry(&self, stamp: Time, status: &DriverStatus) -> Odometry {
        let motion = EstimatedMotion {
            position: status.position,
            velocity: status.velocity,
            position_variance: status.position_variance,
            velocity_variance: status.velocity_variance,
        };
        Odometry { header: on_platen(stamp), child_frame_id: self.courier.clone(), ..odometry::to_message(&motion) }
    }

    /// Where the courier is on the platen, a frame for each of its joints.
    pub(crate) fn transforms(&self, stamp: Time, status: &DriverStatus) -> TFMessage {
        let [slide_x, slide_y] = &self.slides;
        let place = status.position;
        let frames = [
            (slide_x.as_str(), frames::upright(place.x, 0.0, 0.0, 0.0)),
            (slide_y, frames::upright(0.0, place.y, 0.0, 0.0)),
            (&self.courier, frames::upright(0.0, 0.0, 0.0, place.z)),
        ];
        frames::chain(stamp, PLATEN, frames)
    }

    /// How the tray sits on the courier.
    pub(crate) fn static_transforms(&self, stamp: Time, tray_height_m: f64) -> TFMessage {
        frames::to_message(stamp, &self.courier, &self.tray, &frames::upright(0.0, 0.0, tray_height_m, 0.0))
    }
}

/// The courier as URDF.
pub(crate) fn description(config: &CourierDriverConfig) -> Text {
    let limits = &config.courier.limits;
    // The envelope has no bound of its own for the yaw rate: this is what the torque can bring it to within half its range.
    let yaw_rate_rad_s = (2.0 * limits.torque_n_m_max / limits.inertia_kg_m2 * limits.yaw_rad_max).sqrt();
    robot_description::courier(&Courier {
        feeder: &config.feeder,
        lower: [limits.x_m_min, limits.y_m_min, -limits.yaw_rad_max],
        upper: [limits.x_m_max, limits.y_m_max, limits.yaw_rad_max],
        speed_max: [limits.speed_m_s_max, limits.speed_m_s_max, yaw_rate_rad_s],
        effort_max: [limits.force_n_max, limits.force_n_max, limits.torque_n_m_max],
        mass_kg: limits.mass_kg,
        inertia_kg_m2: limits.inertia_kg_m2,
        footprint_radius_m: config.footprint_radius_m,
        tray: config.tray,
    })
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

/// What the courier does, whether its driver is active, and the number of the waveform heard last.
pub(crate) fn courier_state(stamp: Time, status: &DriverStatus, active: bool, waveform_sequence: u32) -> CourierState {
    let error = status.tracking_error_peak;
    let activity = CourierActivity {
        active,
        vibrating: status.vibration != VibrationPhase::Off,
        moving: status.moving,
        position_error_m: error.xy().norm(),
        yaw_error_rad: error.z,
        fault: status.fault.as_ref().map(ToString::to_string),
        warning: status.learning.warning.as_ref().map(ToString::to_string),
        waveform_sequence,
    };
    CourierState { header: on_platen(stamp), ..courier_state::to_message(activity) }
}

/// How a trajectory is followed.
pub(crate) fn feedback(stamp: Time, status: &DriverStatus) -> FollowJointTrajectoryFeedback {
    let following = Following {
        set_point: status.set_point,
        set_point_velocity: status.set_point_velocity,
        position: status.position,
        velocity: status.velocity,
    };
    FollowJointTrajectoryFeedback { header: on_platen(stamp), ..trajectory::to_feedback(&following) }
}

fn on_platen(stamp: Time) -> Header {
    Header { stamp, frame_id: PLATEN.to_owned() }
}

/// How a goal ended, in the terms of its action.
pub(crate) fn end(outcome: GoalOutcome) -> (GoalEnd, EndOfGoal) {
    let (goal_end, end, reason) = match outcome {
        GoalOutcome::Succeeded => (GoalEnd::Succeeded, TrajectoryEnd::Successful, String::new()),
        // As ros2_control ends a goal that another one replaces.
        GoalOutcome::Preempted => {
            (GoalEnd::Canceled, TrajectoryEnd::InvalidGoal, "replaced by another goal".to_owned())
        }
        GoalOutcome::Halted => (GoalEnd::Canceled, TrajectoryEnd::Successful, "halted".to_owned()),
        GoalOutcome::ToleranceViolated { error } => {
            let reason = format!("the end was missed by ({}, {}) m and {} rad", error.x, error.y, error.z);
            (GoalEnd::Aborted, TrajectoryEnd::GoalViolated, reason)
        }
        GoalOutcome::PathViolated { quantity, axis, error, allowed } => {
            let reason = format!("{quantity} of {} was {error:.6} off the path, allowed is {allowed:.6}", AXES[axis]);
            (GoalEnd::Aborted, TrajectoryEnd::PathViolated, reason)
        }
        GoalOutcome::Faulted(fault) => (GoalEnd::Aborted, TrajectoryEnd::PathViolated, fault.to_string()),
    };
    (goal_end, (end, reason))
}

/// How the driver fares, for `/diagnostics`.
pub(crate) fn health(name: &str, state: &str, status: &DriverStatus) -> Health {
    let learning = &status.learning;
    let (level, message) = match (&status.fault, &learning.warning) {
        (Some(fault), _) => (HealthLevel::Error, fault.to_string()),
        (None, Some(warning)) => (HealthLevel::Warning, warning.to_string()),
        (None, None) if status.saturated_ticks > 0 => (HealthLevel::Warning, "force or torque at its peak".to_owned()),
        (None, None) => (HealthLevel::Good, state.to_owned()),
    };
    let error = status.tracking_error_peak;
    let vibration = match status.vibration {
        VibrationPhase::Off => "off",
        VibrationPhase::Measuring => "measuring the courier",
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
        ("learning", learning.phase.to_string()),
        ("velocity error (share)", learning.velocity_error.map_or_else(String::new, |share| format!("{share:.3}"))),
        ("acceleration given over commanded", format!("{:.3}", learning.gain)),
        ("delay (s)", format!("{:.3e}", learning.delay_s)),
        ("lag (s)", format!("{:.3e}", learning.lag_s)),
    ];
    let values = values.map(|(name, value)| (name.to_owned(), value)).to_vec();
    Health { name: name.to_owned(), level, message, hardware_id: HARDWARE_ID.to_owned(), values }
}
