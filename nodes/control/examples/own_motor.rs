//! A motor of one's own behind the courier driver: the three functions that it needs, a move, and a vibration.
//!
//! `cargo run --package feeder_control --example own_motor`

use std::error::Error;

use feeder_control::courier::{CourierConfig, Driver, Trajectory, TrajectoryPoint};
use feeder_model::motor::{PlanarMotor, Wrench};
use feeder_model::waveform::{Axis, Waveform};
use nalgebra::Vector3;

/// A rigid courier on air. Where this computes, hardware is told and asked.
struct OwnMotor {
    /// Mass along x and y, kg, and inertia about z, kg m².
    mass: Vector3<f64>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    air: bool,
}

impl PlanarMotor for OwnMotor {
    /// Hardware sends the command here, and returns when the next servo tick is due.
    fn step(&mut self, command: Wrench, duration_s: f64) {
        if !self.air {
            self.velocity.fill(0.0);
            return;
        }
        let acceleration = command.component_div(&self.mass);
        self.position += (self.velocity + acceleration * (0.5 * duration_s)) * duration_s;
        self.velocity += acceleration * duration_s;
    }

    /// Hardware reads its sensor here; NaN says that there is nothing to read.
    fn measure(&mut self) -> Vector3<f64> {
        self.position
    }

    fn set_air(&mut self, on: bool) {
        self.air = on;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let config = CourierConfig::default();
    // A tenth heavier than the driver believes.
    let mass = 1.1 * config.limits.moved(&config.load);
    let motor = OwnMotor { mass, position: config.start, velocity: Vector3::zeros(), air: true };
    let mut driver = Driver::with_motor(config, motor)?;

    let place = Vector3::new(0.1, 0.0, 0.0);
    driver.execute(1, &Trajectory { points: vec![TrajectoryPoint::at_rest(0.5, place)] })?;
    run(&mut driver, "move of 100 mm in 0.5 s", 60);
    driver.set_waveform(&Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.8654)?, true)?;
    run(&mut driver, "waveform at 30 Hz, first second", 100);
    Ok(())
}

/// Runs so many ticks of 10 ms, 20 servo ticks each, and says what happened.
fn run(driver: &mut Driver<OwnMotor>, what: &str, ticks: usize) {
    let (mut error_m, mut error_rad) = (0.0_f64, 0.0_f64);
    for _ in 0..ticks {
        let output = driver.step(20);
        error_m = error_m.max(output.status.tracking_error_peak.xy().norm());
        error_rad = error_rad.max(output.status.tracking_error_peak.z);
        for event in output.events {
            println!("{event:?}");
        }
    }
    println!("{what}: off the set point by at most {:.1} µm and {:.1} µrad", 1e6 * error_m, 1e6 * error_rad);
}
