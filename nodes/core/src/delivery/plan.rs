//! Planning a move in which no protected part slides.

use nalgebra::{Rotation2, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::hold::holding_acceleration_m_s2;
use super::profile::{LineLimits, Profile};
use crate::courier::{CourierLimits, Load, Trajectory, TrajectoryPoint, check_range};
use crate::gravity::STANDARD_GRAVITY_M_S2;
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;

/// How gently parts are carried.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GentleParameters {
    /// Coefficient of static friction between part and tray.
    pub friction: f64,
    /// Share of the acceleration that friction holds which is used; the rest is for tracking errors. Shares above 1
    /// make parts slide, which tests want to see.
    pub friction_share: f64,
    /// Largest jerk, m/s³.
    pub jerk_m_s3_max: f64,
    /// Acceleration of gravity, m/s².
    pub gravity_m_s2: f64,
}

impl Default for GentleParameters {
    fn default() -> Self {
        Self { friction: 0.2, friction_share: 0.97, jerk_m_s3_max: 100.0, gravity_m_s2: STANDARD_GRAVITY_M_S2 }
    }
}

impl GentleParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("friction", self.friction, 0.01, 5.0)?;
        check_range("friction_share", self.friction_share, 0.05, 2.0)?;
        check_range("jerk_m_s3_max", self.jerk_m_s3_max, 1.0, 1e4)?;
        check_range("gravity_m_s2", self.gravity_m_s2, 0.1, 100.0)
    }
}

/// Why there is no such move.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlanError {
    /// A coordinate is not finite, or out of the courier's reach.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The move is too short to be one.
    #[error("the courier is there already: the distance is {distance_m:e} m")]
    NoDistance {
        /// The distance, m.
        distance_m: f64,
    },
    /// A move that turns the tray.
    #[error("the yaw would change by {change_rad} rad, but moves keep it")]
    Yaw {
        /// The change asked for, rad.
        change_rad: f64,
    },
    /// A part that slides even on a courier at rest.
    #[error("friction {friction} does not hold the part at ({x_m:.4}, {y_m:.4}) m in the tray even at rest")]
    CannotHold {
        /// The coefficient of friction.
        friction: f64,
        /// Where the part lies in the tray, m.
        x_m: f64,
        /// Where the part lies in the tray, m.
        y_m: f64,
    },
}

/// A straight move from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct MovePlan {
    /// Where it begins: x, y (m) and yaw (rad) on the platen.
    pub from: Vector3<f64>,
    /// Where it ends.
    pub to: Vector3<f64>,
    /// How long it takes, s.
    pub duration_s: f64,
    /// What friction alone would allow: √(2d (1/A₁ + 1/A₂)) with the holding acceleration A₁ and braking A₂, s.
    pub bound_s: f64,
    /// The same with the jerk limited, s.
    pub jerk_bound_s: f64,
    /// Largest magnitude of acceleration, m/s².
    pub peak_acceleration_m_s2: f64,
    profile: Profile,
}

impl MovePlan {
    /// The move as a trajectory. Its points are where the jerk changes, between which quintic interpolation gives the
    /// move exactly.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        let step = self.to - self.from;
        let direction = step / step.norm();
        let points = self
            .profile
            .knots
            .iter()
            .map(|knot| TrajectoryPoint {
                time_s: knot.time_s,
                position: self.from + direction * knot.distance_m,
                velocity: Some(direction * knot.speed_m_s),
                acceleration: Some(direction * knot.acceleration_m_s2),
            })
            .collect();
        Trajectory { points }
    }
}

/// Plans moves for one feeder: one tray, one courier, one kind of contact.
#[derive(Clone, Copy, Debug)]
pub struct MovePlanner {
    gentle: GentleParameters,
    tray: TrayGeometry,
    limits: CourierLimits,
    load: Load,
}

impl MovePlanner {
    /// Shortest move worth the name, m.
    const DISTANCE_M_MIN: f64 = 1e-6;

    /// A planner for a tray on a courier.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(
        gentle: GentleParameters,
        tray: TrayGeometry,
        limits: CourierLimits,
        load: Load,
    ) -> Result<Self, OutOfRange> {
        gentle.validate()?;
        limits.validate()?;
        load.validate()?;
        Ok(Self { gentle, tray, limits, load })
    }

    /// The tray that is moved.
    #[must_use]
    pub fn tray(&self) -> &TrayGeometry {
        &self.tray
    }

    /// Whether the courier may stand at `position`.
    ///
    /// # Errors
    /// The first coordinate outside its bounds.
    pub fn check_reach(&self, position: &Vector3<f64>) -> Result<(), OutOfRange> {
        let (min, max) = (self.limits.position_min(), self.limits.position_max());
        let names = ["courier_x (m)", "courier_y (m)", "courier_yaw (rad)"];
        (0..3).try_for_each(|axis| check_range(names[axis], position[axis], min[axis], max[axis]))
    }

    /// Distance from a point of the platen to the nearest place where the courier's centre may be, m.
    #[must_use]
    pub fn distance_to_reach_m(&self, point_m: &Vector2<f64>) -> f64 {
        let (min, max) = (self.limits.position_min().xy(), self.limits.position_max().xy());
        (point_m - point_m.sup(&min).inf(&max)).norm()
    }

    /// The fastest straight move between two places on the platen that holds every part of `protected_in_tray` (m).
    ///
    /// Without any part to protect, the plateau's limit μ g holds.
    ///
    /// # Errors
    /// A place out of reach, a move that turns or goes nowhere, or a part that cannot be held.
    pub fn plan(
        &self,
        from: Vector3<f64>,
        to: Vector3<f64>,
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<MovePlan, PlanError> {
        self.check_reach(&to)?;
        for axis in 0..3 {
            check_range("start of the move", from[axis], -100.0, 100.0)?;
        }
        // The yaw of a courier at rest is measured, not exact; the move takes the exact one.
        const YAW_TOLERANCE_RAD: f64 = 0.4e-3;
        let change_rad = to.z - from.z;
        if change_rad.abs() > YAW_TOLERANCE_RAD {
            return Err(PlanError::Yaw { change_rad });
        }
        let from = Vector3::new(from.x, from.y, to.z);
        let step = to - from;
        let distance_m = step.xy().norm();
        if distance_m < Self::DISTANCE_M_MIN {
            return Err(PlanError::NoDistance { distance_m });
        }
        let direction_in_tray = Rotation2::new(-to.z) * (step.xy() / distance_m);
        let held = self.held(protected_in_tray, &direction_in_tray)?;
        let braked = self.held(protected_in_tray, &-direction_in_tray)?;

        let by_motor_m_s2 = self.limits.translation_acceleration_m_s2_max(&self.load);
        let share = self.gentle.friction_share;
        let jerk_m_s3 = self.gentle.jerk_m_s3_max.min(self.limits.jerk_m_s3_max);
        let limits = LineLimits {
            speed_m_s: self.limits.speed_m_s_max,
            acceleration_m_s2: (share * held).min(by_motor_m_s2),
            braking_m_s2: (share * braked).min(by_motor_m_s2),
            jerk_m_s3,
        };
        let unlimited = LineLimits {
            speed_m_s: f64::INFINITY,
            acceleration_m_s2: held,
            braking_m_s2: braked,
            jerk_m_s3: self.gentle.jerk_m_s3_max,
        };
        let profile = Profile::new(distance_m, &limits);
        Ok(MovePlan {
            from,
            to,
            duration_s: profile.duration_s(),
            bound_s: (2.0 * distance_m * (1.0 / held + 1.0 / braked)).sqrt(),
            jerk_bound_s: Profile::new(distance_m, &unlimited).duration_s(),
            peak_acceleration_m_s2: profile.peak_acceleration_m_s2(),
            profile,
        })
    }

    /// Acceleration along a direction at which every part is held, m/s².
    fn held(&self, parts_in_tray: &[Vector2<f64>], direction_in_tray: &Vector2<f64>) -> Result<f64, PlanError> {
        let GentleParameters { friction, gravity_m_s2, .. } = self.gentle;
        // Friction that wedges a part holds it at any acceleration; a hundred g is as good as that.
        let unprotected_m_s2 = gravity_m_s2 * if parts_in_tray.is_empty() { friction } else { 100.0 };
        parts_in_tray.iter().try_fold(unprotected_m_s2, |least_m_s2, part| {
            holding_acceleration_m_s2(&self.tray, part, direction_in_tray, friction, gravity_m_s2)
                .map(|held_m_s2| held_m_s2.min(least_m_s2))
                .ok_or(PlanError::CannotHold { friction, x_m: part.x, y_m: part.y })
        })
    }
}
