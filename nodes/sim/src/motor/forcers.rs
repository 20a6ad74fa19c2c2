//! The four forcers: who gives which share of a force, how much at most, and how evenly.

use std::f64::consts::TAU;

use nalgebra::{Vector3, Vector4};

use crate::motor::MotorParameters;
use feeder_model::motor::Wrench;

/// Shares a wrench among the forcers, with the smallest sum of squares: N along x, x, y, y.
pub(super) fn allocate(wrench: Wrench, arm_m: f64) -> Vector4<f64> {
    let (x_n, y_n, turn_n) = (0.5 * wrench.x, 0.5 * wrench.y, 0.25 * wrench.z / arm_m);
    // A force along x at y = −arm turns to the left, one along y at x = +arm as well.
    Vector4::new(x_n + turn_n, x_n - turn_n, y_n + turn_n, y_n - turn_n)
}

/// The wrench that forces give together.
pub(super) fn combine(forces_n: Vector4<f64>, arm_m: f64) -> Wrench {
    let [x1, x2, y1, y2] = forces_n.into();
    Wrench::new(x1 + x2, y1 + y2, arm_m * (x1 - x2 + y1 - y2))
}

/// Cuts each force to what its forcer gives at most.
pub(super) fn saturate(forces_n: Vector4<f64>, force_n_max: f64) -> Vector4<f64> {
    forces_n.map(|force_n| force_n.clamp(-force_n_max, force_n_max))
}

/// What the iron gives of a force within the peak.
pub(super) fn lose(forces_n: Vector4<f64>, parameters: &MotorParameters) -> Vector4<f64> {
    let MotorParameters { force_loss_at_peak, forcer_force_n_max, .. } = *parameters;
    forces_n.map(|force_n| force_n * (1.0 - force_loss_at_peak * (force_n / forcer_force_n_max).powi(2)))
}

/// What is given where the courier is at `position`, for what was meant: each forcer ripples with its own travel.
pub(super) fn ripple(forces_n: Vector4<f64>, position: &Vector3<f64>, parameters: &MotorParameters) -> Vector4<f64> {
    if parameters.ripple == 0.0 {
        return forces_n;
    }
    let turn_m = parameters.forcer_arm_m * position.z;
    let travel_m = Vector4::new(position.x + turn_m, position.x - turn_m, position.y + turn_m, position.y - turn_m);
    let phase_rad = travel_m * (TAU / parameters.tooth_pitch_m) + Vector4::from(parameters.ripple_phase_rad);
    forces_n.component_mul(&phase_rad.map(|phase_rad| 1.0 + parameters.ripple * phase_rad.sin()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_shared_out_adds_up(x in -30.0..30.0, y in -30.0..30.0, turn in -2.7..2.7, arm_m in 0.01..0.2) {
            let wrench = Wrench::new(x, y, turn);
            let back = combine(allocate(wrench, arm_m), arm_m);
            prop_assert!((back - wrench).norm() < 1e-12 * (1.0 + wrench.norm() / arm_m));
        }
    }

    #[test]
    fn force_and_torque_compete_for_the_same_forcers() {
        // 15 N a forcer at 45 mm: all of the force along x leaves no torque to the forcers along x.
        let both = saturate(allocate(Wrench::new(30.0, 0.0, 2.7), 0.045), 15.0);
        let given = combine(both, 0.045);
        assert!((given.x - 15.0).abs() < 1e-12 && (given.z - 2.025).abs() < 1e-12, "{given}");
    }
}
