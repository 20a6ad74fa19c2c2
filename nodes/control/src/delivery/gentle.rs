//! How gently parts are carried.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::range::{OutOfRange, check_range, check_ranges};

/// How gently parts are carried.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GentleParameters {
    /// Coefficient of static friction between part and tray: the part's own, not a setting.
    #[serde(skip)]
    pub friction: f64,
    /// Share of the acceleration that friction holds which is used; the rest is for tracking errors. Shares above 1
    /// make parts slide, which tests want to see.
    #[schemars(range(min = 0.05, max = 2.0))]
    pub friction_share: f64,
    /// Largest jerk, m/s³.
    #[schemars(range(min = 1.0, max = 1e4))]
    pub jerk_m_s3_max: f64,
    /// Acceleration of gravity, m/s².
    #[schemars(range(min = 0.1, max = 100.0))]
    pub gravity_m_s2: f64,
}

impl Default for GentleParameters {
    fn default() -> Self {
        Self { friction: 0.2, friction_share: 0.955, jerk_m_s3_max: 100.0, gravity_m_s2: STANDARD_GRAVITY_M_S2 }
    }
}

impl GentleParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("friction", self.friction, 0.01, 5.0)?;
        check_ranges("", self)
    }
}
