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
        /// Period, s; without it the longest in whole milliseconds for which the tray turns by no more than 0.95 of
        /// `courier.limits.yaw_rad_max`: the longer it is, the faster parts are fed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        period_s: Option<f64>,
        /// The smaller acceleration, with which the part is carried, rad/s²; without it the largest with which a part is
        /// carried up the ramp along the outer wall that has the least friction that control believes in.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        a_min_rad_s2: Option<f64>,
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

/// What a waveform is designed for, where its scenario does not state its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesignBasis {
    /// The tray.
    pub tray: TrayGeometry,
    /// The least coefficient of friction that control believes parts may have.
    pub part_friction_min: f64,
    /// Largest radius at which the middle of a part can ride, m.
    pub outermost_m: f64,
    /// Largest yaw of the tray to either side, rad.
    pub yaw_rad_max: f64,
}

impl DesignBasis {
    /// The largest angular acceleration with which a part is carried up the ramp along the outer wall, rad/s².
    fn carrying_rad_s2(&self) -> Result<f64, OutOfRange> {
        let slope_rad = self.tray.ramp_slope_rad(self.outermost_m);
        let carrying_m_s2 = OptimalDesign::carrying_m_s2(self.part_friction_min, slope_rad, STANDARD_GRAVITY_M_S2);
        let least = format_args!("above {} on this ramp, along the outer wall", slope_rad.tan());
        OutOfRange::unless(carrying_m_s2 > 0.0, "least friction of the part", self.part_friction_min, least)?;
        Ok(carrying_m_s2 / self.outermost_m)
    }

    /// The longest stick-slip of these accelerations, rad/s², within which the tray turns hardly as far as it may.
    fn longest_stick_slip(&self, a_min: f64, a_max: f64) -> Result<Waveform, WaveformError> {
        /// The rest is left to a courier that does not follow exactly.
        const YAW_SHARE: f64 = 0.95;
        let of_a_second = Waveform::stick_slip(Axis::Yaw, 1.0, a_min, a_max)?;
        // The same accelerations turn the tray with the square of the period.
        let period_s = (YAW_SHARE * self.yaw_rad_max / of_a_second.peak_position()).sqrt();
        Waveform::stick_slip(Axis::Yaw, (period_s * 1e3).floor() * 1e-3, a_min, a_max)
    }
}

impl WaveformSpec {
    /// The waveform, on the yaw axis.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn design(&self, basis: &DesignBasis) -> Result<Waveform, WaveformError> {
        match *self {
            Self::StickSlip { period_s, a_min_rad_s2, a_max_rad_s2: a_max } => {
                let a_min = a_min_rad_s2.map_or_else(|| basis.carrying_rad_s2(), Ok)?;
                match period_s {
                    Some(period_s) => Waveform::stick_slip(Axis::Yaw, period_s, a_min, a_max),
                    None => basis.longest_stick_slip(a_min, a_max),
                }
            }
            Self::CoulombPump { period_s, a_rad_s2, z } => Waveform::coulomb_pump(Axis::Yaw, period_s, a_rad_s2, z),
            Self::Optimal { period_s, radius_m, surface, friction, limit_rad_s2 } => {
                let slope_rad = match surface {
                    Surface::Ramp => basis.tray.ramp_slope_rad(radius_m),
                    Surface::Plateau => 0.0,
                };
                let design = OptimalDesign {
                    friction: friction.unwrap_or(basis.part_friction_min),
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

#[cfg(test)]
mod tests {
    use feeder_model::mechanics::Friction;
    use feeder_model::mechanics::slope::LinearTrack;

    use super::*;

    const LONGEST: WaveformSpec = WaveformSpec::StickSlip { period_s: None, a_min_rad_s2: None, a_max_rad_s2: 300.0 };

    fn basis(part_friction_min: f64) -> DesignBasis {
        DesignBasis { tray: TrayGeometry::PAPER, part_friction_min, outermost_m: 0.085, yaw_rad_max: 0.035 }
    }

    /// How far a part of this friction slides back along the outer wall each period, m.
    fn slides_back_m(waveform: &Waveform, friction: f64) -> f64 {
        let slope_rad = TrayGeometry::PAPER.ramp_slope_rad(0.085);
        let track = LinearTrack::new(Friction::uniform(friction).unwrap(), slope_rad, STANDARD_GRAVITY_M_S2).unwrap();
        track.drive(waveform, 0.085).unwrap().steady().unwrap().slip_back_m
    }

    #[test]
    fn a_designed_stick_slip_carries_the_least_friction_and_hardly_less() {
        for friction in [0.1, 0.18, 0.3, 0.5] {
            let waveform = LONGEST.design(&basis(friction)).unwrap();
            assert!(slides_back_m(&waveform, 1.001 * friction) < 1e-12, "{friction}");
            assert!(slides_back_m(&waveform, 0.98 * friction) > 1e-5, "{friction}");
        }
    }

    #[test]
    fn a_designed_stick_slip_turns_the_tray_by_a_twentieth_less_than_it_may() {
        for friction in [0.1, 0.18, 0.3, 0.5] {
            let waveform = LONGEST.design(&basis(friction)).unwrap();
            let peak_rad = waveform.peak_position();
            assert!((0.93 * 0.035..0.951 * 0.035).contains(&peak_rad), "{friction}: {peak_rad}");
        }
    }

    #[test]
    fn what_a_stick_slip_states_is_taken_as_it_is() {
        let stated = |period_s, a_min_rad_s2| {
            let spec = WaveformSpec::StickSlip { period_s, a_min_rad_s2, a_max_rad_s2: 300.0 };
            spec.design(&basis(0.18)).unwrap()
        };
        assert_eq!(stated(Some(0.05), Some(15.0)), Waveform::stick_slip(Axis::Yaw, 0.05, 15.0, 300.0).unwrap());
        assert!((stated(Some(0.05), None).period_s() - 0.05).abs() < 1e-12);
        let forward_rad_s2 = stated(None, Some(15.0)).segments()[0].acceleration;
        assert!((forward_rad_s2 - 15.0).abs() < 1e-12);
    }

    #[test]
    fn a_ramp_down_which_parts_slide_is_refused() {
        let refused = LONGEST.design(&basis(0.07)).unwrap_err().to_string();
        assert!(refused.contains("least friction of the part = 0.07") && refused.contains("above 0.0748"), "{refused}");
    }
}
