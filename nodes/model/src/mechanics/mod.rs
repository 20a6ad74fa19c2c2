//! How a part slides on a vibrating tray: a point mass under Coulomb friction.
//!
//! [`slope`] is exact: one dimension, piecewise-constant acceleration, closed-form events, steady motion found directly.
//! [`equations`] holds the closed forms it is checked against. [`annular`] is the annular tray in two dimensions, one
//! closed-form step per sample of any tray motion; [`identify`] finds the friction in a recording; [`map`] puts both together over the radii of a tray.

pub mod annular;
pub mod equations;
pub mod map;
pub mod slope;

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

use crate::range::OutOfRange;
use crate::waveform::Axis;

/// Coulomb friction between part and tray.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Coefficients", into = "Coefficients")]
pub struct Friction {
    at_rest: f64,
    sliding: f64,
}

/// Friction as it stands in a file.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Coefficients {
    #[serde(rename = "static")]
    at_rest: f64,
    kinetic: f64,
}

impl TryFrom<Coefficients> for Friction {
    type Error = OutOfRange;

    fn try_from(raw: Coefficients) -> Result<Self, OutOfRange> {
        Self::new(raw.at_rest, raw.kinetic)
    }
}

impl From<Friction> for Coefficients {
    fn from(friction: Friction) -> Self {
        Self { at_rest: friction.at_rest, kinetic: friction.sliding }
    }
}

impl Friction {
    /// Friction with coefficients μ_s at rest and μ_k while sliding.
    ///
    /// # Errors
    ///
    /// Unless 0 < μ_k ≤ μ_s, both finite.
    pub fn new(static_coefficient: f64, kinetic_coefficient: f64) -> Result<Self, OutOfRange> {
        OutOfRange::unless_positive("kinetic friction", kinetic_coefficient)?;
        OutOfRange::unless(
            static_coefficient >= kinetic_coefficient,
            "static friction",
            static_coefficient,
            format_args!("at least the kinetic friction, {kinetic_coefficient}, and finite"),
        )?;
        Ok(Self { at_rest: static_coefficient, sliding: kinetic_coefficient })
    }

    /// The paper's friction, one coefficient μ for rest and sliding.
    ///
    /// # Errors
    ///
    /// Unless μ is positive and finite.
    pub fn uniform(coefficient: f64) -> Result<Self, OutOfRange> {
        OutOfRange::unless_positive("friction", coefficient)?;
        Self::new(coefficient, coefficient)
    }

    /// μ_s.
    #[must_use]
    pub fn static_coefficient(&self) -> f64 {
        self.at_rest
    }

    /// μ_k.
    #[must_use]
    pub fn kinetic_coefficient(&self) -> f64 {
        self.sliding
    }
}

/// Why a motion cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MechanicsError {
    /// A parameter has no meaning at its value.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The tray accelerates away from under the part.
    #[error(
        "the part leaves the tray: at a horizontal acceleration of {acceleration_m_s2} m/s² the normal force is \
         {normal_over_weight} of the weight; it must not be negative (a sin φ ≤ g cos φ)"
    )]
    LosesContact {
        /// Horizontal acceleration of the tray where it happens.
        acceleration_m_s2: f64,
        /// Normal force over weight there.
        normal_over_weight: f64,
    },
    /// The waveform does not turn the tray.
    #[error("the waveform drives axis {axis:?}; an annular tray is fed by axis Yaw")]
    WrongAxis {
        /// The axis it drives.
        axis: Axis,
    },
}

/// Checks gravity and a slope of less than 90° either way.
pub fn check_slope(slope_rad: f64, gravity_m_s2: f64) -> Result<(), OutOfRange> {
    OutOfRange::unless_positive("gravity_m_s2", gravity_m_s2)?;
    OutOfRange::unless(slope_rad.abs() < FRAC_PI_2, "slope_rad", slope_rad, "within ±π/2 (90°)")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_is_positive_and_static_at_least_kinetic() {
        for (at_rest, sliding, word) in
            [(0.1, 0.2, "static"), (0.2, 0.0, "kinetic"), (f64::NAN, 0.2, "static"), (0.2, f64::NAN, "kinetic")]
        {
            let text = Friction::new(at_rest, sliding).unwrap_err().to_string();
            assert!(text.starts_with(word) && text.contains("range"), "{text}");
        }
        assert!(Friction::uniform(-0.2).is_err());
        assert_eq!(Friction::uniform(0.2), Friction::new(0.2, 0.2));
    }
}
