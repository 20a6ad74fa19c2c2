//! The fastest motion from rest to rest over a distance, with limits of speed, acceleration, braking and jerk.

/// Limits of a motion along a line. Infinite values lift a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LineLimits {
    pub(crate) speed_m_s: f64,
    pub(crate) acceleration_m_s2: f64,
    pub(crate) braking_m_s2: f64,
    pub(crate) jerk_m_s3: f64,
}

/// The state at a change of jerk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Knot {
    pub(crate) time_s: f64,
    pub(crate) distance_m: f64,
    pub(crate) speed_m_s: f64,
    pub(crate) acceleration_m_s2: f64,
}

/// A motion of piecewise constant jerk from rest to rest.
///
/// It speeds up to a peak speed as fast as acceleration and jerk allow, keeps it if the speed limit asks for that, and
/// brakes likewise. Rest to rest this is time-optimal: the time grows with nothing but the peak speed's shortfall.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Profile {
    pub(crate) knots: Vec<Knot>,
    /// How long it speeds up, s.
    pub(crate) speeding_s: f64,
    /// How long it brakes at the end, s.
    pub(crate) braking_s: f64,
}

/// Changing the speed by some amount, from constant speed to constant speed.
#[derive(Clone, Copy, Debug)]
struct SpeedChange {
    jerk_s: f64,
    constant_s: f64,
    peak_m_s2: f64,
}

impl SpeedChange {
    fn new(by_m_s: f64, limit_m_s2: f64, jerk_m_s3: f64) -> Self {
        if by_m_s >= limit_m_s2 * limit_m_s2 / jerk_m_s3 {
            let jerk_s = limit_m_s2 / jerk_m_s3;
            Self { jerk_s, constant_s: by_m_s / limit_m_s2 - jerk_s, peak_m_s2: limit_m_s2 }
        } else {
            let jerk_s = (by_m_s / jerk_m_s3).sqrt();
            Self { jerk_s, constant_s: 0.0, peak_m_s2: jerk_s * jerk_m_s3 }
        }
    }

    fn duration_s(&self) -> f64 {
        2.0 * self.jerk_s + self.constant_s
    }
}

impl Profile {
    /// The fastest motion over a positive, finite distance.
    pub(crate) fn new(distance_m: f64, limits: &LineLimits) -> Self {
        let changes = |peak_m_s: f64| {
            let up = SpeedChange::new(peak_m_s, limits.acceleration_m_s2, limits.jerk_m_s3);
            let down = SpeedChange::new(peak_m_s, limits.braking_m_s2, limits.jerk_m_s3);
            (up, down)
        };
        // A change of speed is symmetric in time, so its mean speed is half of the peak.
        let needed_m = |peak_m_s: f64| {
            let (up, down) = changes(peak_m_s);
            0.5 * peak_m_s * (up.duration_s() + down.duration_s())
        };
        let slowness = 1.0 / limits.acceleration_m_s2 + 1.0 / limits.braking_m_s2;
        let without_jerk_m_s = (2.0 * distance_m / slowness).sqrt();
        let (mut low_m_s, mut high_m_s) = (0.0, without_jerk_m_s.min(limits.speed_m_s));
        if needed_m(high_m_s) > distance_m {
            loop {
                let middle_m_s = 0.5 * (low_m_s + high_m_s);
                if middle_m_s <= low_m_s || middle_m_s >= high_m_s {
                    break;
                }
                if needed_m(middle_m_s) > distance_m {
                    high_m_s = middle_m_s;
                } else {
                    low_m_s = middle_m_s;
                }
            }
        }
        let peak_m_s = high_m_s;
        let (up, down) = changes(peak_m_s);
        let cruise_s = ((distance_m - needed_m(peak_m_s)) / peak_m_s).max(0.0);
        let (up_m_s3, down_m_s3) = (up.peak_m_s2 / up.jerk_s, down.peak_m_s2 / down.jerk_s);
        let phases = [
            (up.jerk_s, 0.0, up_m_s3),
            (up.constant_s, up.peak_m_s2, 0.0),
            (up.jerk_s, up.peak_m_s2, -up_m_s3),
            (cruise_s, 0.0, 0.0),
            (down.jerk_s, 0.0, -down_m_s3),
            (down.constant_s, -down.peak_m_s2, 0.0),
            (down.jerk_s, -down.peak_m_s2, down_m_s3),
        ];
        // A shorter phase than this is a rounding error, and too short to interpolate over.
        const SHORTEST_S: f64 = 1e-9;
        let mut knot = Knot::default();
        let mut knots = vec![knot];
        for (duration_s, start_m_s2, jerk_m_s3) in phases {
            if duration_s > SHORTEST_S {
                let t = duration_s;
                knot.distance_m += t * (knot.speed_m_s + t * (start_m_s2 / 2.0 + t * jerk_m_s3 / 6.0));
                knot.speed_m_s += t * (start_m_s2 + t * jerk_m_s3 / 2.0);
                knot.acceleration_m_s2 = start_m_s2 + t * jerk_m_s3;
                knot.time_s += t;
                knots.push(knot);
            }
        }
        // The end is exactly the end, whatever rounding has left.
        if let Some(last) = knots.last_mut() {
            *last = Knot { time_s: last.time_s, distance_m, ..Knot::default() };
        }
        Self { knots, speeding_s: up.duration_s(), braking_s: down.duration_s() }
    }

    /// The state at a time since the start; at rest before and after the motion.
    pub(crate) fn at(&self, time_s: f64) -> Knot {
        let next = self.knots.partition_point(|knot| knot.time_s <= time_s);
        let Some(after) = self.knots.get(next) else {
            return self.knots.last().map_or_else(Knot::default, |last| Knot { time_s, ..*last });
        };
        let Some(before) = next.checked_sub(1).map(|index| &self.knots[index]) else {
            return Knot { time_s, ..Knot::default() };
        };
        let jerk_m_s3 = (after.acceleration_m_s2 - before.acceleration_m_s2) / (after.time_s - before.time_s);
        let (t, a) = (time_s - before.time_s, before.acceleration_m_s2);
        Knot {
            time_s,
            distance_m: before.distance_m + t * (before.speed_m_s + t * (a / 2.0 + t * jerk_m_s3 / 6.0)),
            speed_m_s: before.speed_m_s + t * (a + t * jerk_m_s3 / 2.0),
            acceleration_m_s2: a + t * jerk_m_s3,
        }
    }

    pub(crate) fn duration_s(&self) -> f64 {
        self.knots.last().map_or(0.0, |knot| knot.time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::{LineLimits, Profile};
    use proptest::prelude::*;
    use rsruckig::prelude::*;

    /// Time of the symmetric motion without speed limit: T = A/J + √((A/J)² + 4 d/A) for d ≥ 2 A³/J², else 4 ∛(d/2J).
    fn symmetric_s(distance_m: f64, a: f64, j: f64) -> f64 {
        if distance_m >= 2.0 * a.powi(3) / (j * j) {
            a / j + ((a / j).powi(2) + 4.0 * distance_m / a).sqrt()
        } else {
            4.0 * (distance_m / (2.0 * j)).cbrt()
        }
    }

    proptest! {
        #[test]
        fn verif_symmetric_times_are_the_closed_form(d in 1e-4..1.0, a in 0.1..20.0, j in 10.0..5000.0) {
            let limits = LineLimits { speed_m_s: f64::INFINITY, acceleration_m_s2: a, braking_m_s2: a, jerk_m_s3: j };
            let expected_s = symmetric_s(d, a, j);
            // The peak speed is found to the last bit; the rest is rounding.
            prop_assert!((Profile::new(d, &limits).duration_s() - expected_s).abs() < 1e-12 * expected_s.max(1.0));
        }

        #[test]
        fn verif_no_faster_motion_is_found_by_an_independent_time_optimal_generator(
            d in 1e-3..1.0, up in 0.1..10.0, down in 0.1..10.0, v in 0.05..2.0, j in 10.0..1000.0,
        ) {
            let limits = LineLimits { speed_m_s: v, acceleration_m_s2: up, braking_m_s2: down, jerk_m_s3: j };
            let mut input = InputParameter::<1>::new(None);
            input.target_position[0] = d;
            input.max_velocity[0] = v;
            input.max_acceleration[0] = up;
            input.min_acceleration = Some(daov_stack![-down]);
            input.max_jerk[0] = j;
            let mut trajectory = rsruckig::prelude::Trajectory::<1>::new(None);
            Ruckig::<1, ThrowErrorHandler>::new(None, 0.01).calculate(&input, &mut trajectory).unwrap();
            // It solves polynomials to about 1e-9 s.
            let (ours_s, theirs_s) = (Profile::new(d, &limits).duration_s(), trajectory.get_duration());
            prop_assert!((ours_s - theirs_s).abs() < 1e-7, "{} against {}", ours_s, theirs_s);
        }

        #[test]
        fn knots_are_in_order_and_inside_the_limits(
            d in 1e-6..1.0, up in 0.1..10.0, down in 0.1..10.0, v in 0.05..2.0, j in 10.0..1000.0,
        ) {
            let limits = LineLimits { speed_m_s: v, acceleration_m_s2: up, braking_m_s2: down, jerk_m_s3: j };
            let knots = Profile::new(d, &limits).knots;
            prop_assert!(knots.windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
            for knot in knots {
                prop_assert!(knot.speed_m_s >= -1e-12 && knot.speed_m_s <= v * (1.0 + 1e-12));
                prop_assert!(knot.acceleration_m_s2 <= up * (1.0 + 1e-12));
                prop_assert!(knot.acceleration_m_s2 >= -down * (1.0 + 1e-12));
                prop_assert!(knot.distance_m >= 0.0 && knot.distance_m <= d * (1.0 + 1e-12));
            }
        }
    }
}
