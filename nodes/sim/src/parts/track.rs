//! A part on the tray's surfaces: how the moving tray and friction move it, and which surface comes next.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use nalgebra::Vector2;

use super::body::Body;
use super::touch::Scratch;
use super::walls::Walls;
use crate::parts::{BulkSettings, Part, Place};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::friction::{Affine, Friction, Grip, Swerve, held_up_to_m_s2};
use feeder_model::mechanics::tray_forces::{Incline, TrayDrive};
use feeder_model::part::PartType;
use feeder_model::tray::TrayGeometry;

/// Where a part passes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Passage {
    RampToPlateau,
    PlateauToRamp,
    OffThePlateau,
}

/// The tray for parts of one type.
#[derive(Clone, Debug)]
pub(super) struct TrayPath {
    /// The part in each of its poses.
    bodies: Vec<Body>,
    walls: Walls,
    /// Distance from the tray's axis up to which the tray's turning is felt: the outer wall and, as the turning of the
    /// part itself, its radius of gyration, m.
    felt_m: f64,
    pitch_m_per_rad: f64,
    /// Unit vector along the upper end of the ramp.
    ramp_end: Vector2<f64>,
    friction: Friction,
    /// What friction can do on the plateau.
    level_grip: Grip,
}

impl TrayPath {
    pub(super) fn new(tray: &TrayGeometry, part: &PartType, settings: &BulkSettings) -> Self {
        let (sin, cos) = tray.ramp_angle_rad.sin_cos();
        let bodies: Vec<Body> = part.poses.iter().map(|pose| Body::new(&part.mesh, pose)).collect();
        let gyration_m = bodies.iter().map(|body| body.gyration_m).fold(0.0, f64::max);
        Self {
            bodies,
            walls: Walls::new(tray, settings),
            felt_m: tray.outer_radius_m + gyration_m,
            pitch_m_per_rad: tray.pitch_m_per_rad(),
            ramp_end: Vector2::new(cos, sin),
            friction: part.friction,
            level_grip: part.friction.grip(Incline::LEVEL.load(0.0, STANDARD_GRAVITY_M_S2).normal_m_s2),
        }
    }

    /// A part as it lies.
    pub(super) fn body(&self, part: &Part) -> &Body {
        &self.bodies[part.pose]
    }

    /// Distances from the tray's axis at which a part's centre may be whichever way it is turned, m.
    pub(super) fn centres_m(&self, part: &Part) -> RangeInclusive<f64> {
        self.walls.centres_m(self.body(part))
    }

    /// Nothing on the tray is accelerated by more than this, m/s².
    pub(super) fn shaking_m_s2(&self, drive: &TrayDrive) -> f64 {
        drive.bound_m_s2(self.felt_m)
    }

    /// Moves one part by a step and returns the square of how far it went (m²), or `None` if it stuck throughout.
    pub(super) fn advance(
        &self,
        part: &mut Part,
        drive: &TrayDrive,
        step_s: f64,
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let body = &self.bodies[part.pose];
        let before_rad = part.yaw_rad;
        let travel_m2 = match part.place {
            Place::Ramp => self.advance_on_ramp(part, body.gyration_m, drive, step_s)?,
            Place::Plateau => self.advance_on_plateau(part, body.gyration_m, drive, step_s)?,
            Place::Falling => return None,
        };
        self.walls.confine(part, body, scratch);
        if body.is_round() {
            return Some(travel_m2);
        }
        // Corners go farther than the centre.
        let swept_m = body.radius_m * (part.yaw_rad - before_rad).abs();
        Some((travel_m2.sqrt() + swept_m).powi(2))
    }

    /// On the plateau a part feels the same in all directions, so it is followed in the tray's own axes.
    ///
    /// The part's own turning comes third, times its radius of gyration: what is at rest in the platen turns back in the
    /// tray.
    fn advance_on_plateau(&self, part: &mut Part, gyration_m: f64, tray: &TrayDrive, step_s: f64) -> Option<f64> {
        let velocity = [part.velocity_x_m_s, part.velocity_y_m_s];
        let felt = tray.felt_m_s2([part.x_m, part.y_m], velocity);
        let drive = [felt[0], felt[1], -gyration_m * tray.yaw_rad_s2];
        if !part.is_moving() && self.level_grip.holds(drive) {
            return None;
        }
        let velocity = [velocity[0], velocity[1], gyration_m * part.yaw_rate_rad_s];
        let slid = self.level_grip.slide(velocity, drive, step_s, Swerve::Followed);
        part.x_m += slid.displacement_m[0];
        part.y_m += slid.displacement_m[1];
        [part.velocity_x_m_s, part.velocity_y_m_s, _] = slid.velocity_m_s;
        turn(part, gyration_m, slid.velocity_m_s[2], slid.displacement_m[2]);
        Some(slid.displacement_m[0].powi(2) + slid.displacement_m[1].powi(2))
    }

    /// On the ramp a part is followed in axes outward and uphill along the slope that stay put over the step. In these,
    /// r ψ̇² is left to the straight path, and the speed uphill gains the 2 ṙ ψ̇ by which e_ψ turns, along the slope.
    fn advance_on_ramp(&self, part: &mut Part, gyration_m: f64, tray: &TrayDrive, step_s: f64) -> Option<f64> {
        let r = (part.x_m * part.x_m + part.y_m * part.y_m).sqrt();
        let per_r = 1.0 / r;
        let (out_x, out_y) = (part.x_m * per_r, part.y_m * per_r);
        let along_axes = |[x, y]: [f64; 2]| [x * out_x + y * out_y, y * out_x - x * out_y];
        let from_axes =
            |[outward, around]: [f64; 2]| [outward * out_x - around * out_y, outward * out_y + around * out_x];

        let velocity = [part.velocity_x_m_s, part.velocity_y_m_s];
        let [felt_outward, felt_around] = along_axes(tray.felt_m_s2([part.x_m, part.y_m], velocity));
        let [outward, around] = along_axes(velocity);
        let incline = Incline::helix(self.pitch_m_per_rad, r);
        let turned = 2.0 * outward * around * per_r;
        let load = incline.load(turned - felt_around, STANDARD_GRAVITY_M_S2);
        let drive = [felt_outward, load.along_m_s2 + turned * incline.stretch, -gyration_m * tray.yaw_rad_s2];
        // Where the tray falls away faster than the part, nothing presses it.
        let grip = self.friction.grip(load.normal_m_s2.max(0.0));
        if !part.is_moving() && grip.holds(drive) {
            return None;
        }
        let velocity = [outward, around * incline.stretch, gyration_m * part.yaw_rate_rad_s];
        let slid = grip.slide(velocity, drive, step_s, Swerve::Followed);
        let moved = [slid.displacement_m[0], slid.displacement_m[1] * incline.cos];
        let [x_m, y_m] = from_axes(moved);
        part.x_m += x_m;
        part.y_m += y_m;
        let velocity = [slid.velocity_m_s[0], slid.velocity_m_s[1] * incline.cos];
        [part.velocity_x_m_s, part.velocity_y_m_s] = from_axes(velocity);
        turn(part, gyration_m, slid.velocity_m_s[2], slid.displacement_m[2]);
        Some(moved[0].powi(2) + moved[1].powi(2))
    }

    /// Keeps a part between the walls and, on the ramp, in front of the drop-off's face.
    pub(super) fn confine(&self, part: &mut Part, scratch: &mut Scratch) {
        self.walls.confine(part, &self.bodies[part.pose], scratch);
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
        // The whole acceleration at its worst: against the part down the slope, and lifting it.
        let worst_m_s2 = |incline: Incline| {
            let (still, shaken) = (incline.load(0.0, STANDARD_GRAVITY_M_S2), incline.load(1.0, STANDARD_GRAVITY_M_S2));
            let drive = Affine { at_zero: [still.along_m_s2], per_m_s2: [-1.0] };
            let normal = Affine { at_zero: still.normal_m_s2, per_m_s2: shaken.normal_m_s2 - still.normal_m_s2 };
            held_up_to_m_s2(self.friction.static_coefficient(), &drive, &normal).unwrap_or(f64::NEG_INFINITY)
        };
        let ramp = parts.iter().filter(|part| part.place == Place::Ramp);
        let inclines = ramp.map(|part| Incline::helix(self.pitch_m_per_rad, part.radius_m()));
        inclines.map(worst_m_s2).fold(worst_m_s2(Incline::LEVEL), f64::min)
    }
}

/// Turns a part by what is given times its radius of gyration.
fn turn(part: &mut Part, gyration_m: f64, velocity_m_s: f64, displacement_m: f64) {
    part.yaw_rate_rad_s = velocity_m_s / gyration_m;
    part.yaw_rad += displacement_m / gyration_m;
    if part.yaw_rad.abs() > PI {
        part.yaw_rad -= TAU * (part.yaw_rad / TAU).round();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use proptest::prelude::*;

    use super::*;
    use crate::parts::tests::{disc, part_at, track as track_of};

    static TRACK: LazyLock<TrayPath> = LazyLock::new(|| track_of(&disc(0.006, 0.2)));

    #[test]
    fn edges_are_passed_where_they_are() {
        let passage = |place, angle_rad: f64| {
            let part = part_at(place, 0.08 * angle_rad.cos(), 0.08 * angle_rad.sin());
            TRACK.passage(&part)
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
            let track = &*TRACK;
            let place = Place::from(TrayGeometry::PAPER.surface(angle_rad));
            let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
            let mut part = part_at(place, x_m, y_m);
            let hold_m_s2 = track.hold_m_s2(&[part]).max(0.0);
            // Up to rounding at the very limit.
            let least_m_s2 = 0.999_999 * hold_m_s2;
            let drive = TrayDrive {
                centre_m_s2: [least_m_s2 * direction.cos(), least_m_s2 * direction.sin()],
                yaw_rad_s: 0.0,
                yaw_rad_s2: 0.0,
            };
            prop_assert!(drive.bound_m_s2(radius_m) <= hold_m_s2);
            prop_assert_eq!(track.advance(&mut part, &drive, 5e-4, &mut Scratch::default()), None);
        }
    }
}
