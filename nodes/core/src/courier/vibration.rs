//! The periodic motion a waveform asks for, faded in and out so that the courier starts and ends at rest.

use nalgebra::Vector3;
use thiserror::Error;

use super::limits::Extent;
use crate::waveform::{Axis, Segment, Waveform};

/// Why a waveform describes no periodic motion.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum WaveformError {
    /// There is nothing to repeat.
    #[error("the waveform has no segments")]
    Empty,
    /// A duration or an acceleration is no finite number, or a duration is not positive.
    #[error("segment {index}: duration {duration_s} s must be positive and finite, acceleration {acceleration} finite")]
    BadSegment {
        /// Which segment.
        index: usize,
        /// Its duration, s.
        duration_s: f64,
        /// Its acceleration, m/s² or rad/s².
        acceleration: f64,
    },
    /// The period is too short or too long to be followed.
    #[error("the period {period_s} s is outside the allowed range {min_s} to {max_s} s")]
    Period {
        /// The period, s.
        period_s: f64,
        /// Shortest period allowed, s.
        min_s: f64,
        /// Longest period allowed, s.
        max_s: f64,
    },
    /// The velocity at the end of a period differs from that at its start, so the courier would run away.
    #[error("the velocity grows by {gain} each period: the segments' accelerations must sum to nothing")]
    NetVelocity {
        /// Gain of velocity over a period, m/s or rad/s.
        gain: f64,
    },
}

/// A corner of the velocity over a period.
#[derive(Clone, Copy, Debug)]
struct Knot {
    time_s: f64,
    position: f64,
    velocity: f64,
    acceleration: f64,
}

/// Steady vibration: position and velocity along one axis as functions of the phase, both periodic and of zero mean.
#[derive(Clone, Debug)]
pub struct PeriodicMotion {
    axis: usize,
    period_s: f64,
    knots: Vec<Knot>,
    position_peak: f64,
    velocity_peak: f64,
    acceleration_peak: f64,
}

impl PeriodicMotion {
    /// Shortest and longest period, s: from a few servo ticks to a slow shake.
    const PERIOD_RANGE_S: (f64, f64) = (0.005, 1.0);

    /// Integrates a waveform twice, with the start velocity and position by which neither has a mean.
    ///
    /// # Errors
    /// A waveform without segments, with values that are not finite, with a period out of range, or with a net gain of
    /// velocity.
    pub fn new(waveform: &Waveform) -> Result<Self, WaveformError> {
        let segments = &waveform.segments;
        if segments.is_empty() {
            return Err(WaveformError::Empty);
        }
        for (index, &Segment { duration_s, acceleration }) in segments.iter().enumerate() {
            if !(duration_s > 0.0 && duration_s.is_finite() && acceleration.is_finite()) {
                return Err(WaveformError::BadSegment { index, duration_s, acceleration });
            }
        }
        let period_s: f64 = segments.iter().map(|s| s.duration_s).sum();
        let (min_s, max_s) = Self::PERIOD_RANGE_S;
        if !(min_s..=max_s).contains(&period_s) {
            return Err(WaveformError::Period { period_s, min_s, max_s });
        }
        let gain: f64 = segments.iter().map(|s| s.acceleration * s.duration_s).sum();
        let swing: f64 = segments.iter().map(|s| (s.acceleration * s.duration_s).abs()).sum();
        if gain.abs() > 1e-6 * swing {
            return Err(WaveformError::NetVelocity { gain });
        }

        // What rounding leaves of the gain is spread over the period, so that the motion closes exactly.
        let correction = gain / period_s;
        let mut knots = Vec::with_capacity(segments.len());
        let (mut time_s, mut velocity, mut position) = (0.0, 0.0, 0.0);
        for segment in segments {
            let acceleration = segment.acceleration - correction;
            let t_s = segment.duration_s;
            knots.push(Knot { time_s, position, velocity, acceleration });
            time_s += t_s;
            position += t_s * (velocity + 0.5 * t_s * acceleration);
            velocity += t_s * acceleration;
        }
        let drift = position / period_s;
        for knot in &mut knots {
            knot.velocity -= drift;
            knot.position -= drift * knot.time_s;
        }
        let mean_position: f64 = knots
            .iter()
            .zip(segments)
            .map(|(knot, segment)| {
                let t_s = segment.duration_s;
                t_s * (knot.position + t_s * (knot.velocity / 2.0 + t_s * knot.acceleration / 6.0))
            })
            .sum::<f64>()
            / period_s;
        for knot in &mut knots {
            knot.position -= mean_position;
        }

        let mut motion = Self {
            axis: match waveform.axis {
                Axis::X => 0,
                Axis::Y => 1,
                Axis::Yaw => 2,
            },
            period_s,
            knots,
            position_peak: 0.0,
            velocity_peak: 0.0,
            acceleration_peak: 0.0,
        };
        for (index, knot) in motion.knots.iter().enumerate() {
            motion.acceleration_peak = motion.acceleration_peak.max(knot.acceleration.abs());
            motion.velocity_peak = motion.velocity_peak.max(knot.velocity.abs());
            motion.position_peak = motion.position_peak.max(knot.position.abs());
            // The position also turns wherever the velocity crosses zero inside a segment.
            let to_turn_s = -knot.velocity / knot.acceleration;
            if to_turn_s > 0.0 && to_turn_s < segments[index].duration_s {
                let turn = knot.position + 0.5 * knot.velocity * to_turn_s;
                motion.position_peak = motion.position_peak.max(turn.abs());
            }
        }
        Ok(motion)
    }

    /// Index of the driven axis in a motion vector.
    #[must_use]
    pub fn axis(&self) -> usize {
        self.axis
    }

    /// The period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Position and velocity along the axis `time_s` after the start of a period.
    #[must_use]
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        let phase_s = time_s.rem_euclid(self.period_s);
        let next = self.knots.partition_point(|knot| knot.time_s <= phase_s);
        let knot = &self.knots[next.saturating_sub(1)];
        let t_s = phase_s - knot.time_s;
        (knot.position + t_s * (knot.velocity + 0.5 * t_s * knot.acceleration), knot.velocity + t_s * knot.acceleration)
    }
}

/// A vibration with its fades: the periodic motion times an envelope that rises from 0 to 1 over the first
/// `fade_periods` periods and falls back over the last ones.
///
/// The envelope is the smoothstep 10 x³ − 15 x⁴ + 6 x⁵. Position, velocity and acceleration of the product begin and end
/// at zero, so the courier leaves from rest and returns to rest in the same place.
#[derive(Clone, Debug)]
pub(crate) struct Vibration {
    motion: PeriodicMotion,
    fade_s: f64,
}

impl Vibration {
    /// Peaks of the smoothstep's first and second derivative on [0, 1]: 15/8 at the middle, 10/√3.
    const RISE_RATE_PEAK: f64 = 1.875;
    const RISE_CURVATURE_PEAK: f64 = 5.773_502_691_896_258;

    pub(crate) fn new(motion: PeriodicMotion, fade_periods: u32) -> Self {
        let fade_s = motion.period_s * f64::from(fade_periods);
        Self { motion, fade_s }
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.motion.period_s
    }

    pub(crate) fn fade_s(&self) -> f64 {
        self.fade_s
    }

    /// Peaks of the motion on each axis, fades included.
    ///
    /// With s the envelope and q the periodic motion, (s q)'' = s q'' + 2 s' q' + s'' q is bounded by the sum of the
    /// peaks of its terms.
    pub(crate) fn extent(&self) -> Extent {
        let rate_per_s = Self::RISE_RATE_PEAK / self.fade_s;
        let curvature_per_s2 = Self::RISE_CURVATURE_PEAK / (self.fade_s * self.fade_s);
        let PeriodicMotion { axis, position_peak, velocity_peak, acceleration_peak, .. } = self.motion;
        let mut extent = Extent::default();
        extent.position[axis] = position_peak;
        extent.velocity[axis] = velocity_peak + rate_per_s * position_peak;
        extent.acceleration[axis] =
            acceleration_peak + 2.0 * rate_per_s * velocity_peak + curvature_per_s2 * position_peak;
        extent
    }

    /// Position and velocity `time_s` after the start, when fading out began, or will, at `fade_out_s`.
    pub(crate) fn at(&self, time_s: f64, fade_out_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (position, velocity) = self.motion.at(time_s);
        let (rise, rise_per_s) = smoothstep(time_s, self.fade_s);
        let (fall, fall_per_s) = smoothstep(time_s - fade_out_s, self.fade_s);
        // Fading out begins only after fading in has ended, so one of the two rates is always zero.
        let (scale, scale_per_s) = (rise - fall, rise_per_s - fall_per_s);
        let mut result = (Vector3::zeros(), Vector3::zeros());
        result.0[self.motion.axis] = scale * position;
        result.1[self.motion.axis] = scale * velocity + scale_per_s * position;
        result
    }
}

/// The smoothstep 10 x³ − 15 x⁴ + 6 x⁵ of x = `time_s` / `duration_s`, 0 before and 1 after, and its derivative, 1/s.
pub(crate) fn smoothstep(time_s: f64, duration_s: f64) -> (f64, f64) {
    let x = (time_s / duration_s).clamp(0.0, 1.0);
    (x * x * x * (10.0 + x * (6.0 * x - 15.0)), 30.0 * (x * (1.0 - x)).powi(2) / duration_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stick_slip(period_s: f64, slow: f64, fast: f64) -> Waveform {
        let first_s = fast * period_s / (2.0 * (slow + fast));
        Waveform {
            axis: Axis::Yaw,
            segments: vec![
                Segment { duration_s: first_s, acceleration: slow },
                Segment { duration_s: period_s - 2.0 * first_s, acceleration: -fast },
                Segment { duration_s: first_s, acceleration: slow },
            ],
        }
    }

    #[test]
    fn verif_the_motion_closes_and_neither_velocity_nor_position_has_a_mean() {
        let motion = PeriodicMotion::new(&stick_slip(1.0 / 30.0, 17.658, 130.87)).unwrap();
        let steps = 100_000;
        let (mut position, mut velocity) = (0.0, 0.0);
        for step in 0..steps {
            let (p, v) = motion.at((f64::from(step) + 0.5) / f64::from(steps) / 30.0);
            position += p;
            velocity += v;
        }
        // The midpoint rule over n steps errs by about a (T/n)² / 24 near each kink: far below these bounds.
        assert!((position / f64::from(steps)).abs() < 1e-9 * motion.position_peak.max(1.0));
        assert!((velocity / f64::from(steps)).abs() < 1e-8 * motion.velocity_peak.max(1.0));
        let (start, end) = (motion.at(0.0), motion.at(1.0 / 30.0 - 1e-15));
        assert!((start.0 - end.0).abs() < 1e-12 && (start.1 - end.1).abs() < 1e-9);
    }

    #[test]
    fn the_extent_bounds_the_motion_with_its_fades() {
        for fade_periods in [1, 2, 5] {
            let motion = PeriodicMotion::new(&stick_slip(1.0 / 30.0, 17.658, 130.87)).unwrap();
            let vibration = Vibration::new(motion, fade_periods);
            let extent = vibration.extent();
            let end_s = 2.0 * vibration.fade_s();
            let step_s = 1e-5;
            let mut last = vibration.at(0.0, vibration.fade_s()).1.z;
            let mut time_s = 0.0;
            while time_s < end_s {
                time_s += step_s;
                let (position, velocity) = vibration.at(time_s, vibration.fade_s());
                assert!(position.z.abs() <= extent.position.z && velocity.z.abs() <= extent.velocity.z);
                assert!((velocity.z - last).abs() <= extent.acceleration.z * step_s * (1.0 + 1e-9));
                last = velocity.z;
            }
            let (position, velocity) = vibration.at(end_s, vibration.fade_s());
            assert!(position.norm() < 1e-15 && velocity.norm() < 1e-12);
        }
    }

    #[test]
    fn a_waveform_that_runs_away_or_is_no_number_is_refused() {
        let mut waveform = stick_slip(0.05, 1.6, 10.1);
        waveform.segments[1].acceleration *= 1.01;
        assert!(matches!(PeriodicMotion::new(&waveform), Err(WaveformError::NetVelocity { .. })));
        waveform.segments[1].acceleration = f64::INFINITY;
        assert!(matches!(PeriodicMotion::new(&waveform), Err(WaveformError::BadSegment { index: 1, .. })));
        waveform.segments.clear();
        assert_eq!(PeriodicMotion::new(&waveform).unwrap_err(), WaveformError::Empty);
        let slow = stick_slip(2.0, 1.0, 2.0);
        assert!(matches!(PeriodicMotion::new(&slow), Err(WaveformError::Period { .. })));
    }
}
