//! `feeder-lab identify-motor`: how the courier answers, as its driver has measured it, beside how the simulated motor does.

use std::f64::consts::TAU;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args as ClapArgs;
use nalgebra::Complex;

use crate::experiment::feed::FeedTrial;
use crate::experiment::motors;
use crate::try_motors;
use feeder_control::courier::{CourierConfig, LearningParameters, PlantModel, VibrationPhase};
use feeder_scenario::{SimulatedCourier, SimulatedDriver};
use feeder_sim::motor::MotorParameters;

/// Measures how a motor answers in yaw and prints it beside the truth: magnitudes over that of a rigid courier of nominal
/// inertia without delay or lag, and phases.
#[derive(Debug, ClapArgs)]
pub(crate) struct Args {
    /// The motor: the first of `try-motors` whose name contains this.
    #[arg(long, default_value = "as assumed")]
    plant: String,
    /// Scenario file (YAML) whose motor and courier are varied, in place of the assumed ones.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// How long the waveform runs, s; after half a second the excitation alone has been seen.
    #[arg(long, default_value_t = 3.0, value_parser = clap::value_parser!(f64))]
    duration: f64,
    /// The built-in scenario's waveform in place of the paper's at 30 Hz.
    #[arg(long)]
    built_in: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let (motor, base) = try_motors::base(args.scenario.as_deref())?;
    let config = CourierConfig { learning: LearningParameters { enabled: true, ..base.learning }, ..base };
    let plants = motors::plants(motor);
    let plant = plants.iter().find(|plant| plant.name.contains(&args.plant));
    let plant = plant.with_context(|| format!("--plant: {}", motors::unknown(&args.plant, &plants)))?;
    let period_s = config.servo_period_s;
    let trial = if args.built_in { FeedTrial::built_in(period_s) } else { FeedTrial::paper(period_s) };
    let mut driver = SimulatedCourier { config, motor: plant.motor }.driver(1)?;
    driver.set_waveform(trial.waveform(), true)?;
    println!("{}", plant.name);
    let excited = excite(&mut driver, &trial);
    // A tray that swings goes its own way.
    let is_rigid = plant.motor.tray_inertia_share <= 0.0;
    let torque = |rad_s2: f64| format!(" by a torque of {:.1} mN m", 1e3 * rad_s2 * plant.motor.inertia_kg_m2);
    println!(
        "the excitation: {:.2} s, tray moved with up to {:.2} rad/s²{}, yaw off by up to {:.1} µrad, parts that rest at 85 mm slide \
         by up to {:.2} µm",
        excited.ticks as f64 * period_s,
        excited.acceleration_rad_s2,
        if is_rigid { torque(excited.acceleration_rad_s2) } else { String::new() },
        1e6 * excited.error_rad,
        1e6 * excited.slip_m,
    );
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
    let ticks = (args.duration.clamp(0.0, 1e3) / period_s).round() as usize;
    let found = driver.step(ticks.saturating_sub(excited.ticks + 1)).status.learning;
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

/// What the excitation asks of the courier, and what parts make of it.
#[derive(Debug, Default)]
struct Excited {
    ticks: usize,
    /// Peaks of the tray's acceleration and of the yaw's error.
    acceleration_rad_s2: f64,
    error_rad: f64,
    /// How far parts at rest slide.
    slip_m: f64,
}

/// Runs the driver until the excitation ends and the waveform begins.
fn excite(driver: &mut SimulatedDriver, trial: &FeedTrial) -> Excited {
    /// No excitation takes so many servo ticks.
    const TICKS_MAX: usize = 4000;
    let mut excited = Excited::default();
    driver.motor_mut().take_block();
    while excited.ticks < TICKS_MAX {
        let status = driver.step(1).status;
        if !matches!(status.vibration, VibrationPhase::Off | VibrationPhase::Measuring) {
            break;
        }
        excited.ticks += 1;
        excited.error_rad = excited.error_rad.max(status.tracking_error_peak.z);
    }
    let samples = driver.motor_mut().take_block().samples;
    let samples = &samples[..excited.ticks.min(samples.len())];
    excited.acceleration_rad_s2 = samples.iter().map(|sample| sample.acceleration.z.abs()).fold(0.0, f64::max);
    excited.slip_m = trial.slip_m(samples);
    excited
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
