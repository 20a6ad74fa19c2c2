//! What drives a part on the moving tray, and what presses it to the tray: the equations of motion without friction.
//!
//! r, ψ are polar coordinates in the tray, θ the yaw of the tray, Ω = ψ̇ + θ̇, tan φ = c/r on the ramp and 0 on the plateau,
//! a_c the acceleration of the tray's centre, e_r and e_ψ the unit vectors outward and counter-clockwise at the part
//! (Quaid Eqs 18–29, corrected, with a_c added). With p = r θ̈ + 2 ṙ Ω + a_c·e_ψ:
//!
//! - normal force per mass: N = g cos φ − p sin φ (Eq. 23);
//! - outward: r̈ = r Ω² − a_c·e_r + f1;
//! - along the track: r ψ̈/cos φ = −g sin φ − p cos φ + f2;
//! - friction (f1, f2) acts as [`friction`](super::friction) says on the speeds (ṙ, r ψ̇/cos φ).
//!
//! r Ω² − a_c·e_r − r ψ̇² and 2 ṙ ψ̇ − p are what the turning tray makes of a part that moves straight on, [`TrayDrive::felt_m_s2`].
//! How ψ̈ turns into a change of speed depends on the axes in which an engine keeps its speeds, so that is left to the engine.

use crate::motion::MotionSample;

/// Motion of the tray over a step, in axes that are fixed in the tray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrayDrive {
    /// Acceleration of the tray's centre along the axes, m/s².
    pub centre_m_s2: [f64; 2],
    /// Yaw rate θ̇ in the middle of the step, rad/s.
    pub yaw_rad_s: f64,
    /// Yaw acceleration θ̈, rad/s².
    pub yaw_rad_s2: f64,
}

impl TrayDrive {
    /// The drive in the middle of a step that starts `from_s` into `sample` and lasts `step_s`, in the axes at the angle
    /// `axes_rad` in the tray.
    #[must_use]
    #[inline]
    pub fn new(sample: &MotionSample, from_s: f64, step_s: f64, axes_rad: f64) -> Self {
        let acceleration = sample.acceleration;
        let middle_s = from_s + 0.5 * step_s;
        let centre_m_s2 = if acceleration.x == 0.0 && acceleration.y == 0.0 {
            [0.0; 2]
        } else {
            let yaw_rad = sample.position.z + (sample.velocity.z + 0.5 * acceleration.z * middle_s) * middle_s;
            let (sin, cos) = (yaw_rad + axes_rad).sin_cos();
            [acceleration.x * cos + acceleration.y * sin, acceleration.y * cos - acceleration.x * sin]
        };
        Self { centre_m_s2, yaw_rad_s: sample.velocity.z + acceleration.z * middle_s, yaw_rad_s2: acceleration.z }
    }

    /// Acceleration, as seen from the tray and along its axes, of what is free to move at `place_m` from the tray's centre
    /// and has `velocity_m_s` relative to the tray: centrifugal, Coriolis and Euler acceleration and the translation, m/s².
    #[must_use]
    #[inline]
    pub fn felt_m_s2(&self, place_m: [f64; 2], velocity_m_s: [f64; 2]) -> [f64; 2] {
        let rate = self.yaw_rad_s;
        [
            rate * (rate * place_m[0] + 2.0 * velocity_m_s[1]) + self.yaw_rad_s2 * place_m[1] - self.centre_m_s2[0],
            rate * (rate * place_m[1] - 2.0 * velocity_m_s[0]) - self.yaw_rad_s2 * place_m[0] - self.centre_m_s2[1],
        ]
    }

    /// No point of the tray within `radius_m` of its axis is accelerated by more than this, m/s².
    #[must_use]
    pub fn bound_m_s2(&self, radius_m: f64) -> f64 {
        let [x, y] = self.centre_m_s2;
        x.hypot(y) + radius_m * (self.yaw_rad_s2.abs() + self.yaw_rad_s.powi(2))
    }
}

/// How steep the track is at a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incline {
    /// sin φ.
    pub sin: f64,
    /// cos φ.
    pub cos: f64,
    /// 1/cos φ: way along the track for each metre of horizontal way.
    pub stretch: f64,
}

/// Forces per mass on a part, without friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLoad {
    /// What drives it along the track, r ψ̈/cos φ without friction, m/s².
    pub along_m_s2: f64,
    /// Normal force N per mass, m/s²; negative where the tray would leave the part behind.
    pub normal_m_s2: f64,
}

impl Incline {
    /// No slope.
    pub const LEVEL: Self = Self { sin: 0.0, cos: 1.0, stretch: 1.0 };

    /// The slope of a helix that rises by `pitch_m_per_rad` (m/rad), at a distance of `radius_m` from its axis.
    #[must_use]
    #[inline]
    pub fn helix(pitch_m_per_rad: f64, radius_m: f64) -> Self {
        let tan = pitch_m_per_rad / radius_m;
        let stretch = (1.0 + tan * tan).sqrt();
        let cos = 1.0 / stretch;
        Self { sin: tan * cos, cos, stretch }
    }

    /// A slope of `slope_rad`, less than 90° either way.
    #[must_use]
    pub fn new(slope_rad: f64) -> Self {
        let (sin, cos) = slope_rad.sin_cos();
        Self { sin, cos, stretch: 1.0 / cos }
    }

    /// What a tray does to a part that presses its slope uphill with p (m/s², horizontal): p = r θ̈ + 2 ṙ Ω + a_c·e_ψ on the
    /// annular tray, and the tray's acceleration a on a straight slope (Quaid Eqs 11–17).
    #[must_use]
    #[inline]
    pub fn load(&self, push_m_s2: f64, gravity_m_s2: f64) -> SurfaceLoad {
        SurfaceLoad {
            along_m_s2: -gravity_m_s2 * self.sin - push_m_s2 * self.cos,
            normal_m_s2: gravity_m_s2 * self.cos - push_m_s2 * self.sin,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::tray::TrayGeometry;

    #[test]
    fn the_drive_is_that_of_the_middle_of_the_step() {
        let sample = MotionSample {
            position: Vector3::new(0.0, 0.0, 0.3),
            velocity: Vector3::new(0.0, 0.0, 20.0),
            acceleration: Vector3::new(3.0, 0.0, 1000.0),
        };
        let drive = TrayDrive::new(&sample, 1e-3, 2e-3, 0.1);
        // 2 ms into the sample: 20 + 1000 × 0.002 rad/s, and 0.3 + 0.04 + 0.002 rad, to axes 0.1 rad farther.
        assert!((drive.yaw_rad_s - 22.0).abs() < 1e-12);
        assert!((drive.centre_m_s2[0] - 3.0 * 0.442_f64.cos()).abs() < 1e-12);
        assert!((drive.centre_m_s2[1] + 3.0 * 0.442_f64.sin()).abs() < 1e-12);
    }

    #[test]
    fn verif_what_rests_in_the_platen_feels_what_keeps_it_there() {
        // Seen from a tray that turns about it, a point at rest in the platen circles backwards: a = −θ̇² ρ − θ̈ ẑ×ρ.
        let drive = TrayDrive { centre_m_s2: [0.0; 2], yaw_rad_s: 3.0, yaw_rad_s2: 7.0 };
        let (x, y) = (0.05, -0.02);
        let felt = drive.felt_m_s2([x, y], [3.0 * y, -3.0 * x]);
        assert!((felt[0] - (-9.0 * x + 7.0 * y)).abs() < 1e-12 && (felt[1] - (-9.0 * y - 7.0 * x)).abs() < 1e-12);
    }

    #[test]
    fn verif_the_polar_form_of_quaid_is_the_cartesian_one() {
        // At (r, 0) with velocity (ṙ, r ψ̇): felt + r ψ̇² outward is r Ω² − a_r, and 2 ṙ ψ̇ − felt along is p.
        let drive = TrayDrive { centre_m_s2: [0.3, -0.4], yaw_rad_s: 1.7, yaw_rad_s2: -11.0 };
        let (r, r_dot, psi_dot): (f64, f64, f64) = (0.08, 0.05, 0.9);
        let felt = drive.felt_m_s2([r, 0.0], [r_dot, r * psi_dot]);
        let omega = psi_dot + 1.7;
        assert!((felt[0] + r * psi_dot * psi_dot - (r * omega * omega - 0.3)).abs() < 1e-12);
        let push = r * -11.0 + 2.0 * r_dot * omega - 0.4;
        assert!((2.0 * r_dot * psi_dot - felt[1] - push).abs() < 1e-12);
    }

    #[test]
    fn a_helix_is_as_steep_as_the_ramp() {
        let tray = TrayGeometry::PAPER;
        let (helix, ramp) = (Incline::helix(tray.pitch_m_per_rad(), 0.06), Incline::new(tray.ramp_slope_rad(0.06)));
        assert!((helix.sin - ramp.sin).abs() < 1e-15 && (helix.stretch - ramp.stretch).abs() < 1e-15);
        assert_eq!(Incline::helix(0.0, 0.06), Incline::LEVEL);
        // At rest, gravity alone: g cos φ presses, g sin φ drives downhill.
        let load = ramp.load(0.0, 10.0);
        assert!((load.normal_m_s2.hypot(load.along_m_s2) - 10.0).abs() < 1e-12 && load.along_m_s2 < 0.0);
    }
}
