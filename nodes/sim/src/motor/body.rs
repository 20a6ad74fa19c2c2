//! A courier with drag under lagging force, and a tray that may twist on it, discretised exactly.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, Vector3};

use crate::motor::MotorParameters;
use feeder_model::motor::Load;
use feeder_model::motor::Wrench;

/// Size of the state.
const STATE: usize = 11;

/// Position and velocity of the courier, the force that is given, and the angle and rate by which the tray is ahead of the
/// courier in yaw.
pub(super) type BodyState = SVector<f64, STATE>;

/// What a stretch of time does to the state, with the force aimed at and another wrench held constant.
#[derive(Clone, Debug)]
struct Step {
    duration_s: f64,
    state: SMatrix<f64, STATE, STATE>,
    target: SMatrix<f64, STATE, 3>,
    wrench: SMatrix<f64, STATE, 3>,
    tray_torque: SVector<f64, STATE>,
}

/// The mounting of a tray that is not rigid.
#[derive(Clone, Copy, Debug)]
struct Mounting {
    stiffness_n_m_rad: f64,
    damping_n_m_s_rad: f64,
    /// Of tray and load.
    inertia_kg_m2: f64,
}

impl Mounting {
    /// Two inertias a and b on a spring k swing against each other at ω² = k (1/a + 1/b).
    fn new(parameters: &MotorParameters, load: &Load) -> Option<Self> {
        let MotorParameters { inertia_kg_m2, tray_inertia_share: share, tray_mode_hz, tray_mode_damping, .. } =
            *parameters;
        let omega_rad_s = TAU * tray_mode_hz;
        let reduced_kg_m2 = inertia_kg_m2 * share * (1.0 - share);
        (share > 0.0).then_some(Self {
            stiffness_n_m_rad: reduced_kg_m2 * omega_rad_s * omega_rad_s,
            damping_n_m_s_rad: 2.0 * tray_mode_damping * reduced_kg_m2 * omega_rad_s,
            inertia_kg_m2: inertia_kg_m2 * share + load.inertia_kg_m2,
        })
    }
}

/// The linear part of the plant: ẋ = v, M v̇ = f + w − D v + t, τ ḟ = target − f, and for a tray that twists by θ against
/// the courier under a torque u of its own: t = k θ + c θ̇, J θ̈ = u − t − J v̇_yaw.
///
/// Between two commands target and w are constant, so the matrix exponential is exact. The centripetal term of an offset
/// centre of mass (ω² ρ < 10⁻³ m/s² here) is left out.
#[derive(Clone, Debug)]
pub(super) struct Body {
    acceleration_from_force: Matrix3<f64>,
    drag: Vector3<f64>,
    lag_s: f64,
    mounting: Option<Mounting>,
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
            mounting: Mounting::new(parameters, load),
            steps: Vec::new(),
        }
    }

    /// Moves on by `duration_s` with the force tending to `target`, `wrench` acting on the courier besides, and `on_tray` on
    /// the tray.
    pub(super) fn advance(
        &mut self,
        state: &mut BodyState,
        target: Wrench,
        wrench: Wrench,
        on_tray: Wrench,
        duration_s: f64,
    ) {
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
        // Only in yaw is the tray not one with the courier.
        let (wrench, tray_torque_n_m) = match self.mounting {
            Some(_) => (wrench + Wrench::new(on_tray.x, on_tray.y, 0.0), on_tray.z),
            None => (wrench + on_tray, 0.0),
        };
        *state = step.state * *state + step.target * target + step.wrench * wrench;
        if self.mounting.is_some() {
            *state += step.tray_torque * tray_torque_n_m;
        }
    }

    fn discretise(&self, duration_s: f64) -> Step {
        let inverse_mass = self.acceleration_from_force;
        // Columns of the inputs, after those of the state.
        const TARGET: usize = STATE;
        const WRENCH: usize = STATE + 3;
        const TRAY: usize = STATE + 6;
        let mut rates = DMatrix::zeros(TRAY + 1, TRAY + 1);
        rates.view_mut((0, 3), (3, 3)).fill_with_identity();
        rates.view_mut((3, 3), (3, 3)).copy_from(&(-inverse_mass * Matrix3::from_diagonal(&self.drag)));
        rates.view_mut((3, 6), (3, 3)).copy_from(&inverse_mass);
        rates.view_mut((3, WRENCH), (3, 3)).copy_from(&inverse_mass);
        if self.lag_s > 0.0 {
            rates.view_mut((6, 6), (3, 3)).fill_diagonal(-1.0 / self.lag_s);
            rates.view_mut((6, TARGET), (3, 3)).fill_diagonal(1.0 / self.lag_s);
        }
        if let Some(Mounting { stiffness_n_m_rad, damping_n_m_s_rad, inertia_kg_m2 }) = self.mounting {
            rates.view_mut((3, 9), (3, 1)).copy_from(&(inverse_mass.column(2) * stiffness_n_m_rad));
            rates.view_mut((3, 10), (3, 1)).copy_from(&(inverse_mass.column(2) * damping_n_m_s_rad));
            rates[(9, 10)] = 1.0;
            let yaw = -rates.row(5).clone_owned();
            rates.row_mut(10).copy_from(&yaw);
            rates[(10, 9)] -= stiffness_n_m_rad / inertia_kg_m2;
            rates[(10, 10)] -= damping_n_m_s_rad / inertia_kg_m2;
            rates[(10, TRAY)] += 1.0 / inertia_kg_m2;
        }
        let exponential = (rates * duration_s).exp();
        Step {
            duration_s,
            state: exponential.fixed_view::<STATE, STATE>(0, 0).into(),
            target: exponential.fixed_view::<STATE, 3>(0, TARGET).into(),
            wrench: exponential.fixed_view::<STATE, 3>(0, WRENCH).into(),
            tray_torque: exponential.fixed_view::<STATE, 1>(0, TRAY).into(),
        }
    }
}

/// Inverse of the mass matrix about the courier's centre for a centre of mass at an offset from it. What sits behind a
/// mounting that twists counts as mass, and not as inertia.
fn acceleration_from_force(parameters: &MotorParameters, load: &Load) -> Matrix3<f64> {
    let [x_m, y_m] = parameters.center_of_mass_offset_m;
    let own_kg = parameters.mass_kg;
    let mass_kg = own_kg + load.mass_kg;
    let (first_x, first_y) = (own_kg * x_m, own_kg * y_m);
    // The mass matrix is [[m, 0, -s_y], [0, m, s_x], [-s_y, s_x, I]] with first moments s and I about the centre.
    let on_tray_kg_m2 = Mounting::new(parameters, load).map_or(0.0, |mounting| mounting.inertia_kg_m2);
    let inertia_kg_m2 =
        parameters.inertia_kg_m2 + own_kg * (x_m * x_m + y_m * y_m) + load.inertia_kg_m2 - on_tray_kg_m2;
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
