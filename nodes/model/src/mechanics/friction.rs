//! The law of dry friction. It stands here and nowhere else: slope, annulus, bulk, the courier's sliding load and the
//! planner of gentle moves all ask this module.
//!
//! Coulomb friction between a body and a surface that press against each other with a normal force N per mass: at rest it
//! takes whatever drives the body, up to μ_s N; on a sliding body it acts against the motion with μ_k N.
//!
//! Vectors have one component for each direction in which the body may slide. A body that may also turn has its turning
//! as one more, the turning rate times the radius of gyration: friction acts against the vector as a whole, as if its
//! lever arm against turning were that radius (an ellipsoidal limit surface after Howe and Cutkosky 1996, with this one
//! assumption: for a disc of even pressure the arm is 0.67 and the radius of gyration 0.71 of the radius).
//!
//! The rule of rounding: a body is at rest if its velocity is exactly zero, no speed is ever taken for zero; and the
//! largest friction at rest counts as larger by a share of 10⁻¹², so that a body driven exactly at the limit stays.

use std::array::from_fn;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::range::OutOfRange;

/// Share of the largest friction at rest that is taken for rounding.
const REST_ROUNDING: f64 = 1e-12;

/// What becomes of a body whose motion along its old direction ends within a step while the drive has begun to move it
/// across. With fine steps there is no difference; with coarse ones each suits one kind of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Swerve {
    /// It stays if friction holds the drive: for motion that all but keeps to a line, which a step then solves at any length.
    Neglected,
    /// It stays if friction can also take up what moves it across within the rest of the step: for any motion.
    Followed,
}

/// Coulomb friction between part and tray.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Coefficients", into = "Coefficients")]
pub struct Friction {
    at_rest: f64,
    sliding: f64,
}

/// Friction as it stands in a file.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Coefficients {
    /// Coefficient of static friction.
    #[serde(rename = "static")]
    at_rest: f64,
    /// Coefficient of kinetic friction.
    kinetic: f64,
}

impl TryFrom<Coefficients> for Friction {
    type Error = OutOfRange;

    fn try_from(raw: Coefficients) -> Result<Self, OutOfRange> {
        Self::new(raw.at_rest, raw.kinetic)
    }
}

impl From<Friction> for Coefficients {
    fn from(friction: Friction) -> Self {
        Self { at_rest: friction.at_rest, kinetic: friction.sliding }
    }
}

impl Friction {
    /// Friction with coefficients μ_s at rest and μ_k while sliding.
    ///
    /// # Errors
    ///
    /// Unless 0 < μ_k ≤ μ_s, both finite.
    pub fn new(static_coefficient: f64, kinetic_coefficient: f64) -> Result<Self, OutOfRange> {
        OutOfRange::unless_positive("friction_kinetic", kinetic_coefficient)?;
        OutOfRange::unless(
            static_coefficient >= kinetic_coefficient,
            "friction_static",
            static_coefficient,
            format_args!("at least friction_kinetic = {kinetic_coefficient}, and finite"),
        )?;
        Ok(Self { at_rest: static_coefficient, sliding: kinetic_coefficient })
    }

    /// The paper's friction, one coefficient μ for rest and sliding.
    ///
    /// # Errors
    ///
    /// Unless μ is positive and finite.
    pub fn uniform(coefficient: f64) -> Result<Self, OutOfRange> {
        OutOfRange::unless_positive("friction", coefficient)?;
        Self::new(coefficient, coefficient)
    }

    /// μ_s.
    #[must_use]
    pub fn static_coefficient(&self) -> f64 {
        self.at_rest
    }

    /// μ_k.
    #[must_use]
    pub fn kinetic_coefficient(&self) -> f64 {
        self.sliding
    }

    /// What friction can do under a normal force per mass of `normal_m_s2`, which must not be negative.
    #[must_use]
    pub fn grip(&self, normal_m_s2: f64) -> Grip {
        Grip {
            at_rest_m_s2: self.at_rest * normal_m_s2 * (1.0 + REST_ROUNDING),
            sliding_m_s2: self.sliding * normal_m_s2,
        }
    }
}

/// What friction can do to a body that is pressed against a surface, per mass of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grip {
    /// Largest friction at rest, m/s².
    at_rest_m_s2: f64,
    /// Friction while sliding, m/s².
    sliding_m_s2: f64,
}

/// What a step left of a sliding motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide<const N: usize> {
    /// Velocity relative to the surface at the end, m/s; exactly zero if friction stopped the body.
    pub velocity_m_s: [f64; N],
    /// Displacement relative to the surface, m.
    pub displacement_m: [f64; N],
}

impl<const N: usize> Slide<N> {
    const REST: Self = Self { velocity_m_s: [0.0; N], displacement_m: [0.0; N] };

    /// Whether the body is at rest on the surface at the end.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        self.velocity_m_s.iter().all(|component| component.abs() == 0.0)
    }
}

impl Grip {
    /// Friction that holds and drags alike, with `limit_m_s2` (m/s²) at most.
    #[must_use]
    pub fn uniform(limit_m_s2: f64) -> Self {
        Self { at_rest_m_s2: limit_m_s2 * (1.0 + REST_ROUNDING), sliding_m_s2: limit_m_s2 }
    }

    /// Whether friction keeps a body at rest that `drive_m_s2` would accelerate.
    #[must_use]
    #[inline]
    pub fn holds<const N: usize>(&self, drive_m_s2: [f64; N]) -> bool {
        dot(drive_m_s2, drive_m_s2) <= self.at_rest_m_s2 * self.at_rest_m_s2
    }

    /// Acceleration of a body that slides along the unit vector `heading` while `drive_m_s2` acts on it, m/s².
    #[must_use]
    pub fn sliding_m_s2<const N: usize>(&self, drive_m_s2: [f64; N], heading: [f64; N]) -> [f64; N] {
        from_fn(|i| drive_m_s2[i] - self.sliding_m_s2 * heading[i])
    }

    /// Acceleration of a body at rest while `drive_m_s2` acts on it, m/s²: zero where friction holds it.
    #[must_use]
    pub fn from_rest_m_s2<const N: usize>(&self, drive_m_s2: [f64; N]) -> [f64; N] {
        if self.holds(drive_m_s2) {
            return [0.0; N];
        }
        let strength = norm(drive_m_s2);
        self.sliding_m_s2(drive_m_s2, drive_m_s2.map(|component| component / strength))
    }

    /// Advances a body by `step_s` under a constant drive.
    ///
    /// `velocity_m_s` is relative to the surface, `drive_m_s2` what accelerates the body relative to the surface but for
    /// friction.
    ///
    /// Friction turns round within a step where the body does: the step is split at the instant the motion along the old
    /// direction ends. Whether the body stays there is for friction at rest to say, and for `swerve` where the drive has begun to move it across.
    /// Where all vectors are parallel, the result is the closed-form solution; else friction acts along the velocity it
    /// leaves (backward Euler), so it never does positive work: the change of kinetic energy minus the work of the drive
    /// over the displacement is at most zero.
    #[must_use]
    #[inline]
    pub fn slide<const N: usize>(
        &self,
        velocity_m_s: [f64; N],
        drive_m_s2: [f64; N],
        step_s: f64,
        swerve: Swerve,
    ) -> Slide<N> {
        let speed = norm(velocity_m_s);
        if speed == 0.0 {
            return if self.holds(drive_m_s2) { Slide::REST } else { self.coast(velocity_m_s, drive_m_s2, step_s) };
        }
        let along = dot(drive_m_s2, velocity_m_s) / speed;
        let braking = self.sliding_m_s2 - along;
        if braking * step_s < speed {
            return self.coast(velocity_m_s, drive_m_s2, step_s);
        }
        let until_turn_s = speed / braking;
        let rest_s = step_s - until_turn_s;
        // What the drive across the old direction has built up meanwhile; zero in one dimension.
        let across: [f64; N] = from_fn(|i| (drive_m_s2[i] - along * velocity_m_s[i] / speed) * until_turn_s);
        let before_turn: [f64; N] = from_fn(|i| 0.5 * (velocity_m_s[i] + across[i]) * until_turn_s);
        let stays = match swerve {
            Swerve::Neglected => self.holds(drive_m_s2),
            Swerve::Followed => {
                let impulse_needed: [f64; N] = from_fn(|i| across[i] + drive_m_s2[i] * rest_s);
                norm(impulse_needed) <= self.at_rest_m_s2 * rest_s
            }
        };
        let after = if stays { Slide::REST } else { self.coast(across, drive_m_s2, rest_s) };
        Slide {
            velocity_m_s: after.velocity_m_s,
            displacement_m: from_fn(|i| before_turn[i] + after.displacement_m[i]),
        }
    }

    /// Friction of a sliding body, against its final velocity, without a turn.
    #[inline]
    fn coast<const N: usize>(&self, velocity_m_s: [f64; N], drive_m_s2: [f64; N], step_s: f64) -> Slide<N> {
        let free: [f64; N] = from_fn(|i| velocity_m_s[i] + drive_m_s2[i] * step_s);
        let kept = (1.0 - self.sliding_m_s2 * step_s / norm(free)).max(0.0);
        let end = free.map(|component| component * kept);
        Slide { velocity_m_s: end, displacement_m: from_fn(|i| 0.5 * (velocity_m_s[i] + end[i]) * step_s) }
    }
}

/// A quantity that changes in proportion to the acceleration a of what carries a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine<T> {
    /// Its value at a = 0.
    pub at_zero: T,
    /// By how much it changes for each m/s² of a.
    pub per_m_s2: T,
}

/// The largest a, m/s², up to which friction of the static coefficient `friction` holds a body that `drive` accelerates
/// under the normal force per mass `normal`; `None` if it does not even at a = 0. Infinite if a may be any.
#[must_use]
pub fn held_up_to_m_s2<const N: usize>(friction: f64, drive: &Affine<[f64; N]>, normal: &Affine<f64>) -> Option<f64> {
    // |drive|² ≤ (μ normal)², sorted by powers of a.
    let limit = Affine { at_zero: friction * normal.at_zero, per_m_s2: friction * normal.per_m_s2 };
    let square = dot(drive.per_m_s2, drive.per_m_s2) - limit.per_m_s2 * limit.per_m_s2;
    let linear = 2.0 * (dot(drive.at_zero, drive.per_m_s2) - limit.at_zero * limit.per_m_s2);
    let constant = dot(drive.at_zero, drive.at_zero) - limit.at_zero * limit.at_zero;
    if constant > 0.0 {
        return None;
    }
    // The smallest positive root, in the form without cancellation.
    let discriminant = linear * linear - 4.0 * square * constant;
    let denominator = linear + discriminant.max(0.0).sqrt();
    let bounded = discriminant >= 0.0 && denominator > 0.0;
    Some(if bounded { -2.0 * constant / denominator } else { f64::INFINITY })
}

#[inline]
fn dot<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

#[inline]
fn norm<const N: usize>(a: [f64; N]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn grip(at_rest_m_s2: f64, sliding_m_s2: f64) -> Grip {
        Grip { at_rest_m_s2, sliding_m_s2 }
    }

    #[test]
    fn friction_is_positive_and_static_at_least_kinetic() {
        for (at_rest, sliding, key) in [
            (0.1, 0.2, "friction_static"),
            (0.2, 0.0, "friction_kinetic"),
            (f64::NAN, 0.2, "friction_static"),
            (0.2, f64::NAN, "friction_kinetic"),
        ] {
            assert_eq!(Friction::new(at_rest, sliding).unwrap_err().parameter, key);
        }
        assert!(Friction::uniform(-0.2).is_err());
        assert_eq!(Friction::uniform(0.2), Friction::new(0.2, 0.2));
    }

    #[test]
    fn the_static_window_is_closed_and_tried_at_exactly_zero() {
        assert_eq!(grip(2.0, 1.0).slide([0.0; 2], [1.2, 1.6], 1e-3, Swerve::Followed), Slide::REST);
        let started = grip(2.0, 1.0).slide([0.0; 2], [1.2, 1.7], 1e-3, Swerve::Followed);
        assert!(started.velocity_m_s[0] > 0.0);
        // Kinetic, not static friction holds it back once it moves: |drive| − 1.
        let speed = norm(started.velocity_m_s);
        assert!((speed - (1.2_f64.hypot(1.7) - 1.0) * 1e-3).abs() < 1e-15);
        // A speed of 1 nm/s is not zero: within the static window it still slides until friction has stopped it.
        let creeping = grip(2.0, 1.0).slide([1e-9, 0.0], [1.5, 0.0], 1e-3, Swerve::Followed);
        assert!((creeping.velocity_m_s[0] - (1e-9 + 0.5e-3)).abs() < 1e-15);
    }

    #[test]
    fn at_the_limit_of_static_friction_rounding_decides_for_rest() {
        let friction = Friction::new(0.3, 0.1).unwrap();
        for normal_m_s2 in [9.81, 7.3, 1e-3] {
            let grip = friction.grip(normal_m_s2);
            assert!(
                grip.holds([0.3 * normal_m_s2 * (1.0 + 1e-13)]) && !grip.holds([0.3 * normal_m_s2 * (1.0 + 1e-11)])
            );
        }
        let stopped = friction.grip(10.0).slide([1e-3], [-3.0], 1e-3, Swerve::Followed);
        assert!(stopped.at_rest(), "{stopped:?}");
    }

    #[test]
    fn friction_from_rest_is_static_up_to_its_limit_and_kinetic_beyond() {
        for (got, expected) in [
            (grip(2.0, 1.0).from_rest_m_s2([-2.0]), 0.0),
            (grip(2.0, 1.0).from_rest_m_s2([-2.5]), -1.5),
            (grip(2.0, 1.0).sliding_m_s2([-2.5], [1.0]), -3.5),
        ] {
            assert!((got[0] - expected).abs() < 1e-15, "{got:?} {expected}");
        }
    }

    #[test]
    fn verif_one_dimension_is_the_closed_form() {
        // Slides at 1 mm/s against drive −3 and grip 1: stops after 0.25 ms, then is driven back at −2 for 0.75 ms.
        let turned = grip(1.0, 1.0).slide([1e-3, 0.0], [-3.0, 0.0], 1e-3, Swerve::Followed);
        assert!((turned.velocity_m_s[0] + 1.5e-3).abs() < 1e-15);
        let expected = 0.5 * 1e-3 * 0.25e-3 - 0.5 * 2.0 * 0.75e-3 * 0.75e-3;
        assert!((turned.displacement_m[0] - expected).abs() < 1e-18);
        // Within the window it stays where it stopped.
        let stopped = grip(1.0, 1.0).slide([1e-3, 0.0], [-1.0, 0.0], 1e-3, Swerve::Followed);
        assert!(stopped.at_rest());
        assert!((stopped.displacement_m[0] - 0.5 * 1e-3 * 0.5e-3).abs() < 1e-18);
    }

    #[test]
    fn a_turn_tries_the_static_window() {
        // Between the kinetic grip of 1 and the static one of 2, a body that comes to a stop stays there.
        assert!(grip(2.0, 1.0).slide([1e-3, 0.0], [-1.5, 0.0], 1e-3, Swerve::Followed).at_rest());
        // But not while it still moves across: 0.95 mm/s built up in the 0.5 ms before the turn.
        let swerved = grip(2.0, 2.0).slide([1e-3, 0.0], [0.0, 1.9], 0.51e-3, Swerve::Followed);
        assert!(swerved.velocity_m_s[1] > 0.9e-3);
    }

    #[test]
    fn verif_a_skewed_stop_takes_the_time_of_the_exact_solution() {
        // For a constant drive d below the grip G the exact stopping time is (G |w| + w·d)/(G² − d²).
        let (velocity, drive, strength) = ([0.02, 0.01], [-0.3, 0.7], 2.0);
        let exact = (strength * norm(velocity) + dot(velocity, drive)) / (strength * strength - dot(drive, drive));
        let stopping_time = |step_s: f64| {
            let mut w = velocity;
            let mut time_s = 0.0;
            while norm(w) > 0.0 {
                w = grip(strength, strength).slide(w, drive, step_s, Swerve::Followed).velocity_m_s;
                time_s += step_s;
            }
            time_s
        };
        for step_s in [5e-4, 1e-4, 1e-5] {
            // Two steps: one for the rounding up to whole steps, one for the direction of friction.
            assert!((stopping_time(step_s) - exact).abs() <= 2.0 * step_s);
        }
    }

    #[test]
    fn what_friction_holds_ends_where_the_body_starts_to_slide() {
        let (drive, normal) =
            (Affine { at_zero: [-0.5, 0.2], per_m_s2: [0.3, -1.0] }, Affine { at_zero: 9.7, per_m_s2: -0.1 });
        let a = held_up_to_m_s2(0.2, &drive, &normal).unwrap();
        let holds = |a: f64| {
            let grip = Friction::uniform(0.2).unwrap().grip(normal.at_zero + a * normal.per_m_s2);
            grip.holds::<2>(from_fn(|i| drive.at_zero[i] + a * drive.per_m_s2[i]))
        };
        assert!(holds(a * (1.0 - 1e-9)) && !holds(a * (1.0 + 1e-9)), "{a}");
        assert_eq!(held_up_to_m_s2(0.05, &drive, &normal), None);
        let pressing = Affine { at_zero: 9.81, per_m_s2: 1.0 };
        let pushed = Affine { at_zero: [0.0], per_m_s2: [0.1] };
        assert_eq!(held_up_to_m_s2(0.2, &pushed, &pressing), Some(f64::INFINITY));
    }

    proptest! {
        #[test]
        fn friction_never_adds_energy(
            w in prop::array::uniform3(-1.0..1.0_f64),
            d in prop::array::uniform3(-50.0..50.0_f64),
            kinetic in 0.0..10.0_f64,
            extra in 0.0..5.0_f64,
            step_s in 1e-6..5e-3_f64,
        ) {
            let slid = grip(kinetic + extra, kinetic).slide(w, d, step_s, Swerve::Followed);
            let gained = 0.5 * (dot(slid.velocity_m_s, slid.velocity_m_s) - dot(w, w));
            let friction_work = gained - dot(d, slid.displacement_m);
            prop_assert!(friction_work <= 1e-13, "friction did {friction_work} J/kg");
        }

        #[test]
        fn a_body_at_rest_within_the_window_stays(
            angle in 0.0..std::f64::consts::TAU,
            share in 0.0..0.999_f64,
            strength in 0.1..10.0_f64,
        ) {
            let drive = [share * strength * angle.cos(), share * strength * angle.sin()];
            prop_assert_eq!(grip(strength, strength / 2.0).slide([0.0; 2], drive, 5e-4, Swerve::Followed), Slide::REST);
        }

        #[test]
        fn sliding_has_no_handedness(
            w in prop::array::uniform2(-0.5..0.5_f64), d in prop::array::uniform2(-20.0..20.0_f64), sliding in 0.0..10.0_f64,
        ) {
            let grip = grip(sliding, sliding);
            let one = grip.slide(w, d, 5e-4, Swerve::Followed).velocity_m_s;
            let other = grip.slide([w[0], -w[1]], [d[0], -d[1]], 5e-4, Swerve::Followed).velocity_m_s;
            prop_assert!(norm([one[0] - other[0], one[1] + other[1]]) < 1e-15);
        }
    }
}
