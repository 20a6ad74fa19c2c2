//! What a courier is set up with.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::control::ControlParameters;
use super::envelope::WaveformEnvelope;
use super::estimator::EstimatorParameters;
use super::learning::LearningParameters;
use super::limits::CourierLimits;
use super::safety::SafetyParameters;
use feeder_model::motor::Load;
use feeder_model::range::{OutOfRange, check_range};

/// Everything a courier is set up with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CourierConfig {
    /// The envelope of commands.
    pub limits: CourierLimits,
    /// The servo loop.
    pub control: ControlParameters,
    /// The learning of waveforms.
    pub learning: LearningParameters,
    /// The estimate of the courier's motion.
    pub estimator: EstimatorParameters,
    /// What the tray carries.
    pub load: Load,
    /// Time between servo ticks, s.
    pub servo_period_s: f64,
    /// Where the courier begins: x, y (m) and yaw (rad).
    #[schemars(with = "[f64; 3]")]
    pub start: Vector3<f64>,
    /// Fewest periods over which a vibration fades in and out; more are taken where the envelope asks for it.
    pub fade_periods: u32,
    /// Largest distance from the set point at which a goal counts as reached, m.
    pub goal_tolerance_m: f64,
    /// Largest yaw from the set point at which a goal counts as reached, rad.
    pub goal_tolerance_rad: f64,
    /// Time after a trajectory's end within which its goal must be reached, s.
    pub goal_time_tolerance_s: f64,
    /// What the driver takes for out of control.
    pub safety: SafetyParameters,
    /// Largest acceleration of translation on the way home, m/s²; of rotation it is ten times the number, in rad/s².
    pub home_acceleration_m_s2: f64,
}

impl Default for CourierConfig {
    fn default() -> Self {
        Self {
            limits: CourierLimits::default(),
            control: ControlParameters::default(),
            learning: LearningParameters::default(),
            estimator: EstimatorParameters::default(),
            load: Load::default(),
            servo_period_s: 0.5e-3,
            start: Vector3::zeros(),
            fade_periods: 2,
            goal_tolerance_m: 20e-6,
            goal_tolerance_rad: 1e-3,
            goal_time_tolerance_s: 0.5,
            safety: SafetyParameters::default(),
            home_acceleration_m_s2: 1.0,
        }
    }
}

impl CourierConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        self.control.validate()?;
        check_range("servo_period_s", self.servo_period_s, 1e-4, 5e-3)?;
        self.learning.validate(self.servo_period_s)?;
        self.estimator.validate()?;
        self.waveform_envelope().validate()?;
        check_range("goal_tolerance_m", self.goal_tolerance_m, 1e-7, 0.01)?;
        check_range("goal_tolerance_rad", self.goal_tolerance_rad, 1e-6, 0.01)?;
        check_range("goal_time_tolerance_s", self.goal_time_tolerance_s, 0.0, 60.0)?;
        self.safety.validate()?;
        check_range("home_acceleration_m_s2", self.home_acceleration_m_s2, 0.01, 20.0)
    }

    /// Which waveforms the courier can run.
    #[must_use]
    pub fn waveform_envelope(&self) -> WaveformEnvelope {
        WaveformEnvelope {
            limits: self.limits,
            load: self.load,
            start: self.start,
            fade_periods: self.fade_periods,
            cutoff_hz: self.learning.set_point_cutoff_hz(),
        }
    }
}
