//! The position sensor: late, out of calibration, noisy and coarse.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use super::MotorParameters;

/// Where the courier was, and how fast, so long ago.
#[derive(Clone, Copy, Debug)]
struct Past {
    age_s: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
}

#[derive(Clone, Debug)]
pub(super) struct Sensor {
    past: VecDeque<Past>,
    noise: Pcg64Mcg,
}

impl Sensor {
    pub(super) fn new(seed: u64) -> Self {
        Self { past: VecDeque::new(), noise: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// Notes where the courier was before it moved for `duration_s`.
    pub(super) fn note(&mut self, position: Vector3<f64>, velocity: Vector3<f64>, duration_s: f64, delay_s: f64) {
        if delay_s <= 0.0 {
            return;
        }
        self.past.push_front(Past { age_s: 0.0, position, velocity });
        self.past.iter_mut().for_each(|past| past.age_s += duration_s);
        // One that is old enough is all that is needed of the old.
        while self.past.len() > 1 && self.past[self.past.len() - 2].age_s >= delay_s {
            self.past.pop_back();
        }
    }

    /// Reads the sensor of a courier that is at `position` and as fast as `velocity`.
    pub(super) fn read(
        &mut self,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        parameters: &MotorParameters,
    ) -> Vector3<f64> {
        let MotorParameters { sensor_noise_m_rms: noise_m, sensor_resolution_m: resolution_m, .. } = *parameters;
        let mut measured = self.delayed(Past { age_s: 0.0, position, velocity }, parameters.sensor_delay_s);
        // Yaw is the difference of two positions, an arm apart on either side.
        let yaw_per_m = 0.5 / parameters.forcer_arm_m;
        for (axis, scale) in [1.0, 1.0, yaw_per_m].into_iter().enumerate() {
            let periodic = (TAU * measured[axis] / (scale * parameters.tooth_pitch_m)).sin();
            measured[axis] +=
                measured[axis] * parameters.sensor_scale_error + scale * parameters.sensor_periodic_error_m * periodic;
            if noise_m > 0.0 {
                let draw: f64 = StandardNormal.sample(&mut self.noise);
                measured[axis] += draw * noise_m * scale;
            }
            if resolution_m > 0.0 {
                let step = resolution_m * scale;
                measured[axis] = (measured[axis] / step).round() * step;
            }
        }
        measured
    }

    /// The position `delay_s` ago, by the cubic through what is known on either side of it.
    fn delayed(&self, now: Past, delay_s: f64) -> Vector3<f64> {
        let Some(older) = self.past.iter().position(|past| past.age_s >= delay_s) else {
            return self.past.back().map_or(now.position, |oldest| oldest.position);
        };
        let after = older.checked_sub(1).map_or(now, |index| self.past[index]);
        let before = self.past[older];
        let span_s = before.age_s - after.age_s;
        let x = (before.age_s - delay_s) / span_s;
        let (from, to) = (before.position, after.position);
        let (slope_from, slope_to) = (before.velocity * span_s, after.velocity * span_s);
        from + (slope_from
            + ((to - from) * 3.0 - slope_from * 2.0 - slope_to + (slope_from + slope_to - (to - from) * 2.0) * x) * x)
            * x
    }
}
