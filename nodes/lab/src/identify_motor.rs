//! `feeder-lab identify-motor`: how the courier answers, as its driver has measured it, beside how the simulated motor does.

use std::f64::consts::TAU;

use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use nalgebra::Complex;

use crate::experiment::feed::FeedTrial;
use crate::experiment::motors;
use feeder_control::courier::{CourierConfig, LearningParameters, PlantModel};
use feeder_scenario::{SimulatedCourier, assumed_motor};
use feeder_sim::motor::MotorParameters;

/// Measures how a motor answers in yaw and prints it beside the truth: magnitudes over that of a rigid courier of nominal
/// inertia without delay or lag, and phases.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// The motor: the first of `try-motors` whose name contains this.
    #[arg(long, default_value = "as assumed")]
    plant: String,
    /// How long the waveform runs, s; after half a second the excitation alone has been seen.
    #[arg(long, default_value_t = 3.0, value_parser = clap::value_parser!(f64))]
    duration: f64,
    /// The built-in waveform at 10 Hz in place of the paper's at 30 Hz.
    #[arg(long)]
    built_in: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let learning = LearningParameters { enabled: true, ..LearningParameters::default() };
    let config = CourierConfig { learning, ..CourierConfig::default() };
    let plants = motors::plants(assumed_motor());
    let plant = plants.iter().find(|plant| plant.name.contains(&args.plant));
    let plant = plant.with_context(|| format!("no motor is called {:?}", args.plant))?;
    let period_s = config.servo_period_s;
    let trial = if args.built_in { FeedTrial::built_in(period_s) } else { FeedTrial::paper(period_s) };
    let mut driver = SimulatedCourier { config, motor: plant.motor }.driver(1)?;
    driver.set_waveform(trial.waveform(), true)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
    let status = driver.step((args.duration.clamp(0.0, 1e3) / period_s).round() as usize).status;
    let found = status.learning;
    println!("{}", plant.name);
    println!(
        "fitted: gain {:.3}, delay {:.3} ms, lag {:.3} ms; the motor's: {:.3}, {:.3} ms, {:.3} ms",
        found.gain,
        found.delay_s * 1e3,
        found.lag_s * 1e3,
        config.limits.inertia_kg_m2 / plant.motor.inertia_kg_m2,
        plant.motor.delay_s * 1e3,
        plant.motor.lag_s * 1e3,
    );
    println!("    Hz | measured        ± | true            | rigid fit");
    let ideal = PlantModel { gain: 1.0, delay_s: 0.0, lag_s: 0.0 };
    for point in driver.measured_response() {
        let omega_rad_s = TAU * point.frequency_hz;
        let (reference, _) = ideal.response(Complex::cis(omega_rad_s * period_s), period_s);
        let polar = |answer: Complex<f64>| {
            let ratio = answer / reference;
            format!("{:6.3} {:7.1}°", ratio.norm(), ratio.arg().to_degrees())
        };
        let truth = truth(&plant.motor, config.limits.inertia_kg_m2, omega_rad_s, period_s);
        println!(
            "{:6.1} | {} {:6.3} | {} | {}",
            point.frequency_hz,
            polar(point.position),
            point.uncertainty,
            polar(truth),
            polar(point.rigid)
        );
    }
    if let Some(warning) = found.warning {
        println!("the driver says: {warning}");
    }
    Ok(())
}

/// How the linear part of a simulated motor answers in yaw at the servo ticks, rad per rad/s² of the nominal inertia: the
/// rigid body, times what a tray on a mounting that twists makes of it.
fn truth(motor: &MotorParameters, nominal_kg_m2: f64, omega_rad_s: f64, period_s: f64) -> Complex<f64> {
    let MotorParameters { inertia_kg_m2, delay_s, lag_s, tray_inertia_share: share, .. } = *motor;
    let plant = PlantModel { gain: nominal_kg_m2 / inertia_kg_m2, delay_s, lag_s };
    let (rigid, _) = plant.response(Complex::cis(omega_rad_s * period_s), period_s);
    // Two inertias on a spring, all relative to the reduced inertia s (1 − s) J: the spring is ω², its damper 2 ζ ω.
    let mode_rad_s = TAU * motor.tray_mode_hz;
    let spring = Complex::new(mode_rad_s * mode_rad_s, 2.0 * motor.tray_mode_damping * mode_rad_s * omega_rad_s);
    let square = omega_rad_s * omega_rad_s;
    let seen = if motor.sensor_on_tray { spring } else { spring - square / (1.0 - share) };
    if share > 0.0 { rigid * seen / (spring - square) } else { rigid }
}
