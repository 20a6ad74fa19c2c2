//! Feed of the paper's waveform with a learning courier, over a grid of plants that differ from the nominal one.
//!
//! Prints, for every plant, the feed on ramp and plateau at r = 85 mm relative to the waveform averaged over servo ticks:
//! mean over the seeds and the worst seed. `cargo run --release -p feeder_core --example learning_grid [SEEDS]`.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the example")]

use feeder_core::courier::control::ControlParameters;
use feeder_core::courier::plant::PlantParameters;
use feeder_core::courier::{CourierConfig, CourierDriver, LearningParameters};
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

/// What a run shows: feed relative to the reference after 5 and after 10 s, and the velocity error, rad/s rms.
struct Run {
    after_5_s: [f64; 2],
    after_10_s: [f64; 2],
    velocity_error_rad_s: f64,
}

fn run(config: CourierConfig, seed: u64, reference: [f64; 2]) -> Run {
    let mut driver = CourierDriver::simulated(config, seed).unwrap();
    driver.set_waveform(&waveform(), true).unwrap();
    driver.step(4 * SECOND);
    let relative = |driver: &mut CourierDriver| {
        let settle = driver.step(SECOND).block.samples;
        let over = driver.step(SECOND).block.samples;
        let feed = Feed::measure(&settle, &over);
        ([feed[0] / reference[0], feed[1] / reference[1]], over)
    };
    let (after_5_s, _) = relative(&mut driver);
    driver.step(3 * SECOND);
    let (after_10_s, over) = relative(&mut driver);
    let (exact, square) = (waveform(), |x: f64| x * x);
    let sum: f64 = over
        .iter()
        .enumerate()
        .map(|(tick, sample)| square(sample.velocity.z - exact.state_at(tick as f64 * TICK_S).velocity))
        .sum();
    Run { after_5_s, after_10_s, velocity_error_rad_s: (sum / over.len() as f64).sqrt() }
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(16, |seeds| seeds.parse().unwrap());
    let reference = Feed::measure(&tick_averaged(), &tick_averaged());
    println!("tick-averaged waveform: ramp {:.4} mm/s, plateau {:.4} mm/s", reference[0] * 1e3, reference[1] * 1e3);
    println!(
        "controller mass delay ripple offset_mm  ramp5 worst  plateau5 worst  ramp10 worst  plateau10 worst  v_rms_mrad_s"
    );
    let off = LearningParameters::default();
    let learning = LearningParameters { enabled: true, ..off };
    let pd = ControlParameters { feed_forward: false, ..ControlParameters::default() };
    let nominal = CourierConfig { plant: PlantParameters::ASSUMED, ..CourierConfig::default() };
    let mut rows = vec![
        ("pd", CourierConfig { control: pd, learning: off, ..nominal }),
        ("pd+ff", CourierConfig { learning: off, ..nominal }),
    ];
    for mass in [1.0, 0.8, 1.2] {
        for delay in [1.0, 0.7, 1.3] {
            for ripple in [0.05, 0.0, 0.1] {
                for offset_m in [0.0, 0.003] {
                    let assumed = PlantParameters::ASSUMED;
                    let plant = PlantParameters {
                        mass_kg: assumed.mass_kg * mass,
                        inertia_kg_m2: assumed.inertia_kg_m2 * mass,
                        delay_s: assumed.delay_s * delay,
                        ripple,
                        center_of_mass_offset_m: [offset_m, 0.0],
                        ..assumed
                    };
                    rows.push(("learning", CourierConfig { plant, learning, ..nominal }));
                }
            }
        }
    }
    for (controller, config) in rows {
        let runs: Vec<Run> = (0..seeds).map(|seed| run(config, seed, reference)).collect();
        let summary = |pick: &dyn Fn(&Run) -> f64| {
            let mean = runs.iter().map(pick).sum::<f64>() / runs.len() as f64;
            let worst = runs.iter().map(|run| (pick(run) - 1.0).abs()).fold(0.0, f64::max);
            (mean, worst)
        };
        let columns = [
            summary(&|run| run.after_5_s[0]),
            summary(&|run| run.after_5_s[1]),
            summary(&|run| run.after_10_s[0]),
            summary(&|run| run.after_10_s[1]),
        ];
        let columns: Vec<String> = columns.iter().map(|(mean, worst)| format!("{mean:8.4} {worst:6.4}")).collect();
        println!(
            "{controller:9} {:.2} {:.2} {:.2} {:.0}  {}  {:.2}",
            config.plant.mass_kg / 1.2,
            config.plant.delay_s / 0.5e-3,
            config.plant.ripple,
            config.plant.center_of_mass_offset_m[0] * 1e3,
            columns.join("  "),
            summary(&|run| run.velocity_error_rad_s).0 * 1e3,
        );
    }
}
