//! Motors that the courier's controller was not made for, and what it feeds on them.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::feed::FeedTrial;
use feeder_control::courier::{CourierConfig, LearningParameters, Rejection};
use feeder_model::motor::Load;
use feeder_scenario::{SimulatedCourier, SimulatedDriver};
use feeder_sim::motor::MotorParameters;

/// A motor by name, and what becomes of its load while it runs.
#[derive(Clone, Debug)]
pub struct Plant {
    /// How it differs from the assumed motor.
    pub name: String,
    /// Its parameters.
    pub motor: MotorParameters,
    /// What is taken off the tray after five seconds.
    pub taken_away: Load,
    /// Whether the driver is told of that.
    pub is_told: bool,
}

/// What a run on a motor shows.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantRun {
    /// Feed on the ramp over that of the ideal tray from 2 to 3 s after a cold start.
    pub after_2_s: f64,
    /// The same from 5 to 6 s: as soon as anything was taken away.
    pub after_5_s: f64,
    /// The same from 7 to 8 s: two seconds after that.
    pub after_7_s: f64,
    /// When the driver said first that something was wrong, s.
    pub said_s: Option<f64>,
    /// What it said last.
    pub said: String,
    /// Whether it went into fault.
    pub is_fault: bool,
}

/// When parts are taken away, s.
const TAKEN_S: f64 = 5.0;

/// Runs a plant on a waveform, with learning or with feedback and feed-forward alone, for 8 s, and listens to the driver for
/// `listen_s` if that is longer.
///
/// # Errors
/// A parameter out of its range, or a waveform refused.
pub fn run(
    trial: &FeedTrial,
    plant: &Plant,
    config: CourierConfig,
    learning: bool,
    seed: u64,
    listen_s: f64,
) -> Result<PlantRun, Rejection> {
    let learning = LearningParameters { enabled: learning, ..config.learning };
    let courier =
        SimulatedCourier { motor: plant.motor, config: CourierConfig { learning, load: plant.taken_away, ..config } };
    let mut driver = courier.driver(seed)?;
    driver.set_waveform(trial.waveform(), true)?;
    let mut said = Said::default();
    let mut elapsed_s = 0.0;
    let mut run = |driver: &mut SimulatedDriver, until_s: f64| {
        driver.motor_mut().take_block();
        while elapsed_s < until_s - 1e-9 {
            said.hear(driver, elapsed_s);
            elapsed_s += Said::BLOCK_S;
        }
        driver.motor_mut().take_block().samples
    };
    run(&mut driver, 1.0);
    let settle = run(&mut driver, 2.0);
    let over = run(&mut driver, 3.0);
    let [after_2_s, _] = trial.relative(&settle, &over);
    run(&mut driver, TAKEN_S - 1.0);
    let settle = run(&mut driver, TAKEN_S);
    driver.motor_mut().set_load(&Load::default());
    if plant.is_told {
        driver.set_load(Load::default())?;
    }
    let over = run(&mut driver, TAKEN_S + 1.0);
    let [after_5_s, _] = trial.relative(&settle, &over);
    let settle = run(&mut driver, TAKEN_S + 2.0);
    let over = run(&mut driver, TAKEN_S + 3.0);
    let [after_7_s, _] = trial.relative(&settle, &over);
    run(&mut driver, listen_s);
    let Said { since_s, last, is_fault } = said;
    Ok(PlantRun { after_2_s, after_5_s, after_7_s, said_s: since_s, said: last, is_fault })
}

/// What the driver says while it runs.
#[derive(Debug, Default)]
struct Said {
    since_s: Option<f64>,
    last: String,
    is_fault: bool,
}

impl Said {
    const BLOCK_S: f64 = 0.01;

    fn hear(&mut self, driver: &mut SimulatedDriver, elapsed_s: f64) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some twenty ticks")]
        let ticks = (Self::BLOCK_S / driver.config().servo_period_s).round() as usize;
        let status = driver.step(ticks).status;
        let fault = status.fault.as_ref().map(|fault| format!("fault: {fault}"));
        let said = fault.or_else(|| status.learning.warning.map(|warning| warning.to_string()));
        if let Some(said) = said.filter(|_| !self.is_fault) {
            self.since_s.get_or_insert(elapsed_s);
            self.last = said;
            self.is_fault = status.fault.is_some();
        }
    }
}

/// So many parts of so many grams at the radius where they queue.
fn parts(count: f64, mass_g: f64) -> Load {
    let mass_kg = count * mass_g * 1e-3;
    Load { mass_kg, inertia_kg_m2: mass_kg * 0.085 * 0.085 }
}

/// That none of these motors is called so.
pub(crate) fn unknown(name: &str, plants: &[Plant]) -> String {
    let names: Vec<&str> = plants.iter().map(|plant| plant.name.as_str()).collect();
    format!("no motor's name contains {name:?}; there are {}", names.join(", "))
}

/// Variations of `base`, the rows of the table in `docs/concepts/learning_control.md`.
#[must_use]
pub fn plants(base: MotorParameters) -> Vec<Plant> {
    let plant = |name: &str, motor: MotorParameters| Plant {
        name: name.to_owned(),
        motor,
        taken_away: Load::default(),
        is_told: false,
    };
    let torque_ripple = |ripple: f64| MotorParameters { ripple, ripple_phase_rad: [0.0, PI, 0.0, PI], ..base };
    let mut all = vec![plant("as assumed", base)];
    for factor in [0.0, 0.6, 2.0, 3.0] {
        all.push(plant(&format!("lag x {factor}"), MotorParameters { lag_s: factor * base.lag_s, ..base }));
    }
    for factor in [0.0, 2.0, 3.0] {
        all.push(plant(&format!("delay x {factor}"), MotorParameters { delay_s: factor * base.delay_s, ..base }));
    }
    for factor in [0.5, 1.6, 2.0, 2.5] {
        let motor = MotorParameters { inertia_kg_m2: factor * base.inertia_kg_m2, ..base };
        all.push(plant(&format!("inertia x {factor}"), motor));
    }
    for sensor_on_tray in [false, true] {
        let place = if sensor_on_tray { "tray" } else { "courier" };
        let soft = [(120.0, 0.1), (120.0, 0.3), (180.0, 0.1), (180.0, 0.3), (400.0, 0.1), (400.0, 0.3)];
        let stiff = [(400.0, 0.02), (400.0, 0.05), (700.0, 0.02), (700.0, 0.05)];
        for (tray_mode_hz, tray_inertia_share) in soft.into_iter().chain(stiff) {
            let motor = MotorParameters { tray_mode_hz, tray_inertia_share, sensor_on_tray, ..base };
            let share = 100.0 * tray_inertia_share;
            all.push(plant(&format!("mode {tray_mode_hz} Hz, {share} %, sensor on {place}"), motor));
        }
    }
    for noise_um in [1.0, 2.0] {
        let motor = MotorParameters { sensor_noise_m_rms: noise_um * 1e-6, ..base };
        all.push(plant(&format!("noise {noise_um} µm"), motor));
    }
    all.push(plant("ripple 15 %", torque_ripple(0.15)));
    all.push(plant("ripple 20 %", torque_ripple(0.2)));
    all.push(plant("iron saturates by 20 %", MotorParameters { force_loss_at_peak: 0.2, ..base }));
    all.push(plant("cable friction", MotorParameters { cable_friction_n: 0.5, cable_friction_n_m: 0.02, ..base }));
    let off = MotorParameters { sensor_scale_error: 5e-3, sensor_periodic_error_m: 20e-6, ..base };
    all.push(plant("sensor off by 0.5 % and 20 µm", off));
    let combined = MotorParameters {
        inertia_kg_m2: 1.4 * base.inertia_kg_m2,
        delay_s: 2.0 * base.delay_s,
        lag_s: 2.0 * base.lag_s,
        sensor_noise_m_rms: 1e-6,
        ..torque_ripple(0.15)
    };
    all.push(plant("inertia x 1.4, delay, lag x 2, ripple 15 %, 1 µm", combined));
    for (told, is_told) in [("", false), (" and told of", true)] {
        for mass_g in [2.0, 5.0] {
            let name = format!("30 parts of {mass_g} g taken away{told}");
            all.push(Plant { name, motor: base, taken_away: parts(30.0, mass_g), is_told });
        }
    }
    all
}

/// So many motors drawn at random from `seed`, all that may differ from `base` at once: lag and delay up to three times,
/// inertia half to twice, noise to 2 µm, ripple to 20 %, and on two of three a tray with 2 to 30 % of the inertia on a
/// mounting of 100 to 900 Hz, seen by the sensor or not.
#[must_use]
pub fn drawn(base: MotorParameters, count: usize, seed: u64) -> Vec<Plant> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut draw = |from: f64, to: f64| from + (to - from) * random.random::<f64>();
    let plant = |_| {
        let [lag, delay, inertia] = [draw(0.0, 3.0), draw(0.0, 3.0), 2.0_f64.powf(draw(-1.0, 1.0))];
        let [noise_um, ripple, kind] = [draw(0.0, 2.0), draw(0.0, 0.2), draw(0.0, 3.0)];
        let [hz, share] = [100.0 * 9.0_f64.powf(draw(0.0, 1.0)), 0.02 * 15.0_f64.powf(draw(0.0, 1.0))];
        let has_mode = kind >= 1.0;
        let sensor_on_tray = kind >= 2.0;
        let motor = MotorParameters {
            lag_s: lag * base.lag_s,
            delay_s: delay * base.delay_s,
            inertia_kg_m2: inertia * base.inertia_kg_m2,
            sensor_noise_m_rms: noise_um * 1e-6,
            ripple,
            ripple_phase_rad: [0.0, PI, 0.0, PI],
            tray_inertia_share: if has_mode { share } else { 0.0 },
            tray_mode_hz: hz,
            sensor_on_tray,
            ..base
        };
        let place = if sensor_on_tray { "tray" } else { "courier" };
        let mode = if has_mode {
            format!("mode {hz:.0} Hz, {:.0} %, sensor on {place}", 100.0 * share)
        } else {
            "rigid".to_owned()
        };
        let name = format!(
            "lag x {lag:.1}, delay x {delay:.1}, inertia x {inertia:.1}, {noise_um:.1} µm, ripple {:.0} %, {mode}",
            100.0 * ripple
        );
        Plant { name, motor, taken_away: Load::default(), is_told: false }
    };
    (0..count).map(plant).collect()
}
