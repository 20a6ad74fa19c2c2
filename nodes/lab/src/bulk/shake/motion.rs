//! Planar motions of the tray, made of bursts that begin and end at rest in the same place.

use std::f64::consts::TAU;

use feeder_control::courier::{CourierLimits, smoothstep};
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::motor::Load;
use feeder_model::waveform::Waveform;
use nalgebra::Vector3;

use crate::bulk::{BLOCK_SAMPLES, SAMPLE_S};

/// Farthest that a motion may carry the tray's centre from its place, m.
pub(super) const REACH_M: f64 = 0.005;

/// Fading takes so many periods, as with the courier.
pub(super) const FADE_PERIODS: f64 = 2.0;

/// What repeats in a burst.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Of amplitude 1.
    Sine { frequency_hz: f64, phase_rad: f64 },
    /// As the waveform says, whatever its axis.
    Periodic(Waveform),
}

impl Shape {
    pub(super) fn period_s(&self) -> f64 {
        match self {
            Self::Sine { frequency_hz, .. } => 1.0 / frequency_hz,
            Self::Periodic(waveform) => waveform.period_s(),
        }
    }

    /// Position and velocity.
    fn at(&self, time_s: f64) -> (f64, f64) {
        match self {
            Self::Sine { frequency_hz, phase_rad } => {
                let rate_rad_s = TAU * frequency_hz;
                let (sin, cos) = (rate_rad_s * time_s + phase_rad).sin_cos();
                (sin, rate_rad_s * cos)
            }
            Self::Periodic(waveform) => {
                let state = waveform.state_at(time_s);
                (state.position, state.velocity)
            }
        }
    }
}

/// A vibration that fades in from rest and out to rest.
#[derive(Clone, Debug)]
pub(super) struct Burst {
    pub(super) shape: Shape,
    /// What a position of 1 of the shape is along x and y (m) and about the tray's axis (rad).
    pub(super) axes: Vector3<f64>,
    pub(super) start_s: f64,
    pub(super) end_s: f64,
    /// How long it takes to fade in, and to fade out.
    pub(super) fades_s: [f64; 2],
}

impl Burst {
    /// Fades in and out over as many periods as with the courier.
    pub(super) fn faded(shape: Shape, axes: Vector3<f64>, start_s: f64, end_s: f64) -> Self {
        let fade_s = FADE_PERIODS * shape.period_s();
        Self { shape, axes, start_s, end_s, fades_s: [fade_s; 2] }
    }

    /// Position and velocity.
    fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        if time_s <= self.start_s || time_s >= self.end_s {
            return Default::default();
        }
        let (position, velocity) = self.shape.at(time_s - self.start_s);
        let (rise, rise_per_s) = fade(time_s - self.start_s, self.fades_s[0]);
        let (left, left_per_s) = fade(self.end_s - time_s, self.fades_s[1]);
        let (scale, scale_per_s) = (rise * left, rise_per_s * left - rise * left_per_s);
        (self.axes * (scale * position), self.axes * (scale * velocity + scale_per_s * position))
    }
}

/// What a burst is scaled by, so long after it began to fade in, and the derivative of that, 1/s: as the courier fades.
fn fade(time_s: f64, over_s: f64) -> (f64, f64) {
    if over_s > 0.0 { smoothstep(time_s, over_s) } else { (1.0, 0.0) }
}

/// Bursts, one after the other or together.
#[derive(Clone, Debug, Default)]
pub(super) struct Motion {
    pub(super) bursts: Vec<Burst>,
}

impl Motion {
    /// The motion over a sample that begins at a time.
    pub(super) fn sample(&self, time_s: f64) -> MotionSample {
        let at = |time_s: f64| {
            let states = self.bursts.iter().map(|burst| burst.at(time_s));
            states.fold((Vector3::zeros(), Vector3::zeros()), |sum, state| (sum.0 + state.0, sum.1 + state.1))
        };
        let (position, velocity) = at(time_s);
        MotionSample { position, velocity, acceleration: (at(time_s + SAMPLE_S).1 - velocity) / SAMPLE_S }
    }

    /// The block of number `index`.
    pub(super) fn block(&self, index: u32) -> MotionBlock {
        let first = u64::from(index) * u64::from(BLOCK_SAMPLES);
        let samples = (first..first + u64::from(BLOCK_SAMPLES)).map(|sample| self.sample(sample as f64 * SAMPLE_S));
        MotionBlock { sample_period_s: SAMPLE_S, samples: samples.collect() }
    }

    pub(super) fn end_s(&self) -> f64 {
        self.bursts.iter().map(|burst| burst.end_s).fold(0.0, f64::max)
    }

    /// The largest share that the motion takes of what a courier may be told: reach, speed, acceleration, and force and torque
    /// beside the feedback's reserve, which come from the same forcers.
    pub(super) fn share_of(&self, limits: &CourierLimits, load: &Load) -> f64 {
        let moved = limits.moved(load);
        let mut time_s = 0.0;
        let mut most: f64 = 0.0;
        while time_s < self.end_s() {
            let MotionSample { position, velocity, acceleration } = self.sample(time_s);
            let wrench = moved.component_mul(&acceleration).component_div(&limits.wrench_max()).abs();
            let forcers = (wrench.x.max(wrench.y) + wrench.z) / (1.0 - limits.feedback_reserve);
            let shares = [
                position.xy().norm() / REACH_M,
                position.z.abs() / limits.yaw_rad_max,
                velocity.xy().norm() / limits.speed_m_s_max,
                acceleration.xy().norm() / limits.acceleration_m_s2_max,
                forcers,
            ];
            most = shares.into_iter().fold(most, f64::max);
            time_s += SAMPLE_S;
        }
        most
    }

    /// The same motion, smaller or larger.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        for burst in &mut self.bursts {
            burst.axes *= factor;
        }
        self
    }
}
