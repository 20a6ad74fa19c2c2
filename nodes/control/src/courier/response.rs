//! Frequency response of the servo loop as it is believed to be: what a periodic force added to the feedback does to the
//! position.

use std::f64::consts::TAU;

use nalgebra::Complex;

use super::control::ControlParameters;

/// A rigid plant on one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantModel {
    /// Acceleration given over that commanded: the nominal mass over the true one.
    pub gain: f64,
    /// Time from a command to its first effect, s.
    pub delay_s: f64,
    /// Time constant of the force, s.
    pub lag_s: f64,
}

/// A rigid plant with its sampled feedback, by exact discretisation between servo ticks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LoopModel {
    pub(crate) control: ControlParameters,
    pub(crate) plant: PlantModel,
    /// Servo period, s.
    pub(crate) period_s: f64,
}

/// Force, speed and position `time_s` after a unit command was applied to a plant of unit mass at rest.
pub(super) fn step_response(time_s: f64, lag_s: f64) -> [f64; 3] {
    let risen = if lag_s > 0.0 { 1.0 - (-time_s / lag_s).exp() } else { 1.0 };
    [risen, time_s - lag_s * risen, 0.5 * time_s * time_s - lag_s * time_s + lag_s * lag_s * risen]
}

impl PlantModel {
    /// Position (m) and velocity (m/s) per command (m/s²) in open loop, at `z` = exp(i ω Δt), Δt being `dt`.
    #[must_use]
    pub fn response(&self, z: Complex<f64>, dt: f64) -> (Complex<f64>, Complex<f64>) {
        let lag_s = self.lag_s;
        let whole_ticks = (self.delay_s / dt + 1e-9).floor();
        let late_s = (self.delay_s - whole_ticks * dt).max(0.0);
        // In a tick the command of l + 1 ticks ago acts for the first `late_s`, then that of l ticks ago.
        let advance = |[force, speed, position]: [f64; 3], time_s: f64| {
            let [risen, gained, moved] = step_response(time_s, lag_s);
            // A force that is no longer commanded decays as fast as one that is commanded rises.
            [
                force * (1.0 - risen),
                speed + force * (time_s - gained),
                position + speed * time_s + force * (0.5 * time_s * time_s - moved),
            ]
        };
        let early = advance(step_response(late_s, lag_s), dt - late_s);
        let late = step_response(dt - late_s, lag_s);
        let shift = Complex::from_polar(1.0, -whole_ticks * z.arg());
        let input = |index: usize| shift * (early[index] / z + late[index]);
        let [risen, gained, moved] = step_response(dt, lag_s);
        let remaining = if lag_s > 0.0 { 1.0 - risen } else { 0.0 };
        let force = input(0) / (z - remaining);
        let (carried_speed, carried_position) =
            if lag_s > 0.0 { (dt - gained, 0.5 * dt * dt - moved) } else { (0.0, 0.0) };
        let speed = (input(1) + force * carried_speed) / (z - 1.0);
        let position = (input(2) + force * carried_position + speed * dt) / (z - 1.0);
        (position * self.gain, speed * self.gain)
    }
}

impl LoopModel {
    /// Command per error of position, the feedback.
    fn feedback(&self, z: Complex<f64>) -> Complex<f64> {
        let natural_rad_s = TAU * self.control.bandwidth_hz;
        let gain = 1.0 - (-TAU * self.control.velocity_filter_hz * self.period_s).exp();
        let rate = gain * (1.0 - 1.0 / z) / self.period_s / (1.0 - (1.0 - gain) / z);
        let integral = 1.0 + self.control.integral_per_s() * self.period_s / (1.0 - 1.0 / z);
        natural_rad_s * natural_rad_s * integral + 2.0 * self.control.damping_ratio * natural_rad_s * rate
    }

    /// Everything of the loop at one frequency.
    pub(crate) fn at(&self, omega_rad_s: f64) -> Response {
        let z = Complex::cis(omega_rad_s * self.period_s);
        let (position, velocity) = self.plant.response(z, self.period_s);
        let difference = (z - 1.0) / self.period_s;
        Response { omega_rad_s, position, velocity, feedback: self.feedback(z), difference }
    }
}

/// The loop at one frequency, as transfer functions between values at servo ticks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Response {
    pub(crate) omega_rad_s: f64,
    /// Position per command in open loop, m per m/s².
    pub(crate) position: Complex<f64>,
    /// Velocity per command in open loop, m/s per m/s².
    pub(crate) velocity: Complex<f64>,
    /// Command per error of position, 1/s².
    pub(crate) feedback: Complex<f64>,
    /// Mean acceleration from a tick to the next per velocity, 1/s.
    pub(crate) difference: Complex<f64>,
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::courier::control::{Controller, SetPoint};
    use feeder_model::motor::{PlanarMotor, Wrench};
    use feeder_sim::motor::{MotorParameters, SimulatedMotor};

    #[test]
    fn verif_the_response_is_what_the_closed_loop_does() {
        let control = ControlParameters::default();
        for (gain, delay_s, lag_s) in
            [(1.0, 0.0, 0.0), (0.8, 0.5e-3, 0.5e-3), (1.5, 0.65e-3, 0.3e-3), (1.0, 1.2e-3, 0.0)]
        {
            let parameters = MotorParameters { delay_s, lag_s, mass_kg: 1.2 / gain, ..MotorParameters::IDEAL };
            let plant = PlantModel { gain, delay_s, lag_s };
            let model = LoopModel { control, plant, period_s: 0.5e-3 };
            for frequency_hz in [30.0, 90.0, 300.0, 630.0] {
                let omega_rad_s = TAU * frequency_hz;
                let mut plant = SimulatedMotor::new(parameters, Vector3::zeros(), 1).unwrap();
                let mut controller = Controller::new(&control, Vector3::new(1.2, 1.2, 0.005), 0.5e-3).unwrap();
                let mut sum = Complex::new(0.0, 0.0);
                // A second to settle, then a second, which is whole periods of every frequency.
                for tick in 0..4000 {
                    let phase = Complex::cis(omega_rad_s * f64::from(tick) * 0.5e-3);
                    let measured = plant.measure();
                    let feedback = controller.command(&SetPoint::default(), &measured);
                    plant.step(feedback + Wrench::new(1.2 * phase.re, 0.0, 0.0), 0.5e-3);
                    if tick >= 2000 {
                        sum += measured.x * phase.conj() * (2.0 / 2000.0);
                    }
                }
                let open = model.at(omega_rad_s);
                let closed = open.position / (1.0 + open.position * open.feedback);
                let error = (sum - closed).norm() / sum.norm();
                // What is left of the start-up after a second, e^(-ω ζ t), and rounding.
                assert!(error < 1e-6, "{delay_s} {lag_s} {frequency_hz}: {error}");
            }
        }
    }
}
