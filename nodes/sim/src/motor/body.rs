//! A rigid body with drag under lagging force, discretised exactly.

use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, Vector3};

use crate::motor::MotorParameters;
use feeder_model::motor::Load;
use feeder_model::motor::Wrench;

/// Position, velocity, and the force that is given.
pub(super) type BodyState = SVector<f64, 9>;

/// What a stretch of time does to the state, with the force aimed at and another wrench held constant.
#[derive(Clone, Debug)]
struct Step {
    duration_s: f64,
    state: SMatrix<f64, 9, 9>,
    target: SMatrix<f64, 9, 3>,
    wrench: SMatrix<f64, 9, 3>,
}

/// The linear part of the plant: ẋ = v, M v̇ = f + w − D v, τ ḟ = target − f.
///
/// Between two commands target and w are constant, so the matrix exponential is exact. The centripetal term of an offset
/// centre of mass (ω² ρ < 10⁻³ m/s² here) is left out.
#[derive(Clone, Debug)]
pub(super) struct Body {
    acceleration_from_force: Matrix3<f64>,
    drag: Vector3<f64>,
    lag_s: f64,
    /// Stretches met so far: with a constant delay and servo period there are two.
    steps: Vec<Step>,
}

impl Body {
    /// Stretches remembered; a changing latency makes new ones all the time.
    const STEPS_MAX: usize = 8;

    pub(super) fn new(parameters: &MotorParameters, load: &Load) -> Self {
        Self {
            acceleration_from_force: acceleration_from_force(parameters, load),
            drag: Vector3::new(parameters.drag_n_s_m, parameters.drag_n_s_m, parameters.drag_n_m_s_rad),
            lag_s: parameters.lag_s,
            steps: Vec::new(),
        }
    }

    /// Moves on by `duration_s` with the force tending to `target` and `wrench` acting besides.
    pub(super) fn advance(&mut self, state: &mut BodyState, target: Wrench, wrench: Wrench, duration_s: f64) {
        if duration_s <= 0.0 {
            return;
        }
        if self.lag_s <= 0.0 {
            state.fixed_rows_mut::<3>(6).copy_from(&target);
        }
        let known = self.steps.iter().position(|step| step.duration_s.to_bits() == duration_s.to_bits());
        let index = known.unwrap_or_else(|| {
            if self.steps.len() >= Self::STEPS_MAX {
                self.steps.remove(0);
            }
            self.steps.push(self.discretise(duration_s));
            self.steps.len() - 1
        });
        let step = &self.steps[index];
        *state = step.state * *state + step.target * target + step.wrench * wrench;
    }

    fn discretise(&self, duration_s: f64) -> Step {
        let inverse_mass = self.acceleration_from_force;
        let mut rates = DMatrix::zeros(15, 15);
        rates.view_mut((0, 3), (3, 3)).fill_with_identity();
        rates.view_mut((3, 3), (3, 3)).copy_from(&(-inverse_mass * Matrix3::from_diagonal(&self.drag)));
        rates.view_mut((3, 6), (3, 3)).copy_from(&inverse_mass);
        rates.view_mut((3, 12), (3, 3)).copy_from(&inverse_mass);
        if self.lag_s > 0.0 {
            rates.view_mut((6, 6), (3, 3)).fill_diagonal(-1.0 / self.lag_s);
            rates.view_mut((6, 9), (3, 3)).fill_diagonal(1.0 / self.lag_s);
        }
        let exponential = (rates * duration_s).exp();
        Step {
            duration_s,
            state: exponential.fixed_view::<9, 9>(0, 0).into(),
            target: exponential.fixed_view::<9, 3>(0, 9).into(),
            wrench: exponential.fixed_view::<9, 3>(0, 12).into(),
        }
    }
}

/// Inverse of the mass matrix about the courier's centre for a centre of mass at an offset from it.
fn acceleration_from_force(parameters: &MotorParameters, load: &Load) -> Matrix3<f64> {
    let [x_m, y_m] = parameters.center_of_mass_offset_m;
    let own_kg = parameters.mass_kg;
    let mass_kg = own_kg + load.mass_kg;
    let (first_x, first_y) = (own_kg * x_m, own_kg * y_m);
    // The mass matrix is [[m, 0, -s_y], [0, m, s_x], [-s_y, s_x, I]] with first moments s and I about the centre.
    let inertia_kg_m2 = parameters.inertia_kg_m2 + own_kg * (x_m * x_m + y_m * y_m) + load.inertia_kg_m2;
    let reduced_kg_m2 = inertia_kg_m2 - (first_x * first_x + first_y * first_y) / mass_kg;
    let (lever_x, lever_y) = (first_x / mass_kg, first_y / mass_kg);
    Matrix3::new(
        1.0 / mass_kg + lever_y * lever_y / reduced_kg_m2,
        -lever_x * lever_y / reduced_kg_m2,
        lever_y / reduced_kg_m2,
        -lever_x * lever_y / reduced_kg_m2,
        1.0 / mass_kg + lever_x * lever_x / reduced_kg_m2,
        -lever_x / reduced_kg_m2,
        lever_y / reduced_kg_m2,
        -lever_x / reduced_kg_m2,
        1.0 / reduced_kg_m2,
    )
}
