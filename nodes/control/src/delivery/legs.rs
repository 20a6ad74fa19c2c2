//! A path of straight legs as one motion: neighbouring legs overlap in time, so that corners are rounded, not stopped at.
//!
//! The motion is the sum of the legs' rest-to-rest motions. While one leg brakes and the next speeds up, their
//! accelerations add up; legs are planned such that the sum stays within what friction holds (`plan`), and its jerk
//! within the limit. As the sum of motions of piecewise constant jerk is one too, interpolating its knots is exact.

use nalgebra::{Vector2, Vector3};

use super::profile::Profile;
use super::surroundings::{Surroundings, distance_to_line_m};
use crate::courier::TrajectoryPoint;

/// A straight leg in (x, y, yaw).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Leg {
    /// From its start to its end: m, m and rad.
    pub(super) step: Vector3<f64>,
    /// What the profile's distance is at its end, m.
    pub(super) length_m: f64,
    pub(super) profile: Profile,
}

/// Position, velocity and acceleration.
type State = (Vector3<f64>, Vector3<f64>, Vector3<f64>);

/// A motion along legs.
#[derive(Clone, Debug)]
pub(super) struct Motion<'a> {
    from: Vector3<f64>,
    legs: &'a [Leg],
    /// When each leg starts, s.
    starts_s: Vec<f64>,
}

/// Two knots nearer than this are one, s.
const SAME_S: f64 = 1e-9;

impl<'a> Motion<'a> {
    /// The legs one after the other, overlapping at each corner by a share of the time in which one brakes and the other
    /// speeds up.
    fn overlapping(from: Vector3<f64>, legs: &'a [Leg], shares: &[f64]) -> Self {
        let mut starts_s = vec![0.0];
        for (index, pair) in legs.windows(2).enumerate() {
            let (before, after) = (&pair[0].profile, &pair[1].profile);
            let overlap_s = shares[index] * before.braking_s.min(after.speeding_s);
            starts_s.push(starts_s[index] + before.duration_s() - overlap_s);
        }
        Self { from, legs, starts_s }
    }

    /// The quickest such motion that stays within the corner distance of its route and clear of all areas.
    pub(super) fn rounded(
        from: Vector3<f64>,
        legs: &'a [Leg],
        route_m: &[Vector2<f64>],
        around: &Surroundings,
    ) -> Self {
        const SHARES: [f64; 5] = [1.0, 0.75, 0.5, 0.25, 0.0];
        let mut shares = vec![0.0; legs.len().saturating_sub(1)];
        for corner in 0..shares.len() {
            for share in SHARES {
                shares[corner] = share;
                let motion = Self::overlapping(from, legs, &shares);
                if share <= 0.0 || motion.keeps_to(corner, route_m, around) {
                    break;
                }
            }
        }
        Self::overlapping(from, legs, &shares)
    }

    /// Whether the motion about a corner stays near the route and out of keep-out areas.
    fn keeps_to(&self, corner: usize, route_m: &[Vector2<f64>], around: &Surroundings) -> bool {
        const SAMPLES: u32 = 32;
        let end_s = self.starts_s[corner] + self.legs[corner].profile.duration_s();
        let start_s = self.starts_s[corner + 1];
        (0..=SAMPLES).all(|index| {
            let time_s = start_s + (end_s - start_s) * f64::from(index) / f64::from(SAMPLES);
            let center_m = self.at(time_s).0.xy();
            distance_to_line_m(&center_m, route_m) <= around.corner_m && around.clearance_m(&center_m) >= 0.0
        })
    }

    pub(super) fn at(&self, time_s: f64) -> State {
        let rest = (self.from, Vector3::zeros(), Vector3::zeros());
        self.legs.iter().zip(&self.starts_s).fold(rest, |(position, velocity, acceleration), (leg, start_s)| {
            let direction = leg.step / leg.length_m;
            let knot = leg.profile.at(time_s - start_s);
            (
                position + direction * knot.distance_m,
                velocity + direction * knot.speed_m_s,
                acceleration + direction * knot.acceleration_m_s2,
            )
        })
    }

    /// The states at which the jerk changes, slowed down as a whole where legs that overlap would exceed the speed.
    pub(super) fn points(&self, speed_m_s_max: f64) -> Vec<TrajectoryPoint> {
        let knots = self.legs.iter().zip(&self.starts_s);
        let mut times_s: Vec<f64> =
            knots.flat_map(|(leg, start_s)| leg.profile.knots.iter().map(move |knot| start_s + knot.time_s)).collect();
        times_s.sort_by(f64::total_cmp);
        times_s.dedup_by(|later, earlier| *later - *earlier < SAME_S);
        let between = times_s.windows(2).flat_map(|pair| [pair[0], 0.5 * (pair[0] + pair[1])]);
        let fastest_m_s = between.map(|time_s| self.at(time_s).1.xy().norm()).fold(0.0, f64::max);
        let slower = (fastest_m_s / speed_m_s_max).max(1.0);
        times_s
            .into_iter()
            .map(|time_s| {
                let (position, velocity, acceleration) = self.at(time_s);
                TrajectoryPoint {
                    time_s: time_s * slower,
                    position,
                    velocity: Some(velocity / slower),
                    acceleration: Some(acceleration / (slower * slower)),
                }
            })
            .collect()
    }
}
