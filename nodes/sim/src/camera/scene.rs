//! What a picture is taken of: everything that does not move, and the tray at the moment of the exposure.

use nalgebra::{Isometry2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::appearance::TrayAppearance;
use super::light::LightModel;
use super::solid::PartSolid;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::range::OutOfRange;

/// The exposure for which [`LightModel::white_level`] is stated, s.
pub(super) const NOMINAL_EXPOSURE_S: f64 = 0.000_5;

/// The sensor behind the lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SensorModel {
    /// Standard deviation of the Gaussian noise, grey levels of 255.
    pub noise_sigma_levels: f64,
    /// How long the shutter is open, s. Brightness grows with it, and so does the blur of what moves.
    pub exposure_s: f64,
}

impl Default for SensorModel {
    fn default() -> Self {
        Self { noise_sigma_levels: 2.0, exposure_s: NOMINAL_EXPOSURE_S }
    }
}

impl SensorModel {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let sigma = self.noise_sigma_levels;
        OutOfRange::unless((0.0..=40.0).contains(&sigma), "sensor.noise_sigma_levels", sigma, "0 to 40")?;
        let exposure_ok = (1e-6..=1.0).contains(&self.exposure_s);
        OutOfRange::unless(exposure_ok, "sensor.exposure_s", self.exposure_s, "1e-6 to 1 s")
    }
}

/// Everything a picture depends on that does not move.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The camera.
    pub camera: CameraModel,
    /// The tray and its mounting.
    pub tray: MountedTray,
    /// How the tray looks.
    pub tray_appearance: TrayAppearance,
    /// The parts.
    pub part: PartSolid,
    /// The light.
    pub light: LightModel,
    /// The sensor.
    pub sensor: SensorModel,
}

impl Scene {
    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] naming the field of the scene that is out of range, or the camera if it hangs lower than twice
    /// the height of the tray's walls.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        self.tray.validate()?;
        self.tray_appearance.validate()?;
        self.part.validate()?;
        self.light.validate()?;
        self.sensor.validate()?;
        let height_m = self.camera.pose().height_m;
        let clears = height_m >= 2.0 * (self.tray.wall_top_m() + self.part.height_m_max());
        OutOfRange::unless(clears, "camera.pose.height_m", height_m, "at least twice the height of the tray's walls")
    }
}

/// The tray while a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrayShot {
    /// Pose of the tray in the middle of the exposure.
    pub platen_from_tray: Isometry2<f64>,
    /// Velocity of its centre over the platen, m/s.
    pub velocity_m_s: Vector2<f64>,
    /// How fast it turns, rad/s.
    pub yaw_rate_rad_s: f64,
}

impl TrayShot {
    /// A tray at rest.
    #[must_use]
    pub fn still(platen_from_tray: Isometry2<f64>) -> Self {
        Self { platen_from_tray, velocity_m_s: Vector2::zeros(), yaw_rate_rad_s: 0.0 }
    }

    /// Velocity over the platen of a point of the tray, m/s.
    pub(super) fn velocity_at(&self, in_tray: Point2<f64>) -> Vector2<f64> {
        let arm = self.platen_from_tray.rotation * in_tray.coords;
        self.velocity_m_s + Vector2::new(-arm.y, arm.x) * self.yaw_rate_rad_s
    }

    pub(super) fn after(&self, seconds: f64) -> Isometry2<f64> {
        let turn = self.platen_from_tray.rotation.angle() + self.yaw_rate_rad_s * seconds;
        Isometry2::new(self.platen_from_tray.translation.vector + self.velocity_m_s * seconds, turn)
    }
}
