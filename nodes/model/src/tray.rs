//! The annular tray: a helical ramp, a plateau and the drop-off between them.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Geometry of the annular tray.
///
/// The running surface lies between two cylindrical walls. Its height is z = c ψ on the ramp, 0 ≤ ψ < Θ, with
/// c = rise/Θ, and z = rise on the plateau, Θ ≤ ψ < 2π; at ψ = 2π it drops to the foot of the ramp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrayGeometry {
    /// Radius of the outer wall, m.
    pub outer_radius_m: f64,
    /// Radius of the inner wall, m.
    pub inner_radius_m: f64,
    /// Height of the plateau above the foot of the ramp, m.
    pub rise_m: f64,
    /// Angle Θ spanned by the ramp, rad.
    pub ramp_angle_rad: f64,
}

/// The part of the running surface at an angle ψ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// The helical ramp, 0 ≤ ψ < Θ.
    Ramp,
    /// The level plateau, Θ ≤ ψ < 2π.
    Plateau,
}

/// Where a part is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// On the helical ramp.
    Ramp,
    /// On the level plateau.
    Plateau,
    /// Off the end of the plateau: falling, coming to rest, or waiting for room at the foot of the ramp. Its position is
    /// where it left the plateau; it touches nothing and cannot be picked.
    Falling,
}

impl From<Surface> for Place {
    fn from(surface: Surface) -> Self {
        match surface {
            Surface::Ramp => Self::Ramp,
            Surface::Plateau => Self::Plateau,
        }
    }
}

impl TrayGeometry {
    /// The tray of the paper: 30 mm to 90 mm, a ramp of 180° rising 20 mm.
    pub const PAPER: Self =
        Self { outer_radius_m: 0.090, inner_radius_m: 0.030, rise_m: 0.020, ramp_angle_rad: std::f64::consts::PI };

    /// Rise of the ramp per radian, c = rise/Θ, m/rad.
    #[must_use]
    pub fn pitch_m_per_rad(&self) -> f64 {
        self.rise_m / self.ramp_angle_rad
    }

    /// Slope angle φ = atan(c/r) of the ramp along the helix at radius `radius_m`, rad.
    #[must_use]
    pub fn ramp_slope_rad(&self, radius_m: f64) -> f64 {
        (self.pitch_m_per_rad() / radius_m).atan()
    }

    /// Which surface lies at `angle_rad`, taken modulo 2π.
    #[must_use]
    pub fn surface(&self, angle_rad: f64) -> Surface {
        if angle_rad.rem_euclid(TAU) < self.ramp_angle_rad { Surface::Ramp } else { Surface::Plateau }
    }

    /// Height of the running surface above the foot of the ramp at `angle_rad`, taken modulo 2π, m.
    #[must_use]
    pub fn height_m(&self, angle_rad: f64) -> f64 {
        let angle_rad = angle_rad.rem_euclid(TAU);
        (angle_rad * self.pitch_m_per_rad()).min(self.rise_m)
    }

    /// From a part as it would lie on a level floor, its centre of mass `com_height_m` (m) above that at the origin, to the
    /// tray's frame, where it lies at `radius_m` (m) and `angle_rad` (rad), turned by `yaw_rad` (rad): on the ramp it leans
    /// as the ramp does under its middle.
    #[must_use]
    pub fn tray_from_lying(
        &self,
        place: Place,
        radius_m: f64,
        angle_rad: f64,
        yaw_rad: f64,
        com_height_m: f64,
    ) -> Isometry3<f64> {
        let (sin, cos) = angle_rad.sin_cos();
        let outwards = Unit::new_unchecked(Vector3::new(cos, sin, 0.0));
        let (floor_m, lean) = match place {
            Place::Ramp => {
                let slope_rad = self.ramp_slope_rad(radius_m);
                (self.height_m(angle_rad), UnitQuaternion::from_axis_angle(&outwards, slope_rad))
            }
            Place::Plateau | Place::Falling => (self.rise_m, UnitQuaternion::identity()),
        };
        let foot = Vector3::new(radius_m * cos, radius_m * sin, floor_m);
        let middle = foot + lean * Vector3::new(0.0, 0.0, com_height_m);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad.rem_euclid(TAU));
        Isometry3::from_parts(Translation3::from(middle), lean * turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_paper_tray_has_the_slopes_of_the_reference_table() {
        // fig15_speed_vs_radius.csv: 4.046108° at 90 mm, 6.056611° at 60 mm.
        let tray = TrayGeometry::PAPER;
        assert!((tray.ramp_slope_rad(0.090).to_degrees() - 4.046_108_071_701_112).abs() < 1e-12);
        assert!((tray.ramp_slope_rad(0.060).to_degrees() - 6.056_610_594_230_222).abs() < 1e-12);
    }

    #[test]
    fn height_rises_to_the_plateau_and_drops_at_a_full_turn() {
        let tray = TrayGeometry::PAPER;
        assert_eq!(tray.surface(0.0), Surface::Ramp);
        assert_eq!(tray.surface(tray.ramp_angle_rad), Surface::Plateau);
        assert_eq!(tray.surface(-1e-9), Surface::Plateau);
        assert!((tray.height_m(tray.ramp_angle_rad / 2.0) - 0.010).abs() < 1e-12);
        assert!((tray.height_m(TAU - 1e-9) - 0.020).abs() < 1e-12);
        assert!(tray.height_m(TAU).abs() < 1e-12);
    }
}
