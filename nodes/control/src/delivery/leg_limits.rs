//! What friction and motor allow along the legs of a move.

use nalgebra::{Rotation2, Vector2, Vector3};

use super::gentle::GentleParameters;
use super::holding::holding_acceleration_m_s2;
use super::plan_error::PlanError;
use super::planner::MovePlanner;

/// What friction, motor and vibration-free tracking allow along a straight leg, in terms of its length.
#[derive(Clone, Copy, Debug)]
pub(super) struct LegLimits {
    /// Acceleration along the leg at which every part is held, m/s².
    pub(super) speeding_m_s2: f64,
    /// The same for braking.
    pub(super) braking_m_s2: f64,
    /// Speed along the leg that leaves at least half of the friction beside the centripetal acceleration, m/s.
    pub(super) speed_m_s: f64,
    /// Share of the friction that the centripetal acceleration leaves.
    pub(super) left: f64,
}

impl MovePlanner {
    /// Share of their own limits that two legs may use while one brakes and the other speeds up.
    ///
    /// What friction holds is a convex set of accelerations (a second-order cone for each part), so their sum is held
    /// whatever the mix, if it is held at the full limits of both; half of each always is.
    pub(super) fn corner_share(
        &self,
        yaw_rad: f64,
        turn_rad: f64,
        before: &(Vector3<f64>, f64, LegLimits),
        after: &(Vector3<f64>, f64, LegLimits),
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<f64, PlanError> {
        if turn_rad.abs() > 0.0 {
            return Ok(0.5);
        }
        let along = |(step, length_m, _): &(Vector3<f64>, f64, LegLimits)| step.xy() / *length_m;
        let motor_m_s2 = self.by_motor_m_s2();
        let sum = along(after) * after.2.speeding_m_s2.min(motor_m_s2)
            - along(before) * before.2.braking_m_s2.min(motor_m_s2);
        let norm = sum.norm();
        if norm <= 0.0 {
            return Ok(1.0);
        }
        let direction_in_tray = Rotation2::new(-yaw_rad) * (sum / norm);
        let held_m_s2 = self.weakest(protected_in_tray, |_| direction_in_tray)?.min(motor_m_s2);
        Ok((held_m_s2 / norm).clamp(0.5, 1.0))
    }

    /// What friction holds along a leg from `start` by `step`, in terms of a length that is `length_m` at its end.
    pub(super) fn held(
        &self,
        start: &Vector3<f64>,
        step: &Vector3<f64>,
        length_m: f64,
        protected_in_tray: &[Vector2<f64>],
    ) -> Result<LegLimits, PlanError> {
        let turns = step.z.abs() > 0.0;
        let mut held = LegLimits {
            speeding_m_s2: f64::INFINITY,
            braking_m_s2: f64::INFINITY,
            speed_m_s: self.limits.speed_m_s_max,
            left: 1.0,
        };
        // The direction in the tray changes with the yaw, by 4° at most.
        let yaws: &[f64] = if turns { &[0.0, 0.5, 1.0] } else { &[0.0] };
        for share in yaws {
            let way_in_tray = Rotation2::new(-(start.z + step.z * share)) * step.xy();
            let along = |part: &Vector2<f64>| (way_in_tray + step.z * Vector2::new(-part.y, part.x)) / length_m;
            held.speeding_m_s2 = held.speeding_m_s2.min(self.weakest(protected_in_tray, along)?);
            held.braking_m_s2 = held.braking_m_s2.min(self.weakest(protected_in_tray, |part| -along(part))?);
        }
        if turns {
            let farthest_m = protected_in_tray.iter().map(Vector2::norm).fold(0.0, f64::max);
            let mut weakest_m_s2 = f64::INFINITY;
            for index in 0..16_u32 {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(index) / 16.0).sin_cos();
                weakest_m_s2 = weakest_m_s2.min(self.weakest(protected_in_tray, |_| Vector2::new(cos, sin))?);
            }
            // Speed² at the end of unlimited speeding up: the largest there can be.
            let bang_bang = 2.0 * length_m / (1.0 / held.speeding_m_s2 + 1.0 / held.braking_m_s2);
            let centripetal_per_speed2 = (step.z / length_m).powi(2) * farthest_m;
            let half = 0.5 * weakest_m_s2 / centripetal_per_speed2;
            held.speed_m_s = held.speed_m_s.min(half.sqrt());
            // The held set is convex: a share of the direction's limit and the rest of the weakest one are held together.
            held.left = 1.0 - (bang_bang.min(half) * centripetal_per_speed2 / weakest_m_s2).min(0.5);
        }
        Ok(held)
    }

    /// Acceleration at which every part is held that is accelerated by `along(part)` times it, m/s².
    fn weakest(
        &self,
        parts_in_tray: &[Vector2<f64>],
        along: impl Fn(&Vector2<f64>) -> Vector2<f64>,
    ) -> Result<f64, PlanError> {
        let GentleParameters { friction, gravity_m_s2, .. } = self.gentle;
        // Friction that wedges a part holds it at any acceleration; a hundred g is as good as that.
        let wedged_m_s2 = 100.0 * gravity_m_s2;
        if parts_in_tray.is_empty() {
            let norm = along(&Vector2::zeros()).norm();
            return Ok(if norm > 0.0 { (gravity_m_s2 * friction / norm).min(wedged_m_s2) } else { wedged_m_s2 });
        }
        parts_in_tray.iter().try_fold(wedged_m_s2, |least_m_s2, part| {
            let vector = along(part);
            let norm = vector.norm();
            if norm <= 0.0 {
                return Ok(least_m_s2);
            }
            holding_acceleration_m_s2(&self.tray, part, &(vector / norm), friction, gravity_m_s2)
                .map(|held_m_s2| (held_m_s2 / norm).min(least_m_s2))
                .ok_or(PlanError::CannotHold { friction, x_m: part.x, y_m: part.y })
        })
    }

    pub(super) fn by_motor_m_s2(&self) -> f64 {
        self.limits.translation_acceleration_m_s2_max(&self.load)
    }

    /// What the motor can do along a leg: force for the way, torque for the turn, m/s².
    pub(super) fn motor_along(&self, step: &Vector3<f64>, length_m: f64) -> f64 {
        let torque_n_m = (1.0 - self.limits.feedback_reserve) * self.limits.torque_n_m_max;
        let turning_rad_s2 = torque_n_m / self.limits.moved(&self.load).z;
        let along = |limit: f64, share: f64| if share > 0.0 { limit * length_m / share } else { f64::INFINITY };
        along(self.by_motor_m_s2(), step.xy().norm()).min(along(turning_rad_s2, step.z.abs()))
    }
}
