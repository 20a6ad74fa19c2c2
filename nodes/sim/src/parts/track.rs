//! A part on the tray's surfaces: drive by the moving tray, friction, walls, and which surface comes next.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use nalgebra::Vector2;

use super::body::Body;
use super::friction::slide;
use super::impulse::{ContactLaw, bounce};
use super::touch::{Scratch, touch_fixed_disc};
use crate::parts::{BulkSettings, Part, Place};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::motion::MotionSample;
use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;

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

/// Rounds in which a part is kept off walls and face: courier motions call for two, whatever is far beyond both for more.
const CONFINING_ROUNDS: usize = 32;

/// The tray for parts of one type.
#[derive(Clone, Debug)]
pub(super) struct Track {
    /// The part in each of its poses.
    bodies: Vec<Body>,
    inner_m: f64,
    outer_m: f64,
    /// Distance from the tray's axis up to which the tray's turning is felt: the outer wall and, as the turning of the
    /// part itself, its radius of gyration, m.
    felt_m: f64,
    pitch_m_per_rad: f64,
    /// Unit vector along the upper end of the ramp.
    ramp_end: Vector2<f64>,
    friction_static: f64,
    friction_kinetic: f64,
    wall_law: ContactLaw,
}

impl Track {
    pub(super) fn new(tray: &TrayGeometry, part: &PartType, settings: &BulkSettings) -> Self {
        let (sin, cos) = tray.ramp_angle_rad.sin_cos();
        let bodies: Vec<Body> = part.poses.iter().map(|pose| Body::new(&part.mesh, pose)).collect();
        let gyration_m = bodies.iter().map(|body| body.gyration_m).fold(0.0, f64::max);
        Self {
            bodies,
            inner_m: tray.inner_radius_m,
            outer_m: tray.outer_radius_m,
            felt_m: tray.outer_radius_m + gyration_m,
            pitch_m_per_rad: tray.pitch_m_per_rad(),
            ramp_end: Vector2::new(cos, sin),
            friction_static: part.friction_static,
            friction_kinetic: part.friction_kinetic,
            wall_law: ContactLaw { restitution: settings.wall_restitution, friction: settings.wall_friction },
        }
    }

    /// A part as it lies.
    pub(super) fn body(&self, part: &Part) -> &Body {
        &self.bodies[part.pose]
    }

    /// Distances from the tray's axis at which a part's centre may be whichever way it is turned, m.
    pub(super) fn centres_m(&self, part: &Part) -> RangeInclusive<f64> {
        let radius_m = self.body(part).radius_m;
        self.inner_m + radius_m..=self.outer_m - radius_m
    }

    /// Nothing on the tray is accelerated by more than this, m/s².
    pub(super) fn shaking_m_s2(&self, drive: &Drive) -> f64 {
        drive.bound_m_s2(self.felt_m)
    }

    /// Moves one part by a step and returns the square of how far it went (m²), or `None` if it stuck throughout.
    pub(super) fn advance(&self, part: &mut Part, drive: &Drive, step_s: f64, scratch: &mut Scratch) -> Option<f64> {
        let body = &self.bodies[part.pose];
        let before_rad = part.yaw_rad;
        let travel_m2 = match part.place {
            Place::Ramp => self.advance_on_ramp(part, body.gyration_m, drive, step_s)?,
            Place::Plateau => self.advance_on_plateau(part, body.gyration_m, drive, step_s)?,
            Place::Falling => return None,
        };
        self.confine(part, scratch);
        if body.is_round() {
            return Some(travel_m2);
        }
        // Corners go farther than the centre.
        let swept_m = body.radius_m * (part.yaw_rad - before_rad).abs();
        Some((travel_m2.sqrt() + swept_m).powi(2))
    }

    /// Quaid Eqs 18–29 with φ = 0 (corrected, with the courier's translation), in the tray's Cartesian axes, where the
    /// tray's turning shows as centrifugal, Euler and Coriolis acceleration.
    ///
    /// The part's own turning comes third, times its radius of gyration: what is at rest in the platen turns back in the
    /// tray.
    fn advance_on_plateau(&self, part: &mut Part, gyration_m: f64, drive: &Drive, step_s: f64) -> Option<f64> {
        let (x, y) = (part.x_m, part.y_m);
        let velocity = [part.velocity_x_m_s, part.velocity_y_m_s, gyration_m * part.yaw_rate_rad_s];
        let rate = drive.yaw_rad_s;
        let push = [
            rate * (rate * x + 2.0 * velocity[1]) + drive.yaw_rad_s2 * y - drive.x_m_s2,
            rate * (rate * y - 2.0 * velocity[0]) - drive.yaw_rad_s2 * x - drive.y_m_s2,
            -gyration_m * drive.yaw_rad_s2,
        ];
        let grip_static = self.friction_static * STANDARD_GRAVITY_M_S2;
        if sticks(part, push, grip_static) {
            return None;
        }
        let grip_kinetic = self.friction_kinetic * STANDARD_GRAVITY_M_S2;
        let slid = slide(velocity, push, grip_static, grip_kinetic, step_s);
        part.x_m += slid.displacement[0];
        part.y_m += slid.displacement[1];
        [part.velocity_x_m_s, part.velocity_y_m_s, _] = slid.velocity;
        turn(part, gyration_m, slid.velocity[2], slid.displacement[2]);
        Some(slid.displacement[0].powi(2) + slid.displacement[1].powi(2))
    }

    /// Quaid Eqs 18–29 (corrected, with the courier's translation) in the axes of the ramp at the part: outward, and
    /// uphill along the slope. The axes stay put over the step, so r ψ̇² is left to the straight path.
    fn advance_on_ramp(&self, part: &mut Part, gyration_m: f64, drive: &Drive, step_s: f64) -> Option<f64> {
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
            -gyration_m * drive.yaw_rad_s2,
        ];
        let grip_static = self.friction_static * normal;
        if sticks(part, push, grip_static) {
            return None;
        }
        let grip_kinetic = self.friction_kinetic * normal;
        let velocity = [outward, around * per_cos, gyration_m * part.yaw_rate_rad_s];
        let slid = slide(velocity, push, grip_static, grip_kinetic, step_s);
        let moved = [slid.displacement[0], slid.displacement[1] * cos];
        part.x_m += moved[0] * out_x + moved[1] * uphill_x;
        part.y_m += moved[0] * out_y + moved[1] * uphill_y;
        let velocity = [slid.velocity[0], slid.velocity[1] * cos];
        part.velocity_x_m_s = velocity[0] * out_x + velocity[1] * uphill_x;
        part.velocity_y_m_s = velocity[0] * out_y + velocity[1] * uphill_y;
        turn(part, gyration_m, slid.velocity[2], slid.displacement[2]);
        Some(moved[0].powi(2) + moved[1].powi(2))
    }

    /// Keeps a part between the walls and, on the ramp, in front of the drop-off's face.
    pub(super) fn confine(&self, part: &mut Part, scratch: &mut Scratch) {
        let body = &self.bodies[part.pose];
        for _ in 0..CONFINING_ROUNDS {
            self.keep_between_the_walls(part, body, scratch);
            let near_the_face = part.place == Place::Ramp && part.x_m > 0.0 && part.y_m < body.radius_m;
            // Where the face meets a wall, moving a part off one moves it a little into the other.
            if !(near_the_face && self.keep_off_the_face(part, body)) {
                return;
            }
        }
    }

    fn keep_between_the_walls(&self, part: &mut Part, body: &Body, scratch: &mut Scratch) {
        let squared = part.x_m * part.x_m + part.y_m * part.y_m;
        let (outermost_m, innermost_m) = (self.outer_m - body.radius_m, self.inner_m + body.radius_m);
        if squared > outermost_m * outermost_m {
            self.keep_inside_the_outer_wall(part, body);
        } else if squared < innermost_m * innermost_m {
            self.keep_outside_the_inner_wall(part, body, scratch);
        }
    }

    /// Tells whether the part was moved.
    fn keep_off_the_face(&self, part: &mut Part, body: &Body) -> bool {
        let corners = corners(body, part);
        let lowest = corners.min_by(|a, b| a[1].total_cmp(&b[1])).unwrap_or([part.x_m, part.y_m - body.radius_m]);
        if lowest[1] >= 0.0 {
            return false;
        }
        part.y_m -= lowest[1];
        bounce(body, part, [0.0, 1.0], [lowest[0], 0.0], self.wall_law);
        true
    }

    fn keep_inside_the_outer_wall(&self, part: &mut Part, body: &Body) {
        if body.is_round() {
            let r = part.radius_m();
            let (out_x, out_y) = (part.x_m / r, part.y_m / r);
            let outermost_m = self.outer_m - body.radius_m;
            (part.x_m, part.y_m) = (out_x * outermost_m, out_y * outermost_m);
            let point = [out_x * self.outer_m, out_y * self.outer_m];
            bounce(body, part, [-out_x, -out_y], point, self.wall_law);
            return;
        }
        // Once for each corner that may be beyond; moving the part in over one corner may move another out.
        for _ in 0..body.corners.len() {
            let squared = |corner: &[f64; 2]| corner[0] * corner[0] + corner[1] * corner[1];
            let farthest = corners(body, part).max_by(|a, b| squared(a).total_cmp(&squared(b)));
            let Some(corner) = farthest.filter(|corner| squared(corner) > self.outer_m * self.outer_m) else {
                return;
            };
            let r = squared(&corner).sqrt();
            let out = [corner[0] / r, corner[1] / r];
            part.x_m -= (r - self.outer_m) * out[0];
            part.y_m -= (r - self.outer_m) * out[1];
            let point = [out[0] * self.outer_m, out[1] * self.outer_m];
            bounce(body, part, [-out[0], -out[1]], point, self.wall_law);
        }
    }

    fn keep_outside_the_inner_wall(&self, part: &mut Part, body: &Body, scratch: &mut Scratch) {
        if body.is_round() {
            let r = part.radius_m();
            let (out_x, out_y) = if r > 0.0 { (part.x_m / r, part.y_m / r) } else { (1.0, 0.0) };
            let innermost_m = self.inner_m + body.radius_m;
            (part.x_m, part.y_m) = (out_x * innermost_m, out_y * innermost_m);
            let point = [out_x * self.inner_m, out_y * self.inner_m];
            bounce(body, part, [out_x, out_y], point, self.wall_law);
        } else if let Some(touch) = touch_fixed_disc((body, part), [0.0, 0.0], self.inner_m, scratch) {
            let out = touch.normal.map(|component| -component);
            part.x_m += touch.depth_m * out[0];
            part.y_m += touch.depth_m * out[1];
            for &point in touch.points() {
                bounce(body, part, out, point, self.wall_law);
            }
        }
    }

    /// Whether a part at rest touches neither wall nor face.
    pub(super) fn has_room(&self, part: &Part, scratch: &mut Scratch) -> bool {
        let mut confined = *part;
        self.confine(&mut confined, scratch);
        part.x_m.is_finite() && part.y_m.is_finite() && confined == *part
    }

    /// Whether no point of a part is beyond a wall by more than `slack_m`.
    pub(super) fn is_inside(&self, part: &Part, slack_m: f64) -> bool {
        let mut confined = *part;
        self.confine(&mut confined, &mut Scratch::default());
        (confined.position_m() - part.position_m()).norm() <= slack_m
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

fn sticks(part: &Part, push: [f64; 3], grip_static: f64) -> bool {
    let squared = push[0] * push[0] + push[1] * push[1] + push[2] * push[2];
    !part.is_moving() && squared <= grip_static * grip_static
}

/// Turns a part by what is given times its radius of gyration.
fn turn(part: &mut Part, gyration_m: f64, velocity_m_s: f64, displacement_m: f64) {
    part.yaw_rate_rad_s = velocity_m_s / gyration_m;
    part.yaw_rad += displacement_m / gyration_m;
    if part.yaw_rad.abs() > PI {
        part.yaw_rad -= TAU * (part.yaw_rad / TAU).round();
    }
}

/// The corners of a part where it is, m.
fn corners<'a>(body: &'a Body, part: &Part) -> impl Iterator<Item = [f64; 2]> + use<'a> {
    let (sin, cos) = part.yaw_rad.sin_cos();
    let (x, y) = (part.x_m, part.y_m);
    body.corners
        .iter()
        .map(move |corner| [x + cos * corner[0] - sin * corner[1], y + sin * corner[0] + cos * corner[1]])
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::parts::tests::{block, disc, part_at, track as track_of};

    static DISCS: LazyLock<Track> = LazyLock::new(|| track_of(&disc(0.006, 0.2)));
    static BLOCKS: LazyLock<Track> = LazyLock::new(|| track_of(&block(0.006, 0.004, 0.003)));

    fn track() -> &'static Track {
        &DISCS
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
        // wall_restitution 0.1 and wall_friction 0.2: an impact at 1 m/s may take 1.1 × 0.2 m/s off the speed along the
        // wall, but a disc that slides at 0.5 m/s rolls along it at a third less.
        let outward = Part { velocity_x_m_s: 1.0, velocity_y_m_s: -0.5, ..part_at(Place::Plateau, 0.0875, 0.0) };
        let inward = Part { velocity_x_m_s: -1.0, ..part_at(Place::Plateau, 0.0325, 0.0) };
        let against_the_face = Part { velocity_x_m_s: 0.1, velocity_y_m_s: -1.0, ..part_at(Place::Ramp, 0.060, 0.001) };
        for (mut part, x_m, y_m, velocity) in [
            (outward, 0.087, 0.0, [-0.1, -1.0 / 3.0]),
            (inward, 0.033, 0.0, [0.1, 0.0]),
            (against_the_face, 0.060, 0.003, [0.2 / 3.0, 0.1]),
        ] {
            track().confine(&mut part, &mut Scratch::default());
            assert!((part.position_m() - Vector2::new(x_m, y_m)).norm() < 1e-12);
            let left = part.velocity_m_s() - Vector2::from(velocity);
            // A disc is drawn with 64 sides.
            assert!(left.norm() < 5e-4, "{:?}", part.velocity_m_s());
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
            prop_assert_eq!(track.advance(&mut part, &drive, 5e-4, &mut Scratch::default()), None);
        }

        #[test]
        fn walls_add_no_energy(
            radius_m in 0.020..0.100_f64,
            angle_rad in 0.0..std::f64::consts::TAU,
            yaw_rad in -PI..PI,
            velocity in prop::array::uniform2(-1.0..1.0_f64),
            yaw_rate_rad_s in -100.0..100.0_f64,
            round in any::<bool>(),
        ) {
            let track: &Track = if round { &DISCS } else { &BLOCKS };
            let place = Place::from(TrayGeometry::PAPER.surface(angle_rad));
            let mut part = Part {
                yaw_rad,
                velocity_x_m_s: velocity[0],
                velocity_y_m_s: velocity[1],
                yaw_rate_rad_s,
                ..part_at(place, radius_m * angle_rad.cos(), radius_m * angle_rad.sin())
            };
            let gyration_m = track.body(&part).gyration_m;
            let energy = |part: &Part| part.velocity_m_s().norm_squared() + (gyration_m * part.yaw_rate_rad_s).powi(2);
            let before = energy(&part);
            track.confine(&mut part, &mut Scratch::default());
            prop_assert!(energy(&part) <= before + 1e-14);
            // What is confined is confined.
            prop_assert!(track.is_inside(&part, 1e-5), "{part:?}");
        }
    }
}
