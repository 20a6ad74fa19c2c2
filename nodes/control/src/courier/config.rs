//! What a courier is set up with.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::control::ControlParameters;
use super::estimator::EstimatorParameters;
use super::learning::LearningParameters;
use super::rejection::Rejection;
use super::safety::SafetyParameters;
use super::vibrator::Vibrator;
use crate::courier::limits::{CourierLimits, Extent};
use feeder_model::motor::Load;
use feeder_model::range::OutOfRange;
use feeder_model::range::check_range;
use feeder_model::waveform::Waveform;

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
        self.limits.validate()?;
        self.control.validate()?;
        self.load.validate()?;
        check_range("servo_period_s", self.servo_period_s, 1e-4, 5e-3)?;
        self.learning.validate(self.servo_period_s)?;
        self.estimator.validate()?;
        let (min, max) = (self.limits.position_min(), self.limits.position_max());
        for (axis, name) in ["start x", "start y", "start yaw"].into_iter().enumerate() {
            check_range(name, self.start[axis], min[axis], max[axis])?;
        }
        check_range("fade_periods", f64::from(self.fade_periods), 1.0, f64::from(Vibrator::FADE_PERIODS_MAX))?;
        check_range("goal_tolerance_m", self.goal_tolerance_m, 1e-7, 0.01)?;
        check_range("goal_tolerance_rad", self.goal_tolerance_rad, 1e-6, 0.01)?;
        check_range("goal_time_tolerance_s", self.goal_time_tolerance_s, 0.0, 60.0)?;
        self.safety.validate()?;
        check_range("home_acceleration_m_s2", self.home_acceleration_m_s2, 0.01, 20.0)
    }

    /// Checks that a waveform could run with the courier at its start, as the driver does before it takes one.
    ///
    /// # Errors
    /// A waveform with a period out of range, or one that leaves the envelope even when faded in slowly.
    pub fn check_waveform(&self, waveform: &Waveform) -> Result<(), Rejection> {
        let cutoff_hz = self.learning.enabled.then_some(self.learning.cutoff_hz);
        let rest = Extent { position: self.start, ..Extent::default() };
        let check = |vibration: Extent| self.limits.check(&rest, &vibration, &self.load, 0.0);
        Vibrator::new(self.servo_period_s, cutoff_hz).prepare(waveform, self.fade_periods, check).map(|_| ())
    }
}
