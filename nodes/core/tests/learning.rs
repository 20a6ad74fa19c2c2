//! The learning courier against plants that differ from the nominal one, measured by what it feeds.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use std::f64::consts::PI;

use feeder_core::courier::control::ControlParameters;
use feeder_core::courier::plant::PlantParameters;
use feeder_core::courier::{CourierConfig, CourierDriver, LearningParameters, Load, Trajectory, TrajectoryPoint};
use feeder_core::gravity::STANDARD_GRAVITY_M_S2;
use feeder_core::mechanics::Friction;
use feeder_core::mechanics::annular::{AnnularTrack, PartState};
use feeder_core::motion::MotionSample;
use feeder_core::tray::TrayGeometry;
use feeder_core::waveform::{Axis, Waveform};
use nalgebra::Vector3;

const TICK_S: f64 = 0.5e-3;
/// A second: thirty periods of the waveform, ten windows of the learner.
const SECOND: usize = 2000;

fn waveform() -> Waveform {
    Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 9.0 * 1.962, 66.7 * 1.962).unwrap()
}

/// Feed along ramp and plateau, m/s, of parts carried by a motion.
struct Feed {
    track: AnnularTrack,
    parts: [PartState; 2],
    start_m: [f64; 2],
    ticks: usize,
}

impl Feed {
    fn new() -> Self {
        let friction = Friction::uniform(0.2).unwrap();
        let track = AnnularTrack::new(TrayGeometry::PAPER, friction, STANDARD_GRAVITY_M_S2).unwrap();
        let parts = [1.0, 4.0].map(|angle_rad| PartState::at_rest(0.085, angle_rad));
        Self { track, parts, start_m: [0.0; 2], ticks: 0 }
    }

    fn track_m(&self) -> [f64; 2] {
        let slope = TrayGeometry::PAPER.ramp_slope_rad(0.085).cos();
        [self.parts[0].angle_rad * 0.085 / slope, self.parts[1].angle_rad * 0.085]
    }

    fn follow(&mut self, samples: &[MotionSample]) {
        for sample in samples {
            for part in &mut self.parts {
                self.track.step(part, sample, TICK_S);
            }
        }
        self.ticks += samples.len();
    }

    /// Lets the parts settle on one stretch of motion and measures over another.
    fn measure(settle: &[MotionSample], over: &[MotionSample]) -> [f64; 2] {
        let mut feed = Self::new();
        feed.follow(settle);
        feed.start_m = feed.track_m();
        feed.ticks = 0;
        feed.follow(over);
        let (end_m, duration_s) = (feed.track_m(), feed.ticks as f64 * TICK_S);
        [0, 1].map(|surface| (end_m[surface] - feed.start_m[surface]) / duration_s)
    }
}

/// Feed of the waveform as a perfect tracker at 2 kHz would run it.
fn reference() -> [f64; 2] {
    Feed::measure(&tick_averaged(), &tick_averaged())
}

/// The waveform as a perfect tracker at 2 kHz would run it.
fn tick_averaged() -> Vec<MotionSample> {
    let waveform = waveform();
    (0..SECOND)
        .map(|tick| {
            let time_s = tick as f64 * TICK_S;
            let state = waveform.state_at(time_s);
            let acceleration = waveform.mean_acceleration(time_s, TICK_S);
            MotionSample {
                position: Vector3::new(0.0, 0.0, state.position),
                velocity: Vector3::new(0.0, 0.0, state.velocity),
                acceleration: Vector3::new(0.0, 0.0, acceleration),
            }
        })
        .collect()
}

/// What a run shows: feed on ramp and plateau relative to the reference after 5 and after 10 s, and the error of velocity
/// against the waveform, rad/s rms.
#[derive(Clone, Copy, Debug)]
struct Run {
    after_5_s: [f64; 2],
    after_10_s: [f64; 2],
    velocity_error_rad_s: f64,
}

impl Run {
    fn new(config: CourierConfig, seed: u64, reference: [f64; 2]) -> Self {
        let mut driver = CourierDriver::simulated(config, seed).unwrap();
        driver.set_waveform(&waveform(), true).unwrap();
        driver.step(4 * SECOND);
        let (after_5_s, _) = relative_feed(&mut driver, reference);
        driver.step(3 * SECOND);
        let (after_10_s, over) = relative_feed(&mut driver, reference);
        Self { after_5_s, after_10_s, velocity_error_rad_s: velocity_error_rad_s(&over) }
    }
}

/// Feed over the second after next, parts settling meanwhile, and the motion in it.
fn relative_feed(driver: &mut CourierDriver, reference: [f64; 2]) -> ([f64; 2], Vec<MotionSample>) {
    let settle = driver.step(SECOND).block.samples;
    let over = driver.step(SECOND).block.samples;
    let feed = Feed::measure(&settle, &over);
    ([feed[0] / reference[0], feed[1] / reference[1]], over)
}

/// For a motion that began a whole number of seconds, thus of periods, after the vibration.
fn velocity_error_rad_s(samples: &[MotionSample]) -> f64 {
    let waveform = waveform();
    let error =
        |(tick, sample): (usize, &MotionSample)| sample.velocity.z - waveform.state_at(tick as f64 * TICK_S).velocity;
    (samples.iter().enumerate().map(error).map(|error| error * error).sum::<f64>() / samples.len() as f64).sqrt()
}

fn learning() -> CourierConfig {
    let learning = LearningParameters { enabled: true, ..LearningParameters::default() };
    CourierConfig { learning, plant: PlantParameters::assumed(), ..CourierConfig::default() }
}

/// A learning courier on a plant whose mass and delay are off by factors.
fn off_nominal(mass: f64, delay: f64, ripple: f64, offset_m: f64) -> CourierConfig {
    let assumed = PlantParameters::assumed();
    let plant = PlantParameters {
        mass_kg: assumed.mass_kg * mass,
        inertia_kg_m2: assumed.inertia_kg_m2 * mass,
        delay_s: assumed.delay_s * delay,
        ripple,
        // The whole ripple falls on the torque.
        ripple_phase_rad: [0.0, PI, 0.0, PI],
        center_of_mass_offset_m: [offset_m, 0.0],
        ..assumed
    };
    CourierConfig { plant, ..learning() }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len();
    values.sum::<f64>() / count as f64
}

#[test]
fn verif_the_reference_is_that_of_the_trial_table() {
    // 2.013 and 7.595 mm/s, from a simulator of its own; over a second, part of a period may be in or out.
    let [ramp, plateau] = reference();
    assert!((ramp - 2.013e-3).abs() < 1e-5 && (plateau - 7.595e-3).abs() < 1e-5, "{ramp} {plateau}");
}

#[test]
fn verif_learning_feeds_as_computed_on_plants_that_are_off() {
    let reference = reference();
    let plants = [
        off_nominal(1.0, 1.0, 0.05, 0.0),
        off_nominal(0.8, 1.3, 0.0, 0.003),
        off_nominal(1.2, 0.7, 0.1, 0.0),
        off_nominal(0.8, 0.7, 0.1, 0.003),
        off_nominal(1.2, 1.3, 0.05, 0.0),
    ];
    for config in plants {
        for seed in 0..2 {
            let run = Run::new(config, seed, reference);
            // 10 % is required of a single run on the ramp, which noise of the sensor spreads by 3 % rms. On the plateau
            // 1.3 % are due to the cut-off and to a delay that is off; noise spreads the rest.
            assert!((run.after_5_s[0] - 1.0).abs() < 0.10, "{run:?} {config:?}");
            assert!((run.after_5_s[1] - 1.0).abs() < 0.025, "{run:?} {config:?}");
            assert!((run.after_10_s[1] - 1.0).abs() < 0.025, "{run:?} {config:?}");
        }
    }
}

#[test]
fn verif_learning_follows_the_velocity_far_better_than_feedback() {
    let reference = reference();
    let plain = CourierConfig { learning: LearningParameters::default(), ..learning() };
    let feedback = ControlParameters { feed_forward: false, ..plain.control };
    let [learned, fed_forward, fed_back] = [learning(), plain, CourierConfig { control: feedback, ..plain }]
        .map(|config| Run::new(config, 1, reference).velocity_error_rad_s);
    assert!(learned < fed_back / 40.0 && learned < fed_forward / 30.0, "{learned} {fed_forward} {fed_back}");
}

#[test]
fn what_was_learned_is_kept_while_another_waveform_runs() {
    let mut driver = CourierDriver::simulated(learning(), 1).unwrap();
    driver.set_waveform(&waveform(), true).unwrap();
    let cold_rad = driver.step(SECOND / 2).status.tracking_error_rms.z;
    let learned_rad = driver.step(3 * SECOND).status.tracking_error_rms.z;
    let other = Waveform::coulomb_pump(Axis::Yaw, 0.05, 60.0, 0.4).unwrap();
    driver.set_waveform(&other, true).unwrap();
    driver.step(2 * SECOND);
    driver.set_waveform(&waveform(), true).unwrap();
    driver.step(SECOND / 4);
    // Fading is not learned, and leaves errors of its own.
    let again_rad = driver.step(SECOND / 2).status.tracking_error_rms.z;
    assert!(again_rad < 0.2 * cold_rad && learned_rad < 0.5 * cold_rad, "{cold_rad} {learned_rad} {again_rad}");
}

#[test]
fn periods_that_are_no_whole_number_of_ticks_are_learned() {
    for period_s in [0.0333, 0.03, 1.0 / 27.0, 0.02 * 2.0_f64.sqrt()] {
        let waveform = Waveform::stick_slip(Axis::Yaw, period_s, 17.66, 130.9).unwrap();
        let mut driver = CourierDriver::simulated(learning(), 1).unwrap();
        driver.set_waveform(&waveform, true).unwrap();
        let cold_rad = driver.step(SECOND / 4).status.tracking_error_rms.z;
        // The longest of these windows lasts a second.
        driver.step(20 * SECOND);
        let learned_rad = driver.step(SECOND).status.tracking_error_rms.z;
        assert!(learned_rad < 0.1 * cold_rad, "{period_s}: {cold_rad} {learned_rad}");
    }
}

#[test]
fn a_load_and_a_move_are_got_over() {
    let mut driver = CourierDriver::simulated(learning(), 1).unwrap();
    driver.set_waveform(&waveform(), true).unwrap();
    driver.step(3 * SECOND);
    let load = Load { mass_kg: 0.3, inertia_kg_m2: 0.001 };
    driver.set_load(load).unwrap();
    driver.plant_mut().set_load(&load);
    let zero = Some(Vector3::zeros());
    let there =
        TrajectoryPoint { time_s: 1.0, position: Vector3::new(0.2, 0.1, 0.0), velocity: zero, acceleration: zero };
    driver.execute(1, &Trajectory { points: vec![there] }).unwrap();
    let step = driver.step(2 * SECOND);
    assert_eq!((step.status.fault, step.status.saturated_ticks), (None, 0));
    driver.step(2 * SECOND);
    let (feed, _) = relative_feed(&mut driver, reference());
    assert!((feed[0] - 1.0).abs() < 0.1 && (feed[1] - 1.0).abs() < 0.025, "{feed:?}");
}

/// The whole grid: mass ±20 %, delay ±30 %, ripple 0 to 10 %, centre of mass 0 or 3 mm off, 16 seeds each. Prints the feed
/// on ramp and plateau relative to the reference: mean of the seeds and the worst of them.
#[test]
#[ignore = "takes half a minute; cargo test --release -p feeder_core --test learning -- --ignored --nocapture"]
fn verif_the_whole_grid() {
    let reference = reference();
    println!("mass delay ripple offset_mm | after 5 s: ramp worst plateau worst | after 10 s: the same | mrad/s rms");
    for mass in [0.8, 1.0, 1.2] {
        for delay in [0.7, 1.0, 1.3] {
            for (ripple, offset_m) in [(0.0, 0.0), (0.05, 0.0), (0.1, 0.0), (0.0, 0.003), (0.05, 0.003), (0.1, 0.003)] {
                let config = off_nominal(mass, delay, ripple, offset_m);
                let runs: Vec<Run> = (0..16).map(|seed| Run::new(config, seed, reference)).collect();
                let column = |pick: &dyn Fn(&Run) -> f64| {
                    let worst = runs.iter().map(|run| (pick(run) - 1.0).abs()).fold(0.0, f64::max);
                    (mean(runs.iter().map(pick)), worst)
                };
                let [ramp_5, plateau_5] = [0, 1].map(|surface| column(&|run| run.after_5_s[surface]));
                let [ramp_10, plateau_10] = [0, 1].map(|surface| column(&|run| run.after_10_s[surface]));
                let velocity_mrad_s = 1e3 * mean(runs.iter().map(|run| run.velocity_error_rad_s));
                print!("{mass:.1} {delay:.1} {ripple:.2} {:.0} |", offset_m * 1e3);
                for (mean, worst) in [ramp_5, plateau_5, ramp_10, plateau_10] {
                    print!(" {mean:.4} {worst:.4}");
                }
                println!(" | {velocity_mrad_s:.2}");
                // The cut-off costs 0.8 %, a delay that is off ±0.5 %.
            }
        }
    }
}
