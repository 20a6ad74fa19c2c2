//! The tray as it stands under the camera.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::CameraModel;
use crate::range::OutOfRange;
use crate::tray::TrayGeometry;

/// The tray on its courier: what camera and selector must know of its heights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MountedTray {
    /// Shape of the running surface.
    pub geometry: TrayGeometry,
    /// Foot of the ramp above the platen, m.
    #[serde(default = "MountedTray::default_floor_height_m")]
    pub floor_height_m: f64,
    /// Top of both walls above the plateau, m.
    #[serde(default = "MountedTray::default_lip_m")]
    pub lip_m: f64,
    /// Thickness of the outer wall, m.
    #[serde(default = "MountedTray::default_wall_thickness_m")]
    pub wall_thickness_m: f64,
}

impl MountedTray {
    const fn default_floor_height_m() -> f64 {
        0.050
    }

    const fn default_lip_m() -> f64 {
        0.003
    }

    const fn default_wall_thickness_m() -> f64 {
        0.003
    }

    /// A tray of this shape mounted as the default scenario mounts it.
    #[must_use]
    pub fn new(geometry: TrayGeometry) -> Self {
        Self {
            geometry,
            floor_height_m: Self::default_floor_height_m(),
            lip_m: Self::default_lip_m(),
            wall_thickness_m: Self::default_wall_thickness_m(),
        }
    }

    /// Checks every number, those of the geometry included.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let g = self.geometry;
        let outer_ok = g.outer_radius_m > 0.0 && g.outer_radius_m <= 10.0;
        OutOfRange::unless(outer_ok, "tray.outer_radius_m", g.outer_radius_m, "above 0 up to 10 m")?;
        let inner_ok = g.inner_radius_m > 0.0 && g.inner_radius_m < g.outer_radius_m;
        OutOfRange::unless(inner_ok, "tray.inner_radius_m", g.inner_radius_m, "above 0, below tray.outer_radius_m")?;
        OutOfRange::unless((0.0..=1.0).contains(&g.rise_m), "tray.rise_m", g.rise_m, "0 to 1 m")?;
        let ramp_ok = g.ramp_angle_rad > 0.0 && g.ramp_angle_rad < TAU;
        OutOfRange::unless(ramp_ok, "tray.ramp_angle_rad", g.ramp_angle_rad, "above 0, below 2π rad")?;
        for (field, value) in [
            ("tray.floor_height_m", self.floor_height_m),
            ("tray.lip_m", self.lip_m),
            ("tray.wall_thickness_m", self.wall_thickness_m),
        ] {
            OutOfRange::unless((0.0..=1.0).contains(&value), field, value, "0 to 1 m")?;
        }
        Ok(())
    }

    /// The plateau above the platen, m.
    #[must_use]
    pub fn plateau_height_m(&self) -> f64 {
        self.floor_height_m + self.geometry.rise_m
    }

    /// The top of the walls above the platen, m.
    #[must_use]
    pub fn wall_top_m(&self) -> f64 {
        self.plateau_height_m() + self.lip_m
    }

    /// The pose (platen from tray) nearest to one of this tray on a grid whose steps move what this camera sees of the plateau
    /// by `step_px` pixels at most along an axis, or round its outer wall: what was worked out for it holds for its neighbours.
    #[must_use]
    pub fn on_grid(&self, camera: &CameraModel, platen_from_tray: &Isometry2<f64>, step_px: f64) -> Isometry2<f64> {
        let step_m = step_px * camera.m_per_px(self.plateau_height_m());
        let rounded = |value: f64, step: f64| (value / step).round() * step;
        let place = platen_from_tray.translation.vector.map(|value| rounded(value, step_m));
        let yaw_rad = rounded(platen_from_tray.rotation.angle(), step_m / self.geometry.outer_radius_m);
        Isometry2::new(Vector2::new(place.x, place.y), yaw_rad)
    }

    /// How far `point` (tray frame) lies inside the plateau sector's two straight edges, the drop-off and the end of the
    /// ramp; negative outside, m.
    #[must_use]
    pub fn inside_sector_m(&self, point: Point2<f64>) -> f64 {
        let (sin, cos) = self.geometry.ramp_angle_rad.sin_cos();
        let before_drop_off = -point.y;
        let beyond_ramp = cos * point.y - sin * point.x;
        if self.geometry.ramp_angle_rad < std::f64::consts::PI {
            before_drop_off.max(beyond_ramp)
        } else {
            before_drop_off.min(beyond_ramp)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{CameraPose, CameraSpec, Distortion};
    use crate::tray::Surface;

    proptest! {
        #[test]
        fn inside_the_sector_is_the_plateau(
            ramp_angle_rad in 0.3..6.0, psi_rad in 0.0..TAU, radius_m in 0.03..0.09,
        ) {
            let geometry = TrayGeometry { ramp_angle_rad, ..TrayGeometry::PAPER };
            let point = Point2::new(radius_m * psi_rad.cos(), radius_m * psi_rad.sin());
            let inside_m = MountedTray::new(geometry).inside_sector_m(point);
            prop_assume!(inside_m.abs() > 1e-9);
            prop_assert_eq!(inside_m > 0.0, geometry.surface(psi_rad) == Surface::Plateau);
        }
    }

    #[test]
    fn poses_on_the_grid_stay_and_others_move_by_half_a_step_at_most() {
        let tray = MountedTray::new(TrayGeometry::PAPER);
        let camera = CameraModel::new(CameraSpec {
            width_px: 640,
            height_px: 480,
            focal_length_px: None,
            platen_m_per_px: Some(0.000_4),
            principal_point_px: None,
            distortion: Distortion::default(),
            pose: CameraPose { x_m: 0.3, y_m: 0.3, height_m: 0.6, yaw_rad: 0.0 },
        })
        .unwrap();
        let step_m = 0.1 * camera.m_per_px(tray.plateau_height_m());
        for index in 0..100 {
            let odd = f64::from(index) * 1.618e-5;
            let pose = Isometry2::new(Vector2::new(0.3 + odd, 0.2 - odd), -0.1 + 3.0 * odd);
            let rounded = tray.on_grid(&camera, &pose, 0.1);
            let moved = rounded.translation.vector - pose.translation.vector;
            assert!(moved.amax() < 0.501 * step_m, "{moved}");
            let turned = rounded.rotation.angle_to(&pose.rotation);
            assert!(turned.abs() * tray.geometry.outer_radius_m < 0.501 * step_m, "{turned}");
            let near = Isometry2::new(Vector2::repeat(1e-9), 1e-9) * rounded;
            assert_eq!(tray.on_grid(&camera, &near, 0.1), rounded, "and so one place has one pose");
        }
    }

    #[test]
    fn a_bad_tray_is_refused_by_name() {
        let mut tray = MountedTray::new(TrayGeometry::PAPER);
        assert_eq!(tray.validate(), Ok(()));
        tray.geometry.inner_radius_m = 0.1;
        assert_eq!(tray.validate().unwrap_err().parameter, "tray.inner_radius_m");
    }
}
