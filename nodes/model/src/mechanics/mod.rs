//! How a part slides on a vibrating tray: a point mass under Coulomb friction.
//!
//! [`friction`] is the law of friction and [`tray_forces`] what a moving tray does to a part; the engines share both.
//! [`slope`] is exact: one dimension, piecewise-constant acceleration, closed-form events, steady motion found directly.
//! [`equations`] holds the closed forms it is checked against. [`annular`] is the annular tray in two dimensions, one
//! closed-form step per sample of any tray motion; [`map`] puts both together over the radii of a tray.

pub mod annular;
pub mod equations;
pub mod friction;
pub mod map;
pub mod slope;
pub mod tray_forces;

pub use friction::Friction;

use std::f64::consts::FRAC_PI_2;

use crate::range::OutOfRange;
use crate::waveform::Axis;

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
