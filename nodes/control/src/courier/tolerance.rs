//! How far the courier may be from where a trajectory asks for it.

use feeder_model::trajectory::Tolerances;
use nalgebra::Vector3;

use super::config::CourierConfig;
use super::rejection::Rejection;

/// Tolerances with every default filled in; infinite where there is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowed {
    pub(super) path_position: Vector3<f64>,
    pub(super) path_velocity: Vector3<f64>,
    pub(super) goal_position: Vector3<f64>,
    pub(super) goal_velocity: Vector3<f64>,
    pub(super) goal_time_s: f64,
}

/// Fills in the defaults.
///
/// # Errors
/// A tolerance that is not a number.
pub(super) fn resolve(asked: &Tolerances, config: &CourierConfig) -> Result<Allowed, Rejection> {
    let none = Vector3::repeat(f64::INFINITY);
    let (m, rad) = (config.goal_tolerance_m, config.goal_tolerance_rad);
    let goal_time_s = if asked.goal_time_s == 0.0 { config.goal_time_tolerance_s } else { asked.goal_time_s };
    if goal_time_s.is_nan() {
        return Err(Rejection::Tolerance { tolerance: "goal_time_tolerance", axis: 0, value: goal_time_s });
    }
    Ok(Allowed {
        path_position: filled("path position tolerance", &asked.path_position, &none)?,
        path_velocity: filled("path velocity tolerance", &asked.path_velocity, &none)?,
        goal_position: filled("goal position tolerance", &asked.goal_position, &Vector3::new(m, m, rad))?,
        goal_velocity: filled("goal velocity tolerance", &asked.goal_velocity, &none)?,
        // For ever is as long as a trajectory may be.
        goal_time_s: if goal_time_s < 0.0 { 600.0 } else { goal_time_s.min(600.0) },
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_asked_is_the_drivers_own_tolerance_and_less_than_nothing_is_none() {
        let config = CourierConfig::default();
        let (m, rad) = (config.goal_tolerance_m, config.goal_tolerance_rad);
        let all = Vector3::repeat;
        for (goal_time_s, position, expected) in [
            (0.0, 0.0, (config.goal_time_tolerance_s, Vector3::new(m, m, rad))),
            (0.2, 1e-3, (0.2, all(1e-3))),
            // For ever is as long as a trajectory may be.
            (-1.0, -1.0, (600.0, all(f64::INFINITY))),
            (1e9, 1.0, (600.0, all(1.0))),
        ] {
            let asked = Tolerances { goal_time_s, goal_position: all(position), ..Tolerances::default() };
            let allowed = resolve(&asked, &config).unwrap();
            assert_eq!((allowed.goal_time_s, allowed.goal_position), expected);
            // Of the way nothing is asked unless a client does.
            assert_eq!(allowed.path_position, all(f64::INFINITY));
        }
    }
}
