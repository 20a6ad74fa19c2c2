//! What an axis of the courier can do, and whether a waveform stays within it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Waveform;

/// Limits of one axis: m, m/s, m/s² on X and Y; rad, rad/s, rad/s² on Yaw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisLimits {
    /// Largest magnitude of acceleration.
    pub max_acceleration: f64,
    /// Largest magnitude of velocity.
    pub max_speed: f64,
    /// Largest peak-to-peak travel.
    pub max_stroke: f64,
}

impl AxisLimits {
    /// No limit at all.
    pub const NONE: Self =
        Self { max_acceleration: f64::INFINITY, max_speed: f64::INFINITY, max_stroke: f64::INFINITY };
}

/// A waveform asks for more than the axis can do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the waveform's {quantity} of {value} exceeds the limit: at most {limit}")]
pub struct LimitExceeded {
    /// `peak acceleration`, `peak speed` or `stroke`.
    pub quantity: &'static str,
    /// What the waveform asks for.
    pub value: f64,
    /// What the axis can do.
    pub limit: f64,
}

impl Waveform {
    /// Checks that the axis can run the waveform; 1e-9 of each limit is taken for rounding.
    ///
    /// # Errors
    ///
    /// The first quantity beyond its limit, in the order acceleration, speed, stroke.
    pub fn check(&self, limits: &AxisLimits) -> Result<(), LimitExceeded> {
        [
            ("peak acceleration", self.peak_acceleration(), limits.max_acceleration),
            ("peak speed", self.peak_speed(), limits.max_speed),
            ("stroke", self.stroke(), limits.max_stroke),
        ]
        .into_iter()
        .try_for_each(|(quantity, value, limit)| {
            if value <= limit * (1.0 + 1e-9) { Ok(()) } else { Err(LimitExceeded { quantity, value, limit }) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Axis;
    use super::*;

    #[test]
    fn each_limit_is_named_when_exceeded() {
        let waveform = Waveform::stick_slip(Axis::Yaw, 0.1, 9.0, 66.7).unwrap();
        assert_eq!(waveform.check(&AxisLimits::NONE), Ok(()));
        let exceeded = |limits: AxisLimits| waveform.check(&limits).unwrap_err().quantity;
        assert_eq!(exceeded(AxisLimits { max_acceleration: 66.0, ..AxisLimits::NONE }), "peak acceleration");
        assert_eq!(exceeded(AxisLimits { max_speed: 0.39, ..AxisLimits::NONE }), "peak speed");
        assert_eq!(exceeded(AxisLimits { max_stroke: 0.0099, ..AxisLimits::NONE }), "stroke");
        assert_eq!(exceeded(AxisLimits { max_stroke: f64::NAN, ..AxisLimits::NONE }), "stroke");
    }
}
