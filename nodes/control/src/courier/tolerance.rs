//! How far the courier may be from where a trajectory asks for it.

use nalgebra::Vector3;

use super::config::CourierConfig;
use super::rejection::Rejection;

/// Tolerances of a goal as `ros2_control` understands them: for each axis 0 stands for the driver's default, a negative
/// number for none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerances {
    /// While the trajectory is followed: distance from the set point, m and rad. There is none by default, beyond what
    /// the driver faults at.
    pub path_position: Vector3<f64>,
    /// While the trajectory is followed: velocity from the set point's, m/s and rad/s. There is none by default.
    pub path_velocity: Vector3<f64>,
    /// At the end: distance from the goal, m and rad.
    pub goal_position: Vector3<f64>,
    /// At the end: velocity, m/s and rad/s. There is none by default.
    pub goal_velocity: Vector3<f64>,
    /// Time after the end within which the goal must be reached, s.
    pub goal_time_s: f64,
}

/// Tolerances with every default filled in; infinite where there is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowed {
    pub(super) path_position: Vector3<f64>,
    pub(super) path_velocity: Vector3<f64>,
    pub(super) goal_position: Vector3<f64>,
    pub(super) goal_velocity: Vector3<f64>,
    pub(super) goal_time_s: f64,
}

impl Tolerances {
    /// Fills in the defaults.
    ///
    /// # Errors
    /// A tolerance that is not a number.
    pub(super) fn resolve(&self, config: &CourierConfig) -> Result<Allowed, Rejection> {
        let none = Vector3::repeat(f64::INFINITY);
        let (m, rad) = (config.goal_tolerance_m, config.goal_tolerance_rad);
        let goal_time_s = if self.goal_time_s == 0.0 { config.goal_time_tolerance_s } else { self.goal_time_s };
        if goal_time_s.is_nan() {
            return Err(Rejection::Tolerance { tolerance: "goal_time_tolerance", axis: 0, value: goal_time_s });
        }
        Ok(Allowed {
            path_position: filled("path position tolerance", &self.path_position, &none)?,
            path_velocity: filled("path velocity tolerance", &self.path_velocity, &none)?,
            goal_position: filled("goal position tolerance", &self.goal_position, &Vector3::new(m, m, rad))?,
            goal_velocity: filled("goal velocity tolerance", &self.goal_velocity, &none)?,
            // For ever is as long as a trajectory may be.
            goal_time_s: if goal_time_s < 0.0 { 600.0 } else { goal_time_s.min(600.0) },
        })
    }
}

fn filled(tolerance: &'static str, asked: &Vector3<f64>, default: &Vector3<f64>) -> Result<Vector3<f64>, Rejection> {
    if let Some(axis) = (0..3).find(|&axis| asked[axis].is_nan()) {
        return Err(Rejection::Tolerance { tolerance, axis, value: asked[axis] });
    }
    Ok(asked.zip_map(default, |asked, default| match asked {
        0.0 => default,
        asked if asked < 0.0 => f64::INFINITY,
        asked => asked,
    }))
}

/// The first axis on which an error is larger than allowed.
pub(super) fn violation(error: &Vector3<f64>, allowed: &Vector3<f64>) -> Option<usize> {
    (0..3).find(|&axis| error[axis].abs() > allowed[axis])
}
