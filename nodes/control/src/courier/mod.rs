//! The courier driver without its hardware: what may be commanded, how it is followed, and the servo loop.
//!
//! A [`Driver`] superposes two motions. The *nominal* motion is where the courier is sent, by trajectories
//! ([`Trajectory`]). The *vibration* repeats a
//! [`Waveform`](feeder_model::waveform::Waveform) about it. Their sum is the set point of a
//! servo loop ([`control`]) that drives a [`PlanarMotor`](feeder_model::motor::PlanarMotor): the hardware, or a simulation of it.
//!
//! Of the motor the driver knows what it told it and what its sensor reads. Feedback, learning and the watch over set point
//! and bounds work on the reading itself; velocity, and all that is reported, comes from an estimate
//! ([`EstimatorParameters`] says of what).
//!
//! Everything is checked before it is begun: a command is refused with a [`Rejection`] and changes nothing, or it is
//! accepted and can be carried out inside the [`CourierLimits`] at every servo tick.
//!
//! Vectors are (x, y, yaw) in the platen frame: m and rad, m/s and rad/s, m/s² and rad/s².

mod config;
pub mod control;
mod driver;
mod envelope;
mod estimator;
mod fourier;
mod learning;
mod limits;
mod path;
mod rejection;
mod report;
mod response;
mod safety;
mod smoothstep;
mod tolerance;
mod trajectory;
mod vibration;
mod vibrator;

pub use config::CourierConfig;
pub use driver::Driver;
pub use envelope::WaveformEnvelope;
pub use estimator::EstimatorParameters;
pub use feeder_model::trajectory::{AXES, Tolerances, Trajectory, TrajectoryPoint};
pub use learning::{LearningParameters, LearningPhase, LearningReport, LearningWarning, MeasuredResponse};
pub use limits::{CourierLimits, LimitViolation};
pub use rejection::Rejection;
pub use report::{Commander, DriverEvent, DriverStatus, Fault, GoalHandle, GoalOutcome, StepOutput, VibrationPhase};
pub use response::PlantModel;
pub use safety::SafetyParameters;
pub use smoothstep::smoothstep;
