//! A controller of one's own on the simulated motor: it knows the motor by the trait alone, as on hardware.
//!
//! `cargo run --package feeder_sim --example own_controller`

use std::error::Error;
use std::f64::consts::TAU;

use feeder_model::motor::{PlanarMotor, Wrench};
use feeder_model::waveform::{Axis, Waveform};
use feeder_sim::motor::{MotorParameters, SimulatedMotor};
use nalgebra::Vector3;

const SERVO_PERIOD_S: f64 = 0.5e-3;

/// Proportional-derivative feedback, half as fast again as the driver's, and feed-forward; for yaw alone.
struct OwnController {
    inertia_kg_m2: f64,
    natural_rad_s: f64,
    last_error_rad: f64,
}

impl OwnController {
    fn torque_n_m(&mut self, position_rad: f64, acceleration_rad_s2: f64, measured_rad: f64) -> f64 {
        let error_rad = position_rad - measured_rad;
        let error_rad_s = (error_rad - self.last_error_rad) / SERVO_PERIOD_S;
        self.last_error_rad = error_rad;
        let feedback = self.natural_rad_s * (self.natural_rad_s * error_rad + 1.8 * error_rad_s);
        self.inertia_kg_m2 * (acceleration_rad_s2 + feedback)
    }
}

/// Follows a yaw waveform for `duration_s` and gives the largest error of its last half, rad.
fn follow(motor: &mut impl PlanarMotor, waveform: &Waveform, duration_s: f64) -> f64 {
    let mut controller = OwnController { inertia_kg_m2: 0.005, natural_rad_s: TAU * 30.0, last_error_rad: 0.0 };
    let mut error_rad_max = 0.0_f64;
    let mut time_s = 0.0;
    while time_s < duration_s {
        let wanted = waveform.state_at(time_s % waveform.period_s());
        let measured_rad = motor.measure().z;
        if time_s > 0.5 * duration_s {
            error_rad_max = error_rad_max.max((wanted.position - measured_rad).abs());
        }
        // What the waveform asks for until the next tick, not only at this one.
        let acceleration_rad_s2 = waveform.mean_acceleration(time_s % waveform.period_s(), SERVO_PERIOD_S);
        let torque_n_m = controller.torque_n_m(wanted.position, acceleration_rad_s2, measured_rad);
        motor.step(Wrench::new(0.0, 0.0, torque_n_m), SERVO_PERIOD_S);
        time_s += SERVO_PERIOD_S;
    }
    error_rad_max
}

fn main() -> Result<(), Box<dyn Error>> {
    let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.8654)?;
    let late = MotorParameters { delay_s: 0.5e-3, lag_s: 0.5e-3, ..MotorParameters::IDEAL };
    for (name, parameters) in [("ideal motor", MotorParameters::IDEAL), ("1 ms late", late)] {
        let mut motor = SimulatedMotor::new(parameters, Vector3::zeros(), 1)?;
        let error_rad = follow(&mut motor, &waveform, 2.0);
        println!("{name}: off the waveform by at most {:.1} µrad of {:.1}", 1e6 * error_rad, 1e6 * waveform.stroke());
    }
    Ok(())
}
