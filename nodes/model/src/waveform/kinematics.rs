//! The motion a waveform stands for, by exact integration of its segments.

use nalgebra::Vector3;

use super::{Axis, Segment, Waveform};
use crate::motion::MotionSample;

/// Motion of the driven axis at an instant, in the units of [`Waveform`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisState {
    /// Acceleration that holds from this instant on.
    pub acceleration: f64,
    /// Velocity, of zero mean over the period.
    pub velocity: f64,
    /// Position, of zero mean over the period.
    pub position: f64,
}

/// Motion where a segment begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knot {
    time_s: f64,
    velocity: f64,
    position: f64,
}

/// Motion at the start of each segment and at the end of the period, with velocity and position of zero mean.
pub(super) fn knots(segments: &[Segment]) -> Vec<Knot> {
    let mut knots = vec![Knot { time_s: 0.0, velocity: 0.0, position: 0.0 }];
    let mut position_mean = 0.0;
    let mut last = knots[0];
    for &Segment { duration_s: d, acceleration: a } in segments {
        position_mean += d * (last.position + d * (last.velocity / 2.0 + d * a / 6.0));
        last = Knot {
            time_s: last.time_s + d,
            velocity: last.velocity + d * a,
            position: last.position + d * (last.velocity + d * a / 2.0),
        };
        knots.push(last);
    }
    // From rest at 0 the period covers `last.position`; taking off its mean velocity makes the position periodic, and
    // takes half a period of that drift off the mean position.
    let period_s = last.time_s;
    let drift = last.position / period_s;
    let position_mean = position_mean / period_s - drift * period_s / 2.0;
    for knot in &mut knots {
        knot.position -= drift * knot.time_s + position_mean;
        knot.velocity -= drift;
    }
    knots
}

impl Waveform {
    /// The period, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.end().time_s
    }

    /// Velocity at the start of the period that makes the net motion of a period zero.
    #[must_use]
    pub fn start_velocity(&self) -> f64 {
        self.knots[0].velocity
    }

    /// Position at the start of the period, of a position with zero mean.
    #[must_use]
    pub fn start_position(&self) -> f64 {
        self.knots[0].position
    }

    /// Motion at time `time_s` after the start of a period; any finite time, the waveform repeats.
    #[must_use]
    pub fn state_at(&self, time_s: f64) -> AxisState {
        let time_s = time_s.rem_euclid(self.period_s());
        let index = self.knots.partition_point(|knot| knot.time_s <= time_s).clamp(1, self.segments.len()) - 1;
        let Knot { time_s: start_s, velocity, position } = self.knots[index];
        let acceleration = self.segments[index].acceleration;
        let t = time_s - start_s;
        AxisState {
            acceleration,
            velocity: velocity + t * acceleration,
            position: position + t * (velocity + t * acceleration / 2.0),
        }
    }

    /// Mean acceleration over the servo sample from `time_s` to `time_s + sample_s`: the acceleration to command for
    /// that sample, if the velocity is to be right at its end.
    #[must_use]
    pub fn mean_acceleration(&self, time_s: f64, sample_s: f64) -> f64 {
        (self.state_at(time_s + sample_s).velocity - self.state_at(time_s).velocity) / sample_s
    }

    /// Peak-to-peak travel.
    #[must_use]
    pub fn stroke(&self) -> f64 {
        let (low, high) = self
            .extreme_positions()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        high - low
    }

    /// Largest magnitude of velocity.
    #[must_use]
    pub fn peak_speed(&self) -> f64 {
        self.knots.iter().fold(0.0, |peak, knot| knot.velocity.abs().max(peak))
    }

    /// Largest magnitude of acceleration.
    #[must_use]
    pub fn peak_acceleration(&self) -> f64 {
        self.segments.iter().fold(0.0, |peak, segment| segment.acceleration.abs().max(peak))
    }

    /// Largest distance from the mean position.
    #[must_use]
    pub fn peak_position(&self) -> f64 {
        self.extreme_positions().fold(0.0, |peak, position| position.abs().max(peak))
    }

    /// One period as samples of the tray's motion with their durations (s): `per_period` of them or a few more, so that they
    /// end with the segments and each has the acceleration of one segment.
    #[must_use]
    pub fn samples(&self, per_period: u32) -> Vec<(MotionSample, f64)> {
        let along = |value: f64| match self.axis {
            Axis::X => Vector3::new(value, 0.0, 0.0),
            Axis::Y => Vector3::new(0.0, value, 0.0),
            Axis::Yaw => Vector3::new(0.0, 0.0, value),
        };
        let mut samples = Vec::new();
        for (knot, segment) in self.knots.iter().zip(&self.segments) {
            let count = (segment.duration_s / self.period_s() * f64::from(per_period)).ceil();
            let sample_s = segment.duration_s / count;
            for i in (0u32..).map(f64::from).take_while(|&i| i < count) {
                let (t, a) = (i * sample_s, segment.acceleration);
                let motion = MotionSample {
                    position: along(knot.position + t * (knot.velocity + t * a / 2.0)),
                    velocity: along(knot.velocity + t * a),
                    acceleration: along(a),
                };
                samples.push((motion, sample_s));
            }
        }
        samples
    }

    /// Positions at the knots and where the velocity changes sign: the extremes are among them.
    fn extreme_positions(&self) -> impl Iterator<Item = f64> {
        let turns = self.knots.windows(2).zip(&self.segments).filter_map(|(ends, segment)| {
            let (from, to) = (ends[0], ends[1]);
            (from.velocity * to.velocity < 0.0)
                .then(|| from.position - from.velocity * from.velocity / (2.0 * segment.acceleration))
        });
        self.knots.iter().map(|knot| knot.position).chain(turns)
    }

    fn end(&self) -> Knot {
        self.knots[self.segments.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Any closed waveform of 2 to 7 segments.
    fn any_waveform() -> impl Strategy<Value = Waveform> {
        prop::collection::vec((1e-4..0.1f64, -50.0..50.0f64), 2..8).prop_map(|raw| {
            let period_s: f64 = raw.iter().map(|r| r.0).sum();
            let mean: f64 = raw.iter().map(|r| r.0 * r.1).sum::<f64>() / period_s;
            let segments = raw.iter().map(|r| Segment { duration_s: r.0, acceleration: r.1 - mean }).collect();
            Waveform::new(Axis::X, segments).unwrap()
        })
    }

    /// Mean over a period by the midpoint rule.
    fn mean_over_period(waveform: &Waveform, quantity: impl Fn(AxisState) -> f64) -> f64 {
        let n = 20_000u32;
        let step = waveform.period_s() / f64::from(n);
        (0..n).map(|i| quantity(waveform.state_at(step * (f64::from(i) + 0.5)))).sum::<f64>() / f64::from(n)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn motion_is_periodic_with_zero_means(waveform in any_waveform()) {
            let (period_s, speed, stroke) = (waveform.period_s(), waveform.peak_speed(), waveform.stroke());
            let (start, end) = (waveform.state_at(0.0), waveform.state_at(period_s * (1.0 - 1e-12)));
            prop_assert!((start.velocity - end.velocity).abs() <= 1e-9 * speed);
            prop_assert!((start.position - end.position).abs() <= 1e-9 * stroke);
            // The midpoint rule's error on a jump of slope is of order 1/n.
            prop_assert!(mean_over_period(&waveform, |s| s.velocity).abs() <= 1e-3 * speed);
            prop_assert!(mean_over_period(&waveform, |s| s.position).abs() <= 1e-3 * stroke);
        }

        #[test]
        fn samples_stay_within_peak_and_stroke(waveform in any_waveform(), phases in prop::collection::vec(-2.0..2.0f64, 50)) {
            let positions: Vec<f64> = phases.iter().map(|p| waveform.state_at(p * waveform.period_s()).position).collect();
            let spread = positions.iter().fold(f64::MIN, |m, p| m.max(*p)) - positions.iter().fold(f64::MAX, |m, p| m.min(*p));
            prop_assert!(spread <= waveform.stroke() * (1.0 + 1e-9));
            for p in phases {
                let state = waveform.state_at(p * waveform.period_s());
                prop_assert!(state.velocity.abs() <= waveform.peak_speed() * (1.0 + 1e-9));
            }
        }

        #[test]
        fn servo_samples_add_up_to_the_velocity(waveform in any_waveform(), sample_s in 1e-4..2e-2f64, first_s in -1.0..1.0f64) {
            let samples = 37u32;
            let gained: f64 = (0..samples)
                .map(|i| waveform.mean_acceleration(first_s + f64::from(i) * sample_s, sample_s) * sample_s)
                .sum();
            let expected = waveform.state_at(first_s + f64::from(samples) * sample_s).velocity - waveform.state_at(first_s).velocity;
            prop_assert!((gained - expected).abs() < 1e-9 * (1.0 + waveform.peak_speed()));
        }
    }
}
