//! The paper's rig: a block on a flat tray that the courier shakes along x, and an interferometer that sees both.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::identify::VelocitySample;
use feeder_control::courier::Rejection;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::slope::LinearTrack;
use feeder_model::waveform::Waveform;
use feeder_scenario::SimulatedCourier;

/// An experiment on the rig.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The courier, with its controller.
    pub courier: SimulatedCourier,
    /// What it runs, along x.
    pub waveform: Waveform,
    /// Friction between block and tray.
    pub friction: Friction,
    /// Noise of the interferometer's velocities, m/s rms (assumed).
    pub velocity_noise_m_s: f64,
}

/// What the rig recorded, from a cold start.
#[derive(Clone, Debug)]
pub struct Recording {
    /// What the interferometer saw at every servo tick.
    pub samples: Vec<VelocitySample>,
    /// Travel of the block relative to the tray at every servo tick, m.
    pub travel_m: Vec<f64>,
    /// Time between samples, s.
    pub sample_period_s: f64,
    /// Period of the waveform, s.
    pub waveform_period_s: f64,
    /// Difference between the tray's velocity and the waveform's over the last second, m/s rms.
    pub velocity_error_m_s: f64,
}

impl Rig {
    /// Runs for `duration_s`, at least two seconds.
    ///
    /// # Errors
    /// A configuration out of its range, or one that refuses the waveform.
    pub fn run(&self, duration_s: f64, seed: u64) -> Result<Recording, Rejection> {
        let mut driver = self.courier.driver(seed)?;
        driver.set_waveform(&self.waveform, true)?;
        let track = LinearTrack::new(self.friction, 0.0, STANDARD_GRAVITY_M_S2)?;
        let period_s = self.courier.config.servo_period_s;
        let mut noise = Pcg64Mcg::seed_from_u64(!seed);
        let mut noisy = |value: f64| {
            let draw: f64 = StandardNormal.sample(&mut noise);
            value + draw * self.velocity_noise_m_s
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
        let ticks = (duration_s.max(2.0) / period_s).round() as usize;
        let (mut samples, mut travel_m) = (Vec::with_capacity(ticks), Vec::with_capacity(ticks));
        let (mut slip_m_s, mut travelled_m, mut square) = (0.0, 0.0, 0.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
        let last_second = ticks - (1.0 / period_s).round() as usize;
        driver.step(ticks);
        for (tick, sample) in driver.motor_mut().take_block().samples.iter().enumerate() {
            let tray_m_s = sample.velocity.x;
            let time_s = tick as f64 * period_s;
            samples.push(VelocitySample { time_s, tray_m_s: noisy(tray_m_s), part_m_s: noisy(tray_m_s + slip_m_s) });
            travel_m.push(travelled_m);
            if tick >= last_second {
                square += (tray_m_s - self.waveform.state_at(time_s).velocity).powi(2);
            }
            let (next_m_s, moved_m) = track.step(slip_m_s, sample.acceleration.x, period_s);
            slip_m_s = next_m_s;
            travelled_m += moved_m;
        }
        Ok(Recording {
            samples,
            travel_m,
            sample_period_s: period_s,
            waveform_period_s: self.waveform.period_s(),
            velocity_error_m_s: (square * period_s).sqrt(),
        })
    }
}

impl Recording {
    /// Mean speed of the block relative to the tray over the last whole periods that fit into `over_s`, m/s.
    #[must_use]
    pub fn feed_m_s(&self, over_s: f64) -> f64 {
        let span_s = (over_s / self.waveform_period_s).floor() * self.waveform_period_s;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
        let ticks = (span_s / self.sample_period_s).round() as usize;
        let last = self.travel_m.len().saturating_sub(1);
        let first = last.saturating_sub(ticks);
        (self.travel_m[last] - self.travel_m[first]) / ((last - first).max(1) as f64 * self.sample_period_s)
    }
}
