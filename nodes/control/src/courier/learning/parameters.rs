//! How a driver is told to learn.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::{OutOfRange, check_range, check_ranges};

/// How waveforms are learned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningParameters {
    /// Whether to learn at all. If so, the set point of a vibration is its waveform up to the cut-off.
    pub enabled: bool,
    /// Highest frequency of the set point and of what is learned, Hz; below half the servo rate.
    /// Above it a tray may swing on its mounting without being seen or shaken; a higher one follows the waveform more
    /// closely, and is for a tray that is known to be rigid up to there.
    pub cutoff_hz: f64,
    /// Highest frequency learned on the two axes that do not vibrate, Hz: what couples into them is weak, and above it
    /// less than the sensor's noise.
    pub lateral_cutoff_hz: f64,
    /// The delay of the loop as far as known, s; what it really is, is measured.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub nominal_delay_s: f64,
    /// The plant's lag as far as known, s; what it really is, is measured.
    #[schemars(range(min = 0.0, max = 0.02))]
    pub nominal_lag_s: f64,
    /// By how much mass and inertia may differ from those of the limits, relative, one standard deviation.
    #[schemars(range(min = 1e-3, max = 1.0))]
    pub mass_spread: f64,
    /// By how much delay and lag may each differ from the nominal ones, s, one standard deviation.
    #[schemars(range(min = 1e-6, max = 0.01))]
    pub delay_spread_s: f64,
    /// Largest acceleration of translation commanded to measure the plant, m/s². Nothing may slide under it; 0: the plant is
    /// measured by the waveform alone.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub excitation_m_s2_max: f64,
    /// The same of rotation, rad/s². The default is a quarter of what holds parts on the paper's ramp at 85 mm, so that they
    /// stay even on a courier of half the inertia.
    #[schemars(range(min = 0.0, max = 50.0))]
    pub excitation_rad_s2_max: f64,
}

impl Default for LearningParameters {
    fn default() -> Self {
        Self {
            enabled: false,
            cutoff_hz: 450.0,
            lateral_cutoff_hz: 450.0,
            nominal_delay_s: 0.5e-3,
            nominal_lag_s: 0.5e-3,
            mass_spread: 0.4,
            delay_spread_s: 0.5e-3,
            excitation_m_s2_max: 0.4,
            excitation_rad_s2_max: 3.2,
        }
    }
}

impl LearningParameters {
    /// Highest frequency of a vibration's set point, Hz; without learning it follows its waveform exactly.
    pub(crate) fn set_point_cutoff_hz(&self) -> Option<f64> {
        self.enabled.then_some(self.cutoff_hz)
    }

    /// Checks every value; `servo_period_s` bounds the cut-off.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self, servo_period_s: f64) -> Result<(), OutOfRange> {
        check_ranges("learning.", self)?;
        // Closer to half the servo rate, force and position of the ticks say too little of each other.
        let cutoff_hz_max = if self.enabled { 0.475 / servo_period_s } else { f64::MAX };
        check_range("learning.cutoff_hz", self.cutoff_hz, 10.0, cutoff_hz_max)?;
        check_range("learning.lateral_cutoff_hz", self.lateral_cutoff_hz, 0.0, cutoff_hz_max)
    }
}
