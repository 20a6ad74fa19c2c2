//! What the driver drives: the motor, or a model of it.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::limits::{Load, check_range};
use crate::range::OutOfRange;

/// Force along x and y (N) and torque about z (N m).
pub type Wrench = Vector3<f64>;

/// The hardware side of the servo loop.
pub trait Plant {
    /// Applies `command` for `duration_s`, the time to the next servo tick.
    fn step(&mut self, command: Wrench, duration_s: f64);

    /// Reads the position sensor: x, y (m) and yaw (rad). Called once a servo tick.
    fn measure(&mut self) -> Vector3<f64>;

    /// Position and velocity now: the truth in a simulation, the best estimate on hardware.
    fn motion(&self) -> (Vector3<f64>, Vector3<f64>);
}

/// A rigid courier with idealised forcers. Nothing of this is published for the paper's motor: every value is assumed.
///
/// [`Self::IDEAL`] follows any command inside the envelope exactly; [`Self::ASSUMED`] has the imperfections by which
/// plain feedback fails to feed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlantParameters {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the courier's centre of mass, kg m².
    pub inertia_kg_m2: f64,
    /// Offset of the centre of mass from the courier's centre along x and y, m. Yaw is too small to turn it.
    pub center_of_mass_offset_m: [f64; 2],
    /// Force at which the forcers saturate, along x and along y, N.
    pub force_n_max: f64,
    /// Torque at which they saturate, N m. Its ratio to the force is the lever arm that scales yaw to tooth travel and
    /// sensor noise to yaw noise.
    pub torque_n_m_max: f64,
    /// Time from a command to its first effect, s.
    pub delay_s: f64,
    /// Time constant of the force's first-order response, s; 0 for none.
    pub lag_s: f64,
    /// Force ripple relative to the force, once a tooth pitch.
    pub ripple: f64,
    /// Tooth pitch of the platen, m.
    pub tooth_pitch_m: f64,
    /// Noise of the position sensor, m rms.
    pub sensor_noise_m_rms: f64,
    /// Resolution of the position sensor, m; 0 for none.
    pub sensor_resolution_m: f64,
}

impl PlantParameters {
    /// A rigid body under exact, immediate force with an exact sensor.
    pub const IDEAL: Self = Self {
        mass_kg: 1.2,
        inertia_kg_m2: 0.005,
        center_of_mass_offset_m: [0.0, 0.0],
        force_n_max: 30.0,
        torque_n_m_max: 2.7,
        delay_s: 0.0,
        lag_s: 0.0,
        ripple: 0.0,
        tooth_pitch_m: 1.016e-3,
        sensor_noise_m_rms: 0.0,
        sensor_resolution_m: 0.0,
    };

    /// The assumed imperfections: 0.5 ms of delay and of lag, 5 % ripple, 0.2 µm of noise and of resolution.
    pub const ASSUMED: Self = Self {
        delay_s: 0.5e-3,
        lag_s: 0.5e-3,
        ripple: 0.05,
        sensor_noise_m_rms: 0.2e-6,
        sensor_resolution_m: 0.2e-6,
        ..Self::IDEAL
    };

    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_range("plant.mass_kg", self.mass_kg, 1e-2, 100.0)?;
        check_range("plant.inertia_kg_m2", self.inertia_kg_m2, 1e-6, 10.0)?;
        for offset_m in self.center_of_mass_offset_m {
            check_range("plant.center_of_mass_offset_m", offset_m, -0.05, 0.05)?;
        }
        check_range("plant.force_n_max", self.force_n_max, 1e-3, 1e3)?;
        check_range("plant.torque_n_m_max", self.torque_n_m_max, 1e-4, 1e3)?;
        check_range("plant.delay_s", self.delay_s, 0.0, 0.02)?;
        check_range("plant.lag_s", self.lag_s, 0.0, 0.02)?;
        check_range("plant.ripple", self.ripple, 0.0, 0.5)?;
        check_range("plant.tooth_pitch_m", self.tooth_pitch_m, 1e-5, 0.1)?;
        check_range("plant.sensor_noise_m_rms", self.sensor_noise_m_rms, 0.0, 1e-3)?;
        check_range("plant.sensor_resolution_m", self.sensor_resolution_m, 0.0, 1e-3)
    }

    fn lever_arm_m(&self) -> f64 {
        self.torque_n_m_max / self.force_n_max
    }
}

impl Default for PlantParameters {
    fn default() -> Self {
        Self::IDEAL
    }
}

/// A planar rigid body driven by saturating forcers, integrated exactly between servo ticks.
///
/// Within a tick the commanded force is constant and its response exponential, so position and velocity have closed
/// forms; a delay that is no whole number of ticks splits the tick. Ripple is taken at the position at which a stretch of
/// constant command begins, and the centripetal term of an offset centre of mass (ω² ρ < 10⁻³ m/s² here) is left out.
#[derive(Clone, Debug)]
pub struct SimulatedPlant {
    parameters: PlantParameters,
    acceleration_from_force: Matrix3<f64>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// Command now at the forcers, and the force they give.
    command: Wrench,
    force: Wrench,
    /// Commands under way with the time until they arrive, s.
    pending: VecDeque<(f64, Wrench)>,
    noise: Pcg64Mcg,
}

impl SimulatedPlant {
    /// A plant at rest at `position` (x, y in m, yaw in rad), whose sensor noise is drawn from `seed`.
    ///
    /// # Errors
    /// A parameter out of its range.
    pub fn new(parameters: PlantParameters, position: Vector3<f64>, seed: u64) -> Result<Self, OutOfRange> {
        parameters.validate()?;
        Ok(Self {
            parameters,
            acceleration_from_force: acceleration_from_force(&parameters, &Load::default()),
            position,
            velocity: Vector3::zeros(),
            command: Wrench::zeros(),
            force: Wrench::zeros(),
            pending: VecDeque::new(),
            noise: Pcg64Mcg::seed_from_u64(seed),
        })
    }

    /// Puts a load on the tray, its centre of mass at the tray's centre.
    pub fn set_load(&mut self, load: &Load) {
        self.acceleration_from_force = acceleration_from_force(&self.parameters, load);
    }

    /// Moves on by `duration_s` under the command at the forcers.
    fn advance(&mut self, duration_s: f64) {
        let lever_arm_m = self.parameters.lever_arm_m();
        let travel_m = self.position.component_mul(&Vector3::new(1.0, 1.0, lever_arm_m));
        let ripple = travel_m.map(|m| 1.0 + self.parameters.ripple * (TAU * m / self.parameters.tooth_pitch_m).sin());
        let target = self.command.component_mul(&ripple);
        let mut impulse = target * duration_s;
        let mut double_impulse = target * (0.5 * duration_s * duration_s);
        let lag_s = self.parameters.lag_s;
        if lag_s > 0.0 {
            let remaining = (-duration_s / lag_s).exp();
            let excess = self.force - target;
            impulse += excess * (lag_s * (1.0 - remaining));
            double_impulse += excess * (lag_s * (duration_s - lag_s * (1.0 - remaining)));
            self.force = target + excess * remaining;
        } else {
            self.force = target;
        }
        self.position += self.velocity * duration_s + self.acceleration_from_force * double_impulse;
        self.velocity += self.acceleration_from_force * impulse;
    }
}

impl Plant for SimulatedPlant {
    fn step(&mut self, command: Wrench, duration_s: f64) {
        let PlantParameters { force_n_max, torque_n_m_max, delay_s, .. } = self.parameters;
        let peak = Vector3::new(force_n_max, force_n_max, torque_n_m_max);
        self.pending.push_back((delay_s, command.sup(&-peak).inf(&peak)));
        let mut now_s = 0.0;
        while let Some(&(arrival_s, arriving)) = self.pending.front() {
            if arrival_s >= duration_s {
                break;
            }
            self.advance(arrival_s - now_s);
            now_s = arrival_s;
            self.command = arriving;
            self.pending.pop_front();
        }
        self.advance(duration_s - now_s);
        for (arrival_s, _) in &mut self.pending {
            *arrival_s = (*arrival_s - duration_s).max(0.0);
        }
    }

    fn measure(&mut self) -> Vector3<f64> {
        let lever_arm_m = self.parameters.lever_arm_m();
        let (noise_m, resolution_m) = (self.parameters.sensor_noise_m_rms, self.parameters.sensor_resolution_m);
        let mut measured = self.position;
        for (axis, scale) in [1.0, 1.0, 1.0 / lever_arm_m].into_iter().enumerate() {
            if noise_m > 0.0 {
                let draw: f64 = StandardNormal.sample(&mut self.noise);
                measured[axis] += draw * noise_m * scale;
            }
            if resolution_m > 0.0 {
                let step = resolution_m * scale;
                measured[axis] = (measured[axis] / step).round() * step;
            }
        }
        measured
    }

    fn motion(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.position, self.velocity)
    }
}

/// Inverse of the mass matrix about the courier's centre for a centre of mass at an offset from it.
fn acceleration_from_force(parameters: &PlantParameters, load: &Load) -> Matrix3<f64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_S: f64 = 0.5e-3;

    fn plant(parameters: PlantParameters) -> SimulatedPlant {
        SimulatedPlant::new(parameters, Vector3::zeros(), 1).unwrap()
    }

    #[test]
    fn verif_constant_force_moves_by_half_a_t_squared() {
        let mut plant = plant(PlantParameters::IDEAL);
        for _ in 0..200 {
            plant.step(Wrench::new(2.4, 0.0, 0.01), TICK_S);
        }
        // a = F/m = 2 m/s², α = 2 rad/s², t = 0.1 s. 200 additions leave rounding only.
        let (position, velocity) = plant.motion();
        assert!((position - Vector3::new(0.01, 0.0, 0.01)).norm() < 1e-15);
        assert!((velocity - Vector3::new(0.2, 0.0, 0.2)).norm() < 1e-14);
    }

    #[test]
    fn verif_delay_and_lag_shift_the_motion_by_their_sum() {
        // A step of force through delay d and lag τ tends to v = a (t - d - τ); after 20 ms exp(-t/τ) is below 1e-15.
        let parameters = PlantParameters { delay_s: 0.7e-3, lag_s: 0.5e-3, ..PlantParameters::IDEAL };
        let mut plant = plant(parameters);
        for _ in 0..40 {
            plant.step(Wrench::new(1.2, 0.0, 0.0), TICK_S);
        }
        let (_, velocity) = plant.motion();
        assert!((velocity.x - (0.020 - 0.0012)).abs() < 1e-14, "{}", velocity.x);
    }

    #[test]
    fn verif_pushing_off_the_center_of_mass_turns_the_courier() {
        // Free body: the centre of mass moves by F/m whatever the offset, and the body turns by F ρ_y / I about it.
        let parameters = PlantParameters { center_of_mass_offset_m: [0.0, 0.003], ..PlantParameters::IDEAL };
        let mut plant = plant(parameters);
        plant.step(Wrench::new(6.0, 0.0, 0.0), TICK_S);
        let (_, velocity) = plant.motion();
        let expected_turn_rad_s = 6.0 * 0.003 / 0.005 * TICK_S;
        assert!((velocity.z - expected_turn_rad_s).abs() < 1e-15);
        assert!((velocity.x - velocity.z * 0.003 - 5.0 * TICK_S).abs() < 1e-15);
    }

    #[test]
    fn a_command_beyond_the_peak_saturates() {
        let mut plant = plant(PlantParameters::IDEAL);
        plant.step(Wrench::new(1e6, -1e6, 0.0), TICK_S);
        let (_, velocity) = plant.motion();
        assert!((velocity - Vector3::new(25.0, -25.0, 0.0) * TICK_S).norm() < 1e-12);
    }

    #[test]
    fn verif_sensor_noise_has_the_stated_spread_and_repeats_with_its_seed() {
        let parameters = PlantParameters { sensor_noise_m_rms: 0.2e-6, ..PlantParameters::IDEAL };
        let mut plants = [plant(parameters), plant(parameters)];
        let mut square_m2 = 0.0;
        for _ in 0..10_000 {
            let [a, b] = plants.each_mut().map(Plant::measure);
            assert_eq!(a, b);
            square_m2 += a.x * a.x;
        }
        // The relative standard error of an rms of n draws is 1/√(2n) = 0.7 %; four of them.
        let rms_m = (square_m2 / 10_000.0).sqrt();
        assert!((rms_m / 0.2e-6 - 1.0).abs() < 0.03, "{rms_m}");
    }
}
