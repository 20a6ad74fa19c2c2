//! What the driver reports.

use std::fmt;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::learning::LearningReport;
use feeder_model::trajectory::AXES;

/// Names an accepted trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GoalHandle(pub u64);

/// How an accepted trajectory ended.
#[derive(Clone, Debug, PartialEq)]
pub enum GoalOutcome {
    /// The end was reached within the tolerance.
    Succeeded,
    /// The same client sent another trajectory.
    Preempted,
    /// Its client cancelled it, or somebody halted the courier.
    Halted,
    /// The end was not reached within the tolerance in time.
    ToleranceViolated {
        /// Distance from the end, (m, m, rad).
        error: Vector3<f64>,
    },
    /// The courier left the tolerance about its path; it comes to rest on it.
    PathViolated {
        /// `position` or `velocity`.
        quantity: &'static str,
        /// Index of the axis.
        axis: usize,
        /// Distance from the set point, m, rad, m/s or rad/s.
        error: f64,
        /// The distance allowed.
        allowed: f64,
    },
    /// The driver went into fault.
    Faulted(Fault),
}

/// Who keeps the courier moving, and is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Commander {
    /// Whoever sends waveforms; watched while the courier vibrates.
    Generator,
    /// Whoever sends trajectories; watched while one is followed.
    Planner,
}

impl fmt::Display for Commander {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Generator => "the waveform generator",
            Self::Planner => "the planner",
        })
    }
}

/// Why the driver refuses to move until it is reset.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Fault {
    /// The courier did not follow its set point.
    #[error("{} is {error:.6} off its set point, allowed is {allowed:.6}", AXES[*axis])]
    TrackingError {
        /// Index of the axis.
        axis: usize,
        /// Distance from the set point, m or rad.
        error: f64,
        /// The distance allowed.
        allowed: f64,
    },
    /// The position sensor gave no finite number.
    #[error("the position sensor gives no finite number")]
    SensorLost,
    /// The courier does not move while its set point does.
    #[error("{} stands still while its set point moves by {asked:.6}", AXES[*axis])]
    Stuck {
        /// Index of the axis.
        axis: usize,
        /// How far the set point went, m or rad.
        asked: f64,
    },
    /// The courier left its envelope.
    #[error("{quantity} is {value:.6}, allowed is {allowed:.6}")]
    LeftEnvelope {
        /// What left its range, with its unit.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// The bound it crossed, its margin included.
        allowed: f64,
    },
    /// The forcers gave all they have for too long.
    #[error("force or torque has been at its peak for {for_s:.3} s")]
    Saturated {
        /// For how long, s.
        for_s: f64,
    },
    /// The forcers gave all they have again and again.
    #[error("force or torque was at its peak in {:.0} % of the last second's ticks", 100.0 * share)]
    OftenSaturated {
        /// Share of the ticks of a second.
        share: f64,
    },
    /// Nothing was heard of who commands the courier; it was brought to rest first.
    #[error("nothing heard of {of} for {for_s:.3} s")]
    Silence {
        /// Of whom.
        of: Commander,
        /// For how long, s.
        for_s: f64,
    },
    /// Somebody pressed the button.
    #[error("emergency stop")]
    EmergencyStop,
}

/// What happened to a goal or to the driver during a step.
#[derive(Clone, Debug, PartialEq)]
pub enum DriverEvent {
    /// A goal ended.
    GoalEnded(GoalHandle, GoalOutcome),
    /// The driver stopped itself and waits for a reset.
    Fault(Fault),
}

/// What the vibration does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VibrationPhase {
    /// Nothing: the tray is still but for trajectories.
    #[default]
    Off,
    /// Not yet: a weak excitation measures the courier first.
    Measuring,
    /// It grows to its amplitude.
    FadingIn,
    /// It repeats its waveform.
    Steady,
    /// It shrinks to nothing.
    FadingOut,
}

/// The driver's state at the end of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct DriverStatus {
    /// Time since the driver's start, s.
    pub time_s: f64,
    /// Position of the tray as estimated from sensor and commands.
    pub position: Vector3<f64>,
    /// Velocity of the tray as estimated.
    pub velocity: Vector3<f64>,
    /// Variance of the estimated position per axis, m² and rad². The axes are estimated apart from each other: between them
    /// there is no covariance.
    pub position_variance: Vector3<f64>,
    /// Variance of the estimated velocity per axis, (m/s)² and (rad/s)².
    pub velocity_variance: Vector3<f64>,
    /// Where the set point is.
    pub set_point: Vector3<f64>,
    /// How fast the set point moves.
    pub set_point_velocity: Vector3<f64>,
    /// Where the courier is sent, without the vibration: where it will be once the vibration has stopped.
    pub nominal_position: Vector3<f64>,
    /// What the vibration does.
    pub vibration: VibrationPhase,
    /// A trajectory is being followed.
    pub moving: bool,
    /// The goal being executed.
    pub goal: Option<GoalHandle>,
    /// Largest magnitude of set point − estimated position at the ticks of the step, per axis.
    pub tracking_error_peak: Vector3<f64>,
    /// Root mean square of set point − estimated position at the ticks of the step, per axis.
    pub tracking_error_rms: Vector3<f64>,
    /// Servo ticks of the step in which force or torque were cut to the peak.
    pub saturated_ticks: usize,
    /// What is learned of the waveform and of the courier, and what is wrong with it.
    pub learning: LearningReport,
    /// The latched fault, or the one it will be when the courier has come to rest.
    pub fault: Option<Fault>,
}

impl DriverStatus {
    /// Neither trajectory nor vibration moves the set point.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        !self.moving && self.vibration == VibrationPhase::Off
    }
}

/// What a step yields.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutput {
    /// The state at its end.
    pub status: DriverStatus,
    /// What happened since the last step.
    pub events: Vec<DriverEvent>,
}
