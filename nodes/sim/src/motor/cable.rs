//! Friction within the cables and hoses: a pull that depends on where the courier came from.

use nalgebra::Vector3;

use super::MotorParameters;
use feeder_model::motor::Wrench;

/// A spring on each axis that slips where it has yielded, as Coulomb friction behind an elastic cable does.
#[derive(Clone, Debug)]
pub(super) struct Cable {
    /// Where the springs are fixed.
    anchor: Vector3<f64>,
}

impl Cable {
    /// Cables without tension on a courier at `position`.
    pub(super) fn at_rest(position: Vector3<f64>) -> Self {
        Self { anchor: position }
    }

    /// The pull on a courier that has come to `position`.
    pub(super) fn pull(&mut self, position: &Vector3<f64>, parameters: &MotorParameters) -> Wrench {
        let MotorParameters { cable_friction_n, cable_friction_n_m, cable_travel_m, cable_travel_rad, .. } =
            *parameters;
        let friction = Vector3::new(cable_friction_n, cable_friction_n, cable_friction_n_m);
        let travel = Vector3::new(cable_travel_m, cable_travel_m, cable_travel_rad);
        self.anchor = self.anchor.sup(&(position - travel)).inf(&(position + travel));
        (self.anchor - position).component_div(&travel).component_mul(&friction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_pull_has_a_hysteresis_of_its_own_friction() {
        let parameters = MotorParameters { cable_friction_n: 0.5, cable_travel_m: 1e-3, ..MotorParameters::IDEAL };
        let mut cable = Cable::at_rest(Vector3::zeros());
        let mut pull_n = |x_m: f64| cable.pull(&Vector3::new(x_m, 0.0, 0.0), &parameters).x;
        // Out, past the yield, and back by twice the travel: the pull has turned round.
        for (x_m, expected_n) in [(0.5e-3, -0.25), (1e-3, -0.5), (5e-3, -0.5), (4e-3, 0.0), (3e-3, 0.5), (0.0, 0.5)] {
            assert!((pull_n(x_m) - expected_n).abs() < 1e-12, "{x_m}");
        }
    }
}
