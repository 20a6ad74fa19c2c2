//! The motions that are tried on parts that touch.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use anyhow::Result;
use feeder_control::courier::CourierLimits;
use feeder_model::motor::Load;
use feeder_model::waveform::{Axis, Waveform};
use nalgebra::{Rotation2, Vector2, Vector3};

use super::cluster::Cluster;
use super::motion::{Burst, Motion, Shape};

/// A motion by its name.
#[derive(Clone, Copy, Debug)]
pub(super) struct Primitive {
    pub(super) name: &'static str,
    kind: Kind,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// To and fro along x.
    Along { hz: f64 },
    /// Round in a circle without turning.
    Round { hz: f64 },
    /// To and fro about the tray's axis.
    Twist { hz: f64 },
    /// Both.
    TwistAlong { twist_hz: f64, along_hz: f64 },
    /// Stick-slip about the tray's axis, by turns forwards and backwards.
    ForthAndBack,
    /// Stick-slip about the middle of the cluster.
    About,
    /// By turns stick-slip about the tray's axis and straight back, so that the cluster stays where it is.
    FeedAndReturn,
    /// By turns stick-slip about two places to either side of the cluster, so far from it (m).
    Shear { distance_m: f64 },
}

/// The motions tried.
pub(super) const PRIMITIVES: &[Primitive] = &[
    Primitive { name: "along x, 5 Hz", kind: Kind::Along { hz: 5.0 } },
    Primitive { name: "along x, 10 Hz", kind: Kind::Along { hz: 10.0 } },
    Primitive { name: "along x, 20 Hz", kind: Kind::Along { hz: 20.0 } },
    Primitive { name: "round, 5 Hz", kind: Kind::Round { hz: 5.0 } },
    Primitive { name: "round, 10 Hz", kind: Kind::Round { hz: 10.0 } },
    Primitive { name: "twist, 5 Hz", kind: Kind::Twist { hz: 5.0 } },
    Primitive { name: "twist, 10 Hz", kind: Kind::Twist { hz: 10.0 } },
    Primitive { name: "twist, 15 Hz", kind: Kind::Twist { hz: 15.0 } },
    Primitive { name: "twist 10 Hz, along x 10 Hz", kind: Kind::TwistAlong { twist_hz: 10.0, along_hz: 10.0 } },
    Primitive { name: "twist 10 Hz, along x 7 Hz", kind: Kind::TwistAlong { twist_hz: 10.0, along_hz: 7.0 } },
    Primitive { name: "forth and back", kind: Kind::ForthAndBack },
    Primitive { name: "about the middle", kind: Kind::About },
    Primitive { name: "feed and return", kind: Kind::FeedAndReturn },
    Primitive { name: "shear, 60 mm", kind: Kind::Shear { distance_m: 0.06 } },
    Primitive { name: "shear, 120 mm", kind: Kind::Shear { distance_m: 0.12 } },
];

/// The smaller acceleration of stick-slip as a share of the larger.
const STICK_SHARE: f64 = 0.2;

/// Its period, s.
const STICK_SLIP_S: f64 = 0.12;

/// How long a burst of those lasts that come by turns, s.
const TURN_S: f64 = 1.0;

impl Primitive {
    /// The motion for a cluster, as strong as a courier with `limits` and `load` can make it.
    pub(super) fn motion(
        &self,
        cluster: &Cluster,
        duration_s: f64,
        limits: &CourierLimits,
        load: &Load,
    ) -> Result<Motion> {
        let motion = Motion { bursts: self.kind.bursts(cluster, duration_s)? };
        let share = motion.share_of(limits, load);
        // A hair's breadth is left to rounding.
        Ok(motion.scaled(0.999 / share))
    }
}

/// What turns the tray by 1 rad about a place, m and rad.
fn about(place_m: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(place_m.y, -place_m.x, 1.0)
}

/// A stick-slip of which only the shape counts.
fn stick_slip() -> Result<Shape> {
    Ok(Shape::Periodic(Waveform::stick_slip(Axis::Yaw, STICK_SLIP_S, STICK_SHARE, 1.0)?))
}

/// Two bursts by turns.
fn by_turns(shape: &Shape, axes: [Vector3<f64>; 2], duration_s: f64) -> Vec<Burst> {
    let mut bursts = Vec::new();
    let mut start_s = 0.0;
    while start_s + 0.5 * TURN_S < duration_s {
        let end_s = (start_s + TURN_S).min(duration_s);
        let axes = axes[bursts.len() % 2];
        bursts.push(Burst { shape: shape.clone(), axes, start_s, end_s, fades_s: [shape.period_s(); 2] });
        start_s = end_s;
    }
    bursts
}

impl Kind {
    fn bursts(self, cluster: &Cluster, duration_s: f64) -> Result<Vec<Burst>> {
        let steady = |shape, axes| Burst::faded(shape, axes, 0.0, duration_s);
        let sine = |frequency_hz: f64, phase_rad: f64| Shape::Sine { frequency_hz, phase_rad };
        let twist = |hz: f64, amount_rad: f64| steady(sine(hz, FRAC_PI_2), amount_rad * Vector3::z());
        let middle_m = cluster.middle_m;
        Ok(match self {
            Self::Along { hz } => vec![steady(sine(hz, 0.0), Vector3::x())],
            Self::Round { hz } => vec![steady(sine(hz, 0.0), Vector3::x()), steady(sine(hz, FRAC_PI_2), Vector3::y())],
            Self::Twist { hz } => vec![twist(hz, 1.0)],
            // Either takes its share of the motor: at the cluster they are about as strong.
            Self::TwistAlong { twist_hz, along_hz } => {
                let lever_m = middle_m.norm() * (twist_hz / along_hz).powi(2);
                vec![twist(twist_hz, 1.0), steady(sine(along_hz, 0.0), lever_m * Vector3::x())]
            }
            Self::ForthAndBack => by_turns(&stick_slip()?, [Vector3::z(), -Vector3::z()], duration_s),
            Self::About => vec![steady(stick_slip()?, about(middle_m))],
            Self::FeedAndReturn => {
                let back = Vector3::new(middle_m.y, -middle_m.x, 0.0);
                by_turns(&stick_slip()?, [Vector3::z(), back], duration_s)
            }
            Self::Shear { distance_m } => {
                // The flow stretches most at 45° to the line through both places.
                let aside_m = distance_m * (Rotation2::new(FRAC_PI_4) * cluster.along);
                by_turns(&stick_slip()?, [about(middle_m + aside_m), about(middle_m - aside_m)], duration_s)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bulk::SAMPLE_S;

    const CLUSTERS: [Cluster; 2] = [
        Cluster { middle_m: Vector2::new(0.01, -0.08), along: Vector2::new(0.6, -0.8) },
        Cluster { middle_m: Vector2::new(-0.05, -0.03), along: Vector2::new(1.0, 0.0) },
    ];

    #[test]
    fn every_motion_takes_all_that_the_courier_may_be_told_and_no_more() {
        let limits = CourierLimits::default();
        let load = Load { mass_kg: 0.1, inertia_kg_m2: 5e-4 };
        for (primitive, cluster) in PRIMITIVES.iter().flat_map(|primitive| CLUSTERS.iter().map(move |c| (primitive, c)))
        {
            let share = primitive.motion(cluster, 2.0, &limits, &load).unwrap().share_of(&limits, &load);
            assert!((0.99..=1.0).contains(&share), "{}: {share}", primitive.name);
        }
    }

    #[test]
    fn every_motion_ends_at_rest_where_it_began() {
        for (primitive, cluster) in PRIMITIVES.iter().flat_map(|primitive| CLUSTERS.iter().map(move |c| (primitive, c)))
        {
            let motion = primitive.motion(cluster, 2.0, &CourierLimits::default(), &Load::default()).unwrap();
            // By its accelerations alone, as the parts feel them.
            let (mut place, mut velocity) = (Vector3::zeros(), Vector3::zeros());
            let mut farthest: f64 = 0.0;
            for sample in (0..201).flat_map(|index| motion.block(index).samples) {
                place += velocity * SAMPLE_S + sample.acceleration * (0.5 * SAMPLE_S * SAMPLE_S);
                velocity += sample.acceleration * SAMPLE_S;
                farthest = farthest.max(place.norm());
            }
            assert!(velocity.norm() < 1e-9 && place.norm() < 1e-5, "{}: {velocity} {place}", primitive.name);
            assert!(farthest > 1e-4, "{}", primitive.name);
        }
    }

    #[test]
    fn what_turns_about_a_place_leaves_it_where_it_is() {
        let place_m = Vector2::new(0.03, -0.07);
        let turned_rad = 1e-3;
        let moved = turned_rad * about(place_m);
        let place_on_platen_m = moved.xy() + Rotation2::new(moved.z) * place_m;
        assert!((place_on_platen_m - place_m).norm() < 1e-7);
    }
}
