//! Dry friction over one step of constant drive, in the plane of the surface.
//!
//! Vectors have the two directions of the plane and, for a body that may turn, its turning as a third: the turning rate
//! times the radius of gyration. Friction acts against the vector as a whole, as if its lever arm against turning were
//! that radius (an ellipsoidal limit surface after Howe and Cutkosky 1996, with this one assumption: for a disc of even
//! pressure the arm is 0.67 and the radius of gyration 0.71 of the radius).

use std::array::from_fn;

/// What a step left of a sliding motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slide<const N: usize> {
    /// Velocity relative to the surface at the end, m/s; exactly zero if friction stopped the part.
    pub(super) velocity: [f64; N],
    /// Displacement relative to the surface, m.
    pub(super) displacement: [f64; N],
}

impl<const N: usize> Slide<N> {
    const REST: Self = Self { velocity: [0.0; N], displacement: [0.0; N] };
}

/// Advances a body under Coulomb friction by `step_s`.
///
/// `velocity` is relative to the surface (m/s) and `drive` is what accelerates the body relative to the surface but for
/// friction (m/s², constant over the step). `grip_static` and `grip_kinetic` are μ_s and μ_k times the normal force per
/// mass (m/s²).
///
/// The body sticks if its relative velocity is exactly zero and the drive is within the static grip; no speed is ever
/// taken for zero. Friction turns round within a step where the body does: the step is split at the instant the motion
/// along the old direction ends, and the static window is tried there. Where all vectors are parallel, the result is
/// the closed-form solution; else friction acts along the velocity it leaves (backward Euler), so it never does
/// positive work: the change of kinetic energy minus the work of the drive over the displacement is at most zero.
pub(super) fn slide<const N: usize>(
    velocity: [f64; N],
    drive: [f64; N],
    grip_static: f64,
    grip_kinetic: f64,
    step_s: f64,
) -> Slide<N> {
    let speed = dot(velocity, velocity).sqrt();
    if speed == 0.0 {
        if dot(drive, drive) <= grip_static * grip_static {
            return Slide::REST;
        }
        return coast(velocity, drive, grip_kinetic, step_s);
    }
    let along = dot(drive, velocity) / speed;
    let braking = grip_kinetic - along;
    if braking * step_s < speed {
        return coast(velocity, drive, grip_kinetic, step_s);
    }
    let until_turn_s = speed / braking;
    let rest_s = step_s - until_turn_s;
    // What the drive across the old direction has built up meanwhile; zero in one dimension.
    let across: [f64; N] = from_fn(|i| (drive[i] - along * velocity[i] / speed) * until_turn_s);
    let before_turn: [f64; N] = from_fn(|i| 0.5 * (velocity[i] + across[i]) * until_turn_s);
    let impulse_needed: [f64; N] = from_fn(|i| across[i] + drive[i] * rest_s);
    let after = if norm(impulse_needed) <= grip_static * rest_s {
        Slide::REST
    } else {
        coast(across, drive, grip_kinetic, rest_s)
    };
    Slide { velocity: after.velocity, displacement: from_fn(|i| before_turn[i] + after.displacement[i]) }
}

/// Kinetic friction against the final velocity, without a turn.
fn coast<const N: usize>(velocity: [f64; N], drive: [f64; N], grip_kinetic: f64, step_s: f64) -> Slide<N> {
    let free: [f64; N] = from_fn(|i| velocity[i] + drive[i] * step_s);
    let kept = (1.0 - grip_kinetic * step_s / norm(free)).max(0.0);
    let end = free.map(|component| component * kept);
    Slide { velocity: end, displacement: from_fn(|i| 0.5 * (velocity[i] + end[i]) * step_s) }
}

fn dot<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

fn norm<const N: usize>(a: [f64; N]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_static_window_is_closed_and_tried_at_exactly_zero() {
        assert_eq!(slide([0.0; 2], [1.2, 1.6], 2.0, 1.0, 1e-3), Slide::REST);
        let started = slide([0.0; 2], [1.2, 1.7], 2.0, 1.0, 1e-3);
        assert!(started.velocity[0] > 0.0);
        // Kinetic, not static friction holds it back once it moves: |drive| − 1.
        let speed = norm(started.velocity);
        assert!((speed - (1.2_f64.hypot(1.7) - 1.0) * 1e-3).abs() < 1e-15);
        // A speed of 1 nm/s is not zero: within the static window it still slides until friction has stopped it.
        let creeping = slide([1e-9, 0.0], [1.5, 0.0], 2.0, 1.0, 1e-3);
        assert!((creeping.velocity[0] - (1e-9 + 0.5e-3)).abs() < 1e-15);
    }

    #[test]
    fn verif_one_dimension_is_the_closed_form() {
        // Slides at 1 mm/s against drive −3 and grip 1: stops after 0.25 ms, then is driven back at −2 for 0.75 ms.
        let turned = slide([1e-3, 0.0], [-3.0, 0.0], 1.0, 1.0, 1e-3);
        assert!((turned.velocity[0] + 1.5e-3).abs() < 1e-15);
        let expected = 0.5 * 1e-3 * 0.25e-3 - 0.5 * 2.0 * 0.75e-3 * 0.75e-3;
        assert!((turned.displacement[0] - expected).abs() < 1e-18);
        // Within the window it stays where it stopped.
        let stopped = slide([1e-3, 0.0], [-1.0, 0.0], 1.0, 1.0, 1e-3);
        assert!(norm(stopped.velocity) <= 0.0);
        assert!((stopped.displacement[0] - 0.5 * 1e-3 * 0.5e-3).abs() < 1e-18);
    }

    #[test]
    fn a_turn_tries_the_static_window() {
        // Between the kinetic grip of 1 and the static one of 2, a body that comes to a stop stays there.
        let stopped = slide([1e-3, 0.0], [-1.5, 0.0], 2.0, 1.0, 1e-3);
        assert!(norm(stopped.velocity) <= 0.0);
        // But not while it still moves across: 0.95 mm/s built up in the 0.5 ms before the turn.
        let swerved = slide([1e-3, 0.0], [0.0, 1.9], 2.0, 2.0, 0.51e-3);
        assert!(swerved.velocity[1] > 0.9e-3);
    }

    #[test]
    fn verif_a_skewed_stop_takes_the_time_of_the_exact_solution() {
        // For a constant drive d below the grip G the exact stopping time is (G |w| + w·d)/(G² − d²).
        let (velocity, drive, grip) = ([0.02, 0.01], [-0.3, 0.7], 2.0);
        let exact = (grip * norm(velocity) + dot(velocity, drive)) / (grip * grip - dot(drive, drive));
        let stopping_time = |step_s: f64| {
            let mut w = velocity;
            let mut time_s = 0.0;
            while norm(w) > 0.0 {
                w = slide(w, drive, grip, grip, step_s).velocity;
                time_s += step_s;
            }
            time_s
        };
        for step_s in [5e-4, 1e-4, 1e-5] {
            // Two steps: one for the rounding up to whole steps, one for the direction of friction.
            assert!((stopping_time(step_s) - exact).abs() <= 2.0 * step_s);
        }
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
            let slid = slide(w, d, kinetic + extra, kinetic, step_s);
            let gained = 0.5 * (dot(slid.velocity, slid.velocity) - dot(w, w));
            let friction_work = gained - dot(d, slid.displacement);
            prop_assert!(friction_work <= 1e-13, "friction did {friction_work} J/kg");
        }

        #[test]
        fn a_body_at_rest_within_the_window_stays(
            angle in 0.0..std::f64::consts::TAU,
            share in 0.0..0.999_f64,
            grip in 0.1..10.0_f64,
        ) {
            let drive = [share * grip * angle.cos(), share * grip * angle.sin()];
            prop_assert_eq!(slide([0.0; 2], drive, grip, grip / 2.0, 5e-4), Slide::REST);
        }
    }
}
