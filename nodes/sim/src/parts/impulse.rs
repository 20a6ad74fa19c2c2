//! Impacts with friction between parts of equal mass, and on what stands still.

use super::Part;
use super::body::{Body, cross, dot};

/// How two things touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactLaw {
    pub(super) restitution: f64,
    pub(super) friction: f64,
}

/// A part that may be pushed at a point.
struct Pushed<'a> {
    part: &'a mut Part,
    arm: [f64; 2],
    /// Turning rate per torque on a unit mass, 1/m².
    per_gyration_squared: f64,
}

impl<'a> Pushed<'a> {
    fn new(part: &'a mut Part, body: &Body, point: [f64; 2]) -> Self {
        let arm = [point[0] - part.x_m, point[1] - part.y_m];
        Self { part, arm, per_gyration_squared: 1.0 / (body.gyration_m * body.gyration_m) }
    }

    /// Velocity of the point along `direction`, m/s.
    fn velocity(&self, direction: [f64; 2]) -> f64 {
        dot([self.part.velocity_x_m_s, self.part.velocity_y_m_s], direction)
            + self.part.yaw_rate_rad_s * cross(self.arm, direction)
    }

    /// Change of that velocity by an impulse of 1 m/s along `direction`.
    fn response(&self, direction: [f64; 2]) -> f64 {
        1.0 + cross(self.arm, direction).powi(2) * self.per_gyration_squared
    }

    fn push(&mut self, direction: [f64; 2], impulse: f64) {
        self.part.velocity_x_m_s += impulse * direction[0];
        self.part.velocity_y_m_s += impulse * direction[1];
        self.part.yaw_rate_rad_s += impulse * cross(self.arm, direction) * self.per_gyration_squared;
    }
}

/// Impact of two parts at a point, `normal` from the first to the second: first what keeps them apart, then friction, at
/// most what ends the sliding. Neither adds energy. Returns whether they approached each other.
pub(super) fn collide(
    (first_body, first): (&Body, &mut Part),
    (second_body, second): (&Body, &mut Part),
    normal: [f64; 2],
    point: [f64; 2],
    law: ContactLaw,
) -> bool {
    let mut a = Pushed::new(first, first_body, point);
    let mut b = Pushed::new(second, second_body, point);
    let approach = a.velocity(normal) - b.velocity(normal);
    if approach <= 0.0 {
        return false;
    }
    let impulse = (1.0 + law.restitution) * approach / (a.response(normal) + b.response(normal));
    a.push(normal, -impulse);
    b.push(normal, impulse);
    let along = [-normal[1], normal[0]];
    let sliding = a.velocity(along) - b.velocity(along);
    let grip = law.friction * impulse;
    let lost = (sliding / (a.response(along) + b.response(along))).clamp(-grip, grip);
    a.push(along, -lost);
    b.push(along, lost);
    true
}

/// Impact of a part at a point on something fixed, `normal` into the part.
pub(super) fn bounce(body: &Body, part: &mut Part, normal: [f64; 2], point: [f64; 2], law: ContactLaw) {
    let mut pushed = Pushed::new(part, body, point);
    let approach = -pushed.velocity(normal);
    if approach <= 0.0 {
        return;
    }
    let impulse = (1.0 + law.restitution) * approach / pushed.response(normal);
    pushed.push(normal, impulse);
    let along = [-normal[1], normal[0]];
    let grip = law.friction * impulse;
    let lost = (pushed.velocity(along) / pushed.response(along)).clamp(-grip, grip);
    pushed.push(along, -lost);
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use proptest::prelude::*;

    use super::*;
    use crate::parts::Place;
    use crate::parts::tests::{block, disc, part_at};

    fn law(restitution: f64, friction: f64) -> ContactLaw {
        ContactLaw { restitution, friction }
    }

    fn moving(x_m: f64, velocity: [f64; 2], yaw_rate_rad_s: f64) -> Part {
        let [velocity_x_m_s, velocity_y_m_s] = velocity;
        Part { velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s, ..part_at(Place::Plateau, x_m, 0.0) }
    }

    static FIVE_MM: LazyLock<Body> = LazyLock::new(|| {
        let part = disc(0.005, 0.2);
        Body::new(&part.mesh, &part.poses[0])
    });

    #[test]
    fn an_inelastic_impact_shares_the_velocity_along_the_line_of_centres() {
        let body = &*FIVE_MM;
        let (mut behind, mut ahead) = (moving(0.0, [0.2, 0.1], 0.0), moving(0.005, [0.0; 2], 0.0));
        let mut hit = || collide((body, &mut behind), (body, &mut ahead), [1.0, 0.0], [0.0025, 0.0], law(0.0, 0.0));
        assert!(hit());
        assert!(!hit());
        assert_eq!((behind.velocity_x_m_s, ahead.velocity_x_m_s), (0.1, 0.1));
        assert_eq!((behind.velocity_y_m_s, ahead.velocity_y_m_s), (0.1, 0.0));
    }

    #[test]
    fn friction_between_parts_is_bounded_by_what_presses_them_and_turns_both() {
        let body = &*FIVE_MM;
        let hit = |sliding: f64, friction: f64| {
            let (mut behind, mut ahead) = (moving(0.0, [0.2, sliding], 0.0), moving(0.005, [0.0; 2], 0.0));
            collide((body, &mut behind), (body, &mut ahead), [1.0, 0.0], [0.0025, 0.0], law(0.0, friction));
            (behind, ahead)
        };
        let (behind, ahead) = hit(0.5, 0.3);
        assert!((ahead.velocity_y_m_s - 0.3 * 0.1).abs() < 1e-12);
        // Like gears: at the point of contact each is dragged by the other. A disc's gyration radius is r/√2.
        let expected_rad_s = -0.3 * 0.1 * 0.0025 / (0.0025_f64.powi(2) / 2.0);
        assert!((behind.yaw_rate_rad_s / expected_rad_s - 1.0).abs() < 0.01);
        assert!((behind.yaw_rate_rad_s - ahead.yaw_rate_rad_s).abs() < 1e-9);
        // Great friction ends the sliding but does not reverse it.
        let (behind, ahead) = hit(0.05, 9.0);
        let sliding = |part: &Part, arm_m: f64| part.velocity_y_m_s + part.yaw_rate_rad_s * arm_m;
        assert!((sliding(&behind, 0.0025) - sliding(&ahead, -0.0025)).abs() < 1e-12);
    }

    #[test]
    fn verif_a_block_hit_at_its_corner_turns_as_momentum_says() {
        // Sliding along −y with one corner on a fixed point, without friction: the corner stops, ω = a v/(k² + a²).
        let part = block(0.006, 0.004, 0.003);
        let body = Body::new(&part.mesh, &part.poses[0]);
        let mut sliding = moving(0.0, [0.0, -0.1], 0.0);
        bounce(&body, &mut sliding, [0.0, 1.0], [0.003, -0.002], law(0.0, 0.0));
        let gyration_squared = (0.006_f64.powi(2) + 0.004_f64.powi(2)) / 12.0;
        let expected_rad_s = 0.003 * 0.1 / (gyration_squared + 0.003_f64.powi(2));
        assert!((sliding.yaw_rate_rad_s - expected_rad_s).abs() < 1e-9);
        assert!((sliding.velocity_y_m_s + 0.003 * sliding.yaw_rate_rad_s).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn an_impact_keeps_momentum_and_adds_no_energy(
            velocities in prop::array::uniform4(-1.0..1.0_f64),
            rates in prop::array::uniform2(-100.0..100.0_f64),
            angle in 0.0..std::f64::consts::TAU,
            point in prop::array::uniform2(-0.004..0.004_f64),
            restitution in 0.0..=1.0_f64,
            friction in 0.0..2.0_f64,
        ) {
            let body = &*FIVE_MM;
            let [a, b, c, d] = velocities;
            let (mut behind, mut ahead) = (moving(0.0, [a, b], rates[0]), moving(0.003, [c, d], rates[1]));
            let turning = |part: &Part| body.gyration_m * part.yaw_rate_rad_s;
            let momentum = |one: &Part, other: &Part| one.velocity_m_s() + other.velocity_m_s();
            let angular = |part: &Part| {
                part.x_m * part.velocity_y_m_s - part.y_m * part.velocity_x_m_s
                    + body.gyration_m.powi(2) * part.yaw_rate_rad_s
            };
            let energy = |part: &Part| part.velocity_m_s().norm_squared() + turning(part).powi(2);
            let before = (momentum(&behind, &ahead), angular(&behind) + angular(&ahead), energy(&behind) + energy(&ahead));
            let normal = [angle.cos(), angle.sin()];
            collide((body, &mut behind), (body, &mut ahead), normal, point, law(restitution, friction));
            prop_assert!((momentum(&behind, &ahead) - before.0).norm() < 1e-13);
            prop_assert!((angular(&behind) + angular(&ahead) - before.1).abs() < 1e-15);
            prop_assert!(energy(&behind) + energy(&ahead) <= before.2 + 1e-13);
        }
    }
}
