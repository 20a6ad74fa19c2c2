//! Planning a move in which no protected part slides.

use nalgebra::{Vector2, Vector3};

use super::leg_limits::LegLimits;
use super::legs::{Leg, Motion};
use super::plan_error::PlanError;
use super::planner::MovePlanner;
use super::profile::{LineLimits, Profile};
use crate::courier::{Trajectory, TrajectoryPoint};
use feeder_model::range::check_range;

/// A move from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct MovePlan {
    /// Where it begins: x, y (m) and yaw (rad) on the platen.
    pub from: Vector3<f64>,
    /// Where it ends.
    pub to: Vector3<f64>,
    /// The polyline it keeps to, but for its corners, m.
    pub route_m: Vec<Vector2<f64>>,
    /// How long it takes, s.
    pub duration_s: f64,
    /// What friction alone would allow on the straight way: √(2d (1/A₁ + 1/A₂)) with the holding acceleration A₁ and
    /// braking A₂, s.
    pub bound_s: f64,
    /// The same with the jerk limited, s.
    pub jerk_bound_s: f64,
    /// Largest magnitude of translational acceleration, m/s².
    pub peak_acceleration_m_s2: f64,
    points: Vec<TrajectoryPoint>,
}

impl MovePlan {
    /// The move as a trajectory. Its points are where the jerk changes, between which quintic interpolation gives the
    /// move exactly.
    #[must_use]
    pub fn trajectory(&self) -> Trajectory {
        Trajectory { points: self.points.clone() }
    }
}

impl MovePlanner {
    /// Shortest move worth the name, m along the path of the tray's rim.
    const DISTANCE_M_MIN: f64 = 1e-6;

    /// A quick estimate of how long a straight move with a part on the plateau takes, s: the jerk-limited bound at the
    /// share of friction that is used.
    #[must_use]
    pub fn estimate_s(&self, distance_m: f64) -> f64 {
        let a =
            (self.gentle.friction_share * self.gentle.friction * self.gentle.gravity_m_s2).min(self.by_motor_m_s2());
        let j = self.gentle.jerk_m_s3_max;
        if distance_m >= 2.0 * a.powi(3) / (j * j) {
            a / j + ((a / j).powi(2) + 4.0 * distance_m / a).sqrt()
        } else {
            4.0 * (distance_m / (2.0 * j)).cbrt()
        }
    }

    /// The fastest move between two places on the platen that holds every part of `protected_in_tray` (m): straight
    /// where that is clear, round the keep-out areas where not. Yaw turns evenly with the way.
    ///
    /// Without any part to protect, the plateau's limit μ g holds.
    ///
    /// # Errors
    /// A place out of reach, a way that is blocked, a move that goes nowhere, or a part that cannot be held.
    pub fn plan(
        &self,
        from: Vector3<f64>,
        to: Vector3<f64>,
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<MovePlan, PlanError> {
        self.check_reach(&to)?;
        for axis in 0..2 {
            check_range("start of the move", from[axis], -100.0, 100.0)?;
        }
        let may_stand = |corner: &Vector2<f64>| self.check_reach(&Vector3::new(corner.x, corner.y, to.z)).is_ok();
        let route_m = self.around.route(from.xy(), to.xy(), may_stand)?;
        self.plan_along(from, to, route_m, protected_in_tray)
    }

    /// As [`plan`](Self::plan), along a route that is known to be clear: a polyline from one place to the other.
    ///
    /// # Errors
    /// A place out of reach, a move that goes nowhere, or a part that cannot be held.
    pub fn plan_along(
        &self,
        from: Vector3<f64>,
        to: Vector3<f64>,
        route_m: Vec<Vector2<f64>>,
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<MovePlan, PlanError> {
        self.check_reach(&to)?;
        for axis in 0..3 {
            check_range("start of the move", from[axis], -100.0, 100.0)?;
        }
        // The yaw of a courier at rest is measured, not exact; a move that need not turn takes the exact one.
        const YAW_TOLERANCE_RAD: f64 = 0.4e-3;
        let turns = (to.z - from.z).abs() > YAW_TOLERANCE_RAD;
        let from = if turns { from } else { Vector3::new(from.x, from.y, to.z) };
        let step = to - from;
        let reach_m = step.xy().norm().max(step.z.abs() * self.tray.outer_radius_m);
        if reach_m < Self::DISTANCE_M_MIN {
            return Err(PlanError::NoDistance { distance_m: reach_m });
        }
        let legs = self.legs(&from, &to, &route_m, protected_in_tray)?;
        let motion = Motion::rounded(from, &legs, &route_m, &self.around);
        let mut points = motion.points(self.limits.speed_m_s_max);
        // The end is exactly the end, whatever rounding has left.
        if let Some(last) = points.last_mut() {
            *last = TrajectoryPoint {
                time_s: last.time_s,
                position: to,
                velocity: Some(Vector3::zeros()),
                acceleration: Some(Vector3::zeros()),
            };
        }
        let direct = self.held(&from, &step, reach_m, protected_in_tray)?;
        let slowness = 1.0 / direct.speeding_m_s2 + 1.0 / direct.braking_m_s2;
        let unlimited = LineLimits {
            speed_m_s: f64::INFINITY,
            acceleration_m_s2: direct.speeding_m_s2,
            braking_m_s2: direct.braking_m_s2,
            jerk_m_s3: self.gentle.jerk_m_s3_max,
        };
        let accelerations = points.iter().filter_map(|point| point.acceleration);
        Ok(MovePlan {
            from,
            to,
            duration_s: points.last().map_or(0.0, |last| last.time_s),
            bound_s: (2.0 * reach_m * slowness).sqrt(),
            jerk_bound_s: Profile::new(reach_m, &unlimited).duration_s(),
            peak_acceleration_m_s2: accelerations.map(|acceleration| acceleration.xy().norm()).fold(0.0, f64::max),
            route_m,
            points,
        })
    }

    /// The legs of a route, each as fast as friction holds, with room for its neighbours where they overlap.
    fn legs(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        route_m: &[Vector2<f64>],
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<Vec<Leg>, PlanError> {
        let total_m: f64 = route_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let turn_rad = to.z - from.z;
        let mut held: Vec<(Vector3<f64>, f64, LegLimits)> = Vec::new();
        let mut start = *from;
        for pair in route_m.windows(2) {
            let (way_m, count) = (pair[1] - pair[0], route_m.len() as f64 - 1.0);
            let share = if total_m > 0.0 { way_m.norm() / total_m } else { 1.0 / count };
            let step = Vector3::new(way_m.x, way_m.y, turn_rad * share);
            let length_m = way_m.norm().max(step.z.abs() * self.tray.outer_radius_m);
            held.push((step, length_m, self.held(&start, &step, length_m, protected_in_tray)?));
            start += step;
        }
        let corners: Vec<f64> = held
            .windows(2)
            .map(|pair| self.corner_share(from.z, turn_rad, &pair[0], &pair[1], protected_in_tray))
            .collect::<Result<_, _>>()?;
        let overlap = if corners.is_empty() { 1.0 } else { 0.5 };
        let jerk_m_s3 = overlap * self.gentle.jerk_m_s3_max.min(self.limits.jerk_m_s3_max);
        let legs = held.iter().enumerate().map(|(index, (step, length_m, held))| {
            let corner = |at: Option<usize>| at.and_then(|at| corners.get(at)).copied().unwrap_or(1.0);
            let usable = self.gentle.friction_share * held.left;
            let by_motor_m_s2 = self.motor_along(step, *length_m);
            let (before, after) = (corner(index.checked_sub(1)), corner(Some(index)));
            let limits = LineLimits {
                speed_m_s: held.speed_m_s,
                acceleration_m_s2: before * (usable * held.speeding_m_s2).min(by_motor_m_s2),
                braking_m_s2: after * (usable * held.braking_m_s2).min(by_motor_m_s2),
                jerk_m_s3,
            };
            Leg { step: *step, length_m: *length_m, profile: Profile::new(*length_m, &limits) }
        });
        Ok(legs.collect())
    }
}
