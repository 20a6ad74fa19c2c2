//! What the courier may be commanded to do.

use std::f64::consts::PI;

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use feeder_model::motor::Load;
use feeder_model::range::{OutOfRange, check_range, check_ranges};

/// Yaw to which the motor holds its force, rad (2 degrees, published).
const YAW_RAD_MAX: f64 = 2.0 * PI / 180.0;

/// The courier's envelope, and the mass by which a commanded acceleration becomes a force.
///
/// The paper publishes about 1.5 m/s, several g and ±2° of yaw; force, torque, mass and inertia are assumed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CourierLimits {
    /// Lower bound of the courier's centre on the platen along x, m.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub x_m_min: f64,
    /// Upper bound along x, m.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub x_m_max: f64,
    /// Lower bound along y, m.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub y_m_min: f64,
    /// Upper bound along y, m.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub y_m_max: f64,
    /// Where the tether is fixed, x and y on the platen, m (assumed).
    #[schemars(inner(range(min = -10.0, max = 10.0)))]
    pub tether_anchor_m: [f64; 2],
    /// Length of the tether, m (assumed): the courier's centre stays this close to the anchor.
    #[schemars(range(min = 0.01, max = 20.0))]
    pub tether_length_m: f64,
    /// Largest yaw to either side, rad.
    #[schemars(range(min = 0.0, max = YAW_RAD_MAX))]
    pub yaw_rad_max: f64,
    /// Largest speed of translation, m/s.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub speed_m_s_max: f64,
    /// Largest acceleration of translation, m/s².
    #[schemars(range(min = 0.001, max = 100.0))]
    pub acceleration_m_s2_max: f64,
    /// Largest jerk of translation in trajectories, m/s³. Waveforms are steps of acceleration and exempt.
    #[schemars(range(min = 1.0, max = 1e6))]
    pub jerk_m_s3_max: f64,
    /// Peak force along x and along y, N (assumed). Force and torque come from the same forcers: where both are wanted,
    /// their shares of the peaks add up to 1 at most.
    #[schemars(range(min = 0.001, max = 1e3))]
    pub force_n_max: f64,
    /// Peak torque about z, N m (assumed).
    #[schemars(range(min = 1e-4, max = 1e3))]
    pub torque_n_m_max: f64,
    /// Share of force and torque kept for feedback: commands may ask for the rest.
    #[schemars(range(min = 0.0, max = 0.9))]
    pub feedback_reserve: f64,
    /// Mass of courier and empty tray, kg (assumed).
    #[schemars(range(min = 1e-2, max = 100.0))]
    pub mass_kg: f64,
    /// Moment of inertia of courier and empty tray about the tray's centre, kg m² (assumed).
    #[schemars(range(min = 1e-6, max = 10.0))]
    pub inertia_kg_m2: f64,
}

impl Default for CourierLimits {
    fn default() -> Self {
        Self {
            x_m_min: -0.5,
            x_m_max: 0.5,
            y_m_min: -0.5,
            y_m_max: 0.5,
            tether_anchor_m: [0.0, 0.8],
            // Just the far corners of the platen.
            tether_length_m: 1.4,
            yaw_rad_max: YAW_RAD_MAX,
            speed_m_s_max: 1.5,
            acceleration_m_s2_max: 20.0,
            jerk_m_s3_max: 10_000.0,
            force_n_max: 30.0,
            torque_n_m_max: 2.7,
            feedback_reserve: 0.1,
            mass_kg: 1.2,
            inertia_kg_m2: 0.005,
        }
    }
}

/// A commanded motion that leaves the envelope.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{quantity} would be {value:.6} at {time_s:.4} s, allowed is {allowed:.6}")]
pub struct LimitViolation {
    /// What leaves its range, with its unit.
    pub quantity: &'static str,
    /// The value it would take.
    pub value: f64,
    /// The bound it would cross.
    pub allowed: f64,
    /// Time since the start of the commanded motion, s.
    pub time_s: f64,
}

/// How far a vibration reaches on each axis about the nominal motion: peaks of magnitude, whatever the phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Extent {
    pub(crate) position: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
}

impl Extent {
    /// The extent that covers both.
    pub(crate) fn union(&self, other: &Self) -> Self {
        Self {
            position: self.position.sup(&other.position),
            velocity: self.velocity.sup(&other.velocity),
            acceleration: self.acceleration.sup(&other.acceleration),
        }
    }
}

impl CourierLimits {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("limits.", self)?;
        check_range("limits.x_m_max", self.x_m_max, self.x_m_min, 10.0)?;
        check_range("limits.y_m_max", self.y_m_max, self.y_m_min, 10.0)
    }

    /// Mass, mass and inertia moved along each axis under `load`.
    #[must_use]
    pub fn moved(&self, load: &Load) -> Vector3<f64> {
        let mass_kg = self.mass_kg + load.mass_kg;
        Vector3::new(mass_kg, mass_kg, self.inertia_kg_m2 + load.inertia_kg_m2)
    }

    /// Peak force along x and y (N) and torque (N m).
    #[must_use]
    pub fn wrench_max(&self) -> Vector3<f64> {
        Vector3::new(self.force_n_max, self.force_n_max, self.torque_n_m_max)
    }

    /// Lower corner of the allowed box of (x, y, yaw).
    #[must_use]
    pub fn position_min(&self) -> Vector3<f64> {
        Vector3::new(self.x_m_min, self.y_m_min, -self.yaw_rad_max)
    }

    /// Upper corner of the allowed box of (x, y, yaw).
    #[must_use]
    pub fn position_max(&self) -> Vector3<f64> {
        Vector3::new(self.x_m_max, self.y_m_max, self.yaw_rad_max)
    }

    /// Distance from the tether's anchor, m.
    #[must_use]
    pub fn tether_m(&self, position: &Vector3<f64>) -> f64 {
        (position.xy() - Vector2::from(self.tether_anchor_m)).norm()
    }

    /// Cuts a wrench to what the forcers give: each component to its peak, then all alike until force and torque fit
    /// together.
    #[must_use]
    pub fn saturate(&self, wrench: Vector3<f64>) -> Vector3<f64> {
        let peak = self.wrench_max();
        let cut = wrench.sup(&-peak).inf(&peak);
        cut / self.forcer_share(&cut).1.max(1.0)
    }

    /// The axis whose forcers a wrench loads most, and the share of their peak that it takes.
    fn forcer_share(&self, wrench: &Vector3<f64>) -> (usize, f64) {
        let share = wrench.component_div(&self.wrench_max()).abs();
        if share.x >= share.y { (0, share.x + share.z) } else { (1, share.y + share.z) }
    }

    /// Largest acceleration of translation a command may ask for under `load`: the smaller of the limit itself and
    /// what force is left beside the feedback's reserve, m/s².
    #[must_use]
    pub fn translation_acceleration_m_s2_max(&self, load: &Load) -> f64 {
        let by_force_m_s2 = (1.0 - self.feedback_reserve) * self.force_n_max / self.moved(load).x;
        self.acceleration_m_s2_max.min(by_force_m_s2)
    }

    /// Checks one instant of a nominal motion with a vibration of `extent` about it.
    pub(crate) fn check(
        &self,
        motion: &Extent,
        vibration: &Extent,
        load: &Load,
        time_s: f64,
    ) -> Result<(), LimitViolation> {
        // Rounding of a motion that ends exactly on a bound must not refuse it.
        const SLACK: f64 = 1e-9;
        let violation = |quantity, value, allowed| Err(LimitViolation { quantity, value, allowed, time_s });
        let lowest = motion.position - vibration.position;
        let highest = motion.position + vibration.position;
        let (min, max) = (self.position_min(), self.position_max());
        for (axis, name) in ["courier_x (m)", "courier_y (m)", "courier_yaw (rad)"].into_iter().enumerate() {
            if lowest[axis] < min[axis] - SLACK {
                return violation(name, lowest[axis], min[axis]);
            }
            if highest[axis] > max[axis] + SLACK {
                return violation(name, highest[axis], max[axis]);
            }
        }
        let tether_m = self.tether_m(&motion.position) + vibration.position.xy().norm();
        if tether_m > self.tether_length_m + SLACK {
            return violation("distance from the tether's anchor (m)", tether_m, self.tether_length_m);
        }
        let velocity = motion.velocity.abs() + vibration.velocity;
        let acceleration = motion.acceleration.abs() + vibration.acceleration;
        let speed_m_s = velocity.xy().norm();
        if speed_m_s > self.speed_m_s_max * (1.0 + SLACK) {
            return violation("speed (m/s)", speed_m_s, self.speed_m_s_max);
        }
        let acceleration_m_s2 = acceleration.xy().norm();
        if acceleration_m_s2 > self.acceleration_m_s2_max * (1.0 + SLACK) {
            return violation("acceleration (m/s²)", acceleration_m_s2, self.acceleration_m_s2_max);
        }
        let wrench = self.moved(load).component_mul(&acceleration);
        let available = self.wrench_max() * (1.0 - self.feedback_reserve);
        for (axis, name) in ["force along x (N)", "force along y (N)", "torque (N m)"].into_iter().enumerate() {
            if wrench[axis] > available[axis] * (1.0 + SLACK) {
                return violation(name, wrench[axis], available[axis]);
            }
        }
        let (axis, share) = self.forcer_share(&wrench);
        if share > (1.0 - self.feedback_reserve) * (1.0 + SLACK) {
            let name = ["force along x and torque (share of peak)", "force along y and torque (share of peak)"][axis];
            return violation(name, share, 1.0 - self.feedback_reserve);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_limits_are_valid_and_a_bad_one_is_named() {
        assert_eq!(CourierLimits::default().validate(), Ok(()));
        let limits = CourierLimits { yaw_rad_max: 0.1, ..CourierLimits::default() };
        let error = limits.validate().unwrap_err();
        assert_eq!(error.parameter, "limits.yaw_rad_max");
        let limits = CourierLimits { speed_m_s_max: f64::NAN, ..CourierLimits::default() };
        assert_eq!(limits.validate().unwrap_err().parameter, "limits.speed_m_s_max");
    }

    #[test]
    fn a_heavy_load_lowers_the_acceleration_that_may_be_asked_for() {
        let limits = CourierLimits::default();
        let empty = limits.translation_acceleration_m_s2_max(&Load::default());
        assert!((empty - 20.0).abs() < 1e-12);
        let loaded = limits.translation_acceleration_m_s2_max(&Load { mass_kg: 1.2, inertia_kg_m2: 0.0 });
        assert!((loaded - 27.0 / 2.4).abs() < 1e-12);
    }

    #[test]
    fn a_short_tether_and_shared_forcers_bound_what_may_be_asked_for() {
        let limits = CourierLimits { tether_length_m: 1.0, ..CourierLimits::default() };
        let check = |position, acceleration| {
            let motion = Extent { position, acceleration, ..Extent::default() };
            limits.check(&motion, &Extent::default(), &Load::default(), 0.0).map_err(|violation| violation.quantity)
        };
        assert_eq!(check(Vector3::new(0.0, -0.1, 0.0), Vector3::zeros()), Ok(()));
        let far = check(Vector3::new(0.4, -0.3, 0.0), Vector3::zeros());
        assert_eq!(far, Err("distance from the tether's anchor (m)"));
        // Half of the force and half of the torque are all that the reserve leaves, and a little too much.
        assert_eq!(check(Vector3::zeros(), Vector3::new(0.0, 11.0, 240.0)), Ok(()));
        let both = check(Vector3::zeros(), Vector3::new(0.0, 12.0, 260.0));
        assert_eq!(both, Err("force along y and torque (share of peak)"));
        let cut = limits.saturate(Vector3::new(60.0, 0.0, 2.7));
        assert!((cut - Vector3::new(15.0, 0.0, 1.35)).norm() < 1e-12, "{cut}");
    }
}
