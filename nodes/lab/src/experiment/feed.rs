//! How well a courier feeds: against the same waveform averaged over servo ticks, which is the best a servo can do.

use nalgebra::Vector3;

use feeder_control::courier::Rejection;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::{AnnularTrack, PartState};
use feeder_model::motion::MotionSample;
use feeder_model::tray::{Surface, TrayGeometry};
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{Scenario, SimulatedCourier, SimulatedDriver, WaveformSpec};

/// Coefficient of friction of the parts.
const FRICTION: f64 = 0.2;
/// Where the part on the ramp and the part on the plateau start, rad.
const START_RAD: [f64; 2] = [1.0, 4.0];
/// How long parts settle, and how long their feed is measured, s.
const STRETCH_S: f64 = 1.0;

/// True motion of the courier over so many servo ticks from now.
fn run(driver: &mut SimulatedDriver, ticks: usize) -> Vec<MotionSample> {
    driver.motor_mut().take_block();
    driver.step(ticks);
    driver.motor_mut().take_block().samples
}

/// The fastest waveform of 10 Hz on the ramp near the outer wall, for this friction or the least that is believed possible.
#[must_use]
pub fn optimal_10_hz(friction: Option<f64>) -> WaveformSpec {
    WaveformSpec::Optimal { period_s: 0.1, radius_m: 0.085, surface: Surface::Ramp, friction, limit_rad_s2: 130.0 }
}

/// What is fed, and by which waveform.
#[derive(Clone, Debug)]
pub struct FeedTrial {
    waveform: Waveform,
    track: AnnularTrack,
    radius_m: f64,
    period_s: f64,
    reference_m_s: [f64; 2],
}

/// What a run shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeedRun {
    /// Feed on ramp and plateau over the reference, from 6 to 7 s after a cold start.
    pub after_5_s: [f64; 2],
    /// The same from 11 to 12 s.
    pub after_10_s: [f64; 2],
    /// Velocity against the waveform's, from 11 to 12 s, rad/s rms.
    pub velocity_error_rad_s: f64,
    /// Largest torque commanded in that time as acceleration times nominal inertia, N m.
    pub torque_n_m: f64,
}

impl FeedTrial {
    /// The trial of the paper's tray and waveform (9.0 and 66.7 μ g as numbers, rad/s², at 30 Hz), μ 0.2, at 85 mm, for a
    /// servo period of `period_s`.
    #[must_use]
    #[expect(clippy::expect_used, reason = "the paper's values are in range")]
    pub fn paper(period_s: f64) -> Self {
        let mu_g = FRICTION * STANDARD_GRAVITY_M_S2;
        Self::of(Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 9.0 * mu_g, 66.7 * mu_g).expect("in range"), period_s)
    }

    /// The trial of the same tray and parts with the fastest waveform of 10 Hz for the ramp, designed for the least friction that
    /// is believed possible: the one that `launch_configs/blocks.yaml` runs.
    #[must_use]
    #[expect(clippy::expect_used, reason = "the values are in range")]
    pub fn optimal(period_s: f64) -> Self {
        Self::of(
            Scenario { waveform: optimal_10_hz(None), ..Scenario::default() }.waveform().expect("in range"),
            period_s,
        )
    }

    /// The trial of the same tray and parts with the waveform that the built-in scenario runs: designed for the least friction that is
    /// believed possible, not for that of these parts.
    #[must_use]
    #[expect(clippy::expect_used, reason = "the values are in range")]
    pub fn built_in(period_s: f64) -> Self {
        Self::of(Scenario::default().waveform().expect("in range"), period_s)
    }

    #[expect(clippy::expect_used, reason = "the paper's values are in range")]
    fn of(waveform: Waveform, period_s: f64) -> Self {
        let friction = Friction::uniform(FRICTION).expect("in range");
        let track = AnnularTrack::new(TrayGeometry::PAPER, friction, STANDARD_GRAVITY_M_S2).expect("in range");
        let mut trial = Self { waveform, track, radius_m: 0.085, period_s, reference_m_s: [1.0; 2] };
        let averaged = trial.tick_averaged();
        trial.reference_m_s = trial.feed_m_s(&averaged, &averaged);
        trial
    }

    /// Feed of the waveform averaged over ticks, on ramp and plateau, m/s.
    #[must_use]
    pub fn reference_m_s(&self) -> [f64; 2] {
        self.reference_m_s
    }

    /// The waveform.
    #[must_use]
    pub fn waveform(&self) -> &Waveform {
        &self.waveform
    }

    /// Runs a courier from cold for 12 s.
    ///
    /// # Errors
    /// A configuration out of its range, or one that refuses the waveform.
    pub fn run(&self, courier: SimulatedCourier, seed: u64) -> Result<FeedRun, Rejection> {
        let mut driver = courier.driver(seed)?;
        driver.set_waveform(&self.waveform, true)?;
        let second = self.ticks(STRETCH_S);
        run(&mut driver, 5 * second);
        let (after_5_s, _) = self.relative_feed(&mut driver);
        run(&mut driver, 3 * second);
        let (after_10_s, over) = self.relative_feed(&mut driver);
        let peak = over.iter().map(|sample| sample.acceleration.z.abs()).fold(0.0, f64::max);
        Ok(FeedRun {
            after_5_s,
            after_10_s,
            velocity_error_rad_s: self.velocity_error_rad_s(&over),
            torque_n_m: peak * courier.config.limits.moved(&courier.config.load).z,
        })
    }

    /// Feed over the second after next relative to the reference, parts settling meanwhile, and the motion in it.
    pub fn relative_feed(&self, driver: &mut SimulatedDriver) -> ([f64; 2], Vec<MotionSample>) {
        let second = self.ticks(STRETCH_S);
        let settle = run(driver, second);
        let over = run(driver, second);
        (self.relative(&settle, &over), over)
    }

    /// Feed on ramp and plateau over one motion of the tray relative to the reference, parts settling over another.
    #[must_use]
    pub fn relative(&self, settle: &[MotionSample], over: &[MotionSample]) -> [f64; 2] {
        let feed_m_s = self.feed_m_s(settle, over);
        [0, 1].map(|surface| feed_m_s[surface] / self.reference_m_s[surface])
    }

    /// How far parts that rest on ramp and plateau slide along them in a motion of the tray, the farther of both, m.
    #[must_use]
    pub fn slip_m(&self, samples: &[MotionSample]) -> f64 {
        let slips_m = START_RAD.map(|start_rad| {
            let mut part = PartState::at_rest(self.radius_m, start_rad);
            let places = samples.iter().map(|sample| {
                self.track.step(&mut part, sample, self.period_s);
                (part.angle_rad - start_rad).abs() * self.radius_m
            });
            places.fold(0.0, f64::max)
        });
        slips_m.into_iter().fold(0.0, f64::max)
    }

    /// Velocity against the waveform's at the phase that fits best: the courier began it when it had been measured.
    fn velocity_error_rad_s(&self, samples: &[MotionSample]) -> f64 {
        let mean_square = |begun: usize| {
            let square = |(tick, sample): (usize, &MotionSample)| {
                let time_s = (tick + begun) as f64 * self.period_s;
                (sample.velocity.z - self.waveform.state_at(time_s).velocity).powi(2)
            };
            samples.iter().enumerate().map(square).sum::<f64>() / samples.len() as f64
        };
        // Three periods are a whole number of ticks.
        (0..self.ticks(3.0 * self.waveform.period_s())).map(mean_square).fold(f64::INFINITY, f64::min).sqrt()
    }

    /// The waveform as a perfect tracker would run it.
    fn tick_averaged(&self) -> Vec<MotionSample> {
        let sample = |tick| {
            let time_s = tick as f64 * self.period_s;
            let state = self.waveform.state_at(time_s);
            MotionSample {
                position: Vector3::new(0.0, 0.0, state.position),
                velocity: Vector3::new(0.0, 0.0, state.velocity),
                acceleration: Vector3::new(0.0, 0.0, self.waveform.mean_acceleration(time_s, self.period_s)),
            }
        };
        (0..self.ticks(STRETCH_S)).map(sample).collect()
    }

    /// Lets parts settle on one stretch of motion and measures their speed along ramp and plateau over another, m/s: over as many
    /// whole periods as it holds, as parts go by jerks.
    fn feed_m_s(&self, settle: &[MotionSample], over: &[MotionSample]) -> [f64; 2] {
        let periods = over.len() as f64 * self.period_s / self.waveform.period_s();
        let over = &over[..self.ticks((periods + 1e-9).floor() * self.waveform.period_s())];
        let slope_cos = TrayGeometry::PAPER.ramp_slope_rad(self.radius_m).cos();
        let mut index = 0;
        START_RAD.map(|start_rad| {
            let lever_m = [self.radius_m / slope_cos, self.radius_m][index];
            index += 1;
            let mut part = PartState::at_rest(self.radius_m, start_rad);
            for sample in settle {
                self.track.step(&mut part, sample, self.period_s);
            }
            let begun_rad = part.angle_rad;
            for sample in over {
                self.track.step(&mut part, sample, self.period_s);
            }
            (part.angle_rad - begun_rad) * lever_m / (over.len() as f64 * self.period_s)
        })
    }

    fn ticks(&self, duration_s: f64) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand")]
        let ticks = (duration_s / self.period_s).round() as usize;
        ticks
    }
}
