//! A part on the tray's surfaces: drive by the moving tray, friction, walls, and which surface comes next.

use nalgebra::Vector2;

use super::friction::slide;
use super::{BulkSettings, Part, PartType, Place};
use crate::gravity::STANDARD_GRAVITY_M_S2;
use crate::motion::MotionSample;
use crate::tray::TrayGeometry;

/// Motion of the tray over one step, seen from the tray's own axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drive {
    /// Courier acceleration along the tray's x, m/s².
    x_m_s2: f64,
    /// Courier acceleration along the tray's y, m/s².
    y_m_s2: f64,
    /// Yaw acceleration θ̈, rad/s².
    yaw_rad_s2: f64,
    /// Yaw rate θ̇ in the middle of the step, rad/s.
    yaw_rad_s: f64,
}

impl Drive {
    /// The drive in the middle of a step that starts `from_s` into `sample` and lasts `step_s`.
    pub(super) fn new(sample: &MotionSample, from_s: f64, step_s: f64) -> Self {
        let acceleration = sample.acceleration;
        let middle_s = from_s + 0.5 * step_s;
        let yaw_rad_s = sample.velocity.z + acceleration.z * middle_s;
        let yaw_rad = sample.position.z + (sample.velocity.z + 0.5 * acceleration.z * middle_s) * middle_s;
        let (sin, cos) = yaw_rad.sin_cos();
        Self {
            x_m_s2: acceleration.x * cos + acceleration.y * sin,
            y_m_s2: acceleration.y * cos - acceleration.x * sin,
            yaw_rad_s2: acceleration.z,
            yaw_rad_s,
        }
    }

    /// No point of the tray within `radius_m` of its axis is accelerated by more than this, m/s².
    pub(super) fn bound_m_s2(&self, radius_m: f64) -> f64 {
        self.x_m_s2.hypot(self.y_m_s2) + radius_m * (self.yaw_rad_s2.abs() + self.yaw_rad_s.powi(2))
    }
}

/// Where a part passes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Passage {
    RampToPlateau,
    PlateauToRamp,
    OffThePlateau,
}

/// The tray for the centres of parts of one type.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) part_radius_m: f64,
    pub(super) innermost_m: f64,
    pub(super) outermost_m: f64,
    pitch_m_per_rad: f64,
    /// Unit vector along the upper end of the ramp.
    ramp_end: Vector2<f64>,
    friction_static: f64,
    friction_kinetic: f64,
    wall_restitution: f64,
    wall_friction: f64,
}

impl Track {
    pub(super) fn new(tray: &TrayGeometry, part: &PartType, settings: &BulkSettings) -> Self {
        let (sin, cos) = tray.ramp_angle_rad.sin_cos();
        Self {
            part_radius_m: part.radius_m(),
            innermost_m: tray.inner_radius_m + part.radius_m(),
            outermost_m: tray.outer_radius_m - part.radius_m(),
            pitch_m_per_rad: tray.pitch_m_per_rad(),
            ramp_end: Vector2::new(cos, sin),
            friction_static: part.friction_static,
            friction_kinetic: part.friction_kinetic,
            wall_restitution: settings.wall_restitution,
            wall_friction: settings.wall_friction,
        }
    }

    /// Moves one part by a step and returns the square of how far it went (m²), or `None` if it stuck throughout.
    pub(super) fn advance(&self, part: &mut Part, drive: &Drive, step_s: f64) -> Option<f64> {
        let travel_m2 = match part.place {
            Place::Ramp => self.advance_on_ramp(part, drive, step_s)?,
            Place::Plateau => self.advance_on_plateau(part, drive, step_s)?,
            Place::Falling => return None,
        };
        self.confine(part);
        Some(travel_m2)
    }

    /// Quaid Eqs 18–29 with φ = 0 (corrected, with the courier's translation), in the tray's Cartesian axes, where the
    /// tray's turning shows as centrifugal, Euler and Coriolis acceleration.
    fn advance_on_plateau(&self, part: &mut Part, drive: &Drive, step_s: f64) -> Option<f64> {
        let (x, y) = (part.x_m, part.y_m);
        let velocity = [part.velocity_x_m_s, part.velocity_y_m_s];
        let rate = drive.yaw_rad_s;
        let push = [
            rate * (rate * x + 2.0 * velocity[1]) + drive.yaw_rad_s2 * y - drive.x_m_s2,
            rate * (rate * y - 2.0 * velocity[0]) - drive.yaw_rad_s2 * x - drive.y_m_s2,
        ];
        let grip_static = self.friction_static * STANDARD_GRAVITY_M_S2;
        if sticks(part, push, grip_static) {
            return None;
        }
        let grip_kinetic = self.friction_kinetic * STANDARD_GRAVITY_M_S2;
        let slid = slide(velocity, push, grip_static, grip_kinetic, step_s);
        part.x_m += slid.displacement[0];
        part.y_m += slid.displacement[1];
        [part.velocity_x_m_s, part.velocity_y_m_s] = slid.velocity;
        Some(slid.displacement[0].powi(2) + slid.displacement[1].powi(2))
    }

    /// Quaid Eqs 18–29 (corrected, with the courier's translation) in the axes of the ramp at the part: outward, and
    /// uphill along the slope. The axes stay put over the step, so r ψ̇² is left to the straight path.
    fn advance_on_ramp(&self, part: &mut Part, drive: &Drive, step_s: f64) -> Option<f64> {
        let r = (part.x_m * part.x_m + part.y_m * part.y_m).sqrt();
        let per_r = 1.0 / r;
        let (out_x, out_y) = (part.x_m * per_r, part.y_m * per_r);
        let (uphill_x, uphill_y) = (-out_y, out_x);
        let slope_length = (r * r + self.pitch_m_per_rad * self.pitch_m_per_rad).sqrt();
        let per_length = 1.0 / slope_length;
        let (sin, cos) = (self.pitch_m_per_rad * per_length, r * per_length);
        let per_cos = slope_length * per_r;

        let outward = part.velocity_x_m_s * out_x + part.velocity_y_m_s * out_y;
        let around = part.velocity_x_m_s * uphill_x + part.velocity_y_m_s * uphill_y;
        let turning = around * per_r;
        // r θ̈ + a_ψ + 2 ṙ Ω, the acceleration that presses the part into the slope.
        let tangential = r * drive.yaw_rad_s2
            + drive.x_m_s2 * uphill_x
            + drive.y_m_s2 * uphill_y
            + 2.0 * outward * (turning + drive.yaw_rad_s);
        let normal = (STANDARD_GRAVITY_M_S2 * cos - sin * tangential).max(0.0);
        let push = [
            drive.yaw_rad_s * (drive.yaw_rad_s * r + 2.0 * around) - drive.x_m_s2 * out_x - drive.y_m_s2 * out_y,
            2.0 * outward * turning * per_cos - STANDARD_GRAVITY_M_S2 * sin - cos * tangential,
        ];
        let grip_static = self.friction_static * normal;
        if sticks(part, push, grip_static) {
            return None;
        }
        let grip_kinetic = self.friction_kinetic * normal;
        let slid = slide([outward, around * per_cos], push, grip_static, grip_kinetic, step_s);
        let moved = [slid.displacement[0], slid.displacement[1] * cos];
        part.x_m += moved[0] * out_x + moved[1] * uphill_x;
        part.y_m += moved[0] * out_y + moved[1] * uphill_y;
        let velocity = [slid.velocity[0], slid.velocity[1] * cos];
        part.velocity_x_m_s = velocity[0] * out_x + velocity[1] * uphill_x;
        part.velocity_y_m_s = velocity[0] * out_y + velocity[1] * uphill_y;
        Some(moved[0].powi(2) + moved[1].powi(2))
    }

    /// Keeps a part between the walls and, on the ramp, in front of the drop-off's face.
    pub(super) fn confine(&self, part: &mut Part) {
        if part.place == Place::Ramp && part.x_m > 0.0 && part.y_m < self.part_radius_m {
            part.y_m = self.part_radius_m;
            self.bounce(part, 0.0, 1.0);
        }
        let squared = part.x_m * part.x_m + part.y_m * part.y_m;
        let outside = squared > self.outermost_m * self.outermost_m;
        if outside || squared < self.innermost_m * self.innermost_m {
            let r = squared.sqrt();
            let (out_x, out_y) = if r > 0.0 { (part.x_m / r, part.y_m / r) } else { (1.0, 0.0) };
            if outside {
                part.x_m = out_x * self.outermost_m;
                part.y_m = out_y * self.outermost_m;
                self.bounce(part, -out_x, -out_y);
            } else {
                part.x_m = out_x * self.innermost_m;
                part.y_m = out_y * self.innermost_m;
                self.bounce(part, out_x, out_y);
            }
        }
    }

    /// Whether a part's outline, centred at (`x_m`, `y_m`), touches neither wall nor face.
    pub(super) fn has_room(&self, place: Place, x_m: f64, y_m: f64) -> bool {
        let at_the_face = place == Place::Ramp && x_m > 0.0 && y_m < self.part_radius_m;
        (self.innermost_m..=self.outermost_m).contains(&x_m.hypot(y_m)) && !at_the_face
    }

    /// Impact on a wall whose normal into the tray is (`normal_x`, `normal_y`), with friction along it.
    fn bounce(&self, part: &mut Part, normal_x: f64, normal_y: f64) {
        let approach = -(part.velocity_x_m_s * normal_x + part.velocity_y_m_s * normal_y);
        if approach <= 0.0 {
            return;
        }
        let impulse = (1.0 + self.wall_restitution) * approach;
        let along = part.velocity_y_m_s * normal_x - part.velocity_x_m_s * normal_y;
        let grip = self.wall_friction * impulse;
        let lost = along.clamp(-grip, grip);
        part.velocity_x_m_s += impulse * normal_x + lost * normal_y;
        part.velocity_y_m_s += impulse * normal_y - lost * normal_x;
    }

    /// The passage a part has made to another surface, if any.
    ///
    /// The quadrants in front of and behind an edge tell it, which is why neither surface may span more than three.
    pub(super) fn passage(&self, part: &Part) -> Option<Passage> {
        let beyond_ramp = || self.ramp_end.x * part.y_m - self.ramp_end.y * part.x_m;
        let near_ramp_end = || self.ramp_end.x * part.x_m + self.ramp_end.y * part.y_m > 0.0;
        match part.place {
            Place::Ramp if beyond_ramp() >= 0.0 && near_ramp_end() => Some(Passage::RampToPlateau),
            Place::Plateau if part.y_m >= 0.0 && part.x_m > 0.0 => Some(Passage::OffThePlateau),
            Place::Plateau if beyond_ramp() < 0.0 && near_ramp_end() => Some(Passage::PlateauToRamp),
            _ => None,
        }
    }

    /// The tray's acceleration (m/s², any direction) under which every sticking part keeps sticking.
    pub(super) fn hold_m_s2(&self, parts: &[Part]) -> f64 {
        let flat = self.friction_static * STANDARD_GRAVITY_M_S2;
        let ramp = parts.iter().filter(|part| part.place == Place::Ramp);
        ramp.fold(flat, |least, part| {
            // From |f| ≤ g sin φ + a and f_N ≥ g cos φ − a sin φ.
            let slope_length = part.radius_m().hypot(self.pitch_m_per_rad);
            let (sin, cos) = (self.pitch_m_per_rad / slope_length, part.radius_m() / slope_length);
            let hold = STANDARD_GRAVITY_M_S2 * (self.friction_static * cos - sin) / (1.0 + self.friction_static * sin);
            least.min(hold)
        })
    }
}

fn sticks(part: &Part, push: [f64; 2], grip_static: f64) -> bool {
    !part.is_moving() && push[0] * push[0] + push[1] * push[1] <= grip_static * grip_static
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::parts::tests::{disc, part_at};

    fn track() -> Track {
        Track::new(&TrayGeometry::PAPER, &disc(0.006, 0.2), &BulkSettings::default())
    }

    fn carried(x_m_s2: f64, y_m_s2: f64) -> Drive {
        let sample = MotionSample { acceleration: Vector3::new(x_m_s2, y_m_s2, 0.0), ..MotionSample::default() };
        Drive::new(&sample, 0.0, 5e-4)
    }

    #[test]
    fn the_drive_is_that_of_the_middle_of_the_step() {
        let sample = MotionSample {
            position: Vector3::new(0.0, 0.0, 0.3),
            velocity: Vector3::new(0.0, 0.0, 20.0),
            acceleration: Vector3::new(3.0, 0.0, 1000.0),
        };
        let drive = Drive::new(&sample, 1e-3, 2e-3);
        // 2 ms into the sample: 20 + 1000 × 0.002 rad/s, and 0.3 + 0.04 + 0.002 rad.
        assert!((drive.yaw_rad_s - 22.0).abs() < 1e-12);
        assert!((drive.x_m_s2 - 3.0 * 0.342_f64.cos()).abs() < 1e-12);
        assert!((drive.y_m_s2 + 3.0 * 0.342_f64.sin()).abs() < 1e-12);
    }

    #[test]
    fn walls_and_face_stop_parts_with_friction() {
        // wall_restitution 0.1 and wall_friction 0.2: an impact at 1 m/s takes 1.1 × 0.2 m/s off the speed along it.
        let outward = Part { velocity_x_m_s: 1.0, velocity_y_m_s: -0.5, ..part_at(Place::Plateau, 0.0875, 0.0) };
        let inward = Part { velocity_x_m_s: -1.0, ..part_at(Place::Plateau, 0.0325, 0.0) };
        let against_the_face = Part { velocity_x_m_s: 0.1, velocity_y_m_s: -1.0, ..part_at(Place::Ramp, 0.060, 0.001) };
        for (mut part, x_m, y_m, velocity) in [
            (outward, 0.087, 0.0, [-0.1, -0.28]),
            (inward, 0.033, 0.0, [0.1, 0.0]),
            (against_the_face, 0.060, 0.003, [0.0, 0.1]),
        ] {
            track().confine(&mut part);
            assert!((part.position_m() - Vector2::new(x_m, y_m)).norm() < 1e-12);
            let left = part.velocity_m_s() - Vector2::from(velocity);
            assert!(left.norm() < 1e-12, "{:?}", part.velocity_m_s());
        }
    }

    #[test]
    fn edges_are_passed_where_they_are() {
        let passage = |place, angle_rad: f64| {
            let part = part_at(place, 0.08 * angle_rad.cos(), 0.08 * angle_rad.sin());
            track().passage(&part)
        };
        for (place, angle_rad, expected) in [
            (Place::Ramp, 0.05, None),
            (Place::Ramp, 3.13, None),
            (Place::Ramp, 3.15, Some(Passage::RampToPlateau)),
            (Place::Plateau, 3.15, None),
            (Place::Plateau, 3.13, Some(Passage::PlateauToRamp)),
            (Place::Plateau, 6.2, None),
            (Place::Plateau, 0.0, Some(Passage::OffThePlateau)),
            (Place::Falling, 0.0, None),
        ] {
            assert_eq!(passage(place, angle_rad), expected, "{place:?} at {angle_rad}");
        }
    }

    proptest! {
        #[test]
        fn a_part_within_the_hold_sticks(
            radius_m in 0.033..0.087_f64,
            angle_rad in 0.1..6.2_f64,
            direction in 0.0..std::f64::consts::TAU,
        ) {
            let track = track();
            let place = Place::from(TrayGeometry::PAPER.surface(angle_rad));
            let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
            let mut part = part_at(place, x_m, y_m);
            let hold_m_s2 = track.hold_m_s2(&[part]).max(0.0);
            let drive = carried(hold_m_s2 * direction.cos(), hold_m_s2 * direction.sin());
            // Up to rounding at the very limit.
            let drive = Drive { x_m_s2: drive.x_m_s2 * 0.999_999, y_m_s2: drive.y_m_s2 * 0.999_999, ..drive };
            prop_assert!(drive.bound_m_s2(radius_m) <= hold_m_s2);
            prop_assert_eq!(track.advance(&mut part, &drive, 5e-4), None);
        }

        #[test]
        fn walls_add_no_energy(
            radius_m in 0.020..0.100_f64,
            angle_rad in 0.0..std::f64::consts::TAU,
            velocity in prop::array::uniform2(-1.0..1.0_f64),
        ) {
            let place = Place::from(TrayGeometry::PAPER.surface(angle_rad));
            let mut part = Part {
                velocity_x_m_s: velocity[0],
                velocity_y_m_s: velocity[1],
                ..part_at(place, radius_m * angle_rad.cos(), radius_m * angle_rad.sin())
            };
            let before = part.velocity_m_s().norm();
            track().confine(&mut part);
            prop_assert!(part.velocity_m_s().norm() <= before + 1e-15);
        }
    }
}
