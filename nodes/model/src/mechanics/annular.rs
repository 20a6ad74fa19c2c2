//! A part on the annular tray in two dimensions, one closed-form step per sample of the tray's motion.
//!
//! The equations are those of [`tray_forces`](super::tray_forces). The part keeps its speeds w1 = ṙ outward and
//! w2 = r ψ̇/cos φ along the track, so ẇ1 = r̈, and ẇ2 = r ψ̈/cos φ + ṙ ψ̇ cos φ, the last term because w2 turns ψ̇ into a
//! speed at a changing r.
//!
//! The drive and N are taken as constant over the sample, the local-slope model. The sliding within it is
//! solved in closed form where w keeps to a line, as it nearly does under pure yaw: there a step is exact, and the static
//! window is tested exactly where the motion reverses, at any sample period. Where w turns, the step is of first order.

use std::f64::consts::TAU;

use super::check_slope;
use super::friction::{Friction, Swerve};
use super::tray_forces::{Incline, TrayDrive};
use crate::motion::MotionSample;
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;

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
        let on_ramp = part.angle_rad < self.tray.ramp_angle_rad;
        let incline = if on_ramp { Incline::helix(self.pitch_m_per_rad, r) } else { Incline::LEVEL };
        let tray = TrayDrive::new(motion, 0.0, sample_s, part.angle_rad);
        let (outward, around) = (part.outward_m_s, part.along_m_s * incline.cos);
        let spin = around / r;
        let felt = tray.felt_m_s2([r, 0.0], [outward, around]);
        let load = incline.load(2.0 * outward * spin - felt[1], self.gravity_m_s2);
        let drive = [felt[0] + around * spin, load.along_m_s2 + outward * spin * incline.cos];
        let grip = self.friction.grip(load.normal_m_s2.max(0.0));
        let slid = grip.slide([outward, part.along_m_s], self.borne(part, drive), sample_s, Swerve::Neglected);

        part.radius_m = r + slid.displacement_m[0];
        part.angle_rad += slid.displacement_m[1] * incline.cos / (r + slid.displacement_m[0] / 2.0);
        [part.outward_m_s, part.along_m_s] = slid.velocity_m_s;
        part.sticking = slid.at_rest();
        self.meet_walls(part)
    }

    /// What is left of a drive where walls and face bear what presses the part against them.
    fn borne(&self, part: &PartState, [mut outward, mut along]: [f64; 2]) -> [f64; 2] {
        let (r, outward_m_s) = (part.radius_m, part.outward_m_s);
        if (r >= self.tray.outer_radius_m && outward > 0.0 && outward_m_s >= 0.0)
            || (r <= self.tray.inner_radius_m && outward < 0.0 && outward_m_s <= 0.0)
        {
            outward = 0.0;
        }
        if part.angle_rad <= 0.0 && along < 0.0 && part.along_m_s <= 0.0 {
            along = 0.0;
        }
        [outward, along]
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
