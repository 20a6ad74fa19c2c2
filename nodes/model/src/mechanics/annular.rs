//! A part on the annular tray in two dimensions, one closed-form step per sample of the tray's motion.
//!
//! r, ψ are polar coordinates in the tray, θ the yaw of the tray, Ω = ψ̇ + θ̇, w1 = ṙ, w2 = r ψ̇/cos φ the speed along the
//! track, tan φ = c/r on the ramp and 0 on the plateau, a_c the acceleration of the tray's centre with e_r, e_ψ the local
//! unit vectors (Quaid Eqs 18–29, corrected, with a_c added). With p = r θ̈ + 2 ṙ Ω + a_c·e_ψ:
//!
//! - normal force per mass: N = g cos φ − p sin φ (Eq. 23);
//! - ẇ1 = r Ω² − a_c·e_r + f1;
//! - ẇ2 = −g sin φ − p cos φ + w1 w2 cos² φ/r + f2, the last term but one because w2 turns ψ̇ into a speed at a changing r;
//! - friction: (f1, f2) = −μ_k N w/|w| while sliding (Eq. 21); at rest it holds what drives the part as long as that is at
//!   most μ_s N (Eqs 24, 28, 29).
//!
//! The drive and N are taken as constant over the sample, the local-slope model. The sliding within it is
//! solved in closed form where w keeps to a line, as it nearly does under pure yaw: there a step is exact, and the static
//! window is tested exactly where the motion reverses, at any sample period. Where w turns, the step is of first order.

use std::f64::consts::TAU;

use super::{Friction, check_slope};
use crate::motion::MotionSample;
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;

/// Share of the limit of static friction taken for rounding.
const REST_ROUNDING: f64 = 1e-12;

/// A part on the tray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartState {
    /// Distance from the tray's axis, m.
    pub radius_m: f64,
    /// Angle ψ in the tray, rad, in \[0, 2π).
    pub angle_rad: f64,
    /// Speed outward relative to the tray, w1, m/s.
    pub outward_m_s: f64,
    /// Speed along the track relative to the tray, w2, counter-clockwise positive, m/s.
    pub along_m_s: f64,
    /// Whether the part ended the last step at rest on the tray.
    pub sticking: bool,
}

impl PartState {
    /// A part at rest on the tray.
    #[must_use]
    pub fn at_rest(radius_m: f64, angle_rad: f64) -> Self {
        Self { radius_m, angle_rad: angle_rad.rem_euclid(TAU), outward_m_s: 0.0, along_m_s: 0.0, sticking: true }
    }
}

/// What a part met during a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encounter {
    /// Nothing.
    None,
    /// The cylindrical wall inside, which took its radial speed.
    InnerWall,
    /// The cylindrical wall outside, which took its radial speed.
    OuterWall,
    /// The face of the drop-off behind the foot of the ramp, which took its speed along the track.
    Face,
    /// It went over the edge at 2π and is now above the foot of the ramp, speed unchanged; the fall is not modelled.
    DropOff,
}

/// The annular tray with friction and gravity, ready to move parts. Walls take the speed into them and have no friction.
/// The radii of the tray bound the part's centre: a part with a body needs them moved in by its own radius.
#[derive(Clone, Copy, Debug)]
pub struct AnnularTrack {
    tray: TrayGeometry,
    pitch_m_per_rad: f64,
    friction: Friction,
    gravity_m_s2: f64,
}

impl AnnularTrack {
    /// A tray with friction and gravity.
    ///
    /// # Errors
    ///
    /// If gravity is not positive, or the tray is not one: 0 < inner < outer radius, rise not negative, 0 < Θ ≤ 2π.
    pub fn new(tray: TrayGeometry, friction: Friction, gravity_m_s2: f64) -> Result<Self, OutOfRange> {
        let TrayGeometry { outer_radius_m, inner_radius_m, rise_m, ramp_angle_rad } = tray;
        OutOfRange::unless_positive("inner_radius_m", inner_radius_m)?;
        OutOfRange::unless(
            outer_radius_m > inner_radius_m,
            "outer_radius_m",
            outer_radius_m,
            format_args!("greater than inner_radius_m = {inner_radius_m}, and finite"),
        )?;
        OutOfRange::unless(rise_m >= 0.0, "rise_m", rise_m, "at least 0, and finite")?;
        OutOfRange::unless(
            ramp_angle_rad > 0.0 && ramp_angle_rad <= TAU,
            "ramp_angle_rad",
            ramp_angle_rad,
            "0 < ramp_angle_rad ≤ 2π",
        )?;
        check_slope(0.0, gravity_m_s2)?;
        Ok(Self { tray, pitch_m_per_rad: tray.pitch_m_per_rad(), friction, gravity_m_s2 })
    }

    /// The same tray with its walls out of the way, for motion at a radius held fixed.
    pub(crate) fn without_walls(&self) -> Self {
        let tray = TrayGeometry { inner_radius_m: 0.0, outer_radius_m: f64::INFINITY, ..self.tray };
        Self { tray, ..*self }
    }

    /// Checks that a radius lies on the tray.
    ///
    /// # Errors
    ///
    /// If it does not lie between the walls.
    pub fn check_radius(&self, radius_m: f64) -> Result<(), OutOfRange> {
        let TrayGeometry { inner_radius_m, outer_radius_m, .. } = self.tray;
        OutOfRange::unless(
            radius_m >= inner_radius_m && radius_m <= outer_radius_m,
            "radius_m",
            radius_m,
            format_args!("{inner_radius_m} to {outer_radius_m} (on the tray)"),
        )
    }

    /// The tray.
    #[must_use]
    pub fn tray(&self) -> &TrayGeometry {
        &self.tray
    }

    /// The friction.
    #[must_use]
    pub fn friction(&self) -> Friction {
        self.friction
    }

    /// Gravity, m/s².
    #[must_use]
    pub fn gravity_m_s2(&self) -> f64 {
        self.gravity_m_s2
    }

    /// Moves a part through one sample of the tray's motion, lasting `sample_s` (s).
    ///
    /// It allocates nothing and costs some tens of nanoseconds. Where the tray leaves the part behind (N < 0) the part
    /// is taken to slide without friction until it is touched again.
    pub fn step(&self, part: &mut PartState, motion: &MotionSample, sample_s: f64) -> Encounter {
        let r = part.radius_m;
        let pitch = if part.angle_rad < self.tray.ramp_angle_rad { self.pitch_m_per_rad } else { 0.0 };
        let helix = (r * r + pitch * pitch).sqrt();
        let (sin, cos) = (pitch / helix, r / helix);

        let forces = self.forces(part, motion, sample_s, (sin, cos));
        let slide = slide([part.outward_m_s, part.along_m_s], forces, sample_s);

        part.radius_m = r + slide.displacement_m[0];
        part.angle_rad += slide.displacement_m[1] * cos / (r + slide.displacement_m[0] / 2.0);
        [part.outward_m_s, part.along_m_s] = slide.velocity_m_s;
        part.sticking = slide.at_rest;
        self.meet_walls(part)
    }

    fn forces(&self, part: &PartState, motion: &MotionSample, sample_s: f64, (sin, cos): (f64, f64)) -> Forces {
        let (r, outward, along) = (part.radius_m, part.outward_m_s, part.along_m_s);
        let (a, g) = (&motion.acceleration, self.gravity_m_s2);
        let (centre_outward, centre_along) = if a.x == 0.0 && a.y == 0.0 {
            (0.0, 0.0)
        } else {
            let (s, c) = (part.angle_rad + motion.position.z).sin_cos();
            (a.x * c + a.y * s, a.y * c - a.x * s)
        };
        let yaw_rate = motion.velocity.z + a.z * sample_s / 2.0;
        let spin = along * cos / r;
        let turn = spin + yaw_rate;
        let push = r * a.z + 2.0 * outward * turn + centre_along;
        let normal = (g * cos - push * sin).max(0.0);
        let mut outward_drive = r * turn * turn - centre_outward;
        // A wall bears what presses the part against it.
        if (r >= self.tray.outer_radius_m && outward_drive > 0.0 && outward >= 0.0)
            || (r <= self.tray.inner_radius_m && outward_drive < 0.0 && outward <= 0.0)
        {
            outward_drive = 0.0;
        }
        let mut along_drive = -g * sin - push * cos + outward * spin * cos;
        if part.angle_rad <= 0.0 && along_drive < 0.0 && along <= 0.0 {
            along_drive = 0.0;
        }
        Forces {
            drive_m_s2: [outward_drive, along_drive],
            sliding_m_s2: self.friction.kinetic_coefficient() * normal,
            at_rest_m_s2: self.friction.static_coefficient() * normal * (1.0 + REST_ROUNDING),
        }
    }

    fn meet_walls(&self, part: &mut PartState) -> Encounter {
        let mut encounter = Encounter::None;
        if part.radius_m > self.tray.outer_radius_m {
            part.radius_m = self.tray.outer_radius_m;
            part.outward_m_s = part.outward_m_s.min(0.0);
            encounter = Encounter::OuterWall;
        } else if part.radius_m < self.tray.inner_radius_m {
            part.radius_m = self.tray.inner_radius_m;
            part.outward_m_s = part.outward_m_s.max(0.0);
            encounter = Encounter::InnerWall;
        }
        if part.angle_rad < 0.0 {
            part.angle_rad = 0.0;
            part.along_m_s = part.along_m_s.max(0.0);
            encounter = Encounter::Face;
        } else if part.angle_rad >= TAU {
            part.angle_rad -= TAU;
            encounter = Encounter::DropOff;
        }
        encounter
    }
}

/// Forces on a part per mass, constant over a step.
#[derive(Clone, Copy, Debug)]
struct Forces {
    /// What accelerates the part relative to the tray, without friction: outward and along, m/s².
    drive_m_s2: [f64; 2],
    /// Friction while sliding, μ_k N.
    sliding_m_s2: f64,
    /// Largest friction at rest, μ_s N.
    at_rest_m_s2: f64,
}

/// Outcome of a step of sliding.
#[derive(Clone, Copy, Debug)]
struct Slide {
    velocity_m_s: [f64; 2],
    displacement_m: [f64; 2],
    at_rest: bool,
}

/// Slides for `duration_s` under constant forces.
///
/// If friction stops the motion in its direction within the step, the step is split there and the static window decides,
/// as in one dimension. Otherwise friction acts against the final direction, which is stable for any step and exact on
/// a line.
fn slide(velocity_m_s: [f64; 2], forces: Forces, duration_s: f64) -> Slide {
    let Forces { drive_m_s2: d, sliding_m_s2, at_rest_m_s2 } = forces;
    let mut w = velocity_m_s;
    let mut left_s = duration_s;
    let mut displacement_m = [0.0; 2];
    let speed = norm(w);
    let mut stopped = speed == 0.0;
    if !stopped {
        let heading = [w[0] / speed, w[1] / speed];
        let along = d[0] * heading[0] + d[1] * heading[1];
        let brake = sliding_m_s2 - along;
        if brake * left_s > speed {
            let stop_s = speed / brake;
            // What drives across the heading has had its way meanwhile.
            let end = [(d[0] - along * heading[0]) * stop_s, (d[1] - along * heading[1]) * stop_s];
            displacement_m = [(w[0] + end[0]) / 2.0 * stop_s, (w[1] + end[1]) / 2.0 * stop_s];
            left_s -= stop_s;
            w = end;
            stopped = true;
        }
    }
    if stopped && norm(d) <= at_rest_m_s2 {
        return Slide { velocity_m_s: [0.0; 2], displacement_m, at_rest: true };
    }
    let free = [w[0] + d[0] * left_s, w[1] + d[1] * left_s];
    let free_speed = norm(free);
    let kept = if free_speed > 0.0 { (1.0 - sliding_m_s2 * left_s / free_speed).max(0.0) } else { 0.0 };
    let end = [free[0] * kept, free[1] * kept];
    displacement_m[0] += (w[0] + end[0]) / 2.0 * left_s;
    displacement_m[1] += (w[1] + end[1]) / 2.0 * left_s;
    Slide { velocity_m_s: end, displacement_m, at_rest: false }
}

fn norm(v: [f64; 2]) -> f64 {
    (v[0] * v[0] + v[1] * v[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn forces(drive_m_s2: [f64; 2], sliding_m_s2: f64, at_rest_m_s2: f64) -> Forces {
        Forces { drive_m_s2, sliding_m_s2, at_rest_m_s2 }
    }

    #[test]
    fn verif_a_slide_on_a_line_is_exact_through_a_reversal() {
        // 1 m/s against 5 m/s² of drive and 2 of friction stops after 1/7 s and comes back at 3 m/s².
        let end = slide([0.0, 1.0], forces([0.0, -5.0], 2.0, 2.5), 0.5);
        let (stop_s, back_s) = (1.0 / 7.0, 0.5 - 1.0 / 7.0);
        assert!((end.velocity_m_s[1] + 3.0 * back_s).abs() < 1e-15);
        assert!((end.displacement_m[1] - (stop_s / 2.0 - 1.5 * back_s * back_s)).abs() < 1e-15);
        assert!(!end.at_rest);
        // With 5 m/s² of static friction it stays where it stopped.
        let end = slide([0.0, 1.0], forces([0.0, -5.0], 2.0, 5.0), 0.5);
        assert!(end.at_rest && (end.displacement_m[1] - stop_s / 2.0).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn verif_sliding_friction_never_adds_energy(
            w in (-0.5..0.5_f64, -0.5..0.5_f64), d in (-20.0..20.0_f64, -20.0..20.0_f64),
            sliding in 0.0..10.0_f64, excess in 1.0..1.5_f64, duration_s in 1e-5..1e-2_f64,
        ) {
            let end = slide([w.0, w.1], forces([d.0, d.1], sliding, sliding * excess), duration_s);
            let gained = (norm(end.velocity_m_s).powi(2) - norm([w.0, w.1]).powi(2)) / 2.0;
            let work = d.0 * end.displacement_m[0] + d.1 * end.displacement_m[1];
            prop_assert!(gained <= work + 1e-12, "friction put in {}", gained - work);
        }

        #[test]
        fn verif_sliding_has_no_handedness(
            w in (-0.5..0.5_f64, -0.5..0.5_f64), d in (-20.0..20.0_f64, -20.0..20.0_f64), sliding in 0.0..10.0_f64,
        ) {
            let one = slide([w.0, w.1], forces([d.0, d.1], sliding, sliding), 5e-4);
            let other = slide([w.0, -w.1], forces([d.0, -d.1], sliding, sliding), 5e-4);
            let difference = [one.velocity_m_s[0] - other.velocity_m_s[0], one.velocity_m_s[1] + other.velocity_m_s[1]];
            prop_assert!(norm(difference) < 1e-15);
        }
    }
}
