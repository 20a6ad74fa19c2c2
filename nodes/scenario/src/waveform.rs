//! How a scenario states its waveform.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::range::OutOfRange;
use feeder_model::tray::{Surface, TrayGeometry};
use feeder_model::waveform::{Axis, OptimalDesign, Segment, Waveform, WaveformError};

/// A vibration of the tray about its centre. Accelerations are angular: divide those of a flat tray by the radius.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum WaveformSpec {
    /// Quaid Eqs 1–3.
    StickSlip {
        /// Period, s.
        period_s: f64,
        /// The smaller acceleration, with which the part is carried, rad/s².
        a_min_rad_s2: f64,
        /// The larger acceleration, under which the tray slips back, rad/s².
        a_max_rad_s2: f64,
    },
    /// Quaid Eqs 8–10.
    CoulombPump {
        /// Period, s.
        period_s: f64,
        /// Acceleration, rad/s².
        a_rad_s2: f64,
        /// Share of the period without acceleration, 0 to 1.
        z: f64,
    },
    /// The fastest for one radius and friction.
    Optimal {
        /// Period, s.
        period_s: f64,
        /// Radius it is designed for, m.
        radius_m: f64,
        /// Surface it is designed for.
        surface: Surface,
        /// Coefficient of friction it is designed for; without it the least that control believes the part's may be, as a
        /// part with less friction than it is designed for slides back on the ramp.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        friction: Option<f64>,
        /// Largest acceleration, rad/s².
        limit_rad_s2: f64,
    },
    /// Anything else.
    Segments {
        /// Segments of constant angular acceleration, rad/s², in order.
        segments: Vec<Segment>,
    },
}

impl WaveformSpec {
    /// The waveform, on the yaw axis, on a tray with parts that are believed to have at least the friction `part_friction_min`.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn design(&self, tray: &TrayGeometry, part_friction_min: f64) -> Result<Waveform, WaveformError> {
        match *self {
            Self::StickSlip { period_s, a_min_rad_s2, a_max_rad_s2 } => {
                Waveform::stick_slip(Axis::Yaw, period_s, a_min_rad_s2, a_max_rad_s2)
            }
            Self::CoulombPump { period_s, a_rad_s2, z } => Waveform::coulomb_pump(Axis::Yaw, period_s, a_rad_s2, z),
            Self::Optimal { period_s, radius_m, surface, friction, limit_rad_s2 } => {
                let slope_rad = match surface {
                    Surface::Ramp => tray.ramp_slope_rad(radius_m),
                    Surface::Plateau => 0.0,
                };
                let design = OptimalDesign {
                    friction: friction.unwrap_or(part_friction_min),
                    slope_rad,
                    gravity_m_s2: STANDARD_GRAVITY_M_S2,
                    limit_m_s2: limit_rad_s2 * radius_m,
                };
                OutOfRange::unless_positive("radius_m", radius_m)?;
                let waveform = Waveform::optimal(Axis::Yaw, period_s, &design);
                // The design knows the acceleration at its radius; the scenario states the angular one.
                let waveform = waveform.map_err(|error| match error {
                    WaveformError::OutOfRange(error) if error.parameter == "limit_m_s2" => {
                        let allowed = format_args!("times radius_m {}", error.allowed);
                        OutOfRange::new("limit_rad_s2", limit_rad_s2, allowed).into()
                    }
                    other => other,
                })?;
                waveform.scaled(1.0 / radius_m)
            }
            Self::Segments { ref segments } => Waveform::new(Axis::Yaw, segments.clone()),
        }
    }

    /// A name for people.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::StickSlip { .. } => "stick_slip",
            Self::CoulombPump { .. } => "coulomb_pump",
            Self::Optimal { .. } => "optimal",
            Self::Segments { .. } => "segments",
        }
    }
}
