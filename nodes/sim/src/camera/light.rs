//! The light over the feeder, and what it makes of a surface.

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use feeder_model::range::OutOfRange;

/// A lamp seen from one direction plus diffuse light from all round, unevenly spread over the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LightModel {
    /// Grey level of a level, perfectly white surface in the middle of the picture, at an exposure of 0.5 ms.
    pub white_level: f64,
    /// Share of the light on a level surface that is diffuse, 0 to 1.
    pub diffuse_ratio: f64,
    /// Where the lamp stands, counter-clockwise from the platen's x, rad.
    pub azimuth_rad: f64,
    /// How high the lamp stands over the platen, rad.
    pub elevation_rad: f64,
    /// Relative change of brightness from the middle of the picture to its right border.
    pub gradient_right_ratio: f64,
    /// Relative change of brightness from the middle of the picture to its lower border.
    pub gradient_down_ratio: f64,
    /// Relative loss of brightness from the middle of the picture to its corners.
    pub vignetting_ratio: f64,
}

impl Default for LightModel {
    fn default() -> Self {
        Self {
            white_level: 235.0,
            diffuse_ratio: 0.72,
            azimuth_rad: 2.2,
            elevation_rad: 1.05,
            gradient_right_ratio: -0.06,
            gradient_down_ratio: -0.04,
            vignetting_ratio: 0.10,
        }
    }
}

impl LightModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let level_ok = (0.0..=1e4).contains(&self.white_level);
        OutOfRange::unless(level_ok, "light.white_level", self.white_level, "0 to 1e4")?;
        let diffuse_ok = (0.0..=1.0).contains(&self.diffuse_ratio);
        OutOfRange::unless(diffuse_ok, "light.diffuse_ratio", self.diffuse_ratio, "0 to 1")?;
        OutOfRange::unless(self.azimuth_rad.is_finite(), "light.azimuth_rad", self.azimuth_rad, "a finite number")?;
        let elevation_ok = (0.1..=std::f64::consts::FRAC_PI_2).contains(&self.elevation_rad);
        OutOfRange::unless(elevation_ok, "light.elevation_rad", self.elevation_rad, "0.1 to π/2 rad")?;
        for (field, value) in [
            ("light.gradient_right_ratio", self.gradient_right_ratio),
            ("light.gradient_down_ratio", self.gradient_down_ratio),
            ("light.vignetting_ratio", self.vignetting_ratio),
        ] {
            OutOfRange::unless(value.abs() <= 0.5, field, value, "-0.5 to 0.5")?;
        }
        Ok(())
    }

    /// Grey level of a level white surface at a pixel of an image of this size.
    pub(crate) fn white_at(&self, column: f64, row: f64, width_px: u32, height_px: u32) -> f32 {
        let right = 2.0 * (column + 0.5) / f64::from(width_px) - 1.0;
        let down = 2.0 * (row + 0.5) / f64::from(height_px) - 1.0;
        let gradient = self.gradient_right_ratio * right + self.gradient_down_ratio * down;
        let corner = (right * right + down * down) / 2.0;
        #[expect(clippy::cast_possible_truncation, reason = "grey levels need no more than f32")]
        let white = (self.white_level * (1.0 + gradient) * (1.0 - self.vignetting_ratio * corner)) as f32;
        white
    }

    /// The same light from a lamp that lies this way.
    pub(crate) fn with_lamp_towards(self, toward_lamp: Vector3<f64>) -> Self {
        let level = toward_lamp.xy();
        Self { azimuth_rad: level.y.atan2(level.x), elevation_rad: toward_lamp.z.atan2(level.norm()), ..self }
    }

    /// The light as a surface on a tray turned by `tray_yaw_rad` meets it.
    pub(crate) fn in_tray(&self, tray_yaw_rad: f64) -> Shading {
        let (sin, cos) = (self.azimuth_rad - tray_yaw_rad).sin_cos();
        let steepness = 1.0 / self.elevation_rad.tan();
        #[expect(clippy::cast_possible_truncation, reason = "grey levels need no more than f32")]
        let (diffuse, toward_lamp) =
            (self.diffuse_ratio as f32, Vector2::new((cos * steepness) as f32, (sin * steepness) as f32));
        Shading { diffuse, toward_lamp }
    }
}

/// Lambert shading in some frame with z up, relative to a level surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shading {
    diffuse: f32,
    /// Horizontal direction towards the lamp; its length is the shadow a post of unit height throws.
    pub(crate) toward_lamp: Vector2<f32>,
}

impl Shading {
    #[cfg(test)]
    pub(crate) fn of_lamp(diffuse: f32, toward_lamp: Vector2<f32>) -> Self {
        Self { diffuse, toward_lamp }
    }

    /// Brightness of a surface z(x, y) with this gradient, of whose lamp light the share `lit` arrives.
    pub(crate) fn on_slope(&self, gradient: Vector2<f32>, lit: f32) -> f32 {
        let toward = 1.0 - gradient.dot(&self.toward_lamp);
        let flattening = 1.0 / (1.0 + gradient.norm_squared()).sqrt();
        self.lit_by(lit * toward * flattening)
    }

    /// Brightness of a surface that gets `lamp` times the lamp light of a level one.
    pub(crate) fn lit_by(&self, lamp: f32) -> f32 {
        self.diffuse + (1.0 - self.diffuse) * lamp.max(0.0)
    }

    /// Brightness of an upright wall facing the horizontal unit vector `normal`: it sees half of the diffuse light.
    pub(crate) fn on_wall(&self, normal: Vector2<f32>) -> f32 {
        0.5 * self.diffuse + self.lamp_on_wall(normal)
    }

    /// The same of what comes straight from the lamp.
    pub(crate) fn lamp_on_wall(&self, normal: Vector2<f32>) -> f32 {
        (1.0 - self.diffuse) * normal.dot(&self.toward_lamp).max(0.0)
    }

    /// Share of the light that does not come straight from the lamp.
    pub(crate) fn diffuse(&self) -> f32 {
        self.diffuse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_surface_has_brightness_one_and_facing_the_lamp_is_brighter() {
        let shading = LightModel::default().in_tray(0.3);
        assert!((shading.on_slope(Vector2::zeros(), 1.0) - 1.0).abs() < 1e-6);
        let away = shading.toward_lamp.normalize() * 0.3;
        assert!(shading.on_slope(-away, 1.0) > 1.0);
        assert!(shading.on_slope(away, 1.0) < 1.0);
        assert!(shading.on_wall(away.normalize()) > shading.on_wall(-away.normalize()));
    }

    #[test]
    fn bad_light_is_refused_by_name() {
        let bad = LightModel { elevation_rad: 0.0, ..LightModel::default() };
        assert_eq!(bad.validate().unwrap_err().parameter, "light.elevation_rad");
        let bad = LightModel { white_level: f64::NAN, ..LightModel::default() };
        assert_eq!(bad.validate().unwrap_err().parameter, "light.white_level");
    }
}
